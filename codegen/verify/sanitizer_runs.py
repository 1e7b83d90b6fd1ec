"""The generated code under AddressSanitizer and UndefinedBehaviorSanitizer on this machine, in processes of its own.

One program is compiled: the C around the generated code, a server, the plant, the closed loop and two fuzz harnesses. Behind a
pipe (see `sanitized`) it runs its self-test, drives from everywhere, look-ups on every road, every built-in scenario in closed
loop, and every fault of the catalogue, whose outcome must be as defined. Two more processes of it run the fuzz harnesses of
reception and step, which also work with libFuzzer. The driver of the harnesses works with every compiler and follows coverage
too. Each run has a fixed number of inputs, the same each time.
"""

from __future__ import annotations

import itertools
import math
import re
import struct
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from codegen.configuration import Config
from codegen.configuration.can import Can, RealSignal
from codegen.configuration.signals import CARRIED
from codegen.emit.can_view import task_view
from codegen.emit.controller_view import ESTIMATE_FACTOR, REFERENCE_OVERSHOOT
from codegen.emit.laws import LAWS
from codegen.emit.render import render, verbatim
from codegen.emit.text import c_type, literal, numpy_type
from codegen.errors import BuildError
from codegen.sil.software import RECORD_COLUMNS, Software, Status, bench_sources
from codegen.verify import drives, sanitized
from codegen.verify.drives import Samples, Thresholds, recordings
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitized import Numbers, ServedEcu, compiled, find_compiler, findings_of, run_sanitized
from hil_sim.bench import run_in_process
from hil_sim.codec import Frame
from hil_sim.fault_catalogue import run_all
from hil_sim.plant_node import PlantNode

Name = Literal["can", "step"]
HARNESSES: tuple[Name, ...] = ("can", "step")

COVERAGE_FLAG = "-fsanitize-coverage=trace-pc"
"""Flag with which the sanitized code reports its edges to the driver."""


def sources(subject: Subject) -> dict[str, bytes]:
    """Return the C of the program."""
    return {
        **bench_sources(subject.config, subject.prefix, subject.precision),
        **{f"fuzz_{name}.c": harness(subject, name, f"fuzz_{name}") for name in HARNESSES},
        "fuzz_main.c": verbatim("verify/fuzz_main.c"),
        "served_ecu.c": render("verify/served_ecu.c.j2", _context(subject)),
    }


def harness(subject: Subject, name: Name, entry: str = "LLVMFuzzerTestOneInput") -> bytes:
    """Return the C of a harness, with the name of its function."""
    return render(f"verify/fuzz_{name}.c.j2", {**_context(subject), "entry": entry})


def _context(subject: Subject) -> dict[str, Any]:
    config, facts, precision = subject.config, subject.manifest["map"], subject.precision
    own_cap = facts["lateral_acceleration_cap_m_s2"]
    law, real, cap = LAWS[subject.kind], numpy_type(precision), max(facts.get("lateral_acceleration_caps_m_s2", [own_cap]))
    numbers = {
        "sampling_time": config.controller.sampling_time_s,
        "plant_step": config.plant.sampling_time_s,
        "actuator_angle_max": float(real(config.rear_actuator.angle_max)),
        "cap": cap,
        "cap_per_friction": (ESTIMATE_FACTOR if law.uses_reference_model else 1.0) * cap / facts["frictions"][0],
        "overshoot": REFERENCE_OVERSHOOT if law.uses_reference_model else 1.0,
        "rounding": 8.0 * float(np.finfo(real).eps),
        "smallest": float(np.finfo(real).smallest_subnormal),
    }
    return {
        "build": {"prefix": subject.prefix, "PREFIX": subject.prefix.upper()},
        "real": c_type(precision),
        "law": law,
        "task": task_view(config),
        "can": config.can,
        "frame_bytes": config.can.frame_bytes,
        "used_bits": _used_bits(config.can),
        "signals": tuple(_reals(config)),
        "measured": config.can.measured,
        "carried": CARRIED,
        "beside": (*(signal for signal in config.can.measured if signal.is_extra), *CARRIED),
        "takes_acceleration": any(signal.is_extra for signal in config.can.measured),
        "stacked": len(facts["frictions"]) > 1,
        "moving": "longitudinal_accelerations" in facts,
        "with_rear_angle": law.uses_rear_angle,
        "with_model": law.uses_reference_model,
        **{key: literal(value, "double") for key, value in numbers.items()},
    }


def _used_bits(can: Can) -> tuple[int, ...]:
    """Return a mask of the used bits of each byte of the command."""
    message = can.rear_steer_command
    signals = {bit for signal in message.signals().values() for bit in signal.bits(message.byte_order)}
    used = sum(1 << bit for bit in can.e2e.definition.header_bits | signals)
    return tuple(used.to_bytes(can.frame_bytes, "little"))


def _reals(config: Config) -> Iterator[tuple[str, str, RealSignal]]:
    """Yield struct in the harness, field and layout of each scaled signal."""
    names = {"vehicle_motion": "motion", "vehicle_conditions": "conditions", "rear_steer_command": "command"}
    for role, message in config.can.messages().items():
        for name, signal in message.signals().items():
            if isinstance(signal, RealSignal):
                yield names[role], name, signal


SEED_SAMPLES = 24
"""Samples of each recording: short enough to be mutated everywhere, long enough for every status."""

INPUT_BYTES_MAX = 2048
"""Longest input in bytes, as in `fuzz_main.c`."""

SEED = 1
"""Seed of the mutations."""
SECONDS_MAX = 600.0
"""Time limit of a harness in s, many times what all inputs take."""

_AT_INPUT = re.compile(r"^at input (\d+)$", re.MULTILINE)


def seeds(subject: Subject) -> dict[Name, tuple[bytes, ...]]:
    """Return seed inputs for both harnesses: the bus traffic of a car without rear steering in the built-in scenarios,
    unchanged and with faults.

    Faults are damaged frames, gaps, values no sensor sends, and changed parameters.

    Raises:
        BuildError: the C of the simulated car does not compile here.
    """
    recorded = list(recordings(subject.config, subject.precision, SEED_SAMPLES))
    real = numpy_type(subject.precision)
    return {
        "can": tuple(bytes(data) for frames, _ in recorded for data in _can_seeds(subject.config, frames)),
        "step": tuple(data for _, drive in recorded for data in _step_seeds(drive, real)),
    }


def _can_seeds(config: Config, recorded: Sequence[Sequence[Frame]]) -> Iterator[Iterable[int]]:
    """Yield the samples unchanged, and with a jump, a damaged frame, foreign frames and a gap."""
    ids = [config.can.vehicle_motion.id, config.can.vehicle_conditions.id]
    samples = [[*(byte for frame in frames if frame.id in ids for byte in frame.data[1:])] for frames in recorded]
    troubles = (
        (3, 2),
        (4, 0x13),
        (4 | 1 << 3, 0x2A),
        (6, 3, 1, 2, 3),
        (7 | 1 << 3, 0x00, 0x03, 0, 0, *range(8)),
        (7 | 4 << 4,),
    )
    # Frames of CAN FD are long: fewer of them fit into an input.
    room = INPUT_BYTES_MAX - sum(map(len, troubles))
    samples = samples[: room // (1 + max(map(len, samples)))]
    gap = len(samples) // len(troubles)
    yield [byte for sample in samples for byte in (0, *sample)]
    after = {gap * (number + 1) - 1: trouble for number, trouble in enumerate(troubles)}
    yield [byte for k, sample in enumerate(samples) for byte in (0, *sample, *after.get(k, ()))]


def _step_seeds(drive: Samples, real: type[np.float32] | type[np.float64]) -> Iterator[bytes]:
    """Yield the samples unchanged, and with wrong numbers, changed parameters, restarts and calls of the other functions."""
    rows = [row.astype(real) for row in drive]
    start = real(0.0).tobytes()
    yield start + b"".join(bytes((0, 0x1F | int(row[5]) << 5)) + row[:5].tobytes() for row in rows)
    parts = [start]
    wrong = [real(value).tobytes() for value in (np.nan, np.inf, -1e30, 1e-42, 3.0, 0.02)]
    for k, row in enumerate(rows):
        parts.append(bytes((0, 0x1F)) + row[:5].tobytes())
        if k % 4 == 3:
            parts.append(bytes((3 << 3, 1 << (k // 4) % 5)) + wrong[k // 4])
            parts.append(struct.pack("BBB", 5, 5 * k, k % 5) + b"\x07\x06" + wrong[5] + b"\x07")
    yield b"".join(parts)


def run_harness(program: Path, name: Name, corpus: Sequence[bytes], inputs: int) -> tuple[dict[str, int], tuple[str, ...]]:
    """Run a harness of a sanitized program on mutations of the corpus.

    Return the numbers of inputs, seeds, inputs kept for new coverage, and edges reached; and the findings.
    """
    figures = {"inputs": 0, "seeds": len(corpus), "corpus": 0, "edges": 0}
    stored = program.parent / f"{name}.seeds"
    stored.write_bytes(b"".join(struct.pack("=I", len(data)) + data for data in corpus))
    try:
        result = run_sanitized(program, name, str(stored), str(inputs), str(SEED), seconds=SECONDS_MAX)
    except subprocess.TimeoutExpired:
        return figures, (f"{name}: an input does not end",)
    findings, at = findings_of(result.stderr), _AT_INPUT.search(result.stderr)
    if result.returncode == 0:
        figures["inputs"], figures["corpus"], figures["edges"] = map(int, result.stdout.split())
    elif not findings:
        findings = (f"the program ended early: exit code {result.returncode}",)
    where = f", at input {at[1]} of {inputs}" if at else ""
    figures["inputs"] = int(at[1]) if at else figures["inputs"]
    return figures, tuple(f"{name}: {finding}{where}" for finding in findings)


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
INPUTS: dict[Name, int] = {"can": 50_000, "step": 100_000}
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
        corpus = seeds(subject)
        with compiled(compiler, subject.sources(), sources(subject), (COVERAGE_FLAG,)) as path:
            with sanitized.served(path, subject) as ecu:
                suite_runs = _Suites(subject, effort, ecu)
                for finding in suite_runs.run():
                    suite_runs.findings.append(finding)  # one by one: the program may end at any time
            for name in HARNESSES:
                inputs = INPUTS_QUICK if effort.quick else INPUTS[name]
                fuzzed[name] = run_harness(path, name, corpus[name], inputs)
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
