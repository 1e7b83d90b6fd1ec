"""Command that accounts for the frames or rows of a log."""

from __future__ import annotations

from typing import Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import channel_option, database_option, drive_log, signals_option


@cli.command(
    short_help="Account for every frame or row of a log.",
    epilog=example("codegen log drive2.blf --dbc generated/4ws2/ars.dbc --channel 1"),
)
@click.argument("path", metavar="FILE", type=drive_log)
@database_option
@channel_option
@signals_option
@json_option
def log(as_json: bool, **given: Any) -> None:
    """Account for every frame of the log of a CAN bus, or every row of a measurement.

    A bus (.blf, .asc, .log of candump, .mf4): the frames in the file, those that are read and those that are skipped, with the
    reason; for each channel, direction and identifier, what becomes of them: used, copies of others, of several senders, in no
    database; the kind of clock, and stamps that go back or repeat; and all that is not plain.

    A measurement (.mf4, .csv, .parquet): the rows in the file, those that are read and those that are skipped, with the reason;
    for each channel, the samples with a number, and those without one; the same about the stamps of each group of channels.

    The commands that read a log use the same account.
    """
    show(codegen.log(**given, progress=console.shown), as_json)
