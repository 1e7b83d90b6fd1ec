"""Loss of rear steering: its consequences for a map.

There are two results. The first is the set of operating points that are feasible only with rear steer: the same car under the
same bounds cannot drive them with its rear wheels straight. The second is the motion after the loss. At some operating points
the two-track plant is in its steady turn. The driver holds the front angle and the speed, and from t = 0 the rear angle is
held, ramped to zero or set to zero.

The operating points: eight speeds, evenly spaced from the lowest to the highest at which the map has a feasible cell and the
controller does not stand by, each moved to the nearest such breakpoint; at each 50, 75 and 100 % of the front angle of the
last feasible cell, with the map's own values, interpolated over the front angle.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.design.loss_simulation import MODES, Points, simulate
from codegen.map_file.map import ReferenceMap
from codegen.optimum.turns import passively_feasible, turns_behind
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack

__all__ = ["MODES", "LossOfFunction", "loss_of_function", "rounded"]


SPEEDS = 8
SHARES = (0.5, 0.75, 1.0)
"""Fractions of the largest feasible front angle."""

KEPT_RESULTS = 4


@dataclass(frozen=True, eq=False)
class LossOfFunction:
    """Consequences of losing rear steering for a map of n speeds and m front angles, at k operating points. Read-only arrays.

    Attributes:
        only_with_rear_steer: (n, m) feasible in the map and not with the rear wheels straight; None for a bare map.
        share_of_feasible: share of these among the feasible cells; None for a bare map.
        speed: (k,) m/s. front_angle: (k,) rad. rear_angle: (k,) rad, before the loss, within the actuator's angle. Where a
            bare map has none it is delta_f - r/G, which gives the map's yaw rate in the linear single-track car.
        passively_feasible: (k,) whether the point is feasible without rear steer too; None for a bare map.
        settles: (k,) whether the plant settles into a steady turn before the loss. Where not, the loss is not simulated.
        sideslip: (k,) rad, of that steady turn, with sign; NaN where it does not settle.
        ramp_rate: (k,) rad/s: the fail-safe's rate.
        sideslip_max: (3, k) rad, largest magnitude from t = 0 on for each of MODES; NaN where it does not settle.
        spins: (3, k) whether the car spins (see `loss_simulation.SPIN_SIDESLIP`); False where it does not settle.
        horizon: (3,) s simulated in each mode.
    """

    only_with_rear_steer: BoolArray | None
    share_of_feasible: float | None
    speed: FloatArray
    front_angle: FloatArray
    rear_angle: FloatArray
    passively_feasible: BoolArray | None
    settles: BoolArray
    sideslip: FloatArray
    ramp_rate: FloatArray
    sideslip_max: FloatArray
    spins: BoolArray
    horizon: tuple[float, float, float]

    @property
    def share_of_grid(self) -> float | None:
        """Share of the cells feasible only with rear steer among all; None for a bare map."""
        return None if self.only_with_rear_steer is None else float(np.mean(self.only_with_rear_steer))

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values, in lists with an entry for each operating point; null where the plant does not settle.

        Cells that are feasible only with rear steer are "x" in a text for each speed.

        Sideslip angles are rounded to 0.1 deg, so that the last bits of a libm do not show.
        """
        only: dict[str, Any] | None = None
        if self.only_with_rear_steer is not None:
            only = {
                "cells": int(self.only_with_rear_steer.sum()),
                "share_of_feasible": rounded(self.share_of_feasible, 4),
                "share_of_grid": rounded(self.share_of_grid, 4),
                "by_speed_and_front_angle": ["".join(".x"[int(cell)] for cell in row) for row in self.only_with_rear_steer],
            }
        points: dict[str, Any] = {
            "speed_km_h": [rounded(value, 2) for value in self.speed / KM_H],
            "front_angle_deg": _degrees(self.front_angle, 3),
            "rear_angle_deg": _degrees(self.rear_angle, 2),
            "passively_feasible": None if self.passively_feasible is None else self.passively_feasible.tolist(),
            "settles": self.settles.tolist(),
            "sideslip_deg": _degrees(self.sideslip, 1),
            "ramp_rate_deg_s": _degrees(self.ramp_rate, 2),
        }
        modes = {
            mode: {
                "horizon_s": rounded(self.horizon[row], 2),
                "sideslip_max_deg": _degrees(self.sideslip_max[row], 1),
                "spins": [bool(spins) if known else None for spins, known in zip(self.spins[row], self.settles, strict=True)],
            }
            for row, mode in enumerate(MODES)
        }
        return {"only_with_rear_steer": only, "operating_points": points, "rear_angle_after_loss": modes}


def rounded(value: float | None, digits: int) -> float | None:
    """Return a number rounded for JSON, which has neither NaN nor infinity; -0.0 becomes 0.0."""
    return round(float(value), digits) + 0.0 if value is not None and math.isfinite(value) else None


def _degrees(values: FloatArray, digits: int) -> list[float | None]:
    return [rounded(value, digits) for value in np.rad2deg(values)]


def loss_of_function(reference_map: ReferenceMap, config: Config) -> LossOfFunction:
    """Return the consequences of losing rear steering for a map, on the road of the map (without the layers of a stack).

    Results are cached by map and configuration.

    Args:
        reference_map: solved or bare. The car that it was solved for decides what is feasible without rear steer.
        config: the simulated car, its road, its actuator and its fail-safe.
    """
    return _kept(_Request(_digest(reference_map, config), reference_map, config))


@dataclass(frozen=True)
class _Request:
    """The arguments, compared by a digest of everything that affects the result."""

    digest: str
    reference_map: ReferenceMap = field(compare=False)
    config: Config = field(compare=False)


def _digest(reference_map: ReferenceMap, config: Config) -> str:
    own = reference_map.config
    texts = (config.to_json(), "" if own is None else own.to_json(), str(reference_map.case), str(reference_map.solved))
    tables = (
        reference_map.speed,
        reference_map.front_angle,
        reference_map.yaw_rate,
        reference_map.feasible,
        reference_map.rear_angle,
    )
    hashed = hashlib.sha256()
    for text in texts:
        hashed.update(f"{len(text)}:{text}".encode())
    for table in tables:
        hashed.update(b"none" if table is None else f"{table.dtype.str}{table.shape}".encode() + table.tobytes())
    return hashed.hexdigest()


@lru_cache(maxsize=KEPT_RESULTS)
def _kept(request: _Request) -> LossOfFunction:
    result = _computed(request.reference_map, request.config)
    for entry in fields(result):
        value = getattr(result, entry.name)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)  # shared through the cache
    return result


def _computed(reference_map: ReferenceMap, config: Config) -> LossOfFunction:
    points = _operating_points(reference_map, config)
    only = share = passive = None
    turns = turns_behind(reference_map)
    if turns is not None:
        feasible = reference_map.feasible
        only = feasible & ~passively_feasible(turns, reference_map.speed, reference_map.front_angle)
        share = float(only.sum() / max(int(feasible.sum()), 1))
        passive = turns.without_rear_steering().at(points.speed, points.front_angle).feasible
    ramp_rate = _ramp_rate(points.speed, config)
    simulated = simulate(points, ramp_rate, config)
    return LossOfFunction(
        only_with_rear_steer=only,
        share_of_feasible=share,
        speed=points.speed,
        front_angle=points.front_angle,
        rear_angle=points.rear_angle,
        passively_feasible=passive,
        settles=simulated.settles,
        sideslip=simulated.sideslip,
        ramp_rate=ramp_rate,
        sideslip_max=simulated.sideslip_max,
        spins=simulated.spins,
        horizon=simulated.horizon,
    )


def _ramp_rate(speed: FloatArray, config: Config) -> FloatArray:
    """Return the rate of the fail-safe in rad/s at speeds (k,)."""
    return np.full_like(speed, math.radians(config.controller.fail_safe.rate_deg_s))


def _rows(reference_map: ReferenceMap, config: Config) -> npt.NDArray[np.intp]:
    """Return the indices of the examined speeds. Where the controller stands by there is no function to lose."""
    speed = reference_map.speed
    standby = config.controller.disable_speed_km_h * KM_H
    usable = np.flatnonzero(reference_map.feasible.any(axis=1) & (speed >= standby))
    if not usable.size:
        return usable
    wanted = np.linspace(speed[usable[0]], speed[usable[-1]], SPEEDS)
    nearest = np.argmin(np.abs(speed[usable] - wanted[:, np.newaxis]), axis=1)
    return np.unique(usable[nearest])


def _operating_points(reference_map: ReferenceMap, config: Config) -> Points:
    """Return the operating points, SHARES at each of `_rows`; none where the controller stands by at all speeds of the map."""
    car = SingleTrack.from_config(config)
    limit = config.rear_actuator.angle_max
    turns = []
    for row in _rows(reference_map, config):
        speed, known = reference_map.speed[row], reference_map.feasible[row]
        # Straight ahead everything is zero, and the map is symmetric.
        angles = np.append(0.0, reference_map.front_angle[known])
        front = np.array(SHARES) * angles[-1]
        yaw_rate = np.interp(front, angles, np.append(0.0, reference_map.yaw_rate[row, known]))
        if reference_map.rear_angle is not None:
            rear = np.interp(front, angles, np.append(0.0, reference_map.rear_angle[row, known]))
        else:
            rear = front - yaw_rate / car.yaw_gain(speed)
        rear = np.clip(rear, -limit, limit)
        sideslip = rear + car.sideslip_per_yaw_rate(speed) * yaw_rate
        turns.append(np.array([np.full(front.shape, speed), front, rear, yaw_rate, sideslip]))
    return Points(*(np.concatenate(turns, axis=1) if turns else np.zeros((5, 0))))
