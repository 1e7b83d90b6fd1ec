/*
 * Proof of lemma_gains(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_gains.c -Iinclude -Iverify --function prove_lemma_gains --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_GAINS(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_law.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_GAINS
#define CONTRACT_LEMMA_GAINS(condition, text) __CPROVER_assume(condition)
#endif
/* CBMC checks an index inside a struct against the whole struct only. A gain of a constant schedule is that constant, so a gain from
 * beyond its table is found. */
static inline void lemma_gains(const ars_parameters_t *parameters, float speed)
{
    gains_t gains;
    uint32_t k;

    CONTRACT_ASSUME(ars_parameters_holds(parameters) && lies_within(speed, 200.0f));
    for (k = 1u; k < (uint32_t)ARS_SCHEDULE_POINTS; k++) {
        CONTRACT_ASSUME(parameters->proportional_gain[k] == parameters->proportional_gain[0]);
        CONTRACT_ASSUME(parameters->integral_gain[k] == parameters->integral_gain[0]);
        CONTRACT_ASSUME(parameters->lead_time[k] == parameters->lead_time[0]);
        CONTRACT_ASSUME(parameters->response_gain[k] == parameters->response_gain[0]);
    }
    gains = gains_at(parameters, speed);
    CONTRACT_LEMMA_GAINS(gains.proportional == parameters->proportional_gain[0], "proportional_gain is read from its table");
    CONTRACT_LEMMA_GAINS(gains.integral == parameters->integral_gain[0], "integral_gain is read from its table");
    CONTRACT_LEMMA_GAINS(gains.lead_time == parameters->lead_time[0], "lead_time is read from its table");
    CONTRACT_LEMMA_GAINS(gains.response == parameters->response_gain[0], "response_gain is read from its table");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_gains(void);

/* Locals without a value have any value. */
void prove_lemma_gains(void)
{
    ars_parameters_t parameters;
    float speed;

    lemma_gains(&parameters, speed);
    check_end();
}
