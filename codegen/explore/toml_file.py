"""Write the chosen configuration as `ars.toml`. If an existing text fits, only its numbers are replaced, which keeps its
comments; otherwise the whole configuration is written, key by key."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from codegen.configuration import CONFIG_BYTES_MAX, Config, parse, preset_text
from codegen.emit.folder import check_output
from codegen.errors import CodegenError, ConfigError
from codegen.explore.controls import ExploreError
from codegen.files import ChangedError, read_file, write_atomically
from codegen.importing.toml_edit import replace_values, whole

REMARK = "codegen explore wrote into this table."
MOVABLE = ("cases.", "limits.", "road.", "tyre.", "controller.")
"""Tables in which a text may differ and still describe the same car; its comments then remain valid."""

Leaves = dict[str, Any]


class Existing(ExploreError):
    """The file exists already; it is overwritten only if the user confirms.

    Attributes:
        sha256: of the existing file; the consent refers to it.
        text: what would change, for the user; `changes` lists it line by line.
    """

    def __init__(self, sha256: str, text: str, changes: tuple[str, ...]) -> None:
        super().__init__("the file exists already")
        self.sha256, self.text, self.changes = sha256, text, changes


@dataclass(frozen=True)
class Target:
    """The file to write: one name in one folder.

    Attributes:
        bases: texts that may be reused; the first that fits. The text of the file itself comes before them.
    """

    path: Path
    bases: tuple[str, ...] = ()

    def write(self, config: Config, replaces: str | None) -> None:
        """Write the configuration, whole or not at all.

        Args:
            replaces: SHA-256 of the file that the user agreed to replace; None if no file may exist.

        Raises:
            Existing: a file exists that the user did not agree to replace.
            CodegenError: it cannot be written, or the path is a link, a folder or part of a build.
        """
        if self.path.is_symlink():
            raise ExploreError(
                "a link, which may lead elsewhere", where=self.path, remedy="remove it, or name another --folder"
            )
        check_output(self.path, ".toml")
        before = None
        if self.path.exists():
            before = read_file(self.path, CONFIG_BYTES_MAX, "check its permissions, or move it away", ExploreError)
        text, kept = self._text(config, before)
        if before is not None:
            found = hashlib.sha256(before).hexdigest()
            if found != replaces:
                raise Existing(found, *self._told(before, config, kept))
        elif replaces is not None:
            raise ExploreError("the file that was to be replaced is gone", where=self.path, remedy="write again")
        try:
            write_atomically(self.path, text.encode("utf-8"), replaces=before)
        except ChangedError:  # since it was read above: ask again, about the file of now
            self.write(config, replaces)

    def _text(self, config: Config, before: bytes | None) -> tuple[str, bool]:
        """Return the text to write, and whether it is the existing file with other numbers."""
        own = [] if before is None else [_decoded(before)]
        for text in (*own, *self.bases):
            edited = _edited(text, config) if text is not None else None
            if edited is not None:
                return edited, bool(own) and text is own[0]
        return whole(config, "codegen explore"), False

    def _told(self, before: bytes, config: Config, kept: bool) -> tuple[str, tuple[str, ...]]:
        base = _parsed(_decoded(before) or "")
        if base is None:
            return f"{self.path} is not a configuration of codegen. All of it would be replaced.", ()
        changes = tuple(_differences(_leaves(base), _leaves(config)))
        if not changes:
            return f"{self.path} already contains these settings.", ()
        if kept:
            return f"In {self.path} these keys would change; comments stay:", changes
        return (
            f"{self.path} differs in more than the settings of this page. All of it would be replaced, with its comments:",
            changes,
        )


def _edited(text: str, config: Config) -> str | None:
    """Return a text with the numbers of the configuration; None if it does not fit, or cannot be edited line by line."""
    base = _parsed(text)
    if base is None:
        return None
    before, after = _leaves(base), _leaves(config)
    changed = [key for key in before | after if before.get(key) != after.get(key)]
    if any(not key.startswith(MOVABLE) for key in changed):
        return None
    tables: dict[str, Leaves] = {}
    gone: dict[str, list[str]] = {}
    for key in changed:
        table, _, name = key.rpartition(".")
        if after.get(key) is not None:
            tables.setdefault(table, {})[name] = after[key]
        else:
            gone.setdefault(table, []).append(name)
    try:
        for table, values in tables.items():
            # The stiffness of a tyre is replaced by B, and margins that belong to other gains are removed.
            renamed = dict.fromkeys(gone.get(table, ()), next(iter(values)))
            text = replace_values(text, table, values, renamed, REMARK)
    except CodegenError:
        return None
    return text if _parsed(text) == config else None


def _leaves(config: Config) -> Leaves:
    """Yield dotted key -> value for all keys that are not tables."""

    def below(values: Mapping[str, Any], place: str) -> Iterator[tuple[str, Any]]:
        for key, value in values.items():
            if isinstance(value, Mapping):
                yield from below(value, f"{place}{key}.")
            else:
                yield f"{place}{key}", value

    return dict(below(config.model_dump(mode="json"), ""))


def _differences(before: Leaves, after: Leaves) -> Iterable[str]:
    for key in before | after:
        old, new = before.get(key), after.get(key)
        if old != new:
            yield f"{key}: {_shown(old)} → {_shown(new)}"


def _shown(value: Any) -> str:
    text = "not there" if value is None else tomlkit.item(value).as_string()
    return text if len(text) <= 60 else f"{text[:59]}…"


def _decoded(data: bytes) -> str | None:
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError:
        return None


def _parsed(text: str) -> Config | None:
    try:
        return parse(tomllib.loads(text), "text")
    except (tomllib.TOMLDecodeError, ConfigError, ValueError, RecursionError):
        return None


def preset_bases() -> tuple[str, ...]:
    """Return the commented presets."""
    return preset_text("recommended"), preset_text("paper")
