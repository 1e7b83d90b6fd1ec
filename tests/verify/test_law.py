"""Check `law`: every kind is its second implementation, and differences are found."""

from __future__ import annotations

import dataclasses
import functools

import pytest

from codegen.config import Kind
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.law import check as law
from codegen.verify.law import kinds
from codegen.verify.packages import MissingTool
from tests.verify import builds, planted

PI, TRACKING = builds.made("pi", "uneven"), builds.made("tracking", "uneven")
FEW = law.Size(drive=60, course=300, sets=3, cycles=200)
"""Enough for the planted faults."""


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drive little, and leave out the search for endless loops, which takes longest."""
    monkeypatch.setattr(law, "SIZE_QUICK", FEW)
    monkeypatch.setattr("codegen.verify.on_host.complaints", lambda files, manifest: ())


def checked(subject: Subject) -> Outcome:
    return law.check(subject, Effort(quick=True))


@functools.cache
def clean() -> Outcome:
    return checked(planted.subject_of(PI))


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("kind", ["tracking"])
def test_every_kind_is_its_law(kind: Kind) -> None:
    found = checked(planted.subject_of(builds.made(kind, "uneven")))
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)
    assert min(found.figures["statuses"].values()) > 0


@pytest.mark.usefixtures("few")
def test_a_wrong_command_and_a_wrong_default_are_found() -> None:
    files = builds.with_text(PI, "src/ars_controller.c", "= parameters->proportional_gain * error;", "= 0.01f * error;")
    path = "src/ars_calibration.c"
    files[path] = builds.with_text(PI, path, ".integral_gain = 1.0f,", ".integral_gain = 1.5f,")[path]
    found = checked(Subject("planted", files, PI.manifest))
    assert found.verdict is Verdict.FAILED
    default, *others = found.findings
    assert default == "src/ars_calibration.c: integral_gain is 1.5, not the configuration's 1"
    assert found.figure.startswith(f"{len(found.findings)} findings in ")
    assert others
    assert all(", sample " in each and "; by the law " in each for each in others if "cycle" not in each)
    names = [each.partition(", sample")[0] for each in others if ", sample" in each]
    assert len(set(names)) == len(names), "only the first difference of a drive is reported"
    assert any(name.startswith("parameter set ") for name in names)


@pytest.mark.usefixtures("few")
def test_a_wrong_frame_of_the_task_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller alone is right, and is not driven."""
    monkeypatch.setattr(law.suites, "drives", lambda ground, samples: ())
    old, new = "measurement.inhibit = self->conditions.inhibit;", "measurement.inhibit = false;"
    found = checked(Subject("planted", builds.with_text(PI, "src/ars_task.c", old, new), PI.manifest))
    assert found.verdict is Verdict.FAILED
    assert found.findings
    assert all(": it sends 0x" in line and "; by the law 0x" in line for line in found.findings)


CLAMP = "    self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);"


def test_reasons_not_to_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def why(subject: Subject) -> str:
        found = checked(subject)
        assert found.verdict is Verdict.NOT_RUN
        (reason,) = found.findings
        return reason

    other = dataclasses.replace(PI, manifest={**PI.manifest, "version": "0.0.9"})
    assert why(planted.subject_of(other)) == (
        "made by codegen 0.0.9: the law that is known here is that of this one; build it again"
    )
    files = builds.with_text(PI, "src/ars_limiter.c", CLAMP, f"    target = __extension__ ({{ target; }});\n{CLAMP}")
    assert why(Subject("planted", files, PI.manifest)).startswith("it cannot be read, and so it might never return: ")
    monkeypatch.setattr(law, "SECOND", {kind: make for kind, make in kinds.SECOND.items() if kind != "pi"})
    assert why(planted.subject_of(PI)) == "nobody has written the kind pi a second time: codegen/verify/law/kinds.py"
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(MissingTool, match=r"^CC: the compiler 'no-such-compiler' does not exist"):
        checked(planted.subject_of(PI))


def test_c_that_does_not_compile_fails() -> None:
    found = checked(planted.subject_of(PI, ars_limiter="this is no C;\n"))
    assert (found.verdict, found.figure) == (Verdict.FAILED, "the C does not run")
