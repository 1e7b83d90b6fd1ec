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

#if ARS_INPUTS_BUILD != 0xD8B70D2Bu
#error "ars_inputs.h and this source come from different builds"
#endif
#if ARS_LIMITER_BUILD != 0xD8B70D2Bu
#error "ars_limiter.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_PARAMETERS_BUILD 0xD8B70D2Bu

enum { ARS_SCHEDULE_POINTS = 8 };

/* Calibration parameters. Call ars_parameters_valid() after each change. */
typedef struct {
    float schedule_speed[ARS_SCHEDULE_POINTS];/* m/s, breakpoints of the gains, increasing; the last gains hold beyond them */
    float proportional_gain[ARS_SCHEDULE_POINTS];/* s: rad of rear angle for each rad/s of error */
    float integral_gain[ARS_SCHEDULE_POINTS];/* rad of rear angle for each rad of integrated error */
    float lead_time[ARS_SCHEDULE_POINTS];/* s, prediction time of the front angle that enters the map */
    float response_gain[ARS_SCHEDULE_POINTS];/* s: rad of rear angle for each rad/s that the model's yaw rate is below the map's */
    float lead_smoothing;               /* weight of a new rate of the front angle in its low-pass filter */
    float lead_angle_max;               /* rad, bound of the predicted change */
    float response_samples;             /* samples, prediction time of the model's yaw rate for the response gain */
    float yaw_increasing_max;           /* rad, bound of the feedback in the direction that increases the yaw rate */
    float yaw_increasing_wide;          /* rad, the same bound without sideslip out of the turn */
    float sideslip_max;                 /* rad, sideslip out of the turn at which that bound ends, and beyond which the reference falls */
    float turn_margin_rate;             /* rad/s, by which the reference may exceed the turn of the lateral acceleration */
    float turn_margin;                  /* m/s^2, smallest such margin */
    float trim_share;                   /* bound of the trim, as a share of the map's yaw rate */
    float trim_rate;                    /* 1/s, inverse time constant of the trim */
    float grip_shortfall;               /* m/s^2, shortfall of lateral acceleration that does not count as a loss of grip */
    float grip_shortfall_share;         /* share of the model's acceleration that is added to it while little grip is used */
    float grip_loss_rate;               /* 1/s, inverse time constant of a loss of grip */
    float grip_forgetting;              /* 1/s, inverse time constant of the reached lateral acceleration */
    float grip_recovery;                /* m/s^3, recovery of the grip in a turn */
    float grip_recovery_idle;           /* m/s^3, recovery while less than half of the grip is needed */
    float rear_angle_error_max;         /* rad, largest distance of the demand from the measured rear angle */
    float rear_angle_max;               /* rad, bound of the command, at most the actuator's largest angle */
    float rear_rate_max;                /* rad/s, bound on the command's rate */
    float friction_min;                 /* a lower estimate counts as this */
    float slow_speed;                   /* m/s, no feedback below and in reverse, whole from twice it on */
    float fade_rate;                    /* rad/m, largest change of the command for each metre below slow_speed */
    float fail_safe_rate;               /* rad/s, return to zero in fail-safe */
    float actuator_share;               /* of the way to the command that the actuator goes in a sample */
    float actuator_error_max;           /* rad, tolerated error, in addition to twice the remaining way */
    uint16_t actuator_samples_max;      /* samples off, less others, then it is stuck */
    uint16_t inhibit_samples_max;       /* consecutive samples with Inhibit, then it is set for good */
    ars_inputs_parameters_t inputs;     /* of the plausibility checks */
    ars_limiter_parameters_t limiter;   /* of the safety limiter */
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
