"""Synthetic recordings."""

from typing import Any

import numpy as np

from codegen.sil.software import RECORD_COLUMNS


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
