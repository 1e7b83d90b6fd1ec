"""View models of the CAN side: frames and their signals as byte operations, the DBC, the task, the bits of `Diagnostics`."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from itertools import groupby

from codegen.configuration import Config
from codegen.configuration.can import NODES, QUALIFIED, Can, E2e, Message, RealSignal, Signal
from codegen.configuration.e2e_profiles import Profile
from codegen.configuration.signals import PAYLOADS, SIGNALS, SignalDefinition
from codegen.emit.e2e_view import E2eView
from codegen.emit.render import decimal, exact_decimal
from codegen.emit.text import Precision, literal


@dataclass(frozen=True)
class Cause:
    """A bit of `Diagnostics`: its name and meaning in C, a few words for a table, and its debouncing by a diagnostic event
    manager.

    Attributes:
        fails_after_s: how long the cause must last until the event has failed, in s; 0: the first sample suffices.
        passes_after_s: how long it must be absent until the event has passed, in s.
    """

    bit: int
    name: str
    text: str
    words: str
    fails_after_s: float = 0.0
    passes_after_s: float = 1.0

    @property
    def mask(self) -> str:
        """The bit as a C literal."""
        return f"0x{1 << self.bit:04X}u"

    def counts(self, period: float) -> tuple[int, int]:
        """Return the counts of samples from which the event has failed and has passed, of samples every `period` s."""
        return max(round(self.fails_after_s / period), 1), -max(round(self.passes_after_s / period), 1)


_RECEPTION = (
    ("MISSING", "no frame in this cycle", "missing"),
    ("WRONG_CRC", "a frame with a wrong CRC, or without {length} bytes", "damaged"),
    ("WRONG_COUNTER", "a wrong counter, or too few valid frames since the start or a fault", "out of sequence"),
)
_OTHERS = (
    ("UNAVAILABLE", "a signal is not available, out of range or implausible, for a short time so far", "signal unavailable"),
    ("SPEED_REPLACED", "the speed is rejected: last value, then decreasing", "speed replaced"),
    ("FRONT_ANGLE_REPLACED", "the front angle is rejected: computed from the yaw rate", "front angle replaced"),
    ("YAW_RATE_REPLACED", "the yaw rate is rejected: computed from the front angle", "yaw rate replaced"),
    ("TASK_LATE", "the task is called less often than frames arrive", "task late"),
    ("INTERMITTENT", "repeated disturbances of the bus", "bus intermittent"),
    ("ACTUATOR_STUCK", "the measured rear angle does not follow the command", "actuator stuck"),
)


def causes(length: str) -> tuple[Cause, ...]:
    """Return the bits of `Diagnostics` for frames of `length` bytes, a number in words."""
    received = [
        (f"{side}_{name}", f"{title}: {text.format(length=length)}", f"{side.lower()} {words}")
        for side, title in _SIDES
        for name, text, words in _RECEPTION
    ]
    found = enumerate((*received, *_OTHERS))
    return tuple(Cause(bit, *texts, fails_after_s=0.0 if texts[0] in _DEBOUNCED else FAILS_AFTER_S) for bit, texts in found)


FAILS_AFTER_S = 0.1
"""Duration in s until an event of a single sample fails. A frame that is lost or damaged now and then is no fault."""

_DEBOUNCED = ("SPEED_REPLACED", "FRONT_ANGLE_REPLACED", "YAW_RATE_REPLACED", "TASK_LATE", "INTERMITTENT", "ACTUATOR_STUCK")
"""Causes that the generated C reports only after counting samples."""


_SIDES = (("MOTION", "VehicleMotion"), ("CONDITIONS", "VehicleConditions"))
DIAGNOSTIC_CAUSES = causes("eight")
"""Bits of `Diagnostics` in Classical CAN. The three bits of each received message are adjacent and in the same order."""


@dataclass(frozen=True)
class Piece:
    """Bits of a signal in one byte: the C expression that packs them from `code`, and the one that unpacks them."""

    byte: int
    packed: str
    unpacked: str


@dataclass(frozen=True)
class FrameSignal:
    """A signal in its frame.

    Attributes:
        definition: entry in the table of signals.
        layout: configured position in the frame.
        byte_order: byte order of the frame.
        precision: precision of the build.
    """

    definition: SignalDefinition
    layout: Signal
    byte_order: str
    precision: Precision

    @property
    def name(self) -> str:
        """Name in the DBC."""
        return self.layout.name

    @property
    def field_type(self) -> str:
        """C type of a whole number in the struct of its message; "" for a real signal or a signal that the struct omits."""
        return "" if self.definition is _QUALIFIER else self.definition.c_type

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The signal byte by byte, from its least significant bit on."""
        return _pieces(self.layout, self.byte_order)

    @property
    def mask(self) -> int:
        """All bits of the code."""
        return (1 << self.layout.length) - 1

    @property
    def start_code(self) -> int:
        """Code before the first value: "not available", or 0 for a signal without a scale."""
        return self.layout.raw_not_available if isinstance(self.layout, RealSignal) else 0

    @property
    def qualifier_bit(self) -> int:
        """Mask of the validity bit in the qualifier; 0 if there is none."""
        return 1 << QUALIFIED.index(self.definition.role) if self.definition.message == "vehicle_motion" else 0

    @property
    def sign_bit(self) -> int:
        """Mask of the sign bit in the code; 0 if there is none."""
        return 1 << (self.layout.length - 1) if isinstance(self.layout, RealSignal) and self.layout.signed else 0

    @property
    def scale(self) -> str:
        """Factor of the C, or its inverse in single precision; see `can_view`."""
        assert isinstance(self.layout, RealSignal)
        # Single precision multiplies and divides by the inverse: 200 is exact where 0.005 is not.
        return literal(1.0 / self.layout.factor if self.precision == "single" else self.layout.factor, self.precision)

    @property
    def value(self) -> str:
        """C expression of a real signal's value without its offset."""
        return f"signals->{self.definition.role}{self._offset(' - ', ' + ')}"

    @property
    def decoded(self) -> str:
        """C expression of a real signal's value from `code`, whose sign bit is inverted."""
        assert isinstance(self.layout, RealSignal)
        code = f"(int32_t)code - {self.sign_bit}" if self.sign_bit else "(int32_t)code"
        return f"to_value({code}, {self.scale}, {self.layout.raw_not_available}){self.offset}"

    @property
    def offset(self) -> str:
        """C operator and number that add the offset; empty if it is zero."""
        return self._offset(" + ", " - ")

    def _offset(self, positive: str, negative: str) -> str:
        assert isinstance(self.layout, RealSignal)
        offset = self.layout.offset
        return f"{positive if offset > 0.0 else negative}{literal(abs(offset), self.precision)}" if offset else ""

    @property
    def dbc(self) -> str:
        """The signal's line in a DBC up to its unit."""
        signal, order = self.layout, 1 if self.byte_order == "intel" else 0
        place = f"{signal.name} : {signal.start_bit}|{signal.length}@{order}"
        if not isinstance(signal, RealSignal):
            return f'{place}+ (1,0) [0|{self.mask}] ""'
        limits = f"[{decimal(signal.physical_low)}|{decimal(signal.physical_high)}]"
        sign = "-" if signal.signed else "+"
        return (
            f'{place}{sign} ({exact_decimal(signal.factor)},{exact_decimal(signal.offset)}) {limits} "{self.definition.unit}"'
        )

    @property
    def dbc_values(self) -> str:
        """The signal's value table in a DBC; empty if there is none."""
        if isinstance(self.layout, RealSignal):
            return f'{self.layout.raw_not_available} "not available"'
        return " ".join(f'{code} "{text}"' for code, text in enumerate(self.definition.values))


@dataclass(frozen=True)
class HeaderField:
    """A field of the E2E protection: CRC, counter, or the nibble of the data id.

    Attributes:
        name: name in the DBC.
        start_bit, length: position in the frame, in Intel byte order.
        code_max: largest code.
        start_code: code in a frame before the first value, which passes the check.
    """

    name: str
    start_bit: int
    length: int
    code_max: int
    start_code: int


@dataclass(frozen=True)
class Frame:
    """A message with its signals.

    Attributes:
        role: role in the configuration.
        layout: configured message.
        title: phrase for comments.
        sender, receiver: nodes of the DBC.
        header: fields of the E2E protection.
    """

    role: str
    layout: Message
    title: str
    sender: str
    receiver: str
    header: tuple[HeaderField, ...]
    signals: tuple[FrameSignal, ...]

    @property
    def name(self) -> str:
        """Name in the DBC."""
        return self.layout.name

    @property
    def data_id(self) -> int:
        """Data id in the C: that of the protection, or the number of the message's list of data ids."""
        number = self.layout.e2e_data_id
        return number if isinstance(number, int) else tuple(PAYLOADS).index(self.role)

    @property
    def data_ids(self) -> tuple[int, ...]:
        """Data ids of the protection: one, or one for each counter."""
        number = self.layout.e2e_data_id
        return tuple(number) if isinstance(number, bytes) else (number,)

    @property
    def is_qualified(self) -> bool:
        """Whether the frame has a qualifier with a validity bit for each signal."""
        return "qualifier" in self.layout.signals()

    @property
    def reals(self) -> tuple[FrameSignal, ...]:
        """The scaled signals."""
        return tuple(signal for signal in self.signals if signal.definition.is_real)


@dataclass(frozen=True)
class CanView:
    """The frames of a configuration, as the CAN templates print them.

    In single precision the arithmetic of the codes is made exact. In double precision it equals that of tools that read a DBC.
    """

    config: Config
    precision: Precision

    reception_bits = len(_RECEPTION)
    splitter = 2.0**12 + 1.0

    @property
    def settings(self) -> E2e:
        """Settings of the E2E protection."""
        return self.config.can.e2e

    @functools.cached_property
    def messages(self) -> tuple[Frame, ...]:
        """The frames."""
        return tuple(_frame(self.config.can, role, self.precision) for role in self.config.can.messages())

    @property
    def diagnostics(self) -> tuple[Cause, ...]:
        """Bits of `Diagnostics`."""
        return causes(self.e2e.length_text)

    @functools.cached_property
    def e2e(self) -> E2eView:
        """The E2E protection."""
        return _e2e_view(self.config.can)

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame."""
        return self.config.can.frame_bytes

    @property
    def is_extended(self) -> bool:
        """Whether identifiers have 29 bits."""
        return self.config.can.extended_ids

    @property
    def _period_ms(self) -> float:
        return round(self.config.controller.sampling_time_s * 1e3, 9)

    @property
    def task_period_ms(self) -> str:
        """Period of task and frames."""
        return decimal(self._period_ms)

    @property
    def window_ms(self) -> str:
        """Time of the window of the E2E state machine."""
        return decimal(self._period_ms * self.settings.window_size)

    @property
    def cycle_time_is_whole(self) -> bool:
        """Whether the period is a whole number of ms."""
        return self._period_ms == round(self._period_ms)

    @property
    def baudrate(self) -> int:
        """Bit rate in bit/s."""
        return round(self.config.can.bitrate_kbit_s * 1e3)

    @property
    def data_baudrate(self) -> int:
        """Bit rate of the data of CAN FD in bit/s; 0 for classical CAN."""
        return round((self.config.can.data_bitrate_kbit_s or 0.0) * 1e3)

    @property
    def window_mask(self) -> int:
        """Previous cycles that remain in the window, in both halves of a word."""
        return ((1 << self.settings.window_size) - 2) * 0x10001

    @property
    def count_mask(self) -> int:
        """Bits of a count of cycles in the window."""
        return (1 << self.settings.window_size.bit_length()) - 1

    @property
    def exact(self) -> bool:
        """Whether the arithmetic of the codes is exact."""
        return self.precision == "single"

    @property
    def scale(self) -> str:
        """Name of the C argument that scales."""
        return "steps" if self.exact else "factor"

    @property
    def to_code(self) -> str:
        """C operator and operand from value to code."""
        return f"{'*' if self.exact else '/'} {self.scale}"

    @property
    def to_value(self) -> str:
        """C operator and operand from code to value."""
        return f"{self.value_operator} {self.scale}"

    @property
    def value_operator(self) -> str:
        """C operator from code to value."""
        return "/" if self.exact else "*"

    @property
    def is_fd(self) -> bool:
        """Whether the frames are those of CAN FD."""
        return self.config.can.data_bitrate_kbit_s is not None

    @property
    def identifiers_text(self) -> str:
        """Kind of the identifiers, in words."""
        return f"{29 if self.is_extended else 11}-bit identifiers"

    @property
    def frames_text(self) -> str:
        """Kind of the frames, in words."""
        return (
            f"{'CAN FD' if self.is_fd else 'Classical CAN'} with {self.identifiers_text} and {self.e2e.length_text} data bytes"
        )

    @property
    def accepted_text(self) -> str:
        """Frames that the task receives, in words."""
        return f"{'CAN FD' if self.is_fd else 'classical'} data frames with {self.identifiers_text}"

    @property
    def dbc_id_flag(self) -> int:
        """Bit that marks an identifier of 29 bits in a DBC."""
        return 1 << 31 if self.is_extended else 0

    @property
    def profile(self) -> Profile:
        """E2E profile of the frames."""
        return self.e2e.profile


ANGLE_WAIT_S, WHEELS_WAIT_S = 0.1, 5.0
"""Times for which the command waits for the rear angle, and for wheels that do not follow."""


def task_name(sampling_time: float) -> str:
    """Return the name of the task's function, which contains its period (s): task_10ms, task_2500us."""
    microseconds = round(sampling_time * 1e6)
    return f"task_{microseconds // 1000}ms" if microseconds % 1000 == 0 else f"task_{microseconds}us"


@dataclass(frozen=True)
class TaskView:
    """The cyclic task: its function, and the samples in which it waits for the rear angle and for wheels that do not follow."""

    period: float

    @property
    def function(self) -> str:
        """Name of its function."""
        return task_name(self.period)

    @property
    def angle_wait_max(self) -> int:
        """Samples in which it waits for the rear angle."""
        return self._samples(ANGLE_WAIT_S)

    @property
    def wheels_wait_max(self) -> int:
        """Samples in which it waits for wheels that do not follow."""
        return self._samples(WHEELS_WAIT_S)

    @property
    def angle_wait_text(self) -> str:
        """The first of these times."""
        return f"{decimal(self.angle_wait_max * self.period * 1e3)} ms"

    @property
    def wheels_wait_text(self) -> str:
        """The second one."""
        return f"{decimal(self.wheels_wait_max * self.period)} s"

    def _samples(self, time: float) -> int:
        return max(math.floor(time / self.period + 1e-9), 1)


def task_view(config: Config) -> TaskView:
    """Return the view of the configured sampling time."""
    return TaskView(config.controller.sampling_time_s)


def _e2e_view(can: Can) -> E2eView:
    e2e, ids = can.e2e, [message.e2e_data_id for message in can.messages().values()]
    settings = f"MaxDeltaCounter {e2e.max_delta_counter}"
    if e2e.definition.has_synchronisation:
        settings = (
            f"MaxDeltaCounterInit {e2e.max_delta_counter_init}, MaxNoNewOrRepeatedData {e2e.max_no_new_or_repeated_data}, "
            f"SyncCounterInit {e2e.sync_counter_init}"
        )
    return E2eView(e2e.definition, can.frame_bytes, tuple(each for each in ids if isinstance(each, bytes)), settings)


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
    role="qualifier",
)
_DEFINITIONS = {(each.message, each.role): each for each in SIGNALS} | {("vehicle_motion", "qualifier"): _QUALIFIER}


def _frame(can: Can, role: str, precision: Precision) -> Frame:
    layout = can.messages()[role]
    signals = tuple(
        FrameSignal(_DEFINITIONS[role, name], signal, layout.byte_order, precision) for name, signal in layout.signals().items()
    )
    title, sender, receiver = _TITLES[role]
    return Frame(role, layout, title, sender, receiver, _header(can, layout, signals), signals)


def _header(can: Can, layout: Message, signals: tuple[FrameSignal, ...]) -> tuple[HeaderField, ...]:
    """Return the fields of the protection. Their start codes protect a frame of the start codes of its signals."""
    profile, data_id, data = can.e2e.definition, layout.e2e_data_id, bytearray(can.frame_bytes)
    for signal in signals:
        for place, bit in enumerate(signal.layout.bits(layout.byte_order)):
            data[bit // 8] |= (signal.start_code >> place & 1) << bit % 8
    nibble = profile.nibble(data_id)
    data[1] |= nibble << 4
    starts = (profile.crc_of(data_id, bytes(data)), 0, nibble)
    highs = (2**profile.crc.width - 1, profile.counter_max, 15)
    fields = zip(layout.header(profile), highs, starts, strict=False)  # most profiles have no nibble
    return tuple(HeaderField(name, min(bits), len(bits), high, start) for (name, bits), high, start in fields)


def _pieces(signal: Signal, byte_order: str) -> tuple[Piece, ...]:
    numbered = list(enumerate(signal.bits(byte_order)))
    pieces = []
    # From the least significant bit on, bits within a byte ascend in either byte order.
    for byte, group in groupby(numbered, key=lambda pair: pair[1] // 8):
        members = list(group)
        shift, left, mask = members[0][0], members[0][1] % 8, f"0x{(1 << len(members)) - 1:02X}u"
        packed = _shifted(f"{_shifted('code', '>>', shift)} & {mask}", "<<", left)
        unpacked = _shifted(f"{_shifted(f'(uint32_t)data[{byte}]', '>>', left)} & {mask}", "<<", shift)
        pieces.append(Piece(byte, f"(uint8_t)({packed})", unpacked))
    return tuple(pieces)


def _shifted(expression: str, operator: str, count: int) -> str:
    if count == 0:
        return expression
    return f"({expression} {operator} {count}u)" if operator == ">>" else f"({expression}) {operator} {count}u"
