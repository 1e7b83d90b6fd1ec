/*
 * Proof of lemma_cell(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_cell.c -Iinclude -Iverify --function prove_lemma_cell --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_CELL(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_map.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_CELL
#define CONTRACT_LEMMA_CELL(condition, text) __CPROVER_assume(condition)
#endif
static inline bool is_place(const place_t *place)
{
    return (place->row.lower <= 117u) && lies_between(place->row.fraction, 0.0f, 1.0f)
        && (place->column.lower <= 100u) && lies_between(place->column.fraction, 0.0f, 1.0f);
}

/* The interpolation reads inside of the tables, and its result is close to the four numbers that it reads. These are the numbers of a
 * table with one cell: the position of a cell only decides where its numbers are. */
static inline void lemma_cell(void)
{
    float n[2][ARS_MAP_FRONT_ANGLE_POINTS];
    const float (*const table)[ARS_MAP_FRONT_ANGLE_POINTS] = (const float (*)[ARS_MAP_FRONT_ANGLE_POINTS])n;
    place_t place;
    float value, row, column;

    CONTRACT_ASSUME(is_place(&place));
    (void)interpolate(ars_map_yaw_rate_table, &place);
    (void)interpolate(ars_map_rear_angle_table, &place);
    place.row.lower = 0u;
    place.column.lower = 0u;
    row = place.row.fraction;
    column = place.column.fraction;
    lemma_interpolation(n[0][0], n[1][0], row);
    lemma_interpolation(n[0][1], n[1][1], row);
    lemma_interpolation(n[0][0] + (row * (n[1][0] - n[0][0])), n[0][1] + (row * (n[1][1] - n[0][1])), column);
    value = interpolate(table, &place);
    CONTRACT_LEMMA_CELL(!lies_between(n[0][0], 0.0f, 10.0f) || !lies_between(n[1][0], 0.0f, 10.0f)
        || !lies_between(n[0][1], 0.0f, 10.0f) || !lies_between(n[1][1], 0.0f, 10.0f)
        || lies_between(value, 0.0f, 16.0f), "a number of a cell is in range");
    CONTRACT_LEMMA_CELL(!lies_between(n[0][0], -0.5f, 0.5f) || !lies_between(n[1][0], -0.5f, 0.5f)
        || !lies_between(n[0][1], -0.5f, 0.5f) || !lies_between(n[1][1], -0.5f, 0.5f)
        || lies_within(value, 1.0f), "a number of a cell is in range");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_cell(void);

/* Locals without a value have any value. */
void prove_lemma_cell(void)
{
    lemma_cell();
    check_end();
}
