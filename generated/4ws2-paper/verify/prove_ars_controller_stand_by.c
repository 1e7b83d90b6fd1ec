/*
 * Proof that ars_controller_stand_by() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_ars_controller_stand_by.c src/ars_controller.c verify/assume_ars_inputs_init.c verify/assume_ars_limiter_init.c verify/assume_ars_law_init.c -Iinclude -Iverify --function prove_ars_controller_stand_by --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
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

void prove_ars_controller_stand_by(void);

/* Locals without a value have any value. */
void prove_ars_controller_stand_by(void)
{
    ars_controller_t self;
    ars_parameters_t parameters;
    ars_controller_t self_before;
    ars_command_t result;

    ars_controller_stand_by_requires(&self, &parameters);
    self_before = self;
    result = ars_controller_stand_by(&self, &parameters);
    ars_controller_stand_by_ensures(&self, &parameters, &result, &self_before);
    check_end();
}
