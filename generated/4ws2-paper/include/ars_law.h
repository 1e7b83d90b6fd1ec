/*
 * Control law, kind "pi": the paper's PI on the yaw-rate error.
 *
 * One part of the controller (ars_controller.h), which decides when the law runs and what happens otherwise.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: angles and yaw rate are positive to the left.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_LAW_H
#define ARS_LAW_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_inputs.h"
#include "ars_parameters.h"

#if ARS_INPUTS_BUILD != 0x4E569E35u
#error "ars_inputs.h and this source come from different builds"
#endif
#if ARS_PARAMETERS_BUILD != 0x4E569E35u
#error "ars_parameters.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_LAW_BUILD 0x4E569E35u

/* What the law does in a sample. */
typedef enum {
    ARS_LAW_STARTS = 0,    /* it did not run before: start without a jump of the command */
    ARS_LAW_CONTINUES = 1, /* it ran in the sample before */
    ARS_LAW_PREDICTS = 2   /* there is no new sample: go on with the last one and its yaw-rate error */
} ars_law_phase_t;

/* Memory between two samples. Private: read it in a debugger, write it only through the functions below. */
typedef struct {
    float integral;                     /* rad, of rear angle */
    bool is_limited;                    /* a limit acted in the last sample */
} ars_law_t;

/* What the law asks for. */
typedef struct {
    float rear_angle;           /* rad, from the last command by at most the rates of controller and limiter */
    float yaw_rate_reference;   /* rad/s, that is followed */
} ars_law_output_t;

/* Start from a commanded rear angle in rad, within +-1. */
void ars_law_init(ars_law_t *self, float rear_angle);

/*
 * One sample of the law. self->is_limited then holds whether a limit acted.
 *
 * sample:         what ars_inputs_step() believes: speed from 0.01 to 200 m/s, front angle within +-1.5 rad,
 *                 yaw rate within +-20 rad/s, and any rear angle.
 * friction:       peak friction of the road, above zero.
 * rear_angle:     rad, the last command, within +-1.
 * yaw_rate_error: rad/s, of the last sample that was not predicted: the reference less the yaw rate, within +-1000.
 */
ars_law_output_t ars_law_step(
    ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase,
    float friction, float rear_angle, float yaw_rate_error);

#ifdef __cplusplus
}
#endif

#endif /* ARS_LAW_H */
