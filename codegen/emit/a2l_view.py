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
from codegen.emit.parameters import Field, ParameterView
from codegen.emit.render import unit as unit_before
from codegen.emit.supervision import Cause, State
from codegen.emit.text import NONE, UNITS, Precision, Unit, unit_of_comment

REAL_FORMAT, COUNT_FORMAT = "%12.6", "%10.0"
REACH = {"m/s": 1000.0, "rad": math.tau, "rad/s": 100.0, "m/s^2": 1000.0}
"""Limits of measurements by unit; 1e6 for other units."""
COUNTERS = (
    ("cycles", "calls of the task; wraps around"),
    ("late_cycles", "calls that found a message more than once"),
    ("early_cycles", "calls that found no message"),
    ("lost_samples", "calls without a good sample"),
)
CHECKED = tuple((each.role, each.unit) for each in signals_of("vehicle_motion"))
"""Signals of a sample that the monitoring of the inputs checks and may replace, with their units."""
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
class Axis:
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
    axes: tuple[Axis, ...] = ()


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

    units: tuple[tuple[str, str, str], ...]
    conversions: tuple[tuple[str, str, str], ...]
    scales: tuple[Scale, ...]
    enumerations: tuple[Enumeration, ...]
    real: str
    measured: tuple[Measured, ...]
    axes: tuple[Axis, ...]
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
    lists = _Lists(prefix, real)
    default, points = f"{prefix}_parameters_default", ((f"{prefix.upper()}_LIMITER_POINTS", limiter.points),)
    parameters = lists.parameters(controller.parameters, f"{prefix}.parameters", default, controller.points)
    highest = next(view.high for view in controller.parameters if view.name == "rear_angle_max")
    bounded = [replace(view, high=highest) if view.name in OF_THE_ANGLE else view for view in limiter.parameters]
    monitoring = lists.parameters(inputs.parameters, f"{prefix}.inputs", f"{default}.inputs", ())
    limits = lists.parameters(bounded, f"{prefix}.limiter", f"{default}.limiter", points)
    numbers, checksum = lists.map(map_view), lists.checksum()
    measured = (*lists.state(controller), *lists.supervision(), *lists.received(can), *lists.counters())
    groups = (
        Group(f"{prefix}.parameters", "parameters of the controller", tuple(each.name for each in parameters)),
        Group(f"{prefix}.inputs", "parameters of the monitoring of the inputs", tuple(each.name for each in monitoring)),
        Group(f"{prefix}.limiter", "parameters of the safety limiter", tuple(each.name for each in limits)),
        Group(f"{prefix}.map", "reference map and its axes", tuple(each.name for each in numbers)),
        Group(f"{prefix}.calibration", "parameters, map and tyre curves together", (checksum.name,)),
        Group(f"{prefix}.measurements", "of the task and its controller", (), tuple(each.name for each in measured)),
    )
    objects: list[Axis | Adjustable] = [*parameters, *monitoring, *limits, *numbers, checksum]
    axes = tuple(each for each in objects if isinstance(each, Axis))
    adjustables = tuple(each for each in objects if isinstance(each, Adjustable))
    scales = tuple(lists.scales(map_view))
    used = {each.conversion for each in measured} | {each.conversion for each in objects} | {each.unit for each in scales}
    units = [(lists.conversion(unit), unit) for unit in UNITS if unit is not NONE and lists.conversion(unit) in used]
    return A2lView(
        units=tuple((name, unit.symbol, " ".join(str(power) for power in unit.exponents)) for name, unit in units),
        conversions=(
            *((name, unit.symbol, REAL_FORMAT) for name, unit in units),
            (lists.conversion(NONE), "", REAL_FORMAT),
            (lists.count, "", COUNT_FORMAT),
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
    real: str

    def conversion(self, unit: Unit) -> str:
        """Name of the COMPU_METHOD of a unit."""
        return f"{self.prefix}.in_{unit.conversion}"

    def raw(self, table: TableView) -> str:
        """Name of the COMPU_METHOD of a table of raw numbers."""
        return f"{self.prefix}.raw_{table.scale_name.removesuffix('_scale')}"

    def scales(self, view: MapView) -> Iterator[Scale]:
        """Yield the conversion of each table of raw numbers."""
        for table in view.tables:
            if table.scale:
                unit = unit_of_comment(table.unit)
                yield Scale(self.raw(table), _plain(table.scale), REAL_FORMAT, unit.symbol, self.conversion(unit))

    @property
    def count(self) -> str:
        """Name of the COMPU_METHOD of whole numbers."""
        return f"{self.prefix}.count"

    def parameters(
        self, views: Iterable[ParameterView], group: str, link: str, points: Iterable[tuple[str, int]]
    ) -> list[Axis | Adjustable]:
        """Return the objects of a struct: increasing arrays become axes, other arrays of that size become curves over them."""
        sizes, made, axis_of = dict(points), list[Axis | Adjustable](), dict[str, Axis]()
        for view in views:
            unit = self.conversion(unit_of_comment(view.comment))
            name, where, text = f"{group}.{view.name}", f"{link}.{view.name}", view.comment
            low, high = (bound.rstrip("u") if view.is_count else _plain(bound) for bound in (view.low, view.high))
            if view.increasing:
                axis = Axis(name, text, unit, sizes[view.points], low, high, f"{self.prefix}.checked.speed", where)
                axis_of[view.points] = axis
                made.append(axis)
            elif view.points:
                axes = (axis_of[view.points],)
                made.append(Adjustable(name, text, "CURVE", f"{self.prefix}_FUNCTION", unit, low, high, where, axes))
            else:
                record = f"{self.prefix}_COUNT" if view.is_count else f"{self.prefix}_REAL"
                made.append(Adjustable(name, text, "VALUE", record, self.count if view.is_count else unit, low, high, where))
        return made

    def map(self, view: MapView) -> list[Axis | Adjustable]:
        """Return the axes of the map, and a MAP for each table and layer."""
        prefix = self.prefix
        tops = (_plain(top) for top in view.axis_tops)
        quantities = (f"{prefix}.checked.speed", f"{prefix}.checked.front_angle")
        axes = [
            Axis(
                name=f"{prefix}.map.{axis.name}",
                text=axis.text,
                conversion=self.conversion(unit_of_comment(axis.unit)),
                points=axis.size,
                low="0.0",
                high=top,
                quantity=quantity,
                link=axis.breakpoints,
            )
            for axis, top, quantity in zip((view.speed, view.front_angle), tops, quantities, strict=True)
        ]
        speed, front_angle = axes
        maps = [
            Adjustable(
                name=f"{prefix}.map.{table.name.removeprefix(f'{prefix}_map_').removesuffix('_table')}"
                + (f".{view.layer_names[k]}" if view.stacked else ""),
                text=f"{table.unit}, at a {'' if view.moving else 'road '}{view.layer_texts[k]}",
                type="MAP",
                record=f"{self.prefix}_RAW_FUNCTION" if table.scale else f"{self.prefix}_FUNCTION",
                conversion=self.raw(table) if table.scale else self.conversion(unit_of_comment(table.unit)),
                low=_limit(table, table.low),
                high=_limit(table, table.high),
                link=table.name + (f"[{k}]" if view.stacked else ""),
                axes=(front_angle, speed),
            )
            for table in view.tables
            for k in range(len(table.layers))
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
                yield self._enumerated("status", field.comment, STATUSES)
            elif field.name == "sample":
                for name, unit in CHECKED:
                    yield self._measured(
                        f"checked.{name}", f"{unit}, last sample after monitoring", self.real, f"{link}.{name}"
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
            yield self._measured(name, field.comment, types[field.kind], link)

    def received(self, can: CanView) -> Iterator[Measured]:
        """Yield the signals from the car. The task stores their last valid values."""
        for message in can.messages:
            for signal in message.signals if message.sender == "Car" else ():
                definition = signal.definition
                if definition.is_real or signal.field_type:
                    link = f"{self.prefix}_{INSTANCE}.{message.role.removeprefix('vehicle_')}.{definition.role}"
                    text = unit_before(definition.meaning, definition.unit)
                    yield self._measured(
                        f"received.{definition.role}", text, self.real if definition.is_real else "UBYTE", link
                    )

    def counters(self) -> Iterator[Measured]:
        """Yield the counters of the task."""
        for name, text in COUNTERS:
            yield self._measured(name, text, "ULONG", f"{self.prefix}_{INSTANCE}.{name}")

    def _measured(self, name: str, text: str, kind: str, link: str) -> Measured:
        name, unit = f"{self.prefix}.{name}", unit_of_comment(text)
        if kind.startswith("FLOAT"):
            reach = REACH.get(unit.symbol, 1e6)
            return Measured(name, text, kind, self.conversion(unit), f"{-reach:.9g}", f"{reach:.9g}", link)
        top = {"UBYTE": 1, "UWORD": 2**16 - 1, "ULONG": 2**32 - 1}[kind]
        conversion = f"{self.prefix}.is_true" if kind == "UBYTE" else self.count
        return Measured(name, text, kind, conversion, "0", str(top), link)


def _limit(table: TableView, bound: str) -> str:
    """Return the limit of a table's values: the bound, or the value of the largest raw number if that is smaller."""
    if not table.scale:
        return _plain(bound)
    reach = RAW_MAX * float(_plain(table.scale))
    return f"{max(min(float(_plain(bound)), reach), -reach):.9g}"


def _plain(literal: str) -> str:
    """Return a C literal in the number format of the A2L."""
    return literal.rstrip("f")
