"""View model of the A2L (ASAM MCD-2 MC, ASAP2 1.7): parameters that a calibration tool may change, and measurements.

Addresses are for `codegen a2l`, which reads them from an ELF; until then the symbol links identify each object.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

from codegen.configuration.signals import STATUSES, signals_of
from codegen.ecu_map.storage import RAW_MAX
from codegen.emit.can_view import CanView
from codegen.emit.controller_view import ControllerView
from codegen.emit.inputs_view import InputsView
from codegen.emit.limiter_view import LimiterView
from codegen.emit.map_view import MapView, TableView
from codegen.emit.parameters import Field, Parameter
from codegen.emit.supervision import Cause, State
from codegen.emit.text import Precision, digits
from codegen.units import M_S, M_S2, NONE, RAD, RAD_S, UNITS, Unit

REAL_FORMAT, COUNT_FORMAT = "%12.6", "%10.0"
REACH = {M_S: 1000.0, RAD: math.tau, RAD_S: 100.0, M_S2: 1000.0}
"""Limits of measurements by unit; 1e6 for other units."""
COUNTERS = (
    ("cycles", "calls of the task; wraps around"),
    ("late_cycles", "calls that found a message more than once"),
    ("early_cycles", "calls that found no message"),
    ("lost_samples", "calls without a good sample"),
)
CHECKED = signals_of("vehicle_motion")
"""Signals of a sample that the monitoring of the inputs checks and may replace."""
OF_THE_ANGLE = ("rear_angle_max", "opposite_phase_max")
"""Parameters of the limiter that must not exceed the controller's own bound; `..._parameters_valid` checks it."""
SUPERVISION = "supervision"
"""Member of the task with the status that is sent. A controller without a task has a status of its own."""
INSTANCE = "task"
"""Name of the task's object after the prefix; the links of the measurements begin with it."""
_BYTES = {"UBYTE": 1, "UWORD": 2, "ULONG": 4, "FLOAT32_IEEE": 4, "FLOAT64_IEEE": 8}


@dataclass(frozen=True)
class Measured:
    """A MEASUREMENT: a number that the code writes. Its type is that of the C on most targets."""

    name: str
    text: str
    type: str
    conversion: str
    low: str
    high: str
    link: str

    @property
    def bytes(self) -> int:
        """Size in memory."""
        return _BYTES[self.type]


@dataclass(frozen=True)
class AxisPoints:
    """An AXIS_PTS: breakpoints in memory. `quantity` is the measurement that is looked up on the axis."""

    name: str
    text: str
    conversion: str
    points: int
    low: str
    high: str
    quantity: str
    link: str


@dataclass(frozen=True)
class Adjustable:
    """A CHARACTERISTIC: VALUE, CURVE or MAP. Neighbouring values along the first axis of a MAP are adjacent in memory."""

    name: str
    text: str
    type: str
    record: str
    conversion: str
    low: str
    high: str
    link: str
    axes: tuple[AxisPoints, ...] = ()


@dataclass(frozen=True)
class Scale:
    """A COMPU_METHOD of raw numbers. `unit` names the COMPU_METHOD of the same quantity in physical units."""

    name: str
    factor: str
    format: str
    symbol: str
    unit: str


@dataclass(frozen=True)
class Group:
    """A GROUP: names of characteristics and axes, or of measurements."""

    name: str
    text: str
    adjustables: tuple[str, ...] = ()
    measured: tuple[str, ...] = ()


@dataclass(frozen=True)
class Enumeration:
    """A COMPU_METHOD that names the values of a whole number."""

    name: str
    text: str
    values: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class A2lView:
    """Objects and conversions of the A2L."""

    units: tuple[tuple[str, Unit], ...]
    conversions: tuple[tuple[str, Unit, str], ...]
    scales: tuple[Scale, ...]
    enumerations: tuple[Enumeration, ...]
    real: str
    measured: tuple[Measured, ...]
    axes: tuple[AxisPoints, ...]
    adjustables: tuple[Adjustable, ...]
    groups: tuple[Group, ...]


def a2l_view(
    prefix: str,
    precision: Precision,
    controller: ControllerView,
    inputs: InputsView,
    limiter: LimiterView,
    map_view: MapView,
    can: CanView,
) -> A2lView:
    """Return the view of a build: every parameter, axis and table of its calibration, and the state of the task."""
    real = "FLOAT32_IEEE" if precision == "single" else "FLOAT64_IEEE"
    lists, default = _Lists(prefix, precision, real), f"{prefix}_parameters_default"
    parameters = lists.parameters(controller.parameters, f"{prefix}.parameters", default)
    highest = next(each.high for each in controller.parameters if each.name == "rear_angle_max")
    bounded = [replace(each, high=highest) if each.name in OF_THE_ANGLE else each for each in limiter.parameters]
    monitoring = lists.parameters(inputs.parameters, f"{prefix}.inputs", f"{default}.inputs")
    limits = lists.parameters(bounded, f"{prefix}.limiter", f"{default}.limiter")
    numbers, checksum = lists.map(map_view), lists.checksum()
    measured = (*lists.state(controller), *lists.supervision(), *lists.received(can), *lists.counters())
    groups = (
        Group(f"{prefix}.parameters", "parameters of the controller", tuple(each.name for each in parameters)),
        Group(f"{prefix}.inputs", "parameters of the monitoring of the inputs", tuple(each.name for each in monitoring)),
        Group(f"{prefix}.limiter", "parameters of the safety limiter", tuple(each.name for each in limits)),
        Group(f"{prefix}.map", "reference map and its axes", tuple(each.name for each in numbers)),
        Group(f"{prefix}.calibration", "parameters, map and tyre curves together", (checksum.name,)),
        Group(
            f"{prefix}.measurements", "measurements of the task and its controller", (), tuple(each.name for each in measured)
        ),
    )
    objects: list[AxisPoints | Adjustable] = [*parameters, *monitoring, *limits, *numbers, checksum]
    axes = tuple(each for each in objects if isinstance(each, AxisPoints))
    adjustables = tuple(each for each in objects if isinstance(each, Adjustable))
    scales = tuple(lists.scales(map_view))
    used = {each.conversion for each in measured} | {each.conversion for each in objects} | {each.unit for each in scales}
    units = tuple((lists.conversion(unit), unit) for unit in UNITS if unit and lists.conversion(unit) in used)
    return A2lView(
        units=units,
        conversions=(
            *((name, unit, REAL_FORMAT) for name, unit in units),
            (lists.conversion(NONE), NONE, REAL_FORMAT),
            (lists.count, NONE, COUNT_FORMAT),
        ),
        scales=scales,
        enumerations=(
            Enumeration("status", "what the last step did", tuple(enumerate(STATUSES))),
            Enumeration("state", "state of the supervision", tuple((each.value, each.name) for each in State)),
            Enumeration("cause", "cause of the last sample", tuple((each.value, each.name) for each in Cause)),
        ),
        real=real,
        measured=measured,
        axes=axes,
        adjustables=adjustables,
        groups=groups,
    )


@dataclass(frozen=True)
class _Lists:
    """Builder of the objects in the A2L."""

    prefix: str
    precision: Precision
    real: str

    def conversion(self, unit: Unit) -> str:
        """Name of the COMPU_METHOD of a unit."""
        return f"{self.prefix}.in_{unit.identifier}"

    def raw(self, table: TableView) -> str:
        """Name of the COMPU_METHOD of a table of raw numbers."""
        return f"{self.prefix}.raw_{table.scale_name.removesuffix('_scale')}"

    def scales(self, view: MapView) -> Iterator[Scale]:
        """Yield the conversion of each table of raw numbers."""
        for table in view.tables:
            if table.scale:
                factor = digits(table.scale, self.precision)
                yield Scale(self.raw(table), factor, REAL_FORMAT, table.unit.symbol, self.conversion(table.unit))

    @property
    def count(self) -> str:
        """Name of the COMPU_METHOD of whole numbers."""
        return f"{self.prefix}.count"

    def parameters(self, parameters: Iterable[Parameter], group: str, link: str) -> list[AxisPoints | Adjustable]:
        """Return the objects of a struct: increasing arrays become axes, other arrays of that size become curves over them."""
        made, axis_of = list[AxisPoints | Adjustable](), dict[str, AxisPoints]()
        for each in parameters:
            unit = self.count if each.is_count else self.conversion(each.unit)
            name, where, text = f"{group}.{each.name}", f"{link}.{each.name}", each.meaning
            low, high = (digits(bound, self.precision) for bound in (each.low, each.high))
            if each.increasing:
                axis = AxisPoints(name, text, unit, len(each.values), low, high, f"{self.prefix}.checked.speed", where)
                axis_of[each.points] = axis
                made.append(axis)
            elif each.points:
                axes = (axis_of[each.points],)
                made.append(Adjustable(name, text, "CURVE", f"{self.prefix}_FUNCTION", unit, low, high, where, axes))
            else:
                record = f"{self.prefix}_COUNT" if each.is_count else f"{self.prefix}_REAL"
                made.append(Adjustable(name, text, "VALUE", record, unit, low, high, where))
        return made

    def map(self, view: MapView) -> list[AxisPoints | Adjustable]:
        """Return the axes of the map, and a MAP for each table and layer."""
        prefix = self.prefix
        tops = (digits(top, self.precision) for top in view.axis_tops)
        quantities = (f"{prefix}.checked.speed", f"{prefix}.checked.front_angle")
        axes = [
            AxisPoints(
                name=f"{prefix}.map.{axis.name}",
                text=axis.text,
                conversion=self.conversion(axis.unit),
                points=axis.size,
                low="0.0",
                high=top,
                quantity=quantity,
                link=axis.breakpoints,
            )
            for axis, top, quantity in zip((view.speed, view.front_angle), tops, quantities, strict=True)
        ]
        (speed, front_angle), texts = axes, view.layer_texts(" of")
        maps = [
            Adjustable(
                name=f"{prefix}.map.{table.quantity}" + (f".{view.layer_names[k]}" if view.stacked else ""),
                text=f"{table.title}, at a {'' if view.moving else 'road '}{texts[k]}",
                type="MAP",
                record=f"{self.prefix}_RAW_FUNCTION" if table.scale else f"{self.prefix}_FUNCTION",
                conversion=self.raw(table) if table.scale else self.conversion(table.unit),
                low=self._limit(table, table.low),
                high=self._limit(table, table.high),
                link=table.name + (f"[{k}]" if view.stacked else ""),
                axes=(front_angle, speed),
            )
            for table in view.tables
            for k in range(len(view.layer_values))
        ]
        return [*axes, *maps]

    def checksum(self) -> Adjustable:
        """Return the object of the calibration checksum that the self-test expects."""
        return Adjustable(
            f"{self.prefix}.calibration.expected_checksum",
            "CRC-32 of map, parameters and tyre curves, which the self-test expects",
            "VALUE",
            f"{self.prefix}_CHECKSUM",
            self.count,
            "0",
            str(2**32 - 1),
            f"{self.prefix}_calibration_expected_checksum",
        )

    def state(self, controller: ControllerView) -> Iterator[Measured]:
        """Yield the state of the controller, including the states of its law and its grip estimate."""
        prefix = self.prefix
        inside = {"law": controller.law_state, "grip": controller.grip_state}
        for field in controller.state:
            link = f"{prefix}_{INSTANCE}.controller.{field.name}"
            if field.name == "status":
                yield self._enumerated("status", field.meaning, STATUSES)
            elif field.name == "sample":
                for signal in CHECKED:
                    yield self._measured(
                        f"checked.{signal.role}", field.meaning, self.real, f"{link}.{signal.role}", signal.unit
                    )
            elif field.name in inside:
                for each in inside[field.name]:
                    yield from self._field(each, f"{field.name}.{each.name}", f"{link}.{each.name}")
            else:
                yield from self._field(field, field.name, link)

    def supervision(self) -> Iterator[Measured]:
        """Yield state and cause of the supervision."""
        yield self._enumerated("state", "state of the supervision", State.__members__)
        yield self._enumerated("cause", "cause of the last sample", Cause.__members__)

    def _enumerated(self, name: str, text: str, names: Collection[str]) -> Measured:
        """Return a member of the supervision with a name for each of its values."""
        prefix, top = self.prefix, str(len(names) - 1)
        link = f"{prefix}_{INSTANCE}.{SUPERVISION}.{name}"
        return Measured(f"{prefix}.{name}", text, "ULONG", f"{prefix}.is_{name}", "0", top, link)

    def _field(self, field: Field, name: str, link: str) -> Iterator[Measured]:
        """Yield a field of a state if it is a number or a flag."""
        types = {"real": self.real, "uint16_t": "UWORD", "bool": "UBYTE"}
        if field.kind in types:
            yield self._measured(name, field.meaning, types[field.kind], link, field.unit)

    def received(self, can: CanView) -> Iterator[Measured]:
        """Yield the signals from the car. The task stores their last valid values."""
        for message in can.messages:
            for signal in message.signals if message.sender == "Car" else ():
                definition = signal.definition
                if definition.is_real or signal.field_type:
                    link = f"{self.prefix}_{INSTANCE}.{message.role.removeprefix('vehicle_')}.{definition.role}"
                    name, kind = f"received.{definition.role}", self.real if definition.is_real else "UBYTE"
                    yield self._measured(name, definition.meaning, kind, link, definition.unit)

    def counters(self) -> Iterator[Measured]:
        """Yield the counters of the task."""
        for name, text in COUNTERS:
            yield self._measured(name, text, "ULONG", f"{self.prefix}_{INSTANCE}.{name}")

    def _measured(self, name: str, text: str, kind: str, link: str, unit: Unit = NONE) -> Measured:
        name = f"{self.prefix}.{name}"
        if kind.startswith("FLOAT"):
            reach = REACH.get(unit, 1e6)
            return Measured(name, text, kind, self.conversion(unit), f"{-reach:.9g}", f"{reach:.9g}", link)
        top = {"UBYTE": 1, "UWORD": 2**16 - 1, "ULONG": 2**32 - 1}[kind]
        conversion = f"{self.prefix}.is_true" if kind == "UBYTE" else self.count
        return Measured(name, text, kind, conversion, "0", str(top), link)

    def _limit(self, table: TableView, bound: float) -> str:
        """Return the limit of a table's values: the bound, or the value of the largest raw number if that is smaller."""
        if not table.scale:
            return digits(bound, self.precision)
        reach = RAW_MAX * table.scale
        return f"{max(min(bound, reach), -reach):.9g}"
