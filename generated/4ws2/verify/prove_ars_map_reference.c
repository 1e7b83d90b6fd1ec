/*
 * Proof that ars_map_reference() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_map_reference.goto" verify/prove_ars_map_reference.c -Iinclude -Iverify && goto-instrument --replace-calls interpolate:interpolate_of_lemma "${TMPDIR:-/tmp}/prove_ars_map_reference.goto" "${TMPDIR:-/tmp}/prove_ars_map_reference.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_map_reference.goto" --function prove_ars_map_reference --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

static float yaw_rate_of_cell;

float interpolate_of_lemma(const float table[][ARS_MAP_FRONT_ANGLE_POINTS], const place_t *place)
{
    float result;

    __CPROVER_assert(is_place(place), "the cell is inside of the table");
    CONTRACT_ASSUME((table != ars_map_yaw_rate_table) || lies_between(result, 0.0f, 16.0f));
    CONTRACT_ASSUME((table != ars_map_rear_angle_table) || lies_within(result, 1.0f));
    yaw_rate_of_cell = (table == ars_map_yaw_rate_table) ? result : yaw_rate_of_cell;
    return result;
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_ars_map_reference(void);

/* Locals without a value have any value. */
void prove_ars_map_reference(void)
{
    float speed;
    float front_angle;
    float friction;
    ars_map_reference_t result;

    ars_map_reference_requires(speed, front_angle, friction);
    lemma_axes();
    lemma_constants();
    lemma_place(speed, front_angle);
    result = ars_map_reference(speed, front_angle, friction);
    lemma_cap(yaw_rate_of_cell, speed, road_of(friction).lateral_acceleration_max);
    ars_map_reference_ensures(speed, front_angle, friction, &result);
    check_end();
}
