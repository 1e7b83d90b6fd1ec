"""Frames of text logs: ASC, Vector's text log, and the output of candump.

The lines go to python-can one by one, through a file of `Lines`, which counts the frames and notes which of them python-can
returns. Stamps are computed here: python-can takes relative ones for absolute ones, and skips negative ones.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from codegen.arrays import FloatArray
from codegen.errors import CodegenError, one_line
from codegen.files import decoded, refuse_utf16
from codegen.logs.frames import REMEDY, Collector

LINE_BYTES_MAX = 2**20
COPY_AGAIN = "copy it again, or end that line if it is whole"
DELTA_FRAMES_MIN = 10
"""Fewest stamps by which alone differences are known. Fewer ones must begin with 0, as those of candump do."""
DELTA_RANGE_MAX = 0.5
"""Range of differences of few frames that do not grow, as a fraction of their mean. Times from 0 on have 0.67 or more."""
DELTA_BACK_MIN = 0.2
"""Least fraction of stamps that do not increase, from which stamps are differences. Frames of several buses that a logger puts
out of order do not come near it unless the stamps grow."""
DELTA_GROWTH_MAX = 0.25
"""Largest growth of differences from the first to the second half, as a fraction of their range. Times grow by half of it."""


class Lines:
    """A text file for python-can that gives it the lines of a log one by one.

    Attributes:
        number: line that was given last, from 1.
        time: stamp of its frame, s.
        channel: channel of its frame as the file has it.
        is_frame: whether it has a frame that python-can has not returned yet.
        is_error: whether its frame is an error frame by its identifier.
    """

    def __init__(self, file: BinaryIO, path: Path, into: Collector) -> None:
        self.path, self.into = path, into
        self.number, self.time, self.channel, self.is_frame, self.is_error = 0, 0.0, "", False, False
        self._file = file
        self._given = self._lines()

    def place(self) -> str:
        """Return the file and the line that was given last."""
        return f"{self.path}, line {self.number}"

    def close(self) -> None:
        """Do nothing: python-can closes its file at the end."""

    def __iter__(self) -> Lines:
        return self

    def __next__(self) -> str:
        self.settle("python-can does not read it")
        return next(self._given)

    def settle(self, reason: str) -> None:
        """Account for the frame of the last line if python-can has not returned it."""
        if self.is_frame:
            self.is_frame = False
            self.into.skip(reason, f"line {self.number}")

    def frame(self, time: float, channel: str) -> None:
        """Record that the line contains a frame."""
        self.into.in_file += 1
        self.time, self.channel, self.is_frame = time, channel, True

    def _lines(self) -> Iterator[str]:
        raise NotImplementedError

    def _texts(self) -> Iterator[str]:
        """Yield the lines of the file; see `decoded`. Raises CodegenError."""
        while line := self._file.readline(LINE_BYTES_MAX + 1):
            self.number += 1
            if len(line) > LINE_BYTES_MAX:
                raise CodegenError("not a log of a CAN bus: a line is over 1 MiB", where=self.path, remedy="give another log")
            if self.number == 1:
                refuse_utf16(line, self.path)
            if b"\0" in line:
                raise CodegenError("it has zero bytes, as a text log has not", where=self.place(), remedy=REMEDY)
            if not line.endswith(b"\n") and re.search(rb"\d", line):  # "End TriggerBlock" contains no frame
                raise CodegenError("it ends inside a line", where=self.place(), remedy=COPY_AGAIN)
            yield decoded(line)


# --- ASC -----------------------------------------------------------------------------------------------------------------

ASC_STAMP = re.compile(r"\s*([-+]?\d[\w.,+-]*|[-+]?(?:nan|inf)\w*)\s+(.*)", re.ASCII | re.IGNORECASE | re.DOTALL)
ASC_TIME = re.compile(r"-?\d+\.\d+", re.ASCII)
DECIMAL_COMMA = re.compile(r"-?\d+,\d+", re.ASCII)
ASC_FRAME = re.compile(
    r"(?:(?P<channel>\d+)\s+(?:(?P<id>\S+)\s+(?P<direction>Rx|TxRq|Tx)\b|ErrorFrame\b)|CANFD\s+(?P<fd>\d+)\s)",
    re.ASCII | re.IGNORECASE,
)
ASC_BODY = re.compile(
    r"(?:\d+\s+(?:ErrorFrame\b|\S+\s+(?:Rx|TxRq|Tx)\s+(?:r\b|d\s+(?P<dlc>[0-9a-f]+)(?=\s|\Z)(?P<data>.*)))"
    r"|CANFD\s+\d+\s+(?:Rx|TxRq|Tx)\s+(?:ErrorFrame\b|[0-9a-f]+x?\s+(?:[^\s.]+\s+)?[01]\s+[01]\s+[0-9a-f]+\s+"
    r"(?P<length>\d+)(?P<fd_data>\s+\S.*)))",
    re.ASCII | re.IGNORECASE | re.DOTALL,
)
"""What a frame has at least."""
ASC_CUT = re.compile(
    r"\s*(?:\d+\s*|\d+\s+[0-9a-f]+x?(?:\s.*)?|CAN(?:FD\b.*|\s*\d*\s*)|.*\d\s+[0-9a-f]+x?\s+(?:Rx|Tx)\s+[dr]\s.*)?",
    re.ASCII | re.IGNORECASE | re.DOTALL,
)
"""An event that begins as a frame does, or has one inside: a line that was cut, and may go on with the next one."""
STAMP_CUT = re.compile(r"\s*-?\d+\.?\s*", re.ASCII)
FRAME_END = re.compile(r"(?:^|\s)(?:Rx|Tx)\s+[dr]\s", re.ASCII)
DAMAGED_LINE = "its line is damaged"
ASC_ID = re.compile(r"[0-9a-f]+x?", re.ASCII | re.IGNORECASE)
ASC_BASE = re.compile(r"\s*base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.IGNORECASE)
ASC_PLAIN = re.compile(r"\s*(?:\Z|date\s|//|(?:no\s+)?internal\s+events\s+logged|(?:begin|end)\s+triggerblock)", re.IGNORECASE)
"""A line without an event that is plain."""
NO_EVENT = "line that is no event"
OTHER_WORDS = re.compile(r"(?:\d+\s+|CAN\s+\d+\s+)?([A-Za-z]\w*)")


class AscLines(Lines):
    """Lines of an ASC. python-can gets the base of its numbers, and its frames."""

    is_relative = False
    first_strange = ""
    header_line = 0
    """Line with the kind of the stamps; 0 for none."""
    _base = ""

    def _lines(self) -> Iterator[str]:
        now, in_header = 0.0, True
        for text in self._texts():
            base = ASC_BASE.match(text)
            if base:
                self._take_base(base, in_header)
                continue
            stamp = None if ASC_PLAIN.match(text) else ASC_STAMP.match(text)
            if stamp is None:
                self._strange(text)
                continue
            word, rest = stamp.groups()
            frame = ASC_FRAME.match(rest)
            if not ASC_TIME.fullmatch(word):
                if frame is None or word.count(".") > 1:
                    self._strange(text)  # a comment that begins with a number
                    continue
                what = f"a frame has an invalid time, {one_line(word, 40)}"
                remedy = "export it with decimal points" if DECIMAL_COMMA.fullmatch(word) else REMEDY
                raise CodegenError(what, where=self.place(), remedy=remedy)
            now = float(word) + (now if self.is_relative else 0.0)  # every event counts, not only frames
            if frame is None and _is_cut(rest):
                self.frame(now, "")
                self.settle(DAMAGED_LINE)
                continue
            if frame is None:
                other = OTHER_WORDS.match(rest)
                self.into.others[other[1] if other else "other event"] += 1
                continue
            if (frame["direction"] or "").lower() == "txrq":
                self.into.others["transmit request"] += 1
                continue
            if in_header:
                in_header = False
                yield f"base {self._base or 'hex'}  timestamps absolute\n"
                yield "\n"  # python-can's header ends with a line that it drops, even one with a frame
            self.frame(now, frame["channel"] or frame["fd"])
            if frame["id"] and not ASC_ID.fullmatch(frame["id"]):
                self.settle("its identifier is a name; log numbers")
                continue
            if not self._is_whole(rest):
                self.settle(DAMAGED_LINE)
                continue
            yield text.replace(word, word.lstrip("-"), 1)

    def _is_whole(self, rest: str) -> bool:
        """Return whether a frame behind its stamp has all that python-can needs. Too few bytes are found later."""
        body = ASC_BODY.match(rest)
        if body is None or not (body["dlc"] or body["length"]):
            return body is not None
        is_hex = self._base != "dec"
        if not is_hex and not (body["length"] or body["dlc"]).isdigit():
            return False
        length = int(body["length"]) if body["length"] else min(int(body["dlc"], 16 if is_hex else 10), 8)
        words = (body["fd_data"] or body["data"]).split()[:length]
        if is_hex and len(words) == length > 1 and len(words[-1]) == 1 and all(len(word) == 2 for word in words[:-1]):
            return False  # the line is cut within its last byte
        byte = HEX_BYTE if is_hex else DECIMAL_BYTE
        return all(byte.fullmatch(word) for word in words)

    def _take_base(self, base: re.Match[str], in_header: bool) -> None:
        """Take over the base of the numbers and the kind of the stamps. Raises CodegenError if the base changes."""
        found = base[1].lower()
        if found != self._base and not in_header:
            what = f"the base of its numbers becomes {found} behind its first frame"
            raise CodegenError(what, where=self.place(), remedy="give the logs that it was made of, one by one")
        self._base = found
        self.header_line = self.number if base[2] else self.header_line
        self.is_relative = self.is_relative or (base[2] or "").lower() == "relative"

    def _strange(self, text: str) -> None:
        if (FRAME_END.search(text) or STAMP_CUT.fullmatch(text)) and not ASC_PLAIN.match(text):
            self.frame(0.0, "")
            self.settle(DAMAGED_LINE)
            return
        if not ASC_PLAIN.match(text):
            self.first_strange = self.first_strange or f"line {self.number}: {one_line(text, 60)}"
            self.into.others[NO_EVENT] += 1


def _is_cut(rest: str) -> bool:
    """Return whether an event that is no frame is the rest of one."""
    word = rest.split(maxsplit=1)[1].strip() if re.match(r"\d+\s+\S", rest) else rest.strip()
    is_begin = any(name.startswith(word) for name in (ERROR_WORD, "CANFD"))
    return is_begin or (ASC_CUT.fullmatch(rest) is not None and not rest.startswith("J1939"))


ERROR_WORD = "ErrorFrame"
HEX_BYTE, DECIMAL_BYTE = re.compile(r"[0-9A-Fa-f]{1,2}", re.ASCII), re.compile(r"\d{1,3}", re.ASCII)


def read_asc(path: Path) -> tuple[Collector, str]:
    """Read an ASC. Returns the frames and the meaning of the stamps. Raises CodegenError."""
    from can import ASCReader

    into = Collector("ASC")
    with path.open("rb") as file:
        lines = AscLines(file, path, into)
        _take(lines, ASCReader(lines))  # type: ignore[arg-type]
    if not into.in_file and set(into.others) == {NO_EVENT}:
        what = f"not an ASC: no line is an event (first: {lines.first_strange})"
        raise CodegenError(what, where=path, remedy="give a log of CANoe, CANalyzer or codegen hil")
    time = np.array(into.times)
    if not lines.is_relative and time.size and np.ptp(time) > 0.0 and are_differences(time):
        what = "its stamps do not grow: they are times from the event before, but its header has no `timestamps relative`"
        remedy = "change `absolute` to `relative` there, or export it with absolute stamps"
        raise CodegenError(what, where=f"{path}, line {max(lines.header_line, 1)}", remedy=remedy)
    return into, "time from the event before" if lines.is_relative else "time from the start of the log"


def _take(lines: Lines, reader: object) -> None:
    """Take over the frames that python-can returns. Raises CodegenError."""
    try:
        for message in reader:  # type: ignore[attr-defined]
            lines.is_frame = False
            message.is_error_frame = message.is_error_frame or lines.is_error
            if not (message.is_remote_frame or message.is_error_frame) and len(message.data) < min(message.dlc, 8):
                lines.into.skip("fewer bytes than its length", f"line {lines.number}")
                continue
            lines.into.add(message, lines.time, lines.channel, lines.place())
    except CodegenError:
        raise
    except Exception as error:  # python-can may raise anything for a damaged line
        what = f"not a readable log of a CAN bus ({one_line(error)})"
        raise CodegenError(what, where=lines.place(), remedy=REMEDY) from None
    lines.settle("python-can does not read it")


# --- candump -------------------------------------------------------------------------------------------------------------

LOG_LINE = re.compile(
    r"\s*\((?P<time>[^)]*)\)\s+(?P<channel>\S+)\s+(?P<id>[0-9A-Fa-f]+)#(?P<data>\S*)(?:\s+[RT])?\s*", re.ASCII
)
ERROR_FLAG = 0x2000_0000
"""Mark of an error frame in its identifier. Without the bit of a bus error, python-can takes it for a data frame."""
XL_DATA = re.compile(r"[0-9A-Fa-f]{2}:[0-9A-Fa-f]{2}:[0-9A-Fa-f]{8}#\S*", re.ASCII)
HEX, ID_DIGITS_MAX = re.compile(r"[0-9A-Fa-f]*", re.ASCII), 8
RAW_LENGTH = re.compile(r"(#[0-9A-Fa-f]{16})_[0-9A-Fa-f]\b", re.ASCII)
"""Length of 9 to 15 that a classic frame of 8 bytes was sent with (`-8`)."""
VIEW_LINE = re.compile(
    r"\s*(?:\((?P<time>[^)]*)\)\s+)?(?P<channel>[A-Za-z]\S*)\s+(?:(?P<direction>RX|TX)(?:\s+\S){0,2}\s+)?(?P<id>[0-9A-Fa-f]{3,8})\s+"
    r"(?:\[(?P<length>\d+)\]|\{(?P<raw_length>[0-9A-Fa-f])\})\s*(?P<data>.*?)\s*",
    re.ASCII | re.DOTALL,
)
BYTES = re.compile(r"((?:[0-9A-Fa-f]{2}(?:\s|$))*)", re.ASCII)
DATE = re.compile(r"(\d{4})-(\d\d)-(\d\d) (\d\d):(\d\d):(\d\d\.\d+)", re.ASCII)
NUMBER = re.compile(r"-?\d+(?:\.\d*)?", re.ASCII)


COLOURS = re.compile(r"\x1b\[[\d;]*m")
DROPPED = re.compile(r"DROPCOUNT: dropped (\d+) CAN frames?\b", re.ASCII)
NOT_LOGGED = "frame that the logger dropped"
SWAPPED, BINARY = re.compile(r"[0-9A-Fa-f]{2}`"), re.compile(r"[01]{8}(?:\s|\Z)")


class CandumpLines(Lines):
    """Lines of candump, in the format of its logs (`-L`) or of its view."""

    form = "candump"

    def _lines(self) -> Iterator[str]:
        of_error = False
        for text in self._texts():
            text = COLOURS.sub("", text)
            if dropped := DROPPED.match(text.strip()):
                self.into.others[NOT_LOGGED] += int(dropped[1])
                continue
            if not text.strip() or (of_error and text.startswith("\t")):
                continue  # below an error frame are its causes
            of_error = text.rstrip().endswith("ERRORFRAME")
            log = LOG_LINE.fullmatch(text)
            view = None if log else VIEW_LINE.fullmatch(text)
            line = log or view
            if line is None:
                what = f"not a readable log of a CAN bus: no frame of candump, {one_line(text, 60)!r}"
                raise CodegenError(what, where=self.place(), remedy=REMEDY)
            if line["time"] is None:
                raise CodegenError("its frames have no times", where=self.place(), remedy="log with candump -l, or -t a")
            self.frame(_seconds(line["time"], self.place()), line["channel"])
            self.is_error = bool(int(line["id"], 16) & ERROR_FLAG)
            if log and (reason := _damage(log)):
                self.settle(reason)
                continue
            yield RAW_LENGTH.sub(r"\1", text) if view is None else self._as_log(view)

    def _as_log(self, view: re.Match[str]) -> str:
        """Return a line of the view as one of a log. In the view, a length of two digits belongs to CAN FD."""
        self.form = "candump, view"
        data = view["data"]
        length = min(int(view["raw_length"], 16), 8) if view["raw_length"] else int(view["length"])
        for pattern, what, option in ((SWAPPED, "swapped", "-S"), (BINARY, "binary digits", "-i")):
            if pattern.match(data):
                raise CodegenError(f"its bytes are {what}", where=self.place(), remedy=f"log without {option} of candump")
        if data.startswith("remote request"):
            content = f"#R{length}"
        else:
            found = BYTES.match(data)
            words = found[1].split()[:length] if found else []
            content = ("##0" if len(view["length"] or "") == 2 else "#") + "".join(words)
            if len(words) < length:
                raise CodegenError("a frame has fewer bytes than its length", where=self.place(), remedy=REMEDY)
        return f"(0.0) {self.channel} {view['id']}{content} {(view['direction'] or 'R')[0]}\n"


def _damage(log: re.Match[str]) -> str:
    """Return why a line of a log is skipped, or "": python-can reads half a byte, and too long identifiers and data."""
    data = log["data"]
    if XL_DATA.fullmatch(data):
        return "a frame of CAN XL"
    if len(log["id"]) > ID_DIGITS_MAX:
        return f"an identifier of over {ID_DIGITS_MAX} digits"
    if not HEX.fullmatch(data):
        return ""
    if len(data) % 2:
        return "its data end within a byte"
    return "over 8 bytes in a classic frame" if len(data) > 16 else ""


def _seconds(text: str, place: str) -> float:
    """Return a stamp of candump: seconds, or with -t A a date. Raises CodegenError."""
    date = DATE.fullmatch(text.strip())
    if date:
        from datetime import UTC, datetime

        *whole, seconds = date.groups()
        return datetime(*map(int, whole), tzinfo=UTC).timestamp() + float(seconds)  # type: ignore[misc,arg-type]
    if not NUMBER.fullmatch(text.strip()):
        raise CodegenError(f"a frame has an invalid time, {one_line(text, 40)}", where=place, remedy=REMEDY)
    return float(text)


def read_candump(path: Path) -> tuple[Collector, str]:
    """Read the output of candump. Returns the frames and the meaning of the stamps. Raises CodegenError."""
    from can import CanutilsLogReader

    into = Collector("candump")
    with path.open("rb") as file:
        lines = CandumpLines(file, path, into)
        _take(lines, CanutilsLogReader(lines))  # type: ignore[arg-type]
    into.form = lines.form
    time = np.array(into.times)
    if are_differences(time):
        into.times = array("d", np.cumsum(time))
        return into, "time from the frame before"
    return into, "Unix time" if time.size and time[0] > 1e8 else "time from the start of the log"


def are_differences(time: FloatArray) -> bool:
    """Return whether stamps (n,) are times from one frame to the next: many do not increase, and they neither grow nor fall."""
    is_short = time.size < DELTA_FRAMES_MIN
    if is_short and (time.size < 3 or time[0] != 0.0):
        return False
    if is_short:
        time = time[1:]
    if time.min() < 0.0:
        return False
    back = np.count_nonzero(np.diff(time) <= 0.0) / (time.size - 1)
    half = time.size // 2
    growth = float(np.mean(time[half:]) - np.mean(time[:half]))
    stays = abs(growth) <= DELTA_GROWTH_MAX * float(np.ptp(time))
    stays = stays or (is_short and float(np.ptp(time)) <= DELTA_RANGE_MAX * float(np.mean(time)))
    return bool(back >= DELTA_BACK_MIN and stays)
