"""Files of a run on disk: the recording as CSV, with units in the column names, and logs of the bus that other tools open.

The logs are BLF, ASC, candump `.log` and MF4. In each a frame's time counts from the start of the run, as `Frame.time` does:

| format | resolution of times | where it comes from | start of the run |
|---|---|---|---|
| BLF | 1 ns | object header flag for nanoseconds, Vector's binlog API | 1 ms, UTC (SYSTEMTIME) |
| ASC | 1 us | six decimals, as python-can and CANoe write them | 1 ms, local time (date line) |
| candump | 1 us | struct timeval of SocketCAN | 1 us, in the Unix time of each line |
| MF4 | float64 of seconds | master channel, ASAM MDF 4.1 | 1 us, UTC |

A log is of one bus, which is channel 1 where channels have numbers. BLF and the lines of ASC are python-can's. Its candump
writer drops the length of remote frames and the class of errors, its MF4 writer starts at the moment of opening: those two are
written here.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import importlib.util
import os
import queue
import struct
import tempfile
import threading
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
import numpy.typing as npt

from codegen import __version__
from codegen.arrays import FloatArray
from codegen.configuration.can import FRAME_BYTES, FRAME_BYTES_MAX
from codegen.errors import CodegenError
from codegen.files import read_text, reason_of, write_atomically
from codegen.interrupts import deferred
from codegen.requirements import missing
from codegen.sil.software import RECORD_COLUMNS
from hil_sim.codec import Frame

CSV_BYTES_MAX = 2**30
"""Largest file in bytes: some hours of driving."""


def to_csv(record: FloatArray) -> bytes:
    """Format a recording (samples, 12) as CSV with a header. Numbers read back to the same bits."""
    lines = [",".join(RECORD_COLUMNS)]
    status = RECORD_COLUMNS.index("status")
    for row in record.tolist():
        lines.append(",".join(str(int(value)) if index == status else repr(value) for index, value in enumerate(row)))
    return ("\n".join(lines) + "\n").encode("ascii")


def save_csv(record: FloatArray, path: Path) -> None:
    """Write a recording; what stood at `path` stays until the new file is complete. Raises CodegenError."""
    write_atomically(path, to_csv(record))


def load_csv(path: Path) -> FloatArray:
    """Read a recording (samples, 12) that `save_csv` wrote. Raises CodegenError with the file and line."""
    lines = read_text(path, CSV_BYTES_MAX, "give the CSV of a run").splitlines()
    if not lines or lines[0] != ",".join(RECORD_COLUMNS):
        raise CodegenError("not the header of a run", where=f"{path}, line 1", remedy=f"needed: {','.join(RECORD_COLUMNS)}")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            row = [float(text) for text in line.split(",")]
        except ValueError as error:
            raise CodegenError(str(error), where=f"{path}, line {number}", remedy="correct the number") from None
        if len(row) != len(RECORD_COLUMNS):
            raise CodegenError(
                f"{len(row)} values, {len(RECORD_COLUMNS)} needed",
                where=f"{path}, line {number}",
                remedy="record the run again",
            )
        rows.append(row)
    return np.array(rows).reshape(len(rows), len(RECORD_COLUMNS))


if TYPE_CHECKING:
    import can
    from asammdf import Signal

EPOCH = 946_684_800.0
"""Start of a run without a wall clock: 2000-01-01 00:00 UTC, in Unix time. BLF holds nothing before 1990."""

CHANNEL_NUMBER = 1
CAN_ERR_FLAG = 0x2000_0000  # linux/can.h: in the id of an error frame
CAN_ERR_BUSERROR = 0x80  # linux/can/error.h: the class where none is known
CAN_ERR_DLC = 8
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


@dataclass(frozen=True)
class Head:
    """Metadata of a log: arguments of BusLog."""

    channel: str
    start: float | None
    dbc: bytes | None

    @property
    def unix(self) -> float:
        """Unix time of the start (s)."""
        return EPOCH if self.start is None else self.start

    @property
    def date(self) -> str:
        """Date in the form of ASC: local time in English in any locale; UTC without a wall clock."""
        moment = datetime.fromtimestamp(round(self.unix, 3), UTC if self.start is None else None)
        day = f"{DAYS[moment.weekday()]} {MONTHS[moment.month - 1]} {moment.day:02d}"
        return f"{day} {moment:%H:%M:%S}.{moment.microsecond // 1000:03d} {moment.year}"


class Writer(Protocol):
    """One format."""

    def __init__(self, path: Path, head: Head) -> None: ...

    def write(self, frame: Frame, received: bool) -> None: ...

    def close(self) -> None:
        """Write what is left and close the file."""


class BlfWriter:
    """Vector's binary log."""

    def __init__(self, path: Path, head: Head) -> None:
        import can

        # Small containers with light compression keep each job of the thread short.
        self._writer = can.BLFWriter(path, channel=CHANNEL_NUMBER, compression_level=1, max_container_size=16384)
        self._start = head.unix
        self._end = 0.0
        # By default python-can starts at the first frame, and Unix time in a float64 loses 0.2 us.
        self._writer.start_timestamp = 0.0

    def write(self, frame: Frame, received: bool) -> None:
        self._end = max(self._end, frame.time)
        half = 0.5e-9  # s: it rounds down
        self._writer.on_message_received(_message(frame, received, half))

    def close(self) -> None:
        self._writer.start_timestamp = self._start
        self._writer.stop_timestamp = self._start + self._end
        self._writer.stop()


class AscWriter:
    """Vector's text log. The head is not python-can's, which shows the moment of writing, and 5 ms as .5 s."""

    def __init__(self, path: Path, head: Head) -> None:
        import can

        file = path.open("w", encoding="ascii", errors="replace", newline="\n")
        self._writer = can.ASCWriter(file, channel=CHANNEL_NUMBER)
        file.seek(0)
        file.truncate()
        file.write(f"date {head.date}\nbase hex  timestamps absolute\ninternal events logged\n")
        file.write(f"// CAN {CHANNEL_NUMBER}: {_word(head.channel)}, by ars-codegen {__version__}\n")
        file.write(f"Begin Triggerblock {head.date}\n 0.000000 Start of measurement\n")
        self._writer.header_written = True

    def write(self, frame: Frame, received: bool) -> None:
        self._writer.on_message_received(_message(frame, received))

    def close(self) -> None:
        self._writer.stop()


class CandumpWriter:
    """Log format of `candump -L -x` (can-utils), with R and T for the direction."""

    def __init__(self, path: Path, head: Head) -> None:
        self._file = path.open("w", encoding="ascii", errors="replace", newline="\n")
        name = _word(head.channel)
        self._channel = f"can{name}" if name.isdigit() else name
        self._start = _microseconds(head.unix)

    def write(self, frame: Frame, received: bool) -> None:
        seconds, microseconds = divmod(self._start + _microseconds(max(frame.time, 0.0)), 1_000_000)
        if frame.error:
            data = frame.data.ljust(CAN_ERR_DLC, b"\0")
            content = f"{CAN_ERR_FLAG | (frame.id or CAN_ERR_BUSERROR):08X}#{data.hex().upper()}"
        else:
            identifier = f"{frame.id:08X}" if frame.extended else f"{frame.id:03X}"
            kind = "##1" if frame.fd else "#"  # a frame of CAN FD has its flags here: bit-rate switching
            content = f"{identifier}{kind}" + (f"R{len(frame.data) or ''}" if frame.remote else frame.data.hex().upper())
        self._file.write(f"({seconds}.{microseconds:06d}) {self._channel} {content} {'R' if received else 'T'}\n")

    def close(self) -> None:
        self._file.close()


class Mf4Writer:
    """Bus logging of ASAM MDF 4.1: plain bus events CAN_DataFrame, CAN_RemoteFrame and CAN_ErrorFrame, a group each.

    Frames are kept in memory, 81 bytes each, and sorted at the end: a master channel never goes back. A log with a frame of
    CAN FD has the members of CAN FD, and room for 64 bytes.
    """

    RECORD = struct.Struct("<dIBBBBB64s")
    FIELDS = np.dtype(
        [
            ("time", "<f8"),
            ("id", "<u4"),
            ("extended", "u1"),
            ("length", "u1"),
            ("sent", "u1"),
            ("kind", "u1"),
            ("fd", "u1"),
            ("data", "u1", FRAME_BYTES_MAX),
        ]
    )
    KINDS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame")

    def __init__(self, path: Path, head: Head) -> None:
        self._file = path.open("w+b")
        self._head = head
        self._records = bytearray()

    def write(self, frame: Frame, received: bool) -> None:
        kind = self.KINDS.index("CAN_ErrorFrame" if frame.error else "CAN_RemoteFrame" if frame.remote else "CAN_DataFrame")
        head = (max(frame.time, 0.0), frame.id, frame.extended, len(frame.data), not received, kind, frame.fd)
        self._records += self.RECORD.pack(*head, frame.data)

    def close(self) -> None:
        from asammdf import MDF
        from asammdf.blocks.v4_blocks import FileHistory

        records = np.frombuffer(self._records, self.FIELDS)
        records = records[np.argsort(records["time"], kind="stable")]
        with self._file, MDF(version="4.10") as mdf:
            mdf.start_time = datetime.fromtimestamp(_microseconds(self._head.unix) / 1e6, UTC)
            for kind, name in enumerate(self.KINDS):
                chosen = records[records["kind"] == kind]
                if len(chosen) or kind == 0:  # without a frame: an empty log of data frames
                    mdf.append(self._signal(name, chosen))
            history = FileHistory()
            history.comment = (
                "<FHcomment><TX>Log of the bus</TX><tool_id>ars-codegen</tool_id><tool_vendor>ars-codegen</tool_vendor>"
                f"<tool_version>{__version__}</tool_version></FHcomment>"
            )
            mdf.file_history.append(history)
            for entry in mdf.file_history:  # not the second of writing: equal runs give equal files
                entry.time_stamp = mdf.start_time
            mdf.save(self._file, compression=1, add_history_block=False)

    def _signal(self, name: str, records: npt.NDArray[np.void]) -> Signal:
        from asammdf import Signal, Source
        from can.util import len2dlc

        is_fd = bool(records["fd"].any())
        members = {
            "BusChannel": np.full(len(records), CHANNEL_NUMBER, np.uint8),
            "ID": records["id"],
            "IDE": records["extended"],
            "DLC": np.array([len2dlc(length) for length in records["length"].tolist()], np.uint8),
            "Dir": records["sent"],
        }
        if name != "CAN_RemoteFrame":
            size = FRAME_BYTES_MAX if is_fd else FRAME_BYTES
            members |= {"DataLength": records["length"], "DataBytes": records["data"][:, :size]}
        if is_fd:  # with bit-rate switching, from senders that are not error passive
            members |= {"EDL": records["fd"], "BRS": records["fd"], "ESI": np.zeros_like(records["fd"])}
        samples = np.empty(len(records), [(f"{name}.{key}", one.dtype, one.shape[1:]) for key, one in members.items()])
        for key, one in members.items():
            samples[f"{name}.{key}"] = one
        attachment = None
        if self._head.dbc is not None and name == "CAN_DataFrame":
            attachment = (self._head.dbc, Path("ars.dbc"), hashlib.md5(self._head.dbc, usedforsecurity=False).digest())
        source = Source(_word(self._head.channel), f"CAN{CHANNEL_NUMBER}", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
        return Signal(samples, records["time"].copy(), name=name, source=source, attachment=attachment)


LOG_WRITERS: dict[str, type[Writer]] = {".blf": BlfWriter, ".asc": AscWriter, ".log": CandumpWriter, ".mf4": Mf4Writer}


def _message(frame: Frame, received: bool, rounding: float = 0.0) -> can.Message:
    import can  # here, as the import takes half a second

    return can.Message(
        timestamp=max(frame.time, 0.0) + rounding,
        arbitration_id=frame.id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote and not frame.error,
        is_error_frame=frame.error,
        is_rx=received,
        is_fd=frame.fd,
        bitrate_switch=frame.fd,
        dlc=len(frame.data),
        data=None if frame.remote else frame.data,
    )


def _microseconds(seconds: float) -> int:
    return round(seconds * 1e6)


def _word(channel: str) -> str:
    """Return a channel's name without blanks, which would break a line of candump or ASC."""
    return "_".join(channel.split()) or "can"


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
        form = LOG_WRITERS.get(path.suffix.lower())
        if form is None:
            raise CodegenError(
                "no format for a log of the bus", where=path, remedy=f"end its name in one of {', '.join(LOG_WRITERS)}"
            )
        if form is Mf4Writer and importlib.util.find_spec("asammdf") is None:
            raise missing("asammdf", "writes MF4", path)
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
