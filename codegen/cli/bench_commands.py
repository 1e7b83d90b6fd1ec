"""Commands that run the generated C on a bus, and the output of runs: lines or JSON, a plot, a recording."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option, note_edited
from codegen.cli.options import (
    build_option,
    bus_names,
    bus_option,
    clock_option,
    configuration_file,
    run_options,
    with_clocks,
    xcp_option,
)
from codegen.errors import CheckFailed, CodegenError
from codegen.files import resolved
from codegen.text_table import text_table

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
    from codegen.emit.text import Precision
    from hil_sim.bus import BusAddress
    from hil_sim.session import EcuKind


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
        from hil_sim.logs import save_csv
        from hil_sim.metrics import Run, evaluate, verdict

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


@dataclass(frozen=True, kw_only=True)
class Choices(Outputs):
    """Options of a run on a bus."""

    bus: str
    lock_step: bool

    def setup(self, config: Config, precision: Precision = "single", dbc: bytes | None = None) -> Setup:
        """Return the settings of a run for a car."""
        from hil_sim.bus import BusAddress
        from hil_sim.scenarios import find
        from hil_sim.session import Setup

        return Setup(
            config=config,
            scenario=with_clocks(find(self.scenario, config), self.drift_ppm, self.jitter_ms),
            address=BusAddress.parse(self.bus),
            lock_step=self.lock_step,
            precision=precision,
            sensors=self.sensors,
            seed=self.seed,
            log=self.log,
            dbc=dbc,
        )


@cli.command(
    short_help="Run the generated C as an ECU on a CAN bus.",
    epilog=example("codegen hil --build generated/4ws2 --bus socketcan:vcan0 --ecu native --log run.blf"),
)
@build_option
@click.option(
    "--ecu",
    "kind",
    type=click.Choice(["native", "cffi", "external"]),
    required=True,
    help="native: the C as a Linux program; cffi: the C called from Python; external: an ECU already on the bus.",
)
@xcp_option
@run_options
def hil(build_path: Path, kind: EcuKind, xcp: bool, **given: Any) -> None:
    """Exchange CAN frames between a plant simulator and an ECU, every 10 ms by the clock or in lock-step.

    The ECU is started and stopped here, unless it is external. The passive car is simulated for comparison.
    """
    from hil_sim.session import BuildFacts, check_xcp, passive, run_hil

    check_xcp(kind, xcp=xcp)
    chosen = Choices(**given)
    chosen.check()
    facts = BuildFacts.read(build_path)
    setup = chosen.setup(facts.config, facts.precision, facts.dbc)
    note_edited(build_path, facts.edited, quiet=chosen.as_json)
    with live_view(setup, kind, quiet=chosen.as_json) as observe:
        ran = run_hil(setup, build_path, kind, observe, xcp=xcp)
    runs = {"controlled": ran.result.record, "passive": passive(setup.config, setup.scenario)}
    title = f"{build_path} on {setup.address}, ECU {kind}, {setup.clock}"
    described = {"build": str(build_path), "ecu": kind, **setup.describe()}
    chosen.tell(title, setup.config, setup.scenario, runs, ran.result, described, ran.ecu_counters)


@cli.command(
    short_help="Run the simulated car on a CAN bus.",
    epilog=example("codegen plant --bus socketcan:vcan0 --scenario sine-with-dwell"),
)
@click.option("--config", "config_path", type=configuration_file, help="ars.toml; by default the paper's preset.")
@run_options
def plant(config_path: Path | None, **given: Any) -> None:
    """Run the simulated car on a bus for any ECU: send its frames, obey the commands."""
    from codegen.map_file.map import choose_config
    from hil_sim.session import passive, run_plant

    chosen = Choices(**given)
    chosen.check(config_path)
    car = choose_config(None, config_path)
    if config_path is None and not chosen.as_json:
        console.note("no --config: using the paper's preset")
    setup = chosen.setup(car.config)
    with live_view(setup, "external", quiet=chosen.as_json) as observe:
        result = run_plant(setup, None, observe)
    runs = {"controlled": result.record, "passive": passive(setup.config, setup.scenario)}
    described = {"configuration": car.source, **setup.describe()}
    chosen.tell(f"plant on {setup.address}, {setup.clock}", setup.config, setup.scenario, runs, result, described)


@cli.command(
    short_help="Run the generated C as the ECU alone on a CAN bus.",
    epilog=example("codegen ecu --build generated/4ws2 --bus socketcan:vcan0"),
)
@build_option
@bus_option
@click.option(
    "--ecu",
    "kind",
    type=click.Choice(["native", "cffi"]),
    help="native: the C as a Linux program (default on socketcan); cffi: the C called from Python (default elsewhere).",
)
@clock_option
@xcp_option
@click.option("--parent", type=int, hidden=True, help="Exit when this process is no longer the parent.")
def ecu(build_path: Path, bus: str, kind: str | None, lock_step: bool, xcp: bool, parent: int | None) -> None:
    """Run as the ECU on a bus until interrupted: print `ready`, answer the car's frames, print counters at the end."""
    from hil_sim.bus import BusAddress
    from hil_sim.session import check_native, check_xcp

    address = BusAddress.parse(bus)
    if kind is None:
        kind = "native" if address.interface == "socketcan" and sys.platform == "linux" else "cffi"
    check_xcp(kind, xcp=xcp)
    if kind == "native":
        from hil_sim import ecu_process

        check_native(address)
        command = ecu_process.command(build_path, address.channel, lock_step=lock_step, xcp=xcp)
        sys.stdout.flush()
        os.execv(command[0], command)  # replaces this process
    _serve(build_path, address, lock_step, parent)


def _serve(build_path: Path, address: BusAddress, lock_step: bool, parent: int | None) -> None:
    """Run the ECU in this process until a signal arrives or its parent ends."""
    from codegen.sil.software import load
    from hil_sim.bus import Bus
    from hil_sim.ecu_node import EcuNode
    from hil_sim.ecu_process import READY, counters_line

    with console.status(f"compiling {build_path}"):
        software = load(build_path)
    if not software.selftest():
        raise CheckFailed("the generated self-test fails", where=build_path, remedy="build again with `codegen build`")
    ended = False

    def end(number: int, frame: FrameType | None) -> None:
        del number, frame
        nonlocal ended
        ended = True

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)
    with Bus(address, software.config.can) as bus:
        node = EcuNode(software, bus)
        console.say(READY)
        sys.stdout.flush()
        node.run(lock_step, lambda: ended or (parent is not None and os.getppid() != parent))
    console.complain(counters_line(node))


@cli.command(
    short_help="Inject every bus fault and check the response.",
    epilog=example("codegen faults --build generated/4ws2 --bus socketcan:vcan0 --ecu native"),
)
@build_option
@click.option(
    "--bus",
    "bus",
    metavar="INTERFACE:CHANNEL",
    shell_complete=bus_names,
    help="A bus of python-can; by default the run is in this process, without a bus.",
)
@click.option("--ecu", "kind", type=click.Choice(["native", "cffi"]), help="On a bus: as in hil; cffi by default.")
@json_option
def faults(build_path: Path, bus: str | None, kind: EcuKind | None, as_json: bool) -> None:
    """Inject every bus fault into the same turn-in. Report the diagnostics, the time to the fail-safe, the largest rear angle
    and the recovery time. On a bus, runs take real time, and delays of this machine count as additional faults."""
    from codegen.report.bus_tables import HEADER, fault_data, fault_rows
    from codegen.sil.software import load
    from hil_sim.bench import run_through_can
    from hil_sim.bus import BusAddress
    from hil_sim.fault_catalogue import run_all
    from hil_sim.session import BuildFacts, Setup, run_hil

    if bus is None and kind is not None:
        raise CodegenError("without a bus there is no ECU to choose", where="--ecu", remedy="add --bus")
    address, facts = None if bus is None else BusAddress.parse(bus), BuildFacts.read(build_path)
    note_edited(build_path, facts.edited, quiet=as_json)
    with console.status(f"compiling {build_path}"):
        software = load(build_path) if address is None else None

    def run(scenario: Scenario) -> BenchResult:
        if software is not None:
            return run_through_can(software, scenario)
        assert address is not None
        return run_hil(Setup(facts.config, scenario, address, precision=facts.precision), build_path, kind or "cffi").result

    with console.progress("faults") as progress:
        outcomes = run_all(facts.config, run, progress)
    if as_json:
        console.print_json({"build": str(build_path), "bus": bus, "faults": fault_data(outcomes)})
    else:
        console.say(text_table(HEADER, fault_rows(outcomes)))
    wrong = [outcome.case.name for outcome in outcomes if outcome.violations]
    if wrong:
        raise CheckFailed(f"not as defined: {', '.join(wrong)}", where=build_path, remedy="see the table")


@cli.command(short_help="List the scenarios.", epilog=example("codegen scenarios"))
@json_option
def scenarios(as_json: bool) -> None:
    """List the built-in scenarios with their descriptions, sources and bus faults."""
    from dataclasses import asdict

    from hil_sim.scenarios import listing

    listed = listing()
    if as_json:
        console.print_json([asdict(entry) for entry in listed])
        return
    for entry in listed:
        console.say(f"{entry.name}: {entry.what} ({entry.duration_s:g} s)")
        console.say(f"    {entry.source}")
        for fault in entry.faults:
            console.say(f"    fault: {fault}")
    console.say("\nYour own: a recorded .csv, or a .toml with base, changes and [[faults]]; see docs/interface.md.")
