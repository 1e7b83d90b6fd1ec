"""Command that identifies a car from measured drives."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option
from codegen.cli.options import FileType, configuration_file
from codegen.errors import CodegenError
from codegen.text_table import text_table

if TYPE_CHECKING:
    from codegen.identify.reading import Reading

DRIVE_ENDINGS = (".mf4", ".blf", ".asc", ".log", ".csv", ".tsv", ".txt", ".dat", ".parquet")


@cli.command(
    short_help="Read measured drives, and check their data.",
    epilog=example("codegen identify --log drive1.mf4 --log drive2.blf --dbc car.dbc --signals names.toml --check"),
)
@click.option(
    "--log",
    "logs",
    required=True,
    multiple=True,
    type=FileType(DRIVE_ENDINGS),
    metavar="FILE",
    help="A measured drive: .mf4, .blf, .asc, .log (candump), .csv or .parquet; may be repeated.",
)
@click.option(
    "--dbc",
    "databases",
    multiple=True,
    type=FileType((".dbc", ".arxml")),
    metavar="FILE",
    help="Database for the log of a bus, DBC or ARXML; may be repeated.",
)
@click.option(
    "--signals",
    "names_path",
    type=configuration_file,
    metavar="TOML",
    help="Names, units and signs of the signals, if they are not obvious.",
)
@click.option("--check", "check_only", is_flag=True, help="Only read the drives and report what was found in them.")
@json_option
def identify(
    logs: tuple[Path, ...], databases: tuple[Path, ...], names_path: Path | None, check_only: bool, as_json: bool
) -> None:
    """Read measured drives: find the signals, bring them to one time grid, and report gaps, offsets and faults.

    The samples of faults have no value in what follows. The guide describes names.toml.
    """
    from codegen.identify.names import load_names
    from codegen.identify.reading import read_drives

    if not check_only:
        raise CodegenError("nothing to do", where="codegen identify", remedy="give --check")
    names = load_names(names_path) if names_path is not None else None
    with console.status(f"reading {', '.join(path.name for path in logs)}"):
        reading = read_drives(logs, databases, names)
    if as_json:
        console.print_json(reading_as_json(reading))
        return
    print_reading(reading)
    if names_path is None:
        console.say("", "names.toml of these signals:", "", reading.names_toml.rstrip())


def print_reading(reading: Reading) -> None:
    """Print the sources of all signals, and the findings."""
    header = ("drive", "quantity", "signal", "unit", "samples", "period [ms]", "with a value [%]")
    rows = []
    for drive, sources in zip(reading.drives, reading.sources, strict=True):
        duration = float(drive.time[-1] - drive.time[0])
        console.say(f"{drive.name}: {duration:.1f} s, {drive.time.size} steps of {1e3 * (drive.time[1] - drive.time[0]):g} ms")
        for key, one in sources.items():
            numbers = (str(one.samples), f"{1e3 * one.period:.3g}", f"{100.0 * one.share:.1f}")
            rows.append((drive.name, key, one.channel, one.unit, *numbers))
    console.say("", text_table(header, rows, left=4), "")
    if not reading.findings:
        console.say("no findings")
        return
    found = [
        (each.drive, each.quantity or "-", each.kind, str(each.lost) if each.lost else "-", each.text)
        for each in reading.findings
    ]
    console.say(text_table(("drive", "quantity", "finding", "lost", "what"), found, left=5))


def reading_as_json(reading: Reading) -> dict[str, Any]:
    """Return the same facts for JSON."""
    drives = [
        {
            "name": drive.name,
            "duration_s": float(drive.time[-1] - drive.time[0]),
            "step_s": float(drive.time[1] - drive.time[0]),
            "signals": {key: dataclasses.asdict(source) for key, source in sources.items()},
        }
        for drive, sources in zip(reading.drives, reading.sources, strict=True)
    ]
    return {"drives": drives, "findings": [dataclasses.asdict(each) for each in reading.findings]}
