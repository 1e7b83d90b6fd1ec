"""Identification of a car from measured drives, and the drives that determine it best."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from codegen.configuration import Config, load, parse
from codegen.emit.folder import Folder, check_output, refuse_folder
from codegen.emit.write import check_target, write_folder
from codegen.errors import CodegenError, within
from codegen.files import write_atomically, write_together
from codegen.identify import plan_output, summary
from codegen.identify.drive import refuse_contradictions
from codegen.identify.drive_plan import DrivePlan as Plan
from codegen.identify.drive_plan import plan_drives as choose_drives
from codegen.identify.drive_plan import signals_of
from codegen.identify.names import load_names
from codegen.identify.outcome import Outcome, identify_and_predict
from codegen.identify.plan_output import MANIFEST_WHAT
from codegen.identify.reading import Reading
from codegen.identify.reading import read_drives as read
from codegen.identify.result import identified_toml
from codegen.importing.toml_edit import with_text
from codegen.library.configurations import ConfigLike, known_config, name_of
from codegen.library.logs import names_of, paths_of
from codegen.library.result import PathLike, Progress, Result, Work, path_of, public
from codegen.logs.account import to_dict
from codegen.report.html.identify import data_section, identify_sections, plan_sections
from codegen.report.html.page import render, require_plotly
from codegen.text import text_table

ACCELERATION_DEFAULT, DURATION_DEFAULT = 4.0, 180.0
"""Limits of planned drives: m/s^2, the range in which the car is about linear; and s."""

Paths = PathLike | Sequence[PathLike]


class Drives(Result):
    """Drives that were read: their signals with their sources, and what was found in them.

    Attributes:
        names: names of the drives.
        findings: gaps, offsets, faults.
        names_toml: text of a names.toml that gives the same reading.
    """

    def __init__(self, reading: Reading, channel: str | None, is_named: bool) -> None:
        self.reading, self._is_named = reading, is_named
        self.names = tuple(drive.name for drive in reading.drives)
        self.findings = tuple(map(str, reading.findings))
        self.names_toml = ("" if channel is None else f'channel = "{channel}"\n') + reading.names_toml

    def lines(self) -> Iterator[str]:
        """Yield the sources of all signals, and the findings."""
        for drive in self.reading.drives:
            duration = float(drive.time[-1] - drive.time[0])
            yield f"{drive.name}: {duration:.1f} s, {drive.time.size} steps of {1e3 * (drive.time[1] - drive.time[0]):g} ms"
        yield from ("", text_table(summary.SIGNAL_HEADER, summary.signal_rows(self.reading), left=4), "")
        if self.reading.findings:
            yield text_table(summary.FINDING_HEADER, summary.finding_rows(self.reading), left=5)
        else:
            yield "no findings"
        if not self._is_named:
            yield from ("", "names.toml of these signals:", "", self.names_toml.rstrip())

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts."""
        return reading_as_json(self.reading)


def reading_as_json(reading: Reading) -> dict[str, Any]:
    """Return drives and findings as JSON values."""
    drives = [
        {
            "name": drive.name,
            "duration_s": float(drive.time[-1] - drive.time[0]),
            "step_s": float(drive.time[1] - drive.time[0]),
            "signals": {key: dataclasses.asdict(source) for key, source in sources.items()},
            "account": to_dict(account),
        }
        for drive, sources, account in zip(reading.drives, reading.sources, reading.accounts, strict=True)
    ]
    return {"drives": drives, "findings": [dataclasses.asdict(each) for each in reading.findings]}


def drives_of(logs: Paths) -> tuple[Path, ...]:
    """Return the paths of measured drives. Raises CodegenError if there is none."""
    if places := paths_of(logs, "a log"):
        return places
    raise CodegenError("no drive is named", where="`logs=`", remedy="name a measured drive")


@public
def read_drives(
    logs: Paths,
    dbc: Paths = (),
    *,
    channel: str | None = None,
    signals: PathLike | None = None,
    progress: Progress | None = None,
) -> Drives:
    """Read logs of drives and report what was found in them. Arguments and errors are those of `log`."""
    places, names = drives_of(logs), names_of(signals, channel)
    with Work(progress).status(f"reading {', '.join(path.name for path in places)}"):
        reading = read(places, paths_of(dbc, "a database"), names)
    return Drives(reading, channel, signals is not None)


class Identification(Result):
    """A car identified from measured drives.

    Attributes:
        config: the configuration with the identified values, and their standard deviations in `[identified]`.
        text: the same as ars.toml; comments of the original are kept.
        drives: the drives and what was found in them.
        doubts: doubts about the result.
        written: files by kind that were written.
    """

    def __init__(self, text: str, where: str, drives: Drives, outcome: Outcome) -> None:
        self.text = identified_toml(outcome.found, text, where, outcome.doubts)
        self.drives, self._outcome, self.doubts = drives, outcome, outcome.doubts
        self.config: Config = parse(tomllib.loads(self.text), where)
        self.warnings = (*drives.findings, *(f"in doubt: {doubt}" for doubt in outcome.doubts))
        self.notes = (*self._doubt_notes("it"), *outcome.found.notes)
        if not outcome.is_held_out:
            self.notes += ("no drive was held out; the errors are those of the drives that were fitted",)
        self.written: dict[str, str | None] = {"output": None, "report": None}

    def _doubt_notes(self, name: str) -> tuple[str, ...]:
        until = "until it has identified.doubts_accepted = true"
        return (f"tune, solve with `share=` and sweep with `measured=` refuse {name} {until}",) if self.doubts else ()

    def save(self, path: PathLike, report: PathLike | None = None) -> None:
        """Write the ars.toml, and with it an HTML report if it has a path. Raises CodegenError."""
        place = path_of(path, "the path of an ars.toml")
        check_output(place, ".toml")
        contents = {place: self.text.encode("utf-8")}
        if report is not None:
            page = path_of(report, "the path of a report")
            check_output(page, ".html")
            parsed = parse(tomllib.loads(self.text), place)
            sections = [*identify_sections(self._outcome, parsed), data_section(self.drives.reading)]
            contents[page] = render("Identification", sections)
        write_together(contents)
        self.written = {"output": str(path), "report": None if report is None else str(report)}
        if self.doubts:
            self.notes = (*self._doubt_notes(place.name), *self.notes[1:])

    def lines(self) -> Iterator[str]:
        """Yield the quantities with their deviations, what the drives reached, and how well they are predicted."""
        outcome = self._outcome
        found, validations = outcome.found, outcome.validations
        rows = summary.quantity_rows(found)
        yield text_table(summary.QUANTITY_HEADER[:-1], [row[:-1] for row in rows])
        if missing := [(row[0], row[-1]) for row in rows if row[-1]]:
            yield from ("", *(f"{name}: {note}" for name, note in missing))
        if together := [direction.text for direction in found.directions if len(direction.components) > 1]:
            yield from ("", "not told apart by these drives:", *(f"  {text}" for text in together))
        yield from ("", *summary.reached_lines(outcome), "")
        yield text_table(summary.VALIDATION_HEADER, summary.validation_rows(validations), left=2)
        yield summary.whiteness_line(validations)
        if self.written["output"] is not None:
            yield from ("", f"written: {self.written['output']}")
        if self.written["report"] is not None:
            yield f"report: {self.written['report']}"

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts, and those of the drives."""
        return {**self.drives.to_dict(), **summary.to_dict(self._outcome), **self.written}


@public
def identify(
    config: ConfigLike,
    logs: Paths,
    *,
    hold_out: Paths = (),
    dbc: Paths = (),
    channel: str | None = None,
    signals: PathLike | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify tyres, yaw inertia, steering and rear actuator of a car from measured drives.

    A quantity that the drives do not determine keeps its configured value, and the missing manoeuvre is named.

    Args:
        config: the car with known values, and a guess of the others, or the path of its ars.toml.
        logs: measured drives: .mf4, .blf, .asc, .log (candump), .csv or .parquet.
        hold_out: drives that are only predicted, to validate the result.
        dbc, channel, signals: as for `log`.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: a file cannot be read, the drives contradict each other, or nothing can be identified.
    """
    given, fitted, held = known_config(config), drives_of(logs), paths_of(hold_out, "a log")
    work, names = Work(progress, "reading", "identifying"), names_of(signals, channel)
    known, text = with_text(given)
    with work.status("reading", f"reading {', '.join(path.name for path in (*fitted, *held))}"):
        reading = read([*fitted, *held], paths_of(dbc, "a database"), names)
    refuse_contradictions(reading.findings)
    with within(", ".join(map(str, fitted))), work.status("identifying"):
        outcome = identify_and_predict(known, reading.drives[: len(fitted)], reading.drives[len(fitted) :])
    return Identification(text, name_of(given), Drives(reading, channel, signals is not None), outcome)


class DrivePlan(Result):
    """A measurement programme: drives that determine the configured car best. `names` lists them."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self.names = plan, tuple(plan.names)
        self._facts = plan_output.to_dict(plan)
        self.written: dict[str, str | None] = {"folder": None, "report": None}

    def save(self, folder: PathLike, report: PathLike | None = None) -> None:
        """Write the drives as scenarios of the bench, and an HTML report if it has a path. Raises CodegenError."""
        place = path_of(folder, "a folder")
        refuse_plan_folder(place)
        write_folder(Folder(plan_output.files_of(self._plan), {"what": MANIFEST_WHAT, "plan": self._facts}), place)
        if report is not None:
            page = path_of(report, "the path of a report")
            check_output(page, ".html")
            write_atomically(page, render("Measurement programme", plan_sections(self._plan)))
        self.written = {"folder": str(folder), "report": None if report is None else str(report)}

    def lines(self) -> Iterator[str]:
        """Yield the drives, and the standard deviations to expect."""
        plan = self._plan
        yield from (text_table(plan_output.DRIVE_HEADER, plan_output.drive_rows(plan), left=2), "")
        yield text_table(plan_output.PREDICTED_HEADER, plan_output.predicted_rows(plan))
        if lines := plan_output.need_lines(plan):
            yield from ("", "not determined, and what it needs:", *(f"  {line}" for line in lines))
        yield from ("", "A tyre curve is determined with its D.")
        if (folder := self.written["folder"]) is not None:
            yield from ("", f"written: {folder}")
            yield from (f"report: {path}" for path in [self.written["report"]] if path is not None)
            yield f"try a drive: codegen sil --build DIR --scenario {Path(folder) / self.names[0]}.csv"

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts."""
        return {**self._facts, **self.written}


def refuse_plan_folder(folder: Path) -> None:
    """Raise CodegenError if a measurement programme cannot go to a folder."""
    check_target(folder)
    refuse_folder(folder, MANIFEST_WHAT, "a measurement programme")


@public
def plan_drives(
    config: ConfigLike,
    *,
    lateral_acceleration_max: float = ACCELERATION_DEFAULT,
    duration: float = DURATION_DEFAULT,
    signals: PathLike | None = None,
    progress: Progress | None = None,
) -> DrivePlan:
    """Choose the drives that determine the configured car best, and predict the standard deviations.

    Args:
        config: the car, or the path of its ars.toml.
        lateral_acceleration_max: m/s^2.
        duration: of all drives together, in s.
        signals: names.toml with the signals that will be measured; by default all.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: no drives within the limits determine anything.
    """
    given = known_config(config)
    measured = signals_of(None if signals is None else load_names(path_of(signals, "a names.toml")))
    known = given if isinstance(given, Config) else load(given)
    with within(name_of(given)), Work(progress).status("choosing drives"):
        return DrivePlan(choose_drives(known, lateral_acceleration_max, duration, measured))


def require_report() -> None:
    """Raise CodegenError if the package that draws reports is missing."""
    require_plotly("identify")
