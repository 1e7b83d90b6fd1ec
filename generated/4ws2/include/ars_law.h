/*
 * Control law, kind "tracking": feedforward of the optimum, reference model, scheduled feedback.
 *
 * Part of the controller (ars_controller.h), which decides when the law runs.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: angles and yaw rate are positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_LAW_H
#define ARS_LAW_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_inputs.h"
#include "ars_parameters.h"
#include "ars_reference_model.h"

#if ARS_INPUTS_BUILD != 0xC9A75925u
#error "ars_inputs.h and this source come from different builds"
#endif
#if ARS_PARAMETERS_BUILD != 0xC9A75925u
#error "ars_parameters.h and this source come from different builds"
#endif
#if ARS_REFERENCE_MODEL_BUILD != 0xC9A75925u
#error "ars_reference_model.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_LAW_BUILD 0xC9A75925u

/* Phase of the law in a sample. */
typedef enum {
    ARS_LAW_STARTS = 0,    /* first sample under control: start without a jump of the command */
    ARS_LAW_CONTINUES = 1, /* the law ran in the previous sample */
    ARS_LAW_PREDICTS = 2   /* no new sample: continue with the last one and its yaw-rate error */
} ars_law_phase_t;

/* State between two samples. Private: read it in a debugger, change it only through the functions below. */
typedef struct {
    ars_reference_model_t model;        /* reference model of the car */
    float trim;                         /* rad/s, correction towards the map's yaw rate */
    float sideslip;                     /* rad, observed sideslip angle */
    float integral;                     /* rad, integral part of the rear angle */
    float front_angle;                  /* rad, front angle of the last sample */
    float front_rate;                   /* rad/s, smoothed rate of the front angle */
    float previous_model_yaw_rate;      /* rad/s, yaw rate of the model one sample ago */
    uint16_t missed_samples;            /* predicted samples since the last good one */
    float yaw_rate;                     /* rad/s, yaw rate of the last sample */
    bool is_limited;                    /* a limit acted in the last sample */
} ars_law_t;

/* Result of the law. */
typedef struct {
    float rear_angle;           /* rad, demand; changes by at most the lower rate of controller and limiter */
    float yaw_rate_reference;   /* rad/s, reference that is followed */
} ars_law_output_t;

/* Initialise. rear_angle: rad, commanded now, within +-1; must not be NaN. */
void ars_law_init(ars_law_t *self, float rear_angle);

/*
 * Compute one sample of the law and set self->is_limited if a limit was active. No pointer may be null, and parameters must be valid.
 * With arguments in these ranges the result is finite.
 *
 * sample:         as ars_inputs_step() returns it: speed from -200 to 200 m/s, front angle within +-1.5 rad,
 *                 yaw rate within +-20 rad/s, and any rear angle.
 * friction:       peak friction coefficient of the road, above zero.
 * rear_angle:     rad, the last command, within +-1.
 * yaw_rate_error: rad/s, reference minus yaw rate in the last sample that was not predicted, within +-1000.
 */
ars_law_output_t ars_law_step(
    ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase,
    float friction, float rear_angle, float yaw_rate_error);

/* Move the reference model on in a sample without control, with arguments as above but for the speed, which may be any number. */
void ars_law_rest(ars_law_t *self, const ars_measurement_t *sample, float friction, float rear_angle);

#ifdef __cplusplus
}
#endif

#endif /* ARS_LAW_H */
