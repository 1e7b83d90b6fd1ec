/*
 * Reference model: the yaw rate that the car can have now.
 *
 * The single-track car with Magic Formula tyres at static wheel loads, driven by the front angle and by what a first-order actuator
 * makes of the rear angle. One step is 10 ms by the linearly implicit midpoint rule, which is stable at every speed.
 *
 * Calls no library: each tyre's curve sin(C atan(x - E (x - atan x))), whose peak is at most 1, is a table,
 * off by at most 2.7e-04 in front and 2.7e-04 at the rear.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: angles and yaw rate are positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_REFERENCE_MODEL_H
#define ARS_REFERENCE_MODEL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_REFERENCE_MODEL_BUILD 0x3CA513E9u

/* Where the model is. Always finite: at most 0.349 rad of sideslip and 2.62 rad/s. */
typedef struct {
    float sideslip_angle; /* rad */
    float yaw_rate;       /* rad/s */
    float rear_angle;     /* rad, achieved by the model's actuator */
} ars_reference_model_t;

/* What drives it over one step, in the ranges of ars_law_step(). With other numbers, NaN among them, the model means nothing, but
 * stays finite. */
typedef struct {
    float speed;       /* m/s; below 1 m/s it counts as that */
    float front_angle; /* rad, at the road wheel */
    float rear_angle;  /* rad, commanded */
    float friction;    /* peak friction of the road */
} ars_reference_model_input_t;

/*
 * Start in a steady turn: the sideslip is that of the linear car at this speed (m/s), yaw rate (rad/s) and rear angle (rad).
 */
void ars_reference_model_start(ars_reference_model_t *self, float speed, float yaw_rate, float rear_angle);

/* One step of 10 ms. */
void ars_reference_model_step(ars_reference_model_t *self, const ars_reference_model_input_t *input);

/* Return the checksum so far (ars_checksum.h) with both tyre curves. */
uint32_t ars_reference_model_crc(uint32_t start);

#ifdef __cplusplus
}
#endif

#endif /* ARS_REFERENCE_MODEL_H */
