/*
 * Parameters of the controller, kind "pi". Together with the map they are the calibration.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: steering angles and yaw rate are positive to the left.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_PARAMETERS_H
#define ARS_PARAMETERS_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_inputs.h"
#include "ars_limiter.h"

#if ARS_INPUTS_BUILD != 0x76CDF87Cu
#error "ars_inputs.h and this source come from different builds"
#endif
#if ARS_LIMITER_BUILD != 0x76CDF87Cu
#error "ars_limiter.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_PARAMETERS_BUILD 0x76CDF87Cu

/* Calibration parameters. Call ars_parameters_valid() after each change. */
typedef struct {
    float proportional_gain;            /* s, proportional gain: rear angle for a yaw-rate error of 1 rad/s */
    float integral_gain;                /* integral gain: rear angle per integrated yaw-rate error */
    float rear_angle_error_max;         /* rad, largest lead of the demand over the measured rear angle */
    float rear_angle_max;               /* rad, largest command, at most the actuator's largest angle */
    float rear_rate_max;                /* rad/s, largest rate of the command (off) */
    float friction_min;                 /* lower friction estimates are raised to this value */
    float enable_speed;                 /* m/s, control starts at this speed */
    float disable_speed;                /* m/s, control ends below this speed */
    float standby_rate;                 /* rad/s, rate of the return to zero in standby */
    float fail_safe_rate;               /* rad/s, rate of the return to zero in fail-safe */
    float actuator_share;               /* share of the remaining way that the actuator covers per sample */
    float actuator_error_max;           /* rad, tolerated position error, besides twice the remaining way */
    uint16_t actuator_samples_max;      /* deviating samples minus following ones until the actuator counts as stuck */
    uint16_t inhibit_samples_max;       /* consecutive samples with Inhibit until the controller enters standby */
    ars_inputs_parameters_t inputs;     /* parameters of the plausibility checks */
    ars_limiter_parameters_t limiter;   /* parameters of the safety limiter */
} ars_parameters_t;

/* Parameters of this build. */
extern const ars_parameters_t ars_parameters_default;

/* Identifier of the build (EPK), by which a calibration tool checks that its A2L file matches. */
extern const char ars_epk[9];

/*
 * Checksum that the self-test expects (ars_controller.h). When a calibration is frozen, store here what
 * ars_calibration_checksum() returns then.
 */
extern const uint32_t ars_calibration_expected_checksum;

/*
 * Return whether every parameter is finite, in range and consistent with the others, and the map is valid (ars_map_valid()).
 * Call it after each change of the calibration, outside the 10 ms task. ars_controller_step() requires valid parameters.
 */
bool ars_parameters_valid(const ars_parameters_t *parameters);

/* Return start, the checksum so far (ars_checksum.h), continued with ars_parameters_default, field by field in struct order. */
uint32_t ars_parameters_crc(uint32_t start);

#ifdef __cplusplus
}
#endif

#endif /* ARS_PARAMETERS_H */
