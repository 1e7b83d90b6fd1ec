/*
 * Stands for ars_limiter_parameters_valid() by its contract. See ars_contracts.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assume(condition)

#include "ars_contracts.h"

/* Locals without a value have any value. */
bool ars_limiter_parameters_valid(const ars_limiter_parameters_t *parameters)
{
    bool result;

    ars_limiter_parameters_valid_requires(parameters);
    ars_limiter_parameters_valid_ensures(parameters, result);
    return result;
}
