"""The mutants: each is one change of the C, with a name of its own."""

import ctypes
import shutil
import subprocess
from collections import Counter
from pathlib import Path

from codegen.sil.toolchain import compiler_command
from codegen.verify.check import Subject
from tests.evidence.mutation.mutants import mutants_of
from tests.evidence.mutation.one_library import source_with
from tests.evidence.mutation.source import Unit
from tests.evidence.parts import FOLDERS

SMALL = b"""
#include <stdint.h>
#include <stdbool.h>
static const float gain = 0.5f;
static const float table[3] = { 1.0f, -2.0f, 3.0f };
bool step(float *value, uint16_t count, float x, const uint8_t data[8])
{
    const uint32_t local[2] = { 7u, 8u };
    bool result = (x > 0.0f) && !(x >= 20.0f);

    if (count < UINT16_MAX) {
        *value += gain * table[count];
    }
    switch (count) {
    case 3:
        *value = -x;
        break;
    default:
        result = result || (data[1] == 0x1Fu);
        break;
    }
    return result ? true : (local[0] != 7u);
}
"""


def test_all_mutants_of_a_unit_compile_to_one_library_that_selects_one(tmp_path: Path) -> None:
    """Constants and functions alike; number 0 is the unaltered unit."""
    text = b"static const int gain = 2;\nint twice(int x);\nint twice(int x)\n{\n    return gain * x;\n}\n"
    unit = Unit.read("src/small.c", {"src/small.c": text})
    mutants = mutants_of(unit)
    (tmp_path / "small.c").write_text(source_with(unit, mutants), encoding="ascii")
    command = [*compiler_command(), "-shared", "-fPIC", "-Wall", "-Werror", "small.c", "-o", "small.so"]
    subprocess.run(command, cwd=tmp_path, check=True)
    found = {}
    for number in range(len(mutants) + 1):
        library = ctypes.CDLL(shutil.copy(tmp_path / "small.so", tmp_path / f"{number}.so"))  # a library selects once
        library.mutant_select(number)
        found[mutants[number - 1].key.operator if number else "unaltered"] = library.twice(10)
    wanted = {"constant: 2 to 3": 30, "constant: 2 to 1": 10, "arithmetic: * to /": 0, "unaltered": 20}
    assert found == wanted


def test_each_mutant_of_a_unit_is_one_change_with_a_name_of_its_own() -> None:
    unit = Unit.read("src/ars_limiter.c", Subject.read(FOLDERS[1]).files)
    before = unit.text()
    mutants = mutants_of(unit)
    assert unit.text() == before, "making mutants leaves the tree as it was"
    assert max(Counter(mutant.key for mutant in mutants).values()) == 1
    assert max(Counter((mutant.index, mutant.text) for mutant in mutants).values()) == 1, "no two are the same C"
    assert all(mutant.text not in before for mutant in mutants)


def test_every_kind_is_made_and_tables_types_and_labels_are_left_as_they_are() -> None:
    mutants = mutants_of(Unit.read("src/small.c", {"src/small.c": SMALL}))
    assert {(mutant.key.operator, mutant.key.text) for mutant in mutants} >= {
        ("relational: > to >=", "x > 0.0f"),
        ("relational: == to !=", "data[1] == 0x1Fu"),
        ("arithmetic: * to /", "gain * table[count]"),
        ("arithmetic: += to -=", "*value += gain * table[count]"),
        ("arithmetic: - lost", "-x"),
        ("constant: 0.5f to 0.505f", "static const float gain = 0.5f"),
        ("constant: 0.0f to 1.0f", "x > 0.0f"),
        *((f"constant: 0x1Fu to {other}", "data[1] == 0x1Fu") for other in ("0x20u", "0x1eu", "0xfu")),
        ("constant: UINT16_MAX to (UINT16_MAX / 2)", "count < UINT16_MAX"),
        *((f"logical: {change}", "(x > 0.0f) && (!(x >= 20.0f))") for change in ("&& to ||", "left condition lost")),
        ("logical: ! lost", "!(x >= 20.0f)"),
        ("logical: always taken", "count < UINT16_MAX"),
        ("deletion", "*value = -x"),
    }
    for mutant in mutants:
        assert mutant.key.function in ("gain", "step")
        kept = ["data[8]", "local[2] = {7u, 8u}"] if mutant.key.function == "step" else []
        assert all(text in mutant.text for text in kept)
        assert not kept or mutant.key.text.startswith("switch") or "case 3:" in mutant.text
