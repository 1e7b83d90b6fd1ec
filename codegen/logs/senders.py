"""Which frames of a log are used: one sender of each message, without the copies of its frames.

A log may have a frame twice: its logger receives what it sent itself, or a gateway repeats it on another bus, some ms later.
Copies are recognised by equal data, never by the direction alone. The original is the one whose data change first. If that
cannot be determined, or if the frames of one message differ, the user must choose.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IndexArray
from codegen.errors import CodegenError, suggestion
from codegen.logs.databases import BusKey, Directory
from codegen.logs.frames import Frames, IntArray, Kind
from codegen.logs.stamps import blocks

COPY_DELAY_MAX_S = 0.5
"""Largest time from a frame to its copy. Gateways take some ms, and some tens of ms under load."""
COPY_FRACTION_MIN = 0.9
"""Least fraction of changes of the data that are copies, and of those that have the same order, if one sender repeats another.
Logs lose frames."""
SAME_TIME_S = 1e-3
"""Largest delay of a copy that may as well be the original: both are logged on one bus."""
STRAY_FRACTION_MAX = 0.05
"""Largest fraction of frames of other senders on the same bus that are left out: a tester that sends a message now and then."""
TICK_S = 1e-6


class Fate(IntEnum):
    """Use of a frame that was read."""

    USED = 0
    ERROR = 1
    REMOTE = 2
    UNKNOWN = 3
    OTHER_CHANNEL = 4
    NO_TIME = 5
    COPY = 6
    OTHER_SENDER = 7
    CONFLICT = 8


FATES: Mapping[Fate, str] = {
    Fate.USED: "used",
    Fate.ERROR: "error frame",
    Fate.REMOTE: "remote frame",
    Fate.UNKNOWN: "not in the databases",
    Fate.OTHER_CHANNEL: "channel not chosen",
    Fate.NO_TIME: "unusable time",
    Fate.COPY: "copy",
    Fate.OTHER_SENDER: "another sender",
    Fate.CONFLICT: "several senders",
}


@dataclass(frozen=True)
class Sender:
    """Frames of one message on one channel, in one direction and with one identifier."""

    channel: str
    is_sent: bool
    identifier: int
    frames: IndexArray

    def __str__(self) -> str:
        return f"channel {self.channel}, {'sent by the logger' if self.is_sent else 'received'}"


@dataclass
class Allotment:
    """Use of each frame.

    Attributes:
        fate: (n,) values of Fate.
        keys: key of the databases -> indices of its frames that are used, in the order of the file.
        findings: key -> findings about its frames.
        conflicts: key -> what differs, and the remedy, where several senders send a message.
        clock: findings about the clock, and the number of frames that are lost by it; "" and 0 for nothing.
    """

    fate: IntArray
    keys: dict[BusKey, IndexArray] = field(default_factory=dict)
    findings: dict[BusKey, str] = field(default_factory=dict)
    conflicts: dict[BusKey, tuple[str, str]] = field(default_factory=dict)
    clock: tuple[str, int] = ("", 0)


def allot(frames: Frames, databases: Directory, channel: str | None, where: object) -> Allotment:
    """Decide for each frame whether it is used.

    Args:
        databases: messages that are of interest.
        channel: the one that is used; None for all.
        where: the log, for errors.

    Raises:
        CodegenError: there is no such channel, or the account does not close.
    """
    if channel is not None and channel not in frames.channels:
        shown = ", ".join(frames.channels) or "none"
        raise CodegenError(
            f"the log has no channel {channel!r}",
            where=where,
            remedy=f"choose one of its channels with `channel=`: {shown}{suggestion(channel, frames.channels)}",
        )
    found = Allotment(np.full(len(frames), Fate.UNKNOWN, dtype=np.int64))
    usable = _usable(frames, found)
    chosen = np.ones(len(frames), dtype=bool)
    if channel is not None:
        chosen = frames.channel == frames.channels.index(channel)
    for fate, is_so in (
        (Fate.NO_TIME, ~usable),
        (Fate.OTHER_CHANNEL, ~chosen),
        (Fate.REMOTE, frames.kind == Kind.REMOTE),
        (Fate.ERROR, frames.kind == Kind.ERROR),
    ):
        found.fate[is_so] = fate
    for key, senders in _senders(frames, databases, found.fate == Fate.UNKNOWN).items():
        _choose(key, senders, frames, found)
    if int(np.bincount(found.fate, minlength=len(Fate)).sum()) != len(frames):
        raise CodegenError("its account does not close", where=where, remedy="report it with the file")
    return found


def _usable(frames: Frames, found: Allotment) -> BoolArray:
    """Return which frames have a usable time: those of the longest part between restarts of the clock."""
    parts = blocks(frames.time)
    used = max(parts, key=len, default=np.array([], dtype=np.intp))
    usable = np.zeros(len(frames), dtype=bool)
    usable[used] = True
    lost = len(frames) - used.size
    if len(parts) > 1:
        text = f"the clock restarts {len(parts) - 1} times; only the longest part is used"
        found.clock = f"{text}, {lost} of {len(frames)} frames are lost", lost
    elif lost:
        found.clock = f"{lost} of {len(frames)} frames have an impossible time", lost
    return usable


def _senders(frames: Frames, databases: Directory, is_open: BoolArray) -> dict[BusKey, list[Sender]]:
    """Return the senders of each message of the databases, among the open frames; the one with most frames first."""
    groups: defaultdict[BusKey, dict[tuple[int, bool, int], list[int]]] = defaultdict(dict)
    keys: dict[tuple[int, bool], BusKey | None] = {}
    numbers = np.flatnonzero(is_open)
    columns = (frames.identifier, frames.is_extended, frames.channel, frames.is_sent)
    rows = zip(numbers.tolist(), *(column[numbers].tolist() for column in columns), strict=True)
    for number, identifier, is_extended, channel, is_sent in rows:
        plain = identifier, is_extended
        if plain not in keys:
            keys[plain] = databases.key_of(*plain)
        key = keys[plain]
        if key is not None:
            groups[key].setdefault((channel, is_sent, identifier), []).append(number)
    return {
        key: sorted(
            (
                Sender(frames.channels[channel], is_sent, identifier, np.array(members, dtype=np.intp))
                for (channel, is_sent, identifier), members in group.items()
            ),
            key=lambda sender: -sender.frames.size,
        )
        for key, group in groups.items()
    }


def _choose(key: BusKey, senders: Sequence[Sender], frames: Frames, found: Allotment) -> None:
    """Use the frames of one sender of a message, and note what becomes of the others."""
    groups: list[list[tuple[Sender, float]]] = []  # senders that repeat each other, with their delay after the first of them
    for sender in senders:
        for group in groups:
            delay = copy_delay(frames, group[0][0].frames, sender.frames)
            if delay is not None:
                group.append((sender, 0.0 if np.isnan(delay) and _is_one_bus([group[0][0], sender]) else delay))
                break
        else:
            groups.append([(sender, 0.0)])
    originals = []
    texts = []
    for group in groups:
        if any(np.isnan(delay) for _, delay in group):
            repeated = [sender for sender, _ in group]
            for sender in senders:
                found.fate[sender.frames] = Fate.CONFLICT
            found.conflicts[key] = _conflict(repeated, "the same data, and which of them are the copies cannot be determined")
            return
        original, start = min(group, key=lambda entry: (entry[1], not entry[0].is_sent))
        originals.append(original)
        for sender, delay in group:
            if sender is not original:
                found.fate[sender.frames] = Fate.COPY
                if _is_one_bus([sender, original]):
                    continue  # a node that hears itself is plain
                later = f"{1e3 * (delay - start):.3g} ms later"
                texts.append(f"{sender.frames.size} frames ({sender}) copy those of {original}, {later}")
    first, others = originals[0], originals[1:]
    stray = sum(other.frames.size for other in others)
    if not others or (_is_one_bus(originals) and stray <= STRAY_FRACTION_MAX * first.frames.size):
        found.fate[first.frames] = Fate.USED
        found.keys[key] = first.frames
        for other in others:
            found.fate[other.frames] = Fate.OTHER_SENDER
            than = f"the {first.frames.size} of {first}"
            texts.append(f"{other.frames.size} frames ({other}) have other data than {than}, and are left out")
    else:
        for other in originals:
            found.fate[other.frames] = Fate.CONFLICT
        found.conflicts[key] = _conflict(originals, "different data")
    if texts:
        found.findings[key] = "; ".join(texts)


def _is_one_bus(senders: Sequence[Sender]) -> bool:
    """Return whether all have one channel and one identifier."""
    return len({(sender.channel, sender.identifier) for sender in senders}) == 1


def _conflict(originals: Sequence[Sender], what: str) -> tuple[str, str]:
    """Return what is wrong if several senders send a message, and the remedy. what: text about their data."""
    shown = " and ".join(f"{each.frames.size} frames ({_of(each, originals)})" for each in originals)
    channels = list(dict.fromkeys(each.channel for each in originals))
    if len(channels) > 1:
        remedy = f"choose a bus with `channel={' or '.join(map(repr, channels))}`, or channel in names.toml"
    elif len({each.identifier for each in originals}) > 1:
        remedy = "give a database with the identifier of the sender that counts"
    else:
        remedy = "log without the node that sends it too"
    return f"{shown} have {what}", remedy


def _of(sender: Sender, originals: Sequence[Sender]) -> str:
    if len({each.identifier for each in originals}) > 1:
        return f"{sender}, from address 0x{sender.identifier & 0xFF:02X}"
    return str(sender)


def copy_delay(frames: Frames, one: IndexArray, other: IndexArray) -> float | None:
    """Return by how many s frames `other` are later than `one`, if they have the same data; None if they do not.

    Only changes of the data are compared, for unchanged data match anything: a late copy equals the next frame of the original
    as well. Each change of `other` must be one of `one`, and `other` must change where `one` does; a gateway may leave frames
    out. Data that never change have no delay.

    The result is NaN if the order cannot be determined. Data that repeat, such as those of a counter, may be as well early as
    late. So only changes with one possible counterpart count, and nearly all of these must be on the same side of it.
    """
    codes: dict[bytes, int] = {}
    (code_one, time_one), (code_other, time_other) = (_changes(frames, indices, codes) for indices in (one, other))
    start, end = frames.time[other].min() - COPY_DELAY_MAX_S, frames.time[other].max() + COPY_DELAY_MAX_S
    within = time_one[(time_one >= start) & (time_one <= end)]
    if not time_other.size or not within.size:
        is_constant = not time_other.size and not within.size
        return 0.0 if is_constant and frames.data[one[0]] == frames.data[other[0]] else None
    since, until = _beside(code_one, time_one, code_other, time_other)
    any_since, any_until = _beside(np.zeros_like(code_other), time_other, np.zeros(within.size, dtype=np.int64), within)
    for distance in (np.minimum(since, until), np.minimum(any_since, any_until)):
        if np.count_nonzero(distance <= COPY_DELAY_MAX_S) < COPY_FRACTION_MIN * distance.size:
            return None
    nearest = np.where(since <= until, since, -until)
    is_clear = (since <= COPY_DELAY_MAX_S) != (until <= COPY_DELAY_MAX_S)
    start, end = frames.time[one].min() + COPY_DELAY_MAX_S, frames.time[one].max() - COPY_DELAY_MAX_S
    is_once = (np.bincount(code_one, minlength=len(codes)) == 1) & (np.bincount(code_other, minlength=len(codes)) == 1)
    is_clear &= ((time_other >= start) & (time_other <= end)) | is_once[code_other]  # else a counterpart may not be in the log
    if np.count_nonzero(is_clear) >= (1.0 - COPY_FRACTION_MIN) * is_clear.size:
        clear = nearest[is_clear]
        late = np.count_nonzero(clear >= 0.0) / clear.size
        if max(late, 1.0 - late) >= COPY_FRACTION_MIN:
            return float(np.median(clear))
    usual = float(np.median(nearest))
    return usual if np.median(np.abs(nearest)) <= SAME_TIME_S else np.nan


def _changes(frames: Frames, indices: IndexArray, codes: dict[bytes, int]) -> tuple[IntArray, FloatArray]:
    """Return a number for the data, from `codes`, and the time of each frame whose data differ from those of the one before."""
    code = np.array([codes.setdefault(frames.data[index], len(codes)) for index in indices.tolist()], dtype=np.int64)
    changed = np.flatnonzero(np.diff(code)) + 1
    return code[changed], frames.time[indices[changed]]


def _beside(code: IntArray, time: FloatArray, wanted: IntArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the time in s since the latest of the times with the same code, and until the next one, (k,); infinite if none."""
    start, end = min(time.min(), at.min()), max(time.max(), at.max())
    count = int(max(code.max(), wanted.max())) + 1
    tick = max(TICK_S, 4.0 * (end - start) * count / 2**62)
    span = int((end - start) / tick) + 1
    step = 4 * span  # times of one code stay far from those of the next
    keys = np.sort(code * step + np.rint((time - start) / tick).astype(np.int64))
    target = wanted * step + np.rint((at - start) / tick).astype(np.int64)
    place = np.searchsorted(keys, target, side="right")
    result = []
    for side, is_there in ((place - 1, place > 0), (place, place < keys.size)):
        distance = np.abs(target - keys[np.clip(side, 0, keys.size - 1)])
        result.append(np.where(is_there & (distance <= span), distance * tick, np.inf))
    return result[0], result[1]
