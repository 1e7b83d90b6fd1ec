/*
 * Proof of lemma_opposite_phase(), which other proofs assume. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_lemma_opposite_phase.c -Iinclude -Iverify --function prove_lemma_opposite_phase --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)
#define CONTRACT_LEMMA_OPPOSITE_PHASE(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_limiter.c"
#include "ars_contracts.h"

#ifndef CONTRACT_LEMMA_OPPOSITE_PHASE
#define CONTRACT_LEMMA_OPPOSITE_PHASE(condition, text) __CPROVER_assume(condition)
#endif
static inline void lemma_opposite_phase(const ars_limiter_parameters_t *parameters, float speed)
{
    const float *const breakpoints = parameters->opposite_phase_speed;
    const float *const angles = parameters->opposite_phase_max;
    float bound = angles[0];
    uint32_t k;

    CONTRACT_ASSUME(ars_limiter_parameters_holds(parameters) && lies_between(speed, 0.0f, 200.0f));
    for (k = 1u; k < (uint32_t)ARS_LIMITER_POINTS; k++) {
        if (breakpoints[k] <= speed) {
            bound = angles[k];
        } else if (breakpoints[k - 1u] < speed) {
            bound = angles[k - 1u] + (((speed - breakpoints[k - 1u]) / (breakpoints[k] - breakpoints[k - 1u])) * (angles[k] - angles[k - 1u]));
        }
    }
    CONTRACT_LEMMA_OPPOSITE_PHASE(opposite_phase_bound(parameters, speed) == bound, "the bound is linear between the breakpoints and constant beyond them");
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_lemma_opposite_phase(void);

/* Locals without a value have any value. */
void prove_lemma_opposite_phase(void)
{
    ars_limiter_parameters_t parameters;
    float speed;

    lemma_opposite_phase(&parameters, speed);
    check_end();
}
