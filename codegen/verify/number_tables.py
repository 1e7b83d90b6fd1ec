"""Tables of numbers, omitted from what an analyser reads.

A map has tens of thousands of numbers, and an analyser takes minutes for them. Only their form can be wrong: this module
checks that each is a plain literal and that none is missing. If so, the analyser reads zeros instead, which break no rule, and
all other lines keep their numbers. If not, it reads the table unchanged.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

NUMBERS_MAX = 300
"""Largest table that the analyser reads; smaller ones take no noticeable time."""

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_LITERALS = {
    "float": r"-?\d+\.\d+(?:e[+-]?\d+)?f",
    "double": r"-?\d+\.\d+(?:e[+-]?\d+)?",
    "int16_t": r"-?\d+",
}


def without_tables(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the files of a build, content by path, with zeros for the numbers of each large table in `manifest["symbols"]`."""
    path, text = _calibration(files, manifest)
    for symbol, body in _tables(text, manifest):
        if math.prod(symbol["shape"]) > NUMBERS_MAX and _is_plain(body, symbol):
            newlines = "\n" * body.count("\n")
            text = text.replace(f"{{{body}}};", f"{{ 0{newlines}}};", 1)
    return {**files, path: text.encode("ascii", "replace")} if text else dict(files)


def malformed(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> Iterator[str]:
    """Describe the tables of `manifest["symbols"]` that are not rows of plain literals of their shape."""
    path, text = _calibration(files, manifest)
    for symbol, body in _tables(text, manifest) if text else ():
        if not _is_plain(body, symbol):
            shape = " x ".join(map(str, symbol["shape"]))
            yield f"{path}: {symbol['name']} is not {shape} plain numbers of type {symbol['type']}"


def _calibration(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> tuple[str, str]:
    path = f"src/{manifest['options']['prefix']}_calibration.c"
    return path, files.get(path, b"").decode("ascii", "replace")


def _tables(text: str, manifest: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Each table in the manifest with its name, and the inside of the outermost braces of its definition."""
    for name, symbol in manifest.get("symbols", {}).items():
        if symbol["type"] in _LITERALS and symbol["shape"]:
            definition = text.partition(f" {name}[")[2].partition(" = {")[2]
            yield {"name": name, **symbol}, definition.partition("};")[0]


def _is_plain(body: str, symbol: Mapping[str, Any]) -> bool:
    """Return whether the text has rows of plain literals of the symbol's shape."""
    text, literal, shape = re.sub(r"\s+", "", _COMMENT.sub("", body)), _LITERALS[symbol["type"]], symbol["shape"]
    row = rf"{literal}(?:,{literal}){{{shape[-1] - 1}}}"
    for size in reversed(shape[:-1]):
        text, found = re.subn(rf"\{{{row}\}}", "#", text)
        row = rf"#(?:,#){{{size - 1}}}"
        if found == 0:
            return False
    return re.fullmatch(row, text) is not None
