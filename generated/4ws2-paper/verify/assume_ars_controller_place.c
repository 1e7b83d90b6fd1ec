/*
 * Stands for ars_controller_place() by its contract. See ars_contracts.h.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
void ars_controller_place(ars_controller_t *self, float rear_angle)
{
    const ars_controller_t self_before = *self;
    ars_controller_t any_self;

    ars_controller_place_requires(self, rear_angle);
    *self = any_self;
    ars_controller_place_ensures(self, rear_angle, &self_before);
}
