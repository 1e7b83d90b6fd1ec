"""Operating points: step steers over speed and amplitude."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from codegen.configuration import Case, Config
from codegen.errors import CodegenError
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from hil_sim import manoeuvres
from hil_sim.manoeuvres import Settings
from hil_sim.scenarios import Scenario

SPEEDS_KM_H = (25.0, 42.5, 60.0, 80.0, 100.0, 120.0)
SHARES = (0.25, 0.5, 0.75, 1.0)
"""Fractions of the largest feasible front angle at a speed."""

STEER_TIME = 1.0
DURATION = 9.0
"""Duration in s. After the step 8 s remain: four time constants of a slow trim, and one second for the steady values."""

C1_SPEED_KM_H = 42.5
C1_STEERING_WHEEL_DEG = 90.0
"""The paper's step, section Validation Setup."""


@dataclass(frozen=True)
class Cell:
    """A step steer at a constant speed, the steering wheel turned as fast as the configuration allows.

    Attributes:
        speed_km_h: speed of the car.
        front_angle_deg: angle at the road wheels, to the left.
        share: fraction of the largest feasible front angle at that speed; None for another choice of angle.
    """

    speed_km_h: float
    front_angle_deg: float
    share: float | None = None

    @property
    def title(self) -> str:
        """Text for tables."""
        share = "" if self.share is None else f" ({100.0 * self.share:g} %)"
        return f"{self.speed_km_h:g} km/h, {self.front_angle_deg:.3g} deg{share}"

    def scenario(self, config: Config, friction: float | None = None, estimate: float | None = None) -> Scenario:
        """Return the scenario on a road (None: the configured friction), with a friction estimate (None: unknown)."""
        return Scenario(
            name="step-steer-cell",
            subject="Step steer",
            what="one cell of the test set",
            source="ISO 7401:2011, clause 10 (step input)",
            duration=DURATION,
            steer_time=STEER_TIME,
            kind="step",
            drive=manoeuvres.step(STEER_TIME),
            settings=Settings(self.speed_km_h, self.front_angle_deg * config.steering.ratio, friction, estimate),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)


def cells(
    config: Config, case: Case, speeds_km_h: tuple[float, ...] = SPEEDS_KM_H, shares: tuple[float, ...] = SHARES
) -> tuple[Cell, ...]:
    """Return the cells of a car: speeds times shares, by default 24; fewer if the grid ends at a lower speed.

    The largest feasible front angle is that of the continuous problem, capped at the grid's last front angle.

    Raises:
        CodegenError: the grid ends below the first of the speeds.
        ConfigError: see `turns_of` and `breakpoints`.
    """
    speed, front_angle = breakpoints(config)
    speeds = tuple(value for value in speeds_km_h if value * KM_H <= speed[-1] * (1.0 + 1e-9))
    if not speeds:
        raise CodegenError(
            f"the grid ends at {speed[-1] / KM_H:.4g} km/h, and the slowest cell of the test set has {speeds_km_h[0]:g}",
            where="grid",
            remedy="solve a map that reaches higher speeds",
        )
    edge = turns_of(config, case).edge(np.array(speeds) * KM_H, float(front_angle[-1])).front_angle
    largest = np.rad2deg(np.minimum(edge, front_angle[-1]))
    return tuple(
        Cell(value, share * float(angle), share) for value, angle in zip(speeds, largest, strict=True) for share in shares
    )


def c1(config: Config) -> Cell:
    """Return the paper's step."""
    return Cell(C1_SPEED_KM_H, C1_STEERING_WHEEL_DEG / config.steering.ratio)


def front_angle(cell: Cell) -> float:
    """Return the front angle at the road wheels in rad."""
    return math.radians(cell.front_angle_deg)
