"""Frama-C's EVA as a part of the campaign: which faults raise an alarm, what may be argued, what is told as not analysed."""

from __future__ import annotations

import dataclasses
import shutil

import pytest

from codegen.errors import BuildError
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.frama_c import frama_c
from tests.evidence.frama_c.frama_c import Alarm, Analysis, Argument
from tests.evidence.part import FOLDERS

PI, TRACKING = FOLDERS
needs_frama_c = pytest.mark.skipif(shutil.which("frama-c") is None, reason="frama-c is not installed")

FAULTS = {
    # unit, text, what takes its place, kind of the alarm, function that it is in
    "an index that is not limited": (
        "reference_model",
        "if (index >= cells) {",
        "if (index > cells) {",
        "mem_access",
        "curve_at",
    ),
    "a conversion that is not limited": (
        "can",
        "if ((scaled > (float)low) && (scaled < (float)high)) {",
        "if (scaled > (float)low) {",
        "float_to_int",
        "to_code",
    ),
    "a loop beyond the frame": ("e2e", "index < 8u", "index <= 8u", "mem_access", "ars_e2e_crc"),
    "a division by zero": ("e2e", "range = counter_max + 1u", "range = counter_max - 14u", "division_by_zero", "check_counter"),
    "a state that is not set": ("limiter", "    self->speed_known = false;\n", "", "initialization", "ars_limiter_step"),
    "an overflow of a signed number": ("can", "code = whole + 1;", "code = whole * 100000;", "signed_overflow", "to_code"),
}

ALARM = Alarm("src/ars_map.c", 7, "f", "a = b;", "b > 0", "mem_access", False)
ARGUMENT = Argument(unit="map", function="f", statement="a = b;", claim="b > 0", reason="it is")


def changed(subject: Subject, unit: str, old: str, new: str) -> Subject:
    """The build with another text in a unit."""
    path = f"src/{subject.prefix}_{unit}.c"
    text = subject.files[path].decode("ascii")
    assert old in text
    return dataclasses.replace(subject, files={**subject.files, path: text.replace(old, new).encode("ascii")})


def analysis(*alarms: Alarm, unreached: tuple[str, ...] = ()) -> Analysis:
    """As if it had been made."""
    return Analysis("4ws2", "ars", alarms, 10, 100, 90, (), unreached, ("map",))


@needs_frama_c
def test_a_committed_build_raises_only_alarms_that_are_argued() -> None:
    outcome = frama_c.run([PI], Effort())
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert outcome.figure.startswith("3 alarms, 3 of them argued to be false; 91 of 91 functions, ")
    figures = outcome.figures["4ws2"]
    # EVA works constants out: of the self-test the branches for wrong sums are dead, of the map's judge those for bad tables.
    judges = {"ars_parameters_valid", "ars_map_valid", "are_between", "are_even", "are_increasing"}
    assert set(figures["partly_reached"]) <= {"ars_selftest", "crc_is_right", *judges}
    assert figures["statements"] > 1_000


@needs_frama_c
@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_raises_its_alarm(fault: str) -> None:
    unit, old, new, kind, function = FAULTS[fault]
    subject = changed(Subject.read(TRACKING), unit, old, new)
    found = frama_c.analyse(frama_c.find_frama_c(), subject, (unit,))
    findings = [
        finding
        for finding in frama_c.outcome_of([found], frama_c.arguments(), "").findings
        if finding.startswith("4ws2-tracking/") or "not analysed" not in finding
    ]
    alarms = [finding for finding in findings if finding.startswith("4ws2-tracking/src/")]
    assert alarms
    assert all(f": {kind}: " in alarm and f" in {function}(): " in alarm for alarm in alarms), alarms


@needs_frama_c
def test_functions_that_are_not_reached_are_told() -> None:
    found = frama_c.analyse(frama_c.find_frama_c(), Subject.read(PI), ("limiter",))
    assert {"to_code", "locate_speed", "ars_task_10ms"} <= set(found.unreached)
    assert "opposite_phase_bound" not in found.unreached
    # One of the two: the controller has its own.
    assert found.unreached.count("clamp") == 1


@needs_frama_c
def test_c_that_it_does_not_take_is_told() -> None:
    with pytest.raises(BuildError, match=r"4ws2/src/ars_e2e.c:\d+: Frama-C does not take the C: syntax error"):
        frama_c.analyse(frama_c.find_frama_c(), changed(Subject.read(PI), "e2e", "uint32_t index;", "uint32_t index"))


def test_a_public_function_without_an_entry_is_told() -> None:
    subject = Subject.read(PI)
    header = "include/ars_limiter.h"
    text = subject.files[header].replace(b"#ifdef __cplusplus\n}", b"void ars_limiter_new(int value);\n#ifdef __cplusplus\n}")
    changed_subject = dataclasses.replace(subject, files={**subject.files, header: text})
    with pytest.raises(BuildError, match=r"no entry of frama_c.c.j2 calls ars_limiter_new\(\)"):
        frama_c.driver_of(changed_subject)


def test_an_alarm_counts_unless_it_is_argued() -> None:
    outcome = frama_c.outcome_of([analysis(ALARM)], [], "25")
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings == ("4ws2/src/ars_map.c:7: possible: mem_access: b > 0 in f(): `a = b;`",)
    argued = frama_c.outcome_of([analysis(ALARM)], [ARGUMENT], "25")
    assert argued.verdict is Verdict.PASSED
    assert argued.figure == "1 alarms, 1 of them argued to be false; 10 of 10 functions, 90 of 100 statements; Frama-C 25"
    assert argued.figures["4ws2"]["alarms"] == list(outcome.findings)


@pytest.mark.parametrize("field", ["unit", "function", "statement", "claim"])
def test_an_argument_is_for_one_alarm_alone(field: str) -> None:
    other = ARGUMENT.model_copy(update={field: "map2" if field == "unit" else "other"})
    assert len(frama_c.outcome_of([analysis(ALARM)], [ARGUMENT, other], "").findings) == (0 if field == "unit" else 1)
    assert frama_c.outcome_of([analysis(ALARM)], [other], "").verdict is Verdict.FAILED


def test_what_is_certain_cannot_be_argued_away() -> None:
    certain = dataclasses.replace(ALARM, certain=True)
    (finding, *_) = frama_c.outcome_of([analysis(certain)], [ARGUMENT], "").findings
    assert ":7: certain: " in finding


def test_an_argument_without_its_alarm_is_told() -> None:
    outcome = frama_c.outcome_of([analysis()], [ARGUMENT], "")
    assert outcome.findings == ("frama_c.toml: map: f: `b > 0` is argued to be a false alarm, and is none",)
    # A build may lack the unit.
    elsewhere = ARGUMENT.model_copy(update={"unit": "reference_model"})
    assert frama_c.outcome_of([analysis()], [elsewhere], "").verdict is Verdict.PASSED


def test_what_is_not_analysed_is_told() -> None:
    outcome = frama_c.outcome_of([analysis(unreached=("g",))], [], "")
    assert (outcome.findings, outcome.verdict) == (("4ws2: g() is not analysed",), Verdict.FAILED)
    assert "9 of 10 functions" in outcome.figure
    assert frama_c.outcome_of([], [], "").verdict is Verdict.FAILED


def test_without_frama_c_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingTool, match=r"frama-c: it is not installed"):
        frama_c.run([PI], Effort())
