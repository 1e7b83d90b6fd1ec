"""Check `processor-in-the-loop`: an emulated core gives the same bits as this machine, and a failing self-test is found."""

import itertools
from dataclasses import replace

import pytest

from codegen.verify import bounded_loops
from codegen.verify import emulated_runs as pil
from codegen.verify.emulated_runs import streams
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.target import CORTEX_M4F, POWERPC_BE, Core
from tests.verify import builds, planted

STEPS = 1_500
"""Enough for the tour through every status and some of the other steps."""
PI = builds.made("pi", "uneven")


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run few steps on the big-endian core only. One test covers the dynamics, which have separate images."""
    monkeypatch.setattr(pil, "QUICK_STEPS", STEPS)
    monkeypatch.setattr(pil, "CORES", {True: (POWERPC_BE,), False: (POWERPC_BE,)})


@pytest.fixture
def no_dynamics(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the dynamics and the search for endless loops."""
    monkeypatch.setattr(pil, "_dynamics", lambda *given: {})
    monkeypatch.setattr(bounded_loops, "complaints", lambda files, manifest: ())


def on(monkeypatch: pytest.MonkeyPatch, core: Core) -> None:
    monkeypatch.setattr(pil, "CORES", {True: (core,)})


def checked(subject: Subject) -> Outcome:
    return pil.check(subject, Effort(quick=True))


@pytest.mark.long
def test_a_build_has_the_same_bits_on_a_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """This runs the whole check with few steps."""
    on(monkeypatch, CORTEX_M4F)
    for name, value in {"STEPS": STEPS, "QUICK_STEPS": STEPS - 1, "RECORDINGS": 1}.items():
        monkeypatch.setattr(pil, name, value)
    found = pil.check(planted.subject_of(PI), Effort())
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)
    rows = found.figures["rows"]
    assert rows["random steps"] == STEPS
    assert min(rows["scenario step-steer"], rows["recorded scenarios"]) > 1_000
    assert min(found.figures["statuses"].values()) > 0
    assert found.figure == f"0 mismatches in {STEPS:,} steps and {sum(rows.values()) - STEPS:,} other calls on 1 core"
    (dynamics,) = found.figures["dynamics"].values()
    assert 0.0 < dynamics["share_of_bound"] < 1.0
    assert dynamics["library_ulps"] <= 2


@pytest.mark.usefixtures("no_dynamics")
def test_a_failing_self_test_and_an_unreached_status_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    on(monkeypatch, CORTEX_M4F)
    monkeypatch.setattr(pil, "streams", lambda *given: itertools.islice(streams(*given), 1))  # the controller alone
    body = "    uint32_t crc = planted_ars_map_crc(start);\n#ifdef __thumb__\n    crc ^= 1u;\n#endif\n    return crc;"
    files = builds.with_text(
        PI, "src/ars_controller.c", "? ARS_STATUS_LIMITED : ARS_STATUS_TRACKING", "? ARS_STATUS_LIMITED : ARS_STATUS_LIMITED"
    )
    found = checked(planted.wrapped(replace(PI, files=files), "ars_map_crc", body))
    assert found.findings == (
        "the random steps never reach the status TRACKING",
        "Cortex-M4F: the self-test of the build fails",
    )
    assert found.verdict is Verdict.FAILED
