"""Options that the bench commands share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import click

from codegen.cli.base import json_option
from codegen.cli.values import (
    FiniteRange,
    build_folder,
    bus_names,
    csv_to_write,
    log_to_write,
    picture_to_write,
    run_to_write,
    scenario_names,
)

if TYPE_CHECKING:
    from hil_sim.scenarios import Scenario

Command = TypeVar("Command", bound=Callable[..., Any])

DEFAULT_SCENARIO = "step-steer"
SCENARIO_HELP = "One of codegen scenarios, a recorded .csv, or a .toml of your own."
OUTPUT_HELP = "Write the run: .mf4, .parquet or .csv; may be repeated."

build_option = click.option(
    "--build", "build_path", required=True, type=build_folder, metavar="DIR", help="A folder made by codegen build."
)
bus_option = click.option(
    "--bus",
    "bus",
    required=True,
    metavar="INTERFACE:CHANNEL",
    shell_complete=bus_names,
    help="Interface and channel of python-can, e.g. socketcan:vcan0.",
)
scenario_option = click.option(
    "--scenario",
    "scenario",
    default=DEFAULT_SCENARIO,
    show_default=True,
    metavar="NAME|FILE",
    shell_complete=scenario_names,
    help=SCENARIO_HELP,
)
clock_option = click.option(
    "--lock-step/--real-time",
    "lock_step",
    default=False,
    help="Run in simulated time, as fast as possible, or in real time (default).",
)
xcp_option = click.option(
    "--xcp", is_flag=True, help="Let a calibration tool measure and calibrate the native ECU: XCP on CAN, ids of [can]."
)
log_option = click.option("--log", type=log_to_write, metavar="FILE", help="Log the bus: .blf, .asc, .log (candump) or .mf4.")


def output_option(text: str, metavar: str = "FILE") -> Callable[[Command], Command]:
    """Return the option -o, --output, which may be repeated: the run as a file in the format of the extension."""
    return click.option("-o", "--output", "files", type=run_to_write, multiple=True, metavar=metavar, help=text)


def sensor_options(command: Command) -> Command:
    """Add --sensors and --seed."""
    command = click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of noise, faults, jitter and random cars.",
    )(command)
    return click.option("--sensors", is_flag=True, help="Simulate the noise, delay and resolution of [sensors].")(command)


def drift_options(command: Command) -> Command:
    """Add --clock-drift and --jitter."""
    command = click.option(
        "--jitter",
        "jitter_ms",
        type=FiniteRange(min=0.0, max=100.0),
        metavar="MS",
        help="Largest deviation of frames and task from their clocks.",
    )(command)
    return click.option(
        "--clock-drift",
        "drift_ppm",
        type=FiniteRange(min=-1e4, max=1e4),
        metavar="PPM",
        help="Let the car's clock run faster than the ECU's.",
    )(command)


def with_clocks(scenario: Scenario, drift_ppm: float | None, jitter_ms: float | None) -> Scenario:
    """Return the scenario, with two clocks if one of the options is given."""
    from hil_sim.clocks import Clocks

    if drift_ppm is None and jitter_ms is None:
        return scenario
    return replace(scenario, clocks=Clocks(drift_ppm or 0.0, jitter_ms or 0.0))


def result_options(command: Command) -> Command:
    """Add --plot, --csv and --json."""
    command = json_option(command)
    command = click.option("--csv", type=csv_to_write, metavar="CSV", help="Write the run, units in the column names.")(command)
    return click.option("--plot", type=picture_to_write, metavar="PNG", help="Plot the run and the passive car.")(command)


def run_options(command: Command) -> Command:
    """Add all options of a run on a bus."""
    output = output_option(OUTPUT_HELP)
    options = (result_options, output, log_option, drift_options, sensor_options, clock_option, scenario_option, bus_option)
    for option in options:
        command = option(command)
    return command
