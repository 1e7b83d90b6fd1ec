"""Tables of numbers, left out of what an analyser reads.

A map has tens of thousands of numbers, and an analyser takes minutes for them. Only their form can be wrong: that each is a
plain literal, and that none is missing, is seen here. Where it is so, the analyser gets zeros in their place, which break no
rule, and every other line stays where it was; where it is not, it gets the table as it stands.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

NUMBERS_MAX = 300
"""Of a table that is left in: so many cost nothing."""

_TABLE = re.compile(
    r"^((?:\w+_SECTION_\w+\s)?(?:static )?const (float|double) \w+((?:\[[\w +-]+\])+)) = \{([^;={]*(?:\{[^;=]*)?)\};",
    re.MULTILINE,
)
_SIZE = re.compile(r"\[(\w+)(?: ([+-]) (\d+))?\]")
_ENUMERATOR = re.compile(r"\b([A-Z]\w*_(?:POINTS|CELLS)) = (\d+)\b")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_LITERAL = {"float": r"-?\d+\.\d+(?:e[+-]?\d+)?f", "double": r"-?\d+\.\d+(?:e[+-]?\d+)?"}


def without_tables(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files of a build, content by path, with zeros for the numbers of each large table."""
    texts = {path: content.decode("ascii", "replace") for path, content in files.items()}
    sizes = {name: int(value) for text in texts.values() for name, value in _ENUMERATOR.findall(text)}

    def short(match: re.Match[str]) -> str:
        head, kind, dimensions, body = match.groups()
        shape = [_size(name, sign, number, sizes) for name, sign, number in _SIZE.findall(dimensions)]
        if math.prod(shape) <= NUMBERS_MAX or not _is_plain(body, shape, kind):
            return match[0]
        lines = "\n" * body.count("\n")
        return f"{head} = {{ 0{lines}}};"

    return {path: _TABLE.sub(short, text).encode("ascii", "replace") for path, text in texts.items()}


def _size(name: str, sign: str, number: str, sizes: Mapping[str, int]) -> int:
    size = int(name) if name.isdecimal() else sizes.get(name, 0)
    return size + int(f"{sign}{number}") if sign else size


def _is_plain(body: str, shape: list[int], kind: str) -> bool:
    """Whether the inside of the outermost braces is rows of plain literals, as many as the shape asks for."""
    text = re.sub(r"\s+", "", _COMMENT.sub("", body))
    row = rf"{_LITERAL[kind]}(?:,{_LITERAL[kind]}){{{shape[-1] - 1}}}"
    for size in reversed(shape[:-1]):
        text, found = re.subn(rf"\{{{row}\}}", "#", text)
        row = rf"#(?:,#){{{size - 1}}}"
        if found == 0:
            return False
    return re.fullmatch(row, text) is not None
