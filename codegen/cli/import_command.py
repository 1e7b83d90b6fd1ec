"""The command that imports maps and tyres from other tools."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.values import FileType, configuration_file
from codegen.errors import CodegenError

if TYPE_CHECKING:
    from codegen.importing.tyre import AxleImport, TyreImport

TYRE_ENDING = ".tir"
READ_ENDINGS = (".mat", ".csv", ".tsv", ".txt", ".dat", TYRE_ENDING)
MAP_OPTIONS = ("vx", "delta_f", "yaw_rate", "beta", "delta_r", "feasible")
READ = "supported are .mat, .csv, .tsv, .txt, .dat (a map) and .tir (a tyre)"


@click.command(
    name="import",
    short_help="Import a map from a .mat or text table, or tyres from .tir files.",
    epilog=example(
        "codegen import map.mat --units vx=km/h,delta_f=deg,yaw_rate=deg/s -o map.npz\n"
        "  codegen import table.csv -o map.npz\n"
        "  codegen import front.tir rear.tir --config ars.toml -o new.toml"
    ),
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=FileType(READ_ENDINGS))
@click.option(
    "-o",
    "--output",
    required=True,
    type=FileType((".npz", ".toml"), to_write=True),
    metavar="OUT",
    help="The map (.npz), or for tyres the new ars.toml (.toml).",
)
@click.option("--vx", metavar="NAME", help="Variable or column of the speeds, if it has no common name.")
@click.option("--delta-f", metavar="NAME", help="Variable or column of the front angles at the road wheel.")
@click.option("--yaw-rate", metavar="NAME", help="Variable or column of the yaw rates.")
@click.option("--beta", metavar="NAME", help="Variable or column of the sideslip angles; optional.")
@click.option("--delta-r", metavar="NAME", help="Variable or column of the rear angles; optional.")
@click.option(
    "--feasible", metavar="NAME", help="Variable or column of 1 and 0; by default cells without a value are infeasible."
)
@click.option(
    "--units", metavar="LIST", help="Units, such as vx=km/h,delta_f=deg,yaw_rate=deg/s, if the names do not contain them."
)
@click.option("--rows", type=click.Choice(["vx", "delta_f"]), help="Axis along the rows of a table, if it is ambiguous.")
@click.option(
    "--config", "config_path", type=configuration_file, help="For tyres: the ars.toml of the car, which is not changed."
)
@click.option(
    "--peak",
    type=click.Choice(["file", "road"]),
    help="For tyres: the peak friction of the file (default), or road.friction.",
)
@json_option
def import_(
    files: tuple[Path, ...],
    output: Path,
    units: str | None,
    rows: str | None,
    config_path: Path | None,
    peak: str | None,
    as_json: bool,
    **names: str | None,
) -> None:
    """Import a map from a MATLAB file or a text table, or the tyres of .tir files into a new ars.toml.

    One .tir file is used for both axles, two are front and rear. The extension of FILE selects the format.
    """
    from codegen.emit.outputs import check_output

    for_map: dict[str, object] = {**names, "units": units, "rows": rows}
    for_tyres: dict[str, object] = {"config": config_path, "peak": peak}
    if _are_tyres(files):
        _refuse_options(for_map, "for a map")
        if config_path is None:
            raise CodegenError(
                "tyres need the configuration of a car",
                where=files[0],
                remedy="name its ars.toml with --config and the new one with -o",
            )
        check_output(output, ".toml", (*files, config_path))
        _import_tyres(files, output, config_path, peak, as_json)
        return
    _refuse_options(for_tyres, "for tyres")
    check_output(output, ".npz", files)
    chosen = {key: name for key in MAP_OPTIONS if (name := names[key]) is not None}
    _import_map(files[0], output, chosen, units, rows, as_json)


def _are_tyres(files: tuple[Path, ...]) -> bool:
    """Return whether the files are tyres. Raises CodegenError if they are neither tyres nor a single map."""
    from codegen.importing.maps import MATLAB_ENDINGS, TABLE_ENDINGS

    endings = [path.suffix.lower() for path in files]
    for path, ending in zip(files, endings, strict=True):
        if ending == ".npz":
            raise CodegenError("is a map already", where=path, remedy="use it directly with codegen show and codegen build")
        if ending not in (TYRE_ENDING, *MATLAB_ENDINGS, *TABLE_ENDINGS):
            raise CodegenError(f"{ending or 'a name without ending'} is not supported", where=path, remedy=READ)
    tyres = endings.count(TYRE_ENDING)
    if tyres == len(files) <= 2:
        return True
    if len(files) > 1:
        raise CodegenError(f"{len(files)} files", where=files[-1], remedy="give one map, or one or two .tir files")
    return False


def _refuse_options(options: dict[str, object], purpose: str) -> None:
    for key, value in options.items():
        if value is not None:
            raise CodegenError(f"this option is {purpose}", where=f"--{key.replace('_', '-')}", remedy="leave it out")


# --- a map ---------------------------------------------------------------------------------------------------------------


def _import_map(path: Path, output: Path, names: dict[str, str], units: str | None, rows: str | None, as_json: bool) -> None:
    from codegen.importing.maps import Choices, import_map
    from codegen.map_file import map as npz
    from codegen.report.summary import map_summary
    from codegen.text_table import text_table

    axis = "vx" if rows == "vx" else "delta_f" if rows == "delta_f" else None
    imported = import_map(path, Choices(names, units, axis))  # type: ignore[arg-type]
    npz.save(imported.reference_map, output)
    summary = map_summary(imported.reference_map)
    if as_json:
        found: dict[str, Any] = {"map": str(output), "source": str(path), "read": list(imported.said)}
        console.print_json({**found, "variables": imported.columns, **summary.to_dict()})
        return
    for text in imported.said:
        console.note(text)
    console.say(f"{output}: {summary.headline}")
    console.say(text_table(("", "from", "to", "unit", "points"), summary.axis_rows))
    console.say("")
    console.say(text_table(("", "from", "to", "unit"), summary.value_rows))


# --- tyres ---------------------------------------------------------------------------------------------------------------


def _import_tyres(files: tuple[Path, ...], output: Path, config_path: Path, peak: str | None, as_json: bool) -> None:
    from codegen.files import write_atomically
    from codegen.importing.tyre import import_tyres

    imported = import_tyres(files, config_path, "road" if peak == "road" else "file")
    write_atomically(output, imported.text.encode("utf-8"))
    if as_json:
        console.print_json({"configuration": str(output), **imported.to_dict(), "notes": list(imported.notes)})
        return
    for text in imported.notes:
        console.note(text)
    _print_tyres(imported, output)


def _print_tyres(imported: TyreImport, output: Path) -> None:
    from codegen.text_table import text_table

    console.say(f"{output}: {', '.join(dict.fromkeys(f'{axle.file} ({axle.version})' for axle in imported.axles))}")
    columns = [_column(axle) for axle in imported.axles]
    rows = [(title, *(column[title] for column in columns)) for title in columns[0]]
    console.say(text_table(("one tyre of the axle", *(axle.axle for axle in imported.axles)), rows))
    console.say(f"next: codegen solve --config {output} --case 4ws-2 -o 4ws2.npz")


def _column(axle: AxleImport) -> dict[str, str]:
    at_peak = "none below 45" if axle.slip_at_peak is None else f"{math.degrees(axle.slip_at_peak):.2f}"
    return {
        "static wheel load [N]": f"{axle.load:.0f}",
        "cornering stiffness [N/rad]": f"{axle.stiffness:.0f}",
        "peak force [N]": f"{axle.peak:.0f}",
        "peak friction": f"{axle.friction:.3f}",
        "slip at the peak [deg]": at_peak,
        "slip bound of the map [deg]": f"{math.degrees(axle.slip_bound):.2f}",
        "removed: horizontal shift [deg]": f"{math.degrees(axle.horizontal_shift):.3f}",
        "removed: vertical shift [N]": f"{axle.vertical_shift:.1f}",
        "removed: difference of E by side": f"{axle.asymmetry:.3f}",
        "curve against the file, up to the slip bound [% of peak]": f"{100.0 * axle.worst:.2f}",
        "the same up to the peak [% of peak]": f"{100.0 * axle.worst_to_peak:.2f}",
        "stiffness against the file at 0.7 of the load [%]": f"{100.0 * axle.stiffness_lighter:+.1f}",
        "stiffness against the file at 1.3 of the load [%]": f"{100.0 * axle.stiffness_heavier:+.1f}",
    }


COMMANDS = (import_,)
