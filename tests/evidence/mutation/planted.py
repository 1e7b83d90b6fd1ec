"""Faults beyond the operators of `mutants`: changes made by hand, in planted.toml."""

import functools
import tomllib
from pathlib import Path

from tests.evidence.mutation.mutants import Key, Mutant
from tests.evidence.mutation.source import Unit, name_of, printed
from tests.sil.case import Case

LIST = Path(__file__).with_name("planted.toml")


@functools.cache
def _faults() -> list[dict[str, str]]:
    faults: list[dict[str, str]] = tomllib.loads(LIST.read_text(encoding="utf-8"))["fault"]
    return faults


def planted_in(case: Case, unit: Unit) -> list[Mutant]:
    """Return the faults of a unit of a build as mutants.

    Raises LookupError unless the text to replace occurs exactly once and the change is inside one definition.
    """
    found = []
    files = dict(case.built.folder.files)
    text = files[unit.path].decode("ascii")
    for fault in _faults():
        if (fault["build"], fault["path"]) != (case.name, unit.path):
            continue
        if text.count(fault["old"]) != 1:
            raise LookupError(f"{unit.path} holds {text.count(fault['old'])} times, instead of once: {fault['old']}")
        altered = Unit.read(unit.path, {**files, unit.path: text.replace(fault["old"], fault["new"]).encode("ascii")})
        pairs = list(zip(unit.nodes, altered.nodes, strict=True))
        differ = [index for index, (one, other) in enumerate(pairs) if printed(one) != printed(other)]
        if len(differ) != 1:
            raise LookupError(f"planted.toml: {fault['name']}: it changes {len(differ)} definitions instead of one")
        line = text[: text.index(fault["old"])].count("\n") + 1
        key = Key(unit.path, name_of(unit.nodes[differ[0]]), "planted", fault["name"])
        found.append(Mutant(key, line, differ[0], printed(altered.nodes[differ[0]])))
    return found
