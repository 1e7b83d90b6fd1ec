"""Tests of `fuzzing` that take seconds each."""

from __future__ import annotations

import pytest

from codegen.verify.check import Verdict
from codegen.verify.fuzzing import check as fuzzing
from tests.verify import planted
from tests.verify.test_fuzzing import TRACKING, checked


def test_an_input_that_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzzing, "SECONDS_MAX", 1.0)
    monkeypatch.setattr(fuzzing, "HARNESSES", ("step",))
    outcome = checked(planted.limiter(TRACKING, "    while (input->demand > 0.05f) {\n        result += 0.0f;\n    }"))
    assert (outcome.findings, outcome.verdict) == (("step: an input does not end",), Verdict.FAILED)
