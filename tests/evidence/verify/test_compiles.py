"""Tests of `compiles` that take seconds each."""

from __future__ import annotations

import re

import pytest

from codegen.verify.check import Verdict
from codegen.verify.compilation import check as compiles
from tests.verify.test_compiles import c_function, checked, with_more


@pytest.mark.usefixtures("no_mixtures")
def test_functions_that_a_target_may_lack_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The code is free of warnings: every conversion is explicit and every function is declared."""
    monkeypatch.setattr(compiles, "by_gcc", lambda *given: ())
    outcome = checked(
        with_more(
            limiter=c_function("float ars_half(float x)", "return (float)((double)x * 0.1);"),
            e2e="float sinf(float x);\n" + c_function("float ars_sine(float x)", "return sinf(x);"),
            dynamics="float expf(float x);\n" + c_function("float ars_power(float x)", "return expf(x);"),
            task=c_function("void ars_clear(float *x)", "*x = 0.0f;"),
        )
    )
    assert outcome.verdict is Verdict.FAILED
    everywhere = "which a bare target need not have (x86-64, Cortex-M4F)"
    needs = {finding for finding in outcome.findings if ": needs " in finding}
    assert {
        "src/ars_limiter.c: needs __aeabi_dmul, double precision (Cortex-M4F)",
        f"src/ars_e2e.c: needs sinf, {everywhere}",
        f"src/ars_dynamics.c: needs expf, {everywhere}",
    } <= needs
    assert all(re.match(r"src/ars_(limiter|e2e|dynamics)\.c: ", finding) for finding in needs)
    assert set(outcome.findings) - needs == {"include/: no header declares ars_clear"}
