"""The generated code under AddressSanitizer and UndefinedBehaviorSanitizer on this machine, in processes of its own.

One program is compiled. Behind a pipe (see `sanitized`) it runs its self-test, drives from everywhere, look-ups on every road,
every built-in scenario in closed loop, and every fault of the catalogue, whose outcome must be as defined.
Two more processes of it run the fuzz harnesses (see `program`).
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from typing import Any, cast

import numpy as np

from codegen.errors import BuildError
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from codegen.verify import drives
from codegen.verify.drives import Thresholds
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitizers import program, sanitized
from codegen.verify.sanitizers.sanitized import Numbers, ServedEcu, compiled, find_compiler
from hil_sim.bench import run_in_process
from hil_sim.fault_catalogue import run_all
from hil_sim.plant_node import PlantNode

SHOWS = (
    "Scenarios, bus faults, drives and fuzzed inputs cause no invalid address and no undefined behaviour; faults end as "
    "specified, every look-up is a number, and no fuzzed input makes the code exceed a bound or use a damaged frame"
)
LIMITS = (
    "Sanitizers check only the code that the runs reach, as compiled by one compiler. They are not a proof.",
    "Fuzzing tries many inputs, not all. It proves nothing about the others.",
    "The target's own compiler and memory protection are not tested.",
)
FAULTS_NOT_JUDGED = (
    "The fault catalogue was run without checking the outcomes: they are specified for the preset's E2E settings, sampling "
    "time and limits for lost samples, and this build has others."
)

SAMPLES, SAMPLES_QUICK = 20_000, 2_000
"""Samples of each drive; a quarter of it is the number of lookups at each friction."""
INPUTS: dict[program.Name, int] = {"can": 50_000, "step": 100_000}
INPUTS_QUICK = 4_000
"""Inputs of each fuzz harness."""

WIDTH_OF_TARGET = re.compile(rb"\b(long|size_t|ssize_t|u?intptr_t|ptrdiff_t)\b")
"""Types that are wider on this machine than on an ECU, where they overflow earlier."""
COMMENT = re.compile(rb"/\*.*?\*/", re.DOTALL)


def check(subject: Subject, effort: Effort) -> Outcome:
    """Run the suites and the fuzz harnesses. Raises MissingTool: there is no C compiler with sanitizers."""
    compiler = find_compiler()
    tools, fuzzed = {"C compiler with sanitizers": compiler.version}, {}
    try:
        seeds = program.seeds(subject)
        with compiled(compiler, subject.sources(), program.sources(subject), (program.COVERAGE_FLAG,)) as path:
            with sanitized.served(path, subject) as ecu:
                suite_runs = _Suites(subject, effort, ecu)
                for finding in suite_runs.run():
                    suite_runs.findings.append(finding)  # one by one: the program may end at any time
            for name in program.HARNESSES:
                inputs = INPUTS_QUICK if effort.quick else INPUTS[name]
                fuzzed[name] = program.run_harness(path, name, seeds[name], inputs)
    except BuildError as error:
        return Outcome(SHOWS, "not compiled", Verdict.FAILED, (str(error),), limits=LIMITS, tools=tools)
    # Findings of the sanitizers explain those of the drives, so they come first.
    findings = (*_types_of_other_width(subject), *ecu.findings, *suite_runs.findings)
    findings += tuple(finding for _, found in fuzzed.values() for finding in found)
    ran, total = suite_runs.figures, sum(figures["inputs"] for figures, _ in fuzzed.values())
    count = "1 finding" if len(findings) == 1 else f"{len(findings)} findings"
    return Outcome(
        SHOWS,
        f"{count} in {ran['scenarios']} scenarios, {ran['faults']} faults, {ran['steps']:,} steps and {total:,} fuzzed inputs",
        Verdict.FAILED if findings else Verdict.PASSED,
        findings,
        {**ran, "fuzzing": {name: figures for name, (figures, _) in fuzzed.items()}},
        (*LIMITS, *suite_runs.limits),
        tools,
    )


def _types_of_other_width(subject: Subject) -> Iterator[str]:
    """Yield a line for each type whose overflow this machine does not show."""
    for path, content in subject.sources().items():
        code = COMMENT.sub(lambda comment: b"\n" * comment[0].count(b"\n"), content)
        for number, line in enumerate(code.splitlines(), 1):
            for name in WIDTH_OF_TARGET.findall(line):
                yield f"{path}:{number}: the width of {name.decode()} depends on the target"


class _Suites:
    """Runs of the drives, and the faults in their results that sanitizers do not detect."""

    def __init__(self, subject: Subject, effort: Effort, ecu: ServedEcu) -> None:
        self._subject, self._ecu = subject, ecu
        self.figures: dict[str, Any] = {"scenarios": 0, "faults": 0, "steps": 0}
        self.findings: list[str] = []
        self.limits: list[str] = []
        self._thresholds = Thresholds.of(subject.manifest)
        self._config = self._thresholds.config
        self._largest = float(ecu.real(self._config.rear_actuator.angle_max))  # rad, in the precision of the C
        self._samples = SAMPLES_QUICK if effort.quick else SAMPLES

    def run(self) -> Iterator[str]:
        """Run everything and yield a line for each fault."""
        if not self._ecu.selftest():
            yield f"src/{self._subject.prefix}_selftest.c: the self-test fails"
        yield from self._drives()
        yield from self._lookups()
        yield from self._loops()
        yield from self._faults()

    def _drives(self) -> Iterator[str]:
        reached: set[int] = set()
        steps = 0
        for number, drive in enumerate(drives.drives_of(self._thresholds, self._samples)):
            # Includes impossible initial angles; the command is bounded for all of them.
            self._ecu.start((0.0, 0.02, -1e30, math.nan, math.inf)[number % 5])
            commands = self._ecu.drive(drive)
            bad = ~(np.abs(commands["rear_angle"]) <= self._largest) | ~np.isfinite(commands["yaw_rate_reference"])
            for step in np.flatnonzero(bad | (commands["status"] > max(Status)))[:1]:
                yield f"drive {number}, step {step}: {_command(commands[step])} after {_sample(drive[step])}"
            reached |= set(commands["status"].tolist())
            steps += len(drive)
        missing = [status.name for status in Status if status not in reached]
        if missing:
            self.limits.append(f"The drives do not reach the status {', '.join(missing)}.")
        self.figures["steps"] = steps

    def _lookups(self) -> Iterator[str]:
        subject = self._subject
        places = drives.places(self._thresholds, self._samples // 4, subject.precision)
        frictions = drives.road_frictions(self._thresholds, subject.precision)
        accelerations = itertools.cycle(_accelerations(subject.manifest["map"].get("longitudinal_accelerations", [])))
        self.figures["look_ups"] = len(places) * len(frictions)
        for friction, acceleration in zip(frictions, accelerations, strict=False):
            found = np.isfinite(self._ecu.look_up(places, friction, acceleration)).all(axis=0)
            for place in places[~found][:1]:
                at = f"{_sample(place)} on a road of friction {friction:.9g}, at {acceleration:.9g} m/s^2"
                yield f"src/{subject.prefix}_map.c: the look-up at {at} is no number"

    def _loops(self) -> Iterator[str]:
        per_sample = round(self._config.controller.sampling_time_s / self._config.plant.sampling_time_s)
        command_signal = self._config.can.rear_steer_command.real("rear_angle")
        count = 0
        for name, inputs in drives.loops(self._config):
            for through_can in (False, True):
                record = self._ecu.run_loop(inputs, per_sample, through_can=through_can)
                command = record[:, RECORD_COLUMNS.index("rear_angle_command_rad")]
                # In a frame the angle is rounded to its code.
                allowed = self._largest + (command_signal.factor if through_can else 0.0)
                if not (np.abs(command) <= allowed).all() or not np.isfinite(record).all():
                    how = " through CAN frames" if through_can else ""
                    largest = np.abs(command).max()
                    yield f"scenario {name}{how}: the rear angle goes to {largest:.6g} rad, or a signal is no number"
            count += 1
        self.figures["scenarios"] = count

    def _faults(self) -> Iterator[str]:
        ecu = cast(Software, self._ecu)  # a bench uses only its task
        outcomes = run_all(
            self._config, lambda run: run_in_process(PlantNode(self._config, run, precision=self._subject.precision), ecu)
        )
        self.figures["faults"] = len(outcomes)
        if not drives.are_faults_defined_for(self._config):
            self.limits.append(FAULTS_NOT_JUDGED)
            return
        for outcome in outcomes:
            for violation in outcome.violations:
                yield f"fault {outcome.case.name}, {outcome.case.what}: {violation}"


def _command(command: Any) -> str:
    return f"{command['rear_angle']:.9g} rad, reference {command['yaw_rate_reference']:.9g} rad/s, status {command['status']}"


def _sample(sample: Numbers) -> str:
    return "(" + ", ".join(f"{value:.9g}" for value in sample) + ")"


def _accelerations(own: list[float]) -> tuple[float, ...]:
    """Return longitudinal accelerations for the lookup: of the layers, between and beyond them, and invalid ones."""
    if not own:
        return (0.0,)
    between = [0.5 * (low + high) for low, high in itertools.pairwise(own)]
    return (*own, *between, 2.0 * own[0], 2.0 * own[-1], math.nan, math.inf, -math.inf)
