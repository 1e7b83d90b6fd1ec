"""Command that accounts for the frames of a log."""

from __future__ import annotations

from pathlib import Path

import click

from codegen import console
from codegen.cli.base import cli, example, json_option
from codegen.cli.options import bus_log, channel_option, database_option
from codegen.text_table import text_table


@cli.command(
    short_help="Account for every frame of a log of a bus.",
    epilog=example("codegen log drive2.blf --dbc generated/4ws2/ars.dbc --channel 1"),
)
@click.argument("path", metavar="FILE", type=bus_log)
@database_option
@channel_option
@json_option
def log(path: Path, databases: tuple[Path, ...], channel: str | None, as_json: bool) -> None:
    """Account for every frame of a log of a CAN bus: .blf, .asc, .log (candump) or .mf4.

    Prints the frames in the file, those that are read and those that are skipped, with the reason; for each channel, direction
    and identifier, what becomes of them: used, copies of others, of several senders, in no database; the kind of clock, and
    stamps that go back or repeat; and all that is not plain. The commands that read a log use the same account.
    """
    from codegen.logs import account
    from codegen.logs.databases import Databases

    with console.status(f"reading {path.name}"):
        found = account.open_bus_log(path, Databases(databases), channel)
    if as_json:
        console.print_json(account.to_dict(found))
        return
    console.say(*account.summary_lines(found))
    if len(found.frames):
        console.say("", text_table(account.CHANNEL_HEADER, account.channel_cells(found), left=2))
        console.say("", text_table(account.IDENTIFIER_HEADER, account.identifier_cells(found), left=4))
    texts = account.findings(found)
    console.say("", *(texts or ["no findings"]))
