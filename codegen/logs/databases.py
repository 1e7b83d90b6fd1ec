"""Databases of a bus, DBC or ARXML: messages by identifier, and findings about the files.

A statement of a DBC that breaks the rules is left out with its reason, for it may be one that no drive needs.
"""

from __future__ import annotations

import codecs
import contextlib
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from codegen.errors import CodegenError, one_line
from codegen.files import decoded, read_file, refuse_empty, refuse_utf16, require_regular
from codegen.importing import child
from codegen.importing.source import check_head
from codegen.limits import Limits
from codegen.requirements import missing

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

DATABASE_ENDINGS = (".dbc", ".arxml")
DATABASE_BYTES_MAX = 2**28
LEFT_OUT_MAX, ATTEMPTS_MAX = 1000, 60
"""Largest number of lines of a DBC that are left out, and of attempts: cantools reports one line in each."""

BusKey = tuple[int, bool]
"""Identifier of a message, and whether it is an extended one."""
PGN_MASK, SOURCE_MASK = 0x03FF_FF00, 0xFF
"""J1939: parameter group and data page in an identifier, without priority and source address."""
PDU2_FORMAT = 0xF0
"""J1939: from this PDU format on, the byte below it belongs to the parameter group; else it is the destination address."""
ANY_SOURCE = 0xFE
"""J1939: the null address, which databases give to a message of any source."""


@dataclass(frozen=True)
class Defined:
    """A message and the file that defines it."""

    message: Message
    path: Path


class Directory(Protocol):
    """Facts about messages that the account of a log needs."""

    @property
    def files(self) -> Sequence[Loaded]:
        """The databases."""

    @property
    def findings(self) -> Sequence[str]:
        """Findings in the databases."""

    @property
    def conflicts(self) -> Mapping[BusKey, str]:
        """Text about each identifier that several different messages have."""

    def key_of(self, identifier: int, is_extended: bool) -> BusKey | None:
        """Return the key of the messages with an identifier; None if there is none."""

    def names_of(self, key: BusKey) -> Sequence[str]:
        """Return the names of the messages with a key."""


@dataclass(frozen=True)
class Identifiers:
    """A directory of known identifiers, without databases. names: key -> name of the message."""

    names: Mapping[BusKey, str]
    files: Sequence[Loaded] = ()
    findings: Sequence[str] = ()
    conflicts: Mapping[BusKey, str] = field(default_factory=dict)

    def key_of(self, identifier: int, is_extended: bool) -> BusKey | None:
        """Return the key of the message with an identifier; None if there is none."""
        return (identifier, is_extended) if (identifier, is_extended) in self.names else None

    def names_of(self, key: BusKey) -> Sequence[str]:
        """Return the name of the message with a key."""
        return (self.names[key],)


@dataclass(frozen=True)
class LeftOut:
    """A line of a DBC that is left out: its number from 1, its text, and why."""

    number: int
    text: str
    reason: str

    def __str__(self) -> str:
        return f"line {self.number}: {self.text}"


@dataclass(frozen=True)
class Loaded:
    """A file: its content, findings about it, and the lines of statements that were left out."""

    path: Path
    database: Database
    findings: Sequence[str]
    left_out: Sequence[LeftOut]


@dataclass(frozen=True)
class Databases:
    """DBC or ARXML files of one bus. They are read when the log of a bus needs them."""

    paths: Sequence[Path]

    @cached_property
    def files(self) -> Sequence[Loaded]:
        """The files. Raises CodegenError: one cannot be read."""
        return [load_database(path) for path in self.paths]

    @cached_property
    def messages(self) -> Mapping[BusKey, Sequence[Defined]]:
        """Messages by identifier: one, or several different ones in a conflict. Raises CodegenError: a file cannot be read."""
        found: defaultdict[BusKey, list[Defined]] = defaultdict(list)
        for each in self.files:
            for message in each.database.messages:
                into = found[message.frame_id, message.is_extended_frame]
                if not message.is_container and not any(_are_equal(message, other.message) for other in into):
                    into.append(Defined(message, each.path))
        return {key: defined for key, defined in found.items() if defined}

    @property
    def findings(self) -> list[str]:
        """Findings in the files: statements that are left out, warnings of the library."""
        return [f"{each.path.name}: {text}" for each in self.files for text in each.findings]

    @cached_property
    def conflicts(self) -> Mapping[BusKey, str]:
        """Text about each identifier that several different messages have."""
        return {
            key: f"the identifier 0x{key[0]:X} is in "
            + " and ".join(f"{each.message.name} ({each.path.name})" for each in defined)
            for key, defined in self.messages.items()
            if len(defined) > 1
        }

    @cached_property
    def _any_source(self) -> Mapping[int, BusKey]:
        """Parameter group -> key, for messages of J1939 that any address may send."""
        return {_group(key[0]): key for key in self.messages if key[1] and key[0] & SOURCE_MASK == ANY_SOURCE}

    def key_of(self, identifier: int, is_extended: bool) -> BusKey | None:
        """Return the key of the messages with an identifier; of J1939, also with another source address than the null one."""
        key = identifier, is_extended
        if key in self.messages:
            return key
        return self._any_source.get(_group(identifier)) if is_extended else None

    def names_of(self, key: BusKey) -> Sequence[str]:
        """Return the names of the messages with a key."""
        return [each.message.name for each in self.messages[key]]


def _group(identifier: int) -> int:
    is_addressed = (identifier >> 16) & 0xFF < PDU2_FORMAT
    return identifier & PGN_MASK & ~(0xFF00 if is_addressed else 0)


def _are_equal(one: Message, other: Message) -> bool:
    """Return whether two messages have the same name and the same signals."""

    def facts(message: Message) -> object:
        return message.name, sorted(
            (
                signal.name,
                signal.start,
                signal.length,
                signal.byte_order,
                signal.is_signed,
                signal.is_float,
                signal.scale,
                signal.offset,
                str(signal.unit),
                str(signal.multiplexer_ids),
                str(signal.choices),
            )
            for signal in message.signals
        )

    return facts(one) == facts(other)


def load_database(path: Path) -> Loaded:
    """Read a DBC or ARXML with cantools. Raises CodegenError."""
    size = require_regular(path, DATABASE_BYTES_MAX, "give a DBC or ARXML")
    kind = path.suffix.lower()
    if kind not in DATABASE_ENDINGS:
        raise CodegenError("not a database of a bus", where=path, remedy="give a .dbc or .arxml")
    refuse_empty(size, path)
    try:
        from cantools import database
    except ImportError:
        raise missing("cantools", "reads databases of buses", path) from None
    findings: list[str] = []
    left_out: list[LeftOut] = []
    try:
        with Limits.of(size).enforced(path), child.collected() as warnings:
            # Not strict: databases in use have signals that overlap, or that are longer than their message.
            if kind == ".dbc":
                found, left_out = _load_dbc(path, findings)
            else:
                text = _text(read_file(path, DATABASE_BYTES_MAX, "give an ARXML"), path)
                check_head(text, path)
                found = database.load_string(text, "arxml", strict=False)  # type: ignore[assignment]
                for message in found.messages:
                    findings.extend(_without_wrong_scales(message))
    except CodegenError:
        raise
    except Exception as error:  # readers may raise anything
        what = f"not a readable database of a CAN bus ({_reason(error)})"
        raise CodegenError(what, where=path, remedy="export or copy it again") from None
    if not found.messages:
        raise CodegenError("it has no message", where=path, remedy="give the database of the bus")
    for reason, count in Counter(line.reason for line in left_out).items():
        first = next(line for line in left_out if line.reason == reason)
        findings.append(f"{count} {'line is' if count == 1 else 'lines are'} left out: {reason} (first: {first})")
    for message in found.messages:
        _lengthen(message)
    findings += _overlapping(found.messages)
    texts = dict.fromkeys(map(_in_our_words, warnings))
    return Loaded(path, found, (*findings, *texts), left_out)


SAME_NAME = re.compile(r"Overwriting message '(.*)' with '(.*)' in the name to message dictionary")
SAME_IDENTIFIER = re.compile(r"Overwriting message '(.*)' with '(.*)' in the frame id .* identical masked frame ids (\w+)")


def _in_our_words(warning: str) -> str:
    """Return the finding of a warning of cantools, which speaks of its dictionaries."""
    if match := SAME_NAME.match(warning):
        return f"the message name {match[1]} is there twice; its messages differ by their identifiers"
    if match := SAME_IDENTIFIER.match(warning):
        return f"the messages {match[1]} and {match[2]} have the same identifier {match[3]}"
    return warning


def _overlapping(messages: Sequence[Message]) -> Iterator[str]:
    """Yield a finding if signals of a message that can be in one frame have common bits: one of them may be wrong."""
    found = []
    for message in messages:
        if message.is_container:
            continue
        signals = [(signal, _bits(signal)) for signal in message.signals]
        for number, (one, bits) in enumerate(signals):
            other = next((other for other, others in signals[:number] if bits & others and not _are_apart(one, other)), None)
            if other is not None:
                found.append(f"{message.name}: {' and '.join(sorted((one.name, other.name)))}")
                break
    if found:
        count = "1 message" if len(found) == 1 else f"{len(found)} messages"
        yield f"signals of {count} overlap; check their start bits (first: {found[0]})"


def _are_apart(one: Signal, other: Signal) -> bool:
    """Return whether two signals are in different frames: they have one multiplexer, and no common value of it."""
    ids, others = one.multiplexer_ids, other.multiplexer_ids
    if not ids or not others:
        return False
    return one.multiplexer_signal != other.multiplexer_signal or not set(ids) & set(others)


def _bits(signal: Signal) -> int:
    """Return the bits of a frame that a signal has, as a mask."""
    if signal.byte_order == "little_endian":
        return ((1 << signal.length) - 1) << signal.start
    start = 8 * (signal.start // 8) + 7 - signal.start % 8  # from the highest bit of the first byte
    places = range(start, start + signal.length)
    return sum(1 << (8 * (place // 8) + 7 - place % 8) for place in places)


def _without_wrong_scales(message: Message) -> Iterator[str]:
    """Remove the signals of a message of an ARXML whose values would be 0, infinite or NaN, and yield a finding on each."""
    for part in message.contained_messages or ():
        yield from _without_wrong_scales(part)
    for signal in list(message.signals):
        for name, number in (("factor", float(signal.scale)), ("offset", float(signal.offset))):
            if not math.isfinite(number) or (name == "factor" and number == 0.0):
                yield f"{message.name}.{signal.name} is left out: its {name} is {number:g}; write finite V of its COMPU-METHOD"
                message.signals.remove(signal)
                break
    message.refresh(strict=False)


def _lengthen(message: Message) -> None:
    """Make a message as long as its signals. Else cantools decodes none of them, also in longer frames."""
    if message.is_container:
        return
    ends = [
        (signal.start if signal.byte_order == "little_endian" else 8 * (signal.start // 8) + 7 - signal.start % 8)
        + signal.length
        for signal in message.signals
    ]
    needed = -(-max(ends, default=0) // 8)
    if needed > message.length:
        message.length = needed
        message.refresh(strict=False)


def _reason(error: Exception) -> str:
    return one_line(error).removeprefix("DBC: ").strip('"') or type(error).__name__


# --- DBC -----------------------------------------------------------------------------------------------------------------

SYNTAX = re.compile(r"Invalid syntax at line (\d+), column (\d+)")
END = 'CM_ "";'
"""A statement behind the last one. Without it cantools discards a last statement that is cut short."""
UNFINISHED = re.compile(r"\s*(?:CM_|VAL_|BA_)(?!.*;\s*\Z)")
"""A statement without its semicolon: the next line is reported then."""
TOO_LONG = re.compile(r"frame id 0x\w+ is more than (?:11|29) bits")
UNUSED = re.compile(r"(VAL_|SIG_VALTYPE_) (\d+) (\w+)")
MESSAGE = re.compile(r"\s*BO_ (\d+) ")
NO_MESSAGE = re.compile(r"\s*BO_ \d+ VECTOR__INDEPENDENT_SIG_MSG\s*:")
"""Message that holds the signals of none. cantools discards them without a warning."""
REFERENCE = re.compile(r"((?:BO_|SG_|VAL_|SIG_GROUP_|SIG_VALTYPE_|BO_TX_BU_|SG_MUL_VAL_)\s+)(\d+)(?=\s)")
SIGNAL = re.compile(
    r"\s*SG_ (?P<name>\w+)\s*(?P<multiplexed>m\d+M?|M)?\s*:\s*\d+\|(?P<length>\d+)@(?P<order>-?\w*)[^\s(]*\s*"
    r"\(\s*(?P<factor>[^,\s]+)\s*,\s*(?P<offset>[^,)\s]*)\s*\)",
    re.ASCII,
)
FLOAT = re.compile(r"\s*SIG_VALTYPE_ (\d+) (\w+)\s*:?\s*([12])\s*;", re.ASCII)
BYTE_ORDERS = ("0", "1")
FLOAT_BITS = {"1": 32, "2": 64}
"""Type of a float in a DBC -> its length. cantools decodes other lengths as floats of 16 bits."""
STATEMENT = re.compile(r"\s*(?:(?:BA_\w*|VAL_|VAL_TABLE_|SIG_\w+|SG_MUL_VAL_|EV_|ENVVAR_DATA_|BO_TX_BU_)\s.*;\s*\Z|SG_ )")
"""A statement of one line without which a DBC can be read."""
STANDARD_MAX, EXTENDED_MAX, EXTENDED = 0x7FF, 0x1FFF_FFFF, 0x8000_0000
"""Largest identifiers of 11 and 29 bits; mark of the latter in a DBC."""


def _load_dbc(path: Path, findings: list[str]) -> tuple[Database, list[LeftOut]]:
    """Read a DBC without the statements that cantools refuses, and return those. Raises what cantools raises."""
    from cantools import database

    lines = _text(read_file(path, DATABASE_BYTES_MAX, "give a DBC"), path).splitlines()
    first: Exception | None = None
    left_out: dict[int, LeftOut] = {}

    def leave_out(number: int, reason: str) -> None:
        left_out[number] = LeftOut(number, one_line(lines[number - 1].strip(), 60), reason)

        lines[number - 1] = ""

    def load(tried: Sequence[str]) -> Database:
        return database.load_string("\n".join([*tried, END, ""]), "dbc", strict=False)  # type: ignore[return-value]

    for number, reason in list(_unusable(lines)):
        leave_out(number, reason)
    for attempt in range(ATTEMPTS_MAX):
        try:
            found = load(lines)
        except Exception as error:
            first = first or error
            if _mark_extended(str(error), lines, findings):
                continue
            bad = {number: reason for number, reason in _refused(str(error), lines) if number not in left_out}
            bad = bad or dict(_first_rejected(lines, load))
            if not bad or len(left_out) + len(bad) > LEFT_OUT_MAX or attempt == ATTEMPTS_MAX - 1:
                raise first from None
            for number, reason in bad.items():
                leave_out(number, reason)
        else:
            if first is not None and not found.messages:
                raise first
            for number in list(_of_no_message(lines)):
                leave_out(number, "a signal of no message")
            return found, [left_out[number] for number in sorted(left_out)]
    raise AssertionError("the last attempt raises")


def _text(data: bytes, path: Path) -> str:
    """Return the text of a database: UTF-16 with its mark, else see `decoded`. Raises CodegenError: UTF-16 without its mark."""
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return data.decode("utf-16", "replace")
    refuse_utf16(data, path)
    return decoded(data)


def _unusable(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield the number and the reason of each signal whose values would be wrong without an error of cantools."""
    lengths: defaultdict[tuple[str, str], list[tuple[int, int]]] = defaultdict(list)
    names: defaultdict[tuple[int, str, str], list[int]] = defaultdict(list)
    identifier, of_message = "", 0
    for number, line in enumerate(lines, start=1):
        if head := MESSAGE.match(line):
            identifier, of_message = head[1], number
        elif match := SIGNAL.match(line):
            lengths[identifier, match["name"]].append((number, int(match["length"])))
            names[of_message, match["name"], match["multiplexed"] or ""].append(number)
            if reason := _wrong_scale(match):
                yield number, reason
        elif match := FLOAT.match(line):
            for of_signal, length in lengths[match[1], match[2]]:
                if length != FLOAT_BITS[match[3]]:
                    yield of_signal, f"it is a float of {length} bits"
    for numbers in names.values():
        if len(numbers) > 1:
            yield from ((number, "another signal of its message has its name") for number in numbers)


def _wrong_scale(signal: re.Match[str]) -> str:
    """Return what is wrong with the byte order, factor or offset of a signal, and the remedy; "" for nothing."""
    if signal["order"] not in BYTE_ORDERS:
        return f"its byte order is {signal['order'] or 'missing'}; write 0 (Motorola) or 1 (Intel) behind the @"
    for name in ("factor", "offset"):
        with contextlib.suppress(ValueError):
            if not math.isfinite(float(signal[name])):
                return f"its {name} is {signal[name]}; give a finite number"
    with contextlib.suppress(ValueError):
        if float(signal["factor"]) == 0.0:
            return "its factor is 0"
    return ""


def _first_rejected(lines: Sequence[str], load: Callable[[Sequence[str]], object]) -> Iterator[tuple[int, str]]:
    """Yield the number and the reason of the first statement of one line with which `load` fails; none if it fails without."""
    numbers = [number for number, line in enumerate(lines, start=1) if STATEMENT.match(line)]

    def error_of(count: int) -> Exception | None:
        """Return the error of the lines with only the first statements."""
        left_out = set(numbers[count:])
        try:
            load(["" if number in left_out else line for number, line in enumerate(lines, start=1)])
        except Exception as error:
            return error
        return None

    if error_of(0) is not None:
        return
    good, bad = 0, len(numbers)
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (good, middle) if error_of(middle) else (middle, bad)
    error = error_of(bad)
    if error is not None:
        is_attribute = lines[numbers[bad - 1] - 1].lstrip().startswith("BA_")
        reason = "its attribute or its value is not defined" if is_attribute else f"cantools rejects it ({_reason(error)})"
        yield numbers[bad - 1], reason


def _of_no_message(lines: Sequence[str]) -> Iterator[int]:
    """Yield the numbers of the lines with signals of no message."""
    for number, line in enumerate(lines, start=1):
        if NO_MESSAGE.match(line):
            _, *signals = _statement(number, lines)
            yield from signals


def _mark_extended(error: str, lines: list[str], findings: list[str]) -> bool:
    """Mark identifiers of 29 bits as extended, as no other kind can have them. Return whether there were any."""
    if not TOO_LONG.search(error):
        return False
    heads = filter(None, map(MESSAGE.match, lines))
    unmarked = {head[1] for head in heads if STANDARD_MAX < int(head[1]) <= EXTENDED_MAX}
    if not unmarked:
        return False

    def marked(match: re.Match[str]) -> str:
        return match[1] + (str(int(match[2]) | EXTENDED) if match[2] in unmarked else match[2])

    lines[:] = [REFERENCE.sub(marked, line) for line in lines]
    findings.append(f"{len(unmarked)} identifiers of 29 bits are not marked as extended ones; they are read as such")
    return True


def _refused(error: str, lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield the number from 1 and the reason of each line of the statements that an error of cantools is about."""
    if match := SYNTAX.search(error):
        number, column = int(match[1]), int(match[2])
        before = next((above for above in range(number - 1, 0, -1) if lines[above - 1].strip()), 0)
        if number > len(lines):
            if before:
                yield before, "the file ends within it"
            return
        is_open = before and UNFINISHED.match(lines[before - 1]) and lines[number - 1][: column - 1].strip() == ""
        reason = "it does not end with a semicolon" if is_open else "it breaks the grammar of a DBC"
        yield from ((line, reason) for line in _statement(before if is_open else number, lines))
    elif TOO_LONG.search(error):
        for number, line in enumerate(lines, start=1):
            if (head := MESSAGE.match(line)) and int(head[1]) & ~EXTENDED > EXTENDED_MAX and not NO_MESSAGE.match(line):
                reason = "the identifier of its message has more than 29 bits"
                yield from ((below, reason) for below in _statement(number, lines))
    for keyword, identifier, name in UNUSED.findall(error):
        values = re.compile(rf"\s*{keyword} {identifier} {name}\b")
        for number, line in enumerate(lines, start=1):
            if values.match(line):
                yield number, "there is no such signal"


def _statement(number: int, lines: Sequence[str]) -> Iterator[int]:
    """Yield a line, and the signals below it if it begins a message."""
    yield number
    if MESSAGE.match(lines[number - 1]):
        for below in range(number + 1, len(lines) + 1):
            if not lines[below - 1].lstrip().startswith("SG_ "):
                return
            yield below
