"""Commands that run the generated C in software: one scenario, or a whole test suite."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.bench_commands import Outputs
from codegen.cli.options import (
    OUTPUT_HELP,
    FiniteRange,
    build_folder,
    check_picture,
    configuration_file,
    drift_options,
    folder_to_write,
    map_file,
    output_option,
    picture_to_write,
    result_options,
    scenario_option,
    sensor_options,
)
from codegen.errors import CodegenError
from codegen.files import resolved
from hil_sim.settings import SPEED_RANGE_KM_H, STEERING_WHEEL_ANGLE_RANGE_DEG

SUITES = ("tracking", "cars", "references")


@dataclass(frozen=True, kw_only=True)
class SuiteChoices:
    """Options of a suite: a picture of the overview, or a folder for all pictures."""

    build: Path | None
    plot: Path | None
    files: tuple[Path, ...]
    cars: int | None
    seed: int | None
    limits: Path | None
    as_json: bool

    def run(self, name: str, note: str = "") -> None:
        """Run a suite, draw its pictures, and print and judge its results after a note. Raises CodegenError, CheckFailed."""
        self._check(name)
        found = codegen.suite(self.build, name, cars=self.cars, seed=self.seed, limits=self.limits, progress=console.shown)
        if self.plot is not None:
            found.plot(self.plot)
        for folder in self.files:
            found.plot_all(folder)
        if note and not self.as_json:
            console.note(note)
        show(found, self.as_json)

    def _check(self, name: str) -> None:
        """Reject paths that cannot be written, before anything runs. Raises CodegenError."""
        from codegen.emit.folder import check_output

        if name == "cars" and (self.plot is not None or self.files):
            where = "--output" if self.plot is None else "--plot"
            raise CodegenError("this suite draws no pictures", where=where, remedy="leave it out; --json has all figures")
        if len(self.files) > 1:
            raise CodegenError("a second folder for the pictures", where=self.files[1], remedy="name one")
        check_picture(self.plot)
        for folder in self.files:
            if folder.exists() and not folder.is_dir():
                raise CodegenError("not a folder", where=folder, remedy="name a folder for the pictures")
            # The folder is created when there is something to write.
            place = folder if folder.is_dir() else resolved(folder).parent
            check_output(place / "overview.png", ".png")


@cli.command(
    short_help="Run a test suite.",
    epilog=example(
        "codegen suite tracking --build generated/4ws2\n  codegen suite cars\n  codegen suite references --plot references.png"
    ),
)
@click.argument("name", metavar="tracking|cars|references", shell_complete=lambda *_: list(SUITES))
@click.option(
    "--build",
    type=build_folder,
    metavar="DIR",
    help="A build; by default the recommended preset.",
)
@click.option("--cars", type=click.IntRange(1, 1000), metavar="N", help="Number of random cars; by default 8.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the random cars; by default 1.")
@click.option(
    "--limits",
    type=configuration_file,
    metavar="TOML",
    help="Limits that differ from the suite's own, such as overshoot_percent = 5.0.",
)
@click.option("--plot", type=picture_to_write, metavar="PNG|SVG", help="Draw an overview.")
@click.option("-o", "--output", "folder", type=folder_to_write, metavar="DIR", help="Folder for all pictures.")
@json_option
def suite(
    name: str,
    build: Path | None,
    cars: int | None,
    seed: int | None,
    limits: Path | None,
    plot: Path | None,
    folder: Path | None,
    as_json: bool,
) -> None:
    """Run a test suite, and exit with 1 if a requirement is missed.

    tracking: simulate the controller and its baselines in every cell of the test set, and compare the figures with the
    requirements.

    cars: draw plausible cars from a seed, solve, tune and build a controller for each, simulate all, and compare the figures
    with the limits. Seed 1 is for development. Seed 4 is for testing; nothing is tuned on it.

    references: drive the controller in the same cells on other maps: the cases of the configuration and the published
    references zero-sideslip, variable-wheelbase and envelope. Nothing is judged.
    """
    files = () if folder is None else (folder,)
    chosen = SuiteChoices(build=build, plot=plot, files=files, cars=cars, seed=seed, limits=limits, as_json=as_json)
    chosen.run(name)


SETTINGS = ("speed_km_h", "steering_wheel_angle_deg")
OF_A_SCENARIO = (
    *("map", "scenario", *SETTINGS, "baselines", "plant", "through_can", "clock_drift_ppm", "jitter_ms", "sensors", "seed"),
    "csv",
)
"""Parameters that cannot be combined with --suite."""


@cli.command(
    short_help="Run the generated C in closed loop.",
    epilog=example(
        "codegen sil --build generated/4ws2 --plot run.png\n  codegen sil --build generated/4ws2 --scenario slalom --baselines"
    ),
)
@click.option("--build", type=build_folder, metavar="DIR", help="A folder made by codegen build.")
@click.option("--map", type=map_file, metavar="MAP.npz", help="Use the car of this map instead of the build's.")
@scenario_option
@click.option("--speed-km-h", type=FiniteRange(*SPEED_RANGE_KM_H), metavar="KM/H", help="Speed, for scenarios that accept one.")
@click.option(
    "--steering-wheel-angle-deg",
    type=FiniteRange(*STEERING_WHEEL_ANGLE_RANGE_DEG),
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
    help="Run a test suite instead of a scenario, as codegen suite does.",
)
@click.option("--cars", type=click.IntRange(1, 1000), metavar="N", help="Number of random cars of --suite cars; by default 8.")
@click.option(
    "--limits",
    type=configuration_file,
    metavar="TOML",
    help="With --suite: limits that differ from the suite's own, such as overshoot_percent = 5.0.",
)
@output_option(f"{OUTPUT_HELP} With --suite: the folder for all its pictures.", "FILE|DIR")
@result_options
@click.pass_context
def sil(context: click.Context, /, suite: str | None, cars: int | None, limits: Path | None, **given: Any) -> None:
    """Run the generated C in closed loop with a simulated car, software in the loop.

    --suite is the earlier form of `codegen suite`.
    """
    if suite is not None:
        seeded = context.get_parameter_source("seed") is click.core.ParameterSource.COMMANDLINE
        _refuse_with_suite(context, "seed" if suite == "cars" else "")
        seed = given["seed"] if seeded else None
        note = f"`codegen suite {suite}` is the new form of `codegen sil --suite {suite}`"
        named = {key: given[key] for key in ("build", "plot", "files", "as_json")}
        SuiteChoices(**named, cars=cars, seed=seed, limits=limits).run(suite, note)
        return
    if cars is not None:
        raise CodegenError("random cars belong to their suite", where="--cars", remedy="use codegen suite cars")
    if limits is not None:
        raise CodegenError("limits belong to a suite", where="--limits", remedy="use codegen suite tracking or cars")
    if given["build"] is None:
        raise CodegenError("no build is named", where="--build", remedy="`codegen build` makes one; or use codegen suite")
    chosen = Outputs(**{key: given.pop(key) for key in OUTPUTS}, **{key: given[key] for key in SHARED})
    chosen.check(given["map"])
    chosen.finish(codegen.run(**given, progress=console.shown))


OUTPUTS = ("plot", "csv", "files", "as_json")
SHARED = ("scenario", "clock_drift_ppm", "jitter_ms", "sensors", "seed")
"""Options that the outputs of a run need, and those that the run itself needs too."""


def _refuse_with_suite(context: click.Context, allowed: str) -> None:
    for option in context.command.params:
        given = context.get_parameter_source(option.name or "") is click.core.ParameterSource.COMMANDLINE
        if option.name in OF_A_SCENARIO and option.name != allowed and given:
            remedy = "leave one of the two out"
            raise CodegenError("it applies to a single scenario, not to --suite", where=option.opts[0], remedy=remedy)
