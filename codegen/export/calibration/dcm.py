"""DCM 2.0 (KONSERVIERUNG_FORMAT 2.0), the text format of calibration values of ETAS, Vector and others."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from codegen.emit.objects import CalibrationObject, Kind, Layout, Numbers, Values
from codegen.errors import CodegenError
from codegen.export.calibration.labels import READ_REMEDY, Label, begins_with, number_text, text_of

_KINDS: dict[str, Kind] = {
    "FESTWERT": "VALUE",
    "STUETZSTELLENVERTEILUNG": "AXIS",
    **dict.fromkeys(("KENNLINIE", "FESTKENNLINIE", "GRUPPENKENNLINIE"), "CURVE"),
    **dict.fromkeys(("KENNFELD", "FESTKENNFELD", "GRUPPENKENNFELD"), "MAP"),
}
"""Blocks that are read. The axes of a build are shared by its curves and maps, so the group forms are written."""
_WRITTEN: dict[Kind, str] = {
    "VALUE": "FESTWERT",
    "AXIS": "STUETZSTELLENVERTEILUNG",
    "CURVE": "GRUPPENKENNLINIE",
    "MAP": "GRUPPENKENNFELD",
}
_OTHER_VALUES = ("FESTWERTEBLOCK", "TEXTSTRING")
_BLOCKS = (*_KINDS, "FUNKTIONEN", "VARIANTENKODIERUNG", *_OTHER_VALUES)
_WORDS = re.compile(r'"(?:[^"]|"")*"|[^\s"]+')
_SHARED_AXIS = re.compile(r"\*SST([XY])\s+(\S+)")
_IGNORED = ("LANGNAME", "DISPLAYNAME", "FUNKTION", "VAR")
_UNIT = "EINHEIT_"
_PER_LINE = 6


def read(content: bytes, path: Path, start: str) -> Iterator[Label]:
    """Yield the values, axes, curves and maps of a file whose names begin with `start`; other names are skipped, whatever they
    contain. Raises CodegenError: it is damaged, or such a name is in a block of another kind."""
    lines = enumerate(text_of(content, path).splitlines(), start=1)
    first = next((words for _, line in lines if (words := _words(line))), [])
    if first != ["KONSERVIERUNG_FORMAT", "2.0"]:
        raise CodegenError("does not begin with KONSERVIERUNG_FORMAT 2.0", where=path, remedy=READ_REMEDY)
    for number, line in lines:
        words = _words(line)
        if not words or words[0] == "MODULKOPF":
            continue
        place = f"{path}, line {number}"
        is_own = len(words) == 1 or begins_with(words[1].strip('"'), start)
        if words[0] in _KINDS and is_own:
            yield _label(words, lines, path, place)
        elif words[0] in _OTHER_VALUES and is_own:
            remedy = f"export it as one of {', '.join(_KINDS)}"
            raise CodegenError(f"{' '.join(words[1:2])} is a {words[0]}, which is not supported", where=place, remedy=remedy)
        elif words[0] in _BLOCKS:
            _skip(words, lines, place)
        else:
            raise CodegenError(f"unknown keyword {words[0]}", where=place, remedy=READ_REMEDY)


def _words(line: str) -> list[str]:
    """Return the words of a line; none of a comment."""
    stripped = line.strip()
    return [] if stripped[:1] in ("*", "!", ".") else _WORDS.findall(stripped)


def _skip(head: list[str], lines: Iterator[tuple[int, str]], place: str) -> None:
    """Skip a block up to its END."""
    for _, line in lines:
        match _words(line):
            case ["END", *_]:
                return
            case [word, *_] if word in _BLOCKS:
                break
    raise CodegenError(f"{' '.join(head[:2])} has no END", where=place, remedy=READ_REMEDY)


def _label(head: list[str], lines: Iterator[tuple[int, str]], path: Path, place: str) -> Label:
    """Read a block up to its END."""
    kind, name = _KINDS[head[0]], head[1] if len(head) > 1 else ""
    sizes = {"VALUE": 0, "AXIS": 1, "CURVE": 1, "MAP": 2}[kind]
    if len(head) != 2 + sizes or not all(re.fullmatch("[0-9]{1,9}", size) for size in head[2:]):
        raise CodegenError(f"{head[0]} needs a name and {sizes} sizes", where=place, remedy=READ_REMEDY)
    shared, numbers = {"X": "", "Y": ""}, {"WERT": list[str](), "ST/X": list[str](), "ST/Y": list[str]()}
    units = {f"{_UNIT}{letter}": "" for letter in "WXY"}
    for number, line in lines:
        if comment := _SHARED_AXIS.match(line.strip()):
            shared[comment[1]] = comment[2]
        words = _words(line)
        if words[:1] == ["END"]:
            break
        if not words or words[0] in _IGNORED:
            continue
        if words[0] in units:
            units[words[0]] = words[1].strip('"') if len(words) > 1 else ""
            continue
        if words[0] not in numbers:
            what = f"{words[0]} in {head[0]} {name}" if words[0] not in _KINDS else f"{head[0]} {name} has no END"
            raise CodegenError(what, where=f"{path}, line {number}", remedy="only numbers are supported; write them with END")
        numbers[words[0]] += words[1:]
    else:
        raise CodegenError(f"{head[0]} {name} has no END", where=place, remedy=READ_REMEDY)
    size = tuple(map(int, head[2:]))
    if kind == "AXIS":
        return Label(name, kind, place, numbers["ST/X"], size, units=(units["EINHEIT_X"],))
    axes, points = (shared["X"], shared["Y"])[:sizes], (numbers["ST/X"], numbers["ST/Y"])[:sizes]
    return Label(name, kind, place, numbers["WERT"], size, axes, points, tuple(units.values()))


def write(values: Values, layout: Layout, title: str) -> bytes:
    """Return the file of a set. The same set gives the same bytes."""
    lines = [f"* {title}", "", "KONSERVIERUNG_FORMAT 2.0", ""]
    for each in layout.objects.values():
        lines += [*_block(each, values, layout), ""]
    return "\n".join(lines).encode("ascii")


def _block(each: CalibrationObject, values: Values, layout: Layout) -> Iterator[str]:
    axes = [layout.objects[name] for name in each.axes]
    yield " ".join([_WRITTEN[each.kind], each.name, *map(str, each.shape[::-1])])
    yield f'   LANGNAME "{each.meaning}"'
    if each.kind == "AXIS":
        yield f'   EINHEIT_X "{each.unit}"'
        yield from _lines("ST/X", values[each.name])
    else:
        for letter, axis in zip("XY", axes, strict=False):
            yield f'   EINHEIT_{letter} "{axis.unit}"'
        yield f'   EINHEIT_W "{each.unit}"'
        for letter, axis in zip("XY", axes, strict=False):
            yield f"*SST{letter} {axis.name}"
        if axes:
            yield from _lines("ST/X", values[axes[0].name])
        if each.kind == "MAP":
            for breakpoint_, row in zip(values[axes[1].name], values[each.name], strict=True):
                yield f"   ST/Y {number_text(breakpoint_)}"
                yield from _lines("WERT", row)
        else:
            yield from _lines("WERT", values[each.name].reshape(-1))
    yield "END"


def _lines(keyword: str, numbers: Numbers) -> Iterator[str]:
    texts = [number_text(number) for number in numbers]
    for start in range(0, len(texts), _PER_LINE):
        yield f"   {keyword} {' '.join(texts[start : start + _PER_LINE])}"
