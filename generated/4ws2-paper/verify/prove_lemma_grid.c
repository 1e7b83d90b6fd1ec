/*
 * Proof of lemma_grid(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_grid.c -Iinclude -Iverify --function prove_lemma_grid --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_GRID(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_map.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_GRID
#define CONTRACT_LEMMA_GRID(condition, text) __CPROVER_assume(condition)
#endif
/* With shares of zero and one, the interpolation gives the number of a corner. Four cells are enough, and numbers of zero and one: the
 * interpolation has no branches, so that the position only decides which numbers it reads. */
static inline void lemma_grid(void)
{
    float n[3][ARS_MAP_FRONT_ANGLE_POINTS];
    place_t place;
    bool is_faster, is_right;
    float value;

    CONTRACT_ASSUME((place.row.lower <= 1u) && (place.column.lower <= 1u));
    for (uint32_t k = 0u; k < 9u; k++) {
        CONTRACT_ASSUME((n[k / 3u][k % 3u] == 0.0f) || (n[k / 3u][k % 3u] == 1.0f));
    }
    place.row.fraction = is_faster ? 1.0f : 0.0f;
    place.column.fraction = is_right ? 1.0f : 0.0f;
    value = interpolate((const float (*)[ARS_MAP_FRONT_ANGLE_POINTS])n, &place);
    CONTRACT_LEMMA_GRID(value == n[place.row.lower + (is_faster ? 1u : 0u)][place.column.lower + (is_right ? 1u : 0u)],
        "on a grid point, it is the number there");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_grid(void);

/* Locals without a value have any value. */
void prove_lemma_grid(void)
{
    lemma_grid();
    check_end();
}
