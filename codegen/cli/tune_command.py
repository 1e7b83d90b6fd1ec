"""The command that designs the feedback gains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import configuration_file, map_file, map_to_write


@cli.command(short_help="Design the gains of a map's controller.", epilog=example("codegen tune --map map.npz -o map.npz"))
@click.option("--map", required=True, type=map_file, metavar="MAP.npz")
@click.option("--config", type=configuration_file, help="ars.toml; by default the map's own configuration.")
@click.option(
    "-o",
    "--output",
    required=True,
    type=map_to_write,
    metavar="MAP.npz",
    help="The map to write; may be the input map.",
)
@json_option
def tune(output: Path, as_json: bool, **given: Any) -> None:
    """Design the gains over speed such that the whole family of [tuning] keeps its margins, and store them in the map.

    Deviations that codegen identify measured replace those of [tuning].

    For a solved map, step responses of the simulated car determine the lead of the front angle and the response gain, and
    simulated losses of all signals determine the rate of the fail-safe. For a map of the nonlinear tyre, the trim is raised
    until its slip bounds are kept in steady state.

    Finally the car is driven with the tuned controller and without it. The judgement is stored in the map, for
    codegen check, show, build, report and explore.
    """
    from codegen.emit.outputs import check_output

    check_output(output, ".npz", (given["config"],))
    found = codegen.tune(**given, progress=console.shown)
    found.save(output)
    show(found, as_json)
