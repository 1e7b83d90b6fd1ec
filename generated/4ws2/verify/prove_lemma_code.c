/*
 * Proof of lemma_code(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_code.c -Iinclude -Iverify --function prove_lemma_code --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_CODE(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_can.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_CODE
#define CONTRACT_LEMMA_CODE(condition, text) __CPROVER_assume(condition)
#endif
/* A code is nearest to its number. The conversions of packing are checked here, as codes with a sign become bytes elsewhere. */
static inline void lemma_code(float value, float scale, int32_t low, int32_t high, int32_t not_available)
{
    CONTRACT_ASSUME((scale > 0.0f) && (low < high) && (low > -0x1000000) && (high < 0x1000000));
    const int32_t code = to_code(value, scale, low, high, not_available);
    const float scaled = value * scale;
    const float most = (scaled < (float)high) ? scaled : (float)high;
    const float bounded = (most > (float)low) ? most : (float)low;
    const bool is_number = (scaled == scaled);

    CONTRACT_LEMMA_CODE(is_number ? ((code >= low) && (code <= high)) : (code == not_available), "the code is in range, or that of NaN");
    CONTRACT_LEMMA_CODE(!is_number || lies_within(bounded - (float)code, 0.5f), "the code is within half a step of the number");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_code(void);

/* Locals without a value have any value. */
void prove_lemma_code(void)
{
    float value;
    float scale;
    int32_t low;
    int32_t high;
    int32_t not_available;

    lemma_code(value, scale, low, high, not_available);
    check_end();
}
