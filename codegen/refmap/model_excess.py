"""By how much the reference model of kind "tracking" turns more than its map, in steady state with the map's rear angle.

The model is the single-track car with Magic Formula tyres at static wheel loads. A map of linear tyres asks for at least what
it can do. A map of the nonlinear car may ask for less: track and load transfer cost that car yaw rate, most where the map ends
at high speed. The trim takes back what it is allowed to (`controller.tracking.trim_max_percent`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from codegen.config import KM_H, Config
from codegen.refmap.map import ReferenceMap
from codegen.vehicle.dynamics import single_track

STEPS = 30
"""Of Newton's method, which starts at the map's own turn, a few percent off."""
RESIDUAL_MAX = 1e-8
"""1/s^2 and rad/s^2."""


@dataclass(frozen=True)
class Excess:
    """The largest excess over a map, as a share of its yaw rate, and where it is: speed in m/s, front angle in rad."""

    share: float
    speed: float
    front_angle: float


def model_excess(reference_map: ReferenceMap, config: Config) -> Excess:
    """Over the feasible cells of a solved map. Where the model has no steady turn near the map's, a cell is left out."""
    assert reference_map.sideslip is not None  # a solved map has both
    assert reference_map.rear_angle is not None
    moving = reference_map.feasible & (reference_map.speed > 0.0)[:, np.newaxis]
    row, column = np.nonzero(moving)
    speed, front_angle, wanted = reference_map.speed[row], reference_map.front_angle[column], reference_map.yaw_rate[moving]
    friction = np.full(speed.size, config.road.friction)
    inputs = np.array([speed, front_angle, reference_map.rear_angle[moving], friction])
    state = np.array([reference_map.sideslip[moving], wanted])
    derivative = single_track(config, "magic-formula").derivative
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 4)
    rate = derivative(x, u)
    newton = ca.Function("newton", [x, u], [x - ca.solve(ca.jacobian(rate, x), rate)])
    for _ in range(STEPS):
        state = np.asarray(newton(state, inputs))
    settled = np.abs(np.asarray(derivative(state, inputs))).max(axis=0) <= RESIDUAL_MAX
    share = np.where(settled & (wanted > 0.0), state[1] / np.where(wanted > 0.0, wanted, 1.0) - 1.0, -math.inf)
    worst = int(share.argmax())
    return Excess(float(share[worst]), float(speed[worst]), float(front_angle[worst]))


def excess_note(reference_map: ReferenceMap, config: Config) -> str | None:
    """What to say of a build of kind "tracking" whose trim does not reach; None where it does, or nothing is asked."""
    if config.controller.kind != "tracking" or not reference_map.solved or reference_map.tyre_model == "linear":
        return None
    excess, allowed = model_excess(reference_map, config), config.controller.tracking.trim_max_percent
    percent = 100.0 * excess.share
    if not percent > allowed:
        return None
    return (
        f"in steady state the reference model turns up to {percent:.1f} % more than this map ({excess.speed / KM_H:.0f} km/h, "
        f"{math.degrees(excess.front_angle):.1f} deg), and its trim takes {allowed:g} % back: there the slip bounds of the map "
        f"are exceeded; controller.tracking.trim_max_percent = {math.ceil(percent)} keeps them, with more overshoot"
    )
