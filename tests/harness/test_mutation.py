"""The mutation campaign: it kills, it sees a missing test, it counts, and it accepts only what is argued."""

import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

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


def sample(*but: str, judges: JudgesOf = judges_of, progress: Progress | None = None) -> Tally:
    """Judge a few mutants of the protection of frames, without some of the judges."""
    return campaign(["4ws2"], (E2E,), lambda *of: [one for one in judges(*of) if one.name not in but], SAMPLE, progress)


def test_the_project_s_tests_kill_a_sample_and_a_killed_run_resumes(tmp_path: Path) -> None:
    path = tmp_path / "steps.jsonl"
    tally = sample("sanitized program", progress=Progress(path))
    assert len(tally.judged) == SAMPLE < len(tally.exist)
    assert tally.faults == []
    assert sum(one.by != SURVIVED for one in tally.judged) >= SAMPLE - 2, "some are equivalent"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:-3]) + lines[-3][:20], encoding="utf-8")  # a kill cuts the last line
    again = sample(judges=lambda *_: (), progress=Progress(path))
    assert [one.mutant.key for one in again.judged] == [one.mutant.key for one in tally.judged], "the same mutants each time"
    assert [one.by for one in again.judged[:-3]] == [one.by for one in tally.judged[:-3]], "judged before the kill"
    assert {one.by for one in again.judged[-3:]} == {SURVIVED}


def test_a_missing_test_leaves_survivors_each_with_its_line() -> None:
    tally = sample("Python's receiver", "sanitized program")
    survived = [one for one in tally.judged if one.by == SURVIVED]
    assert len(survived) > SAMPLE // 2
    outcome = outcome_of(tally, (), least=1)
    assert outcome.verdict is Verdict.FAILED
    assert len(outcome.findings) == len(survived)
    assert all(finding.startswith(f"4ws2/{E2E}:") and "no test sees it" in finding for finding in outcome.findings)


def judged_by(judge: Judge) -> Tally:
    return campaign(["4ws2"], (E2E,), lambda *_: [judge], 1)


def mutated(case: Case) -> bool:
    return case.mutated is not None and case.mutated.number > 0


def loop(case: Case) -> None:
    started = time.process_time()
    while mutated(case) and time.process_time() >= started:
        pass


def crash(case: Case) -> None:
    if mutated(case):
        os.abort()


def break_the_machine(case: Case) -> None:
    if mutated(case):
        raise OSError("disk full")


def refuse(case: Case) -> None:
    raise AssertionError("always")


def test_a_loop_without_end_and_a_crash_kill_and_a_fault_of_the_machine_or_the_unaltered_c_does_not() -> None:
    for judge, by in ((loop, ["a loop without end"]), (crash, ["SIGABRT"])):
        assert [one.by for one in judged_by(Judge("judge", judge)).judged] == by
    with pytest.raises(RuntimeError, match="disk full"):
        judged_by(Judge("broken", break_the_machine))
    outcome = outcome_of(judged_by(Judge("refuses", refuse)), ())
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings == ("4ws2: unaltered, it fails refuses: AssertionError always",)


def test_a_judge_that_kills_nothing_is_found() -> None:
    blind = Judge("blind", lambda case: None)
    tally = campaign(["4ws2"], (CALIBRATION,), lambda kind, path: [judges_of(kind, path)[0], blind])
    assert tally.powerless == ["blind"]


def made(fates: str) -> Tally:
    """Return a tally by letters: killed, survived."""
    mutants = [Mutant(Key("src/a.c", "f", "deletion", f"x = {k}"), k + 1, 0, "") for k in range(len(fates))]
    judged = [Judged("4ws2", one, "a test" if letter == "k" else SURVIVED) for one, letter in zip(mutants, fates, strict=True)]
    return Tally([("4ws2", one) for one in mutants], judged)


def argued(tally: Tally, *numbers: int) -> list[Equivalent]:
    return [Equivalent("4ws2", tally.judged[number].mutant.key, "no input can tell") for number in numbers]


def test_argued_mutants_may_survive_as_long_as_they_are_few_and_the_list_holds_nothing_else() -> None:
    tally = made("s" + "k" * 39)
    passed = outcome_of(tally, argued(tally, 0), least=40)
    assert (passed.verdict, passed.figure) == (Verdict.PASSED, "39 of 40 mutants killed, 1 equivalent")
    stale = replace(argued(tally, 0)[0], key=Key("src/a.c", "f", "deletion", "y = 1"))
    few = made("sss" + "k" * 18)
    for outcome, finding in (
        (outcome_of(tally, (), 40), "4ws2/src/a.c:1: f: deletion: `x = 0`: no test sees it"),
        (outcome_of(few, argued(few, 0, 1, 2), 20), "3 of 21 are argued to be equivalent: more than 5%"),
        (outcome_of(tally, argued(tally, 0, 5), 40), "`x = 5`: equivalent.toml argues that it is equivalent; a test sees it"),
        (outcome_of(tally, [*argued(tally, 0), stale], 40), "equivalent.toml: there is no such mutant"),
        (outcome_of(tally, argued(tally, 0)), "40 mutants; at least 300 are required"),
    ):
        assert outcome.verdict is Verdict.FAILED
        assert len(outcome.findings) == 1 and finding in outcome.findings[0]


def test_the_list_is_read_and_needs_a_reason_once(tmp_path: Path) -> None:
    path, entry = tmp_path / "equivalent.toml", "'both a f | deletion | x = 1 | 2'"
    path.write_text(f'"It is overwritten before it is read." = [{entry}]\n', encoding="utf-8")
    found = equivalents.read(path)
    assert [(one.build, one.key.occurrence) for one in found] == [("4ws2", 2), ("4ws2-tracking", 2)]
    for text, message in ((f'"because" = [{entry}]\n', "no reason"), (f'"It is not read." = [{entry}, {entry}]\n', "twice")):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=message):
            equivalents.read(path)
