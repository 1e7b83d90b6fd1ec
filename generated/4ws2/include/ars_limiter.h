/*
 * Safety limiter of the rear angle: last in the chain, whatever computed the demand.
 *
 * Bounds the angle, its rate, and over speed the angle against the front wheels (opposite phase), which makes the car turn more.
 * Knows nothing of the controller: use it in front of any other one. Call ars_limiter_step() every 10 ms.
 *
 * What it guarantees: the result is finite, within +-rear_angle_max, and moves by at most rear_rate_max times 10 ms in a step
 * (more only where it would be outside +-rear_angle_max). Where the bounds over speed close in, it returns at that rate.
 *
 * Units are SI (m/s, rad). Signs follow ISO 8855: angles are positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_LIMITER_H
#define ARS_LIMITER_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_LIMITER_BUILD 0x3CA513E9u

enum { ARS_LIMITER_POINTS = 6 };

/* Everything that calibration may change. Ask ars_limiter_parameters_valid() after each change. */
typedef struct {
    float rear_angle_max;                                   /* rad, of the demand in any case */
    float rear_rate_max;                                    /* rad/s */
    float opposite_phase_speed[ARS_LIMITER_POINTS];         /* m/s, breakpoints, increasing */
    float opposite_phase_max[ARS_LIMITER_POINTS];           /* rad against the front wheels, at those speeds */
    float in_phase_from_front_angle;                        /* rad of front angle from which on all of rear_angle_max is free in phase */
    float speed_max;                                        /* m/s, beyond it a speed is none */
    float front_angle_max;                                  /* rad, beyond it a front angle is none */
} ars_limiter_parameters_t;

/* One sample. What is no number, or out of range, counts as not available. */
typedef struct {
    float speed;       /* m/s, negative in reverse; not available: the last one */
    float front_angle; /* rad, at the road wheel; not available: the last one */
    float demand;      /* rad, asked for at the rear wheels; not available: the last result */
} ars_limiter_input_t;

/* Memory between two steps. Private. */
typedef struct {
    float rear_angle;  /* rad, last result */
    float speed;       /* m/s, magnitude of the last one available */
    float front_angle; /* rad, last one available */
    bool speed_known;  /* whether there ever was one; before, the angle is held */
} ars_limiter_t;

/* Whether every parameter is finite, in range and consistent with the others. ars_limiter_step() relies on it. */
bool ars_limiter_parameters_valid(const ars_limiter_parameters_t *parameters);

/* Start from the angle that the actuator holds now. rear_angle: rad; NaN, and what is beyond +-1 rad, counts as 0. */
void ars_limiter_init(ars_limiter_t *self, float rear_angle);

/* One sample: the angle to command, rad. */
float ars_limiter_step(
    ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input);

#ifdef __cplusplus
}
#endif

#endif /* ARS_LIMITER_H */
