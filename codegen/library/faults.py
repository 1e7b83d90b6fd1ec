"""Faults on the bus, and the reaction of a controller."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from codegen.errors import CheckFailed, CodegenError
from codegen.library.builds import BuildLike, edited_notes, folder_of
from codegen.library.result import Progress, Result, Work, public
from codegen.report.bus_tables import HEADER, fault_data, fault_rows
from codegen.sil.software import load
from codegen.text import text_table
from hil_sim import bench
from hil_sim.bench import BenchResult
from hil_sim.bus import BusAddress
from hil_sim.fault_catalogue import FaultOutcome, run_all
from hil_sim.scenarios import Scenario
from hil_sim.session import BuildFacts, Setup, run_hil


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
        return [text_table(HEADER, fault_rows(self._outcomes))]

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
