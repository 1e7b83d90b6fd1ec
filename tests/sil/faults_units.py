"""Faults to plant in the units that stand alone, each beside the check that must see it; see `faults`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.sil import checks_limiter, checks_map_reference, checks_reference_model
from tests.sil.units import Units

Check = Callable[[Units], object]


@dataclass(frozen=True)
class Fault:
    """A fault: what it is, the check that must see it, and the text that `new` takes the place of."""

    name: str
    check: Check
    old: str
    new: str


IN_THE_LIMITER = (
    Fault("no bound in opposite phase", checks_limiter.check_opposite_phase, "target = clamp(target, low, high);", ""),
    Fault(
        "bound of the opposite phase only to the left",
        checks_limiter.check_opposite_phase,
        "(self->front_angle > 0.0f) ? in_phase : bound",
        "in_phase",
    ),
    Fault(
        "sides exchanged",
        checks_limiter.check_in_phase,
        "(self->front_angle < 0.0f) ? -in_phase : -bound",
        "(self->front_angle > 0.0f) ? -in_phase : -bound",
    ),
    Fault(
        "in phase from the first degree on",
        checks_limiter.check_in_phase,
        "const float in_phase = bound + (share * (parameters->rear_angle_max - bound));",
        "const float in_phase = (share > 0.0f) ? parameters->rear_angle_max : bound;",
    ),
    Fault(
        "in phase no more than against",
        checks_limiter.check_in_phase,
        "const float in_phase = bound + (share * (parameters->rear_angle_max - bound));",
        "const float in_phase = bound;",
    ),
    Fault(
        "bound not interpolated",
        checks_limiter.check_opposite_phase,
        "((speed - from) / (to - from))",
        "0.0f",
    ),
    Fault(
        "bound not held beyond the last speed",
        checks_limiter.check_opposite_phase,
        "if (speed >= to) {",
        "if (speed >= (10.0f * to)) {",
    ),
    Fault(
        "reverse counts as slow",
        checks_limiter.check_opposite_phase,
        "self->speed = magnitude(input->speed);",
        "self->speed = (input->speed < 0.0f) ? 0.0f : input->speed;",
    ),
    Fault(
        "no rate limit",
        checks_limiter.check_limiter_always_bounded,
        "target = clamp(target, self->rear_angle - step, self->rear_angle + step);",
        "",
    ),
    Fault(
        "rate limit on one side",
        checks_limiter.check_limiter_always_bounded,
        "target = clamp(target, self->rear_angle - step, self->rear_angle + step);",
        "target = clamp(target, self->rear_angle - step, 1.0f);",
    ),
    Fault(
        "rate per second in a sample",
        checks_limiter.check_limiter_always_bounded,
        "const float step = parameters->rear_rate_max * sampling_time;",
        "const float step = parameters->rear_rate_max;",
    ),
    Fault(
        "a passing sample is one unit in the last place off",
        checks_limiter.check_passes,
        "target = input->demand;",
        "target = input->demand * 1.0000001f;",
    ),
    Fault(
        "no bound of the angle",
        checks_limiter.check_limiter_always_bounded,
        "self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);",
        "self->rear_angle = target;",
    ),
    Fault(
        "NaN as a demand",
        checks_limiter.check_limiter_holds,
        "if ((input->demand >= low) || (input->demand <= high)) {",
        "{",
    ),
    Fault("acts without a speed", checks_limiter.check_limiter_holds, "if (self->speed_known) {", "{"),
    Fault(
        "any speed taken",
        checks_limiter.check_limiter_holds,
        "if (is_within(input->speed, parameters->speed_max)) {",
        "{",
    ),
    Fault(
        "a lost front angle is straight ahead",
        checks_limiter.check_limiter_holds,
        "self->front_angle = input->front_angle;\n    }",
        "self->front_angle = input->front_angle;\n    } else {\n        self->front_angle = 0.0f;\n    }",
    ),
    Fault(
        "NaN is within",
        checks_limiter.check_limiter_parameters,
        "return (value >= low) && (value <= high);",
        "return !((value < low) || (value > high));",
    ),
    Fault(
        "only the last element of an array is judged",
        checks_limiter.check_limiter_parameters,
        "valid = valid && is_between(parameters->opposite_phase_max[k], 0.0f, 1.0f);",
        "valid = valid && is_between(parameters->opposite_phase_max[ARS_LIMITER_POINTS - 1], 0.0f, 1.0f);",
    ),
    Fault(
        "breakpoints may stand in one place",
        checks_limiter.check_limiter_parameters,
        "(parameters->opposite_phase_speed[k - 1u] < parameters->opposite_phase_speed[k])",
        "(parameters->opposite_phase_speed[k - 1u] <= parameters->opposite_phase_speed[k])",
    ),
    Fault(
        "start beyond a right angle",
        checks_limiter.check_limiter_same_as_model,
        "is_between(rear_angle, -1.0f, 1.0f) ? rear_angle : 0.0f",
        "rear_angle",
    ),
)

IN_THE_REFERENCE_MODEL = (
    Fault(
        "Euler instead of Heun",
        checks_reference_model.check_model_physics,
        "slope_at(ahead, u, slope_ahead);",
        "slope_ahead[0] = slope[0]; slope_ahead[1] = slope[1];",
    ),
    Fault(
        "front tyre in place of the rear one",
        checks_reference_model.check_model_physics,
        "shape[1] = ars_reference_model_rear_curve(arguments[1]);",
        "shape[1] = ars_reference_model_front_curve(arguments[0]);",
    ),
    Fault(
        "one axle a thousandth stiffer",
        checks_reference_model.check_model_physics,
        "shape[1] = ars_reference_model_rear_curve(arguments[1]);",
        "shape[1] = 1.001f * ars_reference_model_rear_curve(arguments[1]);",
    ),
    Fault(
        "half a step of the rear wheels forgotten",
        checks_reference_model.check_model_physics,
        "self->rear_angle + (0.5f * moved),",
        "self->rear_angle,",
    ),
    Fault(
        "friction not taken",
        checks_reference_model.check_model_settles,
        "(input->friction < friction_max) ? between(input->friction, 0.0f, friction_max) : friction_max",
        "friction_max",
    ),
    Fault(
        "NaN of the friction let in",
        checks_reference_model.check_model_same_bits,
        "(input->friction < friction_max) ? between(input->friction, 0.0f, friction_max) : friction_max",
        "input->friction",
    ),
    Fault(
        "any speed taken",
        checks_reference_model.check_model_stable_when_slow,
        "between(input->speed, model_speed_min, model_speed_max),",
        "input->speed,",
    ),
    Fault(
        "the slowest speed too slow for the step",
        checks_reference_model.check_model_stable_when_slow,
        "between(input->speed, model_speed_min, model_speed_max),",
        "between(input->speed, 0.3f * model_speed_min, model_speed_max),",
    ),
    Fault(
        "front angle without its bound",
        checks_reference_model.check_model_same_bits,
        "bounded(input->front_angle, front_angle_max),",
        "bounded(input->front_angle, 10.0f),",
    ),
    Fault(
        "sideslip without its bound",
        checks_reference_model.check_model_finite,
        "self->sideslip_angle = bounded(x[0] + ((0.5f * step) * (slope[0] + slope_ahead[0])), model_sideslip_max);",
        "self->sideslip_angle = x[0] + ((0.5f * step) * (slope[0] + slope_ahead[0]));",
    ),
    Fault(
        "yaw rate without its bound",
        checks_reference_model.check_model_finite,
        "self->yaw_rate = bounded(x[1] + ((0.5f * step) * (slope[1] + slope_ahead[1])), model_yaw_rate_max);",
        "self->yaw_rate = x[1] + ((0.5f * step) * (slope[1] + slope_ahead[1]));",
    ),
    Fault(
        "actuator at once",
        checks_reference_model.check_model_actuator,
        "between(actuator_share * way, -actuator_step_max, actuator_step_max)",
        "way",
    ),
    Fault(
        "actuator without its rate",
        checks_reference_model.check_model_actuator,
        "between(actuator_share * way, -actuator_step_max, actuator_step_max)",
        "actuator_share * way",
    ),
    Fault(
        "start without sideslip",
        checks_reference_model.check_model_same_bits,
        "self->rear_angle + (self->yaw_rate * ((rear_arm / forward) - (rear_slip * forward))),",
        "self->rear_angle,",
    ),
    Fault(
        "curve not interpolated",
        checks_reference_model.check_curves,
        "curve[index] + ((position - (float)index) * (curve[index + 1u] - curve[index]))",
        "curve[index]",
    ),
    Fault(
        "curve not odd",
        checks_reference_model.check_curves,
        "return (x < 0.0f) ? -value : value;",
        "return value;",
    ),
    Fault(
        "a wrong scale of the curves",
        checks_reference_model.check_curves,
        "(magnitude / (magnitude + compression)) * cells_per_share;",
        "(magnitude / (magnitude + compression)) * (float)cells;",
    ),
    Fault(
        "rounding of one operation in a long drive",
        checks_reference_model.check_model_same_bits_over_time,
        "self->rear_angle = bounded(self->rear_angle + moved, model_rear_angle_max);",
        "self->rear_angle = bounded(self->rear_angle + (moved * 1.0000001f), model_rear_angle_max);",
    ),
)

IN_THE_MAP_REFERENCE = (
    Fault(
        "transposed",
        checks_map_reference.check_same_bits_as_reference,
        "const float *const slower = &table[place->row.lower][place->column.lower];",
        "const float *const slower = &table[place->column.lower][place->row.lower];",
    ),
    Fault(
        "rear angle of the next cell",
        checks_map_reference.check_reference_rule,
        "reference.rear_angle = rear_angle_of_table(&place);",
        "reference.rear_angle = ars_map_rear_angle_table[place.row.lower][place.column.lower];",
    ),
    Fault(
        "yaw rate in place of the rear angle",
        checks_map_reference.check_reference_finite,
        "return interpolate(ars_map_rear_angle_table, place);",
        "return interpolate(ars_map_yaw_rate_table, place);",
    ),
    Fault(
        "no steering where the cap acts",
        checks_map_reference.check_reference_rule,
        "if (yaw_rate > reference.yaw_rate) {",
        "if (yaw_rate > 1000.0f) {",
    ),
    Fault(
        "steering beyond the sideslip bound",
        checks_map_reference.check_reference_rule,
        "if (wanted > bound) {\n        wanted = bound;\n    }",
        "",
    ),
    Fault(
        "steering beyond the rear angle's bound",
        checks_map_reference.check_reference_finite,
        "if (wanted > rear_angle_max) {\n        wanted = rear_angle_max;\n    }",
        "",
    ),
    Fault(
        "steering below the table's own",
        checks_map_reference.check_same_bits_as_reference,
        "return (wanted > rear_angle) ? wanted : rear_angle;",
        "return wanted;",
    ),
    Fault(
        "understeer forgotten",
        checks_map_reference.check_reference_rule,
        "((wheelbase / clamped) + (understeer_coefficient * clamped))",
        "(wheelbase / clamped)",
    ),
    Fault(
        "steering by a speed beyond the map",
        checks_map_reference.check_reference_rule,
        "(speed > top) ? top : speed;\n    const float bound",
        "speed;\n    const float bound",
    ),
    Fault(
        "rear angle keeps its sign in a right turn",
        checks_map_reference.check_reference_symmetry,
        "reference.rear_angle = -reference.rear_angle;",
        "",
    ),
    Fault(
        "the road's lateral acceleration is the map's own",
        checks_map_reference.check_same_bits_as_reference,
        "reference.lateral_acceleration_max = road.lateral_acceleration_max;",
        "reference.lateral_acceleration_max = lateral_acceleration_cap;",
    ),
)

IN_THE_STACK = (
    Fault(
        "the layer above is the layer itself",
        checks_map_reference.check_reference_rule,
        "interpolate(ars_map_rear_angle_table[road->layer.lower + 1u], place)",
        "interpolate(ars_map_rear_angle_table[road->layer.lower], place)",
    ),
    Fault(
        "layers exchanged",
        checks_map_reference.check_reference_rule,
        "interpolate(ars_map_yaw_rate_table[road->layer.lower], place)",
        "interpolate(ars_map_yaw_rate_table[2u - road->layer.lower], place)",
    ),
    Fault(
        "the middle layers never found",
        checks_map_reference.check_same_bits_as_reference,
        "if (on_stack >= friction_layers[candidate]) {",
        "if (on_stack > 1.0f) {",
    ),
    Fault(
        "a layer's own friction belongs to the cell below",
        checks_map_reference.check_same_bits_as_reference,
        "if (on_stack >= friction_layers[candidate]) {",
        "if (on_stack > friction_layers[candidate]) {",
    ),
    Fault(
        "cap of the layer below",
        checks_map_reference.check_same_bits_as_reference,
        "+ (road.layer.fraction * (lateral_acceleration_caps[layer + 1u] - lateral_acceleration_caps[layer]))",
        "",
    ),
    Fault(
        "cap held below the lowest friction",
        checks_map_reference.check_same_bits_as_reference,
        "if (known < friction_layers[0]) {",
        "if (known < 0.0f) {",
    ),
    Fault(
        "NaN of the friction counts as slippery",
        checks_map_reference.check_same_bits_as_reference,
        "((friction <= 0.0f) ? 0.0f : map_friction)",
        "((friction >= map_friction) ? map_friction : 0.0f)",
    ),
)

FAULTS = {
    ("tracking", "src/ars_limiter.c"): IN_THE_LIMITER,
    ("tracking", "src/ars_reference_model.c"): IN_THE_REFERENCE_MODEL,
    ("tracking", "src/ars_map.c"): IN_THE_MAP_REFERENCE,
    ("rough stack", "src/ars_map.c"): IN_THE_STACK,
}
"""By the units and the file that they are planted in."""
