"""Output of the bench commands: lines or JSON, a plot, a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from codegen import console
from codegen.errors import CodegenError
from codegen.files import resolved

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from codegen.configuration import Config
    from hil_sim.bench import BenchResult, Cycle, Observer
    from hil_sim.metrics.run import LookUp
    from hil_sim.metrics.verdict import Covers
    from hil_sim.scenarios import Scenario
    from hil_sim.session import Setup

    Runs = Mapping[str, npt.NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """Output paths of the results, and the options that all runs share."""

    scenario: str
    drift_ppm: float | None
    jitter_ms: float | None
    sensors: bool
    seed: int
    plot: Path | None
    csv: Path | None
    log: Path | None = None
    files: tuple[Path, ...]
    as_json: bool

    def check(self, *inputs: Path | None) -> None:
        """Reject outputs that cannot be written, before anything runs. Raises CodegenError.

        Args:
            inputs: files that the command reads besides the scenario.
        """
        from codegen.emit.outputs import check_output
        from codegen.export.runs import check_formats

        inputs = (*inputs, Path(self.scenario))
        check_formats(self.files)
        for path in self.files:
            check_output(path, path.suffix.lower(), inputs)
        check_output(self.plot, ".png", inputs)
        check_output(self.csv, ".csv", inputs)
        if self.log is not None:
            from hil_sim.logs import BusLog

            BusLog(self.log)  # checks the extension
            check_output(self.log, self.log.suffix.lower(), inputs)
        seen: set[Path] = set()
        for output in filter(None, (self.plot, self.csv, self.log, *self.files)):
            target = resolved(output)
            if target in seen:
                raise CodegenError("it would be written twice", where=output, remedy="name each file once")
            seen.add(target)

    @property
    def written(self) -> dict[str, list[str]]:
        """Return the files by kind, for JSON; kinds without a file are omitted."""
        kinds = {"plot": (self.plot,), "recording": (self.csv, *self.files), "log": (self.log,)}
        named = {kind: [str(path) for path in paths if path is not None] for kind, paths in kinds.items()}
        return {kind: paths for kind, paths in named.items() if paths}

    def tell(
        self,
        title: str,
        config: Config,
        scenario: Scenario,
        runs: Runs,
        result: BenchResult | None,
        facts: Mapping[str, Any],
        ecu_counters: str = "",
        look_up: LookUp | None = None,
        covers: Covers | None = None,
    ) -> None:
        """Write the outputs of a run and print its results.

        Args:
            result: bus statistics of a run through frames; None for other runs.
            look_up, covers: lookup and coverage of the controller's map; None if unknown.
        """
        from codegen.export import runs as exported
        from codegen.report.bus_tables import bus_facts, bus_lines
        from codegen.report.scenario_plots import scenario_figure
        from codegen.report.style import save
        from codegen.report.summary import metric_rows
        from codegen.text_table import text_table
        from hil_sim.metrics import Run, evaluate, verdict
        from hil_sim.recording import save_csv

        evaluation, period = evaluate(scenario, config, runs, look_up), config.controller.sampling_time_s
        controlled = next(iter(evaluation.runs.values()))
        driven = Run(next(iter(runs.values())), scenario, config, look_up)
        judged = verdict(driven, controlled.metrics, controlled.spun_at, covers)
        with console.status("writing") if self.written else nullcontext():
            if self.csv is not None:
                save_csv(runs["controlled"], self.csv)
            for path in self.files:
                exported.save(runs["controlled"], path, scenario.title)
            if self.plot is not None:
                save(scenario_figure(scenario, config, runs, title, look_up=look_up), self.plot)
        if self.as_json:
            bus = {} if result is None else {"bus_figures": bus_facts(result, period), "ecu_counters": ecu_counters or None}
            console.print_json({**facts, "metrics": evaluation.to_dict(), "verdict": judged, **bus, "files": self.written})
            return
        console.say(f"{title}: {scenario.title}")
        if facts.get("sensors", "ideal") != "ideal":
            console.say(f"measured by the sensors of the configuration, {facts['sensors']}")
        console.say(text_table(("", *evaluation.runs), metric_rows(evaluation)))
        console.say(judged)
        if result is not None:
            if not result.received["commands"]:
                console.note("no ECU sent a command; the rear wheels did not move")
            console.say("")
            console.say(*bus_lines(result, period))
            if ecu_counters:
                console.say(f"ECU: {ecu_counters}")
        for kind, names in self.written.items():
            for name in names:
                console.say(f"{kind}: {name}")


@contextmanager
def live_view(setup: Setup, kind: str, *, quiet: bool) -> Iterator[Observer | None]:
    """Show a live view on the terminal during a run. Yields the observer that the bench calls once a cycle."""
    from codegen.report.live import LiveSample, LiveView

    if quiet:
        with console.status(f"{setup.scenario.title}, {setup.clock}"):
            yield None
        return
    duration = setup.scenario.duration
    with LiveView(setup.scenario.title, str(setup.address), kind, setup.clock) as view:

        def observe(cycle: Cycle) -> None:
            time, _, _, yaw_rate, reference, sideslip, _, commanded, achieved, _, _, status = cycle.row
            diagnostics = 0 if cycle.command is None else cycle.command.diagnostics
            motion = (time, duration, yaw_rate, reference, sideslip, commanded, achieved)
            view.update(LiveSample(*motion, int(status), diagnostics, cycle.duration, cycle.without_command, cycle.late))

        yield observe


def note_edited(build: Path, edited: Sequence[str], *, quiet: bool = False) -> None:
    """Warn about generated files that were edited."""
    for path in () if quiet else edited:
        console.note(f"{build / path} was changed after the build; the changed file is used")
