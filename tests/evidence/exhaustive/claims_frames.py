"""Claims about the helpers that write and read CAN frames: codes of signals, their bits, CRC and counter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from codegen.can_sections import QUALIFIED, Message, RealSignal
from tests.evidence.exhaustive.claim import Claim, Source, number

MESSAGES = ("vehicle_motion", "vehicle_conditions", "rear_steer_command")
AROUND = 5
"""Inputs of a pack function for each code: the code's value, and the numbers around both ends of what becomes the code."""

HALVES = """
static inline bool has_half_of_the_digits(float value)
{
    const uint32_t size = size_of(bits_of(value));
    const uint32_t digits = (size >= 0x00800000u) ? ((size & 0x007FFFFFu) | 0x00800000u) : size;
    const uint32_t last = digits & (0u - digits);

    return ((digits >> 12u) < last) | (digits == 0u);
}
"""
LEADING_PART = """
    /* Beyond, no coding has a value: the product with the splitter could overflow. */
    const bool is_beyond = size_of(bits) > bits_of(0x1p100f);
    const float high = leading_part(x);
    const float low = x - high;

    HOLDS("both parts together are the number", is_beyond | (((double)high + (double)low) == (double)x), high, x);
    HOLDS("the leading part has half of the digits", is_beyond | has_half_of_the_digits(high), high, x);
    HOLDS("so has the rest", is_beyond | has_half_of_the_digits(low), low, x);
"""
TO_CODE = """
    const double product = (double)x * (double){{ steps }}; /* 24 digits times 24 fit into 53 */
    const double code = (product > {{ high }}.0) ? {{ high }}.0 : (product < {{ low }}.0) ? {{ low }}.0 : nearest(product);

    SAME("the nearest code, the even one of two", to_code(x, {{ steps }}, {{ low }}, {{ high }}, {{ absent }}),
        is_nan(bits) ? {{ absent }}.0 : code);
"""
CODE_EDGES = """
    for (int32_t code = {{ low }} - 2; code <= {{ high }} + 2; code++) {
        EDGE((float)(((double)code + 0.5) / (double){{ steps }}));
    }
"""
TO_VALUE = """
    const int32_t code = (int32_t)bits + {{ lowest }};
    const float value = to_value(code, {{ steps }}, {{ absent }});

    SAME("the number nearest to the code's value", value,
        (code == {{ absent }}) ? NAN : (float)((double)code / (double){{ steps }}));
    SAME("it comes back", to_code(value, {{ steps }}, {{ low }}, {{ high }}, {{ absent }}), code);
"""
FRAMES = """
static const uint8_t {{ name }}_bits[] = { {{ bits | join(", ") }} };

/* The signal's bits in a frame, the least significant first. */
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
    const int32_t code = ({{ signed }} && (bits >= {{ half }}u)) ? (int32_t)bits - {{ 2 * half }} : (int32_t)bits;
    uint8_t data[8] = { 0u };
    {{ p }}_{{ message }}_t signals;

    {{ name }}_put(bits, data);
    {% if qualifier is not none %}
    {{ function }}(data, &signals);
    HOLDS("a signal that does not qualify is not available", signals.{{ role }} != signals.{{ role }}, signals.{{ role }}, NAN);
    data[{{ qualifier // 8 }}] |= 1u << {{ qualifier % 8 }}u;
    {% endif %}
    {{ function }}(data, &signals);
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
    double expected;

    value = (which == 1u) ? nextafterf(value, INFINITY) : (which == 4u) ? nextafterf(value, -INFINITY) : value;
    value = (code == {{ lowest }} - 1) ? NAN : value;
    expected = nearest(((double)value - {{ offset }}) * (double){{ steps }});
    expected = (expected > {{ high }}.0) ? {{ high }}.0 : (expected < {{ low }}.0) ? {{ low }}.0 : expected;
    expected = (value != value) ? {{ absent }}.0 : expected;
    signals.{{ role }} = value;
    {{ function }}(&signals, data);
    SAME("the nearest code lies in the signal's bits",
        {{ name }}_taken(data), (uint32_t)(int32_t)expected & {{ 2 * half - 1 }}u);
    {% if qualifier is not none %}
    SAME("it qualifies unless it is NaN", (data[{{ qualifier // 8 }}] >> {{ qualifier % 8 }}u) & 1u, value == value);
    {% endif %}
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
    SAME("CRC-8 bit by bit", {{ function }}(data_id, data), crc);
"""
INCREASED = 'SAME("one more, up to 14", increased((uint8_t)bits), (bits < 14u) ? bits + 1u : bits);'
NOT_AVAILABLE = 'SAME("a quiet NaN", bits_of({{ function }}()), 0x7FC00000u);'


def claims(source: Source) -> Iterator[Claim]:
    """Claims about the units can and e2e."""
    yield Claim("can", "@_can_not_available", "NaN that no core changes", NOT_AVAILABLE, inputs=1)
    yield Claim("can", "leading_part", "splits a number into halves that multiply exactly", LEADING_PART, setup=HALVES)
    messages: dict[str, Message] = {role: getattr(source.config.can, role) for role in MESSAGES}
    codings = {}
    for role, message in messages.items():
        for name, signal in message.signals().items():
            if isinstance(signal, RealSignal):
                values = _coding(signal)
                codings[f"{values['low']} to {values['high']}, {1.0 / signal.factor:g} a unit"] = values
                yield from _frames(role, message, name, signal)
    for of, values in codings.items():
        text = "nearest code, bounded; NaN is not available"
        yield Claim("can", "to_code", text, TO_CODE, CODE_EDGES, of=of, values=values)
        text = "nearest number to a code's value, which comes back as the code"
        yield Claim("can", "to_value", text, TO_VALUE, of=of, inputs=values["codes"], values=values)
    yield Claim("e2e", "@_e2e_crc", "CRC-8 of data id and bytes 1 to 7", CRC_OF_FRAME, setup=CRC, inputs=7 * 2**16)
    yield Claim("e2e", "increased", "counts up to its limit and no further", INCREASED, inputs=2**8)


def _coding(signal: RealSignal) -> dict[str, Any]:
    steps, low, high, absent = number(1.0 / signal.factor), signal.raw_low, signal.raw_high, signal.raw_not_available
    lowest = min(low, absent)
    codes = max(high, absent) - lowest + 1
    return {"steps": steps, "low": low, "high": high, "absent": absent, "lowest": lowest, "codes": codes}


def _frames(message_role: str, message: Message, role: str, signal: RealSignal) -> Iterator[Claim]:
    qualifier = getattr(message, "qualifier", None)
    values = {
        **_coding(signal),
        "message": message_role,
        "role": role,
        "name": f"{message_role}_{role}",
        "bits": signal.bits(message.byte_order),
        "half": 2 ** (signal.length - 1),
        "signed": int(signal.signed),
        "factor": repr(signal.factor),
        "offset": repr(signal.offset),
        "around": AROUND,
        "qualifier": qualifier.bits(message.byte_order)[QUALIFIED.index(role)] if qualifier is not None else None,
    }
    for verb, text, body, inputs in (
        ("unpack", "every code of a frame gives its value", UNPACK, 2**signal.length),
        ("pack", "every code and the numbers around it have the bits of the DBC", PACK, AROUND * (values["codes"] + 2)),
    ):
        function = f"@_can_{verb}_{message_role}"
        yield Claim("can", function, text, body, setup=FRAMES, of=signal.name, inputs=inputs, values=values)
