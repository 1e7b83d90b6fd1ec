"""Figures of a run: what a step steer shows.

Peak and steady value are different things and are always given together: the paper's "maximum" fits the steady value of its
reference, while a PI on a static reference overshoots it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from codegen.sil.software import RECORD_COLUMNS, Status

FloatArray = npt.NDArray[np.float64]

STEADY_WINDOW = 1.0
"""s at the end of the run over which steady values are averaged."""

SETTLED_SHARE = 0.01
"""A run counts as settled where the yaw rate swings by less than this share of its mean over that window."""


@dataclass(frozen=True)
class StepMetrics:
    """Step response (ISO 7401, lateral transient response). Units in the names; rear angle: the actuator's, not the command.

    The reference is None for a car that is not controlled at the end. Where `settled` is false, "steady" is only a mean.

    `overshoot_percent` is of the steady yaw rate; `rise_time_s` runs from the start of steering to 90 % of the steady value.
    """

    settled: bool
    yaw_rate_steady_deg_s: float
    yaw_rate_peak_deg_s: float
    yaw_rate_reference_deg_s: float | None
    overshoot_percent: float
    rise_time_s: float
    sideslip_steady_deg: float
    sideslip_abs_min_deg: float
    sideslip_abs_max_deg: float
    rear_angle_min_deg: float
    rear_angle_max_deg: float
    rear_angle_steady_deg: float
    slip_front_abs_max_deg: float
    slip_rear_abs_max_deg: float
    lateral_acceleration_max_m_s2: float

    def to_dict(self) -> dict[str, float | bool | None]:
        """Name to value."""
        return asdict(self)


def column(record: FloatArray, name: str) -> FloatArray:
    """One column (samples,) of a recording by its name, SI units."""
    return record[:, RECORD_COLUMNS.index(name)]


def step_metrics(record: FloatArray, steer_time: float) -> StepMetrics:
    """Metrics of a recording (samples, 12) in which the driver starts to steer at `steer_time` (s).

    `sideslip_abs_min_deg` is the smallest |beta| after the yaw rate first reached 90 % of its steady value: before, beta starts
    from zero and says nothing.
    """
    time = column(record, "time_s")
    after = time >= steer_time - 1e-9
    steady = time > time[-1] - STEADY_WINDOW

    def degrees(name: str) -> FloatArray:
        result: FloatArray = np.rad2deg(column(record, name))
        return result

    yaw_rate, sideslip, rear = degrees("yaw_rate_rad_s"), degrees("sideslip_rad"), degrees("rear_angle_rad")
    controlled = bool((column(record, "status")[steady] <= Status.LIMITED).all())
    yaw_rate_steady = float(yaw_rate[steady].mean())
    sign = 1.0 if yaw_rate_steady >= 0.0 else -1.0
    peak = sign * float((sign * yaw_rate[after]).max())
    risen = after & (sign * yaw_rate >= 0.9 * abs(yaw_rate_steady))
    first = int(np.flatnonzero(risen)[0]) if risen.any() else len(time) - 1
    settled = np.arange(len(time)) >= first
    swing = float(np.ptp(yaw_rate[steady]))
    return StepMetrics(
        settled=swing <= SETTLED_SHARE * max(abs(yaw_rate_steady), 1e-9),
        yaw_rate_steady_deg_s=yaw_rate_steady,
        yaw_rate_peak_deg_s=peak,
        yaw_rate_reference_deg_s=float(degrees("yaw_rate_reference_rad_s")[steady].mean()) if controlled else None,
        overshoot_percent=100.0 * (peak / yaw_rate_steady - 1.0) if yaw_rate_steady else 0.0,
        rise_time_s=float(time[first]) - steer_time,
        sideslip_steady_deg=float(sideslip[steady].mean()),
        sideslip_abs_min_deg=float(np.abs(sideslip[settled]).min()),
        sideslip_abs_max_deg=float(np.abs(sideslip[after]).max()),
        rear_angle_min_deg=float(rear[after].min()),
        rear_angle_max_deg=float(rear[after].max()),
        rear_angle_steady_deg=float(rear[steady].mean()),
        slip_front_abs_max_deg=float(np.abs(degrees("slip_front_rad")[after]).max()),
        slip_rear_abs_max_deg=float(np.abs(degrees("slip_rear_rad")[after]).max()),
        lateral_acceleration_max_m_s2=float(np.abs(column(record, "lateral_acceleration_m_s2")[after]).max()),
    )
