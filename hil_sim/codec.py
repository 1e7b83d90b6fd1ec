"""Frames to signals and back in Python, from the same tables as the generated C but by other means.

A signal's code is the whole number nearest to `(value - offset) / factor`, and the even one of two that are equally near.
Beyond the limits it saturates; NaN becomes "not available". Decoding returns `code * factor + offset`. A build in single
precision multiplies with the inverse of the factor, rounded to single precision, or divides by it: 200 is exact where 0.005
is not. With this, bench and controller see the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.configuration.can import QUALIFIED, Can, RealSignal, Signal
from codegen.configuration.signals import PAYLOADS as PAYLOADS
from codegen.configuration.signals import Payload as Payload
from codegen.configuration.signals import RearSteerCommand as RearSteerCommand
from codegen.configuration.signals import VehicleConditions as VehicleConditions
from codegen.configuration.signals import VehicleMotion as VehicleMotion
from codegen.configuration.signals import signals_of
from codegen.emit import can_view
from codegen.emit.text import Precision, numpy_type


@dataclass(frozen=True)
class Frame:
    """A frame of classical CAN or CAN FD.

    Attributes:
        id: 11 or 29 bits.
        data: 0 to 8 bytes; with CAN FD up to 64.
        time: s since the start of the run; 0.0 if unknown.
        extended, remote, error: kind of the frame. Frames between controller and car are data frames; `frame_of` makes them.
        fd: whether it is a frame of CAN FD, with bit-rate switching.
    """

    id: int
    data: bytes
    time: float = 0.0
    extended: bool = False
    remote: bool = False
    error: bool = False
    fd: bool = False


def frame_of(can: Can, identifier: int, data: bytes) -> Frame:
    """Return a frame of the configured kind."""
    return Frame(identifier, data, extended=can.extended_ids, fd=can.is_fd)


def is_configured(can: Can, frame: Frame) -> bool:
    """Return whether a frame is a data frame of the configured kind."""
    return (frame.extended, frame.fd) == (can.extended_ids, can.is_fd) and not (frame.remote or frame.error)


class _Codes:
    """Whole numbers in the bits of a frame."""

    def __init__(self, signal: Signal, byte_order: str) -> None:
        # Bit b of byte B is bit 8 B + b of the frame read as one little-endian number. Neighbouring bits move together.
        self._runs: list[tuple[int, int, int]] = []  # first bit in the code, first bit in the frame, mask
        for index, bit in enumerate(signal.bits(byte_order)):
            if self._runs and bit - index == self._runs[-1][1] - self._runs[-1][0]:
                first, place, mask = self._runs.pop()
                self._runs.append((first, place, mask << 1 | 1))
            else:
                self._runs.append((index, bit, 1))
        self._sign = 1 << (signal.length - 1) if isinstance(signal, RealSignal) and signal.signed else 0

    def put(self, code: int) -> int:
        """Return the bits of a code in the frame."""
        frame = 0
        for index, bit, mask in self._runs:
            frame |= (code >> index & mask) << bit
        return frame

    def get(self, frame: int) -> int:
        """Return the code in a frame, with its sign."""
        code = 0
        for index, bit, mask in self._runs:
            code |= (frame >> bit & mask) << index
        return code - 2 * (code & self._sign)


_SINGLE_SAFE = 1e30
"""No smaller value overflows single precision, whatever the offset of its signal."""


class _Scale:
    """A physical value and its code, in the precision of a build."""

    def __init__(self, signal: RealSignal, precision: Precision) -> None:
        self._real = numpy_type(precision)
        self._single = precision == "single"
        self._factor, self._steps = signal.factor, np.float32(1.0 / signal.factor)
        self._offset = self._real(signal.offset)
        self._low, self._high = signal.raw_low, signal.raw_high
        self.not_available = signal.raw_not_available

    def code(self, value: float) -> int:
        """Return the nearest code of a value."""
        if abs(value) < _SINGLE_SAFE:
            shifted = float(self._real(value) - self._offset)
        else:
            with np.errstate(over="ignore"):  # too large for single precision: infinite, so it saturates
                shifted = float(self._real(value) - self._offset)
        # In float64 the product of two numbers of single precision is exact.
        scaled = shifted * float(self._steps) if self._single else shifted / self._factor
        if math.isnan(scaled):
            return self.not_available
        return round(min(max(scaled, self._low), self._high))

    def value(self, code: int) -> float:
        """Return the value of a code; NaN for "not available"."""
        if code == self.not_available:
            return math.nan
        scaled = np.float32(code) / self._steps if self._single else np.float64(code) * self._factor
        return float(scaled + self._offset)


class _Layout:
    """One message."""

    def __init__(self, role: str, can: Can, precision: Precision) -> None:
        message = can.messages()[role]
        self.payload = PAYLOADS[role]
        self._frame_bytes = can.frame_bytes
        self._flags = [each.role for each in signals_of(role) if each.is_flag]
        signals = message.signals()
        self._codes = {name: _Codes(signal, message.byte_order) for name, signal in signals.items()}
        self._scales = {name: _Scale(signal, precision) for name, signal in signals.items() if isinstance(signal, RealSignal)}

    def encode(self, payload: Payload) -> bytes:
        codes = {name: scale.code(getattr(payload, name)) for name, scale in self._scales.items()}
        available = [name for name in codes if codes[name] != self._scales[name].not_available]
        for name in self._codes.keys() - codes.keys():
            codes[name] = _qualifier(available) if name == "qualifier" else int(getattr(payload, name))
        return sum(self._codes[name].put(code) for name, code in codes.items()).to_bytes(self._frame_bytes, "little")

    def decode(self, data: bytes) -> Payload:
        frame = int.from_bytes(data, "little")
        values: dict[str, Any] = {name: codes.get(frame) for name, codes in self._codes.items()}
        for name, scale in self._scales.items():
            values[name] = scale.value(values[name])
        if "qualifier" in values:
            qualifier = values.pop("qualifier")
            values |= {name: math.nan for bit, name in enumerate(QUALIFIED) if not qualifier >> bit & 1}
        for name in self._flags:
            values[name] = bool(values[name])
        return self.payload(**values)


def _qualifier(available: list[str]) -> int:
    return sum(1 << bit for bit, name in enumerate(QUALIFIED) if name in available)


class Codec:
    """Codec of the messages of a configuration.

    Encoding leaves CRC and counter zero: `hil_sim.e2e.protect` writes them. Decoding ignores them.
    """

    def __init__(self, can: Can, precision: Precision = "single") -> None:
        self._layouts = {role: _Layout(role, can, precision) for role in PAYLOADS}
        self._roles = {message.id: role for role, message in can.messages().items()}
        self._frame_bytes = can.frame_bytes
        self._role_of = {payload: role for role, payload in PAYLOADS.items()}

    def encode(self, payload: Payload) -> bytes:
        """Return the bytes of a message."""
        return self._layouts[self._role_of[type(payload)]].encode(payload)

    def decode(self, identifier: int, data: bytes) -> Payload | None:
        """Return the contents of a frame by its id; None for a frame of another node or of another length."""
        role = self._roles.get(identifier)
        return None if role is None or len(data) != self._frame_bytes else self._layouts[role].decode(data)


DIAGNOSTICS: Mapping[int, tuple[str, str]] = {cause.bit: (cause.name, cause.words) for cause in can_view.DIAGNOSTIC_CAUSES}
"""Bit: name as in the generated C, and a few words."""


def causes(diagnostics: int) -> tuple[str, ...]:
    """Return the texts of the bits that are set, from the lowest; "bit 20" for one without a name."""
    bits = [bit for bit in range(diagnostics.bit_length()) if diagnostics >> bit & 1]
    return tuple(DIAGNOSTICS[bit][1] if bit in DIAGNOSTICS else f"bit {bit}" for bit in bits)
