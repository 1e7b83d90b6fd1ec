"""The check "proof" of `codegen verify`: what is claimed of the shipped files, and what came of it."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from codegen.ecu_map.storage import RAW_MAX
from codegen.emit.map_view import FRONT_ANGLE_TOP, SPEED_TOP, TABLE_RANGES
from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool, module
from codegen.verify.proof.obligations import Widened

if TYPE_CHECKING:
    from codegen.verify.proof.executor import Executor

SHOWS = (
    "For every input, every valid parameter set, any table in its range and every state that the invariant allows, "
    "the invariant is kept, commands are finite and within their limit, and indices, conversions and divisions are defined"
)
MAP = {
    "yaw_rate_table": Widened(*TABLE_RANGES["yaw_rate"]),
    "rear_angle_table": Widened(*TABLE_RANGES["rear_angle"]),
    "speed_breakpoints": Widened(0.0, SPEED_TOP, is_increasing=True),
    "front_angle_breakpoints": Widened(0.0, FRONT_ANGLE_TOP, is_increasing=True),
}
"""What the map may be calibrated to: rad/s, rad, m/s and rad. The same numbers stand in the C's `..._map_valid`."""

RAW = {"yaw_rate_table": Widened(0, RAW_MAX), "rear_angle_table": Widened(0, 2**16 - 1)}
"""The same of tables of raw numbers, whose values are within that range then: 16 bits, read without a sign. The C's
`..._map_valid` lets no negative yaw rate through."""

LIMITS = (
    "The proof uses the semantics of the C standard with rounding to nearest; the compiled code is the subject of the "
    "processor in the loop.",
    "It covers include/ and src/ as preprocessed for a Cortex-M4F, with the type sizes of that core; example/ and linux/ are "
    "not covered.",
    "It assumes that pointers are valid, that the arguments of a public function do not overlap, that one call at a time uses "
    "a state, that `inhibit` is true or false, and that calibration does not change during a call. For calls between the "
    "functions of the build, pointers and overlap are proved.",
    "Termination is proved only for loops with a fixed count; other loops are rejected.",
    "It is not proved that every double converted to single precision (in the dynamics) is within its range.",
    "It holds for any map that `..._map_valid` accepts: increasing breakpoints, and numbers from "
    + ", ".join(f"{range_.low:g} to {range_.high:g} ({name})" for name, range_ in MAP.items())
    + ". That `..._map_valid` rejects any other map is tested cell by cell.",
    "Products and quotients are represented by their bounds alone. The quality of control is not a subject of the proof.",
)


def check(subject: Subject, effort: Effort) -> Outcome:
    """Prove what there is to prove; `effort` changes nothing.

    Raises:
        MissingTool: `z3-solver` or `ziglang` is not installed.
    """
    del effort
    z3 = module("z3", "z3-solver")
    tools = {"z3": str(z3.get_version_string())}
    if not subject.is_single:
        return Outcome(SHOWS, "", Verdict.NOT_RUN, ("the proof is of single precision",), limits=LIMITS, tools=tools)
    from codegen.verify.proof.claims import CLAIMED
    from codegen.verify.proof.executor import Executor
    from codegen.verify.proof.session import Session
    from codegen.verify.proof.solver import Answer
    from codegen.verify.proof.source import CannotJudge, ParsedProgram

    hashes = {path: subject.sha256(path) for path in sorted(subject.sources())}
    try:
        program = ParsedProgram.read(subject.sources())
        findings = [
            f"no function {subject.prefix}_{name}: what is claimed of it is not shown"
            for name in CLAIMED
            if program.public(f"{subject.prefix}_{name}") is None
        ]
        sampling_time = float(subject.manifest["configuration"]["controller"]["sampling_time_s"])
        ranges = MAP | (RAW if "storage" in subject.manifest["map"] else {})
        machine = Executor(program, {f"{subject.prefix}_map_{name}": range_ for name, range_ in ranges.items()})
        report = Session(machine, subject.prefix, sampling_time).run()
    except MissingTool:
        raise
    except BuildError as error:
        return Outcome(SHOWS, "could not be completed", Verdict.FAILED, (str(error),), limits=LIMITS, tools=tools)
    except CannotJudge as error:
        finding = f"{error.place}: cannot be judged: {error.what}"
        return Outcome(SHOWS, "could not be completed", Verdict.FAILED, (finding,), limits=LIMITS, tools=tools)
    findings += [*_outside(machine), *report.troubles]
    for function, verdict in report.verdicts:
        if verdict.answer is not Answer.PROVED:
            obligation = verdict.obligation
            inputs = ", ".join(f"{name} {value}" for name, value in verdict.inputs[:12])
            told = f"{obligation.place}: {function}: {verdict.answer}: {obligation.kind}: {obligation.text}"
            findings.append(f"{told}; with {inputs}" if inputs else told)
    proved = sum(verdict.answer is Answer.PROVED for _, verdict in report.verdicts)
    kinds = Counter(str(verdict.obligation.kind) for _, verdict in report.verdicts)
    return Outcome(
        SHOWS,
        f"{proved} of {len(report.verdicts)} obligations proved",
        Verdict.FAILED if findings else Verdict.PASSED,
        tuple(findings),
        {
            "obligations": dict(sorted(kinds.items())),
            "proved": proved,
            "invariants": {name: found.words() for name, found in sorted(report.invariants.items())},
            "sha256": hashes,
        },
        LIMITS,
        tools,
    )


def _outside(machine: Executor) -> list[str]:
    """Describe the shipped tables with numbers outside the range that the proof is for."""
    return [
        f"{name}: numbers from {min(table.values):g} to {max(table.values):g}, the proof is for {table.low:g} to {table.high:g}"
        for table in machine.tables
        if table.is_free and not (min(table.values) >= table.low and max(table.values) <= table.high)
        for name in (table.name.rpartition("_map_")[2],)
    ]
