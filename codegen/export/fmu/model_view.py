"""View of the C of a model in an FMU: files, members, constants and table of variables that the templates print."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from codegen.configuration import Config
from codegen.configuration.can import NODES
from codegen.emit.can_view import CanView, task_view
from codegen.emit.text import Precision, literal
from codegen.export.fmu.variables import WITH_BUS, Role, Variable, Version, What
from codegen.sil.software import COUNTERS

MODEL_TITLES: dict[What, str] = {
    "controller": "the controller",
    "plant": "the car",
    "loop": "the car with the controller, in closed loop",
    "ecu": "the ECU with its task on a CAN bus",
    "bus_plant": "the car on a CAN bus",
}

_STORAGE = {
    "": "STORED_DOUBLE",
    "double": "STORED_DOUBLE",
    "float": "STORED_FLOAT",
    "int32_t": "STORED_INT32",
    "uint16_t": "STORED_UINT16",
    "bool": "STORED_BOOL",
    "elsewhere": "STORED_ELSEWHERE",
}
_LARGEST = {"float": "FLT_MAX", "bool": "1.0"}


HEADERS: Mapping[What, Sequence[str]] = {
    "controller": ("controller.h",),
    "plant": (),
    "loop": ("controller.h",),
    "ecu": ("task.h",),
    "bus_plant": ("can.h", "e2e.h"),
}
"""Headers of a build, without their prefix, that a model includes."""

_OF_THE_BUS = ("can", "e2e", "supervision", "task")
_APART = ("dynamics", "selftest")
"""Units of a build that no other unit includes."""


def uses_unit(what: What, unit: str) -> bool:
    """Return whether a model needs a unit of a build, named without the prefix."""
    if what in ("plant", "bus_plant"):
        return what == "bus_plant" and unit in ("sections", "can", "e2e")
    return unit not in (_APART if what == "ecu" else (*_APART, *_OF_THE_BUS))


def step_size(what: What, config: Config) -> float:
    """Return the step of the model in s: a sample of the controller, or a step of the plant (also for the clock of an ECU)."""
    return config.controller.sampling_time_s if what == "controller" else config.plant.sampling_time_s


def _model(what: What, config: Config, prefix: str, variables: Sequence[Variable]) -> dict[str, object]:
    """Return what model.h and the model's source print of one kind of model.

    `groups` has the members of the struct, each with its declaration and comment; `starts` those that do not start at zero.
    """
    has_plant, has_controller = what in ("plant", "loop", "bus_plant"), what in ("controller", "loop")
    steps = round(config.controller.sampling_time_s / config.plant.sampling_time_s)
    named = [each for each in variables if each.member and "." not in each.member]
    own = [f"{prefix}_{header}" for header in HEADERS[what]]
    clock, interval, shift = _periodic_clock(variables)
    numbers = {
        **({"actuator_return_step": _return_step(config)} if what == "bus_plant" else {}),
        **({"periodic_clock_interval": interval, "periodic_clock_shift": shift} if what in WITH_BUS else {}),
    }

    def members(role: Role) -> list[tuple[str, str]]:
        return [(f"{each.storage} {each.member}", each.unit.symbol) for each in named if each.role == role]

    groups = {
        "inputs": members("input"),
        "outputs": [*members("output"), *([("plant_output_t output", "")] if has_plant else [])],
        **({"parameters": members("fixed")} if what == "ecu" else {}),
        **({"parameters": [*members("fixed"), (f"{prefix}_parameters_t parameters", "")]} if has_controller else {}),
        "states": [
            *([("plant_state_t plant", "")] if has_plant else []),
            *([(f"{prefix}_controller_t controller", "")] if has_controller else []),
            *_STATES.get(what, ()),
            *([(f"{prefix}_task_t task", "")] if what == "ecu" else []),
            *([(f"{prefix}_e2e_receiver_t receiver", "")] if what == "bus_plant" else []),
            *([("can_node_t node", "")] if what in WITH_BUS else []),
        ],
    }
    return {
        "title": MODEL_TITLES[what],
        "headers": [*(["plant.h"] if has_plant else []), *own, *(["can_node.h"] if what in WITH_BUS else [])],
        "constants": {**_constants(what, config, steps), **({"PERIODIC_CLOCK": clock} if what in WITH_BUS else {})},
        "numbers": {name: literal(value, "double") for name, value in numbers.items()},
        "has_bus": what in WITH_BUS,
        "is_single": what == "ecu",
        "groups": groups,
        "starts": {
            **{each.member: literal(each.start, "double") for each in named if each.start and each.kind == "real"},
            **{each.member: "true" for each in named if each.start and each.kind == "boolean"},
        },
        "step_size": literal(step_size(what, config), "double"),
    }


def _periodic_clock(variables: Sequence[Variable]) -> tuple[int, float, float]:
    """Return value reference, interval and shift (s) of the periodic clock; without one, a value reference of no variable."""
    for reference, each in enumerate(variables):
        if each.interval is not None:
            return reference, each.interval, each.shift
    return len(variables), 0.0, 0.0


_STATES: Mapping[What, Sequence[tuple[str, str]]] = {
    "loop": (
        ("double waiting[DELAY_SAMPLES + 1]", "rad, newest last: commands that wait to act"),
        ("double acting", "rad, the command that acts"),
        ("uint32_t steps_since_sample", ""),
    ),
    "ecu": (("uint32_t steps_to_task", "until the task runs; by the periodic clock: until it may"),),
    "bus_plant": (
        ("plant_input_t held", "inputs of the present step"),
        ("double waiting[DELAY_STEPS + 1]", "rad, newest last: commands that wait to act"),
        ("uint32_t steps_since_sample", ""),
        ("uint32_t silent_cycles", "without a good command"),
        ("uint8_t motion_counter", ""),
        ("uint8_t conditions_counter", ""),
        ("bool is_heard", "a command came in this cycle, good or not"),
        ("bool is_fresh", "a good command came in this cycle"),
    ),
}


def _constants(what: What, config: Config, steps: int) -> dict[str, int]:
    """Return the whole numbers of model.h; `steps`: of the plant in a sample."""
    if what == "loop":
        return {"SAMPLE_STEPS": steps, "DELAY_SAMPLES": config.plant.command_delay_samples}
    if what == "ecu":
        return {"SAMPLE_STEPS": steps}
    if what == "bus_plant":
        return {
            "SAMPLE_STEPS": steps,
            "DELAY_STEPS": config.plant.command_delay_samples * steps,
            "ACTUATOR_RETURNS": int(config.rear_actuator.on_command_loss == "return"),
            "SILENT_CYCLES_MAX": config.rear_actuator.command_loss_samples_max,
        }
    return {}


def _return_step(config: Config) -> float:
    """Return the movement in rad of an actuator without commands in a sample."""
    return math.radians(config.rear_actuator.return_rate_deg_s) * config.controller.sampling_time_s


RESTART_BITS = 128 * 11
"""Bit times until a node leaves bus off, of ISO 11898-1."""


def _bus(what: What, config: Config, precision: Precision) -> dict[str, int]:
    """Return the constants of the node on the bus; a data bit rate of zero is that of classical CAN."""
    sender = NODES[1] if what == "ecu" else NODES[0]
    can = config.can
    bit_rate = round(can.bitrate_kbit_s * 1e3)
    return {
        "CAN_BIT_RATE": bit_rate,
        "CAN_DATA_BIT_RATE": round((can.data_bitrate_kbit_s or 0.0) * 1e3),
        "CAN_IS_EXTENDED": int(can.extended_ids),
        "CAN_FRAME_BYTES": can.frame_bytes,
        "CAN_MAILBOXES": sum(each.sender == sender for each in CanView(config, precision).messages),
        "CAN_RESTART_STEPS": math.ceil(RESTART_BITS / bit_rate / config.plant.sampling_time_s),
    }


def row(variable: Variable, version: Version) -> dict[str, str]:
    """Return a row of the table of variables."""
    largest = _LARGEST.get(variable.storage, "DBL_MAX")
    smallest = "0.0" if variable.storage == "bool" else f"-{largest}"
    # A parameter may exceed its range here; it is rejected together with all others before the next step.
    bounded = variable.role != "tunable" or variable.kind == "integer"
    return {
        "name": variable.name,
        "type": _type(variable, version),
        "storage": _STORAGE[variable.storage],
        "role": f"ROLE_{variable.role.upper()}",
        "offset": f"offsetof(model_t, {variable.member})" if variable.member else "0u",
        "low": literal(variable.low, "double") if bounded and variable.low is not None else smallest,
        "high": literal(variable.high, "double") if bounded and variable.high is not None else largest,
    }


def _type(variable: Variable, version: Version) -> str:
    if variable.kind == "status":  # FMI 2.0 gets enumerations as integers
        return "TYPE_INTEGER" if version == "2" else "TYPE_ENUMERATION"
    return f"TYPE_{variable.kind.upper()}"


def context(what: What, config: Config, prefix: str, precision: Precision, variables: Sequence[Variable]) -> dict[str, object]:
    """Return the context of the templates of the model."""
    return {
        "build": {"prefix": prefix, "PREFIX": prefix.upper()},
        "real": "float" if precision == "single" else "double",
        "zero": literal(0.0, precision),
        "measured": config.can.measured,
        "task": task_view(config),
        "counters": COUNTERS,
        "bus": _bus(what, config, precision) if what in WITH_BUS else {},
        "what": _model(what, config, prefix, variables),
    }
