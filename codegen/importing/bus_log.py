"""Frames of a log of a CAN bus (BLF, ASC, candump or MF4), read with python-can."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from codegen.errors import CodegenError, one_line
from codegen.files import reason_of, require_regular
from codegen.importing import child
from codegen.requirements import pip_install

if TYPE_CHECKING:
    import can
    from can.io.generic import MessageReader

LOGS = (".blf", ".asc", ".log", ".mf4")
"""Extensions of the formats."""

REMEDY = "give a log that `codegen hil --log` or another tool wrote"
BYTES_MAX = 2**30
LINE_BYTES_MAX = 2**20
TIME_MAX_S = 1e11
"""Largest time stamp of a frame; Unix time stays below for 3,000 years."""
TEXT_LOGS = (".asc", ".log")
ASC_FRAME = re.compile(r"\s*(\S+)\s+(?:\d+\s+[0-9a-f]+x?|CANFD\s+\d+)\s+(?:Rx|Tx)\s", re.IGNORECASE)
"""Beginning of a frame in an ASC: time, channel, identifier and direction; of CAN FD, the channel and the direction."""
EMPTY_OBJECT = re.compile(rb"LOBJ.{4}\0{4}", re.DOTALL)
"""Header of an object of a BLF whose size is 0: signature, size and version of the header, size of the object."""


def frames(path: Path) -> Iterator[can.Message]:
    """Yield the frames of a log in the order of the file; times in s, below `TIME_MAX_S` in magnitude.

    Raises:
        CodegenError: not a regular file, over 1 GiB, damaged, cut short, or the package that reads it is missing.
    """
    require_regular(path, BYTES_MAX, "give a shorter log")
    if path.suffix.lower() in TEXT_LOGS:
        _check_text(path)
    is_mf4 = path.suffix.lower() == ".mf4"
    try:
        for frame in child.call(__name__, "_frames_of_mf4", path, **child.LOG) if is_mf4 else _frames(path):
            if not abs(frame.timestamp) <= TIME_MAX_S:  # NaN neither
                raise CodegenError("a frame has an invalid time", where=path, remedy=REMEDY)
            yield frame
    except CodegenError:
        raise
    except ImportError as error:
        what = f"the package that reads it is missing ({one_line(error)})"
        raise CodegenError(what, where=path, remedy=pip_install("asammdf")) from None
    except Exception as error:  # readers may raise anything for a damaged file
        raise CodegenError(f"not a readable log of a CAN bus ({one_line(error)})", where=path, remedy=REMEDY) from None


def _frames_of_mf4(path: Path) -> list[can.Message]:
    """Return the frames, in a child process: asammdf may crash on a damaged file (8.8 does)."""
    return list(_frames(path))


def _frames(path: Path) -> Iterator[can.Message]:
    with _reader(path) as reader:
        whole = getattr(reader, "file_size", 0)  # from the header of a BLF
        yield from reader
    if path.stat().st_size < whole:
        what = f"it ends early: {path.stat().st_size} of {whole} bytes"
        raise CodegenError(what, where=path, remedy="copy it again, or let the tool that writes it close it")


def _reader(path: Path) -> MessageReader:
    import can  # here, as the import takes half a second

    class BlfReader(can.BLFReader):
        """python-can's reader, which reads an object of no size again and again (python-can 4.6.1)."""

        def _parse_data(self, data: bytes) -> Iterator[can.Message]:
            if EMPTY_OBJECT.search(data):
                raise ValueError("an object has the size 0")
            return super()._parse_data(data)

    return BlfReader(path) if path.suffix.lower() == ".blf" else can.LogReader(path)


def _check_text(path: Path) -> None:
    """Check the lines of a text log: their lengths, as the reader holds each in memory, their ends, and the times of an ASC.

    python-can skips a frame with an invalid time. Raises CodegenError.
    """
    is_asc = path.suffix.lower() == ".asc"
    try:
        with path.open("rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(LINE_BYTES_MAX + 1), b""), start=1):
                if len(line) > LINE_BYTES_MAX:
                    raise CodegenError("not a log of a CAN bus: a line is over 1 MiB", where=path, remedy="give another log")
                if not line.endswith(b"\n") and re.search(rb"\d", line):  # "End TriggerBlock" contains no frame
                    remedy = "copy it again, or end that line if it is whole"
                    raise CodegenError("it ends inside a line", where=f"{path}, line {number}", remedy=remedy)
                frame = ASC_FRAME.match(line.decode("utf-8", "replace")) if is_asc else None
                if frame is not None and _is_invalid_time(frame[1]):
                    what = f"a frame has an invalid time, {one_line(frame[1], 40)}"
                    raise CodegenError(what, where=f"{path}, line {number}", remedy=REMEDY)
    except OSError as error:
        raise CodegenError(f"cannot be read ({reason_of(error)})", where=path, remedy="check its permissions") from None


def _is_invalid_time(word: str) -> bool:
    """Return whether the word is a number, but not one that an ASC has as time; other words begin comments."""
    if re.fullmatch(r"-?\d+\.\d+", word):
        return False
    try:
        float(word)
    except ValueError:
        return False
    return True
