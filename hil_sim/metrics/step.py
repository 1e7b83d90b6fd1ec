"""Metrics of a step steer (ISO 7401:2011, clause 10).

Peak and steady value are always given together: the paper's "maximum" fits the steady value of its reference, while a PI on a
static reference overshoots it.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.sil.software import Status
from codegen.vehicle.tyre import AxleTyres
from hil_sim.metrics.run import Metric, Run, column

STEADY_WINDOW = 1.0
"""Time at the end of the run, in s, over which steady values are averaged."""

STEADY_SWING_MAX_FRACTION = 0.01
"""A run is settled where the range of the yaw rate over that window is below this fraction of its mean."""

SETTLING_BAND_FRACTION = 0.02
"""Half of the width of the settling band, as a fraction of the steady yaw rate."""


@dataclass(frozen=True)
class StepMetrics:
    """Step response (ISO 7401, lateral transient response). The names hold the units; the rear angle is the actuator's.

    The reference is None for a car that is not controlled at the end. Where `settled` is false, "steady" is only a mean.
    `map_error_percent` and `map_overshoot_percent` compare the steady yaw rate and its peak with the map's steady yaw rate for
    speed, front angle and friction estimate at the end. They are negative where the car turns less, and None where no map is
    known.

    `overshoot_percent` is relative to the steady yaw rate. `rise_time_s`, `peak_time_s` and `settling_time_s` are measured from
    the start of steering: to 90 % of the steady value, to the peak, and to where the yaw rate stays within 2 % of its steady
    value (None where it does not settle). `yaw_rate_gain_per_s` is the steady yaw rate over the steady angle of the steering
    wheel; None where that is zero.
    """

    settled: bool
    yaw_rate_steady_deg_s: float
    yaw_rate_peak_deg_s: float
    yaw_rate_reference_deg_s: float | None
    map_yaw_rate_deg_s: float | None
    map_error_percent: float | None
    map_overshoot_percent: float | None
    overshoot_percent: float
    rise_time_s: float
    settling_time_s: float | None
    peak_time_s: float
    yaw_rate_gain_per_s: float | None
    sideslip_steady_deg: float
    sideslip_abs_min_deg: float
    sideslip_abs_max_deg: float
    rear_angle_min_deg: float
    rear_angle_max_deg: float
    rear_angle_steady_deg: float
    slip_front_abs_max_deg: float
    slip_rear_abs_max_deg: float
    lateral_acceleration_max_m_s2: float
    slip_front_steady_deg: float
    slip_rear_steady_deg: float

    def to_dict(self) -> dict[str, float | bool | None]:
        """Return the values by name."""
        return asdict(self)


STEP_ROWS = (
    ("yaw_rate_steady_deg_s", "yaw rate, steady", "deg/s", 2),
    ("yaw_rate_peak_deg_s", "yaw rate, peak", "deg/s", 2),
    ("yaw_rate_reference_deg_s", "reference, steady", "deg/s", 2),
    ("map_yaw_rate_deg_s", "map, steady", "deg/s", 2),
    ("map_error_percent", "error to the map, steady", "%", 1),
    ("map_overshoot_percent", "overshoot of the map", "%", 1),
    ("overshoot_percent", "overshoot of the steady yaw rate", "%", 1),
    ("rise_time_s", "rise time to 90 %", "s", 2),
    ("settling_time_s", "settling time to 2 %", "s", 2),
    ("peak_time_s", "peak time", "s", 2),
    ("yaw_rate_gain_per_s", "yaw-rate gain, steady", "1/s", 3),
    ("sideslip_steady_deg", "sideslip, steady", "deg", 2),
    ("sideslip_abs_min_deg", "|sideslip|, smallest after the rise", "deg", 2),
    ("sideslip_abs_max_deg", "|sideslip|, largest", "deg", 2),
    ("rear_angle_min_deg", "rear angle, smallest", "deg", 2),
    ("rear_angle_max_deg", "rear angle, largest", "deg", 2),
    ("rear_angle_steady_deg", "rear angle, steady", "deg", 2),
    ("slip_front_abs_max_deg", "|front slip|, largest", "deg", 2),
    ("slip_rear_abs_max_deg", "|rear slip|, largest", "deg", 2),
    ("lateral_acceleration_max_m_s2", "lateral acceleration, largest", "m/s^2", 2),
    ("slip_front_steady_deg", "front slip, steady", "deg", 2),
    ("slip_rear_steady_deg", "rear slip, steady", "deg", 2),
)
"""Key, title, unit and digits of the rows below `settled`."""


def step_metrics(
    record: FloatArray, steer_time: float, steering_ratio: float = 1.0, map_yaw_rate: float | None = None
) -> StepMetrics:
    """Return the metrics of a recording (samples, 12).

    `sideslip_abs_min_deg` is the smallest |beta| after the yaw rate first reached 90 % of its steady value; before, beta starts
    from zero.

    Args:
        steer_time: time in s at which the driver starts to steer.
        steering_ratio: ratio of steering wheel to road wheel; 1 gives the gain of the front angle.
        map_yaw_rate: steady yaw rate of the map at the end of the run, in rad/s; None where it is not known.
    """
    time = column(record, "time_s")
    after = time >= steer_time - 1e-9
    steady = time > time[-1] - STEADY_WINDOW

    def degrees(name: str) -> FloatArray:
        result: FloatArray = np.rad2deg(column(record, name))
        return result

    yaw_rate, sideslip, rear = degrees("yaw_rate_rad_s"), degrees("sideslip_rad"), degrees("rear_angle_rad")
    # A car is controlled although single samples are held.
    controlled = steady & (column(record, "status") <= Status.LIMITED)
    mostly = 2 * np.count_nonzero(controlled) > np.count_nonzero(steady)
    reference = float(degrees("yaw_rate_reference_rad_s")[controlled].mean()) if mostly else None
    yaw_rate_steady = float(yaw_rate[steady].mean())
    sign = 1.0 if yaw_rate_steady >= 0.0 else -1.0
    peak = sign * float((sign * yaw_rate[after]).max())
    risen = after & (sign * yaw_rate >= 0.9 * abs(yaw_rate_steady))
    first = int(np.flatnonzero(risen)[0]) if risen.any() else len(time) - 1
    past_rise = np.arange(len(time)) >= first
    swing, size = float(np.ptp(yaw_rate[steady])), max(abs(yaw_rate_steady), 1e-9)
    wheel = float(degrees("front_angle_rad")[steady].mean()) * steering_ratio
    settled = swing <= STEADY_SWING_MAX_FRACTION * size
    outside = np.flatnonzero(after & (np.abs(yaw_rate - yaw_rate_steady) > SETTLING_BAND_FRACTION * size))
    # The sample after the last one outside the band: a settled run ends inside.
    inside_from = float(time[outside[-1] + 1]) if settled and outside.size else steer_time
    return StepMetrics(
        settled=settled,
        yaw_rate_steady_deg_s=yaw_rate_steady,
        yaw_rate_peak_deg_s=peak,
        yaw_rate_reference_deg_s=reference,
        map_yaw_rate_deg_s=None if map_yaw_rate is None else math.degrees(map_yaw_rate),
        map_error_percent=map_error(yaw_rate_steady, map_yaw_rate),
        map_overshoot_percent=map_error(peak, map_yaw_rate),
        overshoot_percent=100.0 * (peak / yaw_rate_steady - 1.0) if yaw_rate_steady else 0.0,
        rise_time_s=float(time[first]) - steer_time,
        settling_time_s=inside_from - steer_time if settled else None,
        peak_time_s=float(time[after][np.argmax(sign * yaw_rate[after])]) - steer_time,
        yaw_rate_gain_per_s=yaw_rate_steady / wheel if abs(wheel) > 1e-6 else None,
        sideslip_steady_deg=float(sideslip[steady].mean()),
        sideslip_abs_min_deg=float(np.abs(sideslip[past_rise]).min()),
        sideslip_abs_max_deg=float(np.abs(sideslip[after]).max()),
        rear_angle_min_deg=float(rear[after].min()),
        rear_angle_max_deg=float(rear[after].max()),
        rear_angle_steady_deg=float(rear[steady].mean()),
        slip_front_abs_max_deg=float(np.abs(degrees("slip_front_rad")[after]).max()),
        slip_rear_abs_max_deg=float(np.abs(degrees("slip_rear_rad")[after]).max()),
        slip_front_steady_deg=float(degrees("slip_front_rad")[steady].mean()),
        slip_rear_steady_deg=float(degrees("slip_rear_rad")[steady].mean()),
        lateral_acceleration_max_m_s2=float(np.abs(column(record, "lateral_acceleration_m_s2")[after]).max()),
    )


def map_error(yaw_rate_deg_s: float, map_yaw_rate: float | None) -> float | None:
    """Return the error of a yaw rate (deg/s) relative to that of the map (rad/s), in %; None where that is 0 or unknown."""
    return 100.0 * (math.radians(yaw_rate_deg_s) / map_yaw_rate - 1.0) if map_yaw_rate else None


def measure(run: Run) -> list[Metric]:
    """Return the step response as rows of a table."""
    of_map = None if run.map_yaw_rate is None else float(run.map_yaw_rate[-1])
    found = step_metrics(run.record, run.scenario.steer_time, run.config.steering.ratio, of_map)
    rows = [Metric("settled", "settled at the end", "", found.settled, words=("NO: means only", "yes"))]
    rows += [Metric(key, title, unit, getattr(found, key), digits) for key, title, unit, digits in STEP_ROWS]
    for axle, bound in zip(("front", "rear"), slip_bounds(run.config) or (None, None), strict=True):
        slip = abs(getattr(found, f"slip_{axle}_steady_deg"))
        share = None if bound is None else 100.0 * slip / math.degrees(bound)
        rows.append(Metric(f"slip_{axle}_steady_of_bound_percent", f"|{axle} slip|, steady, of its bound", "%", share, 1))
    return rows


def slip_bounds(config: Config) -> tuple[float, float] | None:
    """Return the slip bounds of front and rear axle in a map of the configured car, in rad; None for tyres without bounds."""
    try:
        tyres = AxleTyres.from_config(config)
    except ConfigError:  # nearly linear tyres; a map from another tool needs no bound
        return None
    return tyres.front_slip_bound, tyres.rear_slip_bound
