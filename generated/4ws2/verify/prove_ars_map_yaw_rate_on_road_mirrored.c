/*
 * Proof that ars_map_yaw_rate_on_road() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_map_yaw_rate_on_road_mirrored.goto" verify/prove_ars_map_yaw_rate_on_road_mirrored.c -Iinclude -Iverify && goto-instrument --replace-calls magnitude:magnitude_of_lemma --replace-calls interpolate:interpolate_of_lemma "${TMPDIR:-/tmp}/prove_ars_map_yaw_rate_on_road_mirrored.goto" "${TMPDIR:-/tmp}/prove_ars_map_yaw_rate_on_road_mirrored.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_map_yaw_rate_on_road_mirrored.goto" --function prove_ars_map_yaw_rate_on_road_mirrored --unwind 16 --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

/* Any function of the position: the interpolation itself is not mirrored. */
float __CPROVER_uninterpreted_cell(bool is_first, uint32_t row, float row_share, uint32_t column, float column_share);

float interpolate_of_lemma(const float table[][ARS_MAP_FRONT_ANGLE_POINTS], const place_t *place)
{
    return __CPROVER_uninterpreted_cell(
        table == ars_map_yaw_rate_table, place->row.lower, place->row.fraction, place->column.lower, place->column.fraction);
}

float magnitude_of_lemma(float value)
{
    return fabsf(value); /* a term of the solver, where the union makes the bits of each call another number */
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_ars_map_yaw_rate_on_road_mirrored(void);

/* Locals without a value have any value. */
void prove_ars_map_yaw_rate_on_road_mirrored(void)
{
    float speed;
    float front_angle;
    float friction;
    float result;

    ars_map_yaw_rate_on_road_requires(speed, front_angle, friction);
    result = ars_map_yaw_rate_on_road(speed, front_angle, friction);
    (void)result;
    const float mirrored = ars_map_yaw_rate_on_road(speed, -front_angle, friction);
    CONTRACT_ENSURE(!((front_angle < 0.0f) || (front_angle > 0.0f)) || are_mirrored(result, mirrored), "the mirrored front angle gives the mirrored yaw rate");
    check_end();
}
