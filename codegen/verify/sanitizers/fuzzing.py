"""Seeds of the fuzz harnesses, and their run with a fixed number of inputs, which are the same on each run."""

from __future__ import annotations

import re
import struct
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from codegen.configuration import Config
from codegen.emit.text import numpy_type
from codegen.verify.check import Subject
from codegen.verify.sanitizers.program import Name
from codegen.verify.sanitizers.sanitized import findings_of, run_sanitized
from codegen.verify.suites import Recording, recordings

SEED_SAMPLES = 24
"""Samples of each recording: short enough to be mutated everywhere, long enough for every status."""

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
    precision = subject.manifest["options"]["precision"]
    config = subject.config
    recorded = recordings(config, precision, SEED_SAMPLES)
    real = numpy_type(precision)
    return {
        "can": tuple(bytes(data) for recording in recorded for data in _can_seeds(config, recording)),
        "step": tuple(bytes(data) for recording in recorded for data in _step_seeds(recording, real)),
    }


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
