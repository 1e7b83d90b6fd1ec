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

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, note_edited, show
from codegen.cli.options import (
    build_option,
    bus_names,
    bus_option,
    check_picture,
    clock_option,
    configuration_file,
    run_options,
    xcp_option,
)
from codegen.errors import CheckFailed, CodegenError
from codegen.files import resolved

if TYPE_CHECKING:
    from codegen.configuration import Config
    from codegen.emit.text import Precision
    from codegen.library.runs import Run
    from hil_sim.bench import BenchResult, Cycle, Observer
    from hil_sim.bus import BusAddress
    from hil_sim.session import EcuKind, Setup


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """Output paths of the results, and the options that all runs share."""

    scenario: str
    clock_drift_ppm: float | None
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
        from codegen.emit.folder import check_output
        from codegen.export.runs import check_formats

        inputs = (*inputs, Path(self.scenario))
        check_formats(self.files)
        for path in self.files:
            check_output(path, path.suffix.lower(), inputs)
        check_picture(self.plot, inputs)
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

    def finish(self, run: Run) -> None:
        """Write the files of a run and print its results."""
        recordings = [path for path in (self.csv, *self.files) if path is not None]
        with console.status("writing") if recordings or self.plot else nullcontext():
            if self.plot is not None:
                run.plot(self.plot)
            for path in recordings:
                run.save(path)
        if self.log is not None:
            run.written["log"] = [str(self.log)]
        show(run, self.as_json)


@contextmanager
def live_view(setup: Setup, kind: str, *, quiet: bool) -> Iterator[Observer | None]:
    """Show a live view on the terminal during a run. Yields the observer that the bench calls once a cycle."""
    from codegen.report.live import LiveSample, LiveView
    from codegen.sil.software import RECORD_COLUMNS

    if quiet:
        with console.status(f"{setup.scenario.title}, {setup.clock}"):
            yield None
        return
    duration = setup.scenario.duration
    with LiveView(setup.scenario.title, str(setup.address), kind, setup.clock) as view:

        def observe(cycle: Cycle) -> None:
            row = dict(zip(RECORD_COLUMNS, cycle.row, strict=True))
            view.update(
                LiveSample(
                    time=row["time_s"],
                    duration=duration,
                    yaw_rate=row["yaw_rate_rad_s"],
                    yaw_rate_reference=row["yaw_rate_reference_rad_s"],
                    sideslip=row["sideslip_rad"],
                    rear_angle_command=row["rear_angle_command_rad"],
                    rear_angle=row["rear_angle_rad"],
                    status=int(row["status"]),
                    diagnostics=0 if cycle.command is None else cycle.command.diagnostics,
                    cycle_time=cycle.duration,
                    lost_frames=cycle.without_command,
                    late_cycles=cycle.late,
                )
            )

        yield observe


@dataclass(frozen=True, kw_only=True)
class Choices(Outputs):
    """Options of a run on a bus."""

    bus: str
    lock_step: bool

    def setup(self, config: Config, precision: Precision = "single", dbc: bytes | None = None) -> Setup:
        """Return the settings of a run for a car."""
        from hil_sim.bus import BusAddress
        from hil_sim.scenario_files import find
        from hil_sim.session import Setup

        return Setup(
            config=config,
            scenario=find(self.scenario, config).with_clocks(self.clock_drift_ppm, self.jitter_ms),
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
    type=click.Choice(["native", "cffi", "external"]),
    required=True,
    help="native: the C as a Linux program; cffi: the C called from Python; external: an ECU already on the bus.",
)
@xcp_option
@run_options
def hil(build: Path, ecu: EcuKind, xcp: bool, **given: Any) -> None:
    """Exchange CAN frames between a plant simulator and an ECU, every 10 ms by the clock or in lock-step.

    The ECU is started and stopped here, unless it is external. The passive car is simulated for comparison.
    """
    from hil_sim.session import BuildFacts, check_xcp, run_hil

    check_xcp(ecu, xcp=xcp)
    chosen = Choices(**given)
    chosen.check()
    facts = BuildFacts.read(build)
    setup = chosen.setup(facts.config, facts.precision, facts.dbc)
    note_edited(build, facts.edited, quiet=chosen.as_json)
    with live_view(setup, ecu, quiet=chosen.as_json) as observe:
        ran = run_hil(setup, build, ecu, observe, xcp=xcp)
    title = f"{build} on {setup.address}, ECU {ecu}, {setup.clock}"
    described = {"build": str(build), "ecu": ecu, **setup.describe()}
    chosen.finish(_of_bench(title, setup, ran.result, described, ran.ecu_counters))


@cli.command(
    short_help="Run the simulated car on a CAN bus.",
    epilog=example("codegen plant --bus socketcan:vcan0 --scenario sine-with-dwell"),
)
@click.option("--config", type=configuration_file, help="ars.toml; by default the paper's preset.")
@run_options
def plant(config: Path | None, **given: Any) -> None:
    """Run the simulated car on a bus for any ECU: send its frames, obey the commands."""
    from codegen.map_file.map import choose_config
    from hil_sim.session import run_plant

    chosen = Choices(**given)
    chosen.check(config)
    car = choose_config(None, config)
    if config is None and not chosen.as_json:
        console.note("no --config: using the paper's preset")
    setup = chosen.setup(car.config)
    with live_view(setup, "external", quiet=chosen.as_json) as observe:
        result = run_plant(setup, None, observe)
    described = {"configuration": car.source, **setup.describe()}
    chosen.finish(_of_bench(f"plant on {setup.address}, {setup.clock}", setup, result, described))


def _of_bench(title: str, setup: Setup, result: BenchResult, facts: Mapping[str, Any], ecu_counters: str = "") -> Run:
    """Return a run on a bus, beside the passive car."""
    from codegen.library.runs import CONTROLLED, PASSIVE, Recording, Run
    from hil_sim.session import passive

    return Run(
        Recording(
            title=title,
            config=setup.config,
            scenario=setup.scenario,
            records={CONTROLLED: result.record, PASSIVE: passive(setup.config, setup.scenario)},
            facts=facts,
            on_bus=result,
            ecu_counters=ecu_counters,
        )
    )


@cli.command(
    short_help="Run the generated C as the ECU alone on a CAN bus.",
    epilog=example("codegen ecu --build generated/4ws2 --bus socketcan:vcan0"),
)
@build_option
@bus_option
@click.option(
    "--ecu",
    type=click.Choice(["native", "cffi"]),
    help="native: the C as a Linux program (default on socketcan); cffi: the C called from Python (default elsewhere).",
)
@clock_option
@xcp_option
@click.option("--parent", type=int, hidden=True, help="Exit when this process is no longer the parent.")
def ecu(build: Path, bus: str, ecu: str | None, lock_step: bool, xcp: bool, parent: int | None) -> None:
    """Run as the ECU on a bus until interrupted: print `ready`, answer the car's frames, print counters at the end."""
    from hil_sim.bus import BusAddress
    from hil_sim.session import check_native, check_xcp

    address = BusAddress.parse(bus)
    if ecu is None:
        ecu = "native" if address.interface == "socketcan" and sys.platform == "linux" else "cffi"
    check_xcp(ecu, xcp=xcp)
    if ecu == "native":
        from hil_sim import ecu_process

        check_native(address)
        command = ecu_process.command(build, address.channel, lock_step=lock_step, xcp=xcp)
        sys.stdout.flush()
        os.execv(command[0], command)  # replaces this process
    _serve(build, address, lock_step, parent)


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
    metavar="INTERFACE:CHANNEL",
    shell_complete=bus_names,
    help="A bus of python-can; by default the run is in this process, without a bus.",
)
@click.option("--ecu", type=click.Choice(["native", "cffi"]), help="On a bus: as in hil; cffi by default.")
@json_option
def faults(as_json: bool, **given: Any) -> None:
    """Inject every bus fault into the same turn-in. Report the diagnostics, the time to the fail-safe, the largest rear angle
    and the recovery time. On a bus, runs take real time, and delays of this machine count as additional faults."""
    show(codegen.faults(**given, progress=console.shown), as_json)


@cli.command(short_help="List the scenarios.", epilog=example("codegen scenarios"))
@json_option
def scenarios(as_json: bool) -> None:
    """List the built-in scenarios with their descriptions, sources and bus faults."""
    show(codegen.scenarios(), as_json)
