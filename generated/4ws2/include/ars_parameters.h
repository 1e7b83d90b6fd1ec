/*
 * Parameters of the controller, kind "tracking". Together with the map they are the calibration.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: steering angles and yaw rate are positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_PARAMETERS_H
#define ARS_PARAMETERS_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_inputs.h"
#include "ars_limiter.h"

#if ARS_INPUTS_BUILD != 0xC9A75925u
#error "ars_inputs.h and this source come from different builds"
#endif
#if ARS_LIMITER_BUILD != 0xC9A75925u
#error "ars_limiter.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_PARAMETERS_BUILD 0xC9A75925u

enum { ARS_SCHEDULE_POINTS = 8 };

/* Calibration parameters. Call ars_parameters_valid() after each change. */
typedef struct {
    float schedule_speed[ARS_SCHEDULE_POINTS];/* m/s, speeds of the gain schedule; the outermost gains hold beyond them */
    float proportional_gain[ARS_SCHEDULE_POINTS];/* s, proportional gain: rear angle for a yaw-rate error of 1 rad/s */
    float integral_gain[ARS_SCHEDULE_POINTS];/* integral gain: rear angle per integrated yaw-rate error */
    float lead_time[ARS_SCHEDULE_POINTS];/* s, prediction time of the front angle for the map */
    float response_gain[ARS_SCHEDULE_POINTS];/* s, gain on the difference between map and model yaw rate */
    float lead_smoothing;               /* weight of a new front-angle rate in its low-pass filter */
    float lead_angle_max;               /* rad, largest predicted change of the front angle */
    float response_samples;             /* prediction time of the model's yaw rate, in samples */
    float yaw_increasing_max;           /* rad, largest feedback that increases the yaw rate, at sideslip_max */
    float yaw_increasing_wide;          /* rad, largest feedback that increases the yaw rate, without outward sideslip */
    float sideslip_max;                 /* rad, outward sideslip at which yaw_increasing_max applies; beyond it, the reference falls */
    float turn_margin_rate;             /* rad/s, largest excess of the reference over the yaw rate from lateral acceleration */
    float turn_margin;                  /* m/s^2, lower limit of turn_margin_rate times the speed */
    float trim_share;                   /* largest trim as a share of the map's yaw rate */
    float trim_rate;                    /* 1/s, inverse time constant of the trim */
    float grip_shortfall;               /* m/s^2, missing lateral acceleration that does not count as lost grip */
    float grip_shortfall_share;         /* share of the model's acceleration added to grip_shortfall in gentle turns */
    float grip_loss_rate;               /* 1/s, inverse time constant with which the assumed grip falls */
    float grip_forgetting;              /* 1/s, inverse time constant for forgetting the largest lateral acceleration */
    float grip_recovery;                /* m/s^3, rise of the assumed grip in a turn */
    float grip_recovery_idle;           /* m/s^3, rise of the assumed grip while under half is used */
    float rear_angle_error_max;         /* rad, largest lead of the demand over the measured rear angle */
    float rear_angle_max;               /* rad, largest command, at most the actuator's largest angle */
    float rear_rate_max;                /* rad/s, largest rate of the command */
    float friction_min;                 /* lower friction estimates are raised to this value */
    float slow_speed;                   /* m/s, no feedback below it or in reverse; full from twice it */
    float fade_rate;                    /* rad/m, largest change of the command per metre below slow_speed */
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
