"""The C around the generated code, and its fuzz harnesses of reception and step.

All of it is one program, with a server, the plant and the closed loop; the harnesses also work with libFuzzer. The driver of
the harnesses works with every compiler and follows coverage too. Each run has a fixed number of inputs, the same each time.
"""

from __future__ import annotations

import re
import struct
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from codegen.configuration import Config
from codegen.configuration.can import Can, RealSignal
from codegen.configuration.signals import CARRIED
from codegen.emit.can_view import task_view
from codegen.emit.controller_view import ESTIMATE_FACTOR, REFERENCE_OVERSHOOT
from codegen.emit.laws import LAWS
from codegen.emit.render import render, verbatim
from codegen.emit.text import c_type, literal, numpy_type
from codegen.sil.software import bench_sources
from codegen.verify.drives import Samples, recordings
from codegen.verify.outcomes import Subject
from codegen.verify.sanitizers.sanitized import findings_of, run_sanitized
from hil_sim.codec import Frame

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
