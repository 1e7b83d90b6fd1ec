/*
 * Proof that ars_limiter_step() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_limiter_step_demand.goto" verify/prove_ars_limiter_step_demand.c -Iinclude -Iverify && goto-instrument --replace-calls magnitude:magnitude_of_lemma "${TMPDIR:-/tmp}/prove_ars_limiter_step_demand.goto" "${TMPDIR:-/tmp}/prove_ars_limiter_step_demand.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_limiter_step_demand.goto" --function prove_ars_limiter_step_demand --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

void prove_ars_limiter_step_demand(void);

/* Locals without a value have any value. */
void prove_ars_limiter_step_demand(void)
{
    ars_limiter_t self;
    ars_limiter_parameters_t parameters;
    ars_limiter_input_t input;
    ars_limiter_t self_before;
    float result;

    ars_limiter_step_requires(&self, &parameters, &input);
    self_before = self;
    (void)self_before;
    result = ars_limiter_step(&self, &parameters, &input);
    (void)result;
    CONTRACT_ENSURE(!self.speed_known || !((((self.front_angle < 0.0f) ? -(opposite_phase_bound(&parameters, self.speed) + ((((magnitude(self.front_angle) / parameters.in_phase_from_front_angle) < 1.0f) ? (magnitude(self.front_angle) / parameters.in_phase_from_front_angle) : 1.0f) * (parameters.rear_angle_max - opposite_phase_bound(&parameters, self.speed)))) : -opposite_phase_bound(&parameters, self.speed)) <= input.demand) && (input.demand <= ((self.front_angle > 0.0f) ? (opposite_phase_bound(&parameters, self.speed) + ((((magnitude(self.front_angle) / parameters.in_phase_from_front_angle) < 1.0f) ? (magnitude(self.front_angle) / parameters.in_phase_from_front_angle) : 1.0f) * (parameters.rear_angle_max - opposite_phase_bound(&parameters, self.speed)))) : opposite_phase_bound(&parameters, self.speed))) && ((self_before.rear_angle - (parameters.rear_rate_max * 0.01f)) <= input.demand) && (input.demand <= (self_before.rear_angle + (parameters.rear_rate_max * 0.01f))) && lies_within(input.demand, parameters.rear_angle_max)) || (result == input.demand), "the result equals the demand if all bounds allow it");
    check_end();
}
