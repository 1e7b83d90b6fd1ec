/*
 * Proof that ars_can_pack_rear_steer_command() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_can_pack_rear_steer_command.goto" verify/prove_ars_can_pack_rear_steer_command.c -Iinclude -Iverify && goto-instrument --replace-calls to_code:to_code_of_lemma "${TMPDIR:-/tmp}/prove_ars_can_pack_rear_steer_command.goto" "${TMPDIR:-/tmp}/prove_ars_can_pack_rear_steer_command.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_can_pack_rear_steer_command.goto" --function prove_ars_can_pack_rear_steer_command --unwind 26 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

void prove_ars_can_pack_rear_steer_command(void);

/* Locals without a value have any value. */
void prove_ars_can_pack_rear_steer_command(void)
{
    ars_rear_steer_command_t signals;
    uint8_t data[8];

    ars_can_pack_rear_steer_command_requires(&signals, data);
    ars_can_pack_rear_steer_command(&signals, data);
    ars_rear_steer_command_t unpacked;
    ars_can_unpack_rear_steer_command(data, &unpacked);
    ars_can_pack_rear_steer_command_ensures(&signals, data);
    CONTRACT_ENSURE(code_in(data, 12u, 4u, false) == ((uint32_t)signals.status & 0xFu), "the code of status is in its bits of the frame");
    CONTRACT_ENSURE((uint32_t)unpacked.status == ((uint32_t)signals.status & 0xFu), "status is received as its code says");
    CONTRACT_ENSURE(code_in(data, 16u, 16u, false) == ((uint32_t)to_code(signals.rear_angle, 20000.0f, -32767, 32767, -32768) & 0xFFFFu), "the code of rear_angle is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.rear_angle, 20000.0f, -32767, 32767, -32768) == -32768) ? (unpacked.rear_angle != unpacked.rear_angle) : (unpacked.rear_angle == (((float)to_code(signals.rear_angle, 20000.0f, -32767, 32767, -32768) / 20000.0f))), "rear_angle is received as its code says");
    CONTRACT_ENSURE(code_in(data, 32u, 16u, false) == ((uint32_t)to_code(signals.yaw_rate_reference, 5000.0f, -32767, 32767, -32768) & 0xFFFFu), "the code of yaw_rate_reference is in its bits of the frame");
    CONTRACT_ENSURE((to_code(signals.yaw_rate_reference, 5000.0f, -32767, 32767, -32768) == -32768) ? (unpacked.yaw_rate_reference != unpacked.yaw_rate_reference) : (unpacked.yaw_rate_reference == (((float)to_code(signals.yaw_rate_reference, 5000.0f, -32767, 32767, -32768) / 5000.0f))), "yaw_rate_reference is received as its code says");
    CONTRACT_ENSURE(code_in(data, 48u, 16u, false) == ((uint32_t)signals.diagnostics & 0xFFFFu), "the code of diagnostics is in its bits of the frame");
    CONTRACT_ENSURE((uint32_t)unpacked.diagnostics == ((uint32_t)signals.diagnostics & 0xFFFFu), "diagnostics is received as its code says");
    check_end();
}
