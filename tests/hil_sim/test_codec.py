"""Frames in Python and in C: cantools, reading the generated DBC, is the oracle for both."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator
from typing import Any

import cantools
import numpy as np
import pytest
from cantools.database.can import Database
from hypothesis import given
from hypothesis import strategies as st

from codegen import config as configuration
from codegen.can_sections import RealSignal
from codegen.config import Config
from codegen.emit.text import Precision
from hil_sim.codec import PAYLOADS, Codec, Payload, RearSteerCommand, VehicleConditions, VehicleMotion
from tests import builds

OTHER = {
    # Motorola byte order, odd lengths, offsets of both signs, factors whose inverse is no whole number, other identifiers.
    "vehicle_motion": {
        "name": "Motion2",
        "id": 0x7FF,
        "data_id": 0xBEEF,
        "byte_order": "motorola",
        "qualifier": {"name": "Valid", "start_bit": 15, "length": 4},
        "speed": {"name": "V", "start_bit": 23, "length": 13, "factor": 0.03},
        "front_angle": {"name": "Df", "start_bit": 26, "length": 17, "factor": 1.25e-5, "offset": 0.01},
        "yaw_rate": {"name": "R", "start_bit": 41, "length": 12, "factor": 0.002, "offset": -3.5, "signed": False},
    },
    "vehicle_conditions": {
        "id": 0x000,
        "data_id": 1,
        "inhibit": {"name": "Esc", "start_bit": 63, "length": 1},
        "rear_angle": {"name": "Dr", "start_bit": 13, "length": 15, "factor": 3e-5, "offset": -0.02},
        "friction": {"name": "Mu", "start_bit": 37, "length": 9, "factor": 0.0035, "signed": False},
    },
    "rear_steer_command": {
        "id": 0x3A5,
        "byte_order": "motorola",
        "status": {"name": "State", "start_bit": 14, "length": 3},
        "rear_angle": {"name": "DrCmd", "start_bit": 23, "length": 15, "factor": 7e-6},
        "yaw_rate_reference": {"name": "RRef", "start_bit": 24, "length": 17, "factor": 6e-5, "offset": 1.0},
        "diagnostics": {"name": "Causes", "start_bit": 55, "length": 16},
    },
}
VARIANTS: list[tuple[str, Precision]] = [("preset", "single"), ("other", "double")]
variants = pytest.mark.parametrize(("spec", "precision"), VARIANTS)
HOLDS_NAN = ("inhibit", "status", "diagnostics")


@functools.cache
def config_of(spec: str) -> Config:
    if spec == "preset":
        return builds.CONFIG
    tables = builds.CONFIG.model_dump(mode="json")
    for role, changes in OTHER.items():
        tables["can"][role] |= changes
    return configuration.parse(tables, "other")


@functools.cache
def built(spec: str, precision: Precision) -> builds.Built:
    return builds.paper(precision) if spec == "preset" else builds.make(builds.paper_map(), config_of(spec), precision)


@functools.cache
def database(spec: str) -> Database:
    text = built(*next(variant for variant in VARIANTS if variant[0] == spec)).folder.files["ars.dbc"].decode("ascii")
    read = cantools.database.load_string(text, database_format="dbc", strict=True)
    assert isinstance(read, Database)
    return read


def reals(spec: str, role: str) -> dict[str, RealSignal]:
    signals = config_of(spec).can.messages()[role].signals()
    return {name: signal for name, signal in signals.items() if isinstance(signal, RealSignal)}


def oracle_encode(spec: str, role: str, payload: Payload) -> bytes:
    """Bytes by cantools. The DBC has no limits, "not available" and qualifier: they are set here."""
    message = config_of(spec).can.messages()[role]
    codes: dict[str, int | float] = {message.crc_name: 0, message.counter_name: 0}
    known = database(spec).get_message_by_name(message.name)
    qualifier = 0
    for bit, (name, signal) in enumerate(reals(spec, role).items()):
        value = getattr(payload, name)
        if math.isnan(value):
            codes[signal.name] = signal.raw_not_available
            continue
        qualifier |= 1 << bit
        scaled = known.get_signal_by_name(signal.name).scaled_to_raw(min(max(value, -1e9), 1e9))
        codes[signal.name] = min(max(int(scaled), signal.raw_low), signal.raw_high)
    for name, signal in message.signals().items():
        if name == "qualifier":
            codes[signal.name] = qualifier
        elif name in HOLDS_NAN:
            codes[signal.name] = int(getattr(payload, name))
    return bytes(known.encode(codes, scaling=False, strict=True))


def oracle_decode(spec: str, role: str, data: bytes) -> dict[str, float]:
    """cantools' values by the names of the fields."""
    message = config_of(spec).can.messages()[role]
    known = database(spec).get_message_by_name(message.name)
    codes = known.decode(data, decode_choices=False, scaling=False)
    values = known.decode(data, decode_choices=False)
    assert isinstance(codes, dict)
    assert isinstance(values, dict)
    fields = {name: float(values[signal.name]) for name, signal in message.signals().items()}  # type: ignore[arg-type]
    qualifier = int(fields.pop("qualifier", 7.0))
    for bit, (name, signal) in enumerate(reals(spec, role).items()):
        if codes[signal.name] == signal.raw_not_available or not qualifier >> bit & 1:
            fields[name] = math.nan
    return fields


def c_encode(spec: str, precision: Precision, role: str, payload: Payload) -> bytes:
    software = built(spec, precision).software
    struct, data = software.new(role), software.ffi.new("uint8_t[8]", bytes([0xFF] * 8))
    for field in dataclasses.fields(payload):
        setattr(struct, field.name, getattr(payload, field.name))
    software.function(f"can_pack_{role}")(struct, data)
    return bytes(data)


def c_decode(spec: str, precision: Precision, role: str, data: bytes) -> Payload:
    software = built(spec, precision).software
    struct = software.new(role)
    software.function(f"can_unpack_{role}")(data, struct)
    return PAYLOADS[role](**{field.name: getattr(struct, field.name) for field in dataclasses.fields(PAYLOADS[role])})


@functools.cache
def codec(spec: str = "preset", precision: Precision = "single") -> Codec:
    return Codec(config_of(spec).can, precision)


def around(value: float, precision: Precision) -> Iterator[float]:
    """A value in the precision of the build, and its neighbours there."""
    real = np.float32 if precision == "single" else np.float64
    middle = real(value)
    yield float(middle)
    for toward in (-np.inf, np.inf):
        yield float(np.nextafter(middle, real(toward)))


def edges(signal: RealSignal, precision: Precision) -> Iterator[float]:
    """Limits, halves beside them, small codes, sampled ties with their neighbours, and values that are no ordinary numbers."""
    tiny = np.finfo(np.float32 if precision == "single" else np.float64)
    yield from (math.nan, math.inf, -math.inf, 0.0, -0.0, float(tiny.smallest_subnormal), -float(tiny.tiny), float(tiny.max))
    low, high = signal.raw_low, signal.raw_high
    for code in (low, high, 0, 1, 2, 3, -1, -2, 1234, high // 2, high - 1, low + 1):
        for part in (-1.0, -0.5, 0.0, 0.5, 1.0):
            yield from around((code + part) * signal.factor + signal.offset, precision)
    for code in range(low, high, max((high - low) // 100, 1) | 1):
        yield from around((code + 0.5) * signal.factor + signal.offset, precision)


# Rounding of the arithmetic does not decide about a code: in double precision ours is that of cantools, step by step; in
# single precision the preset's product is exact, for it has no offset and its factors' inverses are whole numbers.
@pytest.mark.parametrize("role", PAYLOADS)
@variants
def test_edge_values_are_encoded_as_the_oracle_does(spec: str, precision: Precision, role: str) -> None:
    for name, signal in reals(spec, role).items():
        nothing = PAYLOADS[role](**dict.fromkeys(reals(spec, role), math.nan))
        for value in edges(signal, precision):
            payload = dataclasses.replace(nothing, **{name: value})  # type: ignore[arg-type]
            ours = codec(spec, precision).encode(payload)
            assert ours == c_encode(spec, precision, role, payload), payload
            assert ours == oracle_encode(spec, role, payload), payload


def test_a_tie_goes_to_the_even_code() -> None:
    # 0.0625 m/s is 12.5 steps of 0.005 m/s exactly, 0.1875 m/s 37.5; both neighbours have their own codes.
    single = codec()

    def code(speed: float) -> int:
        return int.from_bytes(single.encode(VehicleMotion(speed, 0.0, 0.0))[2:4], "little", signed=True)

    assert [code(value) for value in (0.0625, 0.1875, -0.0625, -0.1875)] == [12, 38, -12, -38]
    assert [code(value) for value in around(0.0625, "single")] == [12, 12, 13]
    assert [code(value) for value in around(0.1875, "single")] == [38, 37, 38]


VALUES = st.one_of(st.floats(-300.0, 300.0), st.floats(-3.0, 3.0), st.floats(width=32))


@variants
@given(st.data())
def test_random_values_are_encoded_as_the_oracle_does(spec: str, precision: Precision, data: st.DataObject) -> None:
    role = data.draw(st.sampled_from(sorted(PAYLOADS)))
    drawn = {name: data.draw(VALUES) for name in reals(spec, role)}
    values = {name: float(np.float32(value)) if precision == "single" else value for name, value in drawn.items()}
    others: dict[str, Any] = {}
    if role == "vehicle_conditions":
        others = {"inhibit": data.draw(st.booleans())}
    elif role == "rear_steer_command":
        others = {"status": data.draw(st.integers(0, 7)), "diagnostics": data.draw(st.integers(0, 0xFFFF))}
    payload = PAYLOADS[role](**values, **others)
    ours = codec(spec, precision).encode(payload)
    assert ours == c_encode(spec, precision, role, payload) == oracle_encode(spec, role, payload)


@variants
@given(st.data())
def test_random_frames_are_decoded_as_the_oracle_does(spec: str, precision: Precision, data: st.DataObject) -> None:
    role = data.draw(st.sampled_from(sorted(PAYLOADS)))
    frame = data.draw(st.binary(min_size=8, max_size=8))
    ours = codec(spec, precision).decode(config_of(spec).can.messages()[role].id, frame)
    assert isinstance(ours, PAYLOADS[role])
    assert repr(ours) == repr(c_decode(spec, precision, role, frame))
    for name, expected in oracle_decode(spec, role, frame).items():
        value = float(getattr(ours, name))
        signal = reals(spec, role).get(name)
        if signal is None:
            assert value == expected, name
        elif precision == "single":  # the preset: correctly rounded by either
            assert np.float32(value).tobytes() == np.float32(expected).tobytes() or math.isnan(value + expected), name
        else:  # a rounded inverse, a quotient and a sum: a unit in the last place each
            eps = 2.0**-52
            assert value == pytest.approx(expected, rel=2 * eps, abs=2 * eps * abs(signal.offset), nan_ok=True), name


@pytest.mark.parametrize("role", PAYLOADS)
@variants
def test_every_code_comes_back_as_itself(spec: str, precision: Precision, role: str) -> None:
    message = config_of(spec).can.messages()[role]
    known, ours = database(spec).get_message_by_name(message.name), codec(spec, precision)
    longest = max(signal.length for signal in reals(spec, role).values())
    for step in range(0, 2**longest, max(2**longest // 500, 1) | 1):
        codes: dict[str, Any] = {message.crc_name: 0, message.counter_name: 0}
        for name, signal in message.signals().items():
            code = step % 2**signal.length
            if isinstance(signal, RealSignal):
                code += signal.raw_low - 1 if signal.signed else 0
            codes[signal.name] = {"qualifier": 7, "status": step % 8}.get(name, code)
        frame = bytes(known.encode(codes, scaling=False))
        payload = ours.decode(message.id, frame)
        assert payload is not None
        assert repr(payload) == repr(c_decode(spec, precision, role, frame))
        again = ours.encode(payload)
        if any(math.isnan(getattr(payload, name)) for name in reals(spec, role)) and "qualifier" in message.signals():
            continue  # its qualifier bit goes, which the frame had set
        assert again == frame
        assert c_encode(spec, precision, role, payload) == frame


def test_a_value_whose_qualifier_bit_is_zero_is_not_available() -> None:
    frame = bytearray(codec().encode(VehicleMotion(1.0, 2.0, 0.5)))
    for bit, name in enumerate(("speed", "front_angle", "yaw_rate")):
        changed = bytes(frame[:1]) + bytes((frame[1] ^ 0x10 << bit,)) + bytes(frame[2:])
        back = codec().decode(0x101, changed)
        assert back is not None
        assert [field.name for field in dataclasses.fields(back) if math.isnan(getattr(back, field.name))] == [name]
        assert repr(back) == repr(c_decode("preset", "single", "vehicle_motion", changed))


def test_the_preset_is_the_documented_table() -> None:
    # Worked out by hand from the table of the CAN interface.
    ours = codec()
    assert ours.encode(VehicleMotion(11.805, 0.07, -0.3)) == bytes.fromhex("00 70 39 09 78 05 24 fa")
    assert ours.encode(VehicleConditions(-0.02, 0.85, True)) == bytes.fromhex("00 10 70 fe 55 00 00 00")
    assert ours.encode(VehicleConditions()) == bytes.fromhex("00 00 00 80 ff 00 00 00")
    assert ours.encode(RearSteerCommand(0.01, 0.25, 4, 0xA001)) == bytes.fromhex("00 40 c8 00 e2 04 01 a0")
    assert ours.encode(RearSteerCommand(math.nan, math.nan)) == bytes.fromhex("00 00 00 80 00 80 00 00")


def test_frames_of_others_are_none() -> None:
    ours = codec()
    for identifier, length, known in ((0x100, 8, False), (0x101, 7, False), (0x101, 0, False), (0x101, 8, True)):
        assert (ours.decode(identifier, bytes(length)) is not None) == known
