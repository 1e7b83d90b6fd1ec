"""Faults to plant in the kind "tracking", each beside the check that must see it; see `faults`."""

from __future__ import annotations

from tests.sil import checks_kinds, checks_reference, checks_tracking
from tests.sil.faults import Fault

IN_THE_FEEDFORWARD = (
    Fault("no lead", checks_tracking.check_lead, "measurement->front_angle + lead,", "measurement->front_angle,"),
    Fault(
        "lead the wrong way", checks_tracking.check_lead, "measurement->front_angle + lead,", "measurement->front_angle - lead,"
    ),
    Fault(
        "lead without its bound",
        checks_tracking.check_lead,
        "clamp(parameters->lead_time * self->front_rate, -parameters->lead_angle_max, parameters->lead_angle_max)",
        "parameters->lead_time * self->front_rate",
    ),
    Fault(
        "lead on the angle of the last start",
        checks_tracking.check_feedforward,
        "self->front_angle = measurement->front_angle;\n    self->front_rate +=",
        "self->front_rate +=",
    ),
    Fault(
        "the old front angle after a gap",
        checks_tracking.check_restart,
        "self->front_angle = measurement->front_angle;\n    self->front_rate = 0.0f;",
        "self->front_rate = 0.0f;",
    ),
    Fault(
        "feedforward left out", checks_tracking.check_feedforward, "demand = map.rear_angle + feedback;", "demand = feedback;"
    ),
    Fault(
        "feedforward with the wrong sign",
        checks_tracking.check_feedforward,
        "demand = map.rear_angle + feedback;",
        "demand = feedback - map.rear_angle;",
    ),
    Fault(
        "feedforward beyond the angle's limit",
        checks_tracking.check_tracking_same_as_model,
        "reference.rear_angle = clamp(reference.rear_angle, -parameters->rear_angle_max, parameters->rear_angle_max);",
        "",
    ),
    Fault(
        "the smallest of estimate and grip not taken",
        checks_reference.check_estimate,
        "return (estimated < seen) ? estimated : seen;",
        "return seen;",
    ),
    Fault(
        "no estimate counts as an estimate",
        checks_reference.check_grip,
        "return (estimated < seen) ? estimated : seen;",
        "return (estimated > seen) ? seen : estimated;",
    ),
)

IN_THE_FEEDBACK = (
    Fault(
        "wrong sign",
        checks_tracking.check_gain_schedule,
        "reference - measurement->yaw_rate;\n    const gains_t",
        "measurement->yaw_rate - reference;\n    const gains_t",
    ),
    Fault(
        "gains of the next slower cell",
        checks_tracking.check_gain_schedule,
        "if (speed >= parameters->schedule_speed[k]) {",
        "if (speed >= parameters->schedule_speed[k + 1u]) {",
    ),
    Fault(
        "gains that step from breakpoint to breakpoint",
        checks_tracking.check_gain_schedule,
        "share = clamp((speed - from) / (parameters->schedule_speed[lower + 1u] - from), 0.0f, 1.0f);",
        "share = (speed > from) ? 1.0f : 0.0f;",
    ),
    Fault(
        "gains that run on beyond the schedule",
        checks_tracking.check_gain_schedule,
        "share = clamp((speed - from) / (parameters->schedule_speed[lower + 1u] - from), 0.0f, 1.0f);",
        "share = (speed - from) / (parameters->schedule_speed[lower + 1u] - from);",
    ),
    Fault(
        "integral gain in place of the proportional one",
        checks_tracking.check_gain_schedule,
        "gains.proportional = parameters->proportional_gain[lower]",
        "gains.proportional = parameters->integral_gain[lower]",
    ),
    Fault(
        "integral per sample",
        checks_tracking.check_gain_schedule,
        "integral -= (gains.integral * sampling_time) * error;",
        "integral -= gains.integral * error;",
    ),
    Fault(
        "the integral of a new sample is used one sample late",
        checks_tracking.check_gain_schedule,
        "feedback = integral - proportional;",
        "feedback = self->integral - proportional;",
    ),
    Fault(
        "no bound where feedback turns the car more, to the left",
        checks_tracking.check_authority,
        "range.low = clamp(feedforward - parameters->yaw_increasing_max, range.low, range.high);",
        "",
    ),
    Fault(
        "no bound where feedback turns the car more, to the right",
        checks_tracking.check_authority,
        "range.high = clamp(feedforward + parameters->yaw_increasing_max, range.low, range.high);",
        "",
    ),
    Fault(
        "the bound on the stabilising side",
        checks_tracking.check_authority,
        "if (turns_left) {",
        "if (turns_right) {",
    ),
    Fault(
        "authority not relative to the feedforward",
        checks_tracking.check_authority,
        "range.low -= feedforward;",
        "",
    ),
    Fault(
        "blind to the achieved angle",
        checks_tracking.check_tracking_stuck_actuator,
        "range.high = clamp(measurement->rear_angle + parameters->rear_angle_error_max, range.low, range.high);",
        "",
    ),
    Fault(
        "no anti-windup",
        checks_tracking.check_tracking_same_as_model,
        "integral = clamp(self->integral, range.low, range.high);",
        "integral = self->integral;",
    ),
    Fault(
        "the integral runs on at any limit",
        checks_tracking.check_tracking_anti_windup,
        "if (limited && !measurement->inhibit) {",
        "if (false) {",
    ),
    Fault(
        "no saturation in the law",
        checks_tracking.check_authority,
        "feedback = clamp(feedback, range.low, range.high);",
        "",
    ),
    Fault(
        "no rate limit",
        checks_tracking.check_tracking_rate_limit,
        "command = clamp(demand, self->rear_angle - step, self->rear_angle + step);",
        "command = demand;",
    ),
    Fault(
        "no anti-windup of the rate limit",
        checks_tracking.check_tracking_rate_limit,
        "        integral = (integral > self->integral) ? self->integral : integral;\n",
        "",
    ),
    Fault(
        "inhibit ignored",
        checks_tracking.check_tracking_inhibit,
        "if (!measurement->inhibit) {\n        integral -=",
        "if (true) {\n        integral -=",
    ),
    Fault(
        "inhibit ignored at a limit",
        checks_tracking.check_tracking_inhibit,
        "if (limited && !measurement->inhibit) {",
        "if (limited) {",
    ),
    Fault(
        "start with a bump",
        checks_tracking.check_tracking_bumpless,
        "self->integral = self->rear_angle - map.rear_angle;",
        "self->integral = 0.0f;",
    ),
    Fault(
        "start forgets the feedforward",
        checks_tracking.check_tracking_bumpless,
        "self->integral = self->rear_angle - map.rear_angle;",
        "self->integral = self->rear_angle;",
    ),
    Fault(
        "start never ends",
        checks_tracking.check_restart,
        "if (starts) {\n        start_law(self, measurement);",
        "if (starts || (self->speed > 1.0f)) {\n        start_law(self, measurement);",
    ),
    Fault(
        "the model starts from a standing car",
        checks_tracking.check_restart,
        "ars_reference_model_start(&self->model, measurement->speed, measurement->yaw_rate, self->rear_angle);",
        "ars_reference_model_start(&self->model, measurement->speed, 0.0f, self->rear_angle);",
    ),
)

IN_THE_REFERENCE = (
    Fault("no trim", checks_reference.check_trim, "self->model.yaw_rate + self->trim, -limit", "self->model.yaw_rate, -limit"),
    Fault(
        "trim without its bound",
        checks_reference.check_trim,
        "clamp(map->yaw_rate - self->model.yaw_rate, -bound, bound)",
        "map->yaw_rate - self->model.yaw_rate",
    ),
    Fault(
        "trim at once",
        checks_reference.check_trim,
        "self->trim += (parameters->trim_rate * sampling_time) * (missing - self->trim);",
        "self->trim = missing;",
    ),
    Fault(
        "trim bounded only to the left",
        checks_reference.check_trim,
        "parameters->trim_share * magnitude(map->yaw_rate)",
        "parameters->trim_share * map->yaw_rate",
    ),
    Fault(
        "the reference not bounded by the road",
        checks_reference.check_road_limit,
        "return clamp(self->model.yaw_rate + self->trim, -limit, limit);",
        "return self->model.yaw_rate + self->trim;",
    ),
    Fault(
        "the road's bound without its margin",
        checks_reference.check_road_limit,
        "reference_overshoot * (map->lateral_acceleration_max / speed)",
        "map->lateral_acceleration_max / speed",
    ),
    Fault(
        "the model driven by the command, not by the feedforward",
        checks_tracking.check_tracking_same_as_model,
        "measurement->speed, measurement->front_angle, map.rear_angle, friction }",
        "measurement->speed, measurement->front_angle, self->rear_angle, friction }",
    ),
    Fault(
        "the model on the road of the map",
        checks_tracking.check_tracking_same_as_model,
        "map.rear_angle, friction };",
        "map.rear_angle, 0.9f };",
    ),
    Fault(
        "grip lost to the left only",
        checks_reference.check_grip,
        "leftwards ? measurement->yaw_rate : -measurement->yaw_rate",
        "measurement->yaw_rate",
    ),
    Fault(
        "every shortfall is a loss of grip",
        checks_tracking.check_tracking_same_as_model,
        "(shortfall > parameters->grip_shortfall)) {",
        "(shortfall > 0.0f)) {",
    ),
    Fault(
        "grip lost by the whole shortfall",
        checks_reference.check_grip,
        "(shortfall - parameters->grip_shortfall));",
        "shortfall);",
    ),
    Fault(
        "a reversal is a loss of grip",
        checks_tracking.check_tracking_same_as_model,
        "(turning > 0.0f) && ",
        "",
    ),
    Fault(
        "grip below what was reached",
        checks_tracking.check_tracking_same_as_model,
        "if (grip < self->reached) {",
        "if (false) {",
    ),
    Fault(
        "grip recovers in a turn as without one",
        checks_tracking.check_tracking_same_as_model,
        "? parameters->grip_recovery_idle : parameters->grip_recovery",
        "? parameters->grip_recovery : parameters->grip_recovery",
    ),
    Fault(
        "one wrong sign opens the other side",
        checks_tracking.check_tracking_same_as_model,
        "|| (self->yaw_rate > 0.0f)",
        "",
    ),
    Fault(
        "what is proportional is kept at the limit",
        checks_tracking.check_tracking_same_as_model,
        "integral = clamp(self->integral,",
        "integral = clamp(integral - proportional,",
    ),
    Fault(
        "grip does not recover",
        checks_reference.check_grip,
        "self->grip + (recovery * sampling_time)",
        "self->grip",
    ),
    Fault(
        "grip without a floor",
        checks_reference.check_grip,
        "self->grip = clamp(grip, parameters->friction_min / friction_per_grip, grip_max);",
        "self->grip = grip;",
    ),
    Fault(
        "grip updated while ESC acts",
        checks_reference.check_grip,
        "if (!measurement->inhibit) {\n        update_grip",
        "if (true) {\n        update_grip",
    ),
    Fault(
        "grip beyond the map's",
        checks_kinds.check_kind_always_bounded,
        "self->grip = clamp(grip, parameters->friction_min / friction_per_grip, grip_max);",
        "self->grip = clamp(grip, parameters->friction_min / friction_per_grip, 2.0f * grip_max);",
    ),
    Fault(
        "limiter left out",
        checks_tracking.check_limiter_is_told,
        "self->rear_angle = limited;",
        "",
    ),
    Fault(
        "limiter acts in silence",
        checks_tracking.check_limiter_is_told,
        "(limited > self->rear_angle) || (limited < self->rear_angle)",
        "(limited > self->rear_angle) && (limited < self->rear_angle)",
    ),
    Fault(
        "the law never starts afresh",
        checks_kinds.check_kind_same_as_model,
        "starts = (self->status != ARS_STATUS_TRACKING) && (self->status != ARS_STATUS_LIMITED);",
        "starts = self->status == ARS_STATUS_FAIL_SAFE;",
    ),
)

FAULTS: dict[str, tuple[Fault, ...]] = {"src/ars_controller.c": (*IN_THE_FEEDFORWARD, *IN_THE_FEEDBACK, *IN_THE_REFERENCE)}
"""By the file that they are planted in, of the build of kind "tracking"."""
