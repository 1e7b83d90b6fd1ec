"""Frames in Python and in C: cantools with the generated DBC is the oracle for both."""

import dataclasses
import functools
import math
from collections.abc import Iterator
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen import configuration
from codegen.configuration.can import RealSignal
from hil_sim.codec import PAYLOADS, Codec, Payload
from tests import builds

OTHER = {
    # Motorola byte order, odd lengths, offsets of both signs, factors with a fractional inverse or of all digits, other
    # identifiers.
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
        "lateral_acceleration": {"name": "Ay", "start_bit": 46, "length": 14, "factor": 0.003, "offset": 0.2},
    },
    "rear_steer_command": {
        "id": 0x3A5,
        "byte_order": "motorola",
        "status": {"name": "State", "start_bit": 14, "length": 3},
        "rear_angle": {"name": "DrCmd", "start_bit": 23, "length": 15, "factor": 7e-6},
        "yaw_rate_reference": {"name": "RRef", "start_bit": 24, "length": 17, "factor": math.radians(0.0035), "offset": 1.0},
        "diagnostics": {"name": "Causes", "start_bit": 55, "length": 16},
    },
}


class Variant:
    """A message of a configuration in three implementations: Python's codec, the generated C, and cantools on the generated
    DBC."""

    def __init__(self, spec: str, role: str) -> None:
        config, self.real = builds.CONFIG, np.float32
        built = builds.paper()
        if spec == "other":
            tables = config.model_dump(mode="json")
            for changed, changes in OTHER.items():
                tables["can"][changed] |= changes
            config, self.real = configuration.parse(tables, "other"), np.float64
            built = builds.make(builds.paper_map(), config, "double")
        self.role, self.payload, self.software = role, PAYLOADS[role], built.software
        self.codec = Codec(config.can, self.software.precision)
        self.message = config.can.messages()[role]
        self.signals = self.message.signals()
        self.fields = [name for name in self.signals if name != "qualifier"]
        self.reals = {name: signal for name, signal in self.signals.items() if isinstance(signal, RealSignal)}
        database = cantools.database.load_string(built.folder.files["ars.dbc"].decode("ascii"), "dbc", strict=True)
        self.known = database.get_message_by_name(self.message.name)
        self.protection = {self.message.crc_name: 0, self.message.counter_name: 0}

    def oracle_encode(self, payload: Payload) -> bytes:
        """Return cantools' bytes. The DBC lacks limits, "not available" and qualifier: they are set here."""
        codes: dict[str, Any] = dict(self.protection)
        available = {name: not math.isnan(getattr(payload, name)) for name in self.reals}
        for name, signal in self.signals.items():
            if name == "qualifier":
                codes[signal.name] = sum(1 << bit for bit, given in enumerate(available.values()) if given)
            elif name not in self.reals:
                codes[signal.name] = int(getattr(payload, name))
            elif available[name]:
                value = min(max(getattr(payload, name), -1e9), 1e9)
                scaled = self.known.get_signal_by_name(signal.name).scaled_to_raw(value)
                codes[signal.name] = min(max(int(scaled), signal.raw_low), signal.raw_high)
            else:
                codes[signal.name] = signal.raw_not_available
        return self.known.encode(codes, scaling=False, strict=True)

    def oracle_decode(self, data: bytes) -> dict[str, float]:
        """Return cantools' values by field name."""
        codes = self.known.decode(data, decode_choices=False, scaling=False)
        values = self.known.decode(data, decode_choices=False)
        fields = {name: float(values[signal.name]) for name, signal in self.signals.items()}
        qualifier = int(fields.pop("qualifier", 7.0))
        for bit, (name, signal) in enumerate(self.reals.items()):
            if codes[signal.name] == signal.raw_not_available or not qualifier >> bit & 1:
                fields[name] = math.nan
        return fields

    def c_encode(self, payload: Payload) -> bytes:
        struct, data = self.software.new(self.role), self.software.ffi.new("uint8_t[8]", bytes([0xFF] * 8))
        for name in self.fields:
            setattr(struct, name, getattr(payload, name))
        self.software.function(f"can_pack_{self.role}")(struct, data)
        return bytes(data)

    def c_decode(self, data: bytes) -> Payload:
        struct = self.software.new(self.role)
        self.software.function(f"can_unpack_{self.role}")(data, struct)
        return self.payload(**{name: getattr(struct, name) for name in self.fields})

    def check_encoding(self, payload: Payload) -> None:
        assert self.codec.encode(payload) == self.c_encode(payload) == self.oracle_encode(payload), payload

    def edges(self, signal: RealSignal) -> Iterator[float]:
        """Yield limits, halves next to them, small codes, exact and other ties, their neighbours, and special values."""
        limits = np.finfo(self.real)
        yield from (math.nan, math.inf, -math.inf, 0.0, -0.0)
        yield from (float(limits.smallest_subnormal), -float(limits.tiny), float(limits.max))
        low, high = signal.raw_low, signal.raw_high
        # 12.5 and 37.5 steps of 0.005 m/s are exact in binary.
        codes = [
            code + part for code in (low, low + 1, *range(-3, 4), 1234, high // 2, high - 1, high) for part in (-0.5, 0, 0.5)
        ]
        ties = [code + 0.5 for code in (12, 37, -13, -38, *range(low, high, max((high - low) // 100, 1) | 1))]
        for code in (low - 1, high + 1, *codes, *ties):
            middle = self.real(code * signal.factor + signal.offset)
            for toward in (middle, -np.inf, np.inf):
                yield float(np.nextafter(middle, self.real(toward)))


def each_message(test: Any) -> Any:
    """Run a test for each message of the preset (single precision) and of OTHER (double precision)."""
    return pytest.mark.parametrize("role", PAYLOADS)(pytest.mark.parametrize("spec", ["preset", "other"])(test))


variant = functools.cache(Variant)


# Rounding of the arithmetic never changes a code. In double precision it equals that of cantools, step by step. In
# single precision the preset's product is exact, because it has no offset and its factors' inverses are integers.
@each_message
def test_edge_values_are_encoded_like_the_oracle(spec: str, role: str) -> None:
    one = variant(spec, role)
    nothing = one.payload(**dict.fromkeys(one.reals, math.nan))
    for name, signal in one.reals.items():
        for value in one.edges(signal):
            one.check_encoding(dataclasses.replace(nothing, **{name: value}))


@each_message
@given(frame=st.binary(min_size=8, max_size=8))
def test_random_frames_are_decoded_like_the_oracle_and_encode_back(spec: str, role: str, frame: bytes) -> None:
    one = variant(spec, role)
    ours = one.codec.decode(one.message.id, frame)
    assert isinstance(ours, one.payload)
    assert one.codec.decode(one.message.id, frame[:7]) is None is one.codec.decode(0x700, frame)
    assert repr(ours) == repr(one.c_decode(frame))
    for name, expected in one.oracle_decode(frame).items():
        value = float(getattr(ours, name))
        if name not in one.reals:
            assert value == expected, name
        elif spec == "preset":  # correctly rounded by both
            assert np.float32(value).tobytes() == np.float32(expected).tobytes() or math.isnan(value + expected), name
        else:  # rounded inverse, quotient and sum: a unit in the last place each
            eps = 2.0**-52
            assert value == pytest.approx(expected, rel=2 * eps, abs=2 * eps * abs(one.reals[name].offset), nan_ok=True), name
    if not any(math.isnan(getattr(ours, name)) for name in one.reals):
        codes = one.known.decode(frame, decode_choices=False, scaling=False) | one.protection
        if "qualifier" in one.signals:
            codes[one.signals["qualifier"].name] = 7
        assert one.codec.encode(ours) == one.c_encode(ours) == one.known.encode(codes, scaling=False)
