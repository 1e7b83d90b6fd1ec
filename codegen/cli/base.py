"""The command group, and what its commands share."""

from __future__ import annotations

from pathlib import Path

import click

from codegen import __version__

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
file_type = click.Path(path_type=Path)


def example(text: str) -> str:
    """An epilog that click prints as it is."""
    return f"\b\nExample:\n  {text}"


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, epilog=example("codegen init my-car"))
@click.version_option(__version__, prog_name="codegen")
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
def cli() -> None:
    """From vehicle data to checked C for active rear steering."""
