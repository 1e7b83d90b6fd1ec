"""Claims about the helpers of the controller's units: clamps, ranges, steps, and interpolation over speed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from codegen.emit.controller_view import SLOW_RATE, STANDING_SPEED, controller_parameters
from codegen.emit.inputs_view import SHORT_SHARE, inputs_parameters
from codegen.emit.laws import law_of
from codegen.emit.limiter_view import opposite_phase_speeds_km_h
from codegen.units import KM_H
from tests.evidence.exhaustive.claim import Claim, Source, edges, exact, number

MAGNITUDE = 'SAME("the number without its sign", {{ function }}(x), number_of(size_of(bits)));'
HELD = """
    {% for low, high in ranges %}
    SAME("{{ low }} to {{ high }}", {{ function }}(x, {{ low }}, {{ high }}), held(bits, {{ low }}, {{ high }}));
    {% endfor %}
"""
IS_WITHIN = """
    {% for limit in limits %}
    SAME("{{ limit }}", {{ function }}(x, {{ limit }}), size_of(bits) <= bits_of({{ limit }}));
    {% endfor %}
"""
IS_BETWEEN = """
    {% for low, high in ranges %}
    SAME("{{ low }} to {{ high }}", {{ function }}({{ given }}, {{ low }}, {{ high }}),
        held(bits, {{ low }}, {{ high }}) == x);
    {% endfor %}
"""
BOUNDED = """
    {% for limit in limits %}
    SAME("{{ limit }}", bounded(x, {{ limit }}), is_nan(bits) ? {{ limit }} : held(bits, -{{ limit }}, {{ limit }}));
    {% endfor %}
"""
TOWARD_ZERO = """
    /* The difference in double precision, rounded to single, is the single difference: it has over twice the digits. */
    const double size = (double)number_of(size_of(bits)) - (double){{ step }};
    const float left = (is_nan(bits) | (size <= 0.0)) ? 0.0f : (float)size;

    SAME("one step", toward_zero(x, {{ step }}), (bits > 0x7FFFFFFFu) ? -left : left);
"""
NOT_NEGATIVE = """
    SAME("itself above zero; zero for the others, NaN too", not_negative(x), (x > 0.0f) ? number_of(bits) : 0.0f);
"""
KNOWN_FRICTION = """
    SAME("at least the smallest; NaN stays NaN", known_friction(&known_parameters, x),
        is_nan(bits) ? NAN : held(bits, {{ least }}, INFINITY));
"""
GRIP_FRICTION = """
    const {{ p }}_grip_t grip = { .available = 2.0f };
    const float seen = 2.0f * ars_constants.friction_per_grip; /* exact */

    SAME("1.25 times it, at least so of the smallest, at most that of the grip, which NaN counts as",
        {{ function }}(&grip, &known_parameters, x), is_nan(bits) ? seen : held(bits_of(1.25f * x), 1.25f * {{ least }}, seen));
"""
CHOOSE_BY_SPEED = """
    {{ p }}_controller_t on = { .enabled = true };
    {{ p }}_controller_t off = { .enabled = false };

    {{ function }}(&on, &speed_parameters, x);
    {{ function }}(&off, &speed_parameters, x);
    SAME("off below the lower speed", on.enabled, is_nan(bits) || (order_of(bits) >= order_of(bits_of({{ low }}))));
    SAME("on from the upper speed", off.enabled, !is_nan(bits) && (order_of(bits) >= order_of(bits_of({{ high }}))));
"""
IN_DIRECTION = """
    const bool is_reverse = (bits > 0x80000000u) && !is_nan(bits);

    SAME("itself forwards", in_direction(x, 1.0f), x);
    SAME("the other sign in reverse", in_direction(x, -1.0f), -x);
    SAME("by the sign of the speed", in_direction(1.0f, x), is_reverse ? -1.0f : 1.0f);
"""
FEEDBACK_SHARE = """
    const double share = is_nan(bits) ? 0.0 : (((double)x - (double){{ slow }}) / (double){{ slow }});

    /* One rounding of the difference, and one of the quotient. */
    NEAR("linear from none to the whole", feedback_share(&slow_parameters, x), fmin(fmax(share, 0.0), 1.0),
        0x1.001p-23 * fmin(fmax(share, 0.0), 1.0));
"""
MODEL_SPEED = """
    SAME("at least the slow speed, which NaN counts as", model_speed(&slow_parameters, x), held(bits, {{ slow }}, INFINITY));
"""
SLOW_STEP = """
    const bool is_speed = size_of(bits) <= bits_of({{ top }});
    const double share = fmax(((double)x - (double){{ slow }}) / (2.0 * (double){{ slow }}), 0.0);
    const double driven = (size_of(bits) < bits_of({{ standing }})) ? 0.0 : (fabs((double)x) * (double){{ period }});
    const double turned = fmin((double){{ fade }} * driven, (double){{ slow_rate }} * (double){{ period }});
    const double expected = turned + ((double){{ rate }} * (double){{ period }} * share * share);

    /* Eight roundings of terms that are not negative. */
    NEAR("that of the distance, and above the slow speed a share of the rate limit",
        is_speed ? slow_step(&slow_parameters, x) : 0.0f, is_speed ? expected : 0.0, is_speed ? (0x1.001p-21 * expected) : 0.0);
"""
YAW_GAIN = """
    const double length = (double){{ wheelbase }} + (((double){{ understeer }} * (double)x) * (double)x);
    const bool is_speed = size_of(bits) <= bits_of({{ top }});
    const double expected = is_speed ? ((double)x / fmax(length, 0.25 * (double){{ wheelbase }})) : 0.0;

    /* Four roundings for a length above zero, which the linear car of this build has, and one of the quotient. */
    NEAR("that of the linear car", is_speed ? {{ function }}(&gain_parameters, x) : 0.0f, expected,
        (5.0 * 0x1p-23) * fabs(expected) + 0x1p-149);
"""
AGREES = """
    {% for turn in turns %}
    /* A difference in double precision, rounded to single, is the single difference: it has over twice the digits. */
    SAME("{{ turn }}", {{ function }}(&agreement_parameters, x, {{ turn }}),
        (fabs((double)(float)((double)x - (double){{ turn }})) <= (double){{ agreement }})
            && (fabs((double){{ turn }}) > (double)({{ agreement }} + {{ agreement }})));
    {% endfor %}
"""
FALLS_SHORT = """
    {% for turn in turns %}
    SAME("{{ turn }}", {{ function }}(&agreement_parameters, x, {{ turn }}),
        ((float)((double)x * (double){{ turn }})
            < (float)({{ share }} * (double)(float)((double){{ turn }} * (double){{ turn }})))
            && !(fabs((double)(float)((double)x - (double){{ turn }})) <= (double)(2.0f * {{ agreement }})));
    {% endfor %}
"""
IS_RIGHT_AGAIN = """
    {% for held in replaced %}
    {
    const float near = (float)((double){{ agreement }} + (0.25 * fabs({{ held }})));

    SAME("for {{ held }} m/s", {{ function }}(&right_parameters, x, {{ held }}), (fabs({{ held }}) < 1.0)
        || (fabs((double)(float)((double)x - {{ held }})) <= (double)near));
    }
    {% endfor %}
"""
TAKE_FRICTION = """
    {{ p }}_inputs_t self = { .friction = {{ before }} };
    const bool is_estimate = held(bits, 0.0f, {{ top }}) == x;

    {{ function }}(&self, &friction_parameters, x);
    SAME("the estimate, or the last one on its way up", self.friction, is_estimate ? x : ({{ before }} + {{ recovery }}));
"""
CONTROLLER_INIT = """
    const float expected = is_nan(bits) ? 0.0f : held(bits, -{{ limit }}, {{ limit }});
    {{ p }}_controller_t self;

    {{ function }}(&self, x);
    SAME("the actuator's range, NaN as zero", self.rear_angle, expected);
    SAME("the limiter starts there too", self.limiter.rear_angle, expected);
"""
RESTART_ANGLE = """
    const bool is_plausible = size_of(bits) <= bits_of({{ largest }});
    {{ p }}_controller_t commanded, beyond;
    const {{ p }}_controller_t blank = { .rear_angle = 0.01f };

    {{ p }}_controller_init(&commanded, 0.01f);
    beyond = commanded;
    beyond.rear_angle = 1.0f;
    SAME("otherwise the last command", {{ function }}(&commanded, &restart_parameters, x), is_plausible ? x : 0.01f);
    SAME("no command of the actuator", {{ function }}(&beyond, &restart_parameters, x), is_plausible ? x : 0.0f);
    SAME("no command before the start", {{ function }}(&blank, &restart_parameters, x), is_plausible ? x : 0.0f);
"""
LIMITER_INIT = """
    {{ p }}_limiter_t self;

    {{ function }}(&self, x);
    SAME("itself, or zero beyond one radian", self.rear_angle, (size_of(bits) <= bits_of(1.0f)) ? x : 0.0f);
"""
OVER_SPEED_SETUP = """
static const double {{ function }}_at[] = { {{ at | join(", ") }} };
static axis_t {{ function }}_axis = { {{ function }}_at, {{ at | length - 1 }}u, 0u };
static const {{ p }}_{{ type }} {{ function }}_table = {
    {% for member, numbers in columns.items() %}
    .{{ member }} = { {{ numbers | join(", ") }} },
    {% endfor %}
};
"""
OVER_SPEED = """
    /* The step rejects NaN, so any value of the table is correct for it. */
    const double place = place_on(&{{ function }}_axis, is_nan(bits) ? {{ of_nan }} : (double)x);
    const {{ result }} got = {{ function }}(&{{ function }}_table, x);
    const {{ result }} at_last = {{ function }}(&{{ function }}_table, {{ last }}); /* the last value but for rounding */

    {% for member, of, tolerance in outputs %}
    NEAR("linear between the breakpoints", got{{ of }}, line_on(&{{ function }}_axis, {{ function }}_table.{{ member }}, place),
        {{ tolerance }});
    SAME("held beyond the last, to the bit", (x >= {{ last }}) ? got{{ of }} : 0.0f,
        (x >= {{ last }}) ? at_last{{ of }} : 0.0f);
    {% endfor %}
"""

RANGES = (("0.0f", "100.0f"), ("1.0e-4f", "1.0f"), ("-1.0f", "1.0f"))
"""Ranges for checks of parameters and initial states: from zero, from above zero, on both sides."""


def claims(source: Source) -> Iterator[Claim]:
    """Yield claims about the units parameters, law, grip, controller and limiter."""
    config, inputs = source.config, source.config.controller.inputs
    angle = number(config.rear_actuator.angle_max)
    limits = [number(inputs.speed_max_km_h * KM_H)]
    limits += [number(math.radians(degrees)) for degrees in (inputs.front_angle_max_deg, inputs.yaw_rate_max_deg_s)]
    clamps = [(f"-{angle}", angle), ("0.0f", "1.0f")]
    bounding, tracking = (
        ["controller", "inputs", "law", "limiter", "task"],
        ["grip"] if source.subject.kind == "tracking" else [],
    )
    bounding += ["reference_model"] if tracking else []
    for unit in (*bounding, "map", *tracking):
        yield Claim(unit, "magnitude", "returns the magnitude; NaN stays NaN", MAGNITUDE)
    for unit in bounding:
        text = "limits the magnitude; NaN becomes the upper limit"
        yield Claim(unit, "bounded", text, BOUNDED, edges(angle, *limits), values={"limits": [angle, *limits]})
    for unit in ("limiter", "law", *tracking, *(("inputs",) if tracking else ())):
        yield held(unit, "clamp", clamps)
    for unit in ("inputs", "limiter"):
        text = "true if the magnitude is within the limit; false for NaN"
        yield Claim(unit, "is_within", text, IS_WITHIN, edges(*limits), values={"limits": limits})
    for unit in ("inputs", "parameters", "limiter"):
        yield between(unit, "is_between", RANGES)
    yield from _inputs(source)
    period = np.float32(config.controller.sampling_time_s)
    waits, fail_safe = config.controller.waits_for_speed, config.controller.fail_safe
    rate = config.controller.standby_rate_deg_s if waits else fail_safe.rate_deg_s
    step = number(float(np.float32(math.radians(rate)) * period))
    text = "moves one step toward zero but not past it; NaN becomes zero"
    fall = number(config.controller.inputs.speed_fall_m_s2 * config.controller.sampling_time_s)
    for unit, each in (("controller", step), ("inputs", fall)):
        yield Claim(unit, "toward_zero", text, TOWARD_ZERO, edges(each), values={"step": each})
    yield from _enabling(source) if waits else _slow_car(source)
    if tracking:
        yield Claim("law", "not_negative", "zero for a negative number and NaN", NOT_NEGATIVE, edges("0.0f"))
    least = number(config.controller.friction_min)
    setup = "static const {{ p }}_parameters_t known_parameters = { .friction_min = {{ least }} };"
    if source.subject.kind == "tracking":
        text = "1.25 times the friction, from that of the smallest plausible one to that of the grip, which also replaces NaN"
        yield Claim("grip", "@_grip_friction", text, GRIP_FRICTION, edges(least), setup, values={"least": least})
    else:
        text = "at least the smallest plausible friction; NaN stays NaN"
        yield Claim("controller", "known_friction", text, KNOWN_FRICTION, edges(least), setup, values={"least": least})
    text = "starts within the actuator's range; NaN becomes zero"
    for name in ("@_controller_init", "@_controller_place"):
        yield Claim("controller", name, text, CONTROLLER_INIT, edges(angle), values={"limit": angle})
    largest = {parameter.name: number(parameter.value) for parameter in inputs_parameters(config)}["rear_angle_max"]
    text = "a plausible measured angle; without it the last command if there is one, otherwise zero"
    setup = "static const {{ p }}_parameters_t restart_parameters = { .inputs = { .rear_angle_max = {{ largest }} } };"
    near = edges(largest)
    yield Claim("controller", "restart_angle", text, RESTART_ANGLE, near, setup, values={"largest": largest})
    yield Claim("limiter", "@_limiter_init", "starts within a radian; anything else becomes zero", LIMITER_INIT, edges("1.0f"))
    # The bounds of a build may all be equal; these decrease with speed and test more.
    speeds = [speed * KM_H for speed in opposite_phase_speeds_km_h(config)]
    bounds = [config.rear_actuator.angle_max * (1.0 - k / len(speeds)) for k in range(len(speeds))]
    outputs = {"opposite_phase_max": ("", bounds)}
    yield _over_speed("limiter", "opposite_phase_bound", "limiter_parameters_t", "float", speeds, outputs)
    if source.subject.kind == "tracking":
        schedule = source.subject.manifest["configuration"]["controller"]["tracking"]["schedule"]
        outputs = {
            "proportional_gain": (".proportional", schedule["proportional_gain_s"]),
            "integral_gain": (".integral", schedule["integral_gain"]),
        }
        for name, field, key in (("lead_time", ".lead_time", "lead_s"), ("response_gain", ".response", "response_gain_s")):
            if schedule.get(key):
                outputs[name] = (field, schedule[key])
        speeds = [speed * KM_H for speed in schedule["speed_km_h"]]
        yield _over_speed("law", "gains_at", "parameters_t", "gains_t", speeds, outputs)


def _enabling(source: Source) -> Iterator[Claim]:
    """Yield the claim about the speeds between which a law that waits for a speed starts and ends."""
    controller = source.config.controller
    low, high = (number(speed * KM_H) for speed in (controller.disable_speed_km_h, controller.enable_speed_km_h))
    setup = "static const {{ p }}_parameters_t speed_parameters = { .disable_speed = {{ low }}, .enable_speed = {{ high }} };"
    text = "on from the upper speed, off below the lower; unchanged between them and for NaN"
    values: Mapping[str, object] = {"low": low, "high": high}
    yield Claim("controller", "choose_by_speed", text, CHOOSE_BY_SPEED, edges(low, high), setup, values=values)


def _slow_car(source: Source) -> Iterator[Claim]:
    """Yield claims about a law that works from standstill on."""
    named = {each.name: each.value for each in controller_parameters(source.config)}
    parameters = {name: number(named[name]) for name in ("slow_speed", "fade_rate", "rear_rate_max")}
    values: dict[str, object] = {"slow": parameters["slow_speed"], "fade": parameters["fade_rate"]}
    values |= {"rate": parameters["rear_rate_max"], "period": number(source.config.controller.sampling_time_s)}
    top = source.config.controller.inputs.speed_max_km_h * KM_H
    values |= {"standing": number(STANDING_SPEED), "slow_rate": number(SLOW_RATE), "top": number(top)}
    setup = "static const {{ p }}_parameters_t slow_parameters"
    setup += " = { .slow_speed = {{ slow }}, .fade_rate = {{ fade }}, .rear_rate_max = {{ rate }} };"
    near = edges(*(str(values[name]) for name in ("standing", "slow", "top")), "0.0f")
    text = "what the distance in a sample allows, and above slow_speed a share of the rate limit"
    yield Claim("controller", "slow_step", text, SLOW_STEP, near, setup, values=values)
    yield Claim("law", "in_direction", "itself forwards, the other sign in reverse", IN_DIRECTION, edges("0.0f"))
    text = "none up to slow_speed, whole from twice it on; NaN has none"
    yield Claim("law", "feedback_share", text, FEEDBACK_SHARE, near, setup, values=values)
    yield Claim("law", "model_speed", "at least slow_speed; NaN becomes slow_speed", MODEL_SPEED, near, values=values)


def _inputs(source: Source) -> Iterator[Claim]:
    """Yield claims about the helpers that only the unit inputs has."""
    values = {parameter.name: number(parameter.value) for parameter in inputs_parameters(source.config)}
    given = {"wheelbase": values["wheelbase"], "understeer": values["understeer_coefficient"], "top": values["speed_max"]}
    setup = "static const {{ p }}_inputs_parameters_t gain_parameters"
    setup += " = { .wheelbase = {{ wheelbase }}, .understeer_coefficient = {{ understeer }} };"
    yield Claim(
        "inputs", "yaw_gain", "equals the linear car's yaw gain at each speed", YAW_GAIN, edges("0.0f"), setup, values=given
    )
    agreement = values["yaw_rate_agreement"]
    turns = [number(share * float(agreement.rstrip("f"))) for share in (-9.0, -2.1, 0.0, 1.9, 2.1, 9.0)]
    setup = "static const {{ p }}_inputs_parameters_t agreement_parameters = { .yaw_rate_agreement = {{ agreement }} };"
    text = "true near the turn, if there is one; false for NaN"
    given = {"turns": turns, "agreement": agreement}
    yield Claim("inputs", "agrees", text, AGREES, edges(*turns), setup, values=given)
    if law_of(source.config).uses_reference_model:
        text = "true for another turn: less than a share of it, or to the other side; false for NaN"
        yield Claim("inputs", "falls_short", text, FALLS_SHORT, edges(*turns), values={**given, "share": SHORT_SHARE})
    setup = "static const {{ p }}_inputs_parameters_t right_parameters = { .speed_agreement = {{ agreement }} };"
    speeds = ["0.0f", "-0.5f", "1.0f", "-1.0f", "16.0f", "100.0f"]
    given = {"replaced": speeds, "agreement": values["speed_agreement"]}
    text = "true near the substitute, or if the substitute is no usable speed; otherwise false for NaN"
    yield Claim("inputs", "is_right_again", text, IS_RIGHT_AGAIN, edges(*speeds), setup, values=given)
    setup = "static const {{ p }}_inputs_parameters_t friction_parameters"
    setup += " = { .friction_max = {{ top }}, .friction_recovery = {{ recovery }} };"
    given = {"top": values["friction_max"], "recovery": values["friction_recovery"], "before": "0.5f"}
    text = "uses an estimate in its range, otherwise raises the last one"
    yield Claim("inputs", "take_friction", text, TAKE_FRICTION, edges("0.0f", given["top"]), setup, values=given)


def held(unit: str, function: str, ranges: Sequence[tuple[str, str]]) -> Claim:
    """Return the claim of a function that limits a value to a range."""
    text = "limits the value; NaN becomes the lower bound"
    return Claim(unit, function, text, HELD, edges(*chain(*ranges)), values={"ranges": ranges})


def between(unit: str, function: str, ranges: Sequence[tuple[str, str]], given: str = "x") -> Claim:
    """Return the claim of a function that reports whether a value is in a range."""
    text, values = "true within both bounds; false for NaN", {"ranges": ranges, "given": given}
    return Claim(unit, function, text, IS_BETWEEN, edges(*chain(*ranges)), values=values)


Outputs = Mapping[str, tuple[str, Sequence[float]]]
"""Values of a table over speed by parameter member, each with the suffix that selects the result of the call."""


def _over_speed(unit: str, function: str, kind: str, result: str, speeds: Sequence[float], outputs: Outputs) -> Claim:
    """Return the claim of a table over speed. The tolerance is half a unit of the largest value for each of five operations."""
    speed = "opposite_phase_speed" if unit == "limiter" else "schedule_speed"
    columns = {speed: speeds, **{member: numbers for member, (_, numbers) in outputs.items()}}
    values = {
        "type": kind,
        "of_nan": exact(speeds[-1]) if unit == "limiter" else "-1.0",
        "result": result,
        "at": [exact(at) for at in speeds],
        "last": number(speeds[-1]),
        "columns": {member: [*map(number, numbers)] for member, numbers in columns.items()},
        "outputs": [(member, of, repr(2.5 * max(map(abs, each)) * 2.0**-23)) for member, (of, each) in outputs.items()],
    }
    text, start = "linear between the breakpoints, held beyond", "{{ function }}_axis.cell = 0u;"
    return Claim(unit, function, text, OVER_SPEED, edges(*map(number, speeds)), OVER_SPEED_SETUP, start, values=values)
