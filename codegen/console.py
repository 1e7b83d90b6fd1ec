"""Output of commands: lines, progress and JSON. This layer is below `cli` and above the modules that compute."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, TextIO

import click

from codegen.errors import one_line, printable

TEXT_MAX = 100_000
"""Limit on the characters of a note or a warning."""


@dataclass(frozen=True)
class Coloured:
    """A line with one coloured word.

    Attributes:
        before, word, after: the parts of the line.
        colour: of the word, as click names it.
    """

    before: str
    word: str
    after: str
    colour: str


def say(*lines: str | Coloured) -> None:
    """Print lines of a result on standard output."""
    for line in lines:
        _print(line, sys.stdout)


def note(*texts: str) -> None:
    """Print notes on standard error, each in one line."""
    for text in texts:
        _print(f"note: {one_line(text, TEXT_MAX)}", sys.stderr)


def warn(*texts: str) -> None:
    """Print warnings on standard error, each in one line."""
    for text in texts:
        _print(f"warning: {one_line(text, TEXT_MAX)}", sys.stderr)


def complain(text: str) -> None:
    """Print the message of an error on standard error."""
    _print(text, sys.stderr)


def _print(line: str | Coloured, stream: TextIO) -> None:
    """Print to a terminal: the only place that does, besides JSON, which escapes all but ASCII, and the bars of `rich`.

    Lines quote texts from files, which may contain escape sequences.
    """
    if isinstance(line, Coloured):
        word = printable(line.word)
        shown = click.style(word, fg=line.colour) if has_colour(stream) else word
        print(f"{printable(line.before)}{shown}{printable(line.after)}", file=stream)
    else:
        print(printable(line), file=stream, flush=stream is sys.stderr)


def print_json(data: Any) -> None:
    """Print a result for programs as JSON on standard output."""
    print(json.dumps(data, indent=1, allow_nan=False))


def has_colour(stream: TextIO) -> bool:
    """Return whether to print in colour: not with `NO_COLOR` (no-color.org), else with `FORCE_COLOR` or on a terminal."""
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or _is_screen(stream)


def _is_screen(stream: TextIO | None) -> bool:
    """Return whether `stream` is a terminal that can redraw a line."""
    return stream is not None and stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")


@contextlib.contextmanager
def status(title: str, *, quiet: bool = False) -> Iterator[None]:
    """Show a line during work of unknown length if standard error is a terminal; print nothing otherwise, or if `quiet`."""
    title = printable(title)
    if quiet or not _is_screen(sys.stderr):
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True, no_color=not has_colour(sys.stderr)).status(Text(f"{title} ...")):
        yield


class Tell(Protocol):
    """Callback for progress: work done, total work, and the name of the next step if steps are long enough to be named."""

    def __call__(self, done: int, total: int, step: str = "") -> None: ...


@contextlib.contextmanager
def progress(title: str) -> Iterator[Tell]:
    """Report progress on standard error: a bar on a terminal, otherwise a plain line for each tenth or named step."""
    title = printable(title)
    if _is_screen(sys.stderr):
        from rich.console import Console
        from rich.progress import Progress
        from rich.text import Text

        console = Console(stderr=True, no_color=not has_colour(sys.stderr))
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(Text(title).markup, total=None)

            def draw(done: int, total: int, step: str = "") -> None:
                named = f"{title}: {printable(step)}" if step else title
                bar.update(task, completed=done, total=total, description=Text(named).markup)

            yield draw
        return
    told = 0

    def tell(done: int, total: int, step: str = "") -> None:
        nonlocal told
        tenths = 10 * done // total
        if step:
            told = tenths
            _print(f"{title}: {100 * done // total} %, {step}", sys.stderr)
        elif tenths > told:
            told = tenths
            _print(f"{title}: {10 * tenths} %", sys.stderr)

    yield tell


def shown(share: float) -> None:
    """Mark progress that the terminal shows: functions of the library that get this callback show each stage with its title."""
    del share
