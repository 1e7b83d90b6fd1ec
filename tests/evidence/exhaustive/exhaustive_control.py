"""Claims of the helpers of the controller and of the limiter: clamps, ranges, steps, and what is interpolated over speed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from codegen.config import KM_H
from tests.evidence.exhaustive.exhaustive_helper import Facts, Helper, edges, number

MAGNITUDE = """
    EQUAL("the number without its sign", {{ call("magnitude", value="x") }}, number_of(size_of(bits)));
"""
CLAMP = """
    {%- for low, high in ranges %}
    EQUAL("{{ low }} to {{ high }}", {{ call("clamp", value="x", low=low, high=high) }}, held(bits, {{ low }}, {{ high }}));
    {%- endfor %}
"""
IS_WITHIN = """
    {%- for limit in limits %}
    SAME("{{ limit }}", {{ call("is_within", value="x", largest=limit) }}, size_of(bits) <= bits_of({{ limit }}));
    {%- endfor %}
"""
IS_ABSENT_OR_WITHIN = """
    {%- for limit in limits %}
    SAME("{{ limit }}", {{ call("is_absent_or_within", value="x", largest=limit) }},
        (size_of(bits) <= bits_of({{ limit }})) | is_nan(bits));
    {%- endfor %}
"""
IS_BETWEEN = """
    {%- for low, high in ranges %}
    SAME("{{ low }} to {{ high }}", {{ call("is_between", value="x", low=low, high=high) }},
        (order_of(bits) >= order_of(bits_of({{ low }}))) & (order_of(bits) <= order_of(bits_of({{ high }}))) & !is_nan(bits));
    {%- endfor %}
"""
TOWARD_ZERO = """
    {%- for step in steps %}
    {
        /* Rounded to a double first, a difference of two floats rounds to the same float: that has over twice the digits. */
        const double size = (double)number_of(size_of(bits)) - (double){{ step }};
        const float left = (is_nan(bits) || (size <= 0.0)) ? 0.0f : (float)size;

        EQUAL("{{ step }} a sample", {{ call("toward_zero", value="x", step=step) }}, (bits > 0x7FFFFFFFu) ? -left : left);
    }
    {%- endfor %}
"""
KNOWN_SETUP = """
static const {{ p }}_parameters_t known_parameters = { .friction_min = {{ least }} };
"""
KNOWN_FRICTION = """
    {{ p }}_measurement_t measurement;

    measurement.friction = x;
    SAME("at least the smallest; NaN stays NaN",
        {{ call("known_friction", parameters="&known_parameters", measurement="&measurement") }},
        is_nan(bits) ? NAN : held(bits, {{ least }}, INFINITY));
"""
CONTROLLER_INIT = """
    const float expected = is_nan(bits) ? 0.0f : held(bits, -{{ limit }}, {{ limit }});
    {{ p }}_controller_t self;

    {{ call(p ~ "_controller_init", self="&self", rear_angle="x") }};
    EQUAL("the actuator's range, NaN as zero", self.rear_angle, expected);
    EQUAL("the limiter starts there too", self.limiter.rear_angle, expected);
"""
LIMITER_INIT = """
    {{ p }}_limiter_t self;

    {{ call(p ~ "_limiter_init", self="&self", rear_angle="x") }};
    EQUAL("itself, or zero beyond one radian", self.rear_angle, (size_of(bits) <= bits_of(1.0f)) ? x : 0.0f);
"""

# From cell to cell with the input, which mostly grows; rounding is at most half a unit for each of five operations.
CELL = """
static uint32_t {{ name }}_cell;
static float {{ name }}_from;
static float {{ name }}_to;
static double {{ name }}_inverse;

static void {{ name }}_enter(const float *breakpoints, uint32_t points, uint32_t cell)
{
    {{ name }}_cell = cell;
    {{ name }}_from = (cell == 0u) ? -INFINITY : breakpoints[cell];
    {{ name }}_to = (cell + 2u == points) ? INFINITY : breakpoints[cell + 1u];
    {{ name }}_inverse = 1.0 / ((double)breakpoints[cell + 1u] - (double)breakpoints[cell]);
}

static inline double {{ name }}_share(const float *breakpoints, uint32_t points, float x)
{
    double share;

    while (x >= {{ name }}_to && {{ name }}_cell + 2u < points) {
        {{ name }}_enter(breakpoints, points, {{ name }}_cell + 1u);
    }
    while (x < {{ name }}_from) {
        {{ name }}_enter(breakpoints, points, {{ name }}_cell - 1u);
    }
    share = ((double)x - (double)breakpoints[{{ name }}_cell]) * {{ name }}_inverse;
    return (share < 0.0) ? 0.0 : (share > 1.0) ? 1.0 : share;
}

static inline double {{ name }}_line(const float *values, double share)
{
    const double from = values[{{ name }}_cell];

    return from + (share * ((double)values[{{ name }}_cell + 1u] - from));
}

static double {{ name }}_tolerance(const float *values, uint32_t points)
{
    double largest = 0.0;

    for (uint32_t k = 0u; k < points; k++) {
        largest = fmax(largest, fabs((double)values[k]));
    }
    return 2.5 * largest * 0x1p-23;
}
"""
GAINS_SETUP = (
    CELL
    + """
static double proportional_tolerance;
static double integral_tolerance;
"""
)
GAINS_START = """
    {{ name }}_enter({{ p }}_parameters_default.schedule_speed, {{ P }}_SCHEDULE_POINTS, 0u);
    proportional_tolerance = {{ name }}_tolerance({{ p }}_parameters_default.proportional_gain, {{ P }}_SCHEDULE_POINTS);
    integral_tolerance = {{ name }}_tolerance({{ p }}_parameters_default.integral_gain, {{ P }}_SCHEDULE_POINTS);
"""
GAINS_AT = """
    /* NaN, which the step does not let through, may have any gain of the schedule: here, that of the slowest. */
    const {{ p }}_parameters_t *const schedule = &{{ p }}_parameters_default;
    const double share = {{ name }}_share(schedule->schedule_speed, {{ P }}_SCHEDULE_POINTS, is_nan(bits) ? -1.0f : x);
    const gains_t gains = {{ call("gains_at", parameters="schedule", speed="x") }};

    NEAR("proportional", gains.proportional, {{ name }}_line(schedule->proportional_gain, share), proportional_tolerance);
    NEAR("integral", gains.integral, {{ name }}_line(schedule->integral_gain, share), integral_tolerance);
"""
# The bounds of a build may be all alike, which would show little.
BOUND_SETUP = (
    CELL
    + """
static double bound_slack;
static const {{ p }}_limiter_parameters_t falling = {
    .opposite_phase_speed = { {{ speeds | join(", ") }} },
    .opposite_phase_max = { {{ bounds | join(", ") }} },
};
"""
)
BOUND_START = """
    {{ name }}_enter(falling.opposite_phase_speed, {{ P }}_LIMITER_POINTS, 0u);
    bound_slack = {{ name }}_tolerance(falling.opposite_phase_max, {{ P }}_LIMITER_POINTS);
"""
BOUND = """
    const {{ p }}_limiter_parameters_t *const table = &falling;
    const uint32_t last = {{ P }}_LIMITER_POINTS - 1u;
    const double share = {{ name }}_share(table->opposite_phase_speed, {{ P }}_LIMITER_POINTS, is_nan(bits) ? -1.0f : x);
    const float bound = {{ call("opposite_phase_bound", parameters="table", speed="x") }};

    NEAR("linear between the breakpoints", bound, {{ name }}_line(table->opposite_phase_max, share), bound_slack);
    HOLDS("held beyond the last, to the bit", !(x >= table->opposite_phase_speed[last])
        | (bound == table->opposite_phase_max[last]), bound, table->opposite_phase_max[last]);
"""
EDGES_OF = """
    for (uint32_t k = 0u; k < {{ P }}_{{ points }}; k++) {
        EDGE({{ table }}[k]);
    }
"""

RANGES = (("0.0f", "100.0f"), ("1.0e-4f", "1.0f"), ("-1.0f", "1.0f"))
"""As parameters and starts are held against: from zero, from above it, and on both sides."""


def helpers(facts: Facts) -> Iterator[Helper]:
    """Of the units controller and limiter."""
    config, inputs = facts.config, facts.config.controller.inputs
    angle, period = number(config.rear_actuator.angle_max), np.float32(config.controller.sampling_time_s)
    standby = np.float32(math.radians(config.controller.standby_rate_deg_s))
    limits = [number(inputs.speed_max_km_h * KM_H)]
    limits += [number(math.radians(degrees)) for degrees in (inputs.front_angle_max_deg, inputs.yaw_rate_max_deg_s)]
    absent = [number(math.radians(inputs.rear_angle_max_deg)), number(inputs.friction_max)]
    clamps = [(f"-{angle}", angle), ("0.0f", "1.0f")]
    for unit in ("controller", "limiter"):
        yield Helper(unit, "magnitude", "the number without its sign; NaN stays NaN", MAGNITUDE)
        claim = "the value within its bounds, NaN as the lower"
        yield Helper(unit, "clamp", claim, CLAMP, edges=_ends(clamps), values={"ranges": clamps})
        claim = "no farther from zero than the limit, false for NaN"
        yield Helper(unit, "is_within", claim, IS_WITHIN, edges=edges(*limits), values={"limits": limits})
        claim = "within both bounds, false for NaN"
        yield Helper(unit, "is_between", claim, IS_BETWEEN, edges=_ends(RANGES), values={"ranges": RANGES})
    claim = "no farther from zero than the limit, true for NaN"
    values: dict[str, Any] = {"limits": absent}
    yield Helper("controller", "is_absent_or_within", claim, IS_ABSENT_OR_WITHIN, edges=edges(*absent), values=values)
    steps = [number(float(standby * period))]
    claim = "closer to zero by a step and not beyond, NaN as zero"
    yield Helper("controller", "toward_zero", claim, TOWARD_ZERO, edges=edges(*steps), values={"steps": steps})
    least = number(config.controller.friction_min)
    claim = "no less than the smallest that is believed; NaN stays NaN"
    values = {"least": least}
    yield Helper("controller", "known_friction", claim, KNOWN_FRICTION, setup=KNOWN_SETUP, edges=edges(least), values=values)
    claim = "starts within the actuator's range, NaN as zero"
    yield Helper("controller", "@_controller_init", claim, CONTROLLER_INIT, edges=edges(angle), values={"limit": angle})
    yield Helper("limiter", "@_limiter_init", "starts within a radian, all else as zero", LIMITER_INIT, edges=edges("1.0f"))
    yield from _over_speed(facts)


def _ends(ranges: Sequence[tuple[str, str]]) -> str:
    return edges(*sorted({value for pair in ranges for value in pair}))


def _over_speed(facts: Facts) -> Iterator[Helper]:
    claim, at = "linear between the breakpoints, held beyond", EDGES_OF
    setup, start = BOUND_SETUP, BOUND_START
    speeds = facts.config.limiter.opposite_phase_speed_km_h
    bounds = [facts.config.rear_actuator.angle_max * (1.0 - k / len(speeds)) for k in range(len(speeds))]
    values: dict[str, Any] = {"name": "bound", "points": "LIMITER_POINTS", "table": "falling.opposite_phase_speed"}
    values |= {"speeds": [number(speed * KM_H) for speed in speeds], "bounds": [number(bound) for bound in bounds]}
    yield Helper("limiter", "opposite_phase_bound", claim, BOUND, setup=setup, start=start, edges=at, values=values)
    if facts.is_tracking:
        setup, start = GAINS_SETUP, GAINS_START
        table = f"{facts.subject.prefix}_parameters_default.schedule_speed"
        values = {"name": "gains", "points": "SCHEDULE_POINTS", "table": table}
        yield Helper("controller", "gains_at", claim, GAINS_AT, setup=setup, start=start, edges=at, values=values)
