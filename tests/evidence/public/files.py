"""Part `public`: every message of public databases and every entry of public logs is read, or refused with a reason.

The files lie in a folder that the user gives, in any tree. The project's own readers read them. Their account is compared with
counts of `tests.evidence.public.counts`, which use none of those readers. A refusal is one line that names the file, with a
reason that every machine finds. Anything else, and any entry without a use or a reason, is a fault.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from codegen.errors import CodegenError
from codegen.logs.account import BusLog, open_log, to_dict
from codegen.logs.databases import Databases, load_database
from codegen.logs.frames import Frames, Kind
from codegen.logs.measurement import Account
from codegen.text import text_table
from codegen.verify.outcomes import Effort, Outcome, Verdict
from tests.evidence.progress import Progress
from tests.evidence.public import counts

SHOWS = "every message of public databases and every entry of public logs is read, or refused with its reason"
LOGS = (".asc", ".blf", ".log", ".mf4", ".trc", ".mdf")
KINDS = (".dbc", *LOGS)
HEADER = ("file", "entries", "read", "refused", "other", "why refused")
WHY_SHOWN = 120
"""Characters of the reasons of a file that the table shows."""
LIBRARIES = ("asammdf", "cantools", "python-can")
TIME_IS_OVER = re.compile(r"reading it (takes more than [\d.e+]+ s\b|does not end within)")
"""Refusals that depend on the speed of the machine: see `codegen.limits` and `codegen.importing.child`."""
NOT_READ_BY_PYTHON_CAN = (".mf4", ".mdf")
"""Its reader of MF4 needs a log of a bus, and has none for older versions."""


@dataclass(frozen=True)
class Row:
    """Account of one file.

    Attributes:
        entries: messages of a database; frames and other entries of the log of a bus; rows of a measurement.
        read, refused: number of messages, frames or rows. other: entries that are no frames.
        why: reasons for those that are refused.
        faults: what does not agree with the independent count.
    """

    entries: int
    read: int
    refused: int
    other: int
    why: str
    faults: tuple[str, ...] = ()


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Account for all files of KINDS in the folders. The quick form is the same."""
    del effort, progress
    paths = {
        path.relative_to(folder).as_posix(): path
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.suffix.lower() in KINDS and path.is_file()
    }
    if not paths:
        raise CodegenError("no file of the kinds " + ", ".join(KINDS), where=folders[0], remedy="see docs/evidence.md")
    found = {name: account_of(path) for name, path in paths.items()}
    cells = [
        (name, *map(str, (row.entries, row.read, row.refused, row.other)), row.why[:WHY_SHOWN]) for name, row in found.items()
    ]
    print(text_table(HEADER, cells, left=1), flush=True)
    faults = tuple(f"{name}: {fault}" for name, row in found.items() for fault in row.faults)
    figures = {kind: _total([row for name, row in found.items() if name.lower().endswith(kind)]) for kind in KINDS}
    figures = {kind: total for kind, total in figures.items() if total["files"]}
    messages, entries = (_sum(figures, kinds) for kinds in (KINDS[:1], LOGS))
    figure = f"{len(found)} files: {messages} messages and {entries} entries of logs, {len(faults)} faults"
    verdict, versions = Verdict.FAILED if faults else Verdict.PASSED, {name: metadata.version(name) for name in LIBRARIES}
    return Outcome(SHOWS, figure, verdict, faults, {**figures, "files, SHA-256": _digest(paths)}, tools=versions)


def _digest(paths: Mapping[str, Path]) -> str:
    """Return the SHA-256 over names and contents of files."""
    whole = hashlib.sha256()
    for name, path in paths.items():
        whole.update(f"{name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return whole.hexdigest()


def _total(rows: Sequence[Row]) -> dict[str, int]:
    numbers = Counter({"files": len(rows), "faults": sum(len(row.faults) for row in rows)})
    for row in rows:
        numbers.update({key: value for key, value in asdict(row).items() if isinstance(value, int)})
    return {key: numbers[key] for key in ("files", "entries", "read", "refused", "other", "faults")}


def _sum(figures: dict[str, dict[str, int]], kinds: Sequence[str]) -> str:
    return f"{sum(figures[kind]['entries'] for kind in kinds if kind in figures):,}"


def account_of(path: Path) -> Row:
    """Return the account of a file. A traceback is a fault."""
    try:
        return _database(path) if path.suffix.lower() == ".dbc" else _log(path)
    except Exception as error:
        return Row(0, 0, 0, 0, "", (f"{type(error).__name__}: {error}",))


def _refusal(error: CodegenError, path: Path) -> tuple[str, tuple[str, ...]]:
    """Return the reason for the refusal of a whole file, and what is wrong with its line."""
    text = str(error)
    is_plain = text.isprintable() and path.name in text and error.exit_code == 2
    faults = () if is_plain else (f"not one line that names the file: {text!r}",)
    if TIME_IS_OVER.search(text):  # nothing is known about the file
        faults = (*faults, f"its time is over, the machine may be too slow or too busy: {text}")
    return text.replace(f"{path}: ", ""), faults


# --- databases -----------------------------------------------------------------------------------------------------------


def _database(path: Path) -> Row:
    messages, signals, signal_lines = counts.statements(path)
    count = messages.total()
    try:
        loaded = load_database(path)
    except CodegenError as error:
        return Row(count, 0, count, 0, *_refusal(error, path))
    read = Counter((message.frame_id, message.name) for message in loaded.database.messages)
    refused = Counter(line.text.partition(" ")[0] for line in loaded.left_out)
    lost = messages - read
    faults = []
    if lost.total() != refused["BO_"] or read - messages:
        faults.append(f"{lost.total()} messages are not read, {refused['BO_']} are refused: {_shown(lost or read - messages)}")
    kept = Counter(_signal(message.name, one) for message in loaded.database.messages for one in message.signals)
    if signal_lines != kept.total() + refused["SG_"] or kept - signals:
        faults.append(
            f"{signal_lines} signals, {kept.total()} read, {refused['SG_']} refused: {_shown(kept - signals or signals - kept)}"
        )
    return Row(count, read.total(), refused["BO_"], 0, "; ".join(loaded.findings), tuple(faults))


def _signal(message: str, signal: Any) -> counts.Signal:
    is_little, factor, offset = signal.byte_order == "little_endian", float(signal.scale), float(signal.offset)
    return message, signal.name, signal.start, signal.length, is_little, signal.is_signed, factor, offset


def _shown(entries: Counter[object] | Counter[tuple[int, str]] | Counter[counts.Signal]) -> str:
    return ", ".join(str(entry) for entry in list(entries)[:3])


# --- logs ----------------------------------------------------------------------------------------------------------------


def _log(path: Path) -> Row:
    known = Counter() if path.suffix.lower() in NOT_READ_BY_PYTHON_CAN else counts.frames(path)
    entries = counts.entries(path)
    try:
        log = open_log(path, Databases(()))
    except CodegenError as error:
        count = known.total() if entries is None else entries
        return Row(count, 0, count, 0, *_refusal(error, path))
    return _measurement(log, counts.samples(path)) if isinstance(log, Account) else _bus(log, entries, known)


def _measurement(account: Account, samples: Sequence[int]) -> Row:
    rows = [group.rows for group in account.groups]
    read = sum(group.read for group in account.groups)
    faults = [] if rows == list(samples) else [f"{samples} samples in its groups, {rows} rows in the account"]
    return Row(sum(samples), read, sum(rows) - read, 0, "; ".join(account.findings), tuple(faults))


def _bus(log: BusLog, entries: int | None, known: Counter[counts.Frame]) -> Row:
    account = to_dict(log)
    frames, other = account["frames"], sum(log.file.others.values())
    refused = sum(each["frames"] for each in frames["skipped"])
    faults = []
    if entries is not None and entries != frames["in_file"] + other:
        faults.append(f"{entries} entries by a plain count, {frames['in_file']} frames and {other} others in the account")
    for what, rows in (("channels", account["channels"]), ("identifiers", account["identifiers"])):
        errors = log.frames.kind.tolist().count(Kind.ERROR) if what == "identifiers" else 0
        if sum(row["frames"] for row in rows) + errors != frames["read"] or frames["read"] + refused != frames["in_file"]:
            faults.append(f"the sum over its {what} does not close: {frames}")
    lost = known - _frames(log.frames)
    if lost.total() > refused:
        faults.append(f"{lost.total()} frames that python-can reads are not in the account: {_shown(lost)}")
    why = "; ".join(f"{each['frames']}: {each['reason']}" for each in frames["skipped"])
    return Row(frames["in_file"] + other, frames["read"], refused, other, why, tuple(faults))


def _frames(frames: Frames) -> Counter[counts.Frame]:
    kind = frames.kind.tolist()
    rows = zip(frames.identifier.tolist(), frames.is_extended.tolist(), kind, frames.data, strict=True)
    return Counter(
        (0, False, False, True, b"")
        if one == Kind.ERROR
        else (identifier, is_extended, one == Kind.REMOTE, False, b"" if one == Kind.REMOTE else data)
        for identifier, is_extended, one, data in rows
    )
