"""Mutants that are argued to be no faults: the list in equivalent.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from tests.evidence.mutation.mutants import Key

LIST = Path(__file__).with_name("equivalent.toml")


@dataclass(frozen=True)
class Equivalent:
    """One mutant of a build, and why no input can tell it from the C."""

    build: str
    key: Key
    reason: str


def read(path: Path = LIST) -> list[Equivalent]:
    """The list. Raises ValueError for an entry without a reason, or one that is there twice."""
    found = []
    for entry in tomllib.loads(path.read_text(encoding="utf-8")).get("equivalent", []):
        key = Key(entry["path"], entry["function"], entry["operator"], entry["text"], entry.get("occurrence", 1))
        if len(entry["reason"].split()) < 3:
            raise ValueError(f"{path.name}: no reason is given for {key}")
        found.append(Equivalent(entry["build"], key, entry["reason"]))
    twice = {
        (one.build, one.key) for one in found if sum(one.build == other.build and one.key == other.key for other in found) > 1
    }
    if twice:
        raise ValueError(f"{path.name}: listed twice: {sorted(map(str, twice))}")
    return found
