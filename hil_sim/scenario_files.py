"""User scenarios: a recorded drive (.csv), or a built-in scenario with other values and faults (.toml).

A scenario file:

    name = "wet-lane-change"
    base = "sine-with-dwell"
    speed_km_h = 70.0
    friction = 0.6

    [[faults]]                      # if given, these replace those of the base
    kind = "drop"
    start_s = 1.5
    duration_s = 0.2
    message = "VehicleMotion"
"""

from __future__ import annotations

import csv
import difflib
import io
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
from pydantic import AfterValidator, Field, ValidationError

from codegen.arrays import FloatArray
from codegen.configuration import Config, parse_toml, preset
from codegen.configuration.section import Location, Range, Section, check_name, first_fault
from codegen.errors import CodegenError, parts_of, suggestion
from codegen.files import read_text
from codegen.sil.software import RECORD_COLUMNS
from hil_sim.faults import ADDED_KINDS, FRAME_KINDS, VALUE_KINDS, Fault, FaultKind
from hil_sim.manoeuvres import Columns
from hil_sim.scenarios import BUILT_IN, Scenario
from hil_sim.settings import SPEED_RANGE_KM_H, STEERING_WHEEL_ANGLE_RANGE_DEG, Settings

RECORDING_BYTES_MAX, SCENARIO_BYTES_MAX = 64 * 2**20, 2**20


def find(name: str, config: Config | None = None) -> Scenario:
    """Return the built-in scenario called `name`, or the one in a file (.csv: a recording, .toml: a scenario file).

    Args:
        name: of a built-in scenario, or a path.
        config: configuration with the messages that faults of a scenario file may name; None uses the default names.

    Raises:
        CodegenError: there is no such scenario (with the nearest name), or the first error in the file.
    """
    if name in BUILT_IN:
        return BUILT_IN[name]
    if Path(name).suffix.lower() in (".csv", ".toml") or "/" in name or "\\" in name:
        return load(Path(name), config)
    raise CodegenError(
        f"there is no scenario {name!r}",
        where="`scenario=`",
        remedy=f"known: {', '.join(BUILT_IN)}, or a .csv or .toml file{suggestion(name, BUILT_IN)}",
    )


def load(path: Path, config: Config | None = None) -> Scenario:
    """Read a scenario file: .toml, else .csv.

    Args:
        path: of the file.
        config: configuration with the messages and signals that faults may name; None uses the default names.

    Raises:
        CodegenError: the first error, with the file and its line and column, or its key.
    """
    if path.suffix.lower() not in (".csv", ".toml"):
        raise CodegenError("neither .csv nor .toml", where=path, remedy="name a recording or a scenario file")
    limit = RECORDING_BYTES_MAX if path.suffix.lower() == ".csv" else SCENARIO_BYTES_MAX
    text = read_text(path, limit, "name a .csv or .toml file", smaller="cut it into shorter ones")
    if path.suffix.lower() == ".csv":
        return _from_csv(text, path)
    return _from_toml(text, path, config or preset())


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
    amount: Annotated[float, Range(-1_000.0, 1_000.0, "SI unit of the signal")] | None = None


class ScenarioFile(Section):
    """A scenario file: a built-in scenario, what differs, and faults."""

    name: Annotated[str, AfterValidator(check_name)] | None = None
    base: str
    speed_km_h: Annotated[float, Range(*SPEED_RANGE_KM_H, "km/h")] | None = None
    steering_wheel_angle_deg: Annotated[float, Range(*STEERING_WHEEL_ANGLE_RANGE_DEG, "deg")] | None = None
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
        _require_adjustable(base, key, f"`{key}=`")
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
        what, remedy = parts_of(error)
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
                remedy="let it begin earlier, or raise duration_s if the base supports it",
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
    """Return a line as a fault after checking its keys against its kind and the messages of the configuration."""

    def wrong(key: str, what: str, remedy: str) -> CodegenError:
        return CodegenError(what, where=f"{place}: {key}", remedy=remedy)

    of_signal, of_frame = line.kind in VALUE_KINDS, line.kind in FRAME_KINDS
    for key, value, taken, needed in (
        ("message", line.message, of_signal or of_frame, of_signal),
        ("signal", line.signal, of_signal, of_signal),
        ("cycles", line.cycles, line.kind == "delay", line.kind == "delay"),
        ("amount", line.amount, line.kind in ADDED_KINDS, line.kind in ADDED_KINDS),
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
    return Fault(kind, line.start_s, line.duration_s, line.message, line.signal, line.cycles or 0, line.amount or 0.0)


def _key_of(location: Location) -> str:
    """Write a location as a key; [[faults]] are counted from 1, as a user does."""
    return "".join(
        f" {part + 1}" if isinstance(part, int) else f"{': ' if place else ''}{part}" for place, part in enumerate(location)
    )


MAX_DURATION = 3600.0
"""Largest duration of a recorded drive, in s."""
MIN_DURATION = 0.1

STEERING_COLUMNS = ("steering_wheel_angle_rad", "front_angle_rad")
OVERRIDE_COLUMN = "rear_angle_override_rad"
OPTIONAL_COLUMNS = ("friction", "friction_estimate", "yaw_moment_n_m", "inhibit", OVERRIDE_COLUMN)
"""Optional columns: peak friction of the road; friction estimate for the controller (empty or nan: unknown); yaw moment in
N m; 0 or 1 (ESC or ABS acts); rear angle command that replaces the controller's."""

RANGES = {
    "time_s": Range(-1e9, 1e9, "s"),
    "speed_m_s": Range(0.0, 150.0, "m/s"),
    "steering_wheel_angle_rad": Range(-30.0, 30.0, "rad"),
    "front_angle_rad": Range(-1.1, 1.1, "rad"),
    "friction": Range(0.05, 1.5),
    "friction_estimate": Range(0.0, 2.0),
    "yaw_moment_n_m": Range(-1e6, 1e6, "N m"),
    "inhibit": Range(0.0, 1.0),
    OVERRIDE_COLUMN: Range(-1.1, 1.1, "rad"),
}


@dataclass(frozen=True)
class Recording:
    """Columns of a recorded drive by their names, each (rows,); time starts at zero."""

    columns: Mapping[str, FloatArray]

    def drive(self, config: Config, settings: Settings, time: FloatArray) -> Columns:
        """Return the inputs (see `hil_sim.manoeuvres`): values are interpolated linearly, the flag is held."""
        del settings
        recorded = self.columns["time_s"]

        def resampled(name: str) -> FloatArray:
            return np.interp(time, recorded, self.columns[name])

        wheel, front = STEERING_COLUMNS
        steering = resampled(wheel) if wheel in self.columns else resampled(front) * config.steering.ratio
        driven: dict[str, FloatArray] = {"speed": resampled("speed_m_s"), "steering_wheel_command": steering}
        for name, column in (
            ("friction", "friction"),
            ("friction_estimate", "friction_estimate"),
            ("yaw_moment", "yaw_moment_n_m"),
        ):
            if column in self.columns:
                driven[name] = resampled(column)
        if "inhibit" in self.columns:
            driven["inhibit"] = self.held("inhibit", time)
        return driven

    def held(self, name: str, time: FloatArray) -> FloatArray:
        """Return the values of a column at times (n,) in s; each row holds until the next one."""
        row = np.searchsorted(self.columns["time_s"], time + 1e-9, side="right") - 1
        return self.columns[name][np.maximum(row, 0)]


def _from_csv(text: str, path: Path) -> Scenario:
    """Return the scenario of a recorded drive.

    Args:
        text: of the file.
        path: for its name and for errors.

    Raises:
        CodegenError: the first error, with its line and column.
    """
    return _of_columns(_columns(text, path), path)


def of_run(record: FloatArray, path: Path) -> Scenario:
    """Return the scenario of a run: its speed and steering as a recorded drive.

    Args:
        record: (samples, columns), RECORD_COLUMNS.
        path: for its name and for errors.

    Raises:
        CodegenError: the first value outside its range, with its sample and column.
    """
    columns: dict[str, FloatArray] = {}
    for name in ("time_s", "speed_m_s", STEERING_COLUMNS[1]):
        values = record[:, RECORD_COLUMNS.index(name)]
        for sample in np.flatnonzero(~((values >= RANGES[name].low) & (values <= RANGES[name].high)))[:1]:
            _check_range(float(values[sample]), name, f"{path}, sample {sample + 1}, column {name}")
        columns[name] = values - values[0] if name == "time_s" else values
    return _of_columns(columns, path)


def _of_columns(columns: Mapping[str, FloatArray], path: Path) -> Scenario:
    time = columns["time_s"]
    # The last row is held for one more interval, so that the run has its recorded length; not for the length of a gap.
    duration = float(time[-1] + min(np.median(np.diff(time)), MIN_DURATION))
    if not MIN_DURATION <= float(time[-1]) <= MAX_DURATION:
        raise CodegenError(
            f"{time[-1]:.6g} s long, {MIN_DURATION:g} to {MAX_DURATION:g} s are taken",
            where=f"{path}, column time_s",
            remedy="check that time is in seconds, or cut the recording",
        )
    recording = Recording(columns)
    return Scenario(
        name=path.name,
        subject=f"Recording {path.name}",
        what="a recorded drive",
        source=str(path),
        duration=duration,
        steer_time=0.0,
        kind="recording",
        drive=recording.drive,
        adjustable=frozenset(),
        rear_angle=partial(recording.held, OVERRIDE_COLUMN) if OVERRIDE_COLUMN in columns else None,
    )


def _columns(text: str, path: Path) -> dict[str, FloatArray]:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    wanted: dict[str, int] = {}
    values: dict[str, list[float]] = {}
    try:
        header = next(reader, [])
        wanted = _wanted(header, path)
        values = {name: [] for name in wanted}
        for cells in reader:
            if any(cell.strip() for cell in cells):
                _take_row(cells, wanted, values, f"{path}, line {reader.line_num}", len(header))
    except csv.Error as error:
        raise CodegenError(f"not CSV ({error})", where=f"{path}, line {reader.line_num}", remedy="correct that line") from None
    if len(values["time_s"]) < 2:
        raise CodegenError(f"{len(values['time_s'])} rows, at least 2 are needed", where=path, remedy="record a drive")
    columns = {name: np.array(numbers) for name, numbers in values.items()}
    columns["time_s"] -= columns["time_s"][0]
    return columns


def _wanted(header: Sequence[str], path: Path) -> dict[str, int]:
    """Return the places of the columns used."""
    place = f"{path}, line 1"
    names = [name.strip() for name in header]
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise CodegenError(
            "columns are separated by something other than commas", where=place, remedy="separate them by commas"
        )
    known = ["time_s", "speed_m_s", *STEERING_COLUMNS, *OPTIONAL_COLUMNS]
    if twice := next((name for name in names if name in known and names.count(name) > 1), None):
        raise CodegenError(f"two columns {twice}", where=place, remedy="remove one")
    for name in ("time_s", "speed_m_s"):
        if name not in names:
            raise _missing(name, names, place)
    steering = next((name for name in STEERING_COLUMNS if name in names), None)
    if steering is None:
        raise _missing(" or ".join(STEERING_COLUMNS), names, place)
    taken = ["time_s", "speed_m_s", steering, *(name for name in OPTIONAL_COLUMNS if name in names)]
    return {name: names.index(name) for name in taken}


def _missing(name: str, names: Iterable[str], place: str) -> CodegenError:
    near = difflib.get_close_matches(name.split(" or ")[0], list(names), n=1)
    remedy = f"is it {near[0]!r}? units are in the names" if near else "add it; units are in the names"
    return CodegenError(f"no column {name}", where=place, remedy=remedy)


def _take_row(
    cells: Sequence[str], wanted: Mapping[str, int], values: Mapping[str, list[float]], place: str, width: int
) -> None:
    if len(cells) != width:
        raise CodegenError(f"{len(cells)} values, {width} columns", where=place, remedy="correct that line")
    for name, index in wanted.items():
        value = _number(cells[index], name, f"{place}, column {name}")
        if name == "time_s" and values[name] and not value > values[name][-1]:
            raise CodegenError(
                f"time does not increase: {value:.9g} after {values[name][-1]:.9g}",
                where=f"{place}, column time_s",
                remedy="sort the rows and remove those of equal time",
            )
        values[name].append(value)


def _number(cell: str, name: str, place: str) -> float:
    text = cell.strip()
    if name == "friction_estimate" and text.lower() in ("", "nan"):
        return math.nan
    try:
        value = float(text)
    except ValueError:
        raise CodegenError(f"not a number: {text[:40]!r}", where=place, remedy="correct the number") from None
    _check_range(value, name, place)
    return value


def _check_range(value: float, name: str, place: str) -> None:
    try:
        RANGES[name].check(value)
        if name == "inhibit" and value not in (0.0, 1.0):
            raise ValueError(f"{value:g} is neither 0 nor 1; write 1 where ESC or ABS acts")
    except ValueError as error:
        what, remedy = parts_of(error)
        raise CodegenError(what, where=place, remedy=remedy) from None
