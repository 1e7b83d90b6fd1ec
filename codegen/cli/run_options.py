"""Options that the commands of the bench share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from codegen.cli.base import file_type, json_option

Command = TypeVar("Command", bound=Callable[..., Any])

DEFAULT_SCENARIO = "step-steer"
SCENARIO_HELP = "One of codegen scenarios, a recorded .csv, or a .toml of your own."

build_option = click.option(
    "--build", "build_path", required=True, type=file_type, metavar="DIR", help="A folder made by codegen build."
)
bus_option = click.option(
    "--bus", "bus", required=True, metavar="INTERFACE:CHANNEL", help="Any of python-can, e.g. socketcan:vcan0."
)
scenario_option = click.option(
    "--scenario", "scenario", default=DEFAULT_SCENARIO, show_default=True, metavar="NAME|FILE", help=SCENARIO_HELP
)
clock_option = click.option(
    "--lock-step/--real-time",
    "lock_step",
    default=False,
    help="Simulated time, as fast as it goes, or by the clock (default).",
)
log_option = click.option("--log", type=file_type, metavar="FILE", help="Log the bus: .blf, .asc, .log (candump) or .mf4.")


def sensor_options(command: Command) -> Command:
    """--sensors and --seed."""
    command = click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of noise and faults.")(
        command
    )
    return click.option("--sensors", is_flag=True, help="Measure with the noise, delay and steps of [sensors].")(command)


def result_options(command: Command) -> Command:
    """--plot, --csv and --json."""
    command = json_option(command)
    command = click.option("--csv", type=file_type, metavar="CSV", help="Write the run, units in the column names.")(command)
    return click.option("--plot", type=file_type, metavar="PNG", help="Draw the run beside the passive car.")(command)


def run_options(command: Command) -> Command:
    """All options of a run on a bus."""
    for option in (result_options, log_option, sensor_options, clock_option, scenario_option, bus_option):
        command = option(command)
    return command
