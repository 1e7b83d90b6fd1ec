/*
 * Safety limiter of the rear angle: the last stage before the command, independent of the controller.
 *
 * Limits the angle, its rate and, depending on speed, the angle opposite to the front wheels (opposite phase), which makes the car turn
 * more. It uses nothing of the controller and also works with another one. Call ars_limiter_step() every 10 ms.
 *
 * Guarantee: the result is finite, within +-rear_angle_max, and changes by at most rear_rate_max times 10 ms in a step
 * (by more only to return into +-rear_angle_max). Where the bound falls with speed, the angle returns to it at that rate.
 *
 * Units are SI (m/s, rad). Signs follow ISO 8855: angles are positive to the left.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_LIMITER_H
#define ARS_LIMITER_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_LIMITER_BUILD 0x76CDF87Cu

enum { ARS_LIMITER_POINTS = 6 };

/* Calibration parameters. Call ars_limiter_parameters_valid() after each change. */
typedef struct {
    float rear_angle_max;                                   /* rad, largest command */
    float rear_rate_max;                                    /* rad/s, largest rate of the command (off) */
    float opposite_phase_speed[ARS_LIMITER_POINTS];         /* m/s, speeds of the opposite-phase bound */
    float opposite_phase_max[ARS_LIMITER_POINTS];           /* rad, largest angle opposite to the front wheels at those speeds (off) */
    float in_phase_from_front_angle;                        /* rad, front angle from which the full in-phase angle is allowed */
    float speed_max;                                        /* m/s, largest valid speed; larger ones are ignored */
    float front_angle_max;                                  /* rad, largest valid front angle; larger ones are ignored */
} ars_limiter_parameters_t;

/* Inputs of one sample. NaN, and a value out of range, count as not available. */
typedef struct {
    float speed;       /* m/s, negative in reverse; not available: last value */
    float front_angle; /* rad, at the road wheel; not available: last value */
    float demand;      /* rad, demanded rear angle; not available: last result */
} ars_limiter_input_t;

/* State between two steps. Private. */
typedef struct {
    float rear_angle;  /* rad, last result */
    float speed;       /* m/s, magnitude of the last available one */
    float front_angle; /* rad, last available one */
    bool speed_known;  /* a speed was available at least once; until then the angle is held */
} ars_limiter_t;

/* Return whether every parameter is finite, in range and consistent with the others; false for NaN. */
bool ars_limiter_parameters_valid(const ars_limiter_parameters_t *parameters);

/* Start from the angle that the actuator holds now. rear_angle: rad, any number; NaN, and values beyond +-1 rad, count as 0. */
void ars_limiter_init(ars_limiter_t *self, float rear_angle);

/*
 * Return the angle to command in one sample, in rad. No pointer may be null, and parameters must be valid; the inputs may be any
 * numbers.
 */
float ars_limiter_step(
    ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input);

#ifdef __cplusplus
}
#endif

#endif /* ARS_LIMITER_H */
