/*
 * Proof that ars_inputs_step() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_ars_inputs_step.c src/ars_inputs.c -Iinclude -Iverify --function prove_ars_inputs_step --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

void prove_ars_inputs_step(void);

/* Locals without a value have any value. */
void prove_ars_inputs_step(void)
{
    ars_inputs_t self;
    ars_inputs_parameters_t parameters;
    ars_measurement_t measured;
    float rear_angle;
    ars_reference_model_t model;
    ars_measurement_t checked;
    ars_inputs_t self_before;
    ars_quality_t result;

    ars_inputs_step_requires(&self, &parameters, &measured, rear_angle, &model, &checked);
    self_before = self;
    result = ars_inputs_step(&self, &parameters, &measured, rear_angle, &model, &checked);
    ars_inputs_step_ensures(&self, &parameters, &measured, rear_angle, &model, &checked, result, &self_before);
    check_end();
}
