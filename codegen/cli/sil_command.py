"""The command that runs the generated C in software: one scenario, or a whole test suite."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, note_edited
from codegen.cli.bench_commands import Outputs
from codegen.cli.options import (
    OUTPUT_HELP,
    FiniteRange,
    build_folder,
    configuration_file,
    drift_options,
    map_file,
    output_option,
    result_options,
    scenario_option,
    sensor_options,
    with_clocks,
)
from codegen.errors import CheckFailed, CodegenError, suggestion
from codegen.files import make_folder, resolved

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from matplotlib.figure import Figure

    from codegen.sil.software import Software
    from hil_sim.bench import BenchResult
    from hil_sim.scenarios import Scenario
    from hil_sim.suite.cars import CarsResult
    from hil_sim.suite.requirements import Limits

    Record = npt.NDArray[np.float64]


SUITES = ("tracking", "cars", "references")
TOLD = 3
"""Number of missed figures in the error message; the tables contain all of them."""


@dataclass(frozen=True)
class SuiteOutputs:
    """Output paths: one overview picture, or a folder for all pictures."""

    plot: Path | None
    folder: Path | None
    as_json: bool

    def check(self) -> None:
        """Reject paths that cannot be written, before anything runs. Raises CodegenError."""
        from codegen.emit.outputs import check_output

        check_output(self.plot, ".png")
        if self.folder is None:
            return
        if self.folder.exists() and not self.folder.is_dir():
            raise CodegenError("not a folder", where=self.folder, remedy="name a folder for the pictures")
        # The folder is created when there is something to write.
        place = self.folder if self.folder.is_dir() else resolved(self.folder).parent
        check_output(place / "overview.png", ".png")

    def draw(self, overview: Callable[[], Figure], figures: Callable[[], Mapping[str, Figure]]) -> list[Path]:
        """Write the overview, or all pictures by name, and return their paths."""
        from codegen.report.style import save

        written = []
        if self.plot is not None:
            save(overview(), self.plot)
            written.append(self.plot)
        if self.folder is not None:
            make_folder(self.folder)
            for name, figure in figures().items():
                save(figure, self.folder / f"{name}.png")
                written.append(self.folder / f"{name}.png")
        return written


def _limits(path: Path | None) -> Limits:
    """Return the limits of a file, or the defaults. Raises CodegenError."""
    from hil_sim.suite import requirements

    return requirements.Limits() if path is None else requirements.load(path)


def run_cars_command(
    count: int, seed: int | None, build_path: Path | None, outputs: SuiteOutputs, limits_path: Path | None
) -> None:
    """Draw cars, design and simulate a controller for each, print the results, and judge them. `seed` None: development seed.

    Raises:
        CheckFailed: a car misses a limit; everything is printed before.
        CodegenError: an option that this suite does not support.
    """
    from codegen.report.suite_tables import car_failures, car_sections
    from hil_sim.suite.cars import DEVELOPMENT_SEED, run_cars

    if build_path is not None:
        raise CodegenError("the cars of this suite have builds of their own", where="--build", remedy="leave it out")
    if outputs.plot is not None or outputs.folder is not None:
        where = "--output" if outputs.plot is None else "--plot"
        raise CodegenError("this suite draws no pictures", where=where, remedy="leave it out; --json has all figures")
    limits = _limits(limits_path)
    with console.progress(f"{count} cars") as steps:
        result: CarsResult = run_cars(DEVELOPMENT_SEED if seed is None else seed, count, steps, limits)
    if outputs.as_json:
        console.print_json(result.to_dict())
    else:
        _say(f"suite cars: {count} cars of seed {result.seed}", car_sections(result), ())
    missed = car_failures(result)
    if missed:
        more = f"; and {len(missed) - TOLD} more" if len(missed) > TOLD else ""
        raise CheckFailed(
            f"{result.passed} of {count} cars meet all limits: {'; '.join(missed[:TOLD])}{more}", remedy="see the tables"
        )


def run_suite_command(build_path: Path | None, outputs: SuiteOutputs, limits_path: Path | None) -> None:
    """Run the suite "tracking", print and draw the results, and judge them.

    Raises:
        CheckFailed: a requirement is missed; everything is printed and written before.
        CodegenError: solving, tuning, building, compiling or writing fails.
    """
    from codegen.report import suite_plots
    from codegen.report.suite_tables import failures, sections
    from hil_sim.suite.full_suite import run_full_suite
    from hil_sim.suite.subjects import of_folder, recommended

    outputs.check()
    limits = _limits(limits_path)
    candidate = recommended() if build_path is None else of_folder(build_path)
    whole = run_full_suite(candidate, instructions_of_step, console.progress, limits)
    result = whole.result
    written = outputs.draw(lambda: suite_plots.overview_figure(result), lambda: suite_plots.figures(result))
    missed = failures(result.requirements)
    if outputs.as_json:
        facts = {"build": None if build_path is None else str(build_path), "candidate": candidate.title}
        notes = {"edited": list(whole.edited), "notes": list(whole.notes), "pictures": [str(path) for path in written]}
        console.print_json({**facts, **result.to_dict(), **notes})
    else:
        _say(f"suite tracking: {candidate.title}", sections(result), written)
        note_edited(build_path or Path(), whole.edited)
        console.note(*whole.notes)
    if missed:
        more = f"; and {len(missed) - TOLD} more" if len(missed) > TOLD else ""
        told = "1 figure misses its requirement" if len(missed) == 1 else f"{len(missed)} figures miss their requirements"
        what = f"{told}: {'; '.join(missed[:TOLD])}{more}"
        raise CheckFailed(what, where=build_path or "", remedy="see the first table")


def run_references_command(build_path: Path | None, outputs: SuiteOutputs) -> None:
    """Run the suite "references", print and draw the results. Nothing is judged.

    Raises:
        CodegenError: solving, tuning, building, compiling or writing fails.
    """
    from codegen.report import reference_plots, suite_plots
    from codegen.report.reference_tables import reference_sections
    from hil_sim.suite.references import run_references
    from hil_sim.suite.subjects import of_folder, recommended

    outputs.check()
    candidate = recommended() if build_path is None else of_folder(build_path)
    result = run_references(candidate, console.progress)

    def pictures() -> dict[str, Figure]:
        return {**suite_plots.figures(result.suite), "overview": reference_plots.references_figure(result)}

    written = outputs.draw(lambda: reference_plots.references_figure(result), pictures)
    if outputs.as_json:
        facts = {"build": None if build_path is None else str(build_path), "configuration": candidate.title}
        console.print_json({**facts, **result.to_dict(), "pictures": [str(path) for path in written]})
        return
    _say(f"suite references: {candidate.title.split(',')[0]}", reference_sections(result), written)


def instructions_of_step(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> int:
    """Count the instructions of the longest step found. Raises CodegenError: see `codegen.verify.budgets.measure`."""
    from codegen.verify.budgets.measure import measure_step
    from codegen.verify.check import Effort, Subject

    count = measure_step(Subject("the tested build", files, manifest), Effort())
    return (count.instructions_with_limiter or count.instructions).max


def _say(title: str, sections: Iterable[tuple[str, str]], written: Sequence[Path]) -> None:
    console.say(title)
    for heading, text in sections:
        console.say(f"\n{heading}\n\n{text}")
    if written:
        console.say("")
    console.say(*(f"plot: {path}" for path in written))


SETTINGS = ("speed_km_h", "steering_wheel_angle_deg")
OF_A_SCENARIO = (
    *("map_path", "scenario", *SETTINGS, "baselines", "plant", "through_can", "drift_ppm", "jitter_ms", "sensors", "seed"),
    "csv",
)
"""Parameters that cannot be combined with --suite."""

CARS = 8
"""Default number of cars of --suite cars."""


@dataclass(frozen=True, kw_only=True)
class Choices(Outputs):
    """Options of a scenario."""

    build_path: Path
    map_path: Path | None
    speed_km_h: float | None
    steering_wheel_angle_deg: float | None
    baselines: bool
    plant: str
    through_can: bool

    def drive(self, software: Software, scenario: Scenario) -> tuple[Record, BenchResult | None]:
        """Return a recording of a controller, and the bus statistics if the run uses frames."""
        from hil_sim import third_plant
        from hil_sim.bench import run, run_through_can

        if self.plant == "roll":
            return third_plant.run(software, software.config, scenario, seed=self.seed), None
        if not self.through_can:
            return run(software, scenario), None
        result = run_through_can(software, scenario, sensors=self.sensors, seed=self.seed)
        return result.record, result

    def passive(self, software: Software, scenario: Scenario) -> Record:
        """Return a recording of the same car with its rear wheels straight."""
        from hil_sim import third_plant
        from hil_sim.bench import run

        if self.plant == "roll":
            return third_plant.run(None, software.config, scenario, seed=self.seed)
        return run(software, scenario, controlled=False)


@cli.command(
    short_help="Run the generated C in closed loop.",
    epilog=example(
        "codegen sil --build generated/4ws2 --plot run.png\n  codegen sil --suite tracking\n  codegen sil --suite cars\n"
        "  codegen sil --suite references --plot references.png"
    ),
)
@click.option("--build", "build_path", type=build_folder, metavar="DIR", help="A folder made by codegen build.")
@click.option("--map", "map_path", type=map_file, metavar="MAP.npz", help="Use the car of this map instead of the build's.")
@scenario_option
@click.option(
    "--speed-km-h", type=FiniteRange(min=1.0, max=400.0), metavar="KM/H", help="Speed, for scenarios that accept one."
)
@click.option(
    "--steering-wheel-angle-deg",
    type=FiniteRange(min=-1500.0, max=1500.0),
    metavar="DEG",
    help="Steering-wheel angle, for scenarios that accept one.",
)
@click.option("--baselines", is_flag=True, help="Show the paper's PI, feedforward and the proportional law for comparison.")
@click.option(
    "--plant",
    type=click.Choice(["two-track", "roll"]),
    default="two-track",
    show_default=True,
    help="The simulated car; roll has other tyres, roll and backlash of its own, and sensors with bias and jitter.",
)
@click.option("--can", "through_can", is_flag=True, help="Run through the task and its CAN frames, without a bus.")
@drift_options
@sensor_options
@click.option(
    "--suite",
    metavar="NAME",
    shell_complete=lambda *_: list(SUITES),
    help="Run a test suite instead of a scenario: tracking or references (by default of the recommended preset), or cars.",
)
@click.option("--cars", type=click.IntRange(1, 1000), metavar="N", help="Number of random cars of --suite cars; by default 8.")
@click.option(
    "--limits",
    "limits_path",
    type=configuration_file,
    metavar="TOML",
    help="With --suite: limits that differ from the suite's own, such as overshoot_percent = 5.0.",
)
@output_option(f"{OUTPUT_HELP} With --suite: the folder for all its pictures.", "FILE|DIR")
@result_options
@click.pass_context
def sil(context: click.Context, /, suite: str | None, cars: int | None, limits_path: Path | None, **given: Any) -> None:
    """Run the generated C in closed loop with a simulated car, software in the loop.

    With --suite tracking, simulate the controller and its baselines in every cell of the test set, compare the figures with
    the requirements, and exit 1 if one is missed. --plot then draws an overview.

    With --suite cars, draw plausible cars from a seed, solve, tune and build a controller for each, simulate all, and exit 1
    if a car misses a limit. Seed 1, the default of this suite, is for development. Seed 4 is for testing; nothing is tuned
    on it.

    With --suite references, drive the controller in the same cells on other maps: the cases of the configuration and the
    published references zero-sideslip, variable-wheelbase and envelope. Nothing is judged.
    """
    if cars is not None and suite != "cars":
        raise CodegenError("random cars belong to their suite", where="--cars", remedy="add --suite cars")
    if limits_path is not None and suite is None:
        raise CodegenError("limits belong to a suite", where="--limits", remedy="add --suite tracking or --suite cars")
    if suite is not None:
        if suite not in SUITES:
            remedy = f"known: {', '.join(SUITES)}{suggestion(suite, SUITES)}"
            raise CodegenError(f"there is no suite {suite!r}", where="--suite", remedy=remedy)
        seeded = context.get_parameter_source("seed") is click.core.ParameterSource.COMMANDLINE
        _refuse_with_suite(context, "seed" if suite == "cars" else "")
        if len(given["files"]) > 1:
            raise CodegenError("a second folder for the pictures", where=given["files"][1], remedy="name one")
        folder = next(iter(given["files"]), None)
        outputs = SuiteOutputs(given["plot"], folder, given["as_json"])
        if suite == "references":
            if limits_path is not None:
                raise CodegenError("this suite has no limits", where="--limits", remedy="leave it out")
            run_references_command(given["build_path"], outputs)
        elif suite == "cars":
            run_cars_command(cars or CARS, given["seed"] if seeded else None, given["build_path"], outputs, limits_path)
        else:
            run_suite_command(given["build_path"], outputs, limits_path)
        return
    if given["build_path"] is None:
        raise CodegenError("no build is named", where="--build", remedy="`codegen build` makes one; or give --suite tracking")
    _run_scenario(Choices(**given))


def _refuse_with_suite(context: click.Context, allowed: str) -> None:
    for option in context.command.params:
        given = context.get_parameter_source(option.name or "") is click.core.ParameterSource.COMMANDLINE
        if option.name in OF_A_SCENARIO and option.name != allowed and given:
            remedy = "leave one of the two out"
            raise CodegenError("it applies to a single scenario, not to --suite", where=option.opts[0], remedy=remedy)


def _run_scenario(chosen: Choices) -> None:
    from codegen.emit.manifest import read_build
    from codegen.map_file import map as npz
    from codegen.plausibility.car import car_warnings
    from codegen.sil.software import load
    from hil_sim.metrics import coverage
    from hil_sim.scenario_files import with_settings
    from hil_sim.scenarios import find

    build_path = chosen.build_path
    chosen.check(chosen.map_path)
    if chosen.plant != "two-track" and chosen.through_can:
        raise CodegenError("runs through CAN frames support only the two-track car", where="--plant", remedy="leave --can out")
    if chosen.sensors and not chosen.through_can:
        raise CodegenError("sensors are simulated only with CAN frames", where="--sensors", remedy="add --can")
    if (chosen.drift_ppm is not None or chosen.jitter_ms is not None) and not chosen.through_can:
        where = "--jitter" if chosen.drift_ppm is None else "--clock-drift"
        raise CodegenError("clock drift and jitter are simulated only with CAN frames", where=where, remedy="add --can")
    config = npz.load(chosen.map_path).config if chosen.map_path is not None else None
    if chosen.map_path is not None and config is None:
        console.note(f"{chosen.map_path} contains no car; using the build's")
    with console.status(f"compiling {build_path}"):
        software = load(build_path, config)
    settings = {key: value for key in SETTINGS if (value := getattr(chosen, key)) is not None}
    base = with_settings(find(chosen.scenario, software.config), settings)
    scenario = with_clocks(base, chosen.drift_ppm, chosen.jitter_ms)
    console.warn(*car_warnings(software.config))
    if not software.selftest():
        raise CheckFailed("the generated self-test fails", where=build_path, remedy="build again with `codegen build`")
    with console.status(scenario.title):
        controlled, result = chosen.drive(software, scenario)
        passive = chosen.passive(software, scenario)
    beside = _baselines(chosen, software, scenario) if chosen.baselines else {}
    runs = {"controlled": controlled, **beside, "passive": passive}
    facts = {"build": str(build_path), "scenario": scenario.name, "edited": list(software.edited)}
    if chosen.sensors:
        facts["sensors"] = f"seed {chosen.seed}"
    note_edited(build_path, software.edited, quiet=chosen.as_json)
    covers, look_up = coverage(read_build(build_path)), software.map_yaw_rate
    chosen.tell(str(build_path), software.config, scenario, runs, result, facts, look_up=look_up, covers=covers)


def _baselines(chosen: Choices, software: Software, scenario: Scenario) -> dict[str, Record]:
    """Return name -> recording of the baselines, built in memory for the build's car and simulated on the car of `software`."""
    from hil_sim.suite.subjects import of_folder

    with console.progress("baselines") as steps:
        comparison = of_folder(chosen.build_path).comparison(steps)
    console.note(*comparison.notes)
    return {each.name: chosen.drive(each.around(software.config), scenario)[0] for each in comparison.baselines}
