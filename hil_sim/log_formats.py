"""The formats of `logs`: one writer each, for frames with times from the start of the run.

BLF and the lines of ASC are python-can's. Its candump writer drops the length of remote frames and the class of errors, its
MF4 writer starts at the moment of opening: those two are written here.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from codegen import __version__
from hil_sim.frames import Frame

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
            content = f"{identifier}#" + (f"R{len(frame.data) or ''}" if frame.remote else frame.data.hex().upper())
        self._file.write(f"({seconds}.{microseconds:06d}) {self._channel} {content} {'R' if received else 'T'}\n")

    def close(self) -> None:
        self._file.close()


class Mf4Writer:
    """Bus logging of ASAM MDF 4.1: plain bus events CAN_DataFrame, CAN_RemoteFrame and CAN_ErrorFrame, a group each.

    Frames are kept in memory, 24 bytes each, and sorted at the end: a master channel never goes back.
    """

    RECORD = struct.Struct("<dIBBBB8s")
    FIELDS = np.dtype(
        [
            ("time", "<f8"),
            ("id", "<u4"),
            ("extended", "u1"),
            ("length", "u1"),
            ("sent", "u1"),
            ("kind", "u1"),
            ("data", "u1", 8),
        ]
    )
    KINDS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame")

    def __init__(self, path: Path, head: Head) -> None:
        self._file = path.open("w+b")
        self._head = head
        self._records = bytearray()

    def write(self, frame: Frame, received: bool) -> None:
        kind = self.KINDS.index("CAN_ErrorFrame" if frame.error else "CAN_RemoteFrame" if frame.remote else "CAN_DataFrame")
        head = (max(frame.time, 0.0), frame.id, frame.extended, len(frame.data), not received, kind)
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

        members = {
            "BusChannel": np.full(len(records), CHANNEL_NUMBER, np.uint8),
            "ID": records["id"],
            "IDE": records["extended"],
            "DLC": records["length"],
            "Dir": records["sent"],
        }
        if name != "CAN_RemoteFrame":
            members |= {"DataLength": records["length"], "DataBytes": records["data"]}
        samples = np.empty(len(records), [(f"{name}.{key}", one.dtype, one.shape[1:]) for key, one in members.items()])
        for key, one in members.items():
            samples[f"{name}.{key}"] = one
        attachment = None
        if self._head.dbc is not None and name == "CAN_DataFrame":
            attachment = (self._head.dbc, Path("ars.dbc"), hashlib.md5(self._head.dbc, usedforsecurity=False).digest())
        source = Source(_word(self._head.channel), f"CAN{CHANNEL_NUMBER}", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
        return Signal(samples, records["time"].copy(), name=name, source=source, attachment=attachment)


FORMATS: dict[str, type[Writer]] = {".blf": BlfWriter, ".asc": AscWriter, ".log": CandumpWriter, ".mf4": Mf4Writer}


def _message(frame: Frame, received: bool, rounding: float = 0.0) -> can.Message:
    import can  # here, as the import takes half a second

    return can.Message(
        timestamp=max(frame.time, 0.0) + rounding,
        arbitration_id=frame.id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote and not frame.error,
        is_error_frame=frame.error,
        is_rx=received,
        dlc=len(frame.data),
        data=None if frame.remote else frame.data,
    )


def _microseconds(seconds: float) -> int:
    return round(seconds * 1e6)


def _word(channel: str) -> str:
    """Return a channel's name without blanks, which would break a line of candump or ASC."""
    return "_".join(channel.split()) or "can"
