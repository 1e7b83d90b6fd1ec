"""Which frames of a log are used: one sender of each message, without the copies of its frames.

A log may have a frame twice: its logger receives what it sent itself, or a gateway repeats it on another bus, some ms later.
Copies are recognised by equal data, never by the direction alone. The original is the one whose data change first. It is used
if it covers what its copies cover. If it covers only a part, if it cannot be determined, or if the frames of one message
differ, the user must choose.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IndexArray
from codegen.errors import CodegenError, suggestion
from codegen.logs.databases import BusKey, Directory
from codegen.logs.frames import Frames, IntArray, Kind, blocks

COPY_DELAY_MAX_S = 0.5
"""Largest time from a frame to its copy. Gateways take some ms, and some tens of ms under load."""
COPY_FRACTION_MIN = 0.9
"""Least fraction of changes of the data that are copies, and of those that have the same order, if one sender repeats another.
Logs lose frames."""
COVER_FRACTION_MIN = 0.98
"""Least fraction of the frames of a copy that must have a frame of the original nearby, if the original is used."""
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
        repeated = [sender for sender, _ in group]
        if any(np.isnan(delay) for _, delay in group):
            _refuse(
                key, senders, repeated, "the same data, and which of them are the copies cannot be determined", frames, found
            )
            return
        original, start = _original(group, frames)
        first, first_delay = min(group, key=lambda entry: (entry[1], not entry[0].is_sent))
        if any(not _covers(original, sender, frames) for sender in repeated if sender.channel != original.channel):
            lead = min(delay for sender, delay in group if sender.channel != first.channel) - first_delay
            earlier = (
                f"; those of channel {first.channel} are {1e3 * lead:.3g} ms earlier, but" if lead else ", but those of each"
            )
            _refuse(key, senders, repeated, f"the same data{earlier} cover only a part of the others", frames, found)
            return
        originals.append(original)
        for sender, delay in group:
            if sender is not original:
                found.fate[sender.frames] = Fate.COPY
                if _is_one_bus([sender, original]):
                    continue  # a node that hears itself is plain
                later = f", {1e3 * (delay - start):.3g} ms later" if delay != start else ""
                texts.append(f"{sender.frames.size} frames ({sender}) copy those of {original}{later}")
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
        spans = sorted((frames.time[each.frames].min(), frames.time[each.frames].max()) for each in originals)
        are_apart = all(end < start for (_, end), (start, _) in pairwise(spans))
        _refuse(key, originals, originals, "no time in common" if are_apart else "different data", frames, found)
    if texts:
        found.findings[key] = "; ".join(texts)


def _original(group: Sequence[tuple[Sender, float]], frames: Frames) -> tuple[Sender, float]:
    """Return the sender that is used of those that repeat each other, and its delay.

    A channel counts with its earliest sender that covers its others, else with its longest: a logger may note only some of
    the frames that it sends. Of channels at the same time, which log one bus twice, the one that covers the others counts.
    """

    def order(entry: tuple[Sender, float]) -> tuple[float, bool]:
        return entry[1], not entry[0].is_sent

    of_channels: dict[str, list[tuple[Sender, float]]] = {}
    for entry in sorted(group, key=order):
        of_channels.setdefault(entry[0].channel, []).append(entry)
    chosen = []
    for entries in of_channels.values():
        whole = (one for one in entries if all(_covers(one[0], other, frames) for other, _ in entries))
        chosen.append(next(whole, max(entries, key=lambda entry: entry[0].frames.size)))
    chosen.sort(key=order)
    early = [entry for entry in chosen if entry[1] - chosen[0][1] <= SAME_TIME_S]
    whole = (one for one in early if all(_covers(one[0], other, frames) for other, _ in chosen))
    return next(whole, chosen[0])


def _covers(one: Sender, other: Sender, frames: Frames) -> bool:
    """Return whether `one` has frames wherever `other` has some, and about as many."""
    if one is other:
        return True
    times, wanted = np.sort(frames.time[one.frames]), frames.time[other.frames]
    near = np.searchsorted(times, wanted + COPY_DELAY_MAX_S, "right") > np.searchsorted(times, wanted - COPY_DELAY_MAX_S)
    is_dense = times.size >= COPY_FRACTION_MIN * wanted.size
    return bool(is_dense and np.count_nonzero(near) >= COVER_FRACTION_MIN * near.size)


def _refuse(
    key: BusKey, senders: Sequence[Sender], shown: Sequence[Sender], what: str, frames: Frames, found: Allotment
) -> None:
    """Use no frame of any sender of a message. shown: those named in the conflict. what: text about their data."""
    for sender in senders:
        found.fate[sender.frames] = Fate.CONFLICT
    found.conflicts[key] = _conflict(shown, what, frames)


def _is_one_bus(senders: Sequence[Sender]) -> bool:
    """Return whether all have one channel and one identifier."""
    return len({(sender.channel, sender.identifier) for sender in senders}) == 1


def _conflict(originals: Sequence[Sender], what: str, frames: Frames) -> tuple[str, str]:
    """Return what is wrong if several senders send a message, and the remedy. what: text about their data."""
    times = [frames.time[each.frames] - frames.time[np.isfinite(frames.time)].min() for each in originals]
    shown = " and ".join(
        f"{each.frames.size} frames ({_of(each, originals)}, {time.min():.2f} to {time.max():.2f} s)"
        for each, time in zip(originals, times, strict=True)
    )
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

    Only the time that both have is compared, and in it only changes of the data, for unchanged data match anything: a late copy
    equals the next frame of the original as well. Each change of `other` must be one of `one`, and `other` must change where
    `one` does if it has frames there; a gateway may leave frames out. Data that never change have no delay.

    The result is NaN if the order cannot be determined. Data that repeat, such as those of a counter, may be as well early as
    late, so only changes with one possible counterpart count. Where one of them has fewer frames, the first of its frames with
    some data may be too late, and the last too early. So both must be on the same side of their counterpart.
    """
    codes: dict[bytes, int] = {}
    series_one, series_other = (_Series.of(frames, indices, codes) for indices in (one, other))
    start, end = max(series_one.start, series_other.start), min(series_one.end, series_other.end)
    if start > end:
        return None
    if series_one.is_constant and series_other.is_constant:
        return 0.0 if series_one.start_code == series_other.start_code else None
    inner_one, inner_other = (
        np.flatnonzero((series.first >= start) & (series.first <= end)) for series in (series_one, series_other)
    )
    changes = series_one.first[inner_one]
    after = np.searchsorted(series_other.time, changes)
    until_frame = series_other.time[np.minimum(after, series_other.time.size - 1)] - changes
    changes = changes[until_frame <= COPY_DELAY_MAX_S]
    if not inner_other.size or not changes.size:
        is_equal = not inner_other.size and not inner_one.size and series_one.code_at(end) == series_other.code_at(end)
        return np.nan if is_equal else None
    first = _match(series_one, series_other, inner_other, "first", len(codes))
    zeros = np.zeros(changes.size, dtype=np.int64)
    since, until = _beside(np.zeros_like(series_other.code), series_other.first, zeros, changes)
    for is_near in (first.is_since | first.is_until, np.minimum(since, until) <= COPY_DELAY_MAX_S):
        if np.count_nonzero(is_near) < COPY_FRACTION_MIN * is_near.size:
            return None
    ended = inner_other[inner_other < series_other.code.size - 1]  # the last run may go on after the log
    last = _match(series_one, series_other, ended, "last", len(codes))
    bounds = []
    is_thin = _count(series_other, start, end) <= _count(series_one, start, end)
    for match, fraction in ((first, 1.0 - COPY_FRACTION_MIN), (last, COPY_FRACTION_MIN)):
        clear = match.nearest[match.is_clear]
        if clear.size and clear.size >= (1.0 - COPY_FRACTION_MIN) * match.is_clear.size:
            bounds.append(float(np.quantile(clear, fraction if is_thin else 1.0 - fraction)))
    if len(bounds) == 2 and min(bounds) * max(bounds) > 0.0:
        return float(np.mean(bounds))
    usual = float(np.median(first.nearest))
    return usual if np.median(np.abs(first.nearest)) <= SAME_TIME_S else np.nan


def _count(series: _Series, start: float, end: float) -> int:
    return int(np.count_nonzero((series.time >= start) & (series.time <= end)))


@dataclass(frozen=True)
class _Series:
    """Runs of frames with the same data; the first run, whose begin is not known, is left out.

    Attributes:
        time: (n,) s, of all frames. start, end: the first and last.
        start_code: number of the data of the first run.
        code: (k,) number of the data of each later run.
        first, last: (k,) time of the first and last frame of each run, s; none if the data never change.
        before, after: (k,) s to the frame before the first and after the last.
    """

    time: FloatArray
    start: float
    end: float
    start_code: int
    code: IntArray
    first: FloatArray
    last: FloatArray
    before: FloatArray
    after: FloatArray

    @classmethod
    def of(cls, frames: Frames, indices: IndexArray, codes: dict[bytes, int]) -> _Series:
        """Return the runs of frames. codes: numbers for the data; new ones are added."""
        code = np.array([codes.setdefault(frames.data[index], len(codes)) for index in indices.tolist()], dtype=np.int64)
        time = frames.time[indices]
        begin = np.flatnonzero(np.diff(code)) + 1
        finish = np.append(begin[1:] - 1, time.size - 1)[: begin.size]
        gap = np.append(np.diff(time), 0.0)
        return cls(
            np.sort(time),
            float(time.min()),
            float(time.max()),
            int(code[0]),
            code[begin],
            time[begin],
            time[finish],
            gap[begin - 1],
            gap[finish],
        )

    @property
    def is_constant(self) -> bool:
        return not self.first.size

    def code_at(self, time: float) -> int:
        """Return the number of the data at a time."""
        place = int(np.searchsorted(self.first, time, side="right"))
        return int(self.code[place - 1]) if place else self.start_code


@dataclass(frozen=True)
class _Match:
    """Counterparts of runs in another series, (k,).

    Attributes:
        nearest: s after the nearest counterpart; negative before it.
        is_since, is_until: whether there is one before, and after.
        is_clear: whether only one can be it.
    """

    nearest: FloatArray
    is_since: BoolArray
    is_until: BoolArray
    is_clear: BoolArray


def _match(one: _Series, other: _Series, runs: IndexArray, side: str, code_count: int) -> _Match:
    """Return the counterparts in `one` of runs of `other`. side: "first" or "last" frame of the runs."""
    code, at = other.code[runs], getattr(other, side)[runs]
    if not runs.size:
        return _Match(at, *(np.zeros(0, dtype=bool),) * 3)
    since, until = _beside(one.code, getattr(one, side), code, at)
    since_max = COPY_DELAY_MAX_S + (other.before[runs] if side == "first" else 0.0)
    until_max = COPY_DELAY_MAX_S + (other.after[runs] if side == "last" else 0.0)
    is_since, is_until = since <= since_max, until <= until_max
    is_clear = is_since != is_until
    is_once = (np.bincount(one.code, minlength=code_count) == 1) & (np.bincount(other.code, minlength=code_count) == 1)
    start, end = one.start + COPY_DELAY_MAX_S, one.end - COPY_DELAY_MAX_S
    is_clear &= ((at >= start) & (at <= end)) | is_once[code]  # else a counterpart may not be in the log
    return _Match(np.where(since <= until, since, -until), is_since, is_until, is_clear)


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
