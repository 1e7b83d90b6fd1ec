"""View models of the CAN side: frames and their signals as byte operations, the DBC, the task, the bits of `Diagnostics`."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.configuration.can import NODES, QUALIFIED, Can, Message, RealSignal, Signal
from codegen.configuration.signals import SIGNALS, SignalDefinition
from codegen.emit.text import Precision, lines_of, literal


@dataclass(frozen=True)
class Cause:
    """A bit of `Diagnostics`: its name and meaning in C, and a few words for a table."""

    bit: int
    name: str
    text: str
    words: str

    @property
    def mask(self) -> str:
        """As a C literal."""
        return f"0x{1 << self.bit:04X}u"


_RECEPTION = (
    ("MISSING", "no frame in this cycle", "missing"),
    ("WRONG_CRC", "a frame with a wrong CRC, or without eight bytes", "damaged"),
    ("WRONG_COUNTER", "a wrong counter, or the message has to prove itself", "out of sequence"),
)
_OTHERS = (
    ("UNAVAILABLE", "a signal is not available, out of range or impossible, for a short time so far", "signal unavailable"),
    ("SPEED_REPLACED", "the speed is not believed: held, then falling", "speed replaced"),
    ("FRONT_ANGLE_REPLACED", "the front angle is not believed: taken from the yaw rate", "front angle replaced"),
    ("YAW_RATE_REPLACED", "the yaw rate is not believed: taken from the front angle", "yaw rate replaced"),
    ("TASK_LATE", "the calls of the task stay behind the frames", "task late"),
    ("INTERMITTENT", "the bus is disturbed and comes back, again and again", "bus intermittent"),
    ("ACTUATOR_STUCK", "the measured rear angle does not follow the command", "actuator stuck"),
)


def _causes() -> tuple[Cause, ...]:
    received = [
        (f"{side}_{name}", f"{title}: {text}", f"{side.lower()} {words}")
        for side, title in _SIDES
        for name, text, words in _RECEPTION
    ]
    return tuple(Cause(bit, *told) for bit, told in enumerate((*received, *_OTHERS)))


_SIDES = (("MOTION", "VehicleMotion"), ("CONDITIONS", "VehicleConditions"))
DIAGNOSTICS = _causes()
"""Bits of `Diagnostics`, from bit 0; the three of each received message lie side by side in the same order."""


@dataclass(frozen=True)
class PieceView:
    """Neighbouring bits of a signal that share a byte: C that makes them from `code`, and C that gives them back to it."""

    byte: int
    packed: str
    unpacked: str


@dataclass(frozen=True)
class SignalView:
    """A signal as the C and the DBC print it. What does not apply is empty."""

    role: str
    real: bool
    field_type: str
    name: str
    comment: str
    unit: str
    pieces: tuple[PieceView, ...]
    mask: str
    low: int
    high: int
    not_available: int
    scale: str
    value: str
    decoded: str
    sign: str
    qualifier_bit: str
    dbc: str
    dbc_values: str


@dataclass(frozen=True)
class MessageView:
    """A frame."""

    role: str
    ROLE: str
    name: str
    sender: str
    receiver: str
    title: str
    id: str
    dbc_id: int
    data_id: str
    data_id_decimal: int
    signals: tuple[SignalView, ...]
    crc_name: str
    counter_name: str

    @property
    def qualified(self) -> bool:
        """Whether a qualifier says which signals are valid."""
        return any(signal.role == "qualifier" for signal in self.signals)

    @property
    def reals(self) -> tuple[SignalView, ...]:
        """The scaled signals."""
        return tuple(signal for signal in self.signals if signal.real)


@dataclass(frozen=True)
class CanView:
    """Everything that the templates of the CAN side print."""

    messages: tuple[MessageView, ...]
    diagnostics: tuple[Cause, ...]
    reception_bits: int
    cycle_time_ms: str
    cycle_time_is_whole: bool
    baudrate: str
    max_delta_counter_init: int
    max_no_new_or_repeated_data: int
    sync_counter_init: int
    window_size: int
    window_ms: str
    window_mask: str
    counts_mask: str
    count_mask: str
    min_ok_state_init: int
    max_error_state_init: int
    min_ok_state_valid: int
    max_error_state_valid: int
    min_ok_state_invalid: int
    max_error_state_invalid: int
    exact: bool
    scale: str
    to_code: str
    to_value: str
    splitter: str
    half: str
    nan_type: str
    nan_bits: str
    crc_table: tuple[str, ...]
    crc_sum: int


@dataclass(frozen=True)
class TaskView:
    """The cyclic task."""

    function: str


def task_name(sampling_time: float) -> str:
    """Name of the task's function after its period (s): task_10ms, task_2500us."""
    microseconds = round(sampling_time * 1e6)
    return f"task_{microseconds // 1000}ms" if microseconds % 1000 == 0 else f"task_{microseconds}us"


def task_view(config: Config) -> TaskView:
    """The view of the configured sampling time."""
    return TaskView(task_name(config.controller.sampling_time_s))


def can_view(config: Config, precision: Precision) -> CanView:
    """The view of `config.can`."""
    # In single precision the arithmetic is made exact; in double precision it is that of every tool that reads a DBC.
    exact = precision == "single"
    can, period_ms = config.can, round(config.controller.sampling_time_s * 1e3, 9)
    count_mask = (1 << can.e2e.window_size.bit_length()) - 1
    return CanView(
        messages=tuple(_message(can, role, precision) for role in can.messages()),
        diagnostics=DIAGNOSTICS,
        reception_bits=len(_RECEPTION),
        cycle_time_ms=_decimal(period_ms),
        cycle_time_is_whole=period_ms == round(period_ms),
        baudrate=_decimal(can.bitrate_kbit_s * 1e3),
        **can.e2e.model_dump(),
        window_ms=_decimal(period_ms * can.e2e.window_size),
        window_mask=f"0x{((1 << can.e2e.window_size) - 2) * 0x10001:08X}",
        counts_mask=f"0x{count_mask * 0x10001:08X}",
        count_mask=f"0x{count_mask:02X}",
        exact=exact,
        scale="steps" if exact else "factor",
        to_code="* steps" if exact else "/ factor",
        to_value="/ steps" if exact else "* factor",
        splitter=literal(2.0**12 + 1.0, precision),
        half=literal(0.5, precision),
        nan_type="uint32_t" if precision == "single" else "uint64_t",
        nan_bits="0x7FC00000u" if precision == "single" else "0x7FF8000000000000u",
        crc_table=lines_of([f"0x{_crc_of_byte(byte):02X}u" for byte in range(256)]),
        crc_sum=_crc_sum(),
    )


CRC_POLYNOMIAL = 0x1D
"""SAE J1850."""

CRC_EXAMPLE = (0x23, 0x01, 1, 0, 0, 0, 0, 0)
"""Data id, low byte first, and the bytes 1 to 6 of the frame whose byte 7 runs through all values in the self-test."""


def _crc_sum() -> int:
    crc = 0
    for byte in CRC_EXAMPLE:
        crc = _crc_of_byte(crc ^ byte)
    return sum((value + 1) * _crc_of_byte(crc ^ value) for value in range(256))


def _crc_of_byte(byte: int) -> int:
    crc = byte
    for _ in range(8):
        crc = (crc << 1) ^ (CRC_POLYNOMIAL if crc & 0x80 else 0)
        crc &= 0xFF
    return crc


_TITLES = {
    "vehicle_motion": ("what the car does", *NODES),
    "vehicle_conditions": ("what else the controller should know of the car", *NODES),
    "rear_steer_command": ("what the controller asks for", *reversed(NODES)),
}


_QUALIFIER = SignalDefinition(
    "",
    start_bit=0,
    length=0,
    meaning=", ".join(f"bit {bit} {role.replace('_', ' ')}" for bit, role in enumerate(QUALIFIED)) + ": 1 = valid",
)
_DEFINITIONS = {(each.message, each.role): each for each in SIGNALS} | {("vehicle_motion", "qualifier"): _QUALIFIER}


def _message(can: Can, role: str, precision: Precision) -> MessageView:
    message = can.messages()[role]
    title, sender, receiver = _TITLES[role]
    return MessageView(
        role=role,
        ROLE=role.upper(),
        name=message.name,
        sender=sender,
        receiver=receiver,
        title=title,
        id=f"0x{message.id:03X}",
        dbc_id=message.id,
        data_id=f"0x{message.e2e_data_id:04X}",
        data_id_decimal=message.e2e_data_id,
        signals=tuple(
            _signal(message, name, signal, _DEFINITIONS[role, name], precision) for name, signal in message.signals().items()
        ),
        crc_name=message.crc_name,
        counter_name=message.counter_name,
    )


def _signal(message: Message, role: str, signal: Signal, definition: SignalDefinition, precision: Precision) -> SignalView:
    scaled: dict[str, Any] = {
        **{"low": 0, "high": 2**signal.length - 1, "not_available": 0},
        **dict.fromkeys(("scale", "value", "decoded", "sign"), ""),
    }
    if isinstance(signal, RealSignal):
        sign = f"0x{1 << (signal.length - 1):X}u"
        # Single precision multiplies and divides by the inverse: 200 is exact where 0.005 is not.
        scale = literal(1.0 / signal.factor if precision == "single" else signal.factor, precision)
        offset = literal(abs(signal.offset), precision)
        more, less = (" + ", " - ") if signal.offset >= 0.0 else (" - ", " + ")
        code = f"(int32_t)code - {1 << (signal.length - 1)}" if signal.signed else "(int32_t)code"
        scaled = {
            "low": signal.raw_low,
            "high": signal.raw_high,
            "not_available": signal.raw_not_available,
            "value": f"signals->{role}" + (f"{less}{offset}" if signal.offset else ""),
            "scale": scale,
            "sign": sign if signal.signed else "",
            "decoded": f"to_value({code}, {scale}, {signal.raw_not_available})" + (f"{more}{offset}" if signal.offset else ""),
        }
    return SignalView(
        role=role,
        real=isinstance(signal, RealSignal),
        field_type=definition.c_type if role != "qualifier" else "",
        name=signal.name,
        comment=definition.meaning,
        unit=definition.unit,
        pieces=_pieces(signal, message.byte_order),
        mask=f"0x{(1 << signal.length) - 1:X}u",
        qualifier_bit=f"0x{1 << QUALIFIED.index(role):X}u" if "qualifier" in message.signals() and role in QUALIFIED else "",
        dbc=_dbc(message, signal, definition.unit),
        dbc_values=_dbc_values(signal, definition.values),
        **scaled,
    )


def _pieces(signal: Signal, byte_order: str) -> tuple[PieceView, ...]:
    numbered = list(enumerate(signal.bits(byte_order)))
    pieces = []
    # From the least significant bit on, bits within a byte ascend in either byte order.
    for byte, group in groupby(numbered, key=lambda pair: pair[1] // 8):
        members = list(group)
        shift, left, mask = members[0][0], members[0][1] % 8, f"0x{(1 << len(members)) - 1:02X}u"
        packed = _shifted(f"{_shifted('code', '>>', shift)} & {mask}", "<<", left)
        unpacked = _shifted(f"{_shifted(f'(uint32_t)data[{byte}]', '>>', left)} & {mask}", "<<", shift)
        pieces.append(PieceView(byte, f"(uint8_t)({packed})", unpacked))
    return tuple(pieces)


def _shifted(expression: str, operator: str, count: int) -> str:
    if count == 0:
        return expression
    return f"({expression} {operator} {count}u)" if operator == ">>" else f"({expression}) {operator} {count}u"


def _dbc(message: Message, signal: Signal, unit: str) -> str:
    """The signal's line in a DBC up to its unit."""
    order = 1 if message.byte_order == "intel" else 0
    place = f"{signal.name} : {signal.start_bit}|{signal.length}@{order}"
    if not isinstance(signal, RealSignal):
        return f'{place}+ (1,0) [0|{2**signal.length - 1}] ""'
    limits = f"[{_decimal(signal.physical_low)}|{_decimal(signal.physical_high)}]"
    sign = "-" if signal.signed else "+"
    return f'{place}{sign} ({_decimal(signal.factor)},{_decimal(signal.offset)}) {limits} "{unit}"'


def _dbc_values(signal: Signal, names: tuple[str, ...]) -> str:
    """The signal's value table in a DBC; empty where it has none."""
    if isinstance(signal, RealSignal):
        return f'{signal.raw_not_available} "not available"'
    return " ".join(f'{code} "{text}"' for code, text in enumerate(names))


def _decimal(value: float) -> str:
    """Without an exponent, which not every reader of a DBC takes; twelve digits, so that no rounding shows."""
    return np.format_float_positional(float(f"{value:.12g}"), trim="-")
