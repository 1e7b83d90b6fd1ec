"""Claims of the helpers that make and read CAN frames: codes of signals, where they lie, CRC and counter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from codegen.can_sections import QUALIFIED, Message, RealSignal
from tests.evidence.exhaustive.exhaustive_helper import Facts, Helper, number

MESSAGES = ("vehicle_motion", "vehicle_conditions", "rear_steer_command")
AROUND = 5
"""Inputs for each code of a signal: itself, and the numbers around both ends of what becomes it."""

LEADING_PART = """
    /* Beyond, no coding has a value: the product with the splitter could overflow. */
    if (size_of(bits) <= bits_of(0x1p100f)) {
        const float high = {{ call("leading_part", value="x") }};
        const float low = x - high;

        SAME("both parts together are the number", (double)high + (double)low, x);
        HOLDS("the leading part has half of the digits", has_half_of_the_digits(high), high, x);
        HOLDS("so has the rest", has_half_of_the_digits(low), low, x);
    }
"""
HALVES = """
static inline bool has_half_of_the_digits(float value)
{
    const uint32_t size = size_of(bits_of(value));
    const uint32_t digits = (size >= 0x00800000u) ? ((size & 0x007FFFFFu) | 0x00800000u) : size;
    const uint32_t last = digits & (0u - digits);

    return ((digits >> 12u) < last) | (digits == 0u);
}
"""

TO_CODE = """
    const double exact = (double)x * (double){{ steps }}; /* 24 digits times 24 fit into 53 */
    const double code = (exact > {{ high }}.0) ? {{ high }}.0 : (exact < {{ low }}.0) ? {{ low }}.0 : nearest(exact);

    SAME("the nearest code, the even one of two", {{ call("to_code", **arguments) }}, is_nan(bits) ? {{ absent }}.0 : code);
"""
CODE_EDGES = """
    for (int32_t code = {{ low }} - 2; code <= {{ high }} + 2; code++) {
        EDGE((float)(((double)code + 0.5) / (double){{ steps }}));
    }
"""

TO_VALUE = """
    const int32_t code = (int32_t)bits + {{ lowest }};
    const float value = {{ call("to_value", code="code", **arguments) }};

    SAME("the number nearest to the code's value",
        value, (code == {{ absent }}) ? NAN : (float)((double)code / (double){{ steps }}));
    SAME("it comes back", {{ call("to_code", value="value", **arguments) }}, code);
"""

FRAMES = """
static const uint8_t {{ name }}_bits[] = { {{ bits | join(", ") }} };

/* Bits of a frame, the least significant first. */
static uint32_t {{ name }}_taken(const uint8_t data[8])
{
    uint32_t code = 0u;

    for (uint32_t k = 0u; k < sizeof {{ name }}_bits; k++) {
        code |= (((uint32_t)data[{{ name }}_bits[k] / 8u] >> ({{ name }}_bits[k] % 8u)) & 1u) << k;
    }
    return code;
}

static void {{ name }}_put(uint32_t code, uint8_t data[8])
{
    for (uint32_t k = 0u; k < sizeof {{ name }}_bits; k++) {
        data[{{ name }}_bits[k] / 8u] |= (uint8_t)(((code >> k) & 1u) << ({{ name }}_bits[k] % 8u));
    }
}
"""
UNPACK = """
    uint8_t data[8] = { 0u };
    {{ p }}_{{ message }}_t signals;
    const int32_t code = ({{ signed }} && (bits >= {{ half }}u)) ? (int32_t)bits - {{ 2 * half }} : (int32_t)bits;

    {{ name }}_put(bits, data);
    {%- if qualifier is not none %}
    {{ call(function, data="data", signals="&signals") }};
    HOLDS("a signal that does not qualify is not available", signals.{{ role }} != signals.{{ role }}, signals.{{ role }}, NAN);
    data[{{ qualifier // 8 }}] |= 1u << {{ qualifier % 8 }}u;
    {%- endif %}
    {{ call(function, data="data", signals="&signals") }};
    SAME("the code's value", signals.{{ role }},
        (code == {{ absent }}) ? NAN : (float)(((double)code * {{ factor }}) + {{ offset }}));
"""
PACK = """
    static const double beside[{{ around }}] = { -0.5, -0.5, 0.0, 0.5, 0.5 };
    const int32_t code = (int32_t)(bits / {{ around }}u) + {{ lowest }} - 1;
    const uint32_t which = bits % {{ around }}u;
    float value = (float)((((double)code + beside[which]) * {{ factor }}) + {{ offset }});
    {{ p }}_{{ message }}_t signals = { 0 };
    uint8_t data[8];
    double nearest_code;

    value = (which == 1u) ? nextafterf(value, INFINITY) : (which == 4u) ? nextafterf(value, -INFINITY) : value;
    value = (code == {{ lowest }} - 1) ? NAN : value;
    nearest_code = nearest(((double)value - {{ offset }}) * (double){{ steps }});
    nearest_code = (nearest_code > {{ high }}.0) ? {{ high }}.0 : (nearest_code < {{ low }}.0) ? {{ low }}.0 : nearest_code;
    nearest_code = (value != value) ? {{ absent }}.0 : nearest_code;
    signals.{{ role }} = value;
    {{ call(function, data="data", signals="&signals") }};
    SAME("the nearest code lies in the signal's bits",
        {{ name }}_taken(data), (uint32_t)(int32_t)nearest_code & {{ 2 * half - 1 }}u);
    {%- if qualifier is not none %}
    SAME("it qualifies unless it is NaN", (data[{{ qualifier // 8 }}] >> {{ qualifier % 8 }}u) & 1u, value == value);
    {%- endif %}
"""

CRC = """
static uint32_t crc_by_bits(uint32_t crc, uint32_t byte)
{
    crc ^= byte;
    for (uint32_t k = 0u; k < 8u; k++) {
        crc = ((crc << 1u) ^ (((crc & 0x80u) != 0u) ? 0x1Du : 0u)) & 0xFFu;
    }
    return crc;
}
"""
CRC_OF_FRAME = """
    /* All data ids with a frame of zeros; then all values of two bytes side by side. */
    const uint32_t place = bits >> 16u;
    const uint16_t data_id = (place == 0u) ? (uint16_t)bits : 0x0123u;
    uint8_t data[8] = { 0xA5u, 0u, 0u, 0u, 0u, 0u, 0u, 0u };
    uint32_t crc = 0u;

    if (place > 0u) {
        data[place] = (uint8_t)bits;
        data[place + 1u] = (uint8_t)(bits >> 8u);
    }
    crc = crc_by_bits(crc_by_bits(crc, data_id & 0xFFu), data_id >> 8u);
    for (uint32_t k = 1u; k < 8u; k++) {
        crc = crc_by_bits(crc, data[k]);
    }
    SAME("CRC-8 bit by bit", {{ call(p ~ "_e2e_crc", data_id="data_id", data="data") }}, crc);
"""
INCREASED = """
    SAME("one more, up to 14", {{ call("increased", counter="(uint8_t)bits") }}, (bits < 14u) ? bits + 1u : bits);
"""
NOT_AVAILABLE = """
    SAME("a quiet NaN", bits_of({{ call(p ~ "_can_not_available") }}), 0x7FC00000u);
"""


def helpers(facts: Facts) -> Iterator[Helper]:
    """Of the units can and e2e."""
    yield Helper("can", "@_can_not_available", "NaN that no core changes", NOT_AVAILABLE, inputs=1)
    yield Helper("can", "leading_part", "splits a number into halves that multiply exactly", LEADING_PART, setup=HALVES)
    signals = [signal for role in MESSAGES for _, signal in _reals(getattr(facts.config.can, role))]
    for coding in {_coding(signal)["of"]: _coding(signal) for signal in signals}.values():
        yield Helper(
            "can",
            "to_code",
            "nearest code, bounded; NaN is not available",
            TO_CODE,
            edges=CODE_EDGES,
            of=coding["of"],
            values=coding,
        )
        yield Helper(
            "can",
            "to_value",
            "nearest number to a code's value, which comes back as the code",
            TO_VALUE,
            inputs=coding["codes"],
            of=coding["of"],
            values={**coding, "arguments": {key: text for key, text in coding["arguments"].items() if key != "value"}},
        )
    for role in MESSAGES:
        message: Message = getattr(facts.config.can, role)
        for signal_role, signal in _reals(message):
            yield from _frames(role, message, signal_role, signal)
    yield Helper("e2e", "@_e2e_crc", "CRC-8 of data id and bytes 1 to 7", CRC_OF_FRAME, inputs=7 * 2**16, setup=CRC)
    yield Helper("e2e", "increased", "counts up to its limit and no further", INCREASED, inputs=2**8)


def _reals(message: Message) -> list[tuple[str, RealSignal]]:
    return [(role, signal) for role, signal in message.signals().items() if isinstance(signal, RealSignal)]


def _coding(signal: RealSignal) -> dict[str, Any]:
    steps = number(1.0 / signal.factor)
    low, high, none = signal.raw_low, signal.raw_high, signal.raw_not_available
    arguments = {"value": "x", "steps": steps, "low": low, "high": high, "not_available": none}
    lowest = min(low, none)
    of = f"{low} to {high}, {1.0 / signal.factor:g} a unit"
    return {"steps": steps, "low": low, "high": high, "absent": none, "lowest": lowest, "arguments": arguments, "of": of} | {
        "codes": max(high, none) - lowest + 1
    }


def _frames(role: str, message: Message, signal_role: str, signal: RealSignal) -> Iterator[Helper]:
    qualifier = getattr(message, "qualifier", None)
    values = {
        **_coding(signal),
        "message": role,
        "role": signal_role,
        "name": f"{role}_{signal_role}",
        "bits": signal.bits(message.byte_order),
        "half": 2 ** (signal.length - 1),
        "signed": int(signal.signed),
        "factor": repr(signal.factor),
        "offset": repr(signal.offset),
        "around": AROUND,
        "qualifier": qualifier.bits(message.byte_order)[QUALIFIED.index(signal_role)] if qualifier is not None else None,
    }
    of = signal.name
    unpack, pack = f"@_can_unpack_{role}", f"@_can_pack_{role}"
    claim = "every code of a frame gives its value"
    yield Helper("can", unpack, claim, UNPACK, 2**signal.length, FRAMES, of=of, values={**values, "function": unpack})
    claim = "every code, and what lies around it, is put where the DBC says"
    inputs = AROUND * (values["codes"] + 2)
    yield Helper("can", pack, claim, PACK, inputs, of=of, values={**values, "function": pack})
