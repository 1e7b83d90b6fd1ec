"""Tests of `law` that take seconds each."""

from __future__ import annotations

import dataclasses
import json

import pytest

from codegen.sil.software import Status
from codegen.verify.check import Effort, Verdict
from codegen.verify.drives import recorded
from codegen.verify.law import check as law
from tests.verify import planted
from tests.verify.test_law import FEW, PI, checked, clean


def test_what_a_quick_check_drives() -> None:
    found = clean()
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)
    assert found.limits == law.LIMITS, "every status is reached, and every parameter takes other values than its default"
    assert min(found.figures["statuses"].values()) > 0
    assert set(found.figures["statuses"]) == {status.name for status in Status}
    assert found.figures["samples"] == sum(found.figures["statuses"].values())
    assert found.figures["task_cycles"] > law.SIZE_QUICK.cycles + 3 * law.SIZE_QUICK.course, "and a whole scenario"
    assert json.dumps(found.figures)
    samples, drives, cycles = (found.figures[name] for name in ("samples", "drives", "task_cycles"))
    assert found.figure == (
        f"0 findings in {samples:,} samples of {drives} drives, {law.SIZE_QUICK.sets} of them with other parameters, and "
        f"{cycles:,} cycles of the task"
    )


def test_a_whole_check_drives_the_recordings_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(law, "SIZE", FEW)
    monkeypatch.setattr(law, "recorded", lambda software: recorded(software)[:2])
    found = law.check(planted.subject_of(PI), Effort())
    assert found.verdict is Verdict.PASSED
    assert found.figures["drives"] == clean().figures["drives"] - law.SIZE_QUICK.sets + FEW.sets + 2


@pytest.mark.usefixtures("few")
def test_an_invalid_status_and_rejected_defaults_are_found() -> None:
    text = planted.source(PI, "ars_controller").replace("command.status = self->status;", "command.status = (ars_status_t)7;")
    folder = dataclasses.replace(PI, files=planted.subject_of(PI, ars_controller=text).files)
    found = checked(planted.wrapped(folder, "ars_parameters_valid", "    (void)parameters;\n    return false;"))
    assert found.verdict is Verdict.FAILED
    assert any("a status is none: 7 is not a valid Status" in finding for finding in found.findings)
    assert "src/ars_calibration.c: the C refuses its own default parameters" in found.findings
