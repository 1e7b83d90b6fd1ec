"""Frames of an MF4, ASAM's bus logging. Only a child process imports this module: asammdf may crash on a damaged file."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import Any

from asammdf import MDF

from codegen.importing import child
from codegen.importing.mf4 import FRAME_CHANNELS
from codegen.logs.frames import Collector, FileAccount, Frames, Kind

BUS_EVENT = 0x2
"""Flag of a channel group: plain bus event (ASAM MDF 4.1, cg_flags, bit 1)."""
CAN = 2
"""Type of the bus in the source of a group (ASAM MDF 4.1, si_bus_type)."""
KINDS = {"CAN_DataFrame": Kind.DATA, "CAN_RemoteFrame": Kind.REMOTE, "CAN_ErrorFrame": Kind.ERROR}
IDENTIFIER_MASK = 0x1FFF_FFFF
CHUNK = 10_000
"""Records that are read at once. python-can reads 1,000 and looks up each number alone, which takes several times as long."""

Row = tuple[float, tuple[int, bool, bool, bool, int], str, bytes]
"""Time and the other arguments of `Collector.add_row`."""


def read(path: Path) -> tuple[Frames, FileAccount]:
    """Read the frames of an MF4, those of several groups in the order of time. Raises whatever asammdf raises for a damaged
    file."""
    into = Collector("MF4")
    with child.collected() as warnings, MDF(path) as mdf:
        groups = _count(mdf, into)
        start = mdf.header.start_time.timestamp()
        for row in heapq.merge(*(_rows(mdf, number, name, start) for number, name in groups), key=itemgetter(0)):
            into.add_row(*row, str(path))
    return into.finish("Unix time" if start else "time from the start of the log", warnings)


def _rows(mdf: MDF, number: int, name: str, start: float) -> Iterator[Row]:
    """Yield the frames of a group. Without a channel for them, frames are received, extended and classical, on channel 0."""
    kind = KINDS[name]
    for offset in range(0, int(mdf.groups[number].channel_group.cycles_nr), CHUNK):
        signal = mdf.get(name, number, record_offset=offset, record_count=CHUNK, raw=False)
        samples: Any = signal.samples
        fields, size = samples.dtype.names, len(samples)

        def column(part: str, default: object, samples: Any = samples, fields: Any = fields, size: int = size) -> list[Any]:
            return samples[f"{name}.{part}"].tolist() if f"{name}.{part}" in fields else [default] * size

        identifiers = column("ID", 0) if kind != Kind.ERROR else [0] * size
        directions = column("Dir", 0)
        sent = [each != b"Rx" if isinstance(each, bytes) else int(each) != 0 for each in directions]
        fd = column("EDL", False) if kind != Kind.REMOTE else [False] * size
        data = [b""] * size
        if kind != Kind.REMOTE and {f"{name}.DataBytes", f"{name}.DataLength"} <= set(fields):
            remote = column("RTR", False) if kind == Kind.ERROR else [False] * size
            whole = (row.tobytes() for row in samples[f"{name}.DataBytes"])
            lengths = column("DataLength", 0)
            data = [
                b"" if is_remote else row[: int(count)] for row, count, is_remote in zip(whole, lengths, remote, strict=True)
            ]
        times, extended, channels = signal.timestamps.tolist(), column("IDE", True), column("BusChannel", 0)
        for time, identifier, is_extended, is_fd, is_sent, channel, payload in zip(
            times, identifiers, extended, fd, sent, channels, data, strict=True
        ):
            row = (int(identifier) & IDENTIFIER_MASK, bool(is_extended), bool(is_fd), is_sent, int(kind))
            yield time + start, row, str(int(channel)), payload


def _count(mdf: MDF, into: Collector) -> list[tuple[int, str]]:
    """Count the frames of each group, and skip those that are no log of CAN. Return number and channel of the other groups."""
    found = []
    for number, group in enumerate(list[Any](mdf.groups)):
        count = int(group.channel_group.cycles_nr)
        names = {str(channel.name) for channel in group.channels}
        kind = next((name for name in FRAME_CHANNELS if name in names), None)
        if kind is None:
            if count:
                into.others["sample of a group without frames"] += count
            continue
        into.in_file += count
        source = group.channel_group.acq_source
        if kind == "CAN_OverloadFrame":
            reason = "an overload frame"
        elif not group.channel_group.flags & BUS_EVENT:
            reason = "its group is not marked as bus events"
        elif source is None or not source.source_type & 2 or source.bus_type != CAN:
            reason = "its group does not name a CAN bus as its source"
        else:
            found.append((number, kind))
            continue
        if count:
            into.skip(reason, f"group {number}", count)
    return found
