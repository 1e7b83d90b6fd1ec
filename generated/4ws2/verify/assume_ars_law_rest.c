/*
 * Stands for ars_law_rest() by its contract. See ars_contracts.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
void ars_law_rest(ars_law_t *self, const ars_measurement_t *sample, float friction, float rear_angle)
{
    const ars_law_t self_before = *self;
    ars_law_t any_self;

    ars_law_rest_requires(self, sample, friction, rear_angle);
    *self = any_self;
    ars_law_rest_ensures(self, sample, friction, rear_angle, &self_before);
}
