"""Clocks of car and ECU, which are not synchronised: some cycles of the task receive no frame, others two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.errors import CodegenError


@dataclass(frozen=True)
class Clocks:
    """Deviation of the car's clock from the ECU's. Zeros: both run in step.

    Attributes:
        drift_ppm: rate of the car's clock less that of the ECU's, in parts per million.
        jitter_ms: the largest departure of each sending, and of each start of the task, from its own clock; uniform.
    """

    drift_ppm: float = 0.0
    jitter_ms: float = 0.0

    @property
    def are_free_running(self) -> bool:
        """Whether there are two clocks."""
        return self.drift_ppm != 0.0 or self.jitter_ms != 0.0

    def sending_times(self, count: int, period: float, seed: int = 0) -> FloatArray:
        """Return the times (count,) in s of the ECU's clock at which the car sends; both clocks tick together in the middle.

        Args:
            period: s, the nominal one of both.
            seed: of the jitter.

        Raises:
            CodegenError: the jitter could exchange two frames of a message.
        """
        jitter = 1e-3 * self.jitter_ms
        if 2.0 * jitter >= period:
            raise CodegenError(
                f"{self.jitter_ms:g} ms is half of the period of {1e3 * period:g} ms or more",
                where="`jitter_ms=`",
                remedy="choose less: frames of a message keep their order",
            )
        ticks, middle = np.arange(count, dtype=np.float64), 0.5 * count
        drifted = (ticks - middle) / (1.0 + 1e-6 * self.drift_ppm) + middle
        return period * drifted + jitter * np.random.default_rng((seed, 0)).uniform(-1.0, 1.0, count)

    def task_starts(self, cycles: int, period: float, seed: int = 0) -> list[tuple[float, ...]]:
        """Return the starts of the task in s after its tick, up to two, for each cycle of the car from one sending to the
        next.

        A start before the first sending is omitted. Arguments and errors as in `sending_times`.
        """
        if not self.are_free_running:
            return [(0.0,)] * cycles
        sent = self.sending_times(cycles, period, seed)
        starts = period * np.arange(cycles) + 1e-3 * self.jitter_ms * np.random.default_rng((seed, 1)).uniform(
            -1.0, 1.0, cycles
        )
        found: list[tuple[float, ...]] = [()] * cycles
        ticks = Clocks(self.drift_ppm).sending_times(cycles, period)
        end = ticks[-1] + period / (1.0 + 1e-6 * self.drift_ppm)  # of a car that is ahead of the ECU
        for cycle, start in zip(np.searchsorted(sent, starts, side="right") - 1, starts, strict=True):
            if cycle >= 0 and start <= end:
                found[cycle] += (float(start - ticks[cycle]),)
        return found


IN_STEP = Clocks()
"""One clock."""
HALF_RATE = Clocks(drift_ppm=1e6)
"""A task that the ECU calls at half the rate of the car's messages."""
FREE_RUNNING = Clocks(drift_ppm=100.0, jitter_ms=0.7)
"""Two quartz oscillators of 50 ppm each, the usual tolerance, and the jitter of a task and of a bus that others share."""
