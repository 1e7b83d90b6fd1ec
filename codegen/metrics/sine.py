"""Figures of a sine at the steering wheel: the sine with dwell, and the steady sine.

The sine with dwell has the criteria of FMVSS 126 (49 CFR 571.126), S5.2, computed according to S7.11. BOS, the beginning of
steer, is where the steering wheel first reaches 5 deg; COS, its completion, where it is back at zero. Times and values are
interpolated between samples. The signals of a simulation are free of noise, so nothing is filtered.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.metrics.runs import Figure, FigureTable, Lazy, Runs, crossing, spin_times, total

_PERIODS = 3
"""Periods at the end of a run over which the fundamental is determined; the ones before let the transient decay."""

DWELL_FREQUENCY = 0.7
DWELL_PAUSE = 0.5
"""FMVSS 126, S7.9: a sine of 0.7 Hz whose second peak is held for 500 ms."""
DWELL_LENGTH = 1.0 / DWELL_FREQUENCY + DWELL_PAUSE
"""Duration of the steering input from its beginning to its completion, in s."""

BEGINNING_ANGLE = math.radians(5.0)
"""Angle of the steering wheel, in rad, at which the steer begins (S7.11)."""
ZERO_ANGLE = math.radians(0.1)
"""Angle of the steering wheel, in rad, that counts as zero, which the wheel approaches with a lag; the resolution of S6.3."""
RATIOS = {"yaw_rate_ratio_1_00_s_percent": (1.0, 35.0), "yaw_rate_ratio_1_75_s_percent": (1.75, 20.0)}
"""Figure -> time after COS, in s, and the largest ratio of the yaw rate to its second peak there, in % (S5.2.1 and S5.2.2)."""
DISPLACEMENT_TIME = 1.07
"""Time after BOS, in s, at which the displacement is read (S5.2.3)."""
HEAVY_MASS = 3500.0
"""Mass in kg above which less displacement is required. The standard uses the gross rating; this uses the car's mass."""
DISPLACEMENT_MIN, DISPLACEMENT_MIN_HEAVY = 1.83, 1.52
"""Smallest lateral displacement, in m, of a light and of a heavy car."""

DISPLACEMENT, MEETS_CRITERIA = "lateral_displacement_m", "meets_fmvss_126"
"""Names of the displacement and of the outcome among the figures."""


def displacement_min(mass: npt.ArrayLike) -> FloatArray:
    """Return the smallest lateral displacement in m that the standard requires of cars of a mass in kg."""
    return np.where(np.asarray(mass) <= HEAVY_MASS, DISPLACEMENT_MIN, DISPLACEMENT_MIN_HEAVY)


def _ratio(name: str) -> Figure:
    after, limit = RATIOS[name]
    title = f"yaw-rate ratio {after:.2f} s after steering (at most {limit:g})"
    return Figure(title, "%", 1, lambda of: of.ratio(after))


class SineWithDwell(FigureTable):
    """Criteria of FMVSS 126. Runs without the steering of the standard, or that end too early, lack what depends on it.

    The ratios are relative to the second peak with its sign: a yaw rate to the other side is negative. A spin is a failure and
    never invalidates `meets_fmvss_126`. One value beyond its limit is a failure; to pass, all three must have been measured.
    """

    yaw_rate_ratio_1_00_s_percent = _ratio("yaw_rate_ratio_1_00_s_percent")
    yaw_rate_ratio_1_75_s_percent = _ratio("yaw_rate_ratio_1_75_s_percent")
    lateral_displacement_m = Figure(
        f"lateral displacement {DISPLACEMENT_TIME:g} s after its start", "m", 2, lambda of: of.displacement
    )
    meets_fmvss_126 = Figure("meets these three", "", 2, lambda of: of.outcome, ("no", "yes"))

    def until(self, name: str) -> FloatArray | float:
        """See `FigureTable.until`."""
        beginning, _, completion = self.times
        ends: dict[str, FloatArray] = {ratio: completion + after for ratio, (after, _) in RATIOS.items()}
        ends |= {DISPLACEMENT: beginning + DISPLACEMENT_TIME, MEETS_CRITERIA: np.full(beginning.shape, -math.inf)}
        return np.where(np.isnan(ends[name]), math.inf, ends[name])

    @Lazy
    def times(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Beginning, reversal and completion of steer in s, (n,) each; all three NaN for a run without such steering."""
        time, start = self.runs.time, self.runs.steer_time
        begun = self.runs.after.start
        half = int(np.searchsorted(time, start + 0.5 * DWELL_LENGTH))
        wheel = self.runs.signals["front_angle_rad"] * self.runs.steering_ratio
        none = np.full(wheel.shape[1], np.nan)
        if half >= time.size or half <= begun:
            return none, none, none
        wheel = wheel * np.where(total(wheel[begun:half]) >= 0.0, 1.0, -1.0)
        rows = np.arange(wheel.shape[0])[:, np.newaxis]
        beginning = crossing(time, wheel, BEGINNING_ANGLE, begun)
        peak = begun + wheel[begun:].argmax(axis=0)
        reversal = crossing(time, -wheel, 0.0, peak)
        trough = np.where(rows >= peak, wheel, np.inf).argmin(axis=0)
        completion = crossing(time, wheel, -ZERO_ANGLE, trough)
        good = (beginning < reversal) & (reversal < completion)
        return np.where(good, beginning, np.nan), np.where(good, reversal, np.nan), np.where(good, completion, np.nan)

    @Lazy
    def second_peak(self) -> FloatArray:
        """First peaks (n,) of the yaw rate, in rad/s, after the steering wheel changed sign, in its new direction.

        The first local maximum on the new side; the largest value where there is none.
        """
        runs, reversal = self.runs, self.times[1]
        sign = np.where(runs.at(reversal + 0.05, "front_angle_rad") >= 0.0, 1.0, -1.0)
        yaw_rate = sign * runs.signals["yaw_rate_rad_s"]
        inside = runs.time[:, np.newaxis] >= reversal
        falls = np.zeros_like(inside)
        falls[1:-1] = (yaw_rate[1:-1] > 0.0) & (yaw_rate[1:-1] >= yaw_rate[:-2]) & (yaw_rate[1:-1] > yaw_rate[2:])
        falls[1:-1] &= inside[:-2]  # the first sample inside has none before it
        highest = np.where(inside, yaw_rate, -np.inf).argmax(axis=0)
        chosen = np.where(falls.any(axis=0), falls.argmax(axis=0), highest)
        result: FloatArray = sign * yaw_rate[chosen, np.arange(yaw_rate.shape[1])]
        return result

    def ratio(self, after: float) -> FloatArray:
        """Return the yaw rates (n,) `after` seconds after the completion of steer over the second peak, in %."""
        at = self.times[2] + after
        is_known = (self.second_peak != 0.0) & (at <= self.runs.time[-1])
        return np.where(is_known, 100.0 * self.runs.at(at, "yaw_rate_rad_s") / self.second_peak, np.nan)

    @Lazy
    def displacement(self) -> FloatArray:
        """Displacements (n,) in m: the lateral acceleration integrated twice from the beginning of steer, where both are zero.

        The sum is exact for an acceleration that is linear between samples.
        """
        time, lateral = self.runs.time, self.runs.signals["lateral_acceleration_m_s2"]
        begin = self.times[0]
        end = begin + DISPLACEMENT_TIME
        # Each interval between samples, cut to what lies inside.
        left, right = (np.clip(part[:, np.newaxis], begin, end) for part in (time[:-1], time[1:]))
        slope = np.diff(lateral, axis=0) / np.diff(time)[:, np.newaxis]
        inside = lateral[:-1] + slope * (left - time[:-1, np.newaxis])
        inside_right = lateral[:-1] + slope * (right - time[:-1, np.newaxis])
        inside = np.where(left == begin, self.runs.at(begin, "lateral_acceleration_m_s2"), inside)
        inside_right = np.where(right == end, self.runs.at(end, "lateral_acceleration_m_s2"), inside_right)
        step = right - left
        # A later non-finite value must not invalidate earlier ones: NaN times zero is NaN.
        taken = step > 0.0
        inside, inside_right = np.where(taken, inside, 0.0), np.where(taken, inside_right, 0.0)
        gained = 0.5 * step * (inside + inside_right)
        speed = np.cumsum(gained, axis=0) - gained
        moved = total(step * speed + step**2 * (2.0 * inside + inside_right) / 6.0)
        return np.where(end <= time[-1], np.abs(moved), np.nan)

    @Lazy
    def outcome(self) -> FloatArray:
        """Whether the criteria are met, (n,): 1, 0, or NaN where they were not measured."""
        failed, unknown = ~np.isnan(spin_times(self.runs)), np.isnan(self.displacement)
        failed |= self.displacement < displacement_min(self.runs.mass)
        for name, (_, limit) in RATIOS.items():
            failed |= getattr(self, name) > limit
            unknown |= np.isnan(getattr(self, name))
        return np.where(failed, 0.0, np.where(unknown, np.nan, 1.0))


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
        samples = round(_PERIODS / (frequency * step))
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
