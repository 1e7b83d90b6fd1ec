"""Claims about the helpers of the controller and of the limiter: clamps, ranges, steps, and interpolation over speed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from codegen.config import KM_H
from codegen.emit.limiter_view import opposite_phase_speeds_km_h
from tests.evidence.exhaustive.claim import Claim, Source, edges, exact, number

MAGNITUDE = 'SAME("the number without its sign", {{ function }}(x), number_of(size_of(bits)));'
HELD = """
    {% for low, high in ranges %}
    SAME("{{ low }} to {{ high }}", {{ function }}(x, {{ low }}, {{ high }}), held(bits, {{ low }}, {{ high }}));
    {% endfor %}
"""
IS_WITHIN = """
    {% for limit in limits %}
    SAME("{{ limit }}", {{ function }}(x, {{ limit }}), (size_of(bits) <= bits_of({{ limit }})){{ or_nan }});
    {% endfor %}
"""
IS_BETWEEN = """
    {% for low, high in ranges %}
    SAME("{{ low }} to {{ high }}", {{ function }}({{ given }}, {{ low }}, {{ high }}),
        held(bits, {{ low }}, {{ high }}) == x);
    {% endfor %}
"""
TOWARD_ZERO = """
    /* The difference in double precision, rounded to single, is the single difference: it has over twice the digits. */
    const double size = (double)number_of(size_of(bits)) - (double){{ step }};
    const float left = (is_nan(bits) | (size <= 0.0)) ? 0.0f : (float)size;

    SAME("one step", toward_zero(x, {{ step }}), (bits > 0x7FFFFFFFu) ? -left : left);
"""
KNOWN_FRICTION = """
    {{ p }}_measurement_t measurement;

    measurement.friction = x;
    SAME("at least the smallest; NaN stays NaN", known_friction(&known_parameters, &measurement),
        is_nan(bits) ? NAN : held(bits, {{ least }}, INFINITY));
"""
CONTROLLER_INIT = """
    const float expected = is_nan(bits) ? 0.0f : held(bits, -{{ limit }}, {{ limit }});
    {{ p }}_controller_t self;

    {{ function }}(&self, x);
    SAME("the actuator's range, NaN as zero", self.rear_angle, expected);
    SAME("the limiter starts there too", self.limiter.rear_angle, expected);
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
    /* NaN, which the step rejects, may have any value of the table; it has that of the lowest speed. */
    const double place = place_on(&{{ function }}_axis, is_nan(bits) ? -1.0 : (double)x);
    const {{ result }} got = {{ function }}(&{{ function }}_table, x);

    {% for member, of, tolerance in outputs %}
    NEAR("linear between the breakpoints", got{{ of }}, line_on(&{{ function }}_axis, {{ function }}_table.{{ member }}, place),
        {{ tolerance }});
    SAME("held beyond the last, to the bit", (x >= {{ last }}) ? got{{ of }} : 0.0f,
        (x >= {{ last }}) ? {{ function }}_table.{{ member }}[{{ at | length - 1 }}] : 0.0f);
    {% endfor %}
"""

RANGES = (("0.0f", "100.0f"), ("1.0e-4f", "1.0f"), ("-1.0f", "1.0f"))
"""Kinds of ranges that parameters and initial states are checked against: from zero, from above zero, on both sides."""


def claims(source: Source) -> Iterator[Claim]:
    """Claims about the units controller and limiter."""
    config, inputs = source.config, source.config.controller.inputs
    angle = number(config.rear_actuator.angle_max)
    limits = [number(inputs.speed_max_km_h * KM_H)]
    limits += [number(math.radians(degrees)) for degrees in (inputs.front_angle_max_deg, inputs.yaw_rate_max_deg_s)]
    clamps = [(f"-{angle}", angle), ("0.0f", "1.0f")]
    for unit in ("controller", "limiter"):
        yield Claim(unit, "magnitude", "the number without its sign; NaN stays NaN", MAGNITUDE)
        yield held(unit, "clamp", clamps)
        text = "no farther from zero than the limit, false for NaN"
        yield Claim(unit, "is_within", text, IS_WITHIN, edges(*limits), values={"limits": limits, "or_nan": ""})
        yield between(unit, "is_between", RANGES)
    limits = [number(math.radians(inputs.rear_angle_max_deg)), number(inputs.friction_max)]
    values: Mapping[str, object] = {"limits": limits, "or_nan": " | is_nan(bits)"}
    text = "no farther from zero than the limit, true for NaN"
    yield Claim("controller", "is_absent_or_within", text, IS_WITHIN, edges(*limits), values=values)
    period = np.float32(config.controller.sampling_time_s)
    step = number(float(np.float32(math.radians(config.controller.standby_rate_deg_s)) * period))
    text = "closer to zero by a step and not beyond, NaN as zero"
    yield Claim("controller", "toward_zero", text, TOWARD_ZERO, edges(step), values={"step": step})
    least = number(config.controller.friction_min)
    setup = "static const {{ p }}_parameters_t known_parameters = { .friction_min = {{ least }} };"
    text = "no less than the smallest plausible friction; NaN stays NaN"
    yield Claim("controller", "known_friction", text, KNOWN_FRICTION, edges(least), setup, values={"least": least})
    text = "starts within the actuator's range, NaN as zero"
    yield Claim("controller", "@_controller_init", text, CONTROLLER_INIT, edges(angle), values={"limit": angle})
    yield Claim("limiter", "@_limiter_init", "starts within a radian, all else as zero", LIMITER_INIT, edges("1.0f"))
    # The bounds of a build may all be equal, which would test little: these fall with speed.
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
        yield _over_speed("controller", "gains_at", "parameters_t", "gains_t", speeds, outputs)


def held(unit: str, function: str, ranges: Sequence[tuple[str, str]]) -> Claim:
    """Claim of a function that limits a value to a range."""
    text = "the value within its bounds, NaN as the lower"
    return Claim(unit, function, text, HELD, edges(*chain(*ranges)), values={"ranges": ranges})


def between(unit: str, function: str, ranges: Sequence[tuple[str, str]], given: str = "x") -> Claim:
    """Claim of a function that reports whether a value lies in a range."""
    text, values = "within both bounds, false for NaN", {"ranges": ranges, "given": given}
    return Claim(unit, function, text, IS_BETWEEN, edges(*chain(*ranges)), values=values)


Outputs = Mapping[str, tuple[str, Sequence[float]]]
"""Values of a table over speed, by member of the parameters; each with the suffix that takes the result from the call."""


def _over_speed(unit: str, function: str, kind: str, result: str, speeds: Sequence[float], outputs: Outputs) -> Claim:
    """Claim of a table over speed. Rounding is at most half a unit of the largest value for each of five operations."""
    speed = "opposite_phase_speed" if unit == "limiter" else "schedule_speed"
    columns = {speed: speeds, **{member: numbers for member, (_, numbers) in outputs.items()}}
    values = {
        "type": kind,
        "result": result,
        "at": [exact(at) for at in speeds],
        "last": number(speeds[-1]),
        "columns": {member: [*map(number, numbers)] for member, numbers in columns.items()},
        "outputs": [(member, of, repr(2.5 * max(map(abs, each)) * 2.0**-23)) for member, (of, each) in outputs.items()],
    }
    text, start = "linear between the breakpoints, held beyond", "{{ function }}_axis.cell = 0u;"
    return Claim(unit, function, text, OVER_SPEED, edges(*map(number, speeds)), OVER_SPEED_SETUP, start, values=values)
