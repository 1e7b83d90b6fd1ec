"""Output of commands: lines, progress and JSON. Below `cli`, above everything that computes."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from typing import Any, Protocol, TextIO


def say(text: str) -> None:
    """A line of result, on standard output."""
    print(text)


def note(text: str) -> None:
    """Print a note to the user on standard error."""
    print(f"note: {text}", file=sys.stderr)


def warn(text: str) -> None:
    """Print a warning, on standard error."""
    print(f"warning: {text}", file=sys.stderr)


def print_json(data: Any) -> None:
    """A result for programs, on standard output."""
    print(json.dumps(data, indent=1, allow_nan=False))


def has_colour(stream: TextIO) -> bool:
    """Whether colour is wanted there: `NO_COLOR` (no-color.org), then `FORCE_COLOR`, else only on a terminal that has it."""
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or _is_screen(stream)


def _is_screen(stream: TextIO | None) -> bool:
    """Whether it is a terminal on which what was written can be drawn over."""
    return stream is not None and stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")


@contextlib.contextmanager
def status(title: str) -> Iterator[None]:
    """A line on the terminal while something of unknown length goes on, on standard error; nothing elsewhere."""
    if not _is_screen(sys.stderr):
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True, no_color=not has_colour(sys.stderr)).status(Text(f"{title} ...")):
        yield


class Tell(Protocol):
    """Takes what is done, of how much in all, and, where steps are long enough to be named, what comes next."""

    def __call__(self, done: int, total: int, step: str = "") -> None: ...


@contextlib.contextmanager
def progress(title: str) -> Iterator[Tell]:
    """A progress bar on a terminal, a plain line for each tenth or named step elsewhere; both on standard error."""
    if _is_screen(sys.stderr):
        from rich.console import Console
        from rich.progress import Progress
        from rich.text import Text

        console = Console(stderr=True, no_color=not has_colour(sys.stderr))
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(Text(title).markup, total=None)

            def draw(done: int, total: int, step: str = "") -> None:
                named = f"{title}: {step}" if step else title
                bar.update(task, completed=done, total=total, description=Text(named).markup)

            yield draw
        return
    told = 0

    def tell(done: int, total: int, step: str = "") -> None:
        nonlocal told
        tenths = 10 * done // total
        if step:
            told = tenths
            print(f"{title}: {100 * done // total} %, {step}", file=sys.stderr, flush=True)
        elif tenths > told:
            told = tenths
            print(f"{title}: {10 * tenths} %", file=sys.stderr, flush=True)

    yield tell
