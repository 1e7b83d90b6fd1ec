"""Margins of a subject's feedback over speed, for the configured car and the whole family of cars."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.design.margins import Margins, family_margins, nominal_margins
from codegen.emit.laws import law_of
from codegen.units import KM_H

SPEEDS_KM_H = (20.0, 25.0, 30.0, 36.0, 42.5, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0)
"""Speeds at and between the breakpoints of a schedule."""


@dataclass(frozen=True)
class MarginPoint:
    """The worst figures of the family at one speed; each may be of another member. Sensitivity is None for unstable loops."""

    speed_km_h: float
    gain_margin_db: float
    phase_margin_deg: float
    sensitivity: float | None
    stable: bool


@dataclass(frozen=True)
class FamilyMargins:
    """Margins over speed, and the worst of all speeds.

    Attributes:
        points: the worst of the family at each speed.
        configured: those of the configured car alone.
    """

    points: tuple[MarginPoint, ...]
    configured: tuple[MarginPoint, ...] = ()

    @property
    def gain_margin_db(self) -> float:
        """Smallest gain margin, in dB."""
        return min(point.gain_margin_db for point in self.points)

    @property
    def phase_margin_deg(self) -> float:
        """Smallest phase margin, in deg."""
        return min(point.phase_margin_deg for point in self.points)

    @property
    def sensitivity(self) -> float | None:
        """Largest peak sensitivity; None if a loop is unstable."""
        peaks = [point.sensitivity for point in self.points]
        return None if None in peaks else max(peak for peak in peaks if peak is not None)

    def speed_of(self, name: str) -> float:
        """Return the speed in km/h at which a figure (a field of MarginPoint) is worst."""
        choose = max if name == "sensitivity" else min
        return choose(self.points, key=lambda point: float("inf") if (v := getattr(point, name)) is None else v).speed_km_h

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values. Infinity becomes None, as JSON has no infinity."""
        return {
            name: [{key: finite_or_none(value) for key, value in asdict(point).items()} for point in getattr(self, name)]
            for name in ("points", "configured")
        }


def finite_or_none(value: float | None) -> float | None:
    """Return a value; None for infinity, which JSON cannot represent."""
    return value if value is not None and np.isfinite(value) else None


def margins_of(config: Config, speeds_km_h: tuple[float, ...] = SPEEDS_KM_H) -> FamilyMargins | None:
    """Return the margins of the configured car and the worst of the family of `config.tuning`; None without feedback.

    Raises:
        BuildError: the kind lacks a required function. ConfigError: an empty family.
    """
    gains = law_of(config).gains(config)
    if gains is None:
        return None
    speed = np.array(speeds_km_h) * KM_H
    worst, _ = family_margins(config, speed, *gains(speed))
    own = nominal_margins(config, speed, *gains(speed))
    return FamilyMargins(_points(speeds_km_h, worst), _points(speeds_km_h, own))


def _points(speeds_km_h: tuple[float, ...], margins: Margins) -> tuple[MarginPoint, ...]:
    return tuple(
        MarginPoint(
            speed,
            float(margins.gain_margin_db[k]),
            float(margins.phase_margin_deg[k]),
            float(margins.sensitivity[k]) if np.isfinite(margins.sensitivity[k]) else None,
            bool(margins.stable[k]),
        )
        for k, speed in enumerate(speeds_km_h)
    )
