"""A drive that the user recorded, as a scenario.

A CSV with the columns `time_s`, `speed_m_s` and either `steering_wheel_angle_rad` or `front_angle_rad` (of the road wheel; the
former wins); it may have those of OPTIONAL_COLUMNS. Others are not looked at, so a run that this project wrote works as it is.
Its first row is time zero.
"""

from __future__ import annotations

import csv
import difflib
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.configuration.section import Range
from codegen.errors import CodegenError
from hil_sim.manoeuvres import Columns, Settings
from hil_sim.scenarios import Scenario

FloatArray = npt.NDArray[np.float64]

MAX_DURATION = 3600.0
"""s of a recorded drive."""
MIN_DURATION = 0.1

STEERING_COLUMNS = ("steering_wheel_angle_rad", "front_angle_rad")
OPTIONAL_COLUMNS = ("friction", "friction_estimate", "yaw_moment_n_m", "inhibit")
"""Peak friction of the road; what the controller is told of it (empty or nan: nothing); N m; 0 or 1 (ESC or ABS acts)."""

RANGES = {
    "time_s": Range(-1e9, 1e9, "s"),
    "speed_m_s": Range(0.0, 150.0, "m/s"),
    "steering_wheel_angle_rad": Range(-30.0, 30.0, "rad"),
    "front_angle_rad": Range(-1.1, 1.1, "rad"),
    "friction": Range(0.05, 1.5),
    "friction_estimate": Range(0.0, 2.0),
    "yaw_moment_n_m": Range(-1e6, 1e6, "N m"),
    "inhibit": Range(0.0, 1.0),
}


@dataclass(frozen=True)
class Recording:
    """Columns of a recorded drive by their names, each (rows,); time starts at zero."""

    columns: Mapping[str, FloatArray]

    def drive(self, config: Config, settings: Settings, time: FloatArray) -> Columns:
        """A manoeuvre (see `hil_sim.manoeuvres`): values between rows linearly, the flag as it last was."""
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
            row = np.searchsorted(recorded, time + 1e-9, side="right") - 1
            driven["inhibit"] = self.columns["inhibit"][np.maximum(row, 0)]
        return driven


def parse(text: str, path: Path) -> Scenario:
    """The scenario of a recorded drive.

    Args:
        text: of the file.
        path: for its name and for errors.

    Raises:
        CodegenError: the first fault, with its line and column.
    """
    columns = _columns(text, path)
    time = columns["time_s"]
    # The last row is held for one more interval, so that a run comes out as long as it was; not for a gap's length.
    duration = float(time[-1] + min(np.median(np.diff(time)), MIN_DURATION))
    if not MIN_DURATION <= float(time[-1]) <= MAX_DURATION:
        raise CodegenError(
            f"{time[-1]:.6g} s long, {MIN_DURATION:g} to {MAX_DURATION:g} s are taken",
            where=f"{path}, column time_s",
            remedy="check that time is in seconds, or cut the recording",
        )
    return Scenario(
        name=path.name,
        subject=f"Recording {path.name}",
        what="a recorded drive",
        source=str(path),
        duration=duration,
        steer_time=0.0,
        kind="recording",
        drive=Recording(columns).drive,
        adjustable=frozenset(),
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
        raise CodegenError(f"not CSV ({error})", where=f"{path}, line {reader.line_num}", remedy="mend that line") from None
    if len(values["time_s"]) < 2:
        raise CodegenError(f"{len(values['time_s'])} rows, at least 2 are needed", where=path, remedy="record a drive")
    columns = {name: np.array(numbers) for name, numbers in values.items()}
    columns["time_s"] -= columns["time_s"][0]
    return columns


def _wanted(header: Sequence[str], path: Path) -> dict[str, int]:
    """The columns that are taken, with their places."""
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
    remedy = f"is it {near[0]!r}? units stand in the names" if near else "add it; units stand in the names"
    return CodegenError(f"no column {name}", where=place, remedy=remedy)


def _take_row(
    cells: Sequence[str], wanted: Mapping[str, int], values: Mapping[str, list[float]], place: str, width: int
) -> None:
    if len(cells) != width:
        raise CodegenError(f"{len(cells)} values, {width} columns", where=place, remedy="mend that line")
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
        raise CodegenError(f"not a number: {text[:40]!r}", where=place, remedy="mend the number") from None
    try:
        RANGES[name].check(value)
        if name == "inhibit" and value not in (0.0, 1.0):
            raise ValueError(f"{value:g} is neither 0 nor 1; write 1 where ESC or ABS acts")
    except ValueError as error:
        what, _, remedy = str(error).partition("; ")
        raise CodegenError(what, where=place, remedy=remedy) from None
    return value
