"""What commands print: lines, progress and JSON. Below `cli`, above everything that computes."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any


def say(text: str) -> None:
    """A line of result, on standard output."""
    print(text)


def note(text: str) -> None:
    """A line that the user should know beside the result, on standard error."""
    print(f"note: {text}", file=sys.stderr)


def print_json(data: Any) -> None:
    """A result for programs, on standard output."""
    print(json.dumps(data, indent=1, allow_nan=False))


@contextlib.contextmanager
def progress(title: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on a terminal, a plain line for each tenth elsewhere; both on standard error.

    Yields a function of (done, in all).
    """
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import Progress

        console = Console(stderr=True, no_color=bool(os.environ.get("NO_COLOR")) or None)
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(title, total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total)
        return
    told = 0

    def tell(done: int, total: int) -> None:
        nonlocal told
        tenths = 10 * done // total
        if tenths > told:
            told = tenths
            print(f"{title}: {10 * tenths} %", file=sys.stderr, flush=True)

    yield tell
