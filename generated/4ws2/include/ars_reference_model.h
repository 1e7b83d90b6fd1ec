/*
 * Reference model: the yaw rate that the car can reach now.
 *
 * Single-track vehicle with Magic Formula tyres at static wheel loads. Its inputs are the front angle and the rear angle behind a
 * first-order actuator. Side forces follow the slip over a relaxation length of 0.4 m. A step is 10 ms of the leapfrog
 * scheme, which is stable at every speed.
 *
 * The functions call no library. The curve sin(C atan(x - E (x - atan x))) of each tyre, with a peak of at most 1, is a table that is
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

#define ARS_REFERENCE_MODEL_BUILD 0xC9A75925u

/* State of the model. Always finite: at most 0.349 rad of sideslip, 2.62 rad/s and 20 m/s^2. */
typedef struct {
    float sideslip_angle;       /* rad */
    float yaw_rate;             /* rad/s */
    float rear_angle;           /* rad, rear angle that the model's actuator has reached */
    float lateral_acceleration; /* m/s^2, of the centre of gravity; force of the tyres in the middle of the last step */
    float front_argument;       /* argument of the tyre curve; lags behind the motion by the relaxation length */
    float rear_argument;
} ars_reference_model_t;

/* Inputs of one step, in the ranges of ars_law_step(). With other numbers and NaN, the state has no meaning but stays finite. */
typedef struct {
    float speed;       /* m/s; lower values count as 1 m/s */
    float front_angle; /* rad, at the road wheel */
    float rear_angle;  /* rad, commanded */
    float friction;    /* peak friction coefficient of the road */
} ars_reference_model_input_t;

/*
 * Start in the steady turn of the linear vehicle at a speed (m/s), yaw rate (rad/s) and rear angle (rad), which gives the sideslip.
 */
void ars_reference_model_start(ars_reference_model_t *self, float speed, float yaw_rate, float rear_angle);

/* Advance the model by one step of 10 ms. */
void ars_reference_model_step(ars_reference_model_t *self, const ars_reference_model_input_t *input);

/* Return start, the checksum so far (ars_checksum.h), continued with both tyre curves. */
uint32_t ars_reference_model_crc(uint32_t start);

#ifdef __cplusplus
}
#endif

#endif /* ARS_REFERENCE_MODEL_H */
