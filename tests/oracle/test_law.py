"""Differences from the second implementation are found. tests/evidence/verify has sound builds of every kind."""

import re
from dataclasses import replace

from codegen.sil.software import compile_build
from codegen.verify.outcomes import Subject
from codegen.verify.unit_drives import Size, UnitDrives
from tests.oracle import states
from tests.oracle.check import check
from tests.oracle.transitions import transition_findings
from tests.verify import builds, planted

PI, TRACKING = builds.made("pi", "uneven"), builds.made("tracking", "uneven")


FEW = Size(60, 300, 3, 2000)


def test_a_wrong_command_default_and_frame_are_found() -> None:
    """Only the first difference of each drive is reported. The frame is wrong although the controller alone is right."""
    path = "src/ars_calibration.c"
    files = builds.with_text(PI, "src/ars_law.c", "= parameters->proportional_gain * error;", "= 0.01f * error;")
    files[path] = builds.with_text(PI, path, ".integral_gain = 1.0f,", ".integral_gain = 1.5f,")[path]
    default, *others = check(Subject("planted", files, PI.manifest), FEW, with_long_drives=False).findings
    assert default == "src/ars_calibration.c: integral_gain is 1.5, not the configuration's 1"
    assert all("; by the law " in each for each in others)
    names = [each.partition(", sample")[0] for each in others if ", sample " in each]
    assert len(set(names)) == len(names)
    assert any(name.startswith("parameter set ") for name in names)
    old, new = "(((uint32_t)ARS_CAUSES_HOLDING >> (uint32_t)cause) & 1u) != 0u", "false"
    files = builds.with_text(PI, "src/ars_task.c", old, new)
    found = check(Subject("planted", files, PI.manifest), replace(FEW, sets=0), with_long_drives=False).findings
    assert found and all(": 0x" in line and "; by the law 0x" in line for line in found)


def test_every_unsound_number_and_a_wrong_mark_are_found() -> None:
    """A build whose step judges neither is wrong in each number that `is_sound` adds up."""
    path = "src/ars_controller.c"
    old = "(self->initialised == (uint32_t)ARS_CONTROLLER_INITIALISED) && (squares <= squares_max)"
    files = builds.with_text(TRACKING, path, old, "(self->initialised != 0u) && ((squares <= squares_max) || true)")
    summed = re.findall(r"squares \+= self->([\w.]+) ", files[path].decode())
    software = compile_build(files, TRACKING.manifest)
    drive = UnitDrives(planted.subject_of(TRACKING), software, Size(0, 600, 0, 0), with_recordings=False).drive_cycle(0)
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
