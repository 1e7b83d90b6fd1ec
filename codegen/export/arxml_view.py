"""View model of the AUTOSAR export: records of signals, calibration data, diagnostic events.

Signals come from the frames of the DBC, parameters from those of the C, the map's tables from the manifest of the build.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from codegen.configuration import Config
from codegen.configuration.can import NODES, Message, RealSignal
from codegen.configuration.e2e_profiles import Profile
from codegen.ecu_map.storage import RAW_MAX
from codegen.emit.a2l_view import OF_THE_ANGLE
from codegen.emit.can_view import Frame, FrameSignal, HeaderField
from codegen.emit.controller_view import parameters_by_path
from codegen.emit.map_view import FRONT_ANGLE_TOP, SPEED_TOP, TABLE_RANGES
from codegen.emit.render import exact_decimal
from codegen.emit.text import KEYWORDS, Precision, digits
from codegen.errors import BuildError
from codegen.map_file.tables import ACCELERATION_STACK, FRICTION_STACK
from codegen.units import NONE, Unit, unit_of

NOT_AVAILABLE = "not available"

RESERVED_WORDS = KEYWORDS | {"asm", "false", "true", "E_NOT_OK", "E_OK", "FALSE", "NULL", "TRUE"}
"""Words that no member of a struct can have as its name in a file that includes the RTE."""

PLATFORM_TYPES = {
    "uint8": (8, "NONE"),
    "uint16": (16, "NONE"),
    "uint32": (32, "NONE"),
    "sint8": (8, "2C"),
    "sint16": (16, "2C"),
    "sint32": (32, "2C"),
    "float32": (32, "IEEE754"),
    "float64": (64, "IEEE754"),
}
"""Types of AUTOSAR_SWS_PlatformTypes: size in bits and encoding."""


@dataclass(frozen=True)
class Scale:
    """One scale of a CompuMethod: a linear range of codes, or the text of one code."""

    low: int
    high: int
    text: str = ""
    symbol: str = ""


@dataclass(frozen=True)
class SignalView:
    """A signal of a PDU.

    Attributes:
        name: short name, see `message_views`.
        start_bit, length: position as in the DBC.
        is_intel: byte order.
        type: platform type of its code.
        scales: scales of its CompuMethod.
        initial: code before the first value.
        invalid: code of "not available"; None if every code is a value.
        framed: how the adapter places the code in a frame; None for CRC and counter, which belong to the E2E protection.
    """

    name: str
    text: str
    start_bit: int
    length: int
    is_intel: bool
    type: str
    scales: tuple[Scale, ...]
    unit: Unit = NONE
    factor: str = "1"
    offset: str = "0"
    initial: int = 0
    invalid: int | None = None
    framed: FrameSignal | None = None

    @property
    def category(self) -> str:
        """Category of its CompuMethod."""
        linear, texts = (any(bool(scale.text) is is_text for scale in self.scales) for is_text in (False, True))
        return "SCALE_LINEAR_AND_TEXTTABLE" if linear and texts else "TEXTTABLE" if texts else "LINEAR"

    @property
    def initial_text(self) -> str:
        """Text of the initial code; "" if it has none."""
        return next((scale.text for scale in self.scales if scale.text and scale.low == self.initial), "")

    @property
    def low(self) -> int:
        """Smallest code."""
        return min(scale.low for scale in self.scales)

    @property
    def high(self) -> int:
        """Largest code."""
        return max(scale.high for scale in self.scales)


@dataclass(frozen=True)
class MessageView:
    """A message: `signals` are those of the PDU, `elements` those of the record that the component reads or writes."""

    frame: Frame
    signals: tuple[SignalView, ...]

    @property
    def name(self) -> str:
        """Name in the DBC."""
        return self.frame.name

    @property
    def group(self) -> str:
        """Short name of its signal group."""
        return group_name(self.frame)

    @property
    def is_received(self) -> bool:
        """Whether the controller receives it."""
        return self.frame.receiver == NODES[1]

    @property
    def elements(self) -> tuple[SignalView, ...]:
        """Signals without those of the E2E protection."""
        return tuple(signal for signal in self.signals if signal.framed is not None)


@dataclass(frozen=True)
class CalibrationView:
    """Calibration data: a value, an axis, a curve over an axis, or a table over axes (the fastest index first).

    Attributes:
        name: short name.
        member: member of the parameter struct, or the C object.
        category: VALUE, COM_AXIS, CURVE, MAP or CUBOID.
        type: platform type of a number.
        low, high: physical range.
        initial: physical values; empty where the C of the build defines them.
        fixed_points: size of a last axis whose breakpoints are constants; 0 if there is none.
        factor: physical value of a code of 1; "" for real numbers.
    """

    name: str
    member: str
    text: str
    category: str
    type: str
    shape: tuple[int, ...]
    unit: Unit
    low: str
    high: str
    initial: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    fixed_points: int = 0
    factor: str = ""

    @property
    def array(self) -> str:
        """Name of its array type; "" for a single number."""
        return "_".join((self.type.capitalize(), *map(str, self.shape))) if self.shape else ""


def group_name(frame: Frame) -> str:
    """Return the short name of a message's signal group."""
    return f"{frame.name}_Group"


def message_views(frames: Sequence[Frame], profile: Profile, taken: Iterable[str]) -> tuple[MessageView, ...]:
    """Return the views of the messages.

    Generators of COM and types use short names without their packages, so they are unique over all messages, in any letter case
    (constr_2508): those of the DBC, with the name of the message as a prefix if another message, its group or `taken` has the
    same, if C reserves it, or if it does not begin with a letter.
    """
    names = {frame.name: [*(each.name for each in frame.header), *(each.name for each in frame.signals)] for frame in frames}
    count = Counter(name.casefold() for name in itertools.chain.from_iterable(names.values()))
    reserved, found = {each.casefold() for each in (*taken, *names, *map(group_name, frames))}, []
    used = reserved | count.keys()
    for frame in frames:
        short = {}
        for name in names[frame.name]:
            short[name] = name
            is_taken = count[name.casefold()] > 1 or name.casefold() in reserved
            if is_taken or name in RESERVED_WORDS or name.startswith("_"):
                while short[name].casefold() in used:
                    short[name] = f"{frame.name}_{short[name]}"
            used.add(short[name].casefold())
        found.append(_message(frame, profile, short))
    return tuple(found)


def _message(frame: Frame, profile: Profile, short: Mapping[str, str]) -> MessageView:
    """Return the view of a message, the fields of its E2E protection first."""
    texts = (profile.crc.name, "counter", "low four bits of the high byte of the data id")
    fields = zip(frame.header, texts, strict=False)  # most profiles have no nibble
    protection = (_protection(field, short[field.name], f"{text} of the E2E protection") for field, text in fields)
    return MessageView(frame, (*protection, *(_signal(frame.layout, signal, short[signal.name]) for signal in frame.signals)))


def _protection(field: HeaderField, name: str, text: str) -> SignalView:
    place, type_ = (field.start_bit, field.length, True), _platform_type(field.length, False)
    return SignalView(name, text, *place, type_, (Scale(0, field.code_max),), initial=field.start_code)


def _signal(message: Message, signal: FrameSignal, name: str) -> SignalView:
    layout, definition = signal.layout, signal.definition
    place = (layout.start_bit, layout.length, message.byte_order == "intel")
    if isinstance(layout, RealSignal):
        missing = layout.raw_not_available
        return SignalView(
            name,
            definition.meaning,
            *place,
            _platform_type(layout.length, layout.signed),
            (Scale(layout.raw_low, layout.raw_high), Scale(missing, missing, NOT_AVAILABLE, f"{name}_NotAvailable")),
            definition.unit,
            exact_decimal(layout.factor),
            exact_decimal(layout.offset),
            signal.start_code,
            missing,
            signal,
        )
    texts = tuple(Scale(code, code, text, re.sub(r"\W", "_", f"{name}_{text}")) for code, text in enumerate(definition.values))
    scales = texts or (Scale(0, signal.mask),)
    return SignalView(name, definition.meaning, *place, _platform_type(layout.length, False), scales, framed=signal)


def _platform_type(length: int, signed: bool) -> str:
    return f"{'s' if signed else 'u'}int{next(size for size in (8, 16, 32) if length <= size)}"


def parameter_views(config: Config, precision: Precision) -> tuple[CalibrationView, ...]:
    """Return every parameter of `<prefix>_parameters_t`; an axis comes before its curves."""
    parameters, axis_of, found = parameters_by_path(config), dict[str, str](), list[CalibrationView]()
    for path, each in parameters.items():
        name = path.replace(".", "_")
        if each.increasing:
            axis_of[each.points] = name
        is_bounded = path in (f"limiter.{bounded}" for bounded in OF_THE_ANGLE)
        view = CalibrationView(
            name=name,
            member=path,
            text=each.meaning,
            category="COM_AXIS" if each.increasing else "CURVE" if each.points else "VALUE",
            type="uint16" if each.is_count else real_type(precision),
            shape=(len(each.values),) if each.points else (),
            unit=each.unit,
            low=digits(each.low, precision),
            high=digits((parameters["rear_angle_max"] if is_bounded else each).high, precision),
            initial=tuple(digits(value, precision) for value in each.values),
            axes=(axis_of[each.points],) if each.points and not each.increasing else (),
        )
        found.append(view)
    return tuple(found)


def real_type(precision: Precision) -> str:
    """Return the platform type of a real number."""
    return "float32" if precision == "single" else "float64"


def map_views(manifest: Mapping[str, Any], prefix: str, precision: Precision) -> tuple[CalibrationView, ...]:
    """Return axes and tables of the map, which the C of the build defines.

    Raises:
        BuildError: the manifest does not name the objects of the map, or the scale of raw numbers.
    """
    symbols, start = manifest["symbols"], f"{prefix}_map_"
    axes = {name: f"{start}{name}_breakpoints" for name in ("front_angle", "speed")}
    tables = {name: quantity for quantity in TABLE_RANGES if (name := f"{start}{quantity}_table") in symbols}
    scaled = all("scale" in symbols[name] or symbols[name]["type"] != "int16_t" for name in tables)
    if not (tables and scaled and symbols.keys() >= set(axes.values())):
        raise BuildError(
            "it names no tables of the map", where="manifest.json, symbols", remedy="build again with this version"
        )
    found = []
    for (quantity, name), top in zip(axes.items(), (FRONT_ANGLE_TOP, SPEED_TOP), strict=True):
        text = f"breakpoints of the map: {quantity.replace('_', ' ')}"
        found.append(_axis(name, text, symbols[name], "0.0", digits(top, precision), precision))
    for name, quantity in tables.items():
        symbol = symbols[name]
        factor = digits(symbol["scale"], precision) if "scale" in symbol else ""
        reach = RAW_MAX * symbol["scale"] if factor else float("inf")
        low, high = (max(min(bound, reach), -reach) for bound in TABLE_RANGES[quantity])
        shape = tuple(symbol["shape"])
        layers = shape[0] if len(shape) == 3 else 0
        moving = manifest["map"].get("longitudinal_accelerations")
        stack, values = (ACCELERATION_STACK, moving) if moving else (FRICTION_STACK, manifest["map"]["frictions"])
        roads = f"{'' if moving else 'road '}{stack.title} of {', '.join(f'{each:g}' for each in values)}"
        roads += f" {stack.unit}" if stack.unit else ""
        found.append(
            CalibrationView(
                name=name,
                member=name,
                text=f"reference map: {quantity.replace('_', ' ')}, at a {roads}",
                category="CUBOID" if layers else "MAP",
                type="sint16" if factor else real_type(precision),
                shape=shape,
                unit=unit_of(symbol["unit"]),
                low=digits(low, precision),
                high=digits(high, precision),
                axes=tuple(axes.values()),
                fixed_points=layers,
                factor=factor,
            )
        )
    return tuple(found)


def _axis(name: str, text: str, symbol: Mapping[str, Any], low: str, high: str, precision: Precision) -> CalibrationView:
    shape, unit = tuple(symbol["shape"]), unit_of(symbol["unit"])
    return CalibrationView(name, name, text, "COM_AXIS", real_type(precision), shape, unit, low, high)
