"""Counts of the entries of databases and logs that use none of the project's readers.

A database is searched for its statements as plain text. A text log is counted by its lines, a BLF by the signatures of its
objects, an MF4 by the samples of its groups as asammdf has them, and the frames of every log by python-can's own readers.
"""

from __future__ import annotations

import logging
import re
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

Frame = tuple[int, bool, bool, bool, bytes]
"""Identifier, whether it is extended, whether it is a remote frame, an error frame, and its data. An error frame has no
identifier and no data: formats differ in what they store for it."""
Signal = tuple[str, str, int, int, bool, bool, float, float]
"""Names of message and signal, first bit, length, whether little-endian, whether signed, factor and offset."""

MESSAGE = re.compile(r"[ \t]*BO_[ \t]+(\d+)[ \t]+(\w+)")
SIGNAL = re.compile(
    r"[ \t]*SG_[ \t]+(\w+)[^:\n]*:[ \t]*(\d+)\|(\d+)@([01])([+-])[ \t]*\([ \t]*([-+.\dEe]+)[ \t]*,[ \t]*([-+.\dEe]+)[ \t]*\)"
)
ANY_SIGNAL = re.compile(r"[ \t]*SG_[ \t]")
LONG_MESSAGE = re.compile(r'^BA_[ \t]+"SystemMessageLongSymbol"[ \t]+BO_[ \t]+(\d+)[ \t]+"(\w+)"', re.MULTILINE)
LONG_SIGNAL = re.compile(r'^BA_[ \t]+"SystemSignalLongSymbol"[ \t]+SG_[ \t]+(\d+)[ \t]+(\w+)[ \t]+"(\w+)"', re.MULTILINE)
"""Whole names of over 32 characters, which the statements have in a shorter form."""
OF_NO_MESSAGE = "VECTOR__INDEPENDENT_SIG_MSG"
"""Name under which a DBC has signals of no message."""
IDENTIFIER_MASK = 0x1FFF_FFFF
STAMPED = re.compile(rb"[ \t]*-?\d+\.\d+[ \t]")
OBJECT, CONTAINER, HEADER_BYTES, CONTAINER_HEADER_BYTES, DEFLATE = b"LOBJ", 10, 16, 16, 2


def text_of(path: Path) -> str:
    """Return a database as text."""
    data = path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def statements(path: Path) -> tuple[Counter[tuple[int, str]], Counter[Signal], int]:
    """Return identifier and name of each message of a DBC, its signals, and the number of all lines that define a signal."""
    messages: Counter[tuple[int, str]] = Counter()
    signals: Counter[Signal] = Counter()
    lines, number, name, in_text = 0, "", "", False
    text = text_of(path)
    long_messages = dict(LONG_MESSAGE.findall(text))
    long_signals = {(message, short): whole for message, short, whole in LONG_SIGNAL.findall(text)}
    for line in text.splitlines():
        was_in_text, in_text = in_text, in_text ^ (line.replace('\\"', "").count('"') % 2 == 1)
        if was_in_text:
            continue
        if found := MESSAGE.match(line):
            number, name = found[1], long_messages.get(found[1], found[2])
            if name != OF_NO_MESSAGE:
                messages[int(number) & IDENTIFIER_MASK, name] += 1
        lines += ANY_SIGNAL.match(line) is not None
        if found := SIGNAL.match(line):
            signal, start, length, order, sign, factor, offset = found.groups()
            whole = long_signals.get((number, signal), signal)
            signals[name, whole, int(start), int(length), order == "1", sign == "-", float(factor), float(offset)] += 1
    return messages, signals, lines


def entries(path: Path) -> int | None:
    """Return the number of all entries of a log, frames and others; None if its format has no plain count."""
    kind = path.suffix.lower()
    if kind == ".asc":
        return sum(STAMPED.match(line) is not None for line in path.read_bytes().splitlines())
    if kind == ".log":
        return sum(bool(line.strip()) for line in path.read_bytes().splitlines())
    if kind == ".blf":
        return _objects(path.read_bytes())
    return sum(samples(path)) if kind == ".mf4" else None


def _objects(data: bytes) -> int:
    """Return the number of objects of a BLF, of which containers do not count."""
    count, inside, position = 0, b"", data.find(OBJECT)
    while position >= 0:
        size, kind = (int.from_bytes(data[position + start : position + start + 4], "little") for start in (8, 12))
        if kind == CONTAINER:
            packed = data[position + HEADER_BYTES + CONTAINER_HEADER_BYTES : position + size]
            is_packed = int.from_bytes(data[position + HEADER_BYTES : position + HEADER_BYTES + 2], "little") == DEFLATE
            inside += zlib.decompress(packed) if is_packed else packed
        else:
            count += 1
        position = data.find(OBJECT, position + max(size, HEADER_BYTES))
    return count + inside.count(OBJECT)


def samples(path: Path) -> list[int]:
    """Return the number of samples of each group of an MF4, as its times can be read."""
    from asammdf import MDF

    with MDF(path) as mdf:
        return [len(mdf.get_master(number)) for number in range(len(list[Any](mdf.groups)))]


def frames(path: Path) -> Counter[Frame]:
    """Return the frames that python-can reads alone."""
    import can

    logging.getLogger("can").setLevel(logging.ERROR)  # its warnings are among the findings of the account
    with can.LogReader(path) as reader:
        return Counter(
            (0, False, False, True, b"")
            if message.is_error_frame
            else (
                message.arbitration_id,
                message.is_extended_id,
                message.is_remote_frame,
                False,
                b"" if message.is_remote_frame else bytes(message.data),
            )
            for message in reader
        )
