"""Response to a steady sine at the steering wheel (ISO 7401:2011, clause 13, continuous sinusoidal input)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.metrics.runs import Figure, FigureTable, Runs

PERIODS = 3
"""Periods at the end of a run over which the fundamental is determined; the ones before let the transient decay."""


class SineResponse(FigureTable):
    """Fundamentals against that of the front angle: gain, and delay, the phase over angular frequency within half a period."""

    yaw_rate_delay_s = Figure("delay of the yaw rate", "s", 3, lambda of: of.delay("yaw_rate_rad_s"))
    lateral_acceleration_delay_s = Figure(
        "delay of the lateral acceleration", "s", 3, lambda of: of.delay("lateral_acceleration_m_s2")
    )
    yaw_rate_gain_per_s = Figure(
        "gain from the front angle to the yaw rate", "1/s", 3, lambda of: np.abs(of.ratio("yaw_rate_rad_s"))
    )

    def __init__(self, runs: Runs, frequency: float) -> None:
        super().__init__(runs)
        self.frequency = frequency
        step = float(runs.time[1] - runs.time[0])
        samples = round(PERIODS / (frequency * step))
        self._last = slice(runs.time.size - samples, None)
        self._wave = np.exp(-2j * np.pi * frequency * runs.time[self._last])[:, np.newaxis]

    def delay(self, name: str) -> FloatArray:
        """Return the delays (n,) of a column in s."""
        result: FloatArray = -np.angle(self.ratio(name)) / (2.0 * math.pi * self.frequency)
        return result

    def ratio(self, name: str) -> npt.NDArray[np.complex128]:
        """Return the fundamentals (n,) of a column over those of the front angle."""
        result: npt.NDArray[np.complex128] = self._fundamental(name) / self._fundamental("front_angle_rad")
        return result

    def _fundamental(self, name: str) -> npt.NDArray[np.complex128]:
        """Return the fundamentals (n,) of a column, not normalised."""
        result: npt.NDArray[np.complex128] = np.cumsum(self.runs.signals[name][self._last] * self._wave, axis=0)[-1]
        return result
