"""The mutation campaign: it kills, it sees a missing test, it counts, and it accepts only what is argued."""

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from codegen.config import Kind
from codegen.verify.check import Verdict
from tests.evidence.mutation import equivalents
from tests.evidence.mutation.equivalents import Equivalent
from tests.evidence.mutation.judging import SURVIVED
from tests.evidence.mutation.mutants import Key, Mutant
from tests.evidence.mutation.mutation import Judged, JudgesOf, Tally, campaign, outcome_of
from tests.evidence.progress import Progress
from tests.sil.case import Case
from tests.sil.suite import Judge, judges_of

E2E, CALIBRATION = "src/ars_e2e.c", "src/ars_calibration.c"
SAMPLE = 16


def sample(judges: JudgesOf, most: int = SAMPLE, progress: Progress | None = None) -> Tally:
    """Judge a few mutants of the protection of frames."""
    return campaign(["4ws2"], (E2E,), judges, most, progress)


def without(*names: str) -> JudgesOf:
    """Return the judges of a unit without some of them."""
    return lambda kind, path: [judge for judge in judges_of(kind, path) if judge.name not in names]


def test_the_project_s_tests_kill_a_sample_and_a_killed_run_resumes(tmp_path: Path) -> None:
    path = tmp_path / "steps.jsonl"
    tally = sample(without("sanitized program"), progress=Progress(path))
    assert len(tally.judged) == SAMPLE < len(tally.exist)
    assert tally.faults == []
    assert sum(one.by != SURVIVED for one in tally.judged) >= SAMPLE - 2, "some are equivalent"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:-3]) + lines[-3][:20], encoding="utf-8")  # a kill cuts the last line

    def nobody(kind: Kind, path: str) -> Sequence[Judge]:
        return ()

    again = sample(nobody, progress=Progress(path))
    assert [one.mutant.key for one in again.judged] == [one.mutant.key for one in tally.judged], "the same mutants each time"
    assert [one.by for one in again.judged[:-3]] == [one.by for one in tally.judged[:-3]], "judged before the kill"
    assert {one.by for one in again.judged[-3:]} == {SURVIVED}


def test_a_missing_test_leaves_survivors_each_with_its_line() -> None:
    tally = sample(without("Python's receiver", "sanitized program"))
    survived = [one for one in tally.judged if one.by == SURVIVED]
    assert len(survived) > SAMPLE // 2
    outcome = outcome_of(tally, (), least=1)
    assert outcome.verdict is Verdict.FAILED
    assert len(outcome.findings) == len(survived)
    assert all(finding.startswith(f"4ws2/{E2E}:") and "no test sees it" in finding for finding in outcome.findings)


def judged_by(judge: Judge, paths: Sequence[str] = (E2E,), most: int | None = 1) -> Tally:
    return campaign(["4ws2"], paths, lambda *_: [judge], most)


def test_a_judge_that_the_unaltered_c_fails_judges_nothing() -> None:
    def refuse(case: Case) -> None:
        raise AssertionError("always")

    outcome = outcome_of(judged_by(Judge("refuses", refuse)), ())
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings == ("4ws2: unaltered, it fails refuses: AssertionError always",)


def mutated(case: Case) -> bool:
    return case.mutated is not None and case.mutated.number > 0


def loop(case: Case) -> None:
    started = time.process_time()
    while mutated(case) and time.process_time() >= started:
        pass


def crash(case: Case) -> None:
    if mutated(case):
        os.abort()


@pytest.mark.parametrize(("judge", "by"), [(loop, "a loop without end"), (crash, "SIGABRT")])
def test_a_loop_without_end_and_a_crash_kill(judge: JudgesOf, by: str) -> None:
    assert [one.by for one in judged_by(Judge("judge", judge)).judged] == [by]  # type: ignore[arg-type]


def test_a_fault_of_the_machine_kills_nothing() -> None:
    def broken(case: Case) -> None:
        if mutated(case):
            raise OSError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        judged_by(Judge("broken", broken))


def test_a_judge_that_kills_nothing_is_found() -> None:
    def blind(case: Case) -> None:
        pass

    tally = campaign(["4ws2"], (CALIBRATION,), lambda kind, path: [judges_of(kind, path)[0], Judge("blind", blind)])
    assert tally.powerless == ["blind"]


def made(fates: str) -> Tally:
    """Return a tally by letters: killed, survived."""
    judged = [
        Judged(
            "4ws2", Mutant(Key("src/a.c", "f", "deletion", f"x = {k}"), k + 1, 0, ""), "a test" if letter == "k" else SURVIVED
        )
        for k, letter in enumerate(fates)
    ]
    return Tally([("4ws2", one.mutant) for one in judged], judged)


def argued(tally: Tally, *numbers: int) -> list[Equivalent]:
    return [Equivalent("4ws2", tally.judged[number].mutant.key, "no input can tell") for number in numbers]


def test_argued_mutants_may_survive_as_long_as_they_are_few() -> None:
    tally = made("s" + "k" * 19)
    passed = outcome_of(tally, argued(tally, 0), least=20)
    assert (passed.verdict, passed.findings) == (Verdict.PASSED, ())
    assert passed.figure == "19 of 20 mutants killed, 1 equivalent"
    assert outcome_of(tally, (), least=20).findings == ("4ws2/src/a.c:1: f: deletion: `x = 0`: no test sees it",)
    more = made("ss" + "k" * 18)
    assert "more than 5%" in outcome_of(more, argued(more, 0, 1), least=20).findings[0]


def test_a_wrong_argument_a_stale_one_and_too_few_mutants_fail() -> None:
    tally = made("s" + "k" * 39)
    (killed,) = outcome_of(tally, argued(tally, 0, 5), least=20).findings
    assert "`x = 5`: equivalent.toml argues that it is equivalent; a test sees it" in killed
    stale = [*argued(tally, 0), replace(argued(tally, 0)[0], key=Key("src/a.c", "f", "deletion", "y = 1"))]
    (finding,) = outcome_of(tally, stale, least=20).findings
    assert finding.startswith("equivalent.toml: there is no such mutant")
    assert outcome_of(made("k" * 10), ()).findings == ("10 mutants; at least 300 are required",)


ENTRY = '[[argument]]\nreason = "{}"\nmutants = [ "4ws2 a f | deletion | x = 1", {} ]\n'


def test_the_list_is_read_and_needs_a_reason_once(tmp_path: Path) -> None:
    path = tmp_path / "equivalent.toml"
    path.write_text(ENTRY.format("It is overwritten before it is read.", '"4ws2 a f | deletion | x = 1 | 2"'), encoding="utf-8")
    assert [one.key.occurrence for one in equivalents.read(path)] == [1, 2]
    path.write_text(ENTRY.format("because", ""), encoding="utf-8")
    with pytest.raises(ValueError, match="no reason"):
        equivalents.read(path)
    path.write_text(2 * ENTRY.format("It is overwritten before it is read.", ""), encoding="utf-8")
    with pytest.raises(ValueError, match="twice"):
        equivalents.read(path)
