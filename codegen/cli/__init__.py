"""The `codegen` command: parse, call, print. What it calls is imported where it is used, so that `--help` stays quick.

`main` is the entry point, `cli` the group of all commands. Nothing is imported here, so that `main` is soon there to see to
Ctrl-C: until then Python answers with a traceback.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as typing has it
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
    """A handler of SIGINT while nothing is begun: one line, and the exit code of an interrupt."""
    del number, frame
    import os

    try:
        os.write(2, f"{INTERRUPTED}\n".encode())
    finally:
        os._exit(EXIT_INTERRUPTED)


def __getattr__(name: str) -> Any:
    """`cli`, which brings in all commands, is imported when it is asked for."""
    if name == "cli":
        from codegen.cli.commands import cli as group

        return group
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
