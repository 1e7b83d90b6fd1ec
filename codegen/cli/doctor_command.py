"""`codegen doctor`: what is installed, what works here, and what to type where something is missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.errors import CheckFailed

if TYPE_CHECKING:
    from codegen.doctor.examination import Examination
    from codegen.doctor.finding import Finding

COLOURS = {"good": "green", "missing": "yellow", "bad": "red"}


@click.command(short_help="Check the installation and list missing optional tools.", epilog=example("codegen doctor"))
@json_option
def doctor(as_json: bool) -> None:
    """Report what is installed, what each missing extra would add, and which buses work: each of them is tried.

    Exits with 1 where something is missing that codegen sil needs.
    """
    from codegen.doctor.examination import examine

    with console.status("looking around"):
        found = examine()
    if as_json:
        console.print_json(found.to_dict())
    else:
        for line in _lines(found, coloured=console.has_colour(sys.stdout)):
            console.say(line)
    if found.stopping:
        names = ", ".join(finding.name for finding in found.stopping)
        raise CheckFailed(f"codegen sil cannot work: {names}", remedy=found.stopping[0].remedy)


def _lines(found: Examination, *, coloured: bool) -> Iterator[str]:
    names = max(len(finding.name) for section in found.sections for finding in section.findings)
    for number, section in enumerate(found.sections):
        yield from ("", section.title) if number else (section.title,)
        for finding in section.findings:
            yield from _of(finding, names, coloured)


def _of(finding: Finding, width: int, coloured: bool) -> Iterator[str]:
    state = f"{finding.state:<7}"
    shown = click.style(state, fg=COLOURS[finding.state]) if coloured else state
    yield f"  {shown}  {finding.name:<{width}}  {finding.what}"
    margin = " " * (13 + width)
    if finding.state != "good" and finding.serves:
        yield f"{margin}for {finding.serves}"
    if finding.remedy:
        yield f"{margin}-> {finding.remedy}"


COMMANDS = (doctor,)
