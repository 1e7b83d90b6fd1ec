"""Synthetic recordings."""

import math
from typing import Any

import numpy as np

from codegen.configuration import preset
from codegen.sil.software import RECORD_COLUMNS
from hil_sim import manoeuvres


def record(duration: float, **columns: Any) -> np.ndarray:
    """Return a recording with rows of 10 ms; each column is a value or a function of time."""
    time = np.arange(round(duration / 0.01)) * 0.01
    made = np.zeros((len(time), len(RECORD_COLUMNS)))
    for name, values in {"time_s": time, "speed_m_s": 20.0, **columns}.items():
        made[:, RECORD_COLUMNS.index(name)] = values(time) if callable(values) else values
    return made


def spun(made: np.ndarray, since: float) -> np.ndarray:
    """Return the recording of a car that spins from a time (s) on."""
    spinning = made.copy()
    for name in ("sideslip_rad", "slip_rear_rad"):
        spinning[made[:, 0] >= since - 1e-9, RECORD_COLUMNS.index(name)] = 0.3
    return spinning


def dwell_record(sign: float = 1.0, ratios: tuple[float, float] = (30.0, -5.0), lateral: float = 4.0) -> np.ndarray:
    """Return a recording of the standard's steering from 1 s on; the yaw rate falls to its second peak, -0.5 rad/s, at 2.2 s.

    `ratios` are the yaw rates 1.00 s and 1.75 s after the end of steering, in % of that peak.
    """
    end = 1.0 + manoeuvres.DWELL_LENGTH
    times = [1.0, 1.3, 2.2, end, end + 1.00, end + 1.75]
    rates = [0.0, 0.6, -0.5, -0.45, *(-0.5 * share / 100.0 for share in ratios)]
    return record(
        6.0,
        front_angle_rad=lambda t: sign * math.radians(80.0) / preset().steering.ratio * manoeuvres.dwell_shape(t - 1.0),
        yaw_rate_rad_s=lambda t: sign * np.interp(t, times, rates),
        lateral_acceleration_m_s2=lambda t: sign * np.where(t > 0.9, lateral, 0.0),
    )
