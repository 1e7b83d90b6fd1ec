"""Command that accounts for the frames or rows of a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from codegen import console
from codegen.cli.base import cli, example, json_option
from codegen.cli.options import channel_option, database_option, drive_log, signals_option
from codegen.text_table import text_table

if TYPE_CHECKING:
    from codegen.logs.account import BusLog
    from codegen.logs.measurement import Account


@cli.command(
    short_help="Account for every frame or row of a log.",
    epilog=example("codegen log drive2.blf --dbc generated/4ws2/ars.dbc --channel 1"),
)
@click.argument("path", metavar="FILE", type=drive_log)
@database_option
@channel_option
@signals_option
@json_option
def log(path: Path, databases: tuple[Path, ...], channel: str | None, names_path: Path | None, as_json: bool) -> None:
    """Account for every frame of the log of a CAN bus, or every row of a measurement.

    A bus (.blf, .asc, .log of candump, .mf4): the frames in the file, those that are read and those that are skipped, with the
    reason; for each channel, direction and identifier, what becomes of them: used, copies of others, of several senders, in no
    database; the kind of clock, and stamps that go back or repeat; and all that is not plain.

    A measurement (.mf4, .csv, .parquet): the rows in the file, those that are read and those that are skipped, with the reason;
    for each channel, the samples with a number, and those without one; the same about the stamps of each group of channels.

    The commands that read a log use the same account.
    """
    from codegen.identify.names import Names, load_names
    from codegen.logs import account
    from codegen.logs.databases import Databases
    from codegen.logs.measurement import Account

    names = load_names(names_path) if names_path else Names()
    with console.status(f"reading {path.name}"):
        found = account.open_log(path, Databases(databases), channel or names.channel, names.time, names.time_unit)
    if as_json:
        console.print_json(account.to_dict(found))
    elif isinstance(found, Account):
        _print_rows(found)
    else:
        _print_frames(found)


def _print_frames(found: BusLog) -> None:
    from codegen.logs import account

    console.say(*account.summary_lines(found))
    if len(found.frames):
        console.say("", text_table(account.CHANNEL_HEADER, account.channel_cells(found), left=2))
        console.say("", text_table(account.IDENTIFIER_HEADER, account.identifier_cells(found), left=4))
    console.say("", *(account.findings(found) or ["no findings"]))


def _print_rows(found: Account) -> None:
    from codegen.logs import measurement

    console.say(*measurement.summary_lines(found))
    console.say("", text_table(measurement.GROUP_HEADER, measurement.group_cells(found), left=1))
    if found.channels:
        console.say("", text_table(measurement.CHANNEL_HEADER, measurement.channel_cells(found), left=3))
    console.say("", *([*found.findings, *found.channel_findings] or ["no findings"]))
