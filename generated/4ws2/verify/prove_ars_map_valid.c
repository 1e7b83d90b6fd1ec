/*
 * Proof that ars_map_valid() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_map_valid.goto" verify/prove_ars_map_valid.c -Iinclude -Iverify && goto-instrument --replace-calls are_between:are_between_of_lemma --replace-calls are_increasing:are_increasing_of_lemma --replace-calls are_even:are_even_of_lemma "${TMPDIR:-/tmp}/prove_ars_map_valid.goto" "${TMPDIR:-/tmp}/prove_ars_map_valid.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_map_valid.goto" --function prove_ars_map_valid --unwind 120 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_map.c"
#include "ars_contracts.h"

bool are_between_of_lemma(const float *numbers, uint32_t count, float low, float high)
{
    bool result;

    CONTRACT_ASSUME(!result || (any_column >= count) || (numbers != ars_map_yaw_rate_table[any_row])
        || lies_between(ars_map_yaw_rate_table[any_row][any_column], low, high));
    CONTRACT_ASSUME(!result || (any_column >= count) || (numbers != ars_map_rear_angle_table[any_row])
        || lies_between(ars_map_rear_angle_table[any_row][any_column], low, high));
    CONTRACT_ASSUME(!result || (any_row >= count) || (numbers != ars_map_speed_breakpoints) || lies_between(ars_map_speed_breakpoints[any_row], low, high));
    CONTRACT_ASSUME(!result || (any_column >= count) || (numbers != ars_map_front_angle_breakpoints) || lies_between(ars_map_front_angle_breakpoints[any_column], low, high));
    return result;
}

bool are_increasing_of_lemma(const float *numbers, uint32_t count)
{
    bool result;

    CONTRACT_ASSUME(!result || (any_row >= count) || (numbers != ars_map_speed_breakpoints)
        || ((any_row == 0u) ? (ars_map_speed_breakpoints[0] <= 0.0f) : (ars_map_speed_breakpoints[any_row - 1u] < ars_map_speed_breakpoints[any_row])));
    CONTRACT_ASSUME(!result || (any_column >= count) || (numbers != ars_map_front_angle_breakpoints)
        || ((any_column == 0u) ? (ars_map_front_angle_breakpoints[0] <= 0.0f) : (ars_map_front_angle_breakpoints[any_column - 1u] < ars_map_front_angle_breakpoints[any_column])));
    return result;
}

bool are_even_of_lemma(const float *numbers, uint32_t count)
{
    bool result; /* no claim needs even steps */

    (void)numbers;
    (void)count;
    return result;
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_ars_map_valid(void);

/* Locals without a value have any value. */
void prove_ars_map_valid(void)
{
    bool result;

    ars_map_valid_requires();
    CONTRACT_ASSUME((any_row < (uint32_t)ARS_MAP_SPEED_POINTS) && (any_column < (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS));
    result = ars_map_valid();
    ars_map_valid_ensures(result);
    check_end();
}
