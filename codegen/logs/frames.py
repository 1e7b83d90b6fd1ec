"""Frames of a log, the account of the file that they come from, and which of their time stamps can be used.

Every reader counts the frames of its file by itself, before python-can sees them. The frames that python-can returns and those
that are skipped, each with a reason, must add up to that count.

A stamp is unusable if it is not finite, lies far from both of its neighbours, or does not increase. A jump back by more than
RESTART_S is a restart of the logger's clock. Times before and after a restart have no known relation, so only the longest block
is used.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray, IndexArray
from codegen.errors import CodegenError, one_line

if TYPE_CHECKING:
    import can


IntArray = npt.NDArray[np.int64]

BYTES_MAX = 2**30
"""Largest size of a log."""
TIME_MAX_S = 1e11
"""Largest time stamp of a frame; Unix time stays below for 3,000 years."""
REMEDY = "give a log that codegen hil or another tool wrote"


class Kind(IntEnum):
    """Kind of a frame."""

    DATA = 0
    REMOTE = 1
    ERROR = 2


@dataclass(frozen=True)
class Frames:
    """Frames of a log, in the order of the file.

    Attributes:
        time: (n,) s on the clock of the log.
        identifier: (n,) identifiers; 0 for an error frame.
        is_extended, is_fd, is_sent: (n,) flags; the logger itself has sent those with the last one.
        kind: (n,) values of Kind.
        channel: (n,) indices into `channels`.
        channels: names of the channels as the file has them: "1", "can0".
        data: the n payloads.
    """

    time: FloatArray
    identifier: IntArray
    is_extended: BoolArray
    is_fd: BoolArray
    is_sent: BoolArray
    kind: IntArray
    channel: IndexArray
    channels: tuple[str, ...]
    data: list[bytes]

    def __len__(self) -> int:
        return len(self.data)


@dataclass(frozen=True)
class FileAccount:
    """Account of the frames of a file when it was read.

    Attributes:
        form: name of the format.
        clock: meaning of the stamps in the file. Those of `Frames` are always on one clock.
        in_file: number of frames in the file, counted without python-can.
        read: number of frames that were read.
        skipped: reason -> number of frames that were not read, and the place of the first one.
        others: kind of an entry that is no frame -> number.
        warnings: warnings of the libraries.
    """

    form: str
    clock: str
    in_file: int
    read: int
    skipped: Mapping[str, tuple[int, str]]
    others: Mapping[str, int]
    warnings: tuple[str, ...] = ()


@dataclass
class Collector:
    """Collects the frames of a file while a reader goes through it."""

    form: str
    in_file: int = 0
    skipped: dict[str, tuple[int, str]] = field(default_factory=dict)
    others: Counter[str] = field(default_factory=Counter)
    times: array[float] = field(default_factory=lambda: array("d"))
    _rows: array[int] = field(default_factory=lambda: array("q"))
    """Six numbers for each frame, in the order of `Frames`: arrays take a quarter of the memory of lists."""
    _data: list[bytes] = field(default_factory=list)
    _channels: dict[str, int] = field(default_factory=dict)

    def skip(self, reason: str, place: str, count: int = 1) -> None:
        """Account for frames that are not read."""
        before, first = self.skipped.get(reason, (0, place))
        self.skipped[reason] = before + count, first

    def add(self, message: can.Message, time: float, channel: str, place: str) -> None:
        """Take over a frame that python-can has read. Raises CodegenError if its time is impossible."""
        kind = Kind.ERROR if message.is_error_frame else Kind.REMOTE if message.is_remote_frame else Kind.DATA
        identifier = message.arbitration_id if kind != Kind.ERROR else 0
        flags = message.is_extended_id, message.is_fd, not message.is_rx
        self.add_row(time, (identifier, *flags, kind), channel, bytes(message.data), place)

    def add_row(self, time: float, row: tuple[int, bool, bool, bool, int], channel: str, data: bytes, place: str) -> None:
        """Take over a frame: identifier, the three flags and the kind of `Frames`. See `add`."""
        if not abs(time) <= TIME_MAX_S:  # NaN neither
            raise CodegenError("a frame has an invalid time", where=place, remedy=REMEDY)
        self.times.append(time)
        self._rows.extend((*row, self._channels.setdefault(channel, len(self._channels))))
        self._data.append(data)

    def finish(self, clock: str, warnings: Iterable[str] = ()) -> tuple[Frames, FileAccount]:
        """Return the frames and the account. Raises CodegenError if the account does not close."""
        rows = np.array(self._rows, dtype=np.int64).reshape(-1, 6).T.copy()
        is_extended, is_fd, is_sent = (row.astype(bool) for row in rows[1:4])
        frames = Frames(
            np.array(self.times, dtype=np.float64),
            rows[0],
            is_extended,
            is_fd,
            is_sent,
            rows[4],
            rows[5].astype(np.intp),
            tuple(self._channels),
            self._data,
        )
        lost = sum(count for count, _ in self.skipped.values())
        if len(frames) + lost != self.in_file:
            raise CodegenError(
                f"its account does not close: {self.in_file} frames in the file, {len(frames)} read, {lost} skipped",
                remedy="report it with the file",
            )
        texts = tuple(dict.fromkeys(one_line(text) for text in warnings))
        return frames, FileAccount(self.form, clock, self.in_file, len(frames), dict(self.skipped), dict(self.others), texts)


RESTART_S = 1.0
"""Smallest jump back, in s, that counts as a restart. Frames of several controllers may be logged out of order by some ms."""


def is_isolated(time: FloatArray) -> BoolArray:
    """Return which stamps (n,) are not finite, or off by more than RESTART_S between two neighbours that fit each other."""
    bad = ~np.isfinite(time)
    good = np.flatnonzero(~bad)
    before, here, after = (
        (time[good[start : good.size - 2 + start]] for start in range(3)) if good.size > 2 else (time[:0],) * 3
    )
    fits = np.abs(after - before) <= RESTART_S
    bad[good[1:-1][fits & (np.minimum(np.abs(here - before), np.abs(here - after)) > RESTART_S)]] = True
    return bad


def blocks(time: FloatArray) -> list[IndexArray]:
    """Return the indices of the stamps (n,) in each block between restarts, without isolated stamps."""
    good = np.flatnonzero(~is_isolated(time))
    if not good.size:
        return []
    return np.split(good, np.flatnonzero(np.diff(time[good]) < -RESTART_S) + 1)


def increasing(time: FloatArray) -> BoolArray:
    """Return which stamps (n,) are above all earlier ones."""
    above = np.ones(time.size, dtype=bool)
    if time.size:
        above[1:] = time[1:] > np.maximum.accumulate(time)[:-1]
    return above
