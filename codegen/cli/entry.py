"""The entry point: one line for each error, and the exit codes."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import NoReturn

import click

from codegen.cli.base import cli
from codegen.errors import CodegenError, one_line

EXIT_BAD_INPUT = 2
EXIT_INTERNAL = 70
EXIT_INTERRUPTED = 130


def main() -> NoReturn:
    """Entry point: one line for each error, and the exit codes of the interface (0, 1, 2)."""
    # Taken out here, so that it may stand anywhere, and so that an error in the other words is shown in full too.
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    debug = len(arguments) < len(sys.argv) - 1
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup
            signal.signal(number, _terminate)
    try:
        cli.main(arguments, standalone_mode=False)
        if sys.stdout is not None:  # closed by the caller
            sys.stdout.flush()
    except CodegenError as error:
        _fail(f"error: {error}", error.exit_code, debug)
    except click.exceptions.Exit as error:
        raise SystemExit(error.exit_code) from None
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted; nothing is left half-written", EXIT_INTERRUPTED, debug)
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message(), file=sys.stderr)
        raise SystemExit(EXIT_BAD_INPUT) from None
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f"; see `{context.command_path} --help`" if context is not None else ""
        _fail(f"error: {one_line(error.format_message()).rstrip('.')}{hint}", EXIT_BAD_INPUT, debug)
    except BrokenPipeError:
        # The reader of our output went away, as `| head` does: no error, and nothing more to say.
        sys.stdout = None
        raise SystemExit(0) from None
    except OSError as error:
        _fail(f"error: {one_line(error)}; check the path, the permissions and the disk", EXIT_BAD_INPUT, debug)
    except Exception as error:
        _fail(f"internal error: {one_line(repr(error))}; run it again with --debug and report it", EXIT_INTERNAL, debug)
    raise SystemExit(0)


def _fail(text: str, code: int, debug: bool) -> NoReturn:
    if debug:
        raise
    print(text, file=sys.stderr)
    raise SystemExit(code)


def _terminate(number: int, frame: FrameType | None) -> None:
    del frame
    # An exception, so that what is under way cleans up after itself.
    raise SystemExit(128 + number)
