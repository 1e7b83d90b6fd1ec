"""The mutation campaign: it sees a test that is missing, counts what there is, and takes only what is argued."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from codegen.verify.check import Verdict
from tests.evidence.mutation import equivalents, mutation
from tests.evidence.mutation.equivalents import Equivalent
from tests.evidence.mutation.fates import Fate, Judged
from tests.evidence.mutation.mutants import Key, Mutant
from tests.evidence.mutation.mutation import Campaign, Tally, campaign, outcome_of
from tests.evidence.part import FOLDERS
from tests.sil.case import Case
from tests.sil.suite import Judge, judges_of

E2E = "src/ars_e2e.c"
SOME = 24


def some(judges: mutation.JudgesOf, most: int | None = SOME) -> Tally:
    """A few mutants of the protection of frames."""
    return campaign(Campaign(FOLDERS[:1], (E2E,), judges, most))


def test_the_project_s_tests_kill_a_sample() -> None:
    tally = some(judges_of)
    assert len(tally.judged) == SOME < len(tally.exist)
    assert tally.faults == []
    assert len(tally.of(Fate.KILLED)) >= SOME - 3, "some are equivalent"
    assert tally.of(Fate.STILLBORN) == []
    again = some(lambda *_: [])
    assert [one.mutant.key for one in again.judged] == [one.mutant.key for one in tally.judged], "the same ones each time"


def test_a_test_that_is_missing_leaves_survivors() -> None:
    """Without the comparison with Python's receiver nearly all live; the part fails and names each with its line."""
    tally = some(lambda case, path: [judge for judge in judges_of(case, path) if judge.name != "Python's receiver"])
    survived = tally.of(Fate.SURVIVED)
    assert len(survived) > SOME // 2
    outcome = outcome_of(tally, (), least=1)
    assert outcome.verdict is Verdict.FAILED
    assert len(outcome.findings) == len(survived)
    assert all(finding.startswith(f"4ws2/{E2E}:") and "no test sees it" in finding for finding in outcome.findings)


def test_judges_that_the_unaltered_c_does_not_pass_judge_nothing() -> None:
    def refuse(case: Case) -> None:
        raise AssertionError("always")

    tally = some(lambda *_: [Judge("refuses", refuse)])
    assert tally.judged == []
    outcome = outcome_of(tally, ())
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings == ("4ws2: unaltered, it fails refuses: AssertionError always",)


def test_a_loop_without_end_and_a_crash_are_seen() -> None:
    """As a judge that never comes back, or that ends the process, for any C but the unaltered."""

    def judges(case: Case, path: str) -> Sequence[Judge]:
        def judge(case: Case) -> None:
            if case.instead:
                started = time.process_time()
                while time.process_time() >= started:
                    pass

        def crash(case: Case) -> None:
            if case.instead:
                case.built.software.ffi.memmove(case.built.software.ffi.cast("void *", 0), b"x", 1)

        return [Judge("loop", judge)] if path == E2E else [Judge("crash", crash)]

    def fates(path: str) -> list[Judged]:
        return campaign(Campaign(FOLDERS[:1], (path,), judges, 1)).judged

    assert [(one.fate, one.by) for one in fates(E2E)] == [(Fate.KILLED, "a loop that does not end")]
    assert [(one.fate, one.by) for one in fates("src/ars_limiter.c")] == [(Fate.KILLED, "SIGSEGV")]


def test_a_fault_of_the_machine_kills_nothing() -> None:
    def broken(case: Case) -> None:
        if case.instead:
            raise OSError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        some(lambda *_: [Judge("broken", broken)], 2)


def made(fates: str) -> Tally:
    """A tally by letters: killed, survived, does not compile."""
    known = {"k": Fate.KILLED, "s": Fate.SURVIVED, "x": Fate.STILLBORN}
    judged = [
        Judged("4ws2", Mutant(Key("src/a.c", "f", "deletion", f"x = {index}"), index + 1, 0, ""), known[letter], "a test")
        for index, letter in enumerate(fates)
    ]
    return Tally([("4ws2", one.mutant) for one in judged], judged, [])


def argued(tally: Tally, *numbers: int) -> list[Equivalent]:
    return [Equivalent("4ws2", tally.judged[number].mutant.key, "no input can tell") for number in numbers]


def test_what_is_argued_may_survive_as_long_as_it_is_little() -> None:
    tally = made("s" + "k" * 19)
    passed = outcome_of(tally, argued(tally, 0), least=20)
    assert (passed.verdict, passed.findings) == (Verdict.PASSED, ())
    assert passed.figure == "19 of 20 mutants killed, 1 equivalent"
    assert passed.figures["by_kind"] == {"deletion": 20}
    assert outcome_of(tally, (), least=20).findings == ("4ws2/src/a.c:1: f: deletion: `x = 0`: no test sees it",)
    more = made("ss" + "k" * 18)
    assert "more than 5%" in outcome_of(more, argued(more, 0, 1), least=20).findings[0]


def test_an_argument_that_does_not_hold_fails() -> None:
    tally = made("s" + "k" * 39)
    killed = outcome_of(tally, argued(tally, 0, 5), least=20)
    assert killed.findings == (
        "4ws2/src/a.c:6: f: deletion: `x = 5`: is no equivalent, as equivalent.toml has it: a test sees it",
    )
    gone = argued(tally, 0)
    stale = [*gone, replace(gone[0], key=replace(gone[0].key, text="y = 1"))]
    (finding,) = outcome_of(tally, stale, least=20).findings
    assert finding.startswith("equivalent.toml: there is no such mutant")
    assert outcome_of(tally, stale, least=20).verdict is Verdict.FAILED


def test_too_few_and_those_that_do_not_compile_fail() -> None:
    tally = made("k" * 10)
    assert outcome_of(tally, ()).findings == ("10 mutants; at least 300 are asked for",)
    (finding,) = outcome_of(made("k" * 10 + "x"), (), least=10).findings
    assert "does not compile" in finding


def test_a_part_of_them_says_how_many_there_are() -> None:
    tally = made("k" * 10)
    part = Tally(tally.exist * 2, tally.judged, [])
    assert outcome_of(part, (), least=10).figure == "10 of 10 mutants killed, 0 equivalent (of 20 that there are)"


ENTRY = """
[[equivalent]]
build = "4ws2"
path = "src/a.c"
function = "f"
operator = "deletion"
text = "x = 1"
reason = "{reason}"
"""


def test_the_list_is_read_and_refuses_what_is_not_argued(tmp_path: Path) -> None:
    path = tmp_path / "equivalent.toml"
    path.write_text(ENTRY.format(reason="It is overwritten before it is read."), encoding="utf-8")
    (one,) = equivalents.read(path)
    assert one.key == Key("src/a.c", "f", "deletion", "x = 1", 1)
    path.write_text(ENTRY.format(reason="because"), encoding="utf-8")
    with pytest.raises(ValueError, match="no reason"):
        equivalents.read(path)
    path.write_text(2 * ENTRY.format(reason="It is overwritten before it is read."), encoding="utf-8")
    with pytest.raises(ValueError, match="twice"):
        equivalents.read(path)


def test_the_project_s_list_is_about_mutants_that_there_are() -> None:
    known = mutation.all_keys(FOLDERS)
    assert [one for one in equivalents.read() if (one.build, one.key) not in known] == []
