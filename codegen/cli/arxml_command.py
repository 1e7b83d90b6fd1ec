"""Command that describes a build for AUTOSAR Classic."""

from __future__ import annotations

from typing import Any

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import build_option, folder_to_write


@cli.command(
    short_help="Describe a build for AUTOSAR Classic: ARXML, and the adapter in C.",
    epilog=example("codegen arxml --build generated/4ws2 -o autosar"),
)
@build_option
@click.option("-o", "--output", "path", required=True, type=folder_to_write, metavar="DIR", help="Folder for the description.")
@click.option(
    "--e2e",
    type=click.Choice(["transformer", "task"]),
    default="transformer",
    show_default=True,
    help="What checks the frames: the RTE's E2E transformer, or the task of the build on raw frames.",
)
@click.option(
    "--access",
    type=click.Choice(["explicit", "implicit"]),
    default="explicit",
    show_default=True,
    help="How the runnable reads the messages: by Rte_Read, or by Rte_IRead, which needs the transformer.",
)
@json_option
def arxml(as_json: bool, **given: Any) -> None:
    """Write the ARXML (R22-11) of a build, and the C between the RTE and the controller.

    The ARXML contains the software component with its types, ports, parameters and runnables, and the system with frames,
    signals and E2E protection. The C goes to the ECU project together with the sources of the build.
    """
    show(codegen.export(what="arxml", **given, progress=console.shown), as_json)
