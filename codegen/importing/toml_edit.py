"""A configuration as TOML; and new values in a table of a TOML text, whose other comments, order and spaces stay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.container import Container
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Comment, Item, Key, Null, Table

from codegen.configuration import CONFIG_BYTES_MAX, Config, load
from codegen.errors import ConfigError
from codegen.files import read_text
from codegen.importing.source import ImportFault

Entry = tuple[Key | None, Item]


def whole(config: Config, author: str) -> str:
    """Return all keys of a configuration as TOML."""
    keys = tomlkit.dumps(config.model_dump(mode="json", exclude_none=True))
    return f"# Written by {author}: every key, units in the names.\n\n{keys}"


def with_text(given: Config | Path) -> tuple[Config, str]:
    """Return a configuration and its text as TOML; that of a file has its comments. Raises ConfigError."""
    if isinstance(given, Config):
        return given, whole(given, "codegen")
    return load(given), read_text(given, CONFIG_BYTES_MAX, "name an ars.toml", ConfigError)


def replace_values(text: str, table: str, values: Mapping[str, Any], renamed: Mapping[str, str], remark: str) -> str:
    """Return the text with `values` in the table.

    Args:
        text: a valid TOML file.
        table: dotted name of the table, such as "tyre.front"; added at the end where the text has none.
        values: key to value, None to remove a key; keys that the table lacks are added after its last one.
        renamed: key in the text to the key that takes its line.
        remark: a comment under the head of the table. It replaces one of an earlier call with the same first two words.

    Raises:
        ImportFault: the table is not written under a head of its own.
    """
    parts = table.split(".")
    document = tomlkit.parse(text)
    try:
        if not _has(document, parts):
            document = tomlkit.parse(f"{text.rstrip()}\n\n[{table}]\n")
        target = next((each for each in _tables(document, parts) if not each.is_super_table()), None)
    except (TOMLKitError, TypeError):
        target = None
    if target is None:
        raise ImportFault(
            f"[{table}] is written in a way that cannot be edited",
            where=f"[{table}]",
            remedy=f"write it as [{table}], a key on each line",
        )
    target.value.body[:] = _edited(target.value.body, values, renamed, remark)
    return tomlkit.dumps(document)


def _has(document: Any, parts: Sequence[str]) -> bool:
    for part in parts:
        if part not in document:
            return False
        document = document[part]
    return True


def _tables(container: Container, parts: Sequence[str]) -> Iterator[Table]:
    """Yield the parts of a table, which is in several if other tables are between its head and the tables inside it."""
    for key, item in container.body:
        if key is not None and key.key == parts[0] and type(item) is Table:
            yield from _tables(item.value, parts[1:]) if len(parts) > 1 else (item,)


def _edited(body: list[Entry], values: Mapping[str, Any], renamed: Mapping[str, str], remark: str) -> list[Entry]:
    mark = "# " + " ".join(remark.split()[:2])
    result: list[Entry] = [(None, tomlkit.comment(remark))]
    waiting, last = dict(values), 1
    for key, item in body:
        if isinstance(item, Null) or (isinstance(item, Comment) and item.as_string().lstrip().startswith(mark)):
            continue
        name = "" if key is None else key.key
        new = renamed.get(name, name)
        if key is not None and new in waiting:
            if (value := waiting.pop(new)) is not None:
                result.append((key if new == name else tomlkit.key(new), _like(value, item)))
        elif name not in renamed:  # else its line is taken already
            result.append((key, item))
        if key is not None and not isinstance(item, (Table, AoT)):
            last = len(result)
    added: list[Entry] = [(tomlkit.key(key), tomlkit.item(value)) for key, value in waiting.items() if value is not None]
    for _, item in added:
        item.trivia.trail = "\n"
    return [*result[:last], *added, *result[last:]]


def _like(value: Any, item: Item) -> Item:
    """Return a value with the indent and the comment of another."""
    made: Item = tomlkit.item(value)
    made.trivia.indent, made.trivia.trail = item.trivia.indent, item.trivia.trail
    made.trivia.comment_ws, made.trivia.comment = item.trivia.comment_ws, item.trivia.comment
    return made
