/*
 * Grip of the road: the lateral acceleration that the car is known to reach.
 *
 * The control law asks for no more than this grip allows. It falls when the car reaches less than the reference asks for, and rises
 * again slowly. It survives the fail-safe.
 *
 * Units are SI (m/s, rad/s, m/s^2). Signs follow ISO 8855: the yaw rate is positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_GRIP_H
#define ARS_GRIP_H

#include "ars_parameters.h"

#if ARS_PARAMETERS_BUILD != 0x3CA513E9u
#error "ars_parameters.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_GRIP_BUILD 0x3CA513E9u

/* Memory between two samples. Private: read it in a debugger, write it only through the functions below. */
typedef struct {
    float reached;              /* m/s^2 of lateral acceleration, lately */
    float available;            /* m/s^2 of lateral acceleration that the road has not yet refused */
} ars_grip_t;

/* Start from the full grip of the map's road. */
void ars_grip_init(ars_grip_t *self);

/*
 * Return the friction of the road: the estimate, but at least parameters->friction_min, or the friction of the grip if that is
 * lower.
 *
 * estimate: peak friction, any number; NaN means that none is known.
 */
float ars_grip_friction(const ars_grip_t *self, const ars_parameters_t *parameters, float estimate);

/*
 * Learn from a sample that the law has controlled. The grip falls while the lateral acceleration in the commanded turn is short
 * of the reference by more than parameters->grip_shortfall, but never below what the car reached lately.
 *
 * speed: m/s, yaw_rate_reference and yaw_rate: rad/s, all finite and within the ranges of ars_inputs.h.
 */
void ars_grip_update(
    ars_grip_t *self, const ars_parameters_t *parameters, float speed, float yaw_rate_reference, float yaw_rate);

/* Let the grip recover in a sample of standby: nothing is learned there, and what is known of the road grows old. */
void ars_grip_recover(ars_grip_t *self, const ars_parameters_t *parameters);

#ifdef __cplusplus
}
#endif

#endif /* ARS_GRIP_H */
