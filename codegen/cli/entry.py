"""Entry point of the command: one line for each error, and the exit codes."""

from __future__ import annotations

import gc
import logging
import os
import select
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn, TextIO

import click

from codegen import console
from codegen.cli import EXIT_INTERRUPTED, INTERRUPTED, end_quietly
from codegen.cli.base import COMPLETION, PROGRAM
from codegen.cli.commands import cli
from codegen.errors import CodegenError, one_line
from codegen.interrupts import Handler, install_handlers, raise_once

EXIT_BAD_INPUT = 2
EXIT_INTERNAL = 70


def main() -> NoReturn:
    """Run the command: print one line for each error and exit with the codes of the interface (0, 1, 2)."""
    gc.set_threshold(50_000)  # few cycles are made, and looking for them every 700 objects takes 4 % of a short command's time
    # --debug is removed here, so that it may stand anywhere and also applies to errors in the other arguments.
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    debug = len(arguments) < len(sys.argv) - 1
    if not debug:
        logging.disable()  # libraries log an error, even with a traceback, that becomes one line here
    code = 0
    try:
        try:
            _take_signals()
            _run(arguments)
        except BaseException as error:
            text, code = _answer(error)
            if debug and not isinstance(error, (SystemExit, click.exceptions.Exit)):
                raise
            if text:
                console.complain(text)
        if sys.stdout is not None:  # closed by the caller
            sys.stdout.flush()
    except BrokenPipeError:
        # The reader of the output has closed it, as `| head` does. This is not an error.
        _give_up_what_nobody_reads()
    raise SystemExit(code)


def _take_signals() -> None:
    handlers: dict[int, Handler] = {}
    if signal.getsignal(signal.SIGINT) in (signal.default_int_handler, end_quietly):  # else ignored, in the background
        handlers[signal.SIGINT] = raise_once(lambda _: KeyboardInterrupt())
    terminate = raise_once(lambda number: SystemExit(128 + number))  # an exception, so that running code cleans up
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup
            handlers[number] = terminate
    install_handlers(handlers)


def _run(arguments: Sequence[str]) -> None:
    """Run the command without click's `main`, which has its own exit codes for a closed output and for Ctrl-C."""
    if instruction := os.environ.get(COMPLETION):
        from codegen.cli.completion import complete

        raise SystemExit(complete(cli, PROGRAM, COMPLETION, instruction))
    with cli.make_context(PROGRAM, list(arguments)) as context:
        cli.invoke(context)


def _answer(error: BaseException) -> tuple[str, int]:
    """Return the message of an error ("" for none) and the exit code."""
    if isinstance(error, SystemExit):
        return "", error.code if isinstance(error.code, int) else 0
    if isinstance(error, click.exceptions.Exit):
        return "", error.exit_code
    if isinstance(error, CodegenError):
        return f"error: {error}", error.exit_code
    if isinstance(error, (click.Abort, KeyboardInterrupt)):
        # The text of an interrupt, if there is one, states what is kept.
        return "; ".join([INTERRUPTED, *map(one_line, error.args)]), EXIT_INTERRUPTED
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        return error.format_message(), EXIT_BAD_INPUT
    if isinstance(error, click.ClickException):
        context = getattr(error, "ctx", None)
        hint = f"; see `{context.command_path} --help`" if context is not None else ""
        return f"error: {one_line(error.format_message()).rstrip('.')}{hint}", EXIT_BAD_INPUT
    if isinstance(error, BrokenPipeError) and any(map(_has_no_reader, _streams())):
        return "", 0
    if isinstance(error, OSError):
        return f"error: {one_line(error)}; check the path, the permissions and the disk", EXIT_BAD_INPUT
    return f"internal error: {one_line(repr(error))}; run it again with --debug and report it", EXIT_INTERNAL


def _streams() -> list[TextIO]:
    return [stream for stream in (sys.stdout, sys.stderr) if stream is not None]  # None: closed by the caller


def _give_up_what_nobody_reads() -> None:
    """Discard pending output of a stream without a reader.

    Otherwise Python retries at exit and reports an error. Recipe: note on SIGPIPE in the documentation of `signal`.
    """
    for stream in filter(_has_no_reader, _streams()):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def _has_no_reader(stream: TextIO) -> bool:
    poll = select.poll()
    try:
        poll.register(stream, select.POLLOUT)
    except (OSError, ValueError):  # no file behind it
        return False
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))
