"""Frames of an MF4, ASAM's bus logging. Only a child process imports this module: asammdf may crash on a damaged file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from asammdf import MDF
from can.io.mf4 import MF4Reader

from codegen.importing import library_warnings
from codegen.importing.mf4 import FRAME_CHANNELS
from codegen.logs.frames import Collector, FileAccount, Frames

BUS_EVENT = 0x2
"""Flag of a channel group: plain bus event (ASAM MDF 4.1, cg_flags, bit 1)."""
CAN = 2
"""Type of the bus in the source of a group (ASAM MDF 4.1, si_bus_type)."""


def read(path: Path) -> tuple[Frames, FileAccount]:
    """Read the frames of an MF4. Raises whatever asammdf and python-can raise for a damaged file."""
    into = Collector("MF4")
    with library_warnings.collected() as warnings:
        with MDF(path) as mdf:
            _count(mdf, into)
            start = mdf.header.start_time.timestamp()
        with MF4Reader(path) as reader:
            for message in reader:
                into.add(message, message.timestamp, str(0 if message.channel is None else message.channel), str(path))
    return into.finish("Unix time" if start else "time from the start of the log", warnings)


def _count(mdf: MDF, into: Collector) -> None:
    """Count the frames of each group, and skip those of groups that python-can leaves out."""
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
            continue
        if count:
            into.skip(reason, f"group {number}", count)
