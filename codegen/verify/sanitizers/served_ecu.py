"""A sanitized program as an ECU: the generated code of a build in a process of its own, called through a pipe.

Whatever the code does there, wrong addresses included, this process goes on. The commands stand in
`templates/verify/served_ecu.c.j2`.
"""

from __future__ import annotations

import contextlib
import struct
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.emit.text import numpy_type
from codegen.errors import CodegenError
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sil.software import RECORD_COLUMNS
from codegen.verify.check import Subject
from codegen.verify.drives import Samples
from codegen.verify.sanitizers.sanitized import environment, findings_of, launcher

Numbers = npt.NDArray[Any]

BATCH = 16_384
"""Steps or look-ups of one command: their answers fit the program's buffer."""

SECONDS_MAX = 120.0
"""After which a program that does not end counts as caught in a loop: ten times what it takes on a slow machine."""


class Ended(CodegenError):
    """The program ended before it answered."""


class ServedEcu:
    """Commands of the program as functions. Each raises Ended if the program ends.

    Attributes:
        real: NumPy type of the build's numbers.
        findings: reports of the sanitizers, filled when the program ends.
    """

    def __init__(self, process: subprocess.Popen[bytes], real: type[np.float32] | type[np.float64]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self.real = real
        self.findings: tuple[str, ...] = ()
        self._to: IO[bytes] = process.stdin
        self._from: IO[bytes] = process.stdout
        self._command = np.dtype([("rear_angle", real), ("yaw_rate_reference", real), ("status", np.uint32)])

    def selftest(self) -> bool:
        """Return whether the generated self-test passes."""
        return bool(struct.unpack("=I", self._ask(b"s", 4))[0])

    def start(self, rear_angle: float) -> None:
        """Initialise the controller at a rear angle in rad."""
        self._ask(b"i" + self.real(rear_angle).tobytes())

    def drive(self, drive: Samples) -> Numbers:
        """Run the controller. Return its commands, (samples,) with the fields rear_angle, yaw_rate_reference, status."""
        samples = np.empty(len(drive), dtype=np.dtype([("values", self.real, 6), ("inhibit", np.uint8)]))
        with np.errstate(invalid="ignore"):  # a signalling NaN, where the build is in double precision
            samples["values"], samples["inhibit"] = drive[:, :6], drive[:, 6] != 0.0
        return self._batches(b"d", samples, self._command)

    def look_up(self, places: Numbers, friction: float) -> tuple[Numbers, Numbers]:
        """Look up yaw rate and rear angle (0 if the build has none) at places (n, 2) of speed and front angle."""
        rows = np.column_stack([places, np.full(len(places), friction, dtype=self.real)])
        found = self._batches(b"m", rows.reshape(-1), np.dtype((self.real, 2)), width=3)
        return found[:, 0], found[:, 1]

    def run_loop(self, inputs: FloatArray, steps_per_sample: int, *, through_can: bool) -> FloatArray:
        """Run a closed loop with the plant of the build and return the recording (samples, 12), columns RECORD_COLUMNS."""
        samples = len(inputs) // steps_per_sample
        rows = np.ascontiguousarray(inputs[: samples * steps_per_sample], dtype=np.float64)
        assert rows.shape[1] == len(INPUT_COLUMNS)
        head = struct.pack("=III", through_can, steps_per_sample, samples)
        answer = self._ask(b"l" + head + rows.tobytes(), samples * len(RECORD_COLUMNS) * 8)
        return np.frombuffer(answer, dtype=np.float64).reshape(samples, -1)

    def task(self) -> Self:
        """Initialise the only task of the program. Its methods are those of `codegen.sil.software.Task` that a bench calls."""
        self._ask(b"t")
        return self

    def on_can_frame(self, identifier: int, data: bytes) -> None:
        """Receive a frame in the task."""
        self._ask(b"f" + struct.pack("=IB", identifier, len(data)) + data)

    def run(self) -> tuple[int, bytes]:
        """Run one sample of the task. Return id and data of the frame to send."""
        answer = self._ask(b"c", 12)
        return struct.unpack("=I", answer[:4])[0], answer[4:]

    def _batches(self, command: bytes, rows: Numbers, answer: np.dtype[Any], width: int = 1) -> Numbers:
        parts = []
        for start in range(0, len(rows), BATCH * width):
            part = rows[start : start + BATCH * width]
            count = len(part) // width
            data = self._ask(command + struct.pack("=I", count) + part.tobytes(), count * answer.itemsize)
            parts.append(np.frombuffer(data, dtype=answer))
        return np.concatenate(parts)

    def _ask(self, data: bytes, size: int = 0) -> bytes:
        """Send a command and return its answer. A command without an answer is sent with the next that has one."""
        try:
            self._to.write(data)
            if size > 0:
                self._to.flush()
        except OSError:
            raise Ended("the program ended") from None
        answer = self._from.read(size)
        if len(answer) != size:
            raise Ended("the program ended")
        return answer


@contextlib.contextmanager
def served(program: Path, subject: Subject) -> Iterator[ServedEcu]:
    """Run the sanitized code of a build behind a pipe. If the program ends early, the context ends and the findings contain
    it."""
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [*launcher(), str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, env=environment()
        )
        watch = threading.Timer(SECONDS_MAX, process.kill)
        watch.start()
        found = ServedEcu(process, numpy_type(subject.manifest["options"]["precision"]))
        ended = False
        try:
            yield found
        except Ended:
            ended = True
        finally:
            with contextlib.suppress(OSError):
                process.stdin.close()  # type: ignore[union-attr]
            process.wait()
            watch.cancel()
            process.stdout.close()  # type: ignore[union-attr]
        log.seek(0)
        found.findings = findings_of(log.read().decode(errors="replace"))
        if ended and not found.findings:
            code = process.returncode
            how = f"signal {-code}" if code < 0 else f"exit code {code}"
            found.findings = (f"the program ended early: {how}",)
