"""Claims about the helpers that write and read CAN frames: codes of signals, CRC and counter."""

from collections.abc import Iterator
from typing import Any

from codegen.configuration.can import RealSignal
from tests.evidence.exhaustive.claim import Claim, Source, number

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
ONES_OF_HALVES = """
    const uint32_t window = (bits & {{ half }}u) | ((bits >> {{ size }}u) << 16u);
    uint32_t counts = 0u;

    for (uint32_t k = 0u; k < {{ size }}u; k++) {
        counts += (window >> k) & 0x00010001u;
    }
    SAME("the ones of either half", ones_of_halves(window), counts);
"""
NOT_AVAILABLE = 'SAME("a quiet NaN", bits_of({{ function }}()), 0x7FC00000u);'


def claims(source: Source) -> Iterator[Claim]:
    """Yield claims about the units can and e2e."""
    yield Claim("can", "@_can_not_available", "a NaN that no core changes", NOT_AVAILABLE, inputs=1)
    yield Claim("can", "leading_part", "splits a number into halves that multiply exactly", LEADING_PART, setup=HALVES)
    can = source.config.can
    messages = (can.vehicle_motion, can.vehicle_conditions, can.rear_steer_command)
    signals = [signal for message in messages for signal in message.signals().values() if isinstance(signal, RealSignal)]
    codings: dict[str, dict[str, Any]] = {}
    for signal in signals:
        low, high, absent = signal.raw_low, signal.raw_high, signal.raw_not_available
        values = {"steps": number(1.0 / signal.factor), "low": low, "high": high, "absent": absent, "lowest": min(low, absent)}
        codings[f"{low} to {high}, {1.0 / signal.factor:g} a unit"] = values
    for of, values in codings.items():
        text = "returns the nearest code, bounded; NaN becomes not available"
        yield Claim("can", "to_code", text, TO_CODE, CODE_EDGES, of=of, values=values)
        text = "returns the number nearest to a code's value, which encodes to the same code"
        count = max(values["high"], values["absent"]) - values["lowest"] + 1
        yield Claim("can", "to_value", text, TO_VALUE, of=of, inputs=count, values=values)
    yield Claim("e2e", "@_e2e_crc", "CRC-8 of data id and bytes 1 to 7", CRC_OF_FRAME, setup=CRC, inputs=7 * 2**16)
    yield Claim("e2e", "increased", "counts up to its limit and stays there", INCREASED, inputs=2**8)
    size = can.e2e.window_size
    values = {"size": size, "half": (1 << size) - 1}
    text = "counts the ones in each half of a window"
    yield Claim("e2e", "ones_of_halves", text, ONES_OF_HALVES, inputs=2 ** (2 * size), values=values)
