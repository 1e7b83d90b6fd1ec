/*
 * Stands for ars_inputs_step() by its contract. See ars_contracts.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
ars_quality_t ars_inputs_step(ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle, const ars_reference_model_t *model, ars_measurement_t *checked)
{
    const ars_inputs_t self_before = *self;
    ars_inputs_t any_self;
    ars_measurement_t any_checked;
    ars_quality_t result;

    ars_inputs_step_requires(self, parameters, measured, rear_angle, model, checked);
    *self = any_self;
    *checked = any_checked;
    ars_inputs_step_ensures(self, parameters, measured, rear_angle, model, checked, result, &self_before);
    return result;
}
