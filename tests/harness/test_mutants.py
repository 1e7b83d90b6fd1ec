"""The mutants themselves: made of the C as it stands, each a change, each with a name of its own."""

from __future__ import annotations

import subprocess
from collections import Counter
from pathlib import Path

import pytest

from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_command
from codegen.verify.check import Subject
from tests.evidence.mutation.mutants import definitions, mutants_of
from tests.evidence.mutation.mutation import all_keys
from tests.evidence.mutation.source import Unit
from tests.evidence.part import FOLDERS

SUBJECTS = {folder.name: Subject.read(folder) for folder in FOLDERS}
OWN = ("calibration", "controller", "map", "reference_model", "selftest")
"""Units of the second build that are not those of the first."""
UNITS = [
    (name, path)
    for name, subject in SUBJECTS.items()
    for path in subject.sources("src")
    if name == FOLDERS[0].name or path[8:-2] in OWN
]

SMALL = b"""
#include <stdint.h>
#include <stdbool.h>

static const float gain = 0.5f;
static const float table[3] = { 1.0f, -2.0f, 3.0f };
enum { POINTS = 3 };

typedef struct { float value; uint16_t count; } state_t;

bool step(state_t *self, float x, const uint8_t data[8])
{
    const uint32_t local[2] = { 7u, 8u };
    bool result = (x > 0.0f) && !(x >= 20.0f);
    uint32_t k;

    for (k = 0u; k < (uint32_t)POINTS; k++) {
        self->value += gain * table[k];
    }
    if (self->count < UINT16_MAX) {
        self->count++;
    }
    switch (self->count) {
    case 3:
        self->value = -x;
        break;
    default:
        result = result || (data[1] == 0x1Fu);
        break;
    }
    return result ? true : (local[0] != 7u);
}
"""


def small(text: bytes = SMALL) -> Unit:
    return Unit.read("src/small.c", {"src/small.c": text})


def assembly(folder: Path, text: str, include: Path) -> str:
    """What the compiler makes of a source, optimised, under one name."""
    (folder / "unit.c").write_text(text, encoding="ascii")
    command = [*compiler_command(), "-std=c99", "-O2", "-ffp-contract=off", f"-I{include}", "-S", "unit.c", "-o", "-"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(("name", "path"), UNITS)
def test_what_is_mutated_is_the_c_itself(name: str, path: str, tmp_path: Path) -> None:
    """Printed again from its tree, a unit has the machine code that it had; making mutants leaves the tree as it was."""
    subject = SUBJECTS[name]
    for own, content in subject.sources("include").items():
        (tmp_path / own).parent.mkdir(exist_ok=True)
        (tmp_path / own).write_bytes(content)
    unit = Unit.read(path, subject.files)
    before = unit.text()
    mutants = mutants_of(unit)
    assert unit.text() == before
    original = assembly(tmp_path, subject.files[path].decode("ascii"), tmp_path / "include")
    assert assembly(tmp_path, before, tmp_path / "include") == original
    # Of numbers alone any change is seen; of code one that surely matters.
    seen = (mutant for mutant in mutants if mutant.key.operator.startswith(("arithmetic: - to", "logical: &&")))
    wrong = next(seen, mutants[0])
    assert assembly(tmp_path, wrong.source(unit), tmp_path / "include") != original, "it can differ"


@pytest.mark.parametrize(("name", "path"), UNITS)
def test_each_mutant_is_one_change_with_a_name_of_its_own(name: str, path: str) -> None:
    unit = Unit.read(path, SUBJECTS[name].files)
    mutants = mutants_of(unit)
    keys = Counter(mutant.key for mutant in mutants)
    assert max(keys.values()) == 1
    texts = Counter((mutant.index, mutant.text) for mutant in mutants)
    assert max(texts.values()) == 1, "no two do the same"
    lines = SUBJECTS[name].files[path].decode("ascii").count("\n")
    for mutant in mutants:
        assert 1 <= mutant.line <= lines
        assert mutant.text not in unit.text()


def test_every_kind_is_made() -> None:
    told = {(mutant.key.operator, mutant.key.text) for mutant in mutants_of(small())}
    assert told >= {
        ("relational: > to >=", "x > 0.0f"),
        ("relational: > to <=", "x > 0.0f"),
        ("relational: >= to <", "x >= 20.0f"),
        ("relational: == to !=", "data[1] == 0x1Fu"),
        ("arithmetic: * to /", "gain * table[k]"),
        ("arithmetic: += to -=", "self->value += gain * table[k]"),
        ("arithmetic: ++ to --", "self->count++"),
        ("arithmetic: - lost", "-x"),
        ("constant: 0.5f to 0.505f", "static const float gain = 0.5f"),
        ("constant: 0.0f to 1.0f", "x > 0.0f"),
        ("constant: 0x1Fu to 0x20u", "data[1] == 0x1Fu"),
        ("constant: 0x1Fu to 0x1eu", "data[1] == 0x1Fu"),
        ("constant: 0x1Fu to 0xfu", "data[1] == 0x1Fu"),
        ("constant: UINT16_MAX to (UINT16_MAX - 1)", "self->count < UINT16_MAX"),
        ("constant: UINT16_MAX to (UINT16_MAX / 2)", "self->count < UINT16_MAX"),
        ("logical: && to ||", "(x > 0.0f) && (!(x >= 20.0f))"),
        ("logical: left condition lost", "(x > 0.0f) && (!(x >= 20.0f))"),
        ("logical: ! lost", "!(x >= 20.0f)"),
        ("logical: always taken", "self->count < UINT16_MAX"),
        ("deletion", "self->value = -x"),
        ("deletion", "self->count++"),
    }
    assert ("deletion", "self->count < UINT16_MAX") not in told, "the same as without its only statement"


def test_tables_types_and_labels_are_left_as_they_are() -> None:
    for mutant in mutants_of(small()):
        assert mutant.key.function in ("gain", "step")
        kept = [] if mutant.key.function == "gain" else ["data[8]", "local[2] = {7u, 8u}"]
        kept += ["case 3:"] if kept and not mutant.key.text.startswith("switch") else []
        assert all(text in mutant.text for text in kept)


def test_a_name_outlives_lines_that_move_and_comments() -> None:
    moved = b"/* A comment. */\n\n" + SMALL.replace(b"    uint32_t k;\n", b"    /* counts */\n    uint32_t k;\n\n")
    assert [mutant.key for mutant in mutants_of(small(moved))] == [mutant.key for mutant in mutants_of(small())]
    assert [mutant.line for mutant in mutants_of(small(moved))] != [mutant.line for mutant in mutants_of(small())]


def test_what_a_unit_defines() -> None:
    """The same for the same C, comments aside; another for another constant."""
    assert definitions(small()) == definitions(small(b"/* A comment. */\n" + SMALL))
    assert definitions(small()) != definitions(small(SMALL.replace(b"gain = 0.5f", b"gain = 0.6f")))


def test_a_unit_that_stood_in_an_earlier_build_is_mutated_there_only() -> None:
    mutated = {(build, key.path) for build, key in all_keys(FOLDERS)}
    _, second = SUBJECTS.values()
    assert {path for build, path in mutated if build == second.name} == {f"src/{second.prefix}_{unit}.c" for unit in OWN}
    assert all(mutants_of(Unit.read(path, second.files)) for path in second.sources("src"))


def test_c_that_cannot_be_read_is_told() -> None:
    for text in (b"int f(void) { return 1 }", b'#include "nowhere.h"\n'):
        with pytest.raises(BuildError):
            small(text)
