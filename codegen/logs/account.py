"""The account of a log: what became of each of its frames."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from codegen.errors import CodegenError, one_line
from codegen.files import reason_of, refuse_empty, require_regular
from codegen.importing import child
from codegen.importing.rows import RESOLUTION_S
from codegen.limits import Limits
from codegen.logs import measurement
from codegen.logs.databases import Databases, Directory
from codegen.logs.formats import ENDINGS, KINDS, LOGS, MEASUREMENTS
from codegen.logs.frames import BYTES_MAX, REMEDY, Collector, FileAccount, Frames, Kind
from codegen.logs.measurement import open_measurement
from codegen.logs.senders import FATES, Allotment, Fate, allot
from codegen.logs.text import NOT_LOGGED
from codegen.requirements import pip_install

DIRECTIONS = ("received", "sent")


@dataclass(frozen=True)
class BusLog:
    """A log of a bus: its frames, and what became of them.

    Attributes:
        path: the file.
        frames: those that were read.
        file: account of the file.
        allotment: what became of the frames.
        databases: databases that name the messages.
    """

    path: Path
    frames: Frames
    file: FileAccount
    allotment: Allotment
    databases: Directory

    @property
    def findings(self) -> list[str]:
        """One line for each thing that is not plain, without what concerns single messages."""
        lines = [
            f"{count} of {self.file.in_file} frames are not read: {reason} (first: {place})"
            for reason, (count, place) in self.file.skipped.items()
        ]
        if dropped := self.file.others.get(NOT_LOGGED):
            lines.append(f"the logger dropped {dropped} frames")
        if self.file.clock not in PLAIN_CLOCKS:
            lines.append(f"its stamps are the {self.file.clock}; they are added up")
        lines += [f"python-can or asammdf warns: {text}" for text in self.file.warnings]
        present = {key for key in map(self._key, *self._identifiers) if key}
        lines += [text for key, text in self.databases.conflicts.items() if key in present]
        for is_extended in (False, True):
            others = [
                identifier
                for identifier, one in zip(*self._identifiers, strict=True)
                if one == is_extended
                and self._key(identifier, one) is None
                and self._key(identifier, not one) not in {None, *present}
            ]
            if others:
                bits = "29 bits in the log and 11" if is_extended else "11 bits in the log and 29"
                shown = f"the identifier 0x{others[0]:X} has" if len(others) == 1 else f"{len(others)} identifiers have"
                lines.append(f"{shown} {bits} in the databases" + (f" (first: 0x{others[0]:X})" if len(others) > 1 else ""))
        return [*lines, *self.databases.findings]

    @property
    def message_findings(self) -> list[str]:
        """One line for each message whose frames are not plain, with its name."""
        found = self.allotment
        lines = [f"{self._name(key)}: {text}" for key, text in found.findings.items()]
        return lines + [f"{self._name(key)}: {what}; {remedy}" for key, (what, remedy) in found.conflicts.items()]

    @property
    def stamps(self) -> dict[str, int]:
        """Number of stamps that go back, that repeat that of the frame before on the channel, and of frames that repeat one."""
        time, frames = self.frames.time, self.frames
        back = int(np.count_nonzero(np.diff(time) < -RESOLUTION_S))
        repeated = 0
        for channel in range(len(frames.channels)):
            of_channel = np.sort(time[frames.channel == channel])
            repeated += int(np.count_nonzero(np.diff(of_channel) == 0.0))
        columns = (time, frames.identifier, frames.is_extended, frames.channel, frames.is_sent, frames.kind)
        rows = Counter(zip(*(column.tolist() for column in columns), frames.data, strict=True))
        return {"back": back, "repeated": repeated, "duplicates": sum(count - 1 for count in rows.values())}

    @property
    def _identifiers(self) -> tuple[list[int], list[bool]]:
        pairs = sorted(set(zip(self.frames.identifier.tolist(), self.frames.is_extended.tolist(), strict=True)))
        return [identifier for identifier, _ in pairs], [is_extended for _, is_extended in pairs]

    def _key(self, identifier: int, is_extended: bool) -> tuple[int, bool] | None:
        return self.databases.key_of(identifier, is_extended)

    def _name(self, key: tuple[int, bool]) -> str:
        return " or ".join(self.databases.names_of(key))


PLAIN_CLOCKS = ("Unix time", "time from the start of the log")


def read_frames(path: Path) -> tuple[Frames, FileAccount]:
    """Read the frames of a log, on one clock, and account for every frame of the file.

    Raises:
        CodegenError: no log by its name, not a regular file, over 1 GiB, damaged or cut short, or its reader is not installed.
    """
    kind = path.suffix.lower()
    if kind not in LOGS:
        raise CodegenError("not a log of a CAN bus", where=path, remedy="give .blf, .asc, .log (candump) or .mf4 (version 4)")
    size = require_regular(path, BYTES_MAX, "name a log", smaller="give a shorter log")
    refuse_empty(size, path)
    limits = Limits.of(size)
    try:
        if kind == ".mf4":
            found: tuple[Frames, FileAccount] = child.call("codegen.logs.mf4", "read", path, limits=limits)
            return found
        with limits.enforced(path):
            with child.collected() as warnings:
                into, clock = LOG_READERS[kind](path)
            return into.finish(clock, warnings)
    except CodegenError:
        raise
    except OSError as error:
        raise CodegenError(f"cannot be read ({reason_of(error)})", where=path, remedy="check its permissions") from None
    except ImportError as error:
        what = f"the package that reads it is missing ({one_line(error)})"
        raise CodegenError(what, where=path, remedy=pip_install("asammdf")) from None
    except Exception as error:  # readers may raise anything for a damaged file
        raise CodegenError(f"not a readable log of a CAN bus ({one_line(error)})", where=path, remedy=REMEDY) from None


def _blf(path: Path) -> tuple[Collector, str]:
    from codegen.logs import blf  # here, as python-can takes half a second

    return blf.read(path)


def _asc(path: Path) -> tuple[Collector, str]:
    from codegen.logs import text

    return text.read_asc(path)


def _candump(path: Path) -> tuple[Collector, str]:
    from codegen.logs import text

    return text.read_candump(path)


LOG_READERS = {".blf": _blf, ".asc": _asc, ".log": _candump}


def open_bus_log(path: Path, databases: Directory, channel: str | None = None) -> BusLog:
    """Read a log of a bus, and decide for each frame whether it is used.

    Args:
        channel: the bus that is used, as the file names it; None for all.

    Raises:
        CodegenError: the log or a database cannot be read, or the log has no such channel.
    """
    frames, account = read_frames(path)
    return BusLog(path, frames, account, allot(frames, databases, channel, path), databases)


def open_rows(path: Path, time: str | None = None, time_unit: str | None = None) -> measurement.Measurement | None:
    """Return a measurement, None for the log of a bus; see `open_measurement`. Raises CodegenError, also for another format."""
    if path.suffix.lower() not in ENDINGS:
        raise CodegenError("not a log", where=path, remedy=KINDS)
    return open_measurement(path, time, time_unit) if path.suffix.lower() in MEASUREMENTS else None


def open_log(
    path: Path, databases: Databases, channel: str | None = None, time: str | None = None, time_unit: str | None = None
) -> BusLog | measurement.Account:
    """Account for all of a log: the frames of a bus, or the rows of a measurement.

    Args:
        databases, channel: for the log of a bus, see `open_bus_log`.
        time, time_unit: for a table, see `open_rows`.

    Raises:
        CodegenError: the log or a database cannot be read, or the log has no such channel, or no bus.
    """
    found = open_rows(path, time, time_unit)
    if found is None:
        return open_bus_log(path, databases, channel)
    if databases.paths or channel is not None:
        raise CodegenError("it is not the log of a bus", where=path, remedy="leave `dbc=` and `channel=` out")
    return found.account()


def to_dict(log: BusLog | measurement.Account) -> dict[str, Any]:
    """Return the account for JSON."""
    if isinstance(log, measurement.Account):
        return measurement.to_dict(log)
    frames, file = log.frames, log.file
    time = frames.time
    return {
        "file": log.path.name,
        "format": file.form,
        "clock": {
            "kind": file.clock,
            "first_s": float(time.min()) if time.size else None,
            "duration_s": float(np.ptp(time)) if time.size else None,
            **log.stamps,
            "lost": log.allotment.clock[1],
        },
        "frames": {
            "in_file": file.in_file,
            "read": file.read,
            "skipped": [{"reason": why, "frames": count, "first": place} for why, (count, place) in file.skipped.items()],
            "other_entries": dict(file.others),
        },
        "channels": [
            {"channel": channel, "direction": direction, "frames": sum(fates.values()), **_named(fates)}
            for channel, direction, fates in channel_rows(log)
        ],
        "identifiers": list(_identifier_rows(log)),
        "databases": [
            {
                "file": each.path.name,
                "messages": len(each.database.messages),
                "findings": list(each.findings),
                "left_out": [dataclasses.asdict(line) for line in each.left_out],
            }
            for each in log.databases.files
        ],
        "conflicts": list(log.databases.conflicts.values()),
        "findings": findings(log),
    }


def findings(log: BusLog) -> list[str]:
    """Return all that is not plain."""
    clock = log.allotment.clock[0]
    return [*([clock] if clock else []), *log.findings, *log.message_findings]


def _named(fates: Counter[Fate]) -> dict[str, int]:
    return {FATES[fate].replace(" ", "_"): count for fate, count in sorted(fates.items())}


def channel_rows(log: BusLog) -> list[tuple[str, str, Counter[Fate]]]:
    """Return channel, direction and number of frames with each fate."""
    found: dict[tuple[int, int], Counter[Fate]] = {}
    columns = (log.frames.channel, log.frames.is_sent, log.allotment.fate)
    for (channel, is_sent, fate), count in Counter(zip(*(column.tolist() for column in columns), strict=True)).items():
        found.setdefault((channel, is_sent), Counter())[Fate(fate)] = count
    return [(log.frames.channels[channel], DIRECTIONS[is_sent], fates) for (channel, is_sent), fates in sorted(found.items())]


def _identifier_rows(log: BusLog) -> Iterator[dict[str, Any]]:
    """Yield an entry for each identifier, channel and direction."""
    frames = log.frames
    data = frames.kind != Kind.ERROR
    columns = (frames.identifier, frames.is_extended, frames.channel, frames.is_sent, log.allotment.fate)
    rows: dict[tuple[int, bool, int, bool], Counter[Fate]] = {}
    for (*place, fate), count in Counter(zip(*(column[data].tolist() for column in columns), strict=True)).items():
        rows.setdefault(tuple(place), Counter())[Fate(fate)] = count
    for (identifier, is_extended, channel, is_sent), fates in sorted(rows.items()):
        key = log._key(identifier, is_extended)
        yield {
            "identifier": f"0x{identifier:X}",
            "is_extended": is_extended,
            "messages": list(log.databases.names_of(key)) if key else [],
            "channel": frames.channels[channel],
            "direction": DIRECTIONS[is_sent],
            "frames": sum(fates.values()),
            **_named(fates),
        }


BUS_CHANNEL_HEADER = ("channel", "direction", "frames", "of which")
IDENTIFIER_HEADER = ("identifier", "message", "channel", "direction", "frames", "of which")


def summary_lines(log: BusLog) -> list[str]:
    """Return the account of the file as lines."""
    file = log.file
    stamps = log.stamps
    lost = file.in_file - file.read
    others = ", ".join(f"{count} {name}" for name, count in sorted(file.others.items()))
    duration = float(np.ptp(log.frames.time)) if len(log.frames) else 0.0
    return [
        f"{log.path.name}: {file.form}, {duration:.3f} s, {file.clock}",
        f"frames: {file.in_file} in the file, {file.read} read, {lost} skipped",
        *([f"other entries: {others}"] if others else []),
        f"stamps: {stamps['back']} go back, {stamps['repeated']} repeat on a channel; "
        f"frames that repeat one: {stamps['duplicates']}",
    ]


def channel_cells(log: BusLog) -> Sequence[tuple[str, ...]]:
    """Return the rows under CHANNEL_HEADER."""
    return [(channel, direction, str(sum(fates.values())), _shown(fates)) for channel, direction, fates in channel_rows(log)]


def identifier_cells(log: BusLog) -> Sequence[tuple[str, ...]]:
    """Return the rows under IDENTIFIER_HEADER."""
    names = {text.replace(" ", "_"): text for text in FATES.values()}
    return [
        (
            row["identifier"] + ("x" if row["is_extended"] else ""),
            " or ".join(row["messages"]),
            row["channel"],
            row["direction"],
            str(row["frames"]),
            ", ".join(f"{row[key]} {text}" for key, text in names.items() if key in row),
        )
        for row in _identifier_rows(log)
    ]


def _shown(fates: Counter[Fate]) -> str:
    return ", ".join(f"{count} {FATES[fate]}" for fate, count in sorted(fates.items()))
