/*
 * Proof that ars_controller_step() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * goto-cc -o "${TMPDIR:-/tmp}/prove_ars_controller_step.goto" verify/prove_ars_controller_step.c verify/assume_ars_inputs_init.c verify/assume_ars_limiter_init.c verify/assume_ars_law_init.c verify/assume_ars_grip_init.c verify/assume_ars_inputs_step.c verify/assume_ars_law_step.c verify/assume_ars_limiter_step.c verify/assume_ars_grip_friction.c verify/assume_ars_grip_update.c verify/assume_ars_grip_recover.c verify/assume_ars_law_rest.c -Iinclude -Iverify && goto-instrument --replace-calls is_sound:is_sound_of_lemma "${TMPDIR:-/tmp}/prove_ars_controller_step.goto" "${TMPDIR:-/tmp}/prove_ars_controller_step.goto" >/dev/null && cbmc "${TMPDIR:-/tmp}/prove_ars_controller_step.goto" --function prove_ars_controller_step --unwind 16 --bounds-check --pointer-check --div-by-zero-check --float-div-by-zero-check --signed-overflow-check --conversion-check --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
 *
 * The proof counts if CBMC reports VERIFICATION SUCCESSFUL, and if check_end.assertion.1 fails with -DCHECK_END.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#define CONTRACT_REQUIRE(condition, text) __CPROVER_assume(condition)
#define CONTRACT_ENSURE(condition, text) __CPROVER_assert(condition, text)

#include "../src/ars_controller.c"
#include "ars_contracts.h"

bool is_sound_of_lemma(const ars_controller_t *self)
{
    __CPROVER_assert(ars_controller_holds(self), "self is within its invariant");
    return true;
}

/* The end of a proof. With CHECK_END its assertion must fail: otherwise no claim was reached. */
static void check_end(void)
{
#ifdef CHECK_END
    __CPROVER_assert(false, "the end is reached");
#endif
}

void prove_ars_controller_step(void);

/* Locals without a value have any value. */
void prove_ars_controller_step(void)
{
    ars_controller_t self;
    ars_parameters_t parameters;
    ars_measurement_t measurement;
    ars_controller_t self_before;
    ars_command_t result;

    ars_controller_step_requires(&self, &parameters, &measurement);
    self_before = self;
    result = ars_controller_step(&self, &parameters, &measurement);
    ars_controller_step_ensures(&self, &parameters, &measurement, &result, &self_before);
    CONTRACT_ENSURE((result.status == ARS_STATUS_FAIL_SAFE) == ((self.quality == ARS_QUALITY_UNUSABLE) || ((self_before.status == ARS_STATUS_FAIL_SAFE) && (self.quality == ARS_QUALITY_MISSING))), "an unusable sample leads to the fail-safe, which stays while a signal is missing");
    CONTRACT_ENSURE(!(result.status == ARS_STATUS_DEGRADED) || (self.quality == ARS_QUALITY_REPLACED) || (self.quality == ARS_QUALITY_MISSING), "only a replaced or missing signal leads to degraded");
    CONTRACT_ENSURE((result.status > ARS_STATUS_LIMITED) || (self.quality == ARS_QUALITY_GOOD), "only a good sample is followed");
    CONTRACT_ENSURE(self.enabled || (result.yaw_rate_reference == 0.0f), "without control the reference is zero");
    CONTRACT_ENSURE(!(result.status == ARS_STATUS_STANDBY) || (self.quality == ARS_QUALITY_MISSING) || !(self.inputs.speed.source == ARS_SIGNAL_MEASURED), "only a speed that is not measured leads to standby or keeps it");
    CONTRACT_ENSURE(self_before.enabled || !self.enabled || (self.quality <= ARS_QUALITY_REPLACED), "control starts with a sample");
    CONTRACT_ENSURE(!self_before.enabled || self.enabled || (result.status == ARS_STATUS_FAIL_SAFE), "control ends only in the fail-safe");
    CONTRACT_ENSURE((self_before.status != ARS_STATUS_FAIL_SAFE) || (self_before.quality != ARS_QUALITY_UNUSABLE) || (result.status == ARS_STATUS_FAIL_SAFE) || ((self.inputs.front_angle.source == ARS_SIGNAL_MEASURED) && lies_within(measurement.front_angle, parameters.inputs.front_angle_max) && ((self_before.inputs.front_angle.good + 1u) >= parameters.inputs.recovery_samples)) || ((self.inputs.yaw_rate.source == ARS_SIGNAL_MEASURED) && lies_within(measurement.yaw_rate, parameters.inputs.yaw_rate_max) && ((self_before.inputs.yaw_rate.good + 1u) >= parameters.inputs.recovery_samples)), "the fail-safe is left only when front angle or yaw rate is good for recovery_samples");
    CONTRACT_ENSURE(!((!lies_within(measurement.front_angle, parameters.inputs.front_angle_max) && (!(self_before.inputs.front_angle.source == ARS_SIGNAL_MEASURED) || (self_before.inputs.front_angle.missing >= parameters.inputs.missing_samples_max))) && (!lies_within(measurement.yaw_rate, parameters.inputs.yaw_rate_max) && (!(self_before.inputs.yaw_rate.source == ARS_SIGNAL_MEASURED) || (self_before.inputs.yaw_rate.missing >= parameters.inputs.missing_samples_max)))) || (result.status == ARS_STATUS_FAIL_SAFE), "the fail-safe starts no later than when front angle and yaw rate are missing for more than missing_samples_max");
    CONTRACT_ENSURE(!self.limiter.speed_known || (result.status != ARS_STATUS_FAIL_SAFE) || (result.rear_angle <= 0.0f) || (result.rear_angle <= (self_before.rear_angle - (parameters.fail_safe_rate * 0.01f))) || (result.rear_angle <= (self_before.rear_angle - (parameters.limiter.rear_rate_max * 0.01f))), "in fail-safe it returns to zero from the left");
    CONTRACT_ENSURE(!self.limiter.speed_known || (result.status != ARS_STATUS_FAIL_SAFE) || (0.0f <= result.rear_angle) || ((self_before.rear_angle + (parameters.fail_safe_rate * 0.01f)) <= result.rear_angle) || ((self_before.rear_angle + (parameters.limiter.rear_rate_max * 0.01f)) <= result.rear_angle), "in fail-safe it returns to zero from the right");
    CONTRACT_ENSURE(!self.enabled || (result.rear_angle <= (self_before.rear_angle + (((parameters.rear_rate_max < parameters.limiter.rear_rate_max) ? parameters.rear_rate_max : parameters.limiter.rear_rate_max) * 0.01f))) || (result.rear_angle <= 0.0f), "under control, from its first sample on, it leaves zero by at most the lower of both rates, to the left");
    CONTRACT_ENSURE(!self.enabled || ((self_before.rear_angle - (((parameters.rear_rate_max < parameters.limiter.rear_rate_max) ? parameters.rear_rate_max : parameters.limiter.rear_rate_max) * 0.01f)) <= result.rear_angle) || (0.0f <= result.rear_angle), "under control, from its first sample on, it leaves zero by at most the lower of both rates, to the right");
    check_end();
}
