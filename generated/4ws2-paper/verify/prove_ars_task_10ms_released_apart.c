/*
 * Proof that ars_task_10ms() meets its contract. See ars_contracts.h.
 *
 * Run in the folder of the build, with CBMC 6 and Bitwuzla:
 *
 * cbmc verify/prove_ars_task_10ms_released_apart.c src/ars_e2e.c src/ars_can.c src/ars_supervision.c src/ars_task.c verify/assume_ars_controller_init.c verify/assume_ars_controller_place.c verify/assume_ars_controller_stand_by.c verify/assume_ars_controller_step.c -Iinclude -Iverify --function prove_ars_task_10ms_released_apart --unwind 26 --undefined-shift-check --no-standard-checks --unwinding-assertions --slice-formula --bitwuzla
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

void prove_ars_task_10ms_released_apart(void);

/* Locals without a value have any value. */
void prove_ars_task_10ms_released_apart(void)
{
    ars_task_t self;
    uint8_t data[8];
    ars_task_t self_before;
    uint32_t result;

    ars_task_10ms_requires(&self, data);
    self_before = self;
    (void)self_before;
    ars_parameters_t parameters;
    self.parameters = &parameters;
    CONTRACT_ASSUME(ars_parameters_holds(&parameters));
    CONTRACT_ASSUME(self.released);
    result = ars_task_10ms(&self, data);
    (void)result;
    CONTRACT_ENSURE((((self_before.supervision.state == ARS_SUPERVISION_START) || (self_before.supervision.state == ARS_SUPERVISION_RESYNCHRONISE)) || ((self_before.silent_calls > parameters.inputs.missing_samples_max) && ((self_before.motion_input.advance > 0u) || self_before.motion_input.out_of_sequence || (self_before.conditions_input.advance > 0u) || self_before.conditions_input.out_of_sequence) && self_before.has_measured)) || (self.angle_offset == 0.0f) || ((self.controller.rear_angle <= (self_before.controller.rear_angle + (parameters.limiter.rear_rate_max * 0.01f))) || (self.controller.rear_angle == -parameters.limiter.rear_angle_max)) || (self.controller.rear_angle <= self_before.controller.rear_angle) || (self.controller.rear_angle <= (self_before.controller.rear_angle + (((parameters.fail_safe_rate * 0.01f) < (parameters.limiter.rear_rate_max * 0.01f)) ? (parameters.fail_safe_rate * 0.01f) : (parameters.limiter.rear_rate_max * 0.01f)))) || ((self.conditions_input.usable && self.has_measured && (magnitude_of(self.conditions.rear_angle) <= parameters.inputs.rear_angle_max)) && ((self.controller.rear_angle <= held_within(self.conditions.rear_angle, 0.061086524f)) || (self.controller.rear_angle <= (self.conditions.rear_angle - self.angle_offset)) || (self.controller.rear_angle <= (held_within(self.conditions.rear_angle, 0.061086524f) + (parameters.limiter.rear_rate_max * 0.01f))) || (self.controller.rear_angle == -parameters.limiter.rear_angle_max))), "in the sample after control ended, from wheels apart,, to the wheels at most or it rises by at most rear_rate_max, or to -rear_angle_max");
    CONTRACT_ENSURE((((self_before.supervision.state == ARS_SUPERVISION_START) || (self_before.supervision.state == ARS_SUPERVISION_RESYNCHRONISE)) || ((self_before.silent_calls > parameters.inputs.missing_samples_max) && ((self_before.motion_input.advance > 0u) || self_before.motion_input.out_of_sequence || (self_before.conditions_input.advance > 0u) || self_before.conditions_input.out_of_sequence) && self_before.has_measured)) || (self.angle_offset == 0.0f) || (((self_before.controller.rear_angle - (parameters.limiter.rear_rate_max * 0.01f)) <= self.controller.rear_angle) || (self.controller.rear_angle == parameters.limiter.rear_angle_max)) || (self.controller.rear_angle >= self_before.controller.rear_angle) || (self.controller.rear_angle >= (self_before.controller.rear_angle - (((parameters.fail_safe_rate * 0.01f) < (parameters.limiter.rear_rate_max * 0.01f)) ? (parameters.fail_safe_rate * 0.01f) : (parameters.limiter.rear_rate_max * 0.01f)))) || ((self.conditions_input.usable && self.has_measured && (magnitude_of(self.conditions.rear_angle) <= parameters.inputs.rear_angle_max)) && ((self.controller.rear_angle >= held_within(self.conditions.rear_angle, 0.061086524f)) || (self.controller.rear_angle >= (self.conditions.rear_angle - self.angle_offset)) || ((held_within(self.conditions.rear_angle, 0.061086524f) - (parameters.limiter.rear_rate_max * 0.01f)) <= self.controller.rear_angle) || (self.controller.rear_angle == parameters.limiter.rear_angle_max))), "in the sample after control ended, from wheels apart,, to the wheels at most or it falls by at most rear_rate_max, or to rear_angle_max");
    check_end();
}
