/*
 * Proof that ars_can_pack_vehicle_motion() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_motion.goto" verify/prove_ars_can_pack_vehicle_motion.c -Iinclude -Iverify && goto-instrument --replace-calls to_code:to_code_of_lemma "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_motion.goto" "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_motion.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_can_pack_vehicle_motion.goto" --function prove_ars_can_pack_vehicle_motion --unwind 26 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

void prove_ars_can_pack_vehicle_motion(void);

/* Locals without a value have any value. */
void prove_ars_can_pack_vehicle_motion(void)
{
    ars_vehicle_motion_t signals;
    uint8_t data[8];

    ars_can_pack_vehicle_motion_requires(&signals, data);
    ars_can_pack_vehicle_motion(&signals, data);
    ars_vehicle_motion_t unpacked;
    ars_can_unpack_vehicle_motion(data, &unpacked);
    ars_can_pack_vehicle_motion_ensures(&signals, data);
    CONTRACT_ENSURE(code_in(data, 12u, 4u, false) == (((to_code(signals.speed, 200.0f, -32767, 32767, -32768) != -32768) ? 1u : 0u) | ((to_code(signals.front_angle, 20000.0f, -32767, 32767, -32768) != -32768) ? 2u : 0u) | ((to_code(signals.yaw_rate, 5000.0f, -32767, 32767, -32768) != -32768) ? 4u : 0u)), "the code of qualifier is in its bits of the frame");
    CONTRACT_ENSURE(code_in(data, 16u, 16u, false) == ((uint32_t)to_code(signals.speed, 200.0f, -32767, 32767, -32768) & 0xFFFFu), "the code of speed is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.speed, 200.0f, -32767, 32767, -32768) == -32768) ? (unpacked.speed != unpacked.speed) : (unpacked.speed == (((float)to_code(signals.speed, 200.0f, -32767, 32767, -32768) / 200.0f))), "speed is received as its code says");
    CONTRACT_ENSURE(code_in(data, 32u, 16u, false) == ((uint32_t)to_code(signals.front_angle, 20000.0f, -32767, 32767, -32768) & 0xFFFFu), "the code of front_angle is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.front_angle, 20000.0f, -32767, 32767, -32768) == -32768) ? (unpacked.front_angle != unpacked.front_angle) : (unpacked.front_angle == (((float)to_code(signals.front_angle, 20000.0f, -32767, 32767, -32768) / 20000.0f))), "front_angle is received as its code says");
    CONTRACT_ENSURE(code_in(data, 48u, 16u, false) == ((uint32_t)to_code(signals.yaw_rate, 5000.0f, -32767, 32767, -32768) & 0xFFFFu), "the code of yaw_rate is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.yaw_rate, 5000.0f, -32767, 32767, -32768) == -32768) ? (unpacked.yaw_rate != unpacked.yaw_rate) : (unpacked.yaw_rate == (((float)to_code(signals.yaw_rate, 5000.0f, -32767, 32767, -32768) / 5000.0f))), "yaw_rate is received as its code says");
    check_end();
}
