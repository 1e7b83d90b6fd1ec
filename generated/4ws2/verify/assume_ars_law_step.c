/*
 * Stands for ars_law_step() by its contract. See ars_contracts.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
ars_law_output_t ars_law_step(ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase, float friction, float rear_angle, float yaw_rate_error)
{
    const ars_law_t self_before = *self;
    ars_law_t any_self;
    ars_law_output_t result;

    ars_law_step_requires(self, parameters, sample, phase, friction, rear_angle, yaw_rate_error);
    *self = any_self;
    ars_law_step_ensures(self, parameters, sample, phase, friction, rear_angle, yaw_rate_error, &result, &self_before);
    return result;
}
