"""The command group, and helpers that its commands share."""

from __future__ import annotations

import click

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")


def example(text: str) -> str:
    """Return an epilog that click prints unchanged."""
    return f"\b\nExample:\n  {text}"


def _version(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    del parameter
    if wanted and not context.resilient_parsing:
        from codegen.cli.version import lines

        for line in lines():
            click.echo(line)
        context.exit()


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, epilog=example("codegen init my-car"))
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show versions and exit.")
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
def cli() -> None:
    """From vehicle data to checked C for active rear steering."""
