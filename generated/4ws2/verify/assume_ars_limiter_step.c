/*
 * Stands for ars_limiter_step() by its contract. See ars_contracts.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
float ars_limiter_step(ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input)
{
    const ars_limiter_t self_before = *self;
    ars_limiter_t any_self;
    float result;

    ars_limiter_step_requires(self, parameters, input);
    *self = any_self;
    ars_limiter_step_ensures(self, parameters, input, result, &self_before);
    return result;
}
