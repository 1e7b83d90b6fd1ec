/*
 * Proof that ars_can_pack_vehicle_conditions() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_conditions.goto" verify/prove_ars_can_pack_vehicle_conditions.c -Iinclude -Iverify && goto-instrument --replace-calls to_code:to_code_of_lemma "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_conditions.goto" "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_conditions.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_conditions.goto" --function prove_ars_can_pack_vehicle_conditions --unwind 26 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_can.c"
#include "ars_contracts.h"

/* An arbitrary function with results in range; equal arguments give equal results. */
int32_t __CPROVER_uninterpreted_code(float value, float scale, int32_t low, int32_t high, int32_t not_available);

int32_t to_code_of_lemma(float value, float scale, int32_t low, int32_t high, int32_t not_available)
{
    const int32_t code = __CPROVER_uninterpreted_code(value, scale, low, high, not_available);

    CONTRACT_ASSUME((code == not_available) || ((code >= low) && (code <= high)));
    return code;
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_ars_can_pack_vehicle_conditions(void);

/* Locals without a value have any value. */
void prove_ars_can_pack_vehicle_conditions(void)
{
    ars_vehicle_conditions_t signals;
    uint8_t data[8];

    ars_can_pack_vehicle_conditions_requires(&signals, data);
    ars_can_pack_vehicle_conditions(&signals, data);
    ars_vehicle_conditions_t unpacked;
    ars_can_unpack_vehicle_conditions(data, &unpacked);
    ars_can_pack_vehicle_conditions_ensures(&signals, data);
    CONTRACT_ENSURE(code_in(data, 12u, 1u, false) == (signals.inhibit ? 1u : 0u), "the code of inhibit is in its bits of the frame");
    CONTRACT_ENSURE((unpacked.inhibit ? 1u : 0u) == (signals.inhibit ? 1u : 0u), "inhibit is received as its code says");
    CONTRACT_ENSURE(code_in(data, 16u, 16u, false) == ((uint32_t)to_code(signals.rear_angle, 20000.0f, -32767, 32767, -32768) & 0xFFFFu), "the code of rear_angle is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.rear_angle, 20000.0f, -32767, 32767, -32768) == -32768) ? (unpacked.rear_angle != unpacked.rear_angle) : (unpacked.rear_angle == (((float)to_code(signals.rear_angle, 20000.0f, -32767, 32767, -32768) / 20000.0f))), "rear_angle is received as its code says");
    CONTRACT_ENSURE(code_in(data, 32u, 8u, false) == ((uint32_t)to_code(signals.friction, 100.0f, 0, 254, 255) & 0xFFu), "the code of friction is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.friction, 100.0f, 0, 254, 255) == 255) ? (unpacked.friction != unpacked.friction) : (unpacked.friction == (((float)to_code(signals.friction, 100.0f, 0, 254, 255) / 100.0f))), "friction is received as its code says");
    CONTRACT_ENSURE(code_in(data, 48u, 16u, false) == ((uint32_t)to_code(signals.lateral_acceleration, 1000.0f, -32767, 32767, -32768) & 0xFFFFu), "the code of lateral_acceleration is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.lateral_acceleration, 1000.0f, -32767, 32767, -32768) == -32768) ? (unpacked.lateral_acceleration != unpacked.lateral_acceleration) : (unpacked.lateral_acceleration == (((float)to_code(signals.lateral_acceleration, 1000.0f, -32767, 32767, -32768) / 1000.0f))), "lateral_acceleration is received as its code says");
    check_end();
}
