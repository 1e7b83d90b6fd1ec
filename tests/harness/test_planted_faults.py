"""The planted faults of the evidence: each fits the committed build, and their table counts them by check."""

import pytest

from codegen.verify.outcomes import Subject
from codegen.verify.runner import CHECKS
from scripts.guide import evidence_tables
from tests.evidence.faults.planted import FAULTS, QUICK, planted, read_faults
from tests.evidence.parts import FOLDERS, ROOT


def test_each_fault_fits_the_committed_build() -> None:
    subject = Subject.read(FOLDERS[-1])
    names = [fault.name for fault in FAULTS]
    assert len(set(names)) == len(names) >= 40 and QUICK in names
    assert len({fault.kind for fault in FAULTS}) >= 8
    known = {check.name for check in CHECKS}
    for fault in FAULTS:
        assert planted(subject, fault).files != subject.files
        assert set(fault.found_by) <= known, fault.name


def test_every_block_of_the_file_is_a_fault() -> None:
    text = (ROOT / "tests/evidence/faults/planted.txt").read_text(encoding="ascii")
    blocks = [block for block in text.split("\n\n")[1:] if not block.startswith("## ")]
    assert [fault.name for fault in FAULTS] == [block.partition(" (")[0] for block in blocks]


def test_a_fault_may_replace_several_texts_of_several_lines() -> None:
    (fault,) = read_faults("\n## a kind\n\na fault (unit): generator memory\n- a;\n-     b;\n+ c;\n- d;\n+ e;\n+ \n+ f;\n")
    assert (fault.kind, fault.name, fault.unit, fault.found_by) == ("a kind", "a fault", "unit", ("generator", "memory"))
    assert fault.replacements == (("a;\n    b;", "c;"), ("d;", "e;\n\nf;"))


def test_the_table_marks_the_checks_that_find_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    figures = {
        "one": {"kind": "bounds", "found by": ["contracts", "generator"]},
        "two": {"kind": "bounds", "found by": ["memory"]},
        "three": {"kind": "NaN", "found by": []},
    }
    run = {"figure": "3 of 3", "figures": figures, "verdict": "passed", "hash": ""}
    monkeypatch.setattr(evidence_tables.record, "read", lambda part: run)
    text = evidence_tables.planted_faults()
    assert text.startswith("The full run: 3 of 3. CBMC and EVA together find 2.\n")
    head, _, *rows = (line.strip("| ").split(" | ") for line in text.strip().splitlines()[2:])
    assert [row[0] for row in rows] == ["**bounds**", "one", "two", "**NaN**", "three", "**found**"]
    column = [row[1].strip() if len(row) > 1 else "" for row in rows]
    assert head[:3] == ["fault", "CBMC", "EVA"]
    assert column == ["", "●", "", "", "", "1"]
