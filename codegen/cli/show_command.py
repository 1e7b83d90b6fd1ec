"""The command that prints a map, its flash size, and its changes from another map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.values import configuration_file, map_file, picture_to_write
from codegen.errors import CodegenError, MapError, within

if TYPE_CHECKING:
    from codegen.map_file.map import ReferenceMap

EXAMPLE = "codegen show 4ws2.npz --plot map.png\n  codegen show 4ws2.npz --against nonlinear.npz --plot difference.png"


@click.command(short_help="Print the contents of a map, or plot it.", epilog=example(EXAMPLE))
@click.argument("map_path", metavar="MAP.npz", type=map_file)
@click.option(
    "--plot", "plot", type=picture_to_write, metavar="PNG", help="Also draw it: the map, both maps, or error against flash."
)
@click.option("--against", type=map_file, metavar="OTHER.npz", help="Print the changes from this map to another one instead.")
@click.option(
    "--flash",
    is_flag=True,
    help="Print the flash size of chosen breakpoints for errors from 1 to 0.02 deg/s instead; takes minutes.",
)
@click.option("--config", "config_path", type=configuration_file, help="With --flash: ars.toml with the kind of controller.")
@json_option
def show(map_path: Path, plot: Path | None, against: Path | None, flash: bool, config_path: Path | None, as_json: bool) -> None:
    """Print a map: axes, units, ranges, feasibility and binding constraints."""
    from codegen.emit.outputs import check_output
    from codegen.map_file import map as npz
    from codegen.plausibility.map import beyond_grip
    from codegen.report.summary import map_summary
    from codegen.text_table import text_table

    check_output(plot, ".png", (map_path, config_path, against))
    if against is not None and flash:
        raise CodegenError("cannot be combined with --flash", where="--against", remedy="leave one of them out")
    if config_path is not None and not flash:
        raise CodegenError("has no effect here", where="--config", remedy="add --flash, or leave it out")
    reference_map = npz.load(map_path)
    if flash:
        _show_flash(map_path, reference_map, config_path, plot, as_json)
        return
    if against is not None:
        _show_difference(map_path, reference_map, against, plot, as_json)
        return
    summary = map_summary(reference_map)
    if plot is not None:
        from codegen.report.map_plots import map_figure
        from codegen.report.style import save

        with console.status("drawing"):
            save(map_figure(reference_map, map_path.stem), plot)
    if as_json:
        console.print_json({"map": str(map_path), **summary.to_dict(), "plot": None if plot is None else str(plot)})
        return
    if text := beyond_grip(reference_map):
        console.warn(text)
    console.say(f"{map_path}: {summary.headline}")
    if summary.tyre_line:
        console.say(summary.tyre_line)
    console.say(text_table(("", "from", "to", "unit", "points"), summary.axis_rows))
    console.say("")
    console.say(text_table(("", "from", "to", "unit"), summary.value_rows))
    if summary.binding_rows:
        console.say("")
        console.say(text_table(("what binds", "cells", "share"), summary.binding_rows))
    if summary.stack_rows:
        console.say("")
        console.say(
            text_table(("friction", "feasible cells", "share", "lateral acceleration, largest [m/s^2]"), summary.stack_rows)
        )
    if plot is not None:
        console.say(f"\nplot: {plot}")


def _show_difference(map_path: Path, first: ReferenceMap, against: Path, plot: Path | None, as_json: bool) -> None:
    """Print the changes from one map to another."""
    from codegen.map_file import map as npz
    from codegen.optimum.slip_use import slip_use
    from codegen.report.map_difference import (
        CAR_HEADER,
        DIFFERENCE_HEADER,
        POINT_HEADER,
        caveats,
        map_difference,
        map_difference_figure,
        same_car,
    )
    from codegen.text_table import text_table

    if against.exists() and against.samefile(map_path):
        raise CodegenError("is the map itself", where=f"--against {against}", remedy="name another map")
    second = npz.load(against)
    with console.status("comparing"):
        used = (slip_use(first), slip_use(second))
        try:
            found = map_difference(first, second, used)
        except MapError as error:
            raise MapError(error.what, where=f"{map_path}, {against}", remedy=error.remedy) from error
    if plot is not None:
        from codegen.report.style import save

        with console.status("drawing"):
            names = (map_path.stem, against.stem)
            save(map_difference_figure((first, second), used, names), plot)
    if as_json:
        written = None if plot is None else str(plot)
        console.print_json({"map": str(map_path), "against": str(against), **found.to_dict(), "plot": written})
        return
    if same_car(first, second) is False:
        console.note("the maps are of different cars or roads")
    for text in caveats(first, second):
        console.note(text)
    console.say(f"first:  {map_path}\nsecond: {against}\n")
    console.say(text_table(CAR_HEADER, found.rows))
    console.say("")
    console.say(text_table(DIFFERENCE_HEADER, [found.difference_row]))
    if found.points:
        console.say("\nyaw rate r [deg/s] and rear angle [deg]:")
        console.say(text_table(POINT_HEADER, found.point_rows))
    if plot is not None:
        console.say(f"\nplot: {plot}")


def _show_flash(
    map_path: Path, reference_map: ReferenceMap, config_path: Path | None, plot: Path | None, as_json: bool
) -> None:
    """Print the flash size of chosen breakpoints, for the kind of controller of the configuration."""
    from codegen.ecu_map.placement_sweep import flash_table
    from codegen.emit.laws import law_of
    from codegen.map_file.choose import choose_config
    from codegen.report.flash import HEADER, flash_dict, flash_figure, flash_headline, flash_rows
    from codegen.text_table import text_table

    chosen = choose_config(reference_map, config_path)
    tables = 2 if law_of(chosen.config).uses_rear_angle else 1
    with within(map_path), console.progress("placing breakpoints") as progress:
        found = flash_table(reference_map, chosen.config, tables, progress=progress)
    if plot is not None:
        from codegen.report.style import save

        save(flash_figure(found, map_path.stem), plot)
    if as_json:
        console.print_json({"map": str(map_path), **flash_dict(found), "plot": None if plot is None else str(plot)})
        return
    for text in chosen.notes:
        console.note(text)
    console.say(f"{map_path}: {flash_headline(found)}\n")
    console.say(text_table(HEADER, flash_rows(found)))
    if plot is not None:
        console.say(f"\nplot: {plot}")


COMMANDS = (show,)
