/*
 * Proof that ars_limiter_step() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_ars_limiter_step.c -Iinclude -Iverify --function prove_ars_limiter_step --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_ars_limiter_step(void);

/* Locals without a value have any value. */
void prove_ars_limiter_step(void)
{
    ars_limiter_t self;
    ars_limiter_parameters_t parameters;
    ars_limiter_input_t input;
    ars_limiter_t self_before;
    float result;

    ars_limiter_step_requires(&self, &parameters, &input);
    self_before = self;
    result = ars_limiter_step(&self, &parameters, &input);
    for (uint32_t k = 1u; k < (uint32_t)ARS_LIMITER_POINTS; k++) {
        lemma_share(self.speed, parameters.opposite_phase_speed[k - 1u], parameters.opposite_phase_speed[k]);
        lemma_interpolation(parameters.opposite_phase_max[k - 1u], parameters.opposite_phase_max[k],
            (self.speed - parameters.opposite_phase_speed[k - 1u]) / (parameters.opposite_phase_speed[k] - parameters.opposite_phase_speed[k - 1u]));
    }
    lemma_interpolation(opposite_phase_bound(&parameters, self.speed), parameters.rear_angle_max, ((magnitude(self.front_angle) / parameters.in_phase_from_front_angle) < 1.0f) ? (magnitude(self.front_angle) / parameters.in_phase_from_front_angle) : 1.0f);
    ars_limiter_step_ensures(&self, &parameters, &input, result, &self_before);
    CONTRACT_ENSURE(!self.speed_known || (self.front_angle < 0.0f) || (-opposite_phase_bound(&parameters, self.speed) <= result) || ((self_before.rear_angle + (parameters.rear_rate_max * 0.01f)) <= result), "to the right of front wheels to the left, it is within opposite_phase_max, or returns at rear_rate_max");
    CONTRACT_ENSURE(!self.speed_known || (self.front_angle > 0.0f) || (result <= opposite_phase_bound(&parameters, self.speed)) || (result <= (self_before.rear_angle - (parameters.rear_rate_max * 0.01f))), "to the left of front wheels to the right, it is within opposite_phase_max, or returns at rear_rate_max");
    CONTRACT_ENSURE(lies_between(opposite_phase_bound(&parameters, self.speed), 0.0f, parameters.rear_angle_max + 1.0f), "the bound is not negative, and close to rear_angle_max at most");
    check_end();
}
