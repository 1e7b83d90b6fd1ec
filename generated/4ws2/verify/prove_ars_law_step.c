/*
 * Proof that ars_law_step() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_ars_law_step.c src/ars_calibration.c src/ars_law.c verify/assume_ars_map_reference.c verify/assume_ars_reference_model_start.c verify/assume_ars_reference_model_step.c -Iinclude -Iverify --function prove_ars_law_step --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)

#include "ars_contracts.h"

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_ars_law_step(void);

/* Locals without a value have any value. */
void prove_ars_law_step(void)
{
    ars_law_t self;
    ars_parameters_t parameters;
    ars_measurement_t sample;
    ars_law_phase_t phase;
    float friction;
    float rear_angle;
    float yaw_rate_error;
    ars_law_t self_before;
    ars_law_output_t result;

    ars_law_step_requires(&self, &parameters, &sample, phase, friction, rear_angle, yaw_rate_error);
    self_before = self;
    result = ars_law_step(&self, &parameters, &sample, phase, friction, rear_angle, yaw_rate_error);
    ars_law_step_ensures(&self, &parameters, &sample, phase, friction, rear_angle, yaw_rate_error, &result, &self_before);
    check_end();
}
