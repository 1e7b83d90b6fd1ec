/*
 * Stands for ars_grip_update() by its contract. See ars_contracts.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
void ars_grip_update(ars_grip_t *self, const ars_parameters_t *parameters, float model_acceleration, float acceleration)
{
    const ars_grip_t self_before = *self;
    ars_grip_t any_self;

    ars_grip_update_requires(self, parameters, model_acceleration, acceleration);
    *self = any_self;
    ars_grip_update_ensures(self, parameters, model_acceleration, acceleration, &self_before);
}
