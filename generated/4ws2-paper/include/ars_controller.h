/*
 * Yaw-rate controller for active rear steering, kind "pi".
 *
 * Call ars_controller_init() once, then ars_controller_step() every 10 ms. All memory is the caller's: one
 * ars_controller_t for each controlled axle. Nothing here allocates, blocks, reads a clock or calls a library; instances are
 * independent of each other and may run in different tasks.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: steering angles and yaw rate are positive to the left, and a positive
 * rear angle points the same way as a positive front angle.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_CONTROLLER_H
#define ARS_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_inputs.h"
#include "ars_law.h"
#include "ars_limiter.h"
#include "ars_parameters.h"

#if ARS_INPUTS_BUILD != 0x4E569E35u
#error "ars_inputs.h and this source come from different builds"
#endif
#if ARS_LAW_BUILD != 0x4E569E35u
#error "ars_law.h and this source come from different builds"
#endif
#if ARS_LIMITER_BUILD != 0x4E569E35u
#error "ars_limiter.h and this source come from different builds"
#endif
#if ARS_PARAMETERS_BUILD != 0x4E569E35u
#error "ars_parameters.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_CONTROLLER_BUILD 0x4E569E35u

/* What the last step did. In every state the command is finite and within its limits. */
typedef enum {
    ARS_STATUS_TRACKING = 0, /* following the reference */
    ARS_STATUS_LIMITED = 1,  /* following, with the command at a limit: angle, rate, distance to the measured angle, or the limiter's */
    ARS_STATUS_STANDBY = 2,  /* too slow (with hysteresis), or reversing: the rear angle returns to zero */
    ARS_STATUS_DEGRADED = 3, /* following, with a signal replaced by the others, or predicting for a short time without a sample */
    ARS_STATUS_FAIL_SAFE = 4 /* neither front angle nor yaw rate is believed: the rear angle goes to zero */
} ars_status_t;

/* What the controller asks for, and why. */
typedef struct {
    float rear_angle;           /* rad, within +-rear_angle_max */
    float yaw_rate_reference;   /* rad/s, what is followed; predicted while degraded, 0 in standby and fail-safe */
    ars_status_t status;        /* what the step did */
} ars_command_t;

/* Memory between two steps. Private: read it in a debugger, write it only through the functions below. */
typedef struct {
    ars_law_t law;                      /* the control law */
    float rear_angle;                   /* rad, last command */
    float yaw_rate_reference;           /* rad/s, last reference */
    float yaw_rate_error;               /* rad/s, last reference less measured yaw rate; 0 where control is off */
    bool enabled;                       /* above the enabling speed, with hysteresis: the law runs */
    uint32_t initialised;               /* a mark, of which memory without an initialisation has none */
    ars_measurement_t sample;           /* what is believed of the last one */
    ars_inputs_t inputs;                /* first in the chain */
    ars_limiter_t limiter;              /* last in the chain */
    ars_quality_t quality;              /* of the last sample */
    ars_status_t status;                /* of the last step */
} ars_controller_t;

/*
 * Start from the angle that the actuator holds now, without a jump.
 *
 * rear_angle: rad; NaN counts as 0, and beyond the actuator's limit as the limit.
 */
void ars_controller_init(ars_controller_t *self, float rear_angle);

/*
 * One sample: find what is believed of the measurement (ars_inputs.h), look the reference up, control, limit (ars_limiter.h
 * has the last word).
 *
 * For a short time without a sample the law goes on with the last one and the last yaw-rate error. Memory that was never initialised, or
 * that holds NaN or infinity, starts afresh from the measured rear angle, in the fail-safe.
 *
 * None of the pointers may be null; parameters must be valid; measurement may hold any number,
 * and inhibit must be true or false.
 * Returns a command that is finite and within +-parameters->rear_angle_max in every case.
 */
ars_command_t ars_controller_step(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement);

/*
 * Return the CRC-32 over the map and ars_parameters_default in memory. Takes about
 * 85276 table look-ups of four bits.
 */
uint32_t ars_calibration_checksum(void);

/*
 * Whether the calibration in memory has the checksum ars_calibration_expected_checksum, map and default parameters are valid, and
 * the CRC of the CAN frames has its known values; and, unless the map was calibrated, whether the lookup gives the values that it
 * had at build. For power-up; takes little more than ars_calibration_checksum().
 */
bool ars_selftest(void);

#ifdef __cplusplus
}
#endif

#endif /* ARS_CONTROLLER_H */
