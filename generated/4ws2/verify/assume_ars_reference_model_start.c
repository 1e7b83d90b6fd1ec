/*
 * Stands for ars_reference_model_start() by its contract. See ars_contracts.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
void ars_reference_model_start(ars_reference_model_t *self, float speed, float yaw_rate, float rear_angle)
{
    ars_reference_model_t any_self;

    ars_reference_model_start_requires(self, speed, yaw_rate, rear_angle);
    *self = any_self;
    ars_reference_model_start_ensures(self, speed, yaw_rate, rear_angle);
}
