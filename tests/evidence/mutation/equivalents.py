"""Mutants that are argued to be equivalent: equivalent.toml."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from tests.evidence.mutation.mutants import Key
from tests.sil.case import COMMITTED

LIST = Path(__file__).with_name("equivalent.toml")


@dataclass(frozen=True)
class Equivalent:
    """A mutant of a build, and why no input distinguishes it from the original C."""

    build: str
    key: Key
    reason: str


def read(path: Path = LIST) -> list[Equivalent]:
    """Read the list."""
    found = []
    for reason, mutants in tomllib.loads(path.read_text(encoding="utf-8")).items():
        for text in mutants:
            place, operator, changed, *occurrence = text.split(" | ")
            build, unit, function = place.split(" ")
            key = Key(f"src/ars_{unit}.c", function, operator, changed, int(occurrence[0]) if occurrence else 1)
            found += [Equivalent(name, key, reason) for name in (COMMITTED if build == "both" else (build,))]
    return found
