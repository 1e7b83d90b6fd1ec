"""The user's own scenarios: a recorded drive (.csv), or a built-in scenario with other values and faults (.toml).

For recordings see `hil_sim.recorded_drives`. A scenario file:

    name = "wet-lane-change"
    base = "sine-with-dwell"
    speed_km_h = 70.0
    friction = 0.6

    [[faults]]                      # where there is any, these take the place of the base's own
    kind = "drop"
    start_s = 1.5
    duration_s = 0.2
    message = "VehicleMotion"
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import AfterValidator, Field, ValidationError

from codegen.configuration import Config, parse_toml
from codegen.configuration.faults import Location, first_fault
from codegen.configuration.section import Range, Section, check_name
from codegen.errors import CodegenError, suggestion
from codegen.files import read_text
from hil_sim import recorded_drives
from hil_sim.faults import FRAME_KINDS, VALUE_KINDS, Fault, FaultKind
from hil_sim.recorded_drives import MAX_DURATION, MIN_DURATION
from hil_sim.scenarios import BUILT_IN, Scenario

MAX_FILE_BYTES, MAX_TOML_BYTES = 64 * 2**20, 2**20


def load(path: Path, config: Config | None = None) -> Scenario:
    """The scenario in a file: .toml, else .csv.

    Args:
        path: of the file.
        config: names the messages and signals that faults may speak of; None takes the default names.

    Raises:
        CodegenError: the first fault, with the file and its line and column, or its key.
    """
    if path.suffix.lower() not in (".csv", ".toml"):
        raise CodegenError("neither .csv nor .toml", where=path, remedy="name a recording or a scenario file")
    limit = MAX_FILE_BYTES if path.suffix.lower() == ".csv" else MAX_TOML_BYTES
    text = read_text(path, limit, "name a .csv or .toml file, or cut it into shorter ones")
    if path.suffix.lower() == ".csv":
        return recorded_drives.parse(text, path)
    return _from_toml(text, path, Config() if config is None else config)


def _remedy(word: str, known: Collection[str]) -> str:
    """Return the nearest known name, or all of them."""
    return suggestion(word, known).lstrip("; ") or f"known: {', '.join(known)}"


def _known_kind(kind: str) -> str:
    if kind not in get_args(FaultKind):
        raise ValueError(f"there is no fault {kind!r}; {_remedy(kind, get_args(FaultKind))}")
    return kind


class FaultLine(Section):
    """A table `[[faults]]`."""

    kind: Annotated[str, AfterValidator(_known_kind)]
    start_s: Annotated[float, Range(0.0, MAX_DURATION, "s")]
    duration_s: Annotated[float, Range(0.001, MAX_DURATION, "s")]
    message: str | None = None
    signal: str | None = None
    cycles: Annotated[int | None, Field(ge=1, le=100)] = None


class ScenarioFile(Section):
    """A scenario file: a built-in scenario, what differs, and faults."""

    name: Annotated[str, AfterValidator(check_name)] | None = None
    base: str
    speed_km_h: Annotated[float, Range(1.0, 400.0, "km/h")] | None = None
    steering_wheel_angle_deg: Annotated[float, Range(-1_500.0, 1_500.0, "deg")] | None = None
    friction: Annotated[float, Range(0.05, 1.5)] | None = None
    friction_estimate: Annotated[float, Range(0.02, 2.0)] | None = None
    duration_s: Annotated[float, Range(MIN_DURATION, MAX_DURATION, "s")] | None = None
    faults: list[FaultLine] | None = None


def _from_toml(text: str, path: Path, config: Config) -> Scenario:
    data = parse_toml(text, path, CodegenError)
    try:
        given = ScenarioFile.model_validate(data)
    except ValidationError as error:
        raise first_fault(error, path, ScenarioFile, CodegenError, _key_of) from None
    if given.base not in BUILT_IN:
        remedy = _remedy(given.base, BUILT_IN)
        raise CodegenError(f"there is no scenario {given.base!r}", where=f"{path}: base", remedy=remedy)
    return _changed(BUILT_IN[given.base], given, path, config)


def with_settings(base: Scenario, settings: Mapping[str, float]) -> Scenario:
    """Return a scenario with other settings, by name (`speed_km_h`).

    Raises:
        CodegenError: the scenario does not take one of them.
    """
    for key in settings:
        _require_adjustable(base, key, f"--{key.replace('_', '-')}")
    return replace(base, settings=replace(base.settings, **settings)) if settings else base


def _require_adjustable(base: Scenario, key: str, where: str) -> None:
    if key not in base.adjustable:
        remedy = f"it takes {', '.join(sorted(base.adjustable))}" if base.adjustable else "it takes none"
        raise CodegenError(f"{base.name} does not take it", where=where, remedy=remedy)


def _name_of(given: ScenarioFile, path: Path) -> str:
    """Return the name in the file, or that of the file itself."""
    if given.name is not None:
        return given.name
    try:
        return check_name(path.stem)
    except ValueError as error:
        what, _, remedy = str(error).partition("; ")
        raise CodegenError(what, where=path, remedy=f"rename the file, or give it a name: {remedy}") from None


def _changed(base: Scenario, given: ScenarioFile, path: Path, config: Config) -> Scenario:
    changes = given.model_dump(exclude_none=True, exclude={"name", "base", "faults"})
    for key in changes:
        _require_adjustable(base, key, f"{path}: {key}")
    name = _name_of(given, path)
    duration = changes.pop("duration_s", base.duration)
    if duration <= base.steer_time + MIN_DURATION:
        raise CodegenError(
            f"{duration:g} s end before {base.name} begins to steer, at {base.steer_time:g} s",
            where=f"{path}: duration_s",
            remedy="make it longer",
        )
    faults = base.faults
    if given.faults is not None:
        faults = tuple(_fault(line, f"{path}: faults {number}", config) for number, line in enumerate(given.faults, start=1))
    for number, fault in enumerate(faults, start=1):
        if fault.start >= duration:
            raise CodegenError(
                f"begins at {fault.start:g} s, and the run ends at {duration:g} s",
                where=f"{path}: faults {number}: start_s",
                remedy="let it begin earlier, or raise duration_s where the base takes it",
            )
    return replace(
        base,
        name=name,
        subject=f"{name} ({base.subject.lower()})",
        what=f"{base.what}, as {path.name} changes it",
        duration=duration,
        settings=replace(base.settings, **changes),
        faults=faults,
    )


def _fault(line: FaultLine, place: str, config: Config) -> Fault:
    """One line as a fault, its keys checked against its kind and the messages of the configuration."""

    def wrong(key: str, what: str, remedy: str) -> CodegenError:
        return CodegenError(what, where=f"{place}: {key}", remedy=remedy)

    of_signal, of_frame = line.kind in VALUE_KINDS, line.kind in FRAME_KINDS
    for key, value, taken, needed in (
        ("message", line.message, of_signal or of_frame, of_signal),
        ("signal", line.signal, of_signal, of_signal),
        ("cycles", line.cycles, line.kind == "delay", line.kind == "delay"),
    ):
        if value is not None and not taken:
            raise wrong(key, f"{line.kind} does not take it", "remove it")
        if value is None and needed:
            raise wrong(key, f"{line.kind} needs it", "add it")
    messages = {message.name: message for message in config.can.messages().values()}
    if line.message is not None and line.message not in messages:
        raise wrong("message", f"there is no message {line.message!r}", f"known: {', '.join(messages)}")
    if line.signal is not None and line.message is not None:
        signals = messages[line.message].signals()
        if line.signal not in signals:
            raise wrong("signal", f"{line.message} has no signal {line.signal!r}", f"known: {', '.join(signals)}")
    kind: Any = line.kind
    return Fault(kind, line.start_s, line.duration_s, line.message, line.signal, line.cycles or 0)


def _key_of(location: Location) -> str:
    """Write a location as a key; [[faults]] are counted from 1, as a user does."""
    return "".join(
        f" {part + 1}" if isinstance(part, int) else f"{': ' if place else ''}{part}" for place, part in enumerate(location)
    )
