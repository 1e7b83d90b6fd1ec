/*
 * Estimate of the grip: the lateral acceleration that the car can reach on the present road.
 *
 * The control law demands no more than this grip allows. The estimate falls when the car reaches less lateral acceleration than the
 * reference model does, and recovers slowly. The fail-safe keeps it.
 *
 * Units are SI (m/s^2). Signs follow ISO 8855: the acceleration is positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_GRIP_H
#define ARS_GRIP_H

#include "ars_parameters.h"

#if ARS_PARAMETERS_BUILD != 0xC9A75925u
#error "ars_parameters.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_GRIP_BUILD 0xC9A75925u

/* State between two samples. Private: read it in a debugger, change it only through the functions below. */
typedef struct {
    float reached;              /* m/s^2, largest recent lateral acceleration */
    float available;            /* m/s^2, lateral acceleration that the road is assumed to carry */
} ars_grip_t;

/* Initialise with the full grip of the road that the map assumes. */
void ars_grip_init(ars_grip_t *self);

/*
 * Return the friction coefficient for the control law: the lower of 1.25 times the given estimate (at least
 * parameters->friction_min) and the friction that corresponds to the learned grip. The factor is above 1 because the map leaves part of
 * the grip unused: the estimate brings the demand near the limit of the road, and the learned grip does the rest.
 *
 * estimate: peak friction coefficient, any number; with NaN the grip alone decides.
 */
float ars_grip_friction(const ars_grip_t *self, const ars_parameters_t *parameters, float estimate);

/*
 * Update the estimate with a sample under control. The grip falls while the lateral acceleration, in the direction of the model's, is
 * lower than the model's by more than a tolerance. It does not fall below the largest acceleration reached recently. Otherwise it
 * recovers. The tolerance is parameters->grip_shortfall plus, while the model uses little of the grip,
 * parameters->grip_shortfall_share of the model's acceleration: soft tyres fall short in proportion even at small slip, a slippery
 * road mostly near the peak.
 *
 * model_acceleration, acceleration: m/s^2, of model and car; must be finite.
 */
void ars_grip_update(
    ars_grip_t *self, const ars_parameters_t *parameters, float model_acceleration, float acceleration);

/* Let the estimate recover in a sample in standby, in which there is no turn to learn from. */
void ars_grip_recover(ars_grip_t *self, const ars_parameters_t *parameters);

#ifdef __cplusplus
}
#endif

#endif /* ARS_GRIP_H */
