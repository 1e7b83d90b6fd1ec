"""Commands that lead from the configuration to the generated C: solve, tune, build."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import (
    case_names,
    configuration_file,
    folder_to_write,
    map_file,
    map_to_write,
    memory_size,
    yaw_rate_error,
)
from codegen.errors import CodegenError


@cli.command(short_help="Create DIR/ars.toml to edit.", epilog=example("codegen init my-car && cd my-car"))
@click.argument("folder", metavar="DIR", type=folder_to_write)
@click.option(
    "--preset",
    type=click.Choice(["recommended", "paper"]),
    default="recommended",
    show_default=True,
    help="The controller: the recommended one, or the paper's PI.",
)
def init(folder: Path, preset: str) -> None:
    """Create DIR/ars.toml, the paper's vehicle with comments and units, to edit."""
    show(codegen.init(folder, preset), False)


@cli.command(short_help="Print the JSON Schema of ars.toml.", epilog=example("codegen schema > ars.schema.json"))
def schema() -> None:
    """Print the JSON Schema of ars.toml, for completion and checks in editors.

    The first line of a file that `codegen init` makes names ars.schema.json, where editors look for it.
    """
    console.print_json(codegen.schema())


@cli.command(
    short_help="Solve one case and write the map.", epilog=example("codegen solve --config ars.toml --case 4ws-2 -o 4ws2.npz")
)
@click.option("--config", type=configuration_file, help="ars.toml; by default the paper's preset.")
@click.option(
    "--case",
    required=True,
    metavar="NAME",
    shell_complete=case_names,
    help="fws, 4ws-1, 4ws-2, a case of your own, or for comparison zero-sideslip, variable-wheelbase, envelope.",
)
@click.option("-o", "--output", required=True, type=map_to_write, metavar="MAP.npz", help="The map to write.")
@click.option(
    "--method",
    type=click.Choice(["exact", "ipopt"]),
    default="exact",
    show_default=True,
    help="exact: all points at once (closed form; nonlinear tyre: Newton's method); ipopt: point by point, as a reference.",
)
@click.option(
    "--friction",
    metavar="LIST",
    help="Solve a stack, such as 0.3,0.5,0.7,0.9: one map for each friction; the largest is road.friction.",
)
@click.option(
    "--longitudinal-acceleration",
    metavar="LIST",
    help="Solve a stack over longitudinal acceleration in m/s^2, such as -4,0,3; 0 is the map itself.",
)
@click.option(
    "--uncertain",
    "share",
    type=float,
    metavar="SHARE",
    help="Tighten the limits until this share of the cars within [identified] keeps them, such as 0.99. The map with the whole "
    "limits is written to MAP-nominal.npz.",
)
@json_option
def solve(
    config: Path | None, output: Path, friction: str | None, longitudinal_acceleration: str | None, as_json: bool, **given: Any
) -> None:
    """Solve the optimisation of one case on the configured grid and write the map."""
    from codegen.emit.folder import check_output

    nominal_path = output.with_name(f"{output.stem}-nominal.npz")
    for path in (output,) if given["share"] is None else (output, nominal_path):
        check_output(path, ".npz", (config,))
    found = codegen.solve(
        config,
        friction=_numbers(friction, "--friction"),
        longitudinal_acceleration=_numbers(longitudinal_acceleration, "--longitudinal-acceleration"),
        **given,
        progress=console.shown,
    )
    if found.nominal is not None:
        found.nominal.save(nominal_path)
    found.save(output)
    if config is None and not as_json:
        console.note("no --config: using the paper's preset")
    show(found, as_json)


@cli.command(short_help="Generate the C of a map.", epilog=example("codegen build --map 4ws2.npz"))
@click.option("--map", required=True, type=map_file, metavar="MAP.npz")
@click.option("--config", type=configuration_file, help="ars.toml; by default the map's own configuration.")
@click.option("-o", "--output", "folder", type=folder_to_write, metavar="DIR", help="By default generated/<name of the map>.")
@click.option("--prefix", default="ars", show_default=True, help="Prefix of all C names.")
@click.option("--precision", type=click.Choice(["single", "double"]), default="single", show_default=True)
@click.option(
    "--max-error",
    type=yaw_rate_error,
    metavar="RATE",
    help="Choose breakpoints for this largest error of the yaw rate against the optimum (for a map from "
    "another tool: against its own table), such as 0.05deg/s.",
)
@click.option(
    "--max-flash", type=memory_size, metavar="SIZE", help="Choose breakpoints for tables of at most this size, such as 4KiB."
)
@click.option(
    "--storage", type=click.Choice(["float", "int16"]), help="Number format with chosen breakpoints; by default float."
)
@click.option("--beyond-grip", is_flag=True, help="Accept a map that requires more lateral acceleration than road tyres reach.")
@click.option("--check", "write", flag_value=False, default=True, help="Write nothing; exit 1 if DIR is not up to date.")
@json_option
def build(as_json: bool, **given: Any) -> None:
    """Generate the C of a map: controller, lookup, dynamics, CMake, README, manifest."""
    show(codegen.build(**given, progress=console.shown), as_json)


@cli.command(short_help="Reproduce the paper's tables and plots.", epilog=example("codegen paper -o build"))
@click.option(
    "-o", "--output", "folder", required=True, type=folder_to_write, metavar="DIR", help="Folder for maps, C, plots and runs."
)
@json_option
def paper(folder: Path, as_json: bool) -> None:
    """Reproduce the paper: solve its three maps, build the C, run C1 and C2, compare its tables with ours."""
    show(codegen.paper(folder, progress=console.shown), as_json)


def _numbers(text: str | None, place: str) -> list[float] | None:
    """Return the numbers of a comma-separated list; None without one. Raises CodegenError."""
    if text is None:
        return None
    numbers = []
    for word in text.split(",") if text.strip() else ():
        try:
            numbers.append(float(word))
        except ValueError:
            what = f"{word.strip()!r} is not a number" if word.strip() else "a number is missing between commas or at an end"
            raise CodegenError(what, where=place, remedy="separate numbers by commas, such as 0.5,0.9") from None
    return numbers


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
    from codegen.emit.folder import check_output

    check_output(output, ".npz", (given["config"],))
    found = codegen.tune(**given, progress=console.shown)
    found.save(output)
    show(found, as_json)
