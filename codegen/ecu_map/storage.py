"""Storage of the tables: real numbers, or 16-bit integers with one scale for each table, value = scale * raw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray

Real = type[np.float32] | type[np.float64]
Storage = Literal["float", "int16"]

RAW_MAX = 32767
"""Largest raw number; -32768 is unused, so that every value has its negative."""


@dataclass(frozen=True)
class Scales:
    """Scales of int16 tables: rad/s and rad for each raw unit, in the target's precision."""

    yaw_rate: float
    rear_angle: float

    @classmethod
    def of(cls, yaw_rate_max: float, rear_angle_max: float, real: Real) -> Scales:
        """Return the finest scales for the largest magnitudes, rad/s and rad."""
        return cls(scale_of(yaw_rate_max, real), scale_of(rear_angle_max, real))


def scale_of(largest: float, real: Real) -> float:
    """Return the finest scale with which a raw number reaches `largest`, in the target's precision."""
    scale = real((largest or 1.0) / RAW_MAX)
    while float(scale) * RAW_MAX < largest:
        scale = np.nextafter(scale, real(np.inf))
    return float(scale)


def raw_of(table: FloatArray, scale: float) -> npt.NDArray[np.int16]:
    """Return the nearest raw numbers of a table of any shape."""
    raw: npt.NDArray[np.int16] = np.clip(np.rint(table / scale), -RAW_MAX, RAW_MAX).astype(np.int16)
    return raw


def values_of(raw: npt.NDArray[Any], scale: float) -> FloatArray:
    """Return the values of raw numbers. In single precision the products are exact here and rounded once, there as in the C."""
    return scale * raw.astype(np.float64)


def table_bytes(speeds: int, front_angles: int, tables: int, layers: int, storage: Storage, real: Real) -> int:
    """Return the bytes of the tables with their axes, scales and, for a stack, frictions."""
    number = np.dtype(real).itemsize
    frictions = layers if layers > 1 else 0
    cells, scales = tables * layers * speeds * front_angles, tables if storage == "int16" else 0
    return cells * (2 if storage == "int16" else number) + number * (speeds + front_angles + frictions + scales)
