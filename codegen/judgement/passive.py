"""Steady turns of the nonlinear car with its rear wheels straight, up to the peak of its tyres.

The passive car of a map ends at the slip bounds of that map, and so cannot measure it. Here each axle may use PEAK_SLIP of the
slip angle at which its force peaks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.optimum.nonlinear_car import SteadyCar
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

PEAK_SLIP = 0.9
"""Largest slip angle as a fraction of that of the peak force; the tyre of the presets has 99.8 % of its peak force there."""
POINTS = 200
"""Lateral accelerations at each speed, from zero to the friction of the road."""
ROUNDS, TOLERANCE = 40, 1e-6
"""Iterations for the front angle, and the largest rear angle in rad that counts as straight. Near the limit of grip each round
gains a digit; the points that have not converged lie beyond it."""
FRONT_ANGLE_MAX = 0.6
"""Largest front angle of the search in rad, beyond those of the maps that are compared."""


def usable_slip(tyre: MagicFormulaTyre) -> float:
    """Return the largest slip angle in rad of the passive car's turns."""
    return PEAK_SLIP * min(tyre.peak_slip, FRONT_ANGLE_MAX)


@dataclass(frozen=True)
class PassiveTurns:
    """Steady turns over speeds (n,) in m/s and POINTS lateral accelerations in m/s^2.

    `front_angle`: (n, POINTS) rad, NaN where there is no turn.
    """

    speed: FloatArray
    lateral_acceleration: FloatArray
    front_angle: FloatArray

    @classmethod
    def of(cls, config: Config, speed: FloatArray) -> PassiveTurns:
        """Return the turns of a car at speeds in m/s, on the road of its configuration."""
        tyres = AxleTyres.from_config(config)
        car = SteadyCar.from_config(config, (usable_slip(tyres.front), usable_slip(tyres.rear)))
        largest = config.road.friction * config.road.gravity_m_s2
        acceleration: FloatArray = np.linspace(0.0, largest, POINTS + 1)[1:]
        speeds, accelerations = (values.ravel() for values in np.meshgrid(speed, acceleration, indexing="ij"))
        found = _front_angles(car, speeds, accelerations / speeds).reshape(speed.size, POINTS)
        return cls(speed, acceleration, _first_rise(found))

    @property
    def largest(self) -> FloatArray:
        """Largest lateral accelerations (n,) in m/s^2; zero where there is no turn."""
        result: FloatArray = np.where(np.isfinite(self.front_angle), self.lateral_acceleration, 0.0).max(axis=1)
        return result

    def front_angle_at(self, lateral_acceleration: FloatArray) -> FloatArray:
        """Return the front angles (n, k) in rad at lateral accelerations (n, k) in m/s^2; NaN where there is no turn."""
        rows = []
        for wanted, angles in zip(lateral_acceleration, self.front_angle, strict=True):
            known = np.concatenate([[0.0], angles[np.isfinite(angles)]])
            rows.append(np.interp(wanted, np.append(0.0, self.lateral_acceleration)[: known.size], known, right=np.nan))
        return np.array(rows)

    def yaw_rate(self, front_angle: FloatArray) -> FloatArray:
        """Return the yaw rates (n, m) in rad/s at front angles (m,); NaN where there is no turn."""
        rows = []
        for speed, angles in zip(self.speed, self.front_angle, strict=True):
            count = int(np.isfinite(angles).sum())
            known = np.concatenate([[0.0], angles[:count]])
            rates = np.concatenate([[0.0], self.lateral_acceleration[:count] / speed])
            rows.append(np.interp(front_angle, known, rates, right=np.nan))
        return np.array(rows)


def _front_angles(car: SteadyCar, speed: FloatArray, yaw_rate: FloatArray) -> FloatArray:
    """Return the front angles (k,) with straight rear wheels; NaN for none.

    The rear angle that a turn needs rises with the front angle by about as much: subtracting it is Newton's method. Points
    that have converged are not solved again.
    """
    angle = car.wheelbase * yaw_rate / speed
    result = np.full(angle.shape, np.nan)
    open_points = np.arange(angle.size)
    for _ in range(ROUNDS):
        with np.errstate(all="ignore"):  # turns beyond the grip
            turns = car.turns(speed[open_points], angle[open_points], yaw_rate[open_points])
        inside = (np.abs(turns.slip_front) <= car.front.slip_max) & (np.abs(turns.slip_rear) <= car.rear.slip_max)
        is_straight = np.abs(turns.rear_angle) < TOLERANCE
        rear = np.where(np.isfinite(turns.rear_angle), turns.rear_angle, 0.0)
        found = inside & is_straight & turns.converged
        result[open_points[found]] = (angle[open_points] - rear)[found]
        open_points, rear = open_points[~is_straight], rear[~is_straight]
        if not open_points.size:
            break
        angle[open_points] = np.clip(angle[open_points] - rear, 0.0, FRONT_ANGLE_MAX)
    return result


def _first_rise(angles: FloatArray) -> FloatArray:
    """Return angles (n, k) up to the first that is missing or no larger than the one before; no driver holds turns beyond."""
    before = np.concatenate([np.zeros((angles.shape[0], 1)), angles[:, :-1]], axis=1)
    result: FloatArray = np.where(np.logical_and.accumulate(angles > before, axis=1), angles, np.nan)
    return result
