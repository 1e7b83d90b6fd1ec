"""Part "planted": each fault, planted in a build, makes just those checks of `codegen verify` fail that are there for it.

Every check runs on every fault, with the effort of a quick run where it has one. A fault stands on one line, so that no line of
deviations.md moves.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.errors import CodegenError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS, Report
from codegen.verify.runner import run as run_checks

SHOWS = "A fault that is planted in the C makes just those checks fail that are there for it"


@dataclass(frozen=True)
class Fault:
    """A fault, and who must find it.

    Attributes:
        unit: of the build, without prefix and ".c".
        old, new: text on one line that stands once in the unit, and what takes its place.
        found_by: names of all the checks that must fail.
    """

    name: str
    unit: str
    old: str
    new: str
    found_by: frozenset[str]


def _fault(name: str, unit: str, old: str, new: str, *found_by: str) -> Fault:
    return Fault(name, unit, old, new, frozenset(found_by))


FAULTS = (
    _fault(
        "a removed clamp",
        "limiter",
        "self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);",
        "self->rear_angle = target;",
        *("law", "proof", "fuzzing"),
    ),
    _fault(
        "a swapped index",
        "map",
        "faster = &table[place->row.lower + 1u][place->column.lower];",
        "faster = &table[place->row.lower][place->column.lower + 1u];",
        *("processor-in-the-loop", "law", "proof", "sanitizers"),
    ),
    _fault("a double literal", "controller", "const float half_turn = 0.5f *", "const float half_turn = 0.5 *", "compiles"),
    _fault(
        "an unpacked byte order",
        "can",
        "data[2] |= (uint8_t)(code & 0xFFu);",
        "data[2] |= ((const uint8_t *)&code)[0];",
        *("processor-in-the-loop", "proof"),
    ),
    _fault(
        "a skipped CRC",
        "e2e",
        "if ((counter > counter_max) || (ars_e2e_crc(data_id, data) != data[0])) {",
        "if ((counter > counter_max) || ((ars_e2e_crc(data_id, data) ^ data[0]) == 0x55u)) {",
        *("law", "sanitizers", "fuzzing"),
    ),
    _fault(
        "a broken invariant",
        "e2e",
        "*counter = (*counter < counter_max) ? (uint8_t)(*counter + 1u) : 0u;",
        "*counter = (uint8_t)(*counter + 1u);",
        *("law", "proof", "sanitizers", "fuzzing"),
    ),
    _fault(
        "a gain of the wrong sign",
        "controller",
        "const float proportional = parameters->proportional_gain * error;",
        "const float proportional = -(parameters->proportional_gain * error);",
        *("law",),
    ),
    _fault(
        "a fail-safe that grows at one speed in millions",
        "controller",
        "self->rear_angle = toward_zero(self->rear_angle, rate * sampling_time);",
        "self->rear_angle = ((speed > 7.77777f) && (speed < 7.77778f)) ? (2.0f * self->rear_angle) "
        ": toward_zero(self->rear_angle, rate * sampling_time);",
        *("proof",),
    ),
    _fault(
        "a CRC that is skipped for one counter and one code",
        "e2e",
        "if ((counter > counter_max) || (ars_e2e_crc(data_id, data) != data[0])) {",
        "if ((counter > counter_max) || ((ars_e2e_crc(data_id, data) != data[0]) && ((data[0] != 0u) || (counter != 3u)))) {",
        *("fuzzing",),
    ),
    _fault(
        "a violation of MISRA C",
        "task",
        "self->cycles = 0u;",
        "self->cycles = self->late_cycles = 0u;",
        *("static-analysis",),
    ),
    _fault(
        "a bloated loop",
        "limiter",
        "self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);",
        "uint32_t k; for (k = 0u; k < 20u; k++) { target = clamp(target, -parameters->rear_angle_max, "
        "parameters->rear_angle_max); } self->rear_angle = target;",
        *("budgets",),
    ),
)

QUICK = frozenset({"a broken invariant"})
"""Planted in a quick run, for one fault takes every check some minutes: this is the one that the most checks must find, four of
eight."""


def run(folders: Sequence[Path], effort: Effort) -> Outcome:
    """Plant each fault in the first of the builds; quick, one of them: each check has faults of its own in its tests."""
    faults = [fault for fault in FAULTS if fault.name in QUICK or not effort.quick]
    subject = Subject.read(folders[0])
    findings: list[str] = []
    told: dict[str, list[str]] = {}
    for fault in faults:
        report = _checked(planted(subject, fault))
        told[fault.name] = sorted(report.failed)
        findings += [
            f"{fault.name}: {name} was not run: {outcome.findings[0]}"
            for name, outcome in report.outcomes.items()
            if outcome.verdict is Verdict.NOT_RUN
        ]
        if frozenset(report.failed) != fault.found_by:
            findings.append(f"{fault.name}: found by {_names(report.failed)} instead of {_names(fault.found_by)}")
    figure = (
        f"{len(faults)} of {len(FAULTS)} faults, each found by its checks and no other"
        if not findings
        else f"{len(findings)} findings"
    )
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    return Outcome(SHOWS, figure, verdict, tuple(findings), {"found_by": told})


def planted(subject: Subject, fault: Fault) -> Subject:
    """The build with the fault. Raises CodegenError: the text is not there once."""
    path = f"src/{subject.prefix}_{fault.unit}.c"
    text = subject.files[path].decode("ascii")
    places = text.count(fault.old)
    if places == 0 or (places > 1 and fault.unit != "can"):
        raise CodegenError(f"the text of {fault.name!r} stands there {places} times", where=path, remedy="plant it elsewhere")
    files = {**subject.files, path: text.replace(fault.old, fault.new).encode("ascii")}
    return dataclasses.replace(subject, files=files, edited=(path,))


def _checked(subject: Subject) -> Report:
    return run_checks(subject, Effort(quick=True), checks=[dataclasses.replace(check, quick=True) for check in CHECKS])


def _names(names: Sequence[str] | frozenset[str]) -> str:
    return ", ".join(sorted(names)) or "none"
