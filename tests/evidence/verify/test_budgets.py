"""Tests of `budgets` that take seconds each."""

from __future__ import annotations

import re

import pytest

from codegen.verify.budgets.measure import measure_step
from codegen.verify.budgets.taken import CYCLE
from tests.verify import planted
from tests.verify.test_budgets import PI, QUICK, make_few, run, sound


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    make_few(monkeypatch)


def test_the_longest_step_is_that_of_the_check() -> None:
    """`codegen tune` and the tests of the placement measure the step alone."""
    found, checked = measure_step(planted.subject_of(PI), QUICK), sound().figures["functions"]["controller_step"]
    assert {"max": found.worst, "mean": round(found.mean, 1)}.items() <= checked["instructions_with_limiter"].items()
    assert 0 < found.worst - found.limiter <= checked["instructions"]["max"]
    assert 0 < found.limiter < found.worst
    assert found.calls == checked["calls"]


def test_stack_that_the_compiler_does_not_know_is_found() -> None:
    hidden = '    __asm__ volatile ("sub sp, #512; str r0, [sp]; add sp, #512" ::: "memory");\n'
    unread, *found = run(planted.started(PI, "ars_limiter_step", hidden), search_loops=True).findings
    assert unread.startswith("src/ars_limiter.c: not plain C99: ")  # assembly may hold a loop
    assert {finding.split(":")[0] for finding in found} == {"limiter_step", "controller_step", CYCLE}
    assert re.search(r"limiter_step: 51\d bytes of stack were used, by the compiler \d+ are the most", found[0])
