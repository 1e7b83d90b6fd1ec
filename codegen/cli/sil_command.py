"""The command that runs the generated C in software: one scenario, or the whole test set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from codegen import console
from codegen.cli.base import example, file_type
from codegen.cli.run_options import DEFAULT_SCENARIO, SCENARIO_HELP, result_options, sensor_options
from codegen.errors import CheckFailed, CodegenError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from codegen.sil.software import Software
    from hil_sim.bench import BenchResult
    from hil_sim.scenarios import Scenario

WITH_SUITE = ("build_path", "plot", "as_json", "suite", "folder")
"""Options that go with --suite; the others are about one scenario."""


@click.command(
    short_help="Run the generated C in closed loop.",
    epilog=example("codegen sil --build generated/4ws2 --plot run.png --csv run.csv"),
)
@click.option("--build", "build_path", type=file_type, metavar="DIR", help="A folder made by codegen build.")
@click.option("--map", "map_path", type=file_type, metavar="MAP.npz", help="Take the car of this map instead of the build's.")
@click.option("--scenario", "scenario", metavar="NAME|FILE", show_default=DEFAULT_SCENARIO, help=SCENARIO_HELP)
@click.option("--baselines", "baselines", is_flag=True, help="Show the paper's PI, feedforward and a proportional law beside.")
@click.option("--can", "through_can", is_flag=True, help="Through the task and its CAN frames, in this process, without a bus.")
@sensor_options
@click.option(
    "--suite",
    "suite",
    metavar="NAME",
    help="The whole test set (tracking) instead of a scenario: of the build, or of the recommended preset made in memory.",
)
@click.option("-o", "--output", "folder", type=file_type, metavar="DIR", help="With --suite: all its pictures.")
@result_options
@click.pass_context
def sil(
    context: click.Context,
    build_path: Path | None,
    map_path: Path | None,
    scenario: str | None,
    baselines: bool,
    through_can: bool,
    sensors: bool,
    seed: int,
    suite: str | None,
    folder: Path | None,
    plot: Path | None,
    csv: Path | None,
    as_json: bool,
) -> None:
    """Run the generated C in closed loop with the two-track plant, software in the loop.

    With --suite tracking, drive the controller and its baselines in every cell of the test set, and hold the figures against
    what is asked; exit 1 where one is missed.
    """
    if suite is not None:
        _refuse_with_suite(context)
        from codegen.cli.suite_command import SuiteOutputs, run_suite_command

        run_suite_command(suite, build_path, SuiteOutputs(plot, folder, as_json))
        return
    if build_path is None:
        raise CodegenError("no build is named", where="--build", remedy="make one with `codegen build`, or give --suite tracking")
    if folder is not None:
        raise CodegenError("it is for the pictures of --suite", where="-o", remedy="name the picture of a run with --plot")
    _one_scenario(build_path, map_path, scenario or DEFAULT_SCENARIO, baselines, through_can, sensors, seed, plot, csv, as_json)
