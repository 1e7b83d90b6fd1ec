/*
 * Proof that ars_task_10ms() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_ars_task_10ms.c src/ars_e2e.c src/ars_can.c src/ars_supervision.c src/ars_task.c verify/assume_ars_controller_init.c verify/assume_ars_controller_place.c verify/assume_ars_controller_stand_by.c verify/assume_ars_controller_step.c -Iinclude -Iverify --function prove_ars_task_10ms --unwind 26 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

void prove_ars_task_10ms(void);

/* Locals without a value have any value. */
void prove_ars_task_10ms(void)
{
    ars_task_t self;
    uint8_t data[8];
    ars_task_t self_before;
    uint32_t result;

    ars_task_10ms_requires(&self, data);
    self_before = self;
    ars_parameters_t parameters;
    self.parameters = &parameters;
    CONTRACT_ASSUME(ars_parameters_holds(&parameters));
    result = ars_task_10ms(&self, data);
    ars_task_10ms_ensures(&self, data, result, &self_before);
    check_end();
}
