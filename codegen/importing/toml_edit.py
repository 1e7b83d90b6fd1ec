"""Edit values in a table of a TOML text; comments, order and spaces stay.

Python's library reads TOML but does not write it. The edit works by lines, and the result is parsed to verify it.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping
from typing import Any

from codegen.importing.source import ImportFault

HEADER = re.compile(r"\s*\[\[?\s*(.+?)\s*\]\]?\s*(#.*)?\Z")
VALUE = re.compile(r"(?P<start>\s*(?P<key>[A-Za-z0-9_-]+|\"[^\"]+\"|'[^']+')\s*=\s*)(?P<value>[^#]*?)(?P<end>\s*(#.*)?)\Z")


def number(value: float) -> str:
    """Return a number as TOML with at most nine significant digits, far finer than any tyre is known."""
    return repr(float(f"{value:.9g}"))


def replace_values(
    text: str,
    table: str,
    values: Mapping[str, Any],
    renamed: Mapping[str, str],
    remark: str,
    written: Callable[[Any], str] = number,
) -> str:
    """Return the text with `values` in the table.

    Args:
        text: text of a valid TOML file.
        table: dotted name, "tyre.front"; added at the end where the text has none.
        values: key -> value, numbers by default; missing keys are added at the end of the table.
        renamed: existing key -> key that replaces it on its line.
        remark: comment under the head of the table; it replaces one of an earlier call with the same first two words.
        written: writes a value as TOML, on one line.

    Raises:
        ImportFault: the table is written in a way that cannot be edited line by line.
    """
    lines = text.split("\n")
    texts = {key: written(value) for key, value in values.items()}
    start, end = _span(lines, table)
    if start is None:
        made = [f"[{table}]", f"# {remark}", *(f"{key} = {value}" for key, value in texts.items())]
        edited = "\n".join([*text.rstrip("\n").split("\n"), "", *made, ""])
    else:
        body = _edited(lines[start + 1 : end], texts, renamed, remark)
        edited = "\n".join([*lines[: start + 1], *body, *lines[end:]])
    _check(text, edited, table, texts, renamed)
    return edited


def _span(lines: list[str], table: str) -> tuple[int | None, int]:
    """Return the line of the table's head, and the line after its last."""
    start = None
    for index, line in enumerate(lines):
        match = HEADER.match(line)
        if not match:
            continue
        if start is not None:
            return start, index
        if re.sub(r"[\s\"']", "", match[1]) == table:
            start = index
    return start, len(lines)


def _edited(body: list[str], values: Mapping[str, str], renamed: Mapping[str, str], remark: str) -> list[str]:
    mark = "# " + " ".join(remark.split()[:2])
    result, waiting, last = [f"# {remark}"], dict(values), 0
    for line in body:
        if line.startswith(mark):
            continue
        match = VALUE.match(line)
        key = match["key"].strip("\"'") if match else ""
        new = renamed.get(key, key)
        if match and new in waiting:
            start = match["start"] if new == key else match["start"].replace(key, new, 1)
            line = f"{start}{waiting.pop(new)}{match['end']}"
        elif match and key in renamed:
            continue  # its line was reused already
        result.append(line)
        last = len(result) if match else last
    added = [f"{key} = {value}" for key, value in waiting.items()]
    last = max(last, 1)
    return [*result[:last], *added, *result[last:]]


def _check(before: str, after: str, table: str, values: Mapping[str, str], renamed: Mapping[str, str]) -> None:
    """Check that the texts differ in the values, and in nothing else."""
    expected = tomllib.loads(before)
    inner = expected
    for part in table.split("."):
        inner = inner.setdefault(part, {})
    for key in renamed:
        inner.pop(key, None)
    inner.update({key: tomllib.loads(f"value = {value}")["value"] for key, value in values.items()})
    try:
        found = tomllib.loads(after)
    except tomllib.TOMLDecodeError:
        found = {}
    if found != expected:
        raise ImportFault(
            f"[{table}] is written in a way that cannot be edited",
            where=f"[{table}]",
            remedy=f"write it as [{table}], a key on each line",
        )
