"""The mutation campaign: it kills mutants, detects a missing test, counts, and accepts only listed equivalents."""

import ctypes
import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen.sil.toolchain import compiler_command
from codegen.verify.outcomes import Subject, Verdict
from tests.evidence.mutation.equivalents import Equivalent
from tests.evidence.mutation.judging import SURVIVED
from tests.evidence.mutation.mutants import Key, Mutant, mutants_of
from tests.evidence.mutation.mutation import Judged, Tally, campaign, outcome_of
from tests.evidence.mutation.one_library import source_with
from tests.evidence.mutation.source import Unit
from tests.evidence.parts import FOLDERS
from tests.evidence.progress import Progress
from tests.sil.case import Case
from tests.sil.suite import SANITIZED, Judge, judges_of

E2E, CHECKSUM = "src/ars_e2e.c", "src/ars_checksum.c"
SAMPLE = 16


def test_the_project_s_tests_kill_a_sample_and_a_killed_run_resumes(tmp_path: Path) -> None:
    path = tmp_path / "steps.jsonl"
    judges = [judge for judge in judges_of("pi", E2E) if judge != SANITIZED]
    tally = campaign(["4ws2-paper"], (E2E,), lambda *_: judges, SAMPLE, Progress(path))
    assert len(tally.judged) == SAMPLE < len(tally.exist) and tally.faults == []
    assert sum(one.by != SURVIVED for one in tally.judged) >= SAMPLE - 2, "some are equivalent"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:-3]) + lines[-3][:20], encoding="utf-8")  # a kill truncates the last line
    again = campaign(["4ws2-paper"], (E2E,), lambda *_: (), SAMPLE, Progress(path))
    assert [one.mutant.key for one in again.judged] == [one.mutant.key for one in tally.judged], "the same mutants each time"
    assert [one.by for one in again.judged[:-3]] == [one.by for one in tally.judged[:-3]], "judged before the kill"
    assert {one.by for one in again.judged[-3:]} == {SURVIVED}


def judged_by(judge: Callable[[int], None], most: int = 1) -> Tally:
    """Judge mutants by their number alone, 0 for the original unit in the library of its mutants."""

    def run(case: Case) -> None:
        judge(case.mutated.number if case.mutated is not None else 0)

    return campaign(["4ws2-paper"], (E2E,), lambda *_: [Judge("judge", run)], most)


def test_endless_loops_and_crashes_kill_but_faults_of_machine_or_original_c_do_not() -> None:
    def loop_or_crash(number: int) -> None:
        while number > 0:
            if number % 2:
                os.abort()

    def break_the_machine(number: int) -> None:
        if number > 0:
            raise OSError("disk full")

    def refuse(number: int) -> None:
        raise AssertionError("always")

    assert {one.by for one in judged_by(loop_or_crash, 3).judged} == {"an endless loop", "SIGABRT"}
    with pytest.raises(RuntimeError, match="disk full"):
        judged_by(break_the_machine)
    outcome = outcome_of(judged_by(refuse), ())
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings == ("4ws2-paper: unaltered, it fails judge: AssertionError always",)


def test_an_ineffective_judge_is_found() -> None:
    blind = Judge("blind", lambda case: None)
    tally = campaign(["4ws2-paper"], (CHECKSUM,), lambda kind, path: [judges_of(kind, path)[0], blind])
    assert tally.powerless == ["blind"]


def made(letters: str) -> Tally:
    """Return a tally by letters: k for killed, s for survived."""
    mutants = [Mutant(Key("src/a.c", "f", "deletion", f"x = {k}"), k + 1, 0, "") for k in range(len(letters))]
    judged = [
        Judged("4ws2-paper", one, "a test" if letter == "k" else SURVIVED) for one, letter in zip(mutants, letters, strict=True)
    ]
    return Tally([("4ws2-paper", one) for one in mutants], judged)


def test_a_few_listed_equivalents_may_survive() -> None:
    tally, few = made("s" + "k" * 39), made("sss" + "k" * 18)
    argued = [Equivalent("4ws2-paper", Key("src/a.c", "f", "deletion", f"x = {k}"), "no input can tell") for k in range(41)]
    passed = outcome_of(tally, argued[:1], least=40)
    assert (passed.verdict, passed.figure) == (Verdict.PASSED, "39 of 40 mutants killed, 1 equivalent")
    for outcome, finding in (
        (outcome_of(tally, (), 40), "4ws2-paper/src/a.c:1: f: deletion: `x = 0`: no test sees it"),
        (outcome_of(few, argued[:3], 20), "3 of 21 are argued to be equivalent: more than 5%"),
        (outcome_of(tally, argued[:2], 40), "`x = 1`: equivalent.toml argues that it is equivalent; a test sees it"),
        (outcome_of(tally, [argued[0], argued[40]], 40), "equivalent.toml: there is no such mutant"),
        (outcome_of(tally, argued[:1]), "40 mutants; at least 300 are required"),
    ):
        assert outcome.verdict is Verdict.FAILED
        assert len(outcome.findings) == 1 and finding in outcome.findings[0]


def test_all_mutants_of_a_unit_compile_to_one_library_that_selects_one(tmp_path: Path) -> None:
    """This includes constants and functions; number 0 is the original unit."""
    text = b"static const int gain = 2;\nint twice(int x);\nint twice(int x)\n{\n    return gain * x;\n}\n"
    unit = Unit.read("src/small.c", {"src/small.c": text})
    mutants = mutants_of(unit)
    (tmp_path / "small.c").write_text(source_with(unit, mutants), encoding="ascii")
    command = [*compiler_command(), "-shared", "-fPIC", "-Wall", "-Werror", "small.c", "-o", "small.so"]
    subprocess.run(command, cwd=tmp_path, check=True)
    found = {}
    for number in range(len(mutants) + 1):
        library = ctypes.CDLL(shutil.copy(tmp_path / "small.so", tmp_path / f"{number}.so"))  # a library can select only once
        library.mutant_select(number)
        found[mutants[number - 1].key.operator if number else "unaltered"] = library.twice(10)
    wanted = {"constant: 2 to 3": 30, "constant: 2 to 1": 10, "arithmetic: * to /": 0, "unaltered": 20}
    assert found == wanted


def test_each_mutant_is_one_change_with_a_unique_name() -> None:
    unit = Unit.read("src/ars_limiter.c", Subject.read(FOLDERS[1]).files)
    before = unit.text()
    mutants = mutants_of(unit)
    assert unit.text() == before, "making mutants leaves the tree as it was"
    assert max(Counter(mutant.key for mutant in mutants).values()) == 1
    assert max(Counter((mutant.index, mutant.text) for mutant in mutants).values()) == 1, "no two are the same C"
    assert all(mutant.text not in before for mutant in mutants)
