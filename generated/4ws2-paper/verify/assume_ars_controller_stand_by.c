/*
 * Stands for ars_controller_stand_by() by its contract. See ars_contracts.h.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
ars_command_t ars_controller_stand_by(ars_controller_t *self, const ars_parameters_t *parameters)
{
    const ars_controller_t self_before = *self;
    ars_controller_t any_self;
    ars_command_t result;

    ars_controller_stand_by_requires(self, parameters);
    *self = any_self;
    ars_controller_stand_by_ensures(self, parameters, &result, &self_before);
    return result;
}
