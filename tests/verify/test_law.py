"""Check `law`: differences from the second implementation are found. tests/evidence/verify has sound builds of every kind."""

import dataclasses
import re

import pytest

from codegen.sil.software import compile_build
from codegen.verify.budgets import bounded_loops
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.law import check as law
from codegen.verify.law import states
from codegen.verify.law.transitions import transition_findings
from codegen.verify.packages import MissingTool
from tests.verify import builds, planted

PI, TRACKING = builds.made("pi", "uneven"), builds.made("tracking", "uneven")


@pytest.fixture
def few_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulate few drives and no long ones, and skip the slow search for endless loops."""
    monkeypatch.setattr(law.LongDrives, "drives", lambda self: iter(()))
    monkeypatch.setattr(law, "SIZE_QUICK", law.Size(60, 300, 3, 2000, all_long_drives=False))
    monkeypatch.setattr(bounded_loops, "complaints", lambda files, manifest: ())


def checked(subject: Subject) -> Outcome:
    return law.check(subject, Effort(quick=True))


@pytest.mark.usefixtures("few_drives")
def test_a_wrong_command_default_and_frame_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the first difference of each drive is reported. The frame is wrong although the controller alone is right."""
    path = "src/ars_calibration.c"
    files = builds.with_text(PI, "src/ars_law.c", "= parameters->proportional_gain * error;", "= 0.01f * error;")
    files[path] = builds.with_text(PI, path, ".integral_gain = 1.0f,", ".integral_gain = 1.5f,")[path]
    found = checked(Subject("planted", files, PI.manifest))
    assert found.verdict is Verdict.FAILED
    default, *others = found.findings
    assert default == "src/ars_calibration.c: integral_gain is 1.5, not the configuration's 1"
    assert all("; by the law " in each for each in others)
    names = [each.partition(", sample")[0] for each in others if ", sample " in each]
    assert len(set(names)) == len(names)
    assert any(name.startswith("parameter set ") for name in names)
    monkeypatch.setattr(law, "drives_of", lambda thresholds, samples: ())
    old, new = "(((uint32_t)ARS_CAUSES_HOLDING >> (uint32_t)cause) & 1u) != 0u", "false"
    found = checked(Subject("planted", builds.with_text(PI, "src/ars_task.c", old, new), PI.manifest))
    assert found.verdict is Verdict.FAILED
    assert all(": 0x" in line and "; by the law 0x" in line for line in found.findings)


def test_every_unsound_number_and_a_wrong_mark_are_found() -> None:
    """A build whose step judges neither is wrong in each number that `is_sound` adds up."""
    path = "src/ars_controller.c"
    old = "(self->initialised == (uint32_t)ARS_CONTROLLER_INITIALISED) && (squares <= squares_max)"
    files = builds.with_text(TRACKING, path, old, "(self->initialised != 0u) && ((squares <= squares_max) || true)")
    summed = re.findall(r"squares \+= self->([\w.]+) ", files[path].decode())
    software = compile_build(files, TRACKING.manifest)
    drive = law._Comparison(planted.subject_of(TRACKING), law.SIZE_QUICK, with_recordings=False)._drive_cycle(0)
    found = {line.partition("goes on with ")[2].partition(" = ")[0] for line in states.soundness_findings(software, drive)}
    assert found == {*summed, "initialised"}


def test_a_wrong_transition_and_memory_without_a_mark_are_found() -> None:
    exception = "(self->state == ARS_SUPERVISION_START)"
    lost = f"({exception} || (self->state == ARS_SUPERVISION_LOST))"
    files = builds.with_text(TRACKING, "src/ars_supervision.c", exception, lost)
    mark = "self->controller.initialised != (uint32_t)ARS_CONTROLLER_INITIALISED"
    task = builds.with_text(TRACKING, "src/ars_task.c", mark, "self->controller.initialised == 0u")
    software = compile_build({**files, "src/ars_task.c": task["src/ars_task.c"]}, TRACKING.manifest)
    (transition,) = transition_findings(software)
    assert transition == "src/ars_supervision.c: from LOST, ANGLE_UNKNOWN leads to START instead of RESYNCHRONISE"
    assert [*states.uninitialised_findings(software)] == ["src/ars_task.c: the task does not start anew with initialised = 0x1"]


def test_reasons_not_to_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def why(subject: Subject) -> str:
        found = checked(subject)
        assert found.verdict is Verdict.NOT_RUN
        (reason,) = found.findings
        return reason

    other = dataclasses.replace(PI, manifest={**PI.manifest, "version": "0.0.9"})
    assert why(planted.subject_of(other)) == (
        "made by codegen 0.0.9, and the second implementation is that of this version; build it again"
    )
    unreadable = planted.limiter(PI, "    result = __extension__ ({ result; });")
    assert why(unreadable).startswith("it cannot be read, and so it might never return: ")
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(MissingTool, match=r"^CC: the compiler 'no-such-compiler' does not exist"):
        checked(planted.subject_of(PI))
