"""Variables of each kind of FMU: names, units, ranges and members in the C of the model, and the controller's parameters.

Names are those of the columns of a run, or of fields of the C structs with the unit as suffix. Names and values of parameters
come from the compiled build, their descriptions and ranges from the table of parameters.

Layered standards of an FMI 3.0 FMU: FMI Layered Standard for Network Communication 1.0.0 (CAN, network abstraction), sections
4.3, 4.4 and 4.5.1; FMI Layered Standard for XCP 1.0.0, sections 2 and 3.1.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce
from operator import getitem
from typing import Any, Literal

import numpy as np

from codegen.configuration import Config
from codegen.configuration.signals import RECORDED
from codegen.emit.controller_view import parameters_by_path
from codegen.emit.text import shortest
from codegen.sil.software import COUNTERS, Software
from codegen.units import NONE, RAD, S, Unit, unit_of_name
from codegen.vehicle.dynamics import two_track

Version = Literal["2", "3"]
What = Literal["controller", "plant", "loop", "ecu", "bus_plant"]
"""Kinds of FMU; "bus_plant" is the plant as a node on the bus."""
WITH_BUS: tuple[What, ...] = ("ecu", "bus_plant")

Kind = Literal["real", "integer", "boolean", "status", "binary", "clock"]
Role = Literal["time", "input", "output", "fixed", "tunable"]

SPEED_MAX = 150.0
"""Largest speed in m/s, as for the speeds of a map."""
WHEEL_ANGLE_MAX = 30.0
"""Largest steering-wheel angle in rad, beyond any real one."""
FRICTION_MAX = 2.0
YAW_MOMENT_MAX = 1e6
"""Largest yaw moment in N m. Inputs of the plant are bounded to keep its motion finite."""


@dataclass(frozen=True)
class Variable:
    """One scalar variable.

    Attributes:
        name: name for the simulator.
        member: member of `model_t`; "" for the time, binary variables and clocks.
        storage: C type of the member: double, float, int32_t, uint16_t or bool; "elsewhere": no member.
        start: start value; None if computed.
        low, high: inclusive range; None: range of the type.
        depends: inputs that an output depends on directly, within the same step.
        clock: clock of a binary variable.
        interval, shift: of a periodic clock, in s; an interval of None: the clock is triggered.
    """

    name: str
    member: str
    kind: Kind
    role: Role
    description: str
    storage: str = "double"
    unit: Unit = NONE
    start: float | None = None
    low: float | None = None
    high: float | None = None
    continuous: bool = False
    depends: tuple[str, ...] = ()
    clock: str = ""
    interval: float | None = None
    shift: float = 0.0


TIME = Variable("time_s", "", "real", "time", "time", unit=S, continuous=True)

_FRONT = "front wheels, at the road; positive to the left"
_REAR = "rear wheels; positive to the left"


def _input(
    name: str,
    member: str,
    description: str,
    bounds: tuple[float, float] | None = None,
    start: float = 0.0,
) -> Variable:
    low, high = (None, None) if bounds is None else bounds
    unit = unit_of_name(name)
    return Variable(name, member, "real", "input", description, unit=unit, start=start, low=low, high=high, continuous=True)


def _flag(name: str, description: str, start: bool = False) -> Variable:
    return Variable(name, name, "boolean", "input", description, "bool", start=float(start))


def _output(name: str, member: str, description: str, bound: float | None = None, *, continuous: bool = True) -> Variable:
    low = None if bound is None else -bound
    return Variable(
        name, member, "real", "output", description, unit=unit_of_name(name), low=low, high=bound, continuous=continuous
    )


def _commands(config: Config) -> tuple[Variable, ...]:
    """Return the outputs of a controller; constant between its samples."""
    return (
        _output(
            "rear_angle_command_rad",
            "rear_angle_command",
            f"commanded angle of the {_REAR}",
            # A controller in single precision has the nearest number of that, which may lie above.
            max(config.rear_actuator.angle_max, float(np.float32(config.rear_actuator.angle_max))),
            continuous=False,
        ),
        _output("yaw_rate_reference_rad_s", "yaw_rate_reference", "what the controller follows", continuous=False),
        Variable("status", "status", "status", "output", "what the last sample of the controller did", "int32_t"),
    )


def _road(config: Config) -> tuple[Variable, ...]:
    """Return the inputs of the car other than the rear angle."""
    friction = config.road.friction
    return (
        _input("speed_m_s", "speed", "forward speed of the car", (0.0, SPEED_MAX)),
        _input(
            "steering_wheel_command_rad",
            "steering_wheel_command",
            "angle of the steering wheel that the driver demands; positive to the left",
            (-WHEEL_ANGLE_MAX, WHEEL_ANGLE_MAX),
        ),
        _input("friction", "friction", "peak friction of the road", (0.0, FRICTION_MAX), friction),
        _input("yaw_moment_n_m", "yaw_moment", "from outside, such as a gust", (-YAW_MOMENT_MAX, YAW_MOMENT_MAX)),
    )


_MEMBER = {"state": "plant.", "output": "output."}


def _motion(config: Config) -> tuple[Variable, ...]:
    """Return the outputs of the car."""
    car = (
        _output("front_angle_rad", "output.front_angle", f"angle of the {_FRONT}"),
        _output("yaw_rate_rad_s", "plant.yaw_rate", "positive to the left"),
        _output("sideslip_rad", "output.sideslip_angle", "at the centre of gravity; positive to the left"),
        _output("lateral_acceleration_m_s2", "output.lateral_acceleration", "of the centre of gravity; positive to the left"),
        _output("rear_angle_rad", "plant.rear_angle", f"achieved angle of the {_REAR}"),
        _output("slip_front_rad", "output.slip_front", "slip angle at the middle of the front axle"),
        _output("slip_rear_rad", "output.slip_rear", "slip angle at the middle of the rear axle"),
        *(_output(each.variable, _MEMBER[each.origin] + each.origin_name, each.meaning) for each in RECORDED),
    )
    at_once = _inputs_at_once(config)
    return tuple(replace(each, depends=at_once.get(each.member, ())) for each in car)


def _sensed(config: Config) -> tuple[Variable, ...]:
    """Return what the sensors of the car measure where that is not its true motion: with the body's roll, at the motor."""
    sensed = [each for each in config.can.measured if each.origin_name.startswith("measured_")]
    at_once = _inputs_at_once(config)
    outputs = [
        _output(f"measured_{each.variable}", f"output.{each.origin_name}", f"{each.meaning}; for a controller")
        for each in sensed
    ]
    return tuple(replace(each, depends=at_once[each.member]) for each in outputs)


def _inputs_at_once(config: Config) -> dict[str, tuple[str, ...]]:
    """Return member of each plant output -> inputs that it depends on, from the structure of the equations."""
    model = two_track(config)
    assert model.output is not None  # the plant has outputs by construction
    inputs = {each.member: each.name for each in (*_road(config), _REAR_COMMAND)}
    rows, columns = model.output.jac_sparsity(0, 1).get_triplet()
    found: dict[str, tuple[str, ...]] = {f"output.{name}": () for name in model.outputs}
    for row, column in zip(rows, columns, strict=True):
        if (name := inputs.get(model.inputs[column])) is not None:  # no FMU has a lateral force
            found[f"output.{model.outputs[row]}"] += (name,)
    return found


_REAR_COMMAND = _input(
    "rear_angle_command_rad", "rear_angle_command", f"commanded angle at the {_REAR}", (-WHEEL_ANGLE_MAX, WHEEL_ANGLE_MAX)
)


def variables_of(what: What, config: Config) -> tuple[Variable, ...]:
    """Return time, inputs, outputs and start values of one kind of FMU, without controller parameters."""
    if what == "plant":
        return (TIME, *_road(config), _REAR_COMMAND, *_motion(config), *_sensed(config))
    if what == "controller":
        return (TIME, *_measurement(config), *_commands(config), _initial(config))
    if what == "ecu":
        own = (*_ecu_outputs(config), *_task_times(config), *_bus(()))
        # All outputs may change at a tick, and their clock may tick with it.
        return (TIME, *(replace(each, depends=(TASK_CLOCK,)) if each.role == "output" else each for each in own))
    driver = _driver(config)
    every = tuple(each.name for each in driver)
    if what == "bus_plant":
        command = replace(_commands(config)[0], description=f"{_commands(config)[0].description}, as received")
        return (TIME, *driver, *_motion(config), command, *_bus(every))
    commands = tuple(replace(each, depends=every) for each in _commands(config))
    return (TIME, *driver, *_motion(config), *commands)


def _driver(config: Config) -> tuple[Variable, ...]:
    """Return the inputs of the car and those of the controller that no sensor of the car measures."""
    return (
        *_road(config),
        _input(
            "friction_estimate",
            "friction_estimate",
            "for the controller; counts where friction_estimate_available",
            start=config.road.friction,
        ),
        _flag("friction_estimate_available", "false: the controller takes the friction of its map"),
        *(_input(each.variable, each.role, each.meaning) for each in config.can.measured if each.is_extra),
        _flag("inhibit", "ESC or ABS is acting: the controller's integrator holds"),
    )


def _bus(depends: tuple[str, ...]) -> tuple[Variable, ...]:
    """Return the variables of the bus terminal. The frames to send depend on these inputs directly."""

    def named(member: str, kind: Kind, role: Role, description: str, clock: str = "") -> Variable:
        name = f"{CHANNEL}.{member}"
        needed = depends if clock and role == "output" else ()
        return Variable(name, "", kind, role, description, "elsewhere", depends=needed, clock=clock)

    receive, transmit = f"{CHANNEL}.Rx_Clock", f"{CHANNEL}.Tx_Clock"
    about = "the bus confirms frames and reports errors: frames are repeated, and errors counted"
    return (
        named("Rx_Clock", "clock", "input", "ticks when operations arrive from the bus"),
        named("Rx_Data", "binary", "input", "operations from the bus", receive),
        named("Tx_Clock", "clock", "output", "ticks when there are operations for the bus"),
        named("Tx_Data", "binary", "output", "operations for the bus", transmit),
        Variable(f"{CHANNEL}.{NOTIFICATIONS}", "node.notifications", "boolean", "fixed", about, "bool", start=0.0),
    )


def _ecu_outputs(config: Config) -> tuple[Variable, ...]:
    """Return what the last command of the task contains, and the counters of the task."""
    angle, reference, status = _commands(config)
    available = "whether the last frame has an angle; before the first good sample it has none"
    return (
        angle,
        Variable("rear_angle_command_available", "rear_angle_command_available", "boolean", "output", available, "bool"),
        reference,
        status,
        Variable("diagnostics", "diagnostics", "integer", "output", "bits of the signal Diagnostics", "int32_t"),
        *(Variable(each, each, "integer", "output", _COUNTED[each], "int32_t") for each in COUNTERS),
    )


_COUNTED = {
    "cycles": "runs of the task",
    "late_cycles": "runs of the task with more than one frame of a message",
    "early_cycles": "runs of the task without a frame",
    "lost_samples": "runs of the task without a good sample",
}


TASK_CLOCK = "task_clock"


def _task_times(config: Config) -> tuple[Variable, ...]:
    """Return what defines the times of the task: the offset of the ECU's own clock, and the clock of the simulator."""
    period = config.controller.sampling_time_s
    about = "time of the first run of the task, in whole internal steps; by default half a period after the car's frames"
    low, start = config.plant.sampling_time_s, 0.5 * period
    clocked = f"the task runs at the ticks of {TASK_CLOCK}; otherwise by the clock of the ECU, first at task_offset_s"
    ticks = "runs the task if task_is_clocked; otherwise without effect"
    return (
        Variable("task_offset_s", "task_offset", "real", "fixed", about, unit=S, start=start, low=low, high=period),
        Variable("task_is_clocked", "task_is_clocked", "boolean", "fixed", clocked, "bool", start=0.0),
        Variable(TASK_CLOCK, "", "clock", "input", ticks, "elsewhere", interval=period, shift=start),
    )


def _measurement(config: Config) -> tuple[Variable, ...]:
    """Return the controller's measurement, without bounds because the controller checks its inputs."""
    found: list[Variable] = []
    for signal in config.can.measured:
        if not signal.is_real:
            found.append(_flag(signal.role, signal.comment))
        elif not signal.is_optional:
            found.append(_input(signal.variable, signal.role, signal.meaning))
        else:
            available = f"{signal.role}_available"
            start = config.road.friction if signal.role == "friction" else 0.0
            found.append(_input(signal.variable, signal.role, f"{signal.meaning}; counts where {available}", start=start))
            found.append(_flag(available, f"false: {_ABSENCE.get(signal.role, 'not measured')}", signal.role == "rear_angle"))
    return tuple(found)


_ABSENCE = {
    "friction": "the controller takes the friction of its map",
    "longitudinal_acceleration": "the controller takes the strongest braking of its map",
}


def _initial(config: Config) -> Variable:
    bound = config.rear_actuator.angle_max
    return Variable(
        "initial_rear_angle_rad",
        "initial_rear_angle",
        "real",
        "fixed",
        f"angle of the {_REAR}, that the controller starts from",
        unit=RAD,
        start=0.0,
        low=-bound,
        high=bound,
    )


GROUP = "parameters"

_COUNTS = 65535.0


def parameter_variables(software: Software) -> tuple[Variable, ...]:
    """Return every number of `<prefix>_parameters_t`, array elements one by one (from 1), with the build's value as start.

    A field whose type no variable can have, such as a pointer, keeps the value of the build. One that only another version of
    the tool knows has neither description nor range.
    """

    known, found, precision = parameters_by_path(software.config), [], software.precision
    struct = software.ffi.typeof(f"{software.prefix}_parameters_t")
    for path, index, kind, value in _numbers(struct, software.function("parameters_default")):
        each, number = known.get(path), f"[{','.join(str(k + 1) for k in index)}]" if index else ""
        meaning, unit = (each.meaning, each.unit) if each else ("", NONE)
        name, member = f"{GROUP}.{path}{number}", f"{GROUP}.{path}{''.join(f'[{k}]' for k in index)}"
        if kind.cname in ("float", "double"):
            low, high = (shortest(each.low, precision), shortest(each.high, precision)) if each else (None, None)
            start = shortest(value, precision)
            found.append(Variable(name, member, "real", "tunable", meaning, kind.cname, unit, start, low, high))
        elif kind.cname == "uint16_t":
            found.append(Variable(name, member, "integer", "tunable", meaning, kind.cname, NONE, float(value), 0.0, _COUNTS))
    return tuple(found)


def _numbers(struct: Any, values: Any, path: str = "") -> Iterator[tuple[str, tuple[int, ...], Any, Any]]:
    """Yield path, index, type and value of every number in a struct, as cffi describes it; `()` where it is in no array."""
    for field, about in struct.fields:
        kind, value = about.type, getattr(values, field)
        if kind.kind == "struct":
            yield from _numbers(kind, value, f"{path}{field}.")
            continue
        shape = []
        while kind.kind == "array":
            shape.append(kind.length)
            kind = kind.item
        for index in np.ndindex(*shape):  # once with an empty index where the field is no array
            yield f"{path}{field}", index, kind, reduce(getitem, index, value)


CHANNEL = "CanChannel"
"""Name of the bus terminal, and prefix of its variables."""
MIME_TYPE = 'application/org.fmi-standard.fmi-ls-bus.can; version="1.0.0"'
BUFFER_BYTES = 2048
"""Largest size of the operations of one event; CAN_BUFFER_SIZE in can_node.h."""
MEMBERS = ("Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data")
"""Members of a bus terminal."""
NOTIFICATIONS = "BusNotifications"
"""Member of the configuration terminal."""

TERMINALS_PATH = "terminalsAndIcons/terminalsAndIcons.xml"
BUS, XCP = "org.fmi-standard.fmi-ls-bus", "org.fmi-standard.fmi-ls-xcp"
DESCRIPTIONS = {
    BUS: "Layered Standard for the simulation of bus communication on a Physical Signal Abstraction or Network Abstraction "
    "based level.",
    XCP: "Layered standard based on FMI 2.0 and FMI 3.0 for describing and implementing XCP support for FMUs, which can either "
    "provide an XCP service or allow direct memory access via A2L files.",
}
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"


def manifest_path(standard: str) -> str:
    """Return the path of a standard's manifest in the archive."""
    return f"extra/{standard}/fmi-ls-manifest.xml"


def terminals() -> bytes:
    """Return terminalsAndIcons.xml with the bus terminal."""
    root = ET.Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    about = {"terminalKind": "org.fmi-ls-bus.network-terminal", "matchingRule": "org.fmi-ls-bus.transceiver", "name": CHANNEL}
    terminal = ET.SubElement(ET.SubElement(root, "Terminals"), "Terminal", about)
    for member in MEMBERS:
        _member(terminal, member)
    kind = "org.fmi-ls-bus.network-terminal.configuration"
    inner = ET.SubElement(terminal, "Terminal", {"terminalKind": kind, "matchingRule": "bus", "name": "Configuration"})
    _member(inner, NOTIFICATIONS)
    return text(root)


def _member(terminal: ET.Element, member: str) -> None:
    named = {"variableKind": "signal", "variableName": f"{CHANNEL}.{member}", "memberName": member}
    ET.SubElement(terminal, "TerminalMemberVariable", named)


def bus_manifest() -> bytes:
    """Return the manifest of FMI-LS-BUS."""
    root = _manifest(BUS)
    root.set("isBusSimulationFMU", "false")
    return text(root)


def xcp_manifest(a2l: str) -> bytes:
    """Return the manifest of FMI-LS-XCP for one A2L, whose addresses an XCP service of the importer uses."""
    root = _manifest(XCP)
    about = {"definition": a2l, "description": "memory of the ECU", "supportsDirectMemoryAccess": "true"}
    ET.SubElement(root, "Interface", about)
    return text(root)


def _manifest(standard: str) -> ET.Element:
    facts = {"name": standard, "version": "1.0.0", "description": DESCRIPTIONS[standard]}
    ET.register_namespace("fmi-ls", _NAMESPACE)
    return ET.Element("fmiLayeredStandardManifest", {f"{{{_NAMESPACE}}}fmi-ls-{key}": value for key, value in facts.items()})


def text(root: ET.Element) -> bytes:
    """Return an XML file."""
    ET.indent(root, "  ")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'.encode()
