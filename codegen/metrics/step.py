"""Figures of a step steer (ISO 7401:2011, clause 10).

Peak and steady value are always given together: the paper's "maximum" fits the steady value of its reference, while a PI on a
static reference overshoots it.
"""

from __future__ import annotations

import math

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration.signals import Status
from codegen.metrics.runs import Extremes, Figure, FigureTable, IndexArray, Lazy, Runs, crossing, first_from, largest, total

STEADY_WINDOW = 1.0
"""Time at the end of the run, in s, over which steady values are averaged."""

STEADY_SWING_MAX_FRACTION = 0.01
"""A run is settled where the range of the yaw rate over that window is below this fraction of its mean."""

SETTLING_BAND_FRACTION = 0.02
"""Half of the width of the settling band, as a fraction of the steady yaw rate. Its edges are inside, whatever rounds."""

RISEN_FRACTION = 0.9
"""Fraction of the steady yaw rate at which the rise ends."""

YAW_RATE_MIN = math.radians(1e-9)
"""Smallest steady yaw rate in rad/s that swing and settling band are relative to."""


class _Steady(FigureTable):
    """Values of the end of a run."""

    def __init__(self, runs: Runs, steady_window: float = STEADY_WINDOW) -> None:
        super().__init__(runs)
        self.steady = slice(int(np.searchsorted(runs.time, runs.time[-1] - steady_window, side="right")), None)

    def mean(self, name: str) -> FloatArray:
        """Return the steady values (n,) of a column: its means over the steady window."""
        values = self.runs.signals[name][self.steady]
        result: FloatArray = total(values) / values.shape[0]
        return result

    def mean_deg(self, name: str) -> FloatArray:
        """Return the same in deg or deg/s."""
        result: FloatArray = np.rad2deg(self.mean(name))
        return result


class StepResponse(_Steady):
    """Step responses (ISO 7401, lateral transient response). The names hold the units; the rear angle is the actuator's.

    The reference is NaN for a car that is not controlled at the end. Where `settled` is 0, "steady" is only a mean.
    `map_error_percent` and `map_overshoot_percent` compare the steady yaw rate and its peak with the map's steady yaw rate for
    speed, front angle and friction estimate at the end. They are negative where the car turns less, and NaN where no map is
    known.

    `overshoot_percent` is relative to the steady yaw rate. `rise_time_s`, `peak_time_s` and `settling_time_s` are measured from
    the start of steering: to 90 % of the steady value, to the peak, and to where the yaw rate stays within 2 % of its steady
    value (NaN where it does not settle). `yaw_rate_gain_per_s` is the steady yaw rate over the steady angle of the steering
    wheel; NaN where that is zero. `sideslip_abs_min_deg` is the smallest |beta| after the rise; before, beta starts from zero.
    The lateral acceleration has risen when it stays above 90 % of its steady value.
    """

    settled = Figure("settled at the end", "", 2, lambda of: of.is_settled.astype(np.float64), ("NO: means only", "yes"))
    yaw_rate_steady_deg_s = Figure("yaw rate, steady", "deg/s", 2, lambda of: np.rad2deg(of.yaw_rate))
    yaw_rate_peak_deg_s = Figure("yaw rate, peak", "deg/s", 2, lambda of: np.rad2deg(of.peak))
    yaw_rate_reference_deg_s = Figure("reference, steady", "deg/s", 2, lambda of: np.rad2deg(of.reference))
    map_yaw_rate_deg_s = Figure("map, steady", "deg/s", 2, lambda of: np.rad2deg(of.map_yaw_rate))
    map_error_percent = Figure("error to the map, steady", "%", 1, lambda of: of.over_map(of.yaw_rate))
    map_overshoot_percent = Figure("overshoot of the map", "%", 1, lambda of: of.over_map(of.peak))
    overshoot_percent = Figure(
        "overshoot of the steady yaw rate",
        "%",
        1,
        lambda of: np.where(of.yaw_rate != 0.0, 100.0 * (of.peak / of.yaw_rate - 1.0), 0.0),
    )
    rise_time_s = Figure("rise time to 90 %", "s", 2, lambda of: of.since_start(of.runs.time[of.risen]))
    lateral_acceleration_overshoot_percent = Figure("overshoot, lateral acceleration", "%", 1, lambda of: of.lateral_overshoot)
    lateral_acceleration_rise_time_s = Figure("rise to 90 %, lateral acceleration", "s", 2, lambda of: of.lateral_rise)
    settling_time_s = Figure("settling time to 2 %", "s", 2, lambda of: np.where(of.is_settled, of.time_outside_band_s, np.nan))
    peak_time_s = Figure("peak time", "s", 2, lambda of: of.since_start(of.runs.time[of.runs.after][of.turned.argmax(axis=0)]))
    yaw_rate_gain_per_s = Figure("yaw-rate gain, steady", "1/s", 3, lambda of: of.gain)
    sideslip_steady_deg = Figure("sideslip, steady", "deg", 2, lambda of: of.mean_deg("sideslip_rad"))
    sideslip_abs_min_deg = Figure("|sideslip|, smallest after the rise", "deg", 2, lambda of: np.rad2deg(of.sideslip_abs_min))
    sideslip_abs_max_deg = Extremes.sideslip_abs_max_deg
    rear_angle_min_deg = Extremes.rear_angle_min_deg
    rear_angle_max_deg = Extremes.rear_angle_max_deg
    rear_angle_steady_deg = Figure("rear angle, steady", "deg", 2, lambda of: of.mean_deg("rear_angle_rad"))
    slip_front_abs_max_deg = Figure(
        "|front slip|, largest", "deg", 2, lambda of: np.rad2deg(largest(of.after("slip_front_rad")))
    )
    slip_rear_abs_max_deg = Figure("|rear slip|, largest", "deg", 2, lambda of: np.rad2deg(largest(of.after("slip_rear_rad"))))
    lateral_acceleration_max_m_s2 = Extremes.lateral_acceleration_max_m_s2
    slip_front_steady_deg = Figure("front slip, steady", "deg", 2, lambda of: of.mean_deg("slip_front_rad"))
    slip_rear_steady_deg = Figure("rear slip, steady", "deg", 2, lambda of: of.mean_deg("slip_rear_rad"))

    @Lazy
    def yaw_rate(self) -> FloatArray:
        """Steady yaw rates, (n,) rad/s."""
        return self.mean("yaw_rate_rad_s")

    @Lazy
    def turned(self) -> FloatArray:
        """Yaw rates after the start of steering, (samples, n) rad/s, positive in the direction of the steady yaw rate."""
        values, is_right = self.after("yaw_rate_rad_s"), self.yaw_rate < 0.0
        return np.where(is_right, -values, values) if is_right.any() else values

    @Lazy
    def peak(self) -> FloatArray:
        """Peak yaw rates, (n,) rad/s."""
        result: FloatArray = np.where(self.yaw_rate < 0.0, -1.0, 1.0) * self.turned.max(axis=0)
        return result

    @Lazy
    def reference(self) -> FloatArray:
        """Steady references, (n,) rad/s. A car is controlled although single samples are held."""
        controlled: BoolArray = self.runs.signals["status"][self.steady] <= Status.LIMITED
        samples = controlled.sum(axis=0)
        mean = total(np.where(controlled, self.runs.signals["yaw_rate_reference_rad_s"][self.steady], 0.0)) / samples
        return np.where(2 * samples > controlled.shape[0], mean, np.nan)

    @Lazy
    def map_yaw_rate(self) -> FloatArray:
        """The map's yaw rates, (n,) rad/s."""
        known = self.runs.map_yaw_rate
        return np.broadcast_to(np.nan if known is None else np.asarray(known), self.yaw_rate.shape)

    def over_map(self, yaw_rate: FloatArray) -> FloatArray:
        """Return the errors (n,) of yaw rates in rad/s relative to the map's, in %; NaN where that is 0 or unknown."""
        return np.where(self.map_yaw_rate == 0.0, np.nan, 100.0 * (yaw_rate / self.map_yaw_rate - 1.0))

    @Lazy
    def risen(self) -> IndexArray:
        """Samples (n,) of the run in which the yaw rate first reaches RISEN_FRACTION; the last where it does not."""
        found = first_from(self.turned >= RISEN_FRACTION * np.abs(self.yaw_rate), 0)
        return np.where(found < 0, self.runs.time.size - 1, found + self.runs.after.start)

    @Lazy
    def rise_time_interpolated_s(self) -> FloatArray:
        """Rise times (n,) in s, interpolated linearly between samples; NaN where the yaw rate does not rise."""
        level = RISEN_FRACTION * np.abs(self.yaw_rate)
        return crossing(self.runs.time[self.runs.after], self.turned, level, 0) - self.runs.steer_time

    def end_of(self, values: FloatArray) -> FloatArray:
        """Return the means (n,) over the steady window of values (samples from the start of steering, n)."""
        steady = values[self.steady.start - self.runs.after.start :]
        result: FloatArray = total(steady) / steady.shape[0]
        return result

    @Lazy
    def lateral_acceleration(self) -> FloatArray:
        """Lateral accelerations after the start of steering, (samples, n) m/s^2, positive in their steady direction."""
        values = self.after("lateral_acceleration_m_s2")
        return np.where(self.end_of(values) < 0.0, -values, values)

    @Lazy
    def lateral_rise(self) -> FloatArray:
        """Times (n,) in s from which the lateral acceleration stays above RISEN_FRACTION of its steady value, interpolated.

        Front wheels that turn before the rear ones may give a peak that is no rise. NaN where it does not stay above.
        """
        values, time = self.lateral_acceleration, self.runs.time[self.runs.after]
        level = RISEN_FRACTION * self.end_of(values)
        below, each = values < level, np.arange(values.shape[1])
        last = values.shape[0] - 1 - below[::-1].argmax(axis=0)
        after = np.minimum(last + 1, values.shape[0] - 1)
        share = (level - values[last, each]) / (values[after, each] - values[last, each])
        risen = np.where(last < after, time[last] + share * (time[after] - time[last]), np.nan)
        return np.where(below.any(axis=0), risen, time[0]) - self.runs.steer_time

    @Lazy
    def lateral_overshoot(self) -> FloatArray:
        """Overshoots (n,) of the steady lateral acceleration, in %."""
        steady = self.end_of(self.lateral_acceleration)
        return np.where(steady != 0.0, 100.0 * (self.lateral_acceleration.max(axis=0) / steady - 1.0), 0.0)

    @Lazy
    def is_settled(self) -> BoolArray:
        """Whether the yaw rate is steady at the end, (n,)."""
        swing = np.ptp(self.runs.signals["yaw_rate_rad_s"][self.steady], axis=0)
        result: BoolArray = swing <= STEADY_SWING_MAX_FRACTION * np.maximum(np.abs(self.yaw_rate), YAW_RATE_MIN)
        return result

    @Lazy
    def time_outside_band_s(self) -> FloatArray:
        """Times (n,) in s to the sample after the last one outside the settling band; 0 where all are inside.

        That sample follows the end of a run that ends outside the band.
        """
        time, mean = self.runs.time, np.abs(self.yaw_rate)
        outside = np.abs(self.turned - mean) > (SETTLING_BAND_FRACTION + 1e-12) * np.maximum(mean, YAW_RATE_MIN)
        following = np.append(time[1:], 2.0 * time[-1] - time[-2])[::-1][outside[::-1].argmax(axis=0)]
        return np.where(outside.any(axis=0), self.since_start(following), 0.0)

    def since_start(self, time: FloatArray) -> FloatArray:
        """Return times since the start of steering, without the rounding of the subtraction."""
        result: FloatArray = np.round(time - self.runs.steer_time, 12)
        return result

    @Lazy
    def gain(self) -> FloatArray:
        """Steady yaw rates over the steady angles of the steering wheel, (n,) 1/s."""
        wheel = self.mean("front_angle_rad") * self.runs.steering_ratio
        return np.where(np.abs(np.rad2deg(wheel)) > 1e-6, self.yaw_rate / wheel, np.nan)

    @Lazy
    def sideslip_abs_min(self) -> FloatArray:
        """Smallest sideslip angles after the rise, (n,) rad."""
        past_rise = np.arange(self.runs.time.size)[:, np.newaxis] >= self.risen
        result: FloatArray = np.where(past_rise, np.abs(self.runs.signals["sideslip_rad"]), np.inf).min(axis=0)
        return result


class SlipOfBound(_Steady):
    """Steady slip of each axle relative to its bound in a map of the configured car; NaN for tyres without bounds."""

    slip_front_steady_of_bound_percent = Figure("|front slip|, steady, of its bound", "%", 1, lambda of: of.share("front"))
    slip_rear_steady_of_bound_percent = Figure("|rear slip|, steady, of its bound", "%", 1, lambda of: of.share("rear"))

    def share(self, axle: str) -> FloatArray:
        """Return the steady slip (n,) of an axle over its bound, in %."""
        bounds = self.runs.slip_bounds or (math.nan, math.nan)
        return 100.0 * np.abs(self.mean(f"slip_{axle}_rad")) / bounds[axle == "rear"]
