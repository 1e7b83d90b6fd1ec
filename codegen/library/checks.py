"""Plausibility of a configuration, a map or a build, the judgement of the car, and the reaction of a controller to faults."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from codegen.configuration import Config
from codegen.errors import CheckFailed, CodegenError
from codegen.judgement import facts as checking
from codegen.judgement.model import Judgement
from codegen.library.builds import Build, BuildLike, edited_notes, folder_of
from codegen.library.configurations import ConfigLike, given_config
from codegen.library.maps import Map, place_of
from codegen.library.result import PathLike, Progress, Result, Work, path_of, public
from codegen.map_file.map import choose_config
from codegen.report.bus_tables import FAULT_HEADER, fault_data, fault_rows
from codegen.sil.software import load
from codegen.text import text_table
from hil_sim import bench
from hil_sim.bench import BenchResult
from hil_sim.bus import BusAddress
from hil_sim.fault_catalogue import FaultOutcome, run_all
from hil_sim.scenarios import Scenario
from hil_sim.session import BuildFacts, Setup, run_hil


class Check(Result):
    """Result of a check.

    Attributes:
        kind: "configuration", "map" or "build".
        warnings: implausible values, contradictions, and where the car is worse with the controller than without.
        judgement: the comparison of the car with and without its controller; None if there is none.
        facts: what was found, as JSON values.
    """

    def __init__(self, subject: str, found: checking.Found) -> None:
        self.kind, self.facts, self.notes, self.warnings = found.kind, found.facts, found.notes, found.warnings
        self.judgement: Judgement | None = found.judgement
        self._subject, self._lines = subject, found.lines
        if found.warnings:
            one = len(found.warnings) == 1
            count = "1 warning" if one else f"{len(found.warnings)} warnings"
            self.failure = CheckFailed(count, where=subject, remedy=f"resolve {'it' if one else 'them'}")

    def lines(self) -> list[str]:
        """Return the facts, and the judgement of the car."""
        return [*self._lines, *([] if self.warnings else ["no warnings"])]

    def to_dict(self) -> dict[str, Any]:
        """Return the same, with notes and warnings."""
        return {
            "subject": self._subject,
            "kind": self.kind,
            **self.facts,
            "notes": list(self.notes),
            "warnings": list(self.warnings),
        }


@public
def check(
    subject: Map | Build | Config | PathLike,
    config: ConfigLike | None = None,
    *,
    drive: bool = False,
    progress: Progress | None = None,
) -> Check:
    """Check a configuration, a map or a build for implausible values and contradictions; no file is changed.

    Args:
        subject: what to check, or its path.
        config: check a map with this configuration; by default with its own.
        drive: judge the car now; by default the judgement that `tune` stored is used.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: it cannot be read, or is none of the three.
    """
    given = given_config(config)
    name = place_of(subject) if isinstance(subject, Map) else "the configuration"
    if not isinstance(subject, (Map, Config)):
        subject = path_of(subject.folder if isinstance(subject, Build) else subject, "a configuration, a map or a build")
        name = str(subject)
    with Work(progress).stage(f"checking {name}") as tell:
        if isinstance(subject, Map):
            chosen = choose_config(subject.reference_map, given)
            return Check(name, checking.check_map(subject.reference_map, chosen, name, drive, tell))
        if isinstance(subject, Config):
            if given is not None:
                raise CodegenError("only a map is checked with another configuration", where="config", remedy="leave it out")
            return Check(name, checking.check_configuration(choose_config(None, subject), name, drive, tell))
        return Check(name, checking.check_path(subject, given, drive=drive, progress=tell))


class Faults(Result):
    """The reaction of a controller to every fault on the bus.

    Attributes:
        outcomes: a dictionary for each fault.
        wrong: names of the faults that did not end in their defined state.
    """

    def __init__(self, folder: Path, bus: str | None, outcomes: list[FaultOutcome], notes: Iterable[str]) -> None:
        self._folder, self._bus, self._outcomes, self.notes = folder, bus, outcomes, tuple(notes)
        self.outcomes = fault_data(outcomes)
        self.wrong = tuple(each.case.name for each in outcomes if each.violations)
        if self.wrong:
            self.failure = CheckFailed(f"not as defined: {', '.join(self.wrong)}", where=folder, remedy="see the table")

    def lines(self) -> list[str]:
        """Return a row for each fault."""
        return [text_table(FAULT_HEADER, fault_rows(self._outcomes))]

    def to_dict(self) -> dict[str, Any]:
        """Return the outcomes."""
        return {"build": str(self._folder), "bus": self._bus, "faults": self.outcomes}


@public
def faults(
    build: BuildLike,
    *,
    bus: str | None = None,
    ecu: Literal["native", "cffi"] | None = None,
    progress: Progress | None = None,
) -> Faults:
    """Inject every bus fault into the same turn-in, and compare the reaction with the defined one.

    Args:
        build: a build, or the path of its folder.
        bus: of python-can, such as "socketcan:vcan0"; by default the run is in this process, without a bus.
        ecu: on a bus, what runs the C; by default "cffi".
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: the C does not compile, or the bus cannot be opened.
    """
    folder, work = folder_of(build), Work(progress, "compiling", "faults")
    if bus is None and ecu is not None:
        raise CodegenError("without a bus there is no ECU to choose", where="`ecu=`", remedy="add `bus=`")
    address, facts = None if bus is None else BusAddress.parse(bus), BuildFacts.read(folder)
    with work.status("compiling", f"compiling {folder}"):
        software = load(folder) if address is None else None

    def drive(scenario: Scenario) -> BenchResult:
        if software is not None:
            return bench.run_through_can(software, scenario)
        assert address is not None
        return run_hil(Setup(facts.config, scenario, address, precision=facts.precision), folder, ecu or "cffi").result

    with work.stage("faults") as tell:
        outcomes = run_all(facts.config, drive, tell)
    return Faults(folder, bus, list(outcomes), edited_notes(folder, facts.edited))
