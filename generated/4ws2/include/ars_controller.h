/*
 * Yaw-rate controller for active rear steering, kind "tracking".
 *
 * Call ars_controller_init() once, then ars_controller_step() every 10 ms. The caller owns all memory: one
 * ars_controller_t for each controlled axle. The functions do not allocate, block, read a clock or call a library. Instances
 * are independent of each other and may run in different tasks.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: steering angles and yaw rate are positive to the left, and a positive
 * rear angle points the same way as a positive front angle.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_CONTROLLER_H
#define ARS_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_grip.h"
#include "ars_inputs.h"
#include "ars_law.h"
#include "ars_limiter.h"
#include "ars_parameters.h"

#if ARS_GRIP_BUILD != 0xC9A75925u
#error "ars_grip.h and this source come from different builds"
#endif
#if ARS_INPUTS_BUILD != 0xC9A75925u
#error "ars_inputs.h and this source come from different builds"
#endif
#if ARS_LAW_BUILD != 0xC9A75925u
#error "ars_law.h and this source come from different builds"
#endif
#if ARS_LIMITER_BUILD != 0xC9A75925u
#error "ars_limiter.h and this source come from different builds"
#endif
#if ARS_PARAMETERS_BUILD != 0xC9A75925u
#error "ars_parameters.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_CONTROLLER_BUILD 0xC9A75925u

/* Mark of a state that ars_controller_init() has initialised. Not zero, so that cleared memory does not look initialised. */
#define ARS_CONTROLLER_INITIALISED 0x41525331u

/* Status of the last step. The command is finite and within its limits in every status. */
typedef enum {
    ARS_STATUS_TRACKING = 0, /* following the reference */
    ARS_STATUS_LIMITED = 1,  /* following, with the command at a limit: angle, rate, distance to the measured angle, or the limiter's */
    ARS_STATUS_STANDBY = 2,  /* no speed yet, or inhibited for good, then the rear angle returns to zero; kind pi: also too slow or reversing */
    ARS_STATUS_DEGRADED = 3, /* following, with one signal estimated or shortly predicted, or with held integrator: the loop is impaired */
    ARS_STATUS_FAIL_SAFE = 4 /* neither front angle nor yaw rate is valid: the rear angle returns to zero */
} ars_status_t;

/* Result of a step. */
typedef struct {
    float rear_angle;           /* rad, within +-rear_angle_max */
    float yaw_rate_reference;   /* rad/s, reference that is followed; predicted while degraded, 0 in standby and fail-safe */
    ars_status_t status;        /* status of the step */
} ars_command_t;

/* State between two steps. Private: read it in a debugger, change it only through the functions below. */
typedef struct {
    ars_law_t law;                      /* state of the control law */
    ars_grip_t grip;                    /* estimated grip of the road */
    float rear_angle;                   /* rad, last command */
    float yaw_rate_reference;           /* rad/s, last reference */
    float yaw_rate_error;               /* rad/s, last reference minus measured yaw rate; 0 while control is off */
    bool enabled;                       /* the control law runs */
    uint32_t initialised;               /* mark of an initialised state */
    ars_measurement_t sample;           /* last sample after the plausibility checks */
    ars_inputs_t inputs;                /* state of the plausibility checks */
    ars_limiter_t limiter;              /* state of the safety limiter */
    ars_quality_t quality;              /* quality of the last sample */
    ars_status_t status;                /* status of the last step */
} ars_controller_t;

/*
 * Start from the angle that the actuator holds now, so that the command does not jump.
 *
 * rear_angle: rad, any number. NaN counts as 0; a value beyond the actuator's limit counts as that limit.
 */
void ars_controller_init(ars_controller_t *self, float rear_angle);

/*
 * Continue an initialised controller from the angle that the actuator holds now, whatever was commanded meanwhile. Nothing else changes.
 *
 * rear_angle: as for ars_controller_init().
 */
void ars_controller_place(ars_controller_t *self, float rear_angle);

/*
 * Return the command of a sample without control: the angle returns to zero at the lower of fail_safe_rate and the rate of the limiter,
 * in standby. The next step starts anew from there.
 *
 * self, parameters: as for ars_controller_step().
 */
ars_command_t ars_controller_stand_by(ars_controller_t *self, const ars_parameters_t *parameters);

/*
 * Compute the command of one sample: check the measurement (ars_inputs.h), look up the reference, run the control law and
 * apply the safety limiter (ars_limiter.h).
 *
 * For a short time without a sample, the law continues with the last sample and the last yaw-rate error. A state that was never
 * initialised, or that contains NaN or infinity, is initialised from the measured rear angle, without it from the last command, and
 * starts in the fail-safe.
 *
 * self, parameters, measurement: must not be null.
 * parameters:  must be valid, see ars_parameters_valid().
 * measurement: may contain any number, NaN and infinity too; inhibit must be true or false.
 * Returns a command that is finite and within +-parameters->rear_angle_max in every case.
 */
ars_command_t ars_controller_step(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement);

/*
 * Return the CRC-32 over the map, ars_parameters_default and the tyre curves of the reference model in memory. The run
 * time is that of about 197880 table look-ups of four bits each.
 */
uint32_t ars_calibration_checksum(void);

/*
 * Test code and calibration, for use at power-up. The run time is little more than that of ars_calibration_checksum().
 *
 * Returns true if the calibration in memory has the checksum ars_calibration_expected_checksum, map and default parameters
 * are valid, and the CRC of the CAN frames gives its known values. Unless the map was changed by calibration, the lookup must also
 * return the values that it returned at build.
 */
bool ars_selftest(void);

#ifdef __cplusplus
}
#endif

#endif /* ARS_CONTROLLER_H */
