"""Claims about the helpers of map, checksum, reference model and dynamics: axes, road, CRC, tyre curves."""

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

from codegen.emit.dynamics_view import SPEED_MIN, tabulate
from codegen.errors import BuildError
from codegen.optimum.problem import breakpoints
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre
from tests.evidence.exhaustive.claim import Claim, Source, edges, number
from tests.evidence.exhaustive.claims_control import between

AXIS = """
static const double {{ function }}_at[] = { {{ at | join(", ") }} };
static axis_t {{ function }}_axis = { {{ function }}_at, {{ at | length - 1 }}u, 0u };
static double {{ function }}_before;
"""
AXIS_START = "{{ function }}_axis.cell = 0u;\n{{ function }}_before = -INFINITY;"
LOCATE = """
    const float value = {{ "(x < 0.0f) ? -x : x" if is_magnitude else "x" }}; /* as the callers pass it */
    const position_t position = {{ function }}(value);
    const double place = (double)position.lower + (double)position.fraction;
    const double along = {{ "(bits > 0x7FFFFFFFu) ? -place : place" if is_magnitude else "place" }};

    HOLDS("there is a breakpoint above", position.lower < {{ at | length - 1 }}u, position.lower, {{ at | length - 2 }});
    HOLDS("the fraction", (position.fraction >= 0.0f) & (position.fraction <= 1.0f), position.fraction, 0.5);
    if (is_nan(bits)) {
        SAME("NaN counts as zero", place, 0.0);
    } else {
        NEAR("the place between the breakpoints", place, place_on(&{{ function }}_axis, (double)value), {{ tolerance }});
        HOLDS("never back", along >= {{ function }}_before, along, {{ function }}_before);
        {{ function }}_before = along;
    }
"""
ROAD_OF = """
    const double cap = (double)ars_constants.lateral_acceleration_cap;
    const road_t road = road_of(x);
    const double got = (double)road.lateral_acceleration_max;

    HOLDS("from none to the map's own", (got >= 0.0) & (got <= cap), got, cap);
    if (is_nan(bits) || (order_of(bits) >= order_of(bits_of({{ friction }})))) {
        SAME("no estimate, or more than the map's friction, is the map's", got, cap);
    } else if (order_of(bits) <= order_of(0u)) {
        SAME("no friction is none", got, 0.0);
    } else {
        /* Both constants are rounded down, the product to nearest. */
        NEAR("in proportion", got, cap * ((double)x / (double){{ friction }}), ((3.0 * 0x1p-23) * got) + 0x1p-149);
    }
    HOLDS("never less for more friction", (got >= road_before) | is_nan(bits), got, road_before);
    road_before = is_nan(bits) ? road_before : got;
"""
CRC_START = """
    for (uint32_t byte = 0u; byte < 256u; byte++) {
        crc32_table[byte] = byte;
        for (uint32_t k = 0u; k < 8u; k++) {
            crc32_table[byte] = (crc32_table[byte] >> 1u) ^ (((crc32_table[byte] & 1u) != 0u) ? 0xEDB88320u : 0u);
        }
    }
"""
CRC_OF = """
    uint32_t crc = 0xFFFFFFFFu;

    for (uint32_t shift = 0u; shift < 32u; shift += 8u) {
        crc = crc32_table[(crc ^ (bits >> shift)) & 0xFFu] ^ (crc >> 8u);
    }
    SAME("CRC-32 of its four bytes, the lowest first", {{ function }}(0xFFFFFFFFu, x), crc);
"""
INCREASING = """
    const float pair[] = { 0.0f, x };
    const float start[] = { x, 1.0f };

    SAME("above the one before", are_increasing(pair, 2u), (double)x > 0.0);
    SAME("from zero or below", are_increasing(start, 2u), (double)x <= 0.0);
"""
EVEN = """
    const float three[] = { 1.0f, x, 3.0f };

    SAME("a hundredth of a step around the middle", are_even(three, 2u),
        fabs((double)x - 2.0) <= (double)0.01f);
"""
AT_LEAST_SLOW = """
    SAME("at least the lowest; NaN stays NaN", {{ function }}(x), is_nan(bits) ? NAN : held(bits, {{ lowest }}, INFINITY));
"""
# The exact curve is straight to 1e-10 between numbers that share their upper 24 bits.
CURVE_SETUP = """
static uint32_t {{ axle }}_block;
static double {{ axle }}_value;
static double {{ axle }}_slope;

static double {{ axle }}_formula(double x)
{
    return sin({{ shape }} * atan(x - ({{ curvature }} * (x - atan(x)))));
}

static inline double {{ axle }}_exact(uint32_t bits, float x)
{
    const double from = (double)number_of(bits & ~0xFFu);

    if ((bits >> 8u) != {{ axle }}_block) {
        const double to = (double)number_of(bits | 0xFFu);

        {{ axle }}_block = bits >> 8u;
        {{ axle }}_value = {{ axle }}_formula(from);
        {{ axle }}_slope = ({{ axle }}_formula(to) - {{ axle }}_value) / (to - from);
    }
    return {{ axle }}_value + ({{ axle }}_slope * ((double)x - from));
}
"""
CURVE_START = "{{ axle }}_block = 0xFFFFFFFFu;"
CURVE = """
    const {{ "float" if is_relaxed else "curve_t" }} got = {{ function }}(x);

    if (size_of(bits) < bits_of({{ "1e3f" if is_relaxed else "1e6f" }})) {
        const double value = {{ axle }}_exact(bits, x);
{%- if is_relaxed %}

        NEAR("the Magic Formula", got, value, {{ tolerance }});
        SAME("odd, to the bit", got, (bits > 0x7FFFFFFFu) ? -{{ function }}(-x) : got);
{%- else %}
        const double inverse = 1.0 / (fabs((double)x) + {{ compression }});

        NEAR("the Magic Formula", got.value, value, {{ tolerance }});
        NEAR("its slope, or zero where it falls", got.slope, fmax({{ axle }}_slope, 0.0), {{ slope }} * inverse * inverse);
        SAME("odd, to the bit", got.value, (bits > 0x7FFFFFFFu) ? -{{ function }}(-x).value : got.value);
{%- endif %}
    }
"""
ARRANGE = """
    const {{ p }}_dynamics_state_t state = { 0.0f, 0.0f };
    const {{ p }}_dynamics_input_t input = { .speed = x };
    float states[2];
    float inputs[4];

    arrange(&state, &input, states, inputs);
    SAME("at least the lowest speed, NaN as the lowest", inputs[0], held(bits, {{ lowest }}, INFINITY));
"""

_STATED = re.compile(r"off by at most (\S+) in front and (\S+) at the rear")
ROUNDING = 5e-7
"""Rounding error of a tyre curve in single precision, added to the error of its table.

It covers three roundings of the table position by 2^-24, multiplied by the rise of the curve over the table, about two, and
three of the value.
"""
SLOPE_ALLOWANCE = 1.1
"""Allowance for the change of f'' within a cell. A chord of width h deviates by at most h^2 f''/8 and its slope by h f''/2,
which is 4/h times that."""


def claims(source: Source) -> Iterator[Claim]:
    """Yield claims about the units map, reference_model and dynamics."""
    config = source.config
    angles = list(map(float, breakpoints(config)[1]))
    _, *speeds = source.subject.manifest["map"]["speed_m_s"]  # those of the build begin below the solved ones
    stop = config.steering.front_angle_stop
    yield _axis("locate_speed", speeds)
    yield _axis("locate_front_angle", [*angles, stop] if stop > angles[-1] * (1.0 + 1e-6) else angles, is_magnitude=True)
    values: dict[str, object] = {"friction": number(config.road.friction)}
    text = "returns the road's largest lateral acceleration, in proportion to its friction"
    setup, start = "static double road_before;", "road_before = 0.0;"
    yield Claim("map", "road_of", text, ROAD_OF, edges(number(config.road.friction)), setup, start, values=values)
    ranges = [(number(low), number(high)) for low, high in ((0.0, 10.0), (-0.5, 0.5), (0.0, 150.0))]
    yield between("map", "are_between", ranges, "&x, 1u")
    yield Claim("map", "are_increasing", "true if the numbers increase, starting at zero or below", INCREASING, edges("0.0f"))
    yield Claim("map", "are_even", "true if a number is at its even position", EVEN, edges("1.99f", "2.01f"))
    yield Claim(
        "checksum",
        "@_checksum_real",
        "CRC-32 of one number",
        CRC_OF,
        setup="static uint32_t crc32_table[256];",
        start=CRC_START,
    )
    values = {"lowest": number(SPEED_MIN)}
    text = "a speed below the lowest, or NaN, counts as the lowest"
    yield Claim("dynamics", "arrange", text, ARRANGE, edges(number(SPEED_MIN)), values=values)
    if source.path("reference_model") in source.functions:
        yield from _reference_model(source)


def _axis(function: str, given: Sequence[float], is_magnitude: bool = False) -> Claim:
    """Return the claim of a search in breakpoints from zero to the last.

    The position is as accurate as the largest number in its computation: half a unit each for breakpoint, difference, factor
    and product.
    """
    at = sorted({0.0, *given})
    largest = max(len(at) - 1.0, *(above / (above - below) for below, above in pairwise(at)))
    values = {"is_magnitude": is_magnitude, "at": [*map(repr, at)], "tolerance": repr(2.0 * largest * 2.0**-23)}
    text = "returns the correct cell and position for every number: in range and monotonic"
    return Claim("map", function, text, LOCATE, edges(*map(number, at)), AXIS, AXIS_START, values=values)


def _reference_model(source: Source) -> Iterator[Claim]:
    lowest = number(SPEED_MIN)
    text = "a speed below the lowest counts as the lowest; NaN stays NaN"
    yield Claim("reference_model", "at_least_slow", text, AT_LEAST_SLOW, edges(lowest), values={"lowest": lowest})
    stated = _STATED.search(source.subject.files[f"include/{source.subject.prefix}_reference_model.h"].decode("ascii"))
    if stated is None:
        raise BuildError("the header no longer states the error of its curves", where="reference_model.h")
    tyres = AxleTyres.from_config(source.config)
    is_relaxed = source.config.plant.relaxation_length_m > 0.0
    yield _curve("front", tyres.front, float(stated[1]), is_relaxed)
    yield _curve("rear", tyres.rear, float(stated[2]), is_relaxed)


def _curve(axle: str, tyre: MagicFormulaTyre, error: float, is_relaxed: bool) -> Claim:
    table = tabulate(tyre)
    values = {
        "is_relaxed": is_relaxed,
        "axle": axle,
        "shape": repr(tyre.shape_factor),
        "curvature": repr(tyre.curvature_factor),
        "tolerance": repr(error + ROUNDING),
        "compression": repr(table.compression),
        "slope": repr(SLOPE_ALLOWANCE * 4.0 * error * (table.values.size - 1) * table.compression),
    }
    text = f"returns the tyre curve within the error stated in the header{'' if is_relaxed else ', and its slope'}; odd"
    setup = CURVE_SETUP, CURVE_START
    return Claim("reference_model", f"{axle}_curve", text, CURVE, edges("1e6f"), *setup, values=values)
