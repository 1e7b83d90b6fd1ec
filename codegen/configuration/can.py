"""The tables `[can]` of `ars.toml`: frames, signals, identifiers and scaling, from which the DBC and both codecs are made.

The quantities are fixed; the user configures their position in a frame and their scaling. Bit numbers are
those of a DBC: for Intel byte order the start bit is that of the least significant bit, for Motorola that of the most
significant one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from codegen.configuration.e2e_profiles import (
    DATA_ID_COUNT,
    DEFAULT_PROFILE,
    PROFILES,
    DataId,
    DataIdMode,
    Profile,
    ProfileName,
    shared_counters,
)
from codegen.configuration.section import Meaning, Range, Section
from codegen.configuration.signals import MEASURED, SignalDefinition, signals_of

FRAME_BYTES = 8
"""Bytes of a frame of classical CAN."""
FRAME_BYTES_MAX = 64
"""Largest frame of CAN FD, in bytes."""

QUALIFIED = tuple(each.role for each in signals_of("vehicle_motion"))
"""Signals of VehicleMotion that have a bit each in its qualifier, from bit 0."""

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,31}\Z", re.ASCII)


_RESERVED = ("VERSION", "FILTER", "VECTOR__INDEPENDENT_SIG_MSG", "Vector__XXX")
"""Reserved words of the DBC format. All its other reserved words end in an underscore."""

NODES = ("Car", "RearSteering")
"""Names of the two sending nodes in the DBC."""


def _check_dbc_name(name: str) -> str:
    if name in _RESERVED or name in NODES or name.endswith("_"):
        raise ValueError(f"{name!r} is reserved in a DBC; use another name")
    if not _NAME.match(name):
        raise ValueError(f"{name[:40]!r} is not a valid name in a DBC; use a letter, then letters, digits or '_', at most 32")
    return name


DbcName = Annotated[str, AfterValidator(_check_dbc_name)]
Identifier = Annotated[int, Field(ge=0, le=0x1FFF_FFFF)]
STANDARD_ID_MAX = 0x7FF
"""Largest identifier of 11 bits."""


class Signal(Section):
    """Position of an unsigned number in its frame."""

    name: Annotated[DbcName, Meaning("name in the DBC")]
    start_bit: Annotated[int, Field(ge=0, le=511), Meaning("start bit as in a DBC")]
    length: Annotated[int, Field(ge=1, le=24), Meaning("number of bits")]

    def bits(self, byte_order: str) -> tuple[int, ...]:
        """Bit numbers (byte * 8 + bit) from the least significant bit to the most significant one.

        Raises:
            ValueError: the signal reaches beyond the frame.
        """
        position, bits = self.start_bit, []
        for _ in range(self.length):
            bits.append(position)
            if byte_order == "intel":
                position += 1
            else:  # down to bit 0 of a byte, then to bit 7 of the next
                position += 15 if position % 8 == 0 else -1
        if max(bits) >= 8 * FRAME_BYTES_MAX:
            raise ValueError(f"{self.name} reaches beyond the {FRAME_BYTES_MAX} bytes of a frame; correct start_bit or length")
        return tuple(bits if byte_order == "intel" else reversed(bits))


class RealSignal(Signal):
    """A physical value: factor * code + offset. The lowest code (if `signed`, else the highest) means "not available"."""

    length: Annotated[int, Field(ge=2, le=24)]
    factor: Annotated[float, Range(1e-9, 1e6), Meaning("value = factor * code + offset, in the SI unit")]
    offset: Annotated[float, Range(-1e6, 1e6), Meaning("offset in the SI unit")] = 0.0
    signed: Annotated[
        bool, Meaning("whether the code is signed. The lowest signed or the highest unsigned code means “not available”")
    ] = True

    @property
    def raw_low(self) -> int:
        """Smallest code of a value."""
        return -(2 ** (self.length - 1)) + 1 if self.signed else 0

    @property
    def raw_high(self) -> int:
        """Largest code of a value."""
        return int(2 ** (self.length - 1)) - 1 if self.signed else int(2**self.length) - 2

    @property
    def raw_not_available(self) -> int:
        """The code of "not available"."""
        return self.raw_low - 1 if self.signed else self.raw_high + 1

    @property
    def physical_low(self) -> float:
        """Smallest value that can be sent, in the signal's SI unit."""
        return self.raw_low * self.factor + self.offset

    @property
    def physical_high(self) -> float:
        """Largest value that can be sent, in the signal's SI unit."""
        return self.raw_high * self.factor + self.offset


def default_layout(definition: SignalDefinition) -> Signal:
    """Return the default position of a signal in its frame."""
    place: dict[str, Any] = {"name": definition.name, "start_bit": definition.start_bit, "length": definition.length}
    if definition.factor is None:
        return Signal(**place)
    return RealSignal(**place, factor=definition.factor, signed=definition.signed)


class Message(Section):
    """A frame, sent in every sampling time and protected by an AUTOSAR E2E profile.

    A subclass names its role in the table of signals, such as `role="vehicle_motion"`, and gets a field for each signal of it.
    """

    _role: ClassVar[str]
    name: Annotated[DbcName, Meaning("name in the DBC")]
    id: Annotated[Identifier, Meaning("also the data id of the protection, unless data_id is given")]
    cycle_time_ms: Annotated[
        Annotated[float, Range(1.0, 100.0, "ms")] | None, Meaning("must equal `controller.sampling_time_s`")
    ] = None
    data_id: Annotated[
        Annotated[int, Field(ge=0, le=0xFFFF)] | None,
        Meaning("data id of the E2E protection, by default the `id` of the message"),
    ] = None
    data_ids: Annotated[
        list[Annotated[int, Field(ge=0, le=0xFF)]] | None,
        Meaning("list of the 16 data ids of E2E profile 2, one for each counter; other profiles have `data_id`"),
    ] = Field(default=None, exclude_if=lambda ids: ids is None)
    byte_order: Annotated[Literal["intel", "motorola"], Meaning("byte order of the signals")] = "intel"
    crc_name: Annotated[DbcName, Meaning("name in the DBC of the CRC")]
    counter_name: Annotated[DbcName, Meaning("name in the DBC of the counter")]
    nibble_name: Annotated[
        DbcName, Meaning("name in the DBC of the four bits of the data id that a frame of profile 1C or 11C carries")
    ]

    @property
    def e2e_data_id(self) -> DataId:
        """Data id of the protection, by default the CAN identifier; for profile 2 the list of data ids."""
        if self.data_ids is not None:
            return bytes(self.data_ids)
        return self.id if self.data_id is None else self.data_id

    def header(self, profile: Profile) -> tuple[tuple[str, frozenset[int]], ...]:
        """Return name and bits of each field of the protection."""
        fields = ((self.crc_name, profile.crc_bits), (self.counter_name, profile.counter_bits))
        return (*fields, (self.nibble_name, profile.nibble_bits)) if profile.nibble_bits else fields

    def __init_subclass__(cls, role: str, **keywords: Any) -> None:
        """Add the fields, before pydantic collects them."""
        super().__init_subclass__(**keywords)
        for each in sorted(signals_of(role), key=lambda each: each.start_bit):
            kind, default = Signal if each.factor is None else RealSignal, default_layout(each)
            if each.is_extra:
                cls.__annotations__[each.role] = Annotated[kind | None, Meaning(each.layout_comment)]
                setattr(cls, each.role, Field(default=None, exclude_if=lambda signal: signal is None))
            else:
                cls.__annotations__[each.role] = Annotated[kind, Meaning(each.layout_comment)]
                setattr(cls, each.role, default)
        cls._role = role

    def real(self, role: str) -> RealSignal:
        """Return the scaled signal of a role."""
        found = self.signals()[role]
        assert isinstance(found, RealSignal)
        return found

    def signals(self) -> dict[str, Signal]:
        """Return the signals by their role, in the order of their fields."""
        fields = ((role, getattr(self, role)) for role in type(self).model_fields)
        return {role: value for role, value in fields if isinstance(value, Signal)}

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, data: Any) -> Any:
        """Complete a signal with its defaults."""
        if not isinstance(data, dict):
            return data
        defaults = {role: field.default for role, field in cls.model_fields.items() if isinstance(field.default, Signal)}
        defaults |= {each.role: default_layout(each) for each in signals_of(cls._role) if each.is_extra}
        given = {role: data[role] for role in defaults if isinstance(data.get(role), dict)}
        return {**data, **{role: {**defaults[role].model_dump(), **keys} for role, keys in given.items()}}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        names = [self.crc_name, self.counter_name, self.nibble_name, *(signal.name for signal in self.signals().values())]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise ValueError(f"two signals are called {twice}; rename one")
        for one, other in combinations(self._places(), 2):
            if one[1] & other[1]:
                raise ValueError(f"{one[0]} and {other[0]} share bit {min(one[1] & other[1])}; move one of them")
        return self

    def check_end(self, frame_bytes: int) -> None:
        """Check that the signals are within the frame.

        Raises:
            ValueError: one is not.
        """
        for name, bits in self._places():
            if max(bits) >= 8 * frame_bytes:
                raise ValueError(f"{name} reaches beyond the {frame_bytes} bytes of its frame; correct start_bit or length")

    def check_protection(self, profile: Profile) -> None:
        """Check that the message has the data id of a profile, and room for its header.

        Raises:
            ValueError: it has not.
        """
        if (self.data_ids is not None) != (profile.data_id_mode == "list"):
            remedy = "remove them" if self.data_ids is not None else f"give {DATA_ID_COUNT} numbers from 0 to 255"
            raise ValueError(
                f"{self.name} {'has' if self.data_ids is not None else 'needs'} data_ids with E2E {profile.title}; {remedy}"
            )
        if self.data_ids is not None and len(self.data_ids) != DATA_ID_COUNT:
            raise ValueError(f"{self.name} has {len(self.data_ids)} data_ids; give {DATA_ID_COUNT}, one for each counter")
        number = self.e2e_data_id
        if isinstance(number, int) and number > profile.data_id_max:
            raise ValueError(
                f"{self.name} has the data id 0x{number:X}; E2E {profile.title} needs a data_id up to 0x{profile.data_id_max:X}"
            )
        for name, bits in self._places():
            for field, own in self.header(profile):
                if bits & own:
                    raise ValueError(
                        f"{self.name}: {field} of E2E {profile.title} and {name} share bit {min(bits & own)}; move {name}"
                    )

    def _places(self) -> Iterator[tuple[str, frozenset[int]]]:
        for signal in self.signals().values():
            yield signal.name, frozenset(signal.bits(self.byte_order))


def _needs(signal: Signal, length: int) -> None:
    if signal.length != length:
        raise ValueError(f"{signal.name} has {signal.length} bits and needs {length}; correct its length")


def _nibble_name(default: str) -> Any:
    """Return a field that only a configuration with another name contains."""
    return Field(default=default, exclude_if=lambda name: name == default)


class VehicleMotion(Message, role="vehicle_motion"):
    """Message from the car: speed (m/s), front angle (rad, road wheel), yaw rate (rad/s).

    `qualifier` has a validity bit for each: 0 speed, 1 front angle, 2 yaw rate.
    """

    name: DbcName = "VehicleMotion"
    id: Identifier = 0x101
    crc_name: DbcName = "Motion_Crc"
    counter_name: DbcName = "Motion_Counter"
    nibble_name: DbcName = _nibble_name("Motion_DataIdNibble")
    qualifier: Annotated[Signal, Meaning("validity: bit 0 speed, bit 1 front angle, bit 2 yaw rate")] = Signal(
        name="Motion_Qualifier", start_bit=12, length=4
    )

    @model_validator(mode="after")
    def _wide_enough(self) -> Self:
        if self.qualifier.length < 3:
            raise ValueError(f"{self.qualifier.name} needs at least 3 bits; it has {self.qualifier.length}")
        return self


class VehicleConditions(Message, role="vehicle_conditions"):
    """Message from the car: whether ESC or ABS is acting, achieved rear angle (rad), estimated peak friction, lateral
    acceleration (m/s^2)."""

    name: DbcName = "VehicleConditions"
    id: Identifier = 0x102
    crc_name: DbcName = "Conditions_Crc"
    counter_name: DbcName = "Conditions_Counter"
    nibble_name: DbcName = _nibble_name("Conditions_DataIdNibble")

    @model_validator(mode="after")
    def _one_bit(self) -> Self:
        for each in signals_of("vehicle_conditions"):
            if each.is_flag:
                _needs(self.signals()[each.role], 1)
        return self


class RearSteerCommand(Message, role="rear_steer_command"):
    """Message from the controller: status, rear angle (rad), reference yaw rate (rad/s), and a bit for each diagnosed cause."""

    name: DbcName = "RearSteerCommand"
    id: Identifier = 0x201
    crc_name: DbcName = "Command_Crc"
    counter_name: DbcName = "Command_Counter"
    nibble_name: DbcName = _nibble_name("Command_DataIdNibble")

    @model_validator(mode="after")
    def _wide_enough(self) -> Self:
        signals = self.signals()
        status = signals["status"]
        if status.length < 3:
            raise ValueError(f"{status.name} needs at least 3 bits; it has {status.length}")
        _needs(signals["diagnostics"], 16)
        return self


WINDOW_SIZE_MAX = 16
"""Largest window in cycles. The generated C stores a window in half a word."""

WindowCount = Annotated[int, Field(ge=0, le=WINDOW_SIZE_MAX)]


MAX_DELTA_COUNTER = 4
"""Default step of the counter in profiles 5 and 11: three lost frames are tolerated, as by the defaults of profile 1."""


class E2e(Section):
    """Protection of the frames, and tolerances of their receivers, named as in AUTOSAR's E2E profiles and its state machine.

    The state machine counts the good frames (`min_ok_*`) and the damaged ones (`max_error_*`) of the last `window_size` cycles.
    The data of a message are used only while it is VALID.
    """

    profile: Annotated[ProfileName, Meaning("AUTOSAR E2E profile and variant: `1A`, `1B`, `1C`, `2`, `5`, `11A` or `11C`")] = (
        Field(default=DEFAULT_PROFILE.name, exclude_if=lambda name: name == DEFAULT_PROFILE.name)
    )
    max_delta_counter: Annotated[
        Annotated[int, Field(ge=1, le=14)],
        Meaning("largest step of the counter between two frames, for the profiles 5 and 11; they ignore the next three keys"),
    ] = Field(default=MAX_DELTA_COUNTER, exclude_if=lambda step: step == MAX_DELTA_COUNTER)
    max_delta_counter_init: Annotated[
        int,
        Field(ge=0, le=14),
        Meaning("largest step of the counter between two frames; more after each cycle without a frame"),
    ] = 1
    max_no_new_or_repeated_data: Annotated[
        int,
        Field(ge=0, le=14),
        Meaning("after more cycles without a new frame, the counter must be in sequence before it counts again"),
    ] = 3
    sync_counter_init: Annotated[int, Field(ge=0, le=14), Meaning("number of frames in sequence for that")] = 1
    window_size: Annotated[
        int,
        Field(ge=1, le=WINDOW_SIZE_MAX),
        Meaning("cycles that decide whether a message is valid; only valid messages are used"),
    ] = 6
    min_ok_state_init: Annotated[WindowCount, Meaning("least good cycles to become valid at first")] = 2
    max_error_state_init: Annotated[WindowCount, Meaning("most damaged cycles to become valid at first")] = 2
    min_ok_state_valid: Annotated[WindowCount, Meaning("least good cycles to stay valid")] = 2
    max_error_state_valid: Annotated[WindowCount, Meaning("most damaged cycles to stay valid")] = 3
    min_ok_state_invalid: Annotated[WindowCount, Meaning("least good cycles to become valid again")] = 3
    max_error_state_invalid: Annotated[WindowCount, Meaning("most damaged cycles to become valid again")] = 2

    @property
    def definition(self) -> Profile:
        """The profile's entry in the table."""
        return PROFILES[self.profile]

    @property
    def good_frames_min(self) -> int:
        """Least good frames in a window that make a message valid."""
        return min(self.min_ok_state_init, self.min_ok_state_invalid)

    @model_validator(mode="after")
    def _state_is_reached_and_kept(self) -> Self:
        if self.min_ok_state_valid < 1:
            raise ValueError("min_ok_state_valid is 0: a message that stops would stay valid for ever; give at least 1")
        for state in ("init", "invalid"):
            least, most = getattr(self, f"min_ok_state_{state}"), getattr(self, f"max_error_state_{state}")
            if least > self.window_size:
                raise ValueError(
                    f"min_ok_state_{state} is {least} of {self.window_size} cycles: no message would become valid; "
                    "give at most window_size"
                )
            if least < self.min_ok_state_valid:
                raise ValueError(
                    f"min_ok_state_{state} is below min_ok_state_valid: a message would alternate between valid and invalid; "
                    "give at least as much"
                )
            if most > self.max_error_state_valid:
                raise ValueError(
                    f"max_error_state_{state} is above max_error_state_valid: a message would alternate between valid and "
                    "invalid; give at most as much"
                )
        return self


_REMEDIES: dict[DataIdMode, str] = {
    "both": "change one of them",
    "alternating": "give data ids that differ in the low byte and in the high byte",
    "nibble": "change one of them",
    "list": "give lists that differ at each counter",
}
"""Change that makes two data ids distinct."""


class Can(Section):
    """The bus and its three messages."""

    bitrate_kbit_s: Annotated[
        float, Range(10.0, 1000.0, "kbit/s"), Meaning("bit rate for the setup of a real bus; `vcan` has none")
    ] = 500.0
    data_bitrate_kbit_s: Annotated[
        Annotated[float, Range(10.0, 10_000.0, "kbit/s")] | None,
        Meaning("bit rate of the data phase; makes it CAN FD with bit-rate switching. Not given: classical CAN"),
    ] = Field(default=None, exclude_if=lambda rate: rate is None)
    frame_bytes: Annotated[
        Literal[8, 12, 16, 20, 24, 32, 48, 64], Meaning("bytes of each of the three frames; more than 8 with CAN FD")
    ] = Field(default=8, exclude_if=lambda size: size == FRAME_BYTES)
    extended_ids: Annotated[
        bool,
        Meaning("whether the identifiers of the three messages have 29 bits; an identifier up to 0x7FF may have 29 bits too"),
    ] = Field(default=False, exclude_if=lambda extended: not extended)
    e2e: E2e = E2e()
    vehicle_motion: VehicleMotion = VehicleMotion()
    vehicle_conditions: VehicleConditions = VehicleConditions()
    rear_steer_command: RearSteerCommand = RearSteerCommand()

    @property
    def measured(self) -> tuple[SignalDefinition, ...]:
        """Signals from the car, in the order of the C struct."""
        return tuple(each for each in MEASURED if each.role in self.messages()[each.message].signals())

    def with_signal(self, role: str) -> Can:
        """Return the configuration with an extra signal of the car, in its default place unless it has one. Not validated."""
        definition = next(each for each in MEASURED if each.role == role)
        message = self.messages()[definition.message]
        if role in message.signals():
            return self
        changed = message.model_copy(update={role: default_layout(definition)})
        return self.model_copy(update={definition.message: changed})

    def messages(self) -> dict[str, Message]:
        """Return the messages by their role."""
        return {
            "vehicle_motion": self.vehicle_motion,
            "vehicle_conditions": self.vehicle_conditions,
            "rear_steer_command": self.rear_steer_command,
        }

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        for one, other in combinations(self.messages().values(), 2):
            if one.id == other.id:
                raise ValueError(f"{one.name} and {other.name} have the same id 0x{one.id:X}; change one")
            if one.name == other.name:
                raise ValueError(f"two messages are called {one.name}; rename one")
            if one.e2e_data_id == other.e2e_data_id:
                number = one.e2e_data_id
                what = f"data_id 0x{number:X}" if isinstance(number, int) else "data_ids"
                raise ValueError(f"{one.name} and {other.name} have the same {what}; change one")
        return self

    @property
    def is_fd(self) -> bool:
        """Whether the frames are those of CAN FD, with bit-rate switching."""
        return self.data_bitrate_kbit_s is not None

    @model_validator(mode="after")
    def _framed(self) -> Self:
        if self.frame_bytes > FRAME_BYTES and not self.is_fd:
            raise ValueError(f"frame_bytes is {self.frame_bytes} without CAN FD; give data_bitrate_kbit_s, or 8 bytes")
        profile = self.e2e.definition
        if self.frame_bytes > profile.data_bytes_max:
            what = f"frame_bytes is {self.frame_bytes}; E2E {profile.title} protects up to {profile.data_bytes_max} bytes"
            raise ValueError(f"{what}; give fewer, or another profile")
        for message in self.messages().values():
            message.check_end(self.frame_bytes)
        return self

    @model_validator(mode="after")
    def _identified(self) -> Self:
        for message in self.messages().values():
            if message.id > STANDARD_ID_MAX and not self.extended_ids:
                raise ValueError(f"{message.name} has the id 0x{message.id:X}; give at most 0x7FF, or set extended_ids = true")
        return self

    @model_validator(mode="after")
    def _protected(self) -> Self:
        for message in self.messages().values():
            message.check_protection(self.e2e.definition)
        for one, other, counters in self.shared_data_ids():
            if self.e2e.definition.data_id_mode != "list" or len(counters) >= self.e2e.good_frames_min:
                raise ValueError(self.shared_text(one, other, counters))
        return self

    def shared_data_ids(self) -> Iterator[tuple[Message, Message, tuple[int, ...]]]:
        """Yield two messages whose data ids E2E does not distinguish, and the counters of the frames that pass.

        Only lists of profile 2 may be so, at fewer counters than a message needs good frames to become valid: frames of the
        other message alone then never do. Numbers of eight bits cannot differ everywhere in the lists of all messages of a
        car, which are often given.
        """
        profile = self.e2e.definition
        for one, other in combinations(self.messages().values(), 2):
            if counters := shared_counters(profile, one.e2e_data_id, other.e2e_data_id):
                yield one, other, counters

    def shared_text(self, one: Message, other: Message, counters: tuple[int, ...]) -> str:
        """Return a message about such data ids."""
        profile = self.e2e.definition
        ids = [message.e2e_data_id for message in (one, other)]
        given = " and ".join(f"0x{number:04X}" for number in ids if isinstance(number, int))
        which = ", ".join(map(str, counters[:3])) + (", …" if len(counters) > 3 else "")
        return (
            f"frames of {one.name} pass the check of {other.name} and the other way round, at {len(counters)} of "
            f"{profile.counter_count} counters ({which}): E2E {profile.title} does not distinguish their "
            f"{f'data ids {given}' if given else 'data_ids'}; {_REMEDIES[profile.data_id_mode]}"
        )
