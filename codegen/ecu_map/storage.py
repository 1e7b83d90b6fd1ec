"""How the tables are stored: as real numbers, or as 16-bit integers with one scale for each table, value = scale * raw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Real = type[np.float32] | type[np.float64]
Storage = Literal["float", "int16"]

RAW_MAX = 32767
"""The largest raw number; -32768 is not used, so that a table may be turned to the other side."""


@dataclass(frozen=True)
class Scales:
    """Of int16 tables: rad/s and rad for each raw unit, as the target's precision holds them."""

    yaw_rate: float
    rear_angle: float

    @classmethod
    def of(cls, yaw_rate_max: float, rear_angle_max: float, real: Real) -> Scales:
        """The finest for the largest magnitudes, rad/s and rad."""
        return cls(scale_of(yaw_rate_max, real), scale_of(rear_angle_max, real))


def scale_of(largest: float, real: Real) -> float:
    """The finest with which a raw number reaches `largest`, as the target's precision holds it."""
    scale = real((largest or 1.0) / RAW_MAX)
    while float(scale) * RAW_MAX < largest:
        scale = np.nextafter(scale, real(np.inf))
    return float(scale)


def raw_of(table: FloatArray, scale: float) -> npt.NDArray[np.int16]:
    """The nearest raw numbers of a table of any shape."""
    raw: npt.NDArray[np.int16] = np.clip(np.rint(table / scale), -RAW_MAX, RAW_MAX).astype(np.int16)
    return raw


def values_of(raw: npt.NDArray[Any], scale: float) -> FloatArray:
    """What raw numbers stand for. In single precision the products are exact here and rounded once, there as in the C."""
    return scale * raw.astype(np.float64)


def table_bytes(speeds: int, front_angles: int, tables: int, layers: int, storage: Storage, real: Real) -> int:
    """Bytes of the tables with their axes, scales and, for a stack, frictions: all that grows with the breakpoints."""
    number = np.dtype(real).itemsize
    frictions = layers if layers > 1 else 0
    cells, scales = tables * layers * speeds * front_angles, tables if storage == "int16" else 0
    return cells * (2 if storage == "int16" else number) + number * (speeds + front_angles + frictions + scales)
