"""Faults to plant in the generated C, each beside the check that must see it.

The text to replace stands exactly once in the generated file; `builds.altered` refuses anything else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.builds import Built
from tests.sil import checks_control, checks_lookup, checks_supervision

Check = Callable[[Built], object]


@dataclass(frozen=True)
class Fault:
    """A fault: what it is, the check that must see it, and the text that `new` takes the place of."""

    name: str
    check: Check
    old: str
    new: str


IN_THE_LOOKUP = (
    Fault(
        "transposed map",
        checks_lookup.check_same_bits,
        "const float *const slower = &table[place->row.lower][place->column.lower];\n"
        "    const float *const faster = &table[place->row.lower + 1u][place->column.lower];",
        "const float *const slower = &table[place->column.lower][place->row.lower];\n"
        "    const float *const faster = &table[place->column.lower + 1u][place->row.lower];",
    ),
    Fault("row not interpolated", checks_lookup.check_error_bound, "[place->row.lower + 1u]", "[place->row.lower]"),
    Fault("cap missing", checks_lookup.check_cap, "result = road->lateral_acceleration_max / speed;", ""),
    Fault("cap by the clamped speed", checks_lookup.check_cap, "(yaw_rate * speed) >", "(yaw_rate * 33.333332f) >"),
    Fault(
        "cap a millionth too high",
        checks_lookup.check_cap,
        "road_t road = { lateral_acceleration_cap };",
        "road_t road = { lateral_acceleration_cap * 1.000001f };",
    ),
    Fault(
        "cap two millionths too low",
        checks_lookup.check_cap_is_reached,
        "road_t road = { lateral_acceleration_cap };",
        "road_t road = { lateral_acceleration_cap * 0.999998f };",
    ),
    Fault(
        "symmetry lost",
        checks_lookup.check_odd_symmetry,
        "? -yaw_rate_at(speed, -front_angle, road)",
        "? yaw_rate_at(speed, -front_angle, road)",
    ),
    Fault(
        "right turns look straight",
        checks_lookup.check_odd_symmetry,
        "? -yaw_rate_at(speed, -front_angle, road)",
        "? -yaw_rate_at(speed, 0.0f, road)",
    ),
    Fault(
        "axis constant one unit in the last place off",
        checks_lookup.check_same_bits,
        "((speed - at[1])",
        "((speed - (at[1] + 5.0e-7f))",
    ),
    Fault(
        "axis constant a thousandth off",
        checks_lookup.check_error_bound,
        "(magnitude / at[100]) * 100.0f",
        "(magnitude / at[100]) * 100.1f",
    ),
    Fault("no clamp at the last speed", checks_lookup.check_edges, "fraction = 1.0f;", "fraction = steps - 99.0f;"),
    Fault("NaN let in", checks_lookup.check_finite, "} else if (speed > 0.0f) {", "} else if (!(speed <= 0.0f)) {"),
    Fault(
        "checksum of fewer rows",
        checks_lookup.check_checksum,
        "row < (uint32_t)ARS_MAP_SPEED_POINTS; row++) {\n        crc",
        "row < 50u; row++) {\n        crc",
    ),
    Fault("estimate of friction ignored", checks_lookup.check_cap, "if (friction < map_friction)", "if (friction < -1.0f)"),
)

IN_THE_LAW = (
    Fault("no limiter", checks_control.check_command_within_limit, "limit(self, parameters, measurement);", ""),
    Fault(
        "wrong sign",
        checks_control.check_sign,
        "error = reference - measurement->yaw_rate;",
        "error = measurement->yaw_rate - reference;",
    ),
    Fault(
        "wrong sign of the integral",
        checks_control.check_sign,
        "integral -= (parameters",
        "integral += (parameters",
    ),
    Fault(
        "wrong sign of the proportional part",
        checks_control.check_gains,
        "wanted = integral - proportional;",
        "wanted = integral + proportional;",
    ),
    Fault(
        "stuck integrator",
        checks_control.check_saturation,
        "integral -= (parameters->integral_gain * sampling_time) * error;",
        "",
    ),
    Fault(
        "integral per sample instead of per second",
        checks_control.check_gains,
        "(parameters->integral_gain * sampling_time) * error",
        "parameters->integral_gain * error",
    ),
    Fault(
        "the integral of a new sample is used one sample late",
        checks_control.check_same_as_model,
        "wanted = integral - proportional;",
        "wanted = before - proportional;",
    ),
    Fault(
        "no saturation in the law",
        checks_control.check_anti_windup,
        "return clamp(result, -parameters->rear_angle_max, parameters->rear_angle_max);",
        "return result;",
    ),
    Fault("no anti-windup", checks_control.check_anti_windup, "integral = demand + proportional;", ""),
    Fault(
        "anti-windup blind to the achieved angle",
        checks_control.check_windup_by_a_stuck_actuator,
        "demand = allowed(parameters, measurement, wanted);",
        "demand = clamp(wanted, -parameters->rear_angle_max, parameters->rear_angle_max);",
    ),
    Fault(
        "anti-windup on one side",
        checks_control.check_windup_by_a_stuck_actuator,
        "high = measurement->rear_angle + parameters->rear_angle_error_max;",
        "high = measurement->rear_angle + 10.0f;",
    ),
    Fault(
        "no rate limit",
        checks_control.check_rate_limit,
        "command = clamp(demand, self->rear_angle - step, self->rear_angle + step);",
        "command = demand;",
    ),
    Fault(
        "no anti-windup of the rate limit",
        checks_control.check_windup_by_the_rate_limit,
        "        integral = (integral < before) ? before : integral;\n",
        "",
    ),
    Fault(
        "start with a bump",
        checks_control.check_bumpless,
        "starts ? (self->rear_angle + proportional) :",
        "starts ? 0.0f :",
    ),
    Fault(
        "start forgets the proportional part",
        checks_control.check_bumpless,
        "starts ? (self->rear_angle + proportional) :",
        "starts ? self->rear_angle :",
    ),
    Fault(
        "inhibit ignored",
        checks_control.check_inhibit,
        "if (!measurement->inhibit) {\n        integral -=",
        "if (true) {\n        integral -=",
    ),
    Fault(
        "inhibit ignored at a limit",
        checks_control.check_inhibit,
        "if (limited && !measurement->inhibit) {",
        "if (limited) {",
    ),
    Fault(
        "friction below its minimum", checks_control.check_friction, "? parameters->friction_min :", "? measurement->friction :"
    ),
    Fault(
        "status does not tell of the limit",
        checks_control.check_saturation,
        "? ARS_STATUS_LIMITED : ARS_STATUS_TRACKING",
        "? ARS_STATUS_TRACKING : ARS_STATUS_TRACKING",
    ),
    Fault(
        "a static variable shared by all instances",
        checks_control.check_instances,
        "float integral = before;",
        "static float shared; float integral = before + shared; shared = 1e-6f * (float)(self->speed > 14.0f);",
    ),
)

IN_THE_SUPERVISION = (
    Fault(
        "NaN accepted",
        checks_supervision.check_inputs,
        "return magnitude(value) <= largest;",
        "return !(magnitude(value) > largest);",
    ),
    Fault(
        "range of the yaw rate not checked",
        checks_supervision.check_inputs,
        "&& is_within(measurement->yaw_rate, parameters->yaw_rate_max)",
        "",
    ),
    Fault(
        "range of the measured rear angle not checked",
        checks_supervision.check_inputs,
        "&& is_absent_or_within(measurement->rear_angle, parameters->rear_angle_input_max)",
        "",
    ),
    Fault(
        "yaw rate always believed",
        checks_supervision.check_plausibility_time,
        "self->implausible_samples++;",
        "self->implausible_samples++; trusted = true;",
    ),
    Fault(
        "implausible samples never forgiven",
        checks_supervision.check_plausibility_time,
        "if (is_plausible(parameters, measurement)) {\n            self->implausible_samples = 0u;",
        "if (is_plausible(parameters, measurement)) {",
    ),
    Fault(
        "plausible only to the left",
        checks_supervision.check_plausibility_limit,
        " + magnitude(half_turn);",
        " + half_turn;",
    ),
    Fault(
        "standby ignored",
        checks_supervision.check_standby,
        "self->enabled = false;\n        } else {",
        "} else {",
    ),
    Fault(
        "no hysteresis",
        checks_supervision.check_standby,
        "self->speed < parameters->disable_speed",
        "self->speed < parameters->enable_speed",
    ),
    Fault(
        "reverse counts as forward",
        checks_supervision.check_standby,
        "if (self->speed >= parameters->enable_speed)",
        "if ((self->speed * self->speed) >= (parameters->enable_speed * parameters->enable_speed))",
    ),
    Fault(
        "standby drops to zero",
        checks_supervision.check_standby,
        "toward_zero(self->rear_angle, parameters->standby_rate * sampling_time)",
        "0.0f",
    ),
    Fault(
        "at the hold speed the fail-safe ramps",
        checks_supervision.check_fail_safe_at_the_hold_speed,
        "if (speed < parameters->hold_speed) {",
        "if (speed <= parameters->hold_speed) {",
    ),
    Fault(
        "a start at no angle",
        checks_supervision.check_start_at_no_angle,
        "if ((rear_angle > 0.0f) || (rear_angle < 0.0f)) {",
        "if (true) {",
    ),
    Fault(
        "a limit hides a gap",
        checks_supervision.check_limiter_in_a_gap,
        "if ((self->status == ARS_STATUS_TRACKING) && ((limited",
        "if ((self->status != ARS_STATUS_STANDBY) && ((limited",
    ),
    Fault(
        "a short gap drops to zero",
        checks_supervision.check_gap,
        "self->status = ARS_STATUS_DEGRADED;",
        "self->status = ARS_STATUS_DEGRADED; self->rear_angle = 0.0f;",
    ),
    Fault(
        "gap one sample longer",
        checks_supervision.check_gap,
        "self->bad_samples > parameters->degraded_samples_max",
        "self->bad_samples > (parameters->degraded_samples_max + 1)",
    ),
    Fault(
        "control goes on after a gap as if there had been none",
        checks_supervision.check_gap,
        "starts = (self->status != ARS_STATUS_TRACKING) && (self->status != ARS_STATUS_LIMITED);",
        "starts = self->status == ARS_STATUS_STANDBY;",
    ),
    Fault(
        "fail-safe drops to zero",
        checks_supervision.check_fail_safe_ramp,
        "toward_zero(self->rear_angle, rate * sampling_time)",
        "0.0f",
    ),
    Fault(
        "fail-safe drops to zero at speed",
        checks_supervision.check_fail_safe_hold,
        "if (speed < parameters->hold_speed) {",
        "if (!(speed < parameters->hold_speed)) { self->rear_angle = 0.0f; } else {",
    ),
    Fault(
        "fail-safe ramps at any speed",
        checks_supervision.check_fail_safe_hold,
        "if (speed < parameters->hold_speed) {",
        "if (true) {",
    ),
    Fault(
        "fail-safe ramp the wrong way round",
        checks_supervision.check_fail_safe_ramp,
        "const float share = speed / parameters->hold_speed;",
        "const float share = 1.0f - (speed / parameters->hold_speed);",
    ),
    Fault(
        "ramp past zero",
        checks_supervision.check_fail_safe_ramp,
        "if (value > step) {",
        "if (value > 0.0f) {",
    ),
    Fault(
        "speed out of range kept",
        checks_supervision.check_last_speed,
        "if (is_within(measurement->speed, parameters->speed_max)) {",
        "{",
    ),
    Fault(
        "recovery in one sample",
        checks_supervision.check_recovery,
        "if (self->good_samples >= parameters->recovery_samples) {",
        "{",
    ),
    Fault(
        "recovery does not start again after a bad sample",
        checks_supervision.check_recovery,
        "self->good_samples = 0u;\n    if ((self->status",
        "if ((self->status",
    ),
    Fault(
        "integral from a lost measurement",
        checks_supervision.check_always_bounded,
        "if (!is_trusted(self, parameters, measurement)) {",
        "if (!is_trusted(self, parameters, measurement) && !(measurement->yaw_rate > 1.0e9f)) {",
    ),
)

FAULTS: dict[str, tuple[Fault, ...]] = {
    "src/ars_map.c": IN_THE_LOOKUP,
    "src/ars_controller.c": (*IN_THE_LAW, *IN_THE_SUPERVISION),
}
"""By the file that they are planted in, of the paper's build."""
