"""The mutants that are argued to be equivalent: equivalent.toml."""

import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from tests.evidence.mutation.mutants import Key
from tests.sil.case import COMMITTED

LIST = Path(__file__).with_name("equivalent.toml")


@dataclass(frozen=True)
class Equivalent:
    """A mutant of a build, and why no input tells it from the C."""

    build: str
    key: Key
    reason: str


def read(path: Path = LIST) -> list[Equivalent]:
    """Read the list. Raises ValueError for an argument without a reason, or a mutant that is listed twice."""
    found = []
    for reason, mutants in tomllib.loads(path.read_text(encoding="utf-8")).items():
        if len(reason.split()) < 3:
            raise ValueError(f"{path.name}: no reason is given for {mutants}")
        for text in mutants:
            place, operator, changed, *occurrence = text.split(" | ")
            build, unit, function = place.split(" ")
            key = Key(f"src/ars_{unit}.c", function, operator, changed, int(occurrence[0]) if occurrence else 1)
            found += [Equivalent(name, key, reason) for name in (COMMITTED if build == "both" else (build,))]
    twice = [one for one, count in Counter((one.build, one.key) for one in found).items() if count > 1]
    if twice:
        raise ValueError(f"{path.name}: listed twice: {', '.join(map(str, twice))}")
    return found
