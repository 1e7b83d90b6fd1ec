"""Part "exhaustive": the helpers of one argument, static ones too, for all 2^32 inputs, against what they should compute.

What that is stands in exhaustive_frames.py, exhaustive_control.py and exhaustive_car.py: worked out in double precision, in
whole numbers or bit by bit, from the configuration. The code is compiled as it is, with undefined behaviour told. A function
that takes a number and is neither judged nor argued here fails the part, and so does a claim whose function is gone.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Container, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitizers.sanitized import Compiler, find_compiler
from tests.evidence.exhaustive import exhaustive_car, exhaustive_control, exhaustive_frames
from tests.evidence.exhaustive.exhaustive_helper import Facts, Helper
from tests.evidence.exhaustive.exhaustive_program import Judge, Program, Verdicts, compile_program, judge_of, pieces
from tests.evidence.exhaustive.exhaustive_source import Absent, Judged

SHOWS = "each helper of one argument computes what it should for every input, and nothing that C leaves undefined"
QUICK_STRIDE = 1009
"""Prime, and below the number of floats of one exponent; the inputs around edges are taken whatever the stride."""

TOLD_MAX = 3
"""Wrong inputs that are told of a helper."""

SEVERAL = "takes several numbers that vary: the proof and the tests are there for it"
OTHERS: Mapping[str, str] = {
    "can: error_of": "takes a product and its factors: judged through to_code, for every value of each coding",
    "can: goes_outward": "takes a product and its factors: judged through to_code, for every value of each coding",
    "controller: allowed": SEVERAL,
    "controller: reference_ahead": SEVERAL,
    "controller: reachable_yaw_rate": SEVERAL,
    "controller: feedback_range": SEVERAL,
    "map: place_of": "pairs what locate_speed and locate_front_angle give",
    "map: capped": SEVERAL,
    "map: yaw_rate_at": SEVERAL,
    "map: yaw_rate_on": SEVERAL,
    "map: @_map_yaw_rate_on_road": SEVERAL,
    "map: @_map_yaw_rate": SEVERAL,
    "map: capped_rear_angle": SEVERAL,
    "map: @_map_reference": SEVERAL,
    "reference_model: curve_at": "judged through both curves, for every argument",
    "reference_model: @_reference_model_start": SEVERAL,
}
"""Unit and function that takes a number and has no claim of its own -> why."""


@dataclass
class _Claim:
    """A claim, wherever the same C has it: `places` are units of builds."""

    judge: Judge
    places: list[str] = field(default_factory=list)
    done: list[Verdicts] = field(default_factory=list)

    @property
    def inputs(self) -> int:
        return sum(each.inputs for each in self.done)

    @property
    def wrong(self) -> int:
        return sum(each.wrong for each in self.done)

    @property
    def findings(self) -> list[str]:
        told = list(dict.fromkeys(chain.from_iterable(each.told for each in self.done)))
        if self.wrong and not told:
            told.append("goes wrong where it comes from the input before")
        more = f"; {self.wrong:,} inputs are wrong" if self.wrong else ""
        return [f"{self.places[0]}: {self.judge.name} {text}{more}" for text in told[:TOLD_MAX]]


@dataclass(frozen=True)
class _Planned:
    """A program that is to be made: its unit, and what it judges."""

    subject: Subject
    unit: str
    claims: Sequence[_Claim]

    def compile(self, compiler: Compiler, folder: Path) -> Program:
        return compile_program(compiler, self.subject, self.unit, [claim.judge for claim in self.claims], folder)


def run(folders: Sequence[Path], effort: Effort, only: Container[str] | None = None) -> Outcome:
    """The part of the campaign; quick, it goes through some inputs of each helper, and all that matter most.

    Args:
        folders: the builds.
        effort: how many inputs.
        only: units, without prefix; by default all.

    Raises:
        MissingTool: no C compiler whose sanitizers work. BuildError: a build in double precision.
    """
    compiler = find_compiler()
    findings: list[str] = []
    claims: dict[str, _Claim] = {}
    planned: list[_Planned] = []
    for subject in map(Subject.read, folders):
        helpers, units = _helpers(subject), _units(subject)
        gone = dict.fromkeys(helper.unit for helper in helpers if helper.unit not in units)
        findings += [f"{subject.name}: there is no unit {unit!r}, of which something is claimed" for unit in gone]
        for unit, judged in units.items():
            if only is not None and unit not in only:
                continue
            judges, missing = _judges(unit, judged, [helper for helper in helpers if helper.unit == unit])
            findings += missing
            if new := _new(claims, judges, judged):
                planned.append(_Planned(subject, unit, new))
    _go_through(planned, compiler, QUICK_STRIDE if effort.quick else 1)
    return _outcome(list(claims.values()), findings, compiler)


def _helpers(subject: Subject) -> list[Helper]:
    """Every claim over the helpers of a build."""
    if not subject.is_single:
        raise BuildError("the inputs of a build in double precision cannot be gone through", where=subject.name)
    facts = Facts(subject)
    return [*exhaustive_frames.helpers(facts), *exhaustive_control.helpers(facts), *exhaustive_car.helpers(facts)]


def _units(subject: Subject) -> dict[str, Judged]:
    """By name without prefix."""
    paths = sorted(path for path in subject.sources("src") if path.endswith(".c"))
    return {Path(path).stem.removeprefix(f"{subject.prefix}_"): Judged(path, subject) for path in paths}


def _judges(unit: str, judged: Judged, helpers: Sequence[Helper]) -> tuple[list[Judge], list[str]]:
    """The claims over a unit, and what keeps others from being judged."""
    found, missing = [], []
    known = {name.removeprefix(f"{unit}: ") for name in OTHERS if name.startswith(f"{unit}: ")}
    for helper in helpers:
        known.add(helper.function)
        try:
            found.append(judge_of(helper, judged))
        except Absent as error:
            missing.append(f"{judged.subject.name}/{error}: {helper.function} cannot be judged")
    names = {name.replace("@", judged.subject.prefix) for name in known}
    missing += [
        f"{judged.subject.name}/{judged.path}: {function.name}() takes a number and is neither judged nor argued"
        for function in judged.functions.values()
        if function.takes_number and function.name not in names
    ]
    return found, missing


def _new(claims: dict[str, _Claim], judges: Sequence[Judge], judged: Judged) -> list[_Claim]:
    """Those that no build before made; the others are noted for this one too."""
    new = []
    for judge in judges:
        if judge.key not in claims:
            claims[judge.key] = _Claim(judge)
            new.append(claims[judge.key])
        claims[judge.key].places.append(f"{judged.subject.name}/{judged.path}")
    return new


def _go_through(planned: Sequence[_Planned], compiler: Compiler, stride: int) -> None:
    """As many programs at a time as there are processors; what came of them is put into the claims."""
    with tempfile.TemporaryDirectory(prefix="ars-exhaustive-") as scratch, ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        compiled = [pool.submit(each.compile, compiler, Path(scratch, str(k))) for k, each in enumerate(planned)]
        going = [
            (claim, pool.submit(program.result().go_through, index, *piece))
            for each, program in zip(planned, compiled, strict=True)
            for index, claim in enumerate(each.claims)
            for piece in pieces(claim.judge, stride)
        ]
        for claim, done in going:
            claim.done.append(done.result())


def _outcome(claims: Sequence[_Claim], findings: Sequence[str], compiler: Compiler) -> Outcome:
    told = [*findings, *chain.from_iterable(claim.findings for claim in claims)]
    if not claims:
        told.append("nothing was judged")
    floats = [claim for claim in claims if claim.judge.floats]
    few = [claim for claim in claims if not claim.judge.floats]
    each = min((claim.inputs for claim in floats), default=0)
    figure = f"{len(floats)} helpers x {each:,} inputs, {sum(claim.wrong for claim in floats):,} wrong"
    if few:
        inputs, wrong = sum(claim.inputs for claim in few), sum(claim.wrong for claim in few)
        figure += f"; {len(few)} of whole numbers, {inputs:,} inputs in all, {wrong:,} wrong"
    return Outcome(
        SHOWS,
        figure,
        Verdict.FAILED if told else Verdict.PASSED,
        tuple(told),
        {f"{claim.places[0]}: {claim.judge.name}": _figures(claim) for claim in claims},
        tools={"cc": compiler.version},
    )


def _figures(claim: _Claim) -> dict[str, Any]:
    same = {"same_c_in": claim.places[1:]} if claim.places[1:] else {}
    return {"claim": claim.judge.claim, "inputs": claim.inputs, "wrong": claim.wrong, **same}
