/*
 * Proof of lemma_place(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_place.c -Iinclude -Iverify --function prove_lemma_place --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_PLACE(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_map.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_PLACE
#define CONTRACT_LEMMA_PLACE(condition, text) __CPROVER_assume(condition)
#endif
static inline bool is_place(const place_t *place)
{
    return (place->row.lower <= 117u) && lies_between(place->row.fraction, 0.0f, 1.0f)
        && (place->column.lower <= 100u) && lies_between(place->column.fraction, 0.0f, 1.0f);
}

static inline void lemma_place(float speed, float front_angle)
{
    const place_t place = place_of(speed, magnitude(front_angle));

    CONTRACT_LEMMA_PLACE(is_place(&place), "the cell is inside of the table");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_place(void);

/* Locals without a value have any value. */
void prove_lemma_place(void)
{
    float speed;
    float front_angle;

    lemma_axes();
    lemma_place(speed, front_angle);
    check_end();
}
