"""Claims of the helpers of the map, of the reference model and of the dynamics: axes, the road, checksum, tyre curves."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from codegen.config import KM_H
from codegen.emit.dynamics_view import SPEED_MIN
from codegen.errors import BuildError
from codegen.refmap.problem import breakpoints
from codegen.sections import Tyre
from tests.evidence.exhaustive.exhaustive_helper import Facts, Helper, edges, number

AXIS = """
static const double {{ name }}_breakpoints_exact[] = { {{ breakpoints | join(", ") }} };
static double {{ name }}_inverse[{{ cells }}];
static uint32_t {{ name }}_cell;
static double {{ name }}_before;
static bool {{ name }}_toward_zero;

/* Cells from the first breakpoint to a value, in double precision. From cell to cell with the value, which mostly grows. */
static inline double {{ name }}_exact(double value)
{
    const double *const at = {{ name }}_breakpoints_exact;
    double share;

    while (({{ name }}_cell + 1u < {{ cells }}u) && (value >= at[{{ name }}_cell + 1u])) {
        {{ name }}_cell++;
    }
    while (({{ name }}_cell > 0u) && (value < at[{{ name }}_cell])) {
        {{ name }}_cell--;
    }
    share = (value - at[{{ name }}_cell]) * {{ name }}_inverse[{{ name }}_cell];
    return (double){{ name }}_cell + ((share < 0.0) ? 0.0 : (share > 1.0) ? 1.0 : share);
}
"""
AXIS_START = """
    {{ name }}_cell = 0u;
    {{ name }}_before = {{ -1.0 if signed else cells + 1.0 }};
    {{ name }}_toward_zero = true;
    for (uint32_t k = 0u; k < {{ cells }}u; k++) {
        {{ name }}_inverse[k] = 1.0 / ({{ name }}_breakpoints_exact[k + 1u] - {{ name }}_breakpoints_exact[k]);
    }
"""
LOCATE = """
    {%- if signed %}
    const float value = x;
    {%- else %}
    const float value = (x < 0.0f) ? -x : x; /* as it is called */
    {%- endif %}
    const position_t position = {{ call("locate_" ~ name, **{argument: "value"}) }};
    const double place = (double)position.lower + (double)position.fraction;

    HOLDS("there is a breakpoint above", position.lower < {{ cells }}u, position.lower, {{ cells - 1 }});
    WITHIN("the fraction", position.fraction, 0.0, 1.0);
    if (is_nan(bits)) {
        SAME("NaN counts as zero", place, 0.0);
    } else {
        NEAR("where it lies between the breakpoints", place, {{ name }}_exact((double)value), {{ tolerance }});
        {%- if signed %}
        HOLDS("never back", place >= {{ name }}_before, place, {{ name }}_before);
        {%- else %}
        /* Toward zero first, then away from it. */
        {{ name }}_before = ((bits > 0x7FFFFFFFu) == {{ name }}_toward_zero) ? {{ name }}_before : place;
        {{ name }}_toward_zero = bits > 0x7FFFFFFFu;
        HOLDS("never back", {{ name }}_toward_zero ? (place <= {{ name }}_before) : (place >= {{ name }}_before),
            place, {{ name }}_before);
        {%- endif %}
        {{ name }}_before = place;
    }
"""
AXIS_EDGES = """
    for (uint32_t k = 0u; k < {{ cells }}u + 1u; k++) {
        EDGE((float){{ name }}_breakpoints_exact[k]);
    }
"""

ROAD_SETUP = "static double road_before;\n"
ROAD_OF = """
    const road_t road = {{ call("road_of", friction="x") }};
    const double cap = (double)lateral_acceleration_cap;
    const double got = (double)road.lateral_acceleration_max;

    WITHIN("from none to the map's own", got, 0.0, cap);
    if (is_nan(bits) || (order_of(bits) >= order_of(bits_of({{ friction }})))) {
        SAME("no estimate, or more than the map's friction, is the map's", got, cap);
    } else if (order_of(bits) <= 0) {
        SAME("no friction is none", got, 0.0);
    } else {
        /* Both constants are rounded down, the product to nearest. */
        NEAR("in proportion", got, cap * ((double)x / (double){{ friction }}), ((3.0 * 0x1p-23) * got) + 0x1p-149);
    }
    HOLDS("never less for more friction", (got >= road_before) | is_nan(bits), got, road_before);
    road_before = is_nan(bits) ? road_before : got;
"""
CRC_SETUP = """
static uint32_t crc32_table[256];
"""
CRC_START = """
    for (uint32_t byte = 0u; byte < 256u; byte++) {
        uint32_t crc = byte;

        for (uint32_t k = 0u; k < 8u; k++) {
            crc = (crc >> 1u) ^ (((crc & 1u) != 0u) ? 0xEDB88320u : 0u);
        }
        crc32_table[byte] = crc;
    }
"""
CRC_OF = """
    uint32_t crc = 0xFFFFFFFFu;

    for (uint32_t shift = 0u; shift < 32u; shift += 8u) {
        crc = crc32_table[(crc ^ (bits >> shift)) & 0xFFu] ^ (crc >> 8u);
    }
    SAME("CRC-32 of its four bytes, the lowest first",
        {{ call("crc_of", start="0xFFFFFFFFu", numbers="&x", count="1u") }}, crc);
"""

BETWEEN_ALL = """
    {%- for low, high in ranges %}
    SAME("{{ low }} to {{ high }}", {{ call("are_between", numbers="&x", count="1u", low=low, high=high) }},
        ((double)x >= (double){{ low }}) && ((double)x <= (double){{ high }}));
    {%- endfor %}
"""
INCREASING = """
    const float pair[] = { 0.0f, x };
    const float start[] = { x, 1.0f };

    SAME("above the one before", {{ call("are_increasing", breakpoints="pair", count="2u") }}, (double)x > 0.0);
    SAME("from zero or below", {{ call("are_increasing", breakpoints="start", count="2u") }}, (double)x <= 0.0);
"""
EVEN = """
    const float three[] = { 1.0f, x, 3.0f };

    SAME("a hundredth of a step around the middle", {{ call("are_even", breakpoints="three", cells="2u") }},
        fabs((double)x - 2.0) <= (double)0.01f);
"""

BETWEEN = """
    {%- for low, high in ranges %}
    EQUAL("{{ low }} to {{ high }}", {{ call("between", value="x", low=low, high=high) }}, held(bits, {{ low }}, {{ high }}));
    {%- endfor %}
"""
BOUNDED = """
    {%- for limit in limits %}
    EQUAL("{{ limit }}", {{ call("bounded", value="x", limit=limit) }},
        is_nan(bits) ? 0.0f : held(bits, -{{ limit }}, {{ limit }}));
    {%- endfor %}
"""
# Between numbers that share their upper 24 bits the curve is straight to 1e-10: it is worked out where those change.
CURVE_SETUP = """
static uint32_t {{ axle }}_block;
static double {{ axle }}_from;
static double {{ axle }}_value;
static double {{ axle }}_slope;

static float {{ axle }}_end;

static double {{ axle }}_curve(double x)
{
    return sin({{ shape }} * atan(x - ({{ curvature }} * (x - atan(x)))));
}

static inline double {{ axle }}_exact(uint32_t bits, float x)
{
    if ((bits >> 8u) != {{ axle }}_block) {
        const double to = (double)number_of(bits | 0xFFu);

        {{ axle }}_block = bits >> 8u;
        {{ axle }}_from = (double)number_of(bits & ~0xFFu);
        {{ axle }}_value = {{ axle }}_curve({{ axle }}_from);
        {{ axle }}_slope = ({{ axle }}_curve(to) - {{ axle }}_value) / (to - {{ axle }}_from);
    }
    return {{ axle }}_value + ({{ axle }}_slope * ((double)x - {{ axle }}_from));
}
"""
CURVE_START = """
    {{ axle }}_block = 0xFFFFFFFFu;
    {{ axle }}_end = {{ call(function, x="64.0f") }};
"""
CURVE = """
    const float got = {{ call(function, x="x") }};

    if (is_nan(bits)) {
        SAME("NaN counts as zero", got, 0.0);
    } else if (size_of(bits) > bits_of(64.0f)) {
        SAME("held beyond the table", got, (bits > 0x7FFFFFFFu) ? -{{ axle }}_end : {{ axle }}_end);
    } else {
        NEAR("the Magic Formula", got, {{ axle }}_exact(bits, x), {{ tolerance }});
        SAME("odd, to the bit", got, (bits > 0x7FFFFFFFu) ? -{{ call(function, x="-x") }} : got);
    }
"""
_STATED = re.compile(r"off by at most (\S+) in front and (\S+) at the rear")
ROUNDING = 5e-7
"""Of the curve in single precision, beside the table's own error: three roundings by 2^-24 of the place in the table, times how
steeply the curve rises over the whole of it, about two; and three of the value."""

ARRANGE = """
    const {{ p }}_dynamics_state_t state = { 0.0f, 0.0f };
    const {{ p }}_dynamics_input_t input = { .speed = x };
    float states[2];
    float inputs[4];

    {{ call("arrange", state="&state", input="&input", x="states", u="inputs") }};
    EQUAL("at least the lowest speed, NaN as the lowest", inputs[0], held(bits, {{ lowest }}, INFINITY));
"""


def helpers(facts: Facts) -> Iterator[Helper]:
    """Of the units map, reference_model and dynamics. Raises BuildError: a map of several frictions."""
    speeds, angles = breakpoints(facts.config)
    yield _axis("speed", "speed", speeds, signed=True)
    stop = facts.config.steering.front_angle_stop
    angles = np.append(angles, stop) if stop > angles[-1] * (1.0 + 1e-6) else angles
    yield _axis("front_angle", "magnitude", angles, signed=False)
    friction = number(facts.config.road.friction)
    claim = "what the road allows, in proportion to its friction"
    start = "road_before = 0.0;"
    yield Helper(
        "map", "road_of", claim, ROAD_OF, setup=ROAD_SETUP, start=start, edges=edges(friction), values={"friction": friction}
    )
    ranges = [(number(low), number(high)) for low, high in ((0.0, 10.0), (-0.5, 0.5), (0.0, 150.0))]
    at = edges(*(bound for pair in ranges for bound in pair))
    claim = "a number from the one bound to the other, NaN not"
    yield Helper("map", "are_between", claim, BETWEEN_ALL, edges=at, values={"ranges": ranges})
    yield Helper("map", "are_increasing", "from zero, each above the one before", INCREASING, edges=edges("0.0f"))
    yield Helper("map", "are_even", "a number in its even place", EVEN, edges=edges("1.99f", "2.01f"))
    yield Helper("map", "crc_of", "CRC-32 of one number", CRC_OF, setup=CRC_SETUP, start=CRC_START)
    if facts.has("reference_model"):
        yield from _reference_model(facts)
    lowest = number(SPEED_MIN)
    claim = "a speed below the lowest, or NaN, counts as the lowest"
    yield Helper("dynamics", "arrange", claim, ARRANGE, edges=edges(lowest), values={"lowest": lowest})


def _axis(name: str, argument: str, given: npt.NDArray[np.float64], signed: bool) -> Helper:
    """Breakpoints as the map is extended: from zero, up to the steering's stop. A place is as exact as the largest of the
    numbers that it is worked out from, with half a unit each of breakpoint, difference, factor and product."""
    places = sorted({0.0, *given.tolist()})
    cells = len(places) - 1
    widest = max(at / (at - before) for before, at in pairwise(places))
    values = {
        "name": name,
        "argument": argument,
        "signed": signed,
        "cells": cells,
        "breakpoints": [repr(place) for place in places],
        "tolerance": repr(2.0 * max(cells, widest) * 2.0**-23),
    }
    claim = "the cell, and the place in it, of every number: inside, never back, where it lies"
    return Helper("map", f"locate_{name}", claim, LOCATE, setup=AXIS, start=AXIS_START, edges=AXIS_EDGES, values=values)


def _reference_model(facts: Facts) -> Iterator[Helper]:
    config, inputs, actuator = facts.config, facts.config.controller.inputs, facts.config.rear_actuator
    step = number(math.radians(actuator.rate_max_deg_s) * config.controller.sampling_time_s)
    ranges = [("2.0f", number(inputs.speed_max_km_h * KM_H)), (f"-{step}", step)]
    limits = [number(actuator.angle_max), "64.0f"]
    claim = "the value within its bounds, NaN as the lower"
    at = edges(*(value for pair in ranges for value in pair))
    yield Helper("reference_model", "between", claim, BETWEEN, edges=at, values={"ranges": ranges})
    claim = "the value within its limit on both sides, NaN as zero"
    yield Helper("reference_model", "bounded", claim, BOUNDED, edges=edges(*limits), values={"limits": limits})
    stated = _STATED.search(facts.subject.files[f"include/{facts.subject.prefix}_reference_model.h"].decode("ascii"))
    if stated is None:
        raise BuildError("it no longer says how far its curves are off", where="reference_model.h")
    tyres = (("front", config.tyre.front, stated[1]), ("rear", config.tyre.rear, stated[2]))
    for axle, tyre, error in tyres:
        yield _curve(axle, tyre, float(error))


def _curve(axle: str, tyre: Tyre, error: float) -> Helper:
    function = f"@_reference_model_{axle}_curve"
    values = {
        "axle": axle,
        "function": function,
        "shape": repr(tyre.shape_factor_c),
        "curvature": repr(tyre.curvature_factor_e),
        "tolerance": repr(error + ROUNDING),
    }
    claim = "the tyre's curve within the error that the header states; odd, and held beyond its table"
    return Helper(
        "reference_model", function, claim, CURVE, setup=CURVE_SETUP, start=CURVE_START, edges=edges("64.0f"), values=values
    )
