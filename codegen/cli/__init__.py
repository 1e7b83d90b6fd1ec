"""The `codegen` command. Commands parse, call and print; they import what they call when they run, so `--help` is fast.

`main` is the entry point, `cli` the group of all commands. This module imports nothing, so that `main` can handle Ctrl-C
before the slow imports, during which Python would print a traceback.
"""

from __future__ import annotations

TYPE_CHECKING = False  # avoids importing typing
if TYPE_CHECKING:
    from typing import Any, NoReturn

    from codegen.cli.commands import cli

__all__ = ["cli", "main"]

INTERRUPTED = "interrupted; nothing is left half-written"
EXIT_INTERRUPTED = 130


def main() -> NoReturn:
    """Entry point; see `codegen.cli.entry.main`."""
    import _signal  # type: ignore[import-not-found]  # built in; `signal` takes some milliseconds

    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, end_quietly)
    from codegen.cli.entry import main as run

    run()


def end_quietly(number: int, frame: object) -> None:
    """Handle SIGINT before any work has begun: print one line and exit with the code of an interrupt."""
    del number, frame
    import os

    try:
        os.write(2, f"{INTERRUPTED}\n".encode())
    finally:
        os._exit(EXIT_INTERRUPTED)


def __getattr__(name: str) -> Any:
    """Import `cli`, and with it all commands, on first access."""
    if name == "cli":
        from codegen.cli.commands import cli as group

        return group
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
