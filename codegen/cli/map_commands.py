"""Commands that lead from the configuration to the generated C."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option
from codegen.cli.options import (
    Quantity,
    case_names,
    configuration_file,
    folder_to_write,
    map_file,
    map_to_write,
    memory_size,
    yaw_rate_error,
)
from codegen.errors import CheckFailed, CodegenError, within
from codegen.files import make_folder, write_atomically

if TYPE_CHECKING:
    from codegen.ecu_map.placement import Request
    from codegen.optimum.uncertain import UncertainMap


@cli.command(short_help="Create DIR/ars.toml to edit.", epilog=example("codegen init my-car && cd my-car"))
@click.argument("folder", metavar="DIR", type=folder_to_write)
@click.option(
    "--preset",
    "preset",
    type=click.Choice(["recommended", "paper"]),
    default="recommended",
    show_default=True,
    help="The controller: the recommended one, or the paper's PI.",
)
def init(folder: Path, preset: str) -> None:
    """Create DIR/ars.toml, the paper's vehicle with comments and units, to edit."""
    from codegen.configuration import preset_text

    path = folder / "ars.toml"
    if path.exists() or path.is_symlink():
        raise CodegenError("exists already and was not changed", where=path, remedy="name another folder, or edit that file")
    make_folder(folder)
    write_atomically(path, preset_text("paper" if preset == "paper" else "recommended").encode("utf-8"))
    then = "" if preset == "paper" else ", codegen tune --map 4ws2.npz -o 4ws2.npz"
    console.say(f"{path}: the paper's vehicle, to edit; next: codegen solve --config {path} --case 4ws-2 -o 4ws2.npz{then}")


@cli.command(
    short_help="Solve one case and write the map.", epilog=example("codegen solve --config ars.toml --case 4ws-2 -o 4ws2.npz")
)
@click.option("--config", "config_path", type=configuration_file, help="ars.toml; by default the paper's preset.")
@click.option(
    "--case",
    "case",
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
    "friction_list",
    metavar="LIST",
    help="Solve a stack, such as 0.3,0.5,0.7,0.9: one map for each friction; the largest is road.friction.",
)
@click.option(
    "--longitudinal-acceleration",
    "acceleration_list",
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
    config_path: Path | None,
    case: str,
    output: Path,
    method: str,
    friction_list: str | None,
    acceleration_list: str | None,
    share: float | None,
    as_json: bool,
) -> None:
    """Solve the optimisation of one case on the configured grid and write the map."""
    from codegen.emit.outputs import check_output
    from codegen.map_file import map as npz
    from codegen.map_file.map import choose_config
    from codegen.optimum.like_friction import friction_errors
    from codegen.optimum.solve import ACCELERATION_OPTION, Method, solve_acceleration_stack, solve_case, solve_stack
    from codegen.optimum.uncertain import solve_uncertain
    from codegen.plausibility.car import Handling, car_warnings
    from codegen.plausibility.map import MapFacts, map_warnings
    from codegen.report.summary import map_summary

    check_output(output, ".npz", (config_path,))
    if friction_list is not None and acceleration_list is not None:
        raise CodegenError("a map has one stack", where=ACCELERATION_OPTION, remedy="leave it or --friction out")
    nominal_path = output.with_name(f"{output.stem}-nominal.npz")
    if share is not None:
        other = {"--friction": friction_list, ACCELERATION_OPTION: acceleration_list}
        for option in (*(name for name, value in other.items() if value), *(["--method ipopt"] if method == "ipopt" else [])):
            raise CodegenError("cannot be combined with --uncertain", where=option, remedy="leave one of them out")
        check_output(nominal_path, ".npz", (config_path,))
    friction = None if friction_list is None else _numbers(friction_list, "--friction")
    acceleration = None if acceleration_list is None else _numbers(acceleration_list, ACCELERATION_OPTION)
    chosen = choose_config(None, config_path)
    solver: Method = "ipopt" if method == "ipopt" else "exact"
    title = f"solving {case}" + ("" if friction is None else f" for {len(friction)} frictions")
    title += "" if acceleration is None else f" for {len(acceleration)} accelerations"
    title += "" if share is None else f" for {100.0 * share:g} % of the cars"
    uncertain = None
    with within(config_path or "the paper's preset"), console.progress(title) as progress:
        if friction is not None:
            reference_map = solve_stack(chosen.config, case, friction, solver, progress)
        elif acceleration is not None:
            reference_map = solve_acceleration_stack(chosen.config, case, acceleration, solver, progress)
        elif share is not None:
            uncertain = solve_uncertain(chosen.config, case, share, progress)
            reference_map = uncertain.map
        else:
            reference_map = solve_case(chosen.config, case, solver, progress)
        alike = friction_errors(reference_map)
    if uncertain is not None:
        npz.save(uncertain.nominal, nominal_path)
    npz.save(reference_map, output)
    summary = map_summary(reference_map)
    handling, facts = Handling.from_config(chosen.config), MapFacts.of_map(reference_map, chosen.config)
    warnings = [*car_warnings(chosen.config), *map_warnings(reference_map, chosen.config)]
    if as_json:
        origin = {"map": str(output), "configuration": chosen.source, "notes": list(chosen.notes), "warnings": warnings}
        like = {"like_friction": [one.to_dict() for one in alike]} if alike else {}
        cost = {} if uncertain is None else {"nominal": {"map": str(nominal_path), **_cost(uncertain)}}
        console.print_json({**origin, "handling": handling.to_dict(), **facts.to_dict(), **summary.to_dict(), **like, **cost})
        return
    console.note(*chosen.notes)
    if config_path is None:
        console.note("no --config: using the paper's preset")
    console.warn(*warnings)
    console.say(f"{output}: {summary.headline}")
    console.say(f"car: {handling}")
    console.say(*(f"map: {line}" for line in facts.lines()))
    console.say(*(f"map: {one.line}" for one in alike))
    if uncertain is not None:
        console.say(f"map: {summary.tightening_line}")
        cost = _cost(uncertain)
        mean, largest = (f"{cost[key]:.2f} deg/s" for key in ("yaw_rate_mean_deg_s", "yaw_rate_max_deg_s"))
        console.say(
            f"{nominal_path}: the map with the whole limits; {cost['lost_percent']:.0f} % of the cars exceed one. Its yaw rate "
            f"is {mean} larger on average, at most {largest} at {cost['at']}, and {cost['cells']} more cells are feasible"
        )


def _cost(uncertain: UncertainMap) -> dict[str, Any]:
    """Return what the nominal map has more than the tightened one, as JSON values."""
    from codegen.report.map_difference import map_difference

    found = map_difference(uncertain.nominal, uncertain.map, (None, None))
    return {
        "lost_percent": 100.0 * uncertain.lost_by_nominal,
        "yaw_rate_mean_deg_s": found.mean_deg_s,
        "yaw_rate_max_deg_s": found.largest_deg_s,
        "at": str(found.largest_at),
        "cells": found.only_first - found.only_second,
    }


@cli.command(short_help="Generate the C of a map.", epilog=example("codegen build --map 4ws2.npz"))
@click.option("--map", "map_path", required=True, type=map_file, metavar="MAP.npz")
@click.option("--config", "config_path", type=configuration_file, help="ars.toml; by default the map's own configuration.")
@click.option("-o", "--output", type=folder_to_write, metavar="DIR", help="By default generated/<name of the map>.")
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
@click.option("--check", is_flag=True, help="Write nothing; exit 1 if DIR is not up to date.")
@json_option
def build(
    map_path: Path,
    config_path: Path | None,
    output: Path | None,
    prefix: str,
    precision: str,
    max_error: Quantity | None,
    max_flash: Quantity | None,
    storage: str | None,
    beyond_grip: bool,
    check: bool,
    as_json: bool,
) -> None:
    """Generate the C of a map: controller, lookup, dynamics, CMake, README, manifest."""
    from codegen.emit.evidence import placement_line, placement_summary
    from codegen.emit.from_files import prepare
    from codegen.emit.text import Precision
    from codegen.emit.write import check_target
    from codegen.judgement.check import all_warnings
    from codegen.judgement.model import of_map
    from codegen.plausibility.map import require_grip

    request = _request(max_error, max_flash, storage)
    if request is not None and output is not None:
        check_target(output)  # before a search, which takes long
    judge = None if beyond_grip else require_grip
    chosen: Precision = "double" if precision == "double" else "single"
    with console.status(f"generating the C of {map_path}"):
        prepared = prepare(map_path, config_path, output, prefix, chosen, request=request, judge=judge)
    if not as_json:
        console.note(*prepared.chosen.notes)
    target, files = prepared.target, [*sorted(prepared.folder.files), "manifest.json"]
    if check:
        found, others = prepared.differences(), prepared.other_tools
        if as_json:
            result = {"build": str(target), "up_to_date": not found, "differences": found}
            console.print_json({**result, "other_tools": others})
        if found:
            more = f" and {len(found) - 1} more" if len(found) > 1 else ""
            raise CheckFailed(f"not up to date: {found[0]}{more}", where=target, remedy="run the same command without --check")
        if not as_json:
            console.note(*(f"the build was made with {each}: the same files" for each in others))
            console.say(f"{target}: up to date")
        return
    changed = prepared.write()
    manifest = prepared.folder.manifest
    stored = of_map(prepared.reference_map, prepared.chosen.config)
    warnings = [*all_warnings(prepared.chosen.config, prepared.reference_map, manifest), *stored.warnings]
    result = {"build": str(target), "changed": changed, "files": files, "configuration": prepared.chosen.source}
    result["limiter_cut"] = manifest["limiter_cut"]
    if request is not None:
        result["placement"] = placement_summary(manifest)
    if as_json:
        console.print_json({**result, "notes": list(prepared.chosen.notes), "warnings": warnings})
        return
    state = "" if changed else " (unchanged)"
    console.warn(*warnings)
    console.say(f"{target}: {len(files)} files{state}; start with {target / 'README.md'}")
    if not manifest["limiter_cut"]["cells"]:
        console.say("limiter: it cuts nothing off the map")
    if request is not None:
        console.say(placement_line(manifest))


def _request(max_error: Quantity | None, max_flash: Quantity | None, storage: str | None) -> Request | None:
    """Return the target for choosing breakpoints; None without one."""
    if max_error is None and max_flash is None:
        if storage is not None:
            remedy = "add --max-error or --max-flash, such as --max-error 0.05deg/s"
            raise CodegenError("applies only to chosen breakpoints", where="--storage", remedy=remedy)
        return None
    from codegen.ecu_map.placement import Request

    words = [f"--max-error {max_error.words}"] if max_error else []
    words += [f"--max-flash {max_flash.words}"] if max_flash else []
    words += [f"--storage {storage}"] if storage == "int16" else []
    return Request(
        max_error=max_error.value if max_error else None,
        max_flash=int(min(max_flash.value, 2.0**31)) if max_flash else None,
        storage="int16" if storage == "int16" else "float",
        words=" ".join(words),
    )


@cli.command(short_help="Reproduce the paper's tables and plots.", epilog=example("codegen paper -o build"))
@click.option("-o", "--output", required=True, type=folder_to_write, metavar="DIR", help="Folder for maps, C, plots and runs.")
@json_option
def paper(output: Path, as_json: bool) -> None:
    """Reproduce the paper: solve its three maps, build the C, run C1 and C2, compare its tables with ours."""
    with console.progress("reproducing the paper") as progress:
        progress(0, 1, "loading")
        from codegen.report.paper import reproduce

        result = reproduce(output, done=progress)
    if as_json:
        console.print_json(result.to_dict())
        return
    console.say(*result.lines())


def _numbers(text: str, place: str) -> list[float]:
    """Return the numbers of a comma-separated list. Raises CodegenError."""
    numbers = []
    for word in text.split(",") if text.strip() else ():
        try:
            numbers.append(float(word))
        except ValueError:
            what = f"{word.strip()!r} is not a number" if word.strip() else "a number is missing between commas or at an end"
            raise CodegenError(what, where=place, remedy="separate numbers by commas, such as 0.5,0.9") from None
    return numbers
