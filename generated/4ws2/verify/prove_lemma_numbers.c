/*
 * Proof of lemma_numbers(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_numbers.c -Iinclude -Iverify --function prove_lemma_numbers --unwind 120 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_NUMBERS(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_map.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_NUMBERS
#define CONTRACT_LEMMA_NUMBERS(condition, text) __CPROVER_assume(condition)
#endif
/* The functions that check the numbers of a row, or the breakpoints of an axis, check each of them. */
static inline void lemma_numbers(void)
{
    float numbers[119], low, high;
    uint32_t count, k;
    bool between, increasing;

    CONTRACT_ASSUME((count >= 1u) && (count <= 119u) && (k < count));
    between = are_between(numbers, count, low, high);
    increasing = are_increasing(numbers, count);
    (void)are_even(numbers, (count > 1u) ? (count - 1u) : 1u);
    CONTRACT_LEMMA_NUMBERS(!between || lies_between(numbers[k], low, high), "any number is in range");
    CONTRACT_LEMMA_NUMBERS(!increasing || ((k == 0u) ? (numbers[0] <= 0.0f) : (numbers[k - 1u] < numbers[k])), "an axis starts at zero or below and increases");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_numbers(void);

/* Locals without a value have any value. */
void prove_lemma_numbers(void)
{
    lemma_numbers();
    check_end();
}
