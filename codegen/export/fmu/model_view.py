"""View model of the C templates: the model's struct, its table of variables, and its start values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from codegen.configuration import Config
from codegen.configuration.signals import MEASURED
from codegen.emit.text import Precision, literal
from codegen.export.fmu.variables import Role, Variable, Version, What, of_role

TITLES: dict[What, str] = {
    "controller": "the controller",
    "plant": "the car",
    "loop": "the car with the controller, in closed loop",
}

_STORAGE = {
    "": "STORED_DOUBLE",
    "double": "STORED_DOUBLE",
    "float": "STORED_FLOAT",
    "int32_t": "STORED_INT32",
    "uint16_t": "STORED_UINT16",
    "bool": "STORED_BOOL",
}
_LARGEST = {"float": "FLT_MAX", "bool": "1.0"}
_ROLES: dict[Role, str] = {
    "time": "ROLE_TIME",
    "input": "ROLE_INPUT",
    "output": "ROLE_OUTPUT",
    "fixed": "ROLE_FIXED",
    "tunable": "ROLE_TUNABLE",
}


@dataclass(frozen=True)
class Member:
    """A member of the model's struct."""

    declaration: str
    comment: str = ""


@dataclass(frozen=True)
class Group:
    """Members that belong together."""

    title: str
    fields: tuple[Member, ...]


@dataclass(frozen=True)
class Start:
    """A member that does not start at zero."""

    member: str
    value: str


@dataclass(frozen=True)
class ModelView:
    """Everything that model.h and the model's source print."""

    title: str
    headers: tuple[str, ...]
    constants: tuple[tuple[str, int], ...]
    groups: tuple[Group, ...]
    starts: tuple[Start, ...]
    step_size: str


@dataclass(frozen=True)
class Row:
    """A row of the table of variables."""

    name: str
    type: str
    storage: str
    role: str
    offset: str
    low: str
    high: str


def step_size(what: What, config: Config) -> float:
    """Return the step of the model in s: a sample of the controller, or a step of the plant."""
    return config.controller.sampling_time_s if what == "controller" else config.plant.sampling_time_s


def model_view(what: What, config: Config, prefix: str, variables: Sequence[Variable]) -> ModelView:
    """Return the view of one kind of model; `variables` as returned by `variables_of`."""
    plant = what != "controller"
    headers = (("plant.h",) if plant else ()) + ((f"{prefix}_controller.h",) if what != "plant" else ())
    steps = round(config.controller.sampling_time_s / config.plant.sampling_time_s)
    constants = (("SAMPLE_STEPS", steps), ("DELAY_SAMPLES", config.plant.command_delay_samples)) if what == "loop" else ()
    own = [each for each in variables if each.member and "." not in each.member]
    groups = [
        Group("inputs", tuple(_members(of_role(own, "input")))),
        Group("outputs", (*_members(of_role(own, "output")), *([Member("plant_output_t output")] if plant else []))),
    ]
    if what != "plant":
        fixed = _members(of_role(own, "fixed"))
        groups.append(Group("parameters", (*fixed, Member(f"{prefix}_parameters_t parameters"))))
    groups.append(Group("states", _states(what, prefix)))
    starts = (Start(each.member, literal(each.start, "double")) for each in own if each.start and each.kind == "real")
    flags = (Start(each.member, "true") for each in own if each.start and each.kind == "boolean")
    return ModelView(
        TITLES[what], headers, constants, tuple(groups), (*starts, *flags), literal(step_size(what, config), "double")
    )


def _members(variables: Iterable[Variable]) -> tuple[Member, ...]:
    return tuple(Member(f"{each.storage} {each.member}", each.unit) for each in variables)


def _states(what: What, prefix: str) -> tuple[Member, ...]:
    controller = Member(f"{prefix}_controller_t controller")
    if what == "controller":
        return (controller,)
    if what == "plant":
        return (Member("plant_state_t plant"),)
    return (
        Member("plant_state_t plant"),
        controller,
        Member("double waiting[DELAY_SAMPLES + 1]", "rad, newest last: commands that wait to act"),
        Member("double acting", "rad, the command that acts"),
        Member("uint32_t steps_since_sample"),
    )


def rows(variables: Sequence[Variable], version: Version) -> tuple[Row, ...]:
    """Return the table of variables, by value reference."""
    return tuple(_row(each, version) for each in variables)


def _row(variable: Variable, version: Version) -> Row:
    largest = _LARGEST.get(variable.storage, "DBL_MAX")
    smallest = "0.0" if variable.storage == "bool" else f"-{largest}"
    # A parameter may exceed its range here; it is rejected together with all others before the next step.
    bounded = variable.role != "tunable" or variable.kind == "integer"
    low = literal(variable.low, "double") if bounded and variable.low is not None else smallest
    high = literal(variable.high, "double") if bounded and variable.high is not None else largest
    return Row(
        variable.name,
        _type(variable, version),
        _STORAGE[variable.storage],
        _ROLES[variable.role],
        f"offsetof(model_t, {variable.member})" if variable.member else "0u",
        low,
        high,
    )


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
        "measured": MEASURED,
        "what": model_view(what, config, prefix, variables),
    }
