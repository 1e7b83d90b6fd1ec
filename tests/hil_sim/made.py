"""Recordings made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from codegen.sil.software import RECORD_COLUMNS


def record(duration: float, **columns: Any) -> np.ndarray:
    """A recording of 10 ms rows; each column a value, or a function of time."""
    time = np.arange(round(duration / 0.01)) * 0.01
    made = np.zeros((len(time), len(RECORD_COLUMNS)))
    for name, values in {"time_s": time, "speed_m_s": 20.0, **columns}.items():
        made[:, RECORD_COLUMNS.index(name)] = values(time) if callable(values) else values
    return made
