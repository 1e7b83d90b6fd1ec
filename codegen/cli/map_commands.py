"""Commands from the configuration to the generated C."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from codegen import console
from codegen.cli.base import example, file_type, json_option
from codegen.errors import CheckFailed, CodegenError, within

if TYPE_CHECKING:
    from codegen.refmap.map import ReferenceMap

LATERAL_ACCELERATION_NOTE_G = 1.5
"""Maps that ask for more than this are built, but their user is asked about the units."""


@click.command(short_help="Make DIR/ars.toml to edit.", epilog=example("codegen init my-car && cd my-car"))
@click.argument("folder", metavar="DIR", type=file_type)
@click.option(
    "--preset",
    "preset",
    type=click.Choice(["recommended", "paper"]),
    default="recommended",
    show_default=True,
    help="The controller: the recommended one, or the paper's PI.",
)
def init(folder: Path, preset: str) -> None:
    """Make DIR/ars.toml, the paper's vehicle with comments and units, to edit."""
    from codegen.config import preset_text
    from codegen.files import make_folder, write_atomically

    path = folder / "ars.toml"
    if path.exists() or path.is_symlink():
        raise CodegenError("already there and left as it is", where=path, remedy="name another folder, or edit that file")
    make_folder(folder)
    write_atomically(path, preset_text("paper" if preset == "paper" else "recommended").encode("utf-8"))
    then = "" if preset == "paper" else ", codegen tune --map 4ws2.npz -o 4ws2.npz"
    console.say(f"{path}: the paper's vehicle, to edit; next: codegen solve --config {path} --case 4ws-2 -o 4ws2.npz{then}")


@click.command(
    short_help="Solve one case and write the map.", epilog=example("codegen solve --config ars.toml --case 4ws-2 -o 4ws2.npz")
)
@click.option("--config", "config_path", type=file_type, help="ars.toml; by default the paper's preset.")
@click.option("--case", "case", required=True, metavar="NAME", help="fws, 4ws-1, 4ws-2 or a case of your own.")
@click.option("-o", "--output", required=True, type=file_type, metavar="MAP.npz", help="The map to write.")
@click.option(
    "--method",
    type=click.Choice(["exact", "ipopt"]),
    default="exact",
    show_default=True,
    help="Closed form, or IPOPT point by point (the reference).",
)
@click.option(
    "--friction",
    "friction_list",
    metavar="LIST",
    help="Solve a stack, such as 0.3,0.5,0.7,0.9: one map for each friction; the largest is road.friction.",
)
@json_option
def solve(config_path: Path | None, case: str, output: Path, method: str, friction_list: str | None, as_json: bool) -> None:
    """Solve the optimisation of one case on the configured grid and write the map."""
    from codegen.emit.outputs import check_output
    from codegen.refmap import map as npz
    from codegen.refmap.choose import choose_config
    from codegen.refmap.solve import Method, solve_case
    from codegen.refmap.stack import solve_stack
    from codegen.report.summary import map_summary

    check_output(output, ".npz", (config_path,))
    friction = None if friction_list is None else _numbers(friction_list, "--friction")
    chosen = choose_config(None, config_path)
    solver: Method = "ipopt" if method == "ipopt" else "exact"
    title = f"solving {case}" + ("" if friction is None else f" for {len(friction)} frictions")
    with within(config_path or "the paper's preset"), console.progress(title) as progress:
        if friction is None:
            reference_map = solve_case(chosen.config, case, solver, progress)
        else:
            reference_map = solve_stack(chosen.config, case, friction, solver, progress)
    npz.save(reference_map, output)
    summary = map_summary(reference_map)
    if as_json:
        console.print_json({"map": str(output), "configuration": chosen.source, **summary.to_dict()})
        return
    for text in chosen.notes:
        console.note(text)
    if config_path is None:
        console.note("no --config: the paper's preset is taken")
    console.say(f"{output}: {summary.headline}")


@click.command(short_help="Tell what a map holds, and draw it.", epilog=example("codegen show 4ws2.npz --plot map.png"))
@click.argument("map_path", metavar="MAP.npz", type=file_type)
@click.option("--plot", "plot", type=file_type, metavar="PNG", help="Also draw the map.")
@json_option
def show(map_path: Path, plot: Path | None, as_json: bool) -> None:
    """Tell what a map holds: axes, units, ranges, feasibility, what binds where."""
    from codegen.emit.outputs import check_output
    from codegen.refmap import map as npz
    from codegen.report.summary import map_summary, table

    check_output(plot, ".png", (map_path,))
    reference_map = npz.load(map_path)
    summary = map_summary(reference_map)
    if plot is not None:
        from codegen.report import plots

        plots.save(plots.map_figure(reference_map, map_path.stem), plot)
    if as_json:
        console.print_json({"map": str(map_path), **summary.to_dict(), "plot": None if plot is None else str(plot)})
        return
    _note_lateral_acceleration(reference_map)
    console.say(f"{map_path}: {summary.headline}")
    console.say(table(("", "from", "to", "unit", "points"), summary.axis_rows))
    console.say("")
    console.say(table(("", "from", "to", "unit"), summary.value_rows))
    if summary.binding_rows:
        console.say("")
        console.say(table(("what binds", "cells", "share"), summary.binding_rows))
    if summary.stack_rows:
        console.say("")
        console.say(table(("friction", "feasible cells", "share", "lateral acceleration, largest [m/s^2]"), summary.stack_rows))
    if plot is not None:
        console.say(f"\nplot: {plot}")


@click.command(short_help="Generate the C of a map.", epilog=example("codegen build --map 4ws2.npz"))
@click.option("--map", "map_path", required=True, type=file_type, metavar="MAP.npz")
@click.option("--config", "config_path", type=file_type, help="ars.toml; by default the map's own configuration.")
@click.option("-o", "--output", type=file_type, metavar="DIR", help="By default generated/<name of the map>.")
@click.option("--prefix", default="ars", show_default=True, help="Start of all C names.")
@click.option("--precision", type=click.Choice(["single", "double"]), default="single", show_default=True)
@click.option("--check", is_flag=True, help="Write nothing; exit 1 where DIR is not up to date.")
@json_option
def build(
    map_path: Path,
    config_path: Path | None,
    output: Path | None,
    prefix: str,
    precision: str,
    check: bool,
    as_json: bool,
) -> None:
    """Generate the C of a map: controller, lookup, dynamics, CMake, README, manifest."""
    from codegen.emit.evidence import margin_note
    from codegen.emit.folder import differences
    from codegen.emit.from_files import prepare
    from codegen.emit.write import write_folder

    prepared = prepare(map_path, config_path, output, prefix, "double" if precision == "double" else "single")
    if not as_json:
        for text in prepared.chosen.notes:
            console.note(text)
        _note_lateral_acceleration(prepared.reference_map)
    target, files = prepared.target, [*sorted(prepared.folder.files), "manifest.json"]
    if check:
        found = differences(prepared.folder, target)
        if as_json:
            console.print_json({"build": str(target), "up_to_date": not found, "differences": found})
        if found:
            more = f" and {len(found) - 1} more" if len(found) > 1 else ""
            raise CheckFailed(f"not up to date: {found[0]}{more}", where=target, remedy="run the same command without --check")
        if not as_json:
            console.say(f"{target}: up to date")
        return
    changed = write_folder(prepared.folder, target)
    little_margin = margin_note(prepared.folder.manifest)
    notes = [*prepared.chosen.notes, *filter(None, [little_margin])]
    result = {"build": str(target), "changed": changed, "files": files, "configuration": prepared.chosen.source}
    if as_json:
        console.print_json({**result, "notes": notes})
        return
    state = "" if changed else " (unchanged)"
    if little_margin:
        console.note(little_margin)
    console.say(f"{target}: {len(files)} files{state}; start with {target / 'README.md'}")


@click.command(short_help="Reproduce the paper's tables and plots.", epilog=example("codegen paper -o build"))
@click.option("-o", "--output", required=True, type=file_type, metavar="DIR", help="Where maps, C, plots and runs go.")
@json_option
def paper(output: Path, as_json: bool) -> None:
    """Reproduce the paper: solve its three maps, build the C, run C1 and C2, print its tables beside ours."""
    from codegen.report.paper import reproduce

    result = reproduce(output)
    if as_json:
        console.print_json(result.to_dict())
        return
    for line in result.lines():
        console.say(line)


def _numbers(text: str, place: str) -> list[float]:
    """The numbers of a list with commas. Raises CodegenError."""
    numbers = []
    for word in text.split(",") if text.strip() else ():
        try:
            numbers.append(float(word))
        except ValueError:
            what = f"{word.strip()!r} is no number" if word.strip() else "a number is missing between two commas or at an end"
            raise CodegenError(what, where=place, remedy="give numbers with commas between them, such as 0.5,0.9") from None
    return numbers


def _note_lateral_acceleration(reference_map: ReferenceMap) -> None:
    import numpy as np

    largest = float(np.nanmax(reference_map.speed[:, np.newaxis] * reference_map.yaw_rate)) / 9.81
    if largest > LATERAL_ACCELERATION_NOTE_G:
        console.note(f"the map asks for up to {largest:.2g} g of lateral acceleration; is vx in m/s and yaw_rate in rad/s?")


COMMANDS = (init, solve, show, build, paper)
