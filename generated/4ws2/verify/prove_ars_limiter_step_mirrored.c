/*
 * Proof that ars_limiter_step() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_limiter_step_mirrored.goto" verify/prove_ars_limiter_step_mirrored.c -Iinclude -Iverify && goto-instrument --replace-calls magnitude:magnitude_of_lemma --replace-calls opposite_phase_bound:opposite_phase_bound_of_lemma "${TMPDIR:-/tmp}/prove_ars_limiter_step_mirrored.goto" "${TMPDIR:-/tmp}/prove_ars_limiter_step_mirrored.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_limiter_step_mirrored.goto" --function prove_ars_limiter_step_mirrored --unwind 16 --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_limiter.c"
#include "ars_contracts.h"

/* Any function of the speed: the proof is for one set of parameters. */
float __CPROVER_uninterpreted_bound(float speed);

float opposite_phase_bound_of_lemma(const ars_limiter_parameters_t *parameters, float speed)
{
    const float bound = __CPROVER_uninterpreted_bound(speed);

    CONTRACT_ASSUME(lies_between(bound, 0.0f, parameters->rear_angle_max + 1.0f));
    return bound;
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

void prove_ars_limiter_step_mirrored(void);

/* Locals without a value have any value. */
void prove_ars_limiter_step_mirrored(void)
{
    ars_limiter_t self;
    ars_limiter_parameters_t parameters;
    ars_limiter_input_t input;
    ars_limiter_t self_before;
    float result;

    ars_limiter_step_requires(&self, &parameters, &input);
    self_before = self;
    (void)self_before;
    ars_limiter_t mirrored = self;
    ars_limiter_input_t other = input;
    mirrored.rear_angle = -self.rear_angle;
    mirrored.front_angle = -self.front_angle;
    other.demand = -input.demand;
    other.front_angle = -input.front_angle;
    result = ars_limiter_step(&self, &parameters, &input);
    (void)result;
    const float mirrored_result = ars_limiter_step(&mirrored, &parameters, &other);
    lemma_interpolation(opposite_phase_bound(&parameters, self.speed), parameters.rear_angle_max, ((magnitude(self.front_angle) / parameters.in_phase_from_front_angle) < 1.0f) ? (magnitude(self.front_angle) / parameters.in_phase_from_front_angle) : 1.0f);
    CONTRACT_ENSURE(are_mirrored(result, mirrored_result), "the mirrored angles give the mirrored result");
    check_end();
}
