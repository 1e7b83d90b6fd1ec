"""The controller of a build on a Cortex-M4F: its commands, and the instructions of every step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.emit.render import render
from codegen.errors import BuildError
from codegen.sil.software import Measurement
from codegen.verify.target.cross import compile_image
from codegen.verify.target.emulator import DATA, DATA_BYTES, CortexM4, IntArray

Drive = npt.NDArray[np.float32]
"""Samples one after the other, (samples, 6): the fields of `Measurement`, `inhibit` as 0 or 1."""

COLUMNS = ("speed", "front_angle", "yaw_rate", "rear_angle", "friction", "inhibit")

SAMPLE = np.dtype([("values", "<f4", 5), ("inhibit", "<u4")])
RESULT = np.dtype([("rear_angle", "<f4"), ("yaw_rate_reference", "<f4"), ("status", "<u4")])
"""One command, as the numbers of the target."""

FRAME = "frame/cortex_m.c"
LIBRARY_UNIT = "dynamics"
"""The one unit that needs a C library, and that no step of the controller calls."""

CHUNK = DATA_BYTES // 64
"""Samples of one call; the rest of the data is for results."""
RESULTS = DATA + CHUNK * SAMPLE.itemsize


@dataclass(frozen=True)
class Steps:
    """Instructions of each step of a drive.

    Attributes:
        total: (samples,).
        parts: (samples, functions), by `Target.functions`.
    """

    total: IntArray
    parts: IntArray


def drive_of(measurements: Sequence[Measurement]) -> Drive:
    """Measurements as an array."""
    rows = [[float(getattr(measurement, name)) for name in COLUMNS] for measurement in measurements]
    with np.errstate(over="ignore"):  # beyond float32: infinity, as in the C
        return np.array(rows, dtype=np.float32).reshape(-1, len(COLUMNS))


def measurements_of(drive: Drive) -> list[Measurement]:
    """The same, back."""
    return [
        Measurement(speed, front_angle, yaw_rate, rear_angle, friction, bool(inhibit))
        for speed, front_angle, yaw_rate, rear_angle, friction, inhibit in drive.tolist()
    ]


class Target:
    """One controller on one core, in single precision.

    Attributes:
        functions: names of those that the image holds.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: a build in double precision, or C that does not compile.
    """

    def __init__(self, files: Mapping[str, bytes], manifest: Mapping[str, Any], flags: Sequence[str] = ("-O2",)) -> None:
        options = manifest["options"]
        if options["precision"] != "single":
            raise BuildError(
                "a build in double precision is not for a Cortex-M4F, whose FPU has single precision",
                where="options.precision",
                remedy="build with --precision single",
            )
        prefix = options["prefix"]
        sources = {path: content for path, content in files.items() if path.startswith(("include/", "src/"))}
        sources.pop(f"src/{prefix}_{LIBRARY_UNIT}.c", None)
        sources[FRAME] = render("verify/cortex_m.c.j2", {"build": {"prefix": prefix}})
        self._core = CortexM4(compile_image(sources, ("verify_run", "verify_init"), flags))
        self.functions = tuple(function.name for function in self._core.functions)
        self._starts = np.array([function.start for function in self._core.functions])
        self._step = self._core.functions[self.functions.index(f"{prefix}_controller_step")].start
        self._frame = [self.functions.index(name) for name in ("verify_run", "verify_init")]

    def run(self, drive: Drive, rear_angle: float = 0.0) -> npt.NDArray[Any]:
        """Start at a rear angle (rad), then take every sample; the commands, (samples,) of RESULT."""
        self._init(rear_angle)
        return np.concatenate([self._chunk(part) for part in _chunks(drive)])

    def count(self, drive: Drive, rear_angle: float = 0.0) -> tuple[npt.NDArray[Any], Steps]:
        """The same, and the instructions of each step."""
        self._init(rear_angle)
        results, steps = [], []
        for part in _chunks(drive):
            blocks = self._core.traced(lambda part=part: results.append(self._chunk(part)))  # type: ignore[misc]
            function = np.searchsorted(self._starts, blocks.address, side="right") - 1
            inside = ~np.isin(function, self._frame)
            sample = np.cumsum(blocks.address == self._step) - 1
            counted = np.zeros((len(part), len(self.functions)), dtype=np.int64)
            np.add.at(counted, (sample[inside], function[inside]), blocks.instructions[inside])
            steps.append(counted)
        parts = np.concatenate(steps)
        return np.concatenate(results), Steps(parts.sum(axis=1), parts)

    def _init(self, rear_angle: float) -> None:
        self._core.write(DATA, np.float32(rear_angle).tobytes())
        self._core.call("verify_init", DATA)

    def _chunk(self, part: Drive) -> npt.NDArray[Any]:
        samples = np.empty(len(part), dtype=SAMPLE)
        samples["values"], samples["inhibit"] = part[:, :5], part[:, 5] != 0.0
        self._core.write(DATA, samples.tobytes())
        self._core.call("verify_run", DATA, RESULTS, len(part))
        return np.frombuffer(self._core.read(RESULTS, RESULT.itemsize * len(part)), dtype=RESULT)


def _chunks(drive: Drive) -> Iterator[Drive]:
    for start in range(0, max(len(drive), 1), CHUNK):
        yield drive[start : start + CHUNK]
