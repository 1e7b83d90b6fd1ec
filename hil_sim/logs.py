"""Logs of the bus that other tools open: BLF, ASC, candump `.log` and MF4.

In each a frame's time counts from the start of the run, as `Frame.time` does:

| format | resolution of times | where it comes from | start of the run |
|---|---|---|---|
| BLF | 1 ns | object header flag for nanoseconds, Vector's binlog API | 1 ms, UTC (SYSTEMTIME) |
| ASC | 1 us | six decimals, as python-can and CANoe write them | 1 ms, local time (date line) |
| candump | 1 us | struct timeval of SocketCAN | 1 us, in the Unix time of each line |
| MF4 | float64 of seconds | master channel, ASAM MDF 4.1 | 1 us, UTC |

A log is of one bus, which is channel 1 where channels have numbers.
"""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import os
import queue
import tempfile
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from codegen.errors import CodegenError
from codegen.files import reason_of
from codegen.interrupts import deferred
from hil_sim.frames import Frame
from hil_sim.log_formats import FORMATS, Head, Mf4Writer, Writer


class BusLog:
    """A log of the frames on a bus, in the format of the extension. A context manager.

    The file appears under its name when the block ends, even with an error: the log of an interrupted run is evidence. Until
    then, and if the log cannot be written, an existing file is kept. A separate thread writes, so that disk and compression do
    not delay the bench, and Ctrl-C does not cut a frame in two.
    """

    def __init__(self, path: Path, *, channel: str = "vcan0", start: float | None = None, dbc: bytes | None = None) -> None:
        """Prepare a log; nothing is written yet.

        Args:
            path: `.blf`, `.asc`, `.log` or `.mf4`.
            channel: the bus, as the user calls it; in candump and MF4, and in a comment of ASC.
            start: Unix time of the run's start (s); None for no wall clock: EPOCH, so that equal runs give equal files.
            dbc: attached to an MF4, which then opens with physical signals.

        Raises:
            CodegenError: another extension, or asammdf is missing and the log an MF4.
        """
        form = FORMATS.get(path.suffix.lower())
        if form is None:
            raise CodegenError(
                "no format for a log of the bus", where=path, remedy=f"end its name in one of {', '.join(FORMATS)}"
            )
        if form is Mf4Writer and importlib.util.find_spec("asammdf") is None:
            raise CodegenError("asammdf, which writes MF4, is missing", where=path, remedy='pip install "ars-codegen[tools]"')
        self._format: type[Writer] = form
        self._path = path
        self._head = Head(channel, start, dbc)
        self._frames: queue.SimpleQueue[tuple[Frame, bool] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._drain, name="bus log", daemon=True)
        self._failure: Exception | None = None

    def write(self, frame: Frame, received: bool) -> None:
        """Log a frame, from any thread.

        Args:
            frame: a time before the start counts as the start; length of a remote frame: that of its data.
            received: False for a frame that this node has sent.

        Raises:
            CodegenError: an earlier frame could not be written; the log is lost.
        """
        if self._failure is not None:
            raise _log_error(self._path, self._failure)
        self._frames.put((frame, received))

    def __enter__(self) -> Self:
        """Open the log. Raises CodegenError, for example if the folder is missing or the path is not a file."""
        try:
            target = self._path.resolve()  # follow a link
            if target.exists() and not target.is_file():
                raise OSError(errno.EINVAL, "it is not a regular file")
            handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp")
            os.close(handle)
            self._target, self._temporary = target, Path(name)
            try:
                self._writer = self._format(self._temporary, self._head)
            except BaseException:
                self._temporary.unlink(missing_ok=True)
                raise
        except (OSError, ValueError, RuntimeError) as error:  # a NUL in the name; a link to itself
            raise _log_error(self._path, error) from None
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close the log. Raises CodegenError if it could not be written, unless another CodegenError is pending."""
        with deferred():  # a second Ctrl-C waits until the file is complete
            self._frames.put(None)
            self._thread.join()
            if self._failure is None:
                try:
                    self._put_in_place()
                except OSError as failure:
                    self._failure = failure
            self._temporary.unlink(missing_ok=True)
        if self._failure is not None and not isinstance(error, CodegenError):
            raise _log_error(self._path, self._failure) from None

    def _drain(self) -> None:
        """Write frames in the thread. An error is kept for the next `write` or the end of the block."""
        try:
            while (item := self._frames.get()) is not None:
                frame, received = item
                self._writer.write(frame, received)
            self._writer.close()
        except Exception as error:
            self._failure = error
            with contextlib.suppress(Exception):
                self._writer.close()  # closes its file

    def _put_in_place(self) -> None:
        with self._temporary.open("rb+") as file:
            os.fsync(file.fileno())
        # mkstemp is private to the user; a log is as public as the umask lets any new file be.
        umask = os.umask(0)
        os.umask(umask)
        self._temporary.chmod(0o666 & ~umask)
        self._temporary.replace(self._target)


def _log_error(path: Path, error: Exception) -> CodegenError:
    return CodegenError(
        f"the log cannot be written ({reason_of(error)})",
        where=path,
        remedy="check that the folder exists, is writable and has space",
    )
