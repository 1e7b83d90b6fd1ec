"""Check 7, its bounded part: a fixed number of changed inputs on the CAN receive path and on the step, sanitized.

The harnesses are libFuzzer's (see `fuzz_harness`); the driver here needs no clang, goes by coverage too, and gives the same
inputs on each run. Where Debian's clang is, the campaign in the checkout runs the same harnesses for as long as one likes.
"""

from __future__ import annotations

import re
import struct
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from codegen import configuration
from codegen.configuration import Config
from codegen.configuration.can import Message, RealSignal
from codegen.configuration.signals import CARRIED, MEASURED
from codegen.emit.can_view import task_view
from codegen.emit.controller_view import REFERENCE_OVERSHOOT
from codegen.emit.laws import LAWS
from codegen.emit.render import render, verbatim
from codegen.emit.text import c_type, literal, numpy_type
from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitizers.sanitized import Compiler, compiled, find_compiler, findings_of, run_sanitized
from codegen.verify.suites import Recording, recordings

Name = Literal["can", "step"]
HARNESSES: tuple[Name, ...] = ("can", "step")

SEED_SAMPLES = 24
"""Samples of each recording: short enough to be mutated everywhere, long enough for every status."""

CRC_AND_COUNTER = range(12)
"""Bits of a protected frame."""


def source(subject: Subject, name: Name) -> bytes:
    """Return the C of a harness."""
    manifest = subject.manifest
    config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    law, facts, real = LAWS[subject.kind], manifest["map"], numpy_type(manifest["options"]["precision"])
    cap, friction = facts["lateral_acceleration_cap_m_s2"], facts["frictions"][0]
    numbers = {
        "sampling_time": config.controller.sampling_time_s,
        "actuator_angle_max": float(real(config.rear_actuator.angle_max)),
        "cap": cap,
        "cap_per_friction": cap / friction,
        "overshoot": REFERENCE_OVERSHOOT if law.uses_reference_model else 1.0,
        "rounding": 8.0 * float(np.finfo(real).eps),
        "smallest": float(np.finfo(real).smallest_subnormal),
    }
    context: dict[str, Any] = {
        "build": {"prefix": subject.prefix, "PREFIX": subject.prefix.upper()},
        "real": c_type(manifest["options"]["precision"]),
        "task": task_view(config),
        "can": config.can,
        "used_bits": _used_bits(config.can.rear_steer_command),
        "signals": tuple(_reals(config)),
        "measured": MEASURED,
        "carried": CARRIED,
        "stacked": len(facts["frictions"]) > 1,
        "with_rear_angle": law.uses_rear_angle,
        "with_model": law.uses_reference_model,
        **{key: literal(value, "double") for key, value in numbers.items()},
    }
    return render(f"verify/fuzz_{name}.c.j2", context)


def driver() -> bytes:
    """Return the C that runs a harness with a fixed number of inputs."""
    return verbatim("verify/fuzz_main.c")


def seeds(subject: Subject) -> dict[Name, tuple[bytes, ...]]:
    """Return seed inputs for both harnesses: the bus traffic of a car without rear steering in the built-in scenarios,
    unchanged and with faults.

    Faults are damaged frames, gaps, values no sensor sends, and changed parameters.

    Raises:
        BuildError: the C of the simulated car does not compile here.
    """
    precision = subject.manifest["options"]["precision"]
    config = subject.config
    recorded = recordings(config, precision, SEED_SAMPLES)
    real = numpy_type(precision)
    return {
        "can": tuple(bytes(data) for recording in recorded for data in _can_seeds(config, recording)),
        "step": tuple(bytes(data) for recording in recorded for data in _step_seeds(recording, real)),
    }


def _used_bits(message: Message) -> int:
    """Return a mask of the used bits of a frame, from the lowest of byte 0."""
    used = {*CRC_AND_COUNTER, *(bit for signal in message.signals().values() for bit in signal.bits(message.byte_order))}
    return sum(1 << bit for bit in used)


def _reals(config: Config) -> Iterator[tuple[str, str, RealSignal]]:
    """Yield struct in the harness, field and layout of each scaled signal."""
    names = {"vehicle_motion": "motion", "vehicle_conditions": "conditions", "rear_steer_command": "command"}
    for role, message in config.can.messages().items():
        for name, signal in message.signals().items():
            if isinstance(signal, RealSignal):
                yield names[role], name, signal


def _can_seeds(config: Config, recording: Recording) -> Iterator[Iterable[int]]:
    """Yield the samples unchanged, and with a jump, a damaged frame, foreign frames and a gap."""
    ids = [config.can.vehicle_motion.id, config.can.vehicle_conditions.id]
    samples = [[*(byte for frame in frames if frame.id in ids for byte in frame.data[1:])] for frames in recording.frames]
    yield [byte for sample in samples for byte in (0, *sample)]
    troubles = (
        (3, 2),
        (4, 0x13),
        (4 | 1 << 3, 0x2A),
        (6, 3, 1, 2, 3),
        (7 | 1 << 3, 0x00, 0x03, 0, 0, *range(8)),
        (7 | 4 << 4,),
    )
    yield [byte for k, sample in enumerate(samples) for byte in (0, *sample, *(troubles[k // 4] if k % 4 == 3 else ()))]


def _step_seeds(recording: Recording, real: type[np.float32] | type[np.float64]) -> Iterator[bytes]:
    """Yield the samples unchanged, and with wrong numbers, changed parameters, restarts and calls of the other functions."""
    rows = [row.astype(real) for row in recording.measurements]
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


SHOWS = (
    "No frames, measurements, initial states or valid parameters found by fuzzing make the code crash, exceed its bounds, use "
    "a frame with a wrong CRC, or miss the fail-safe"
)
LIMITS = ("Fuzzing tries many inputs, not all. It proves nothing about the others.",)

INPUTS: dict[Name, int] = {"can": 50_000, "step": 100_000}
INPUTS_QUICK = 4_000
SEED = 1

SECONDS_MAX = 600.0
"""Then an input counts as one that does not end: many times what all of them take."""

COVERAGE = "-fsanitize-coverage=trace-pc"

_AT_INPUT = re.compile(r"^at input (\d+)$", re.MULTILINE)


@dataclass(frozen=True)
class _Run:
    """Result of a harness."""

    inputs: int
    corpus: int
    edges: int
    findings: tuple[str, ...]


def check(subject: Subject, effort: Effort) -> Outcome:
    """Run both harnesses.

    Raises:
        MissingTool: there is no C compiler with sanitizers.
    """
    compiler = find_compiler()
    try:
        corpus = seeds(subject)
        runs = {name: _run(compiler, subject, name, corpus[name], _inputs(name, effort)) for name in HARNESSES}
    except BuildError as error:
        return Outcome(SHOWS, "not compiled", Verdict.FAILED, (str(error),))
    findings = tuple(f"{name}: {finding}" for name, run in runs.items() for finding in run.findings)
    crashes = sum(bool(run.findings) for run in runs.values())
    return Outcome(
        SHOWS,
        f"{sum(run.inputs for run in runs.values()):,} inputs, {crashes} crashes",
        Verdict.FAILED if findings else Verdict.PASSED,
        findings,
        {
            name: {"inputs": run.inputs, "seeds": len(corpus[name]), "corpus": run.corpus, "edges": run.edges}
            for name, run in runs.items()
        },
        LIMITS,
        {"C compiler with sanitizers": compiler.version},
    )


def _inputs(name: Name, effort: Effort) -> int:
    return INPUTS_QUICK if effort.quick else INPUTS[name]


def _run(compiler: Compiler, subject: Subject, name: Name, corpus: Sequence[bytes], inputs: int) -> _Run:
    around = {f"fuzz_{name}.c": source(subject, name), "fuzz_main.c": driver()}
    with compiled(compiler, subject.sources(), around, (COVERAGE,)) as program:
        stored = program.path.parent / "seeds"
        stored.write_bytes(b"".join(struct.pack("=I", len(data)) + data for data in corpus))
        try:
            result = run_sanitized(program.path, str(stored), str(inputs), str(SEED), seconds=SECONDS_MAX)
        except subprocess.TimeoutExpired:
            return _Run(inputs, 0, 0, ("an input does not end",))
        return _read(result, inputs)


def _read(result: subprocess.CompletedProcess[str], inputs: int) -> _Run:
    findings = findings_of(result.stderr)
    at = _AT_INPUT.search(result.stderr)
    if at is not None:
        findings = tuple(f"{finding}, at input {at[1]} of {inputs}" for finding in findings)
    if result.returncode != 0 and not findings:
        findings = (f"the program ended early: exit code {result.returncode}",)
    if result.returncode != 0:
        return _Run(int(at[1]) if at is not None else 0, 0, 0, findings)
    done, corpus, edges = (int(word) for word in result.stdout.split())
    return _Run(done, corpus, edges, findings)
