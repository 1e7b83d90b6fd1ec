"""View model of the A2L (ASAM MCD-2 MC, ASAP2 1.7): parameters that a calibration tool may change, and measurements.

Addresses are for `codegen a2l`, which reads them from an ELF; until then the symbol links identify each object.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from codegen.configuration import Config
from codegen.configuration.signals import STATUSES, signals_of
from codegen.ecu_map.storage import RAW_MAX
from codegen.emit.can_view import CanView, task_view
from codegen.emit.controller_view import ControllerView
from codegen.emit.inputs_view import InputsView
from codegen.emit.limiter_view import LimiterView
from codegen.emit.map_view import MapView, TableView
from codegen.emit.objects import CalibrationObject, CType, Layout, ManifestObjects, Measurement
from codegen.emit.parameters import Field, Parameter
from codegen.emit.render import render
from codegen.emit.supervision import Cause, State
from codegen.emit.text import Precision, c_type, comment_text, digits, shortest
from codegen.emit.xcp_view import xcp_view
from codegen.units import KM_H, M_S, M_S2, NONE, RAD, RAD_S, Unit, in_order, unit_of

COUNT = "count"
"""Conversion of whole numbers, without the prefix."""
UNSIGNED: dict[int, CType] = {1: "uint8_t", 2: "uint16_t", 4: "uint32_t"}
"""Types of whole numbers by their bytes."""
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
ASAP2_TYPES = {
    "bool": ("UBYTE", 1),
    "uint8_t": ("UBYTE", 1),
    "int16_t": ("SWORD", 2),
    "uint16_t": ("UWORD", 2),
    "uint32_t": ("ULONG", 4),
    "float": ("FLOAT32_IEEE", 4),
    "double": ("FLOAT64_IEEE", 8),
}
"""Names of types in an A2L, and bytes."""
_GROUPS = {
    "parameters": "parameters of the controller",
    "inputs": "parameters of the monitoring of the inputs",
    "limiter": "parameters of the safety limiter",
    "map": "reference map and its axes",
    "calibration": "parameters, map and tyre curves together",
}
_RECORDS = {"uint16_t": "COUNT", "uint32_t": "CHECKSUM"}
HINT = "Addresses: codegen a2l --build DIR --elf ELF -o A2L"


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
    """Objects and conversions of the A2L.

    Attributes:
        layout: objects and measurements, with their addresses if they are known.
        precision: of the build.
        header: origin of the file and of its addresses.
        segment: first address and size in bytes of the calibration and the build's identity.
    """

    layout: Layout
    precision: Precision
    header: str
    segment: tuple[int, int] = (0, 0)

    enumerations = (
        Enumeration("status", "what the last step did", tuple(enumerate(STATUSES))),
        Enumeration("state", "state of the supervision", tuple((each.value, each.name) for each in State)),
        Enumeration("cause", "cause of the last sample", tuple((each.value, each.name) for each in Cause)),
    )
    real_format, count_format = "%12.6", "%10.0"

    @property
    def byte_order(self) -> str:
        """Byte order, as the A2L spells it."""
        return "MSB_LAST" if self.layout.byte_order == "<" else "MSB_FIRST"

    @property
    def real(self) -> str:
        """Type of real numbers."""
        return self.type(c_type(self.precision))

    @property
    def axes(self) -> tuple[CalibrationObject, ...]:
        """Axes of the calibration."""
        return tuple(each for each in self.layout.objects.values() if each.kind == "AXIS")

    @property
    def adjustables(self) -> tuple[CalibrationObject, ...]:
        """Values, curves and maps of the calibration."""
        return tuple(each for each in self.layout.objects.values() if each.kind != "AXIS")

    @property
    def scales(self) -> tuple[CalibrationObject, ...]:
        """One object for each conversion of raw numbers."""
        return tuple({each.conversion: each for each in self.adjustables if each.scale}.values())

    @property
    def units(self) -> tuple[Unit, ...]:
        """Units of the objects and measurements."""
        symbols = {each.unit for each in self.layout.objects.values()} | {each.unit for each in self.layout.measurements}
        return in_order(unit_of(symbol) for symbol in symbols if symbol)

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups of calibration objects and that of the measurements."""
        prefix, objects = self.layout.prefix, self.layout.in_struct_order
        named = {group: tuple(each.name for each in objects if each.group == group) for group in _GROUPS}
        measured = tuple(each.name for each in self.layout.measurements)
        return (
            *(Group(f"{prefix}.{group}", text, named[group]) for group, text in _GROUPS.items()),
            Group(f"{prefix}.measurements", "measurements of the task and its controller", (), measured),
        )

    def type(self, name: str) -> str:
        """Return the name of a C type in an A2L."""
        return ASAP2_TYPES[name][0]

    def bytes(self, name: str) -> int:
        """Return the size of a C type."""
        return ASAP2_TYPES[name][1]

    def number(self, value: float, *, nine_digits: bool = False) -> str:
        """Return a number in the precision of the build, or with nine digits."""
        return f"{value:.9g}" if nine_digits and isinstance(value, float) else digits(value, self.precision)

    def limits(self, each: CalibrationObject | Measurement) -> str:
        """Return both limits. Those of raw numbers and measurements have nine digits."""
        short = isinstance(each, Measurement) or each.scale is not None
        return f"{self.number(each.low, nine_digits=short)} {self.number(each.high, nine_digits=short)}"

    def record(self, each: CalibrationObject) -> str:
        """Return the name of the record layout of a value, curve or map, without the prefix."""
        if each.shape:
            return "RAW_FUNCTION" if each.scale else "FUNCTION"
        return _RECORDS.get(each.type, "REAL")

    def quantity(self, axis: CalibrationObject) -> str:
        """Return the measurement that is looked up on an axis, if there is one."""
        there = any(each.name == axis.quantity for each in self.layout.measurements)
        return axis.quantity if there else "NO_INPUT_QUANTITY"


def a2l(
    manifest: Mapping[str, Any],
    config: Config,
    layout: Layout | None = None,
    origin: str = "",
    segment: tuple[int, int] = (0, 0),
) -> bytes:
    """Return the A2L of a build, rendered from its manifest.

    Args:
        manifest: of the build.
        config: its configuration.
        layout: objects with addresses; None: those of the manifest.
        origin: origin of the addresses; "" without addresses.
        segment: address and bytes of the calibration.
    """
    own, prefix, facts = layout or Layout.of(manifest), manifest["options"]["prefix"], manifest["map"]
    header = f"Made by codegen; do not edit, build again. {origin}"
    if not origin:
        header = f"Made by codegen {manifest['version']}; do not edit, build again. {HINT}"
    context = {
        "name": comment_text(manifest["name"]),
        "domain": domain_text(facts["friction"], facts["speed_m_s"][-1], facts["front_angle_rad"][-1]),
        "p": prefix,
        "xcp": xcp_view(config, task_view(config).function),
        "a2l": A2lView(own, manifest["options"]["precision"], header, segment),
    }
    return render("a2l.j2", context)


def domain_text(friction: float, speed: float, front_angle: float) -> str:
    """Return the domain of a map in words, from the friction of the road and the largest speed and front angle, SI units."""
    return (
        f"road friction {friction:g}, 0 to {speed / KM_H:.4g} km/h, 0 to {np.rad2deg(front_angle):.4g} deg at the front wheels"
    )


def manifest_objects(
    prefix: str,
    precision: Precision,
    controller: ControllerView,
    inputs: InputsView,
    limiter: LimiterView,
    map_view: MapView,
    can: CanView,
) -> ManifestObjects:
    """Return every parameter, axis and table of the calibration of a build, and the state of the task."""
    lists, default = _Lists(prefix, precision), f"{prefix}_parameters_default"
    highest = next(each.high for each in controller.parameters if each.name == "rear_angle_max")
    bounded = [replace(each, high=highest) if each.name in OF_THE_ANGLE else each for each in limiter.parameters]
    return ManifestObjects(
        objects=[
            *lists.parameters(controller.parameters, "parameters", default),
            *lists.parameters(inputs.parameters, "inputs", f"{default}.inputs"),
            *lists.parameters(bounded, "limiter", f"{default}.limiter"),
            *lists.map(map_view),
            lists.checksum(),
        ],
        measurements=[*lists.state(controller), *lists.supervision(), *lists.received(can), *lists.counters()],
        conditions=list(controller.conditions),
    )


@dataclass(frozen=True)
class _Lists:
    """Builder of the objects."""

    prefix: str
    precision: Precision

    @property
    def real(self) -> Literal["float", "double"]:
        """C type of real numbers."""
        return "float" if self.precision == "single" else "double"

    def parameters(self, parameters: Iterable[Parameter], group: str, link: str) -> list[CalibrationObject]:
        """Return the objects of a struct: increasing arrays become axes, other arrays of that size become curves over them."""
        made, axis_of = list[CalibrationObject](), dict[str, str]()
        for each in parameters:
            name, kind = f"{self.prefix}.{group}.{each.name}", "VALUE"
            if each.increasing:
                axis_of[each.points], kind = name, "AXIS"
            elif each.points:
                kind = "CURVE"
            made.append(
                CalibrationObject(
                    name=name,
                    meaning=each.meaning,
                    group=group,
                    kind=kind,  # type: ignore[arg-type]
                    type="uint16_t" if each.is_count else self.real,
                    unit=each.unit.symbol,
                    conversion=COUNT if each.is_count else _conversion(each.unit),
                    low=self._exact(each.low),
                    high=self._exact(each.high),
                    link=f"{link}.{each.name}",
                    shape=(len(each.values),) if each.points else (),
                    axes=(axis_of[each.points],) if kind == "CURVE" else (),
                    quantity=f"{self.prefix}.checked.speed" if kind == "AXIS" else "",
                )
            )
        return made

    def _exact(self, bound: float) -> float:
        """Return a bound in the precision of the build; whole numbers stay whole."""
        return bound if isinstance(bound, int) else shortest(bound, self.precision)

    def map(self, view: MapView) -> list[CalibrationObject]:
        """Return the axes of the map, and a MAP for each table and layer."""
        prefix = self.prefix
        axes = [
            CalibrationObject(
                name=f"{prefix}.map.{axis.name}",
                meaning=axis.text,
                group="map",
                kind="AXIS",
                type=self.real,
                unit=axis.unit.symbol,
                conversion=_conversion(axis.unit),
                low=0.0,
                high=self._exact(top),
                link=axis.breakpoints,
                shape=(axis.size,),
                quantity=f"{prefix}.checked.{axis.name}",
            )
            for axis, top in zip((view.speed, view.front_angle), view.axis_tops, strict=True)
        ]
        texts = view.layer_texts(" of")
        maps = [
            CalibrationObject(
                name=f"{prefix}.map.{table.quantity}" + (f".{view.layer_names[k]}" if view.stacked else ""),
                meaning=f"{table.title}, at a {'' if view.moving else 'road '}{texts[k]}",
                group="map",
                kind="MAP",
                type="int16_t" if table.scale else self.real,
                scale=table.scale or None,
                physical=self.real if table.scale else "",
                unit=table.unit.symbol,
                conversion=f"raw_{table.quantity}" if table.scale else _conversion(table.unit),
                low=self._limit(table, table.low),
                high=self._limit(table, table.high),
                link=table.name + (f"[{k}]" if view.stacked else ""),
                shape=(view.speed.size, view.front_angle.size),
                axes=(axes[1].name, axes[0].name),
            )
            for table in view.tables
            for k in range(len(view.layer_values))
        ]
        return [*axes, *maps]

    def checksum(self) -> CalibrationObject:
        """Return the object of the calibration checksum that the self-test expects."""
        return CalibrationObject(
            name=f"{self.prefix}.calibration.expected_checksum",
            meaning="CRC-32 of map, parameters and tyre curves, which the self-test expects",
            group="calibration",
            kind="VALUE",
            type="uint32_t",
            conversion=COUNT,
            low=0,
            high=2**32 - 1,
            link=f"{self.prefix}_calibration_expected_checksum",
        )

    def state(self, controller: ControllerView) -> Iterator[Measurement]:
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

    def supervision(self) -> Iterator[Measurement]:
        """Yield state and cause of the supervision."""
        yield self._enumerated("state", "state of the supervision", State.__members__)
        yield self._enumerated("cause", "cause of the last sample", Cause.__members__)

    def _enumerated(self, name: str, text: str, names: Collection[str]) -> Measurement:
        """Return a member of the supervision with a name for each of its values."""
        return Measurement(
            name=f"{self.prefix}.{name}",
            meaning=text,
            type="uint32_t",
            conversion=f"is_{name}",
            low=0,
            high=len(names) - 1,
            link=f"{self.prefix}_{INSTANCE}.{SUPERVISION}.{name}",
        )

    def _field(self, field: Field, name: str, link: str) -> Iterator[Measurement]:
        """Yield a field of a state if it is a number or a flag."""
        types: dict[str, CType] = {"real": self.real, "uint16_t": "uint16_t", "bool": "bool"}
        if field.kind in types:
            yield self._measured(name, field.meaning, types[field.kind], link, field.unit)

    def received(self, can: CanView) -> Iterator[Measurement]:
        """Yield the signals from the car. The task stores their last valid values."""
        for message in can.messages:
            for signal in message.signals if message.sender == "Car" else ():
                definition = signal.definition
                if definition.is_real or signal.field_type:
                    link = f"{self.prefix}_{INSTANCE}.{message.role.removeprefix('vehicle_')}.{definition.role}"
                    name, kind = f"received.{definition.role}", self.real if definition.is_real else UNSIGNED[1]
                    yield self._measured(name, definition.meaning, kind, link, definition.unit)

    def counters(self) -> Iterator[Measurement]:
        """Yield the counters of the task."""
        for name, text in COUNTERS:
            yield self._measured(name, text, "uint32_t", f"{self.prefix}_{INSTANCE}.{name}")

    def _measured(self, name: str, text: str, kind: CType, link: str, unit: Unit = NONE) -> Measurement:
        """Return a number or a flag, with the limits of its type or unit."""
        reach = float(f"{REACH.get(unit, 1e6):.9g}")
        tops = {"bool": 1, "uint8_t": 1, "uint16_t": 2**16 - 1, "uint32_t": 2**32 - 1}
        is_real, is_flag = kind == self.real, tops.get(kind) == 1
        return Measurement(
            name=f"{self.prefix}.{name}",
            meaning=text,
            type=kind,
            conversion=_conversion(unit) if is_real else "is_true" if is_flag else COUNT,
            unit=unit.symbol if is_real else "",
            low=-reach if is_real else 0,
            high=reach if is_real else tops[kind],
            link=link,
        )

    def _limit(self, table: TableView, bound: float) -> float:
        """Return the limit of a table's values: the bound, or the value of the largest raw number if that is smaller."""
        if not table.scale:
            return self._exact(bound)
        reach = RAW_MAX * table.scale
        return float(f"{max(min(bound, reach), -reach):.9g}")


def _conversion(unit: Unit) -> str:
    """Return the name of the COMPU_METHOD of a unit, without the prefix."""
    return f"in_{unit.identifier}"


def symbols_of(table: MapView, prefix: str, real: str, epk: str) -> dict[str, dict[str, Any]]:
    """Return type, shape, unit and section of each object by name. All are defined in `<prefix>_calibration.c`.

    A table is stored row by row, with one row for each speed. `unit` is the unit of the physical value. Raw numbers have a
    `scale` too, the physical value of a raw number 1.
    """
    found = {
        f"{prefix}_parameters_default": _symbol(f"{prefix}_parameters_t"),
        f"{prefix}_epk": _symbol("char", (len(epk) + 1,)),
        f"{prefix}_calibration_expected_checksum": _symbol("uint32_t"),
        **_map_symbols(table, table.tables, real, "calibration"),
        f"{prefix}_constants": _symbol(f"{prefix}_constants_t", section="const"),
    }
    return found if table.grip is None else found | _map_symbols(table, (table.grip,), real, "const")


def _map_symbols(of: MapView, tables: tuple[TableView, ...], real: str, section: str) -> dict[str, dict[str, Any]]:
    axes, layers = (tables[0].speed, tables[0].front_angle), (len(of.layer_values),) if of.stacked else ()
    shape = (*layers, *(axis.size for axis in axes))
    return {axis.breakpoints: _symbol(real, (axis.size,), axis.unit, section) for axis in axes} | {
        each.name: _symbol(real if each.kind == "real" else each.kind, shape, each.unit, section, each.scale) for each in tables
    }


def _symbol(
    kind: str, shape: tuple[int, ...] = (), unit: Unit = NONE, section: str = "calibration", scale: float | None = None
) -> dict[str, Any]:
    factor = {} if scale is None else {"scale": scale}
    return {"type": kind, "shape": list(shape), "unit": unit.symbol, "section": section, **factor}
