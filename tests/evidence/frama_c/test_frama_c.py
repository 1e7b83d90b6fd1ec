"""EVA raises an alarm for planted faults, and reports what it does not analyse. Run by name; needs Frama-C."""

import dataclasses
import shutil

import pytest

from codegen.verify.check import Subject
from tests.evidence.frama_c import frama_c
from tests.evidence.parts import FOLDERS

pytestmark = pytest.mark.skipif(shutil.which("frama-c") is None, reason="frama-c is not installed")

NO_LIMIT = ("if ((scaled > (float)low) && (scaled < (float)high)) {", "if (scaled > (float)low) {")
FAULTS = {
    "an index without limit": ("reference_model", "if (index >= cells) {", "if (index > cells) {", "mem_access", "curve_at"),
    "a conversion without limit": ("can", *NO_LIMIT, "float_to_int", "to_code"),
    "a loop beyond the frame": ("e2e", "index < 8u", "index <= 8u", "mem_access", "ars_e2e_crc"),
    "a division by zero": ("e2e", "range = counter_max + 1u", "range = counter_max - 14u", "division_by_zero", "check_counter"),
    "a state that is not set": ("limiter", "    self->speed_known = false;\n", "", "initialization", "ars_limiter_step"),
    "a signed overflow": ("can", "code = whole + 1;", "code = whole * 100000;", "signed_overflow", "to_code"),
}
"""Unit, text, replacement, and the kind and function of the alarm."""


def analyse(unit: str, old: str, new: str) -> frama_c.Analysis:
    """Analyse the entry of a unit with a text replaced."""
    subject, path = Subject.read(FOLDERS[1]), f"src/ars_{unit}.c"
    text = subject.files[path].decode("ascii")
    assert old in text
    files = {**subject.files, path: text.replace(old, new).encode("ascii")}
    return frama_c.analyse(frama_c.find_frama_c(), dataclasses.replace(subject, files=files), (unit,))


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_raises_its_alarm(fault: str) -> None:
    *change, kind, function = FAULTS[fault]
    findings = frama_c.outcome_of([analyse(*change)], frama_c.arguments(), "").findings
    alarms = [finding for finding in findings if finding.startswith("4ws2-tracking/src/")]
    assert alarms
    assert all(f": {kind}: " in alarm and f" in {function}(): " in alarm for alarm in alarms), alarms


def test_functions_that_are_not_reached_are_reported() -> None:
    found = analyse("limiter", "", "")
    assert {"to_code", "locate_speed", "ars_task_10ms"} <= set(found.unreached)
    # The controller has a function of the same name as the limiter.
    assert "opposite_phase_bound" not in found.unreached and found.unreached.count("clamp") == 1
