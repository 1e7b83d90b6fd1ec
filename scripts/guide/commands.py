"""The commands of the program as Markdown, from its help."""

from __future__ import annotations

import inspect
import re

import click

from codegen.cli import cli
from scripts.guide.markdown import table


def markdown() -> str:
    """Return a section for the program and for each command: description, usage, options and an example."""
    program = click.Context(cli, info_name="codegen", **cli.context_settings)
    commands = [(cli.commands[name], click.Context(cli.commands[name], program, name)) for name in cli.list_commands(program)]
    return "\n\n".join(_section(command, context) for command, context in [(cli, program), *commands])


def _section(command: click.Command, context: click.Context) -> str:
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    records = [each.get_help_record(context) for each in command.params]
    options = [(f"`{name}`", _escaped(text)) for name, text in filter(None, records) if text]
    listed = [table(("option", "meaning"), options).strip()] if options else []
    return "\n\n".join([f"## {context.command_path}", *_parts(command.help), _block(usage), *listed, *_parts(command.epilog)])


def _parts(text: str | None) -> list[str]:
    """Return the paragraphs of a help text. Lines that click leaves as they are become a block, after their title."""
    found = []
    for paragraph in inspect.cleandoc(text or "").split("\n\n"):
        if not paragraph.startswith("\b\n"):
            found.append(_escaped(paragraph))
            continue
        lines = paragraph.splitlines()[1:]
        title = lines.pop(0) if lines[0].endswith(":") else ""
        found += [title, _block(inspect.cleandoc("\n".join(["", *lines])))]
    return [each for each in found if each]


def _block(text: str) -> str:
    return f"```text\n{text}\n```"


def _escaped(text: str) -> str:
    return re.sub(r"([<*\[])", r"\\\1", " ".join(text.split()))
