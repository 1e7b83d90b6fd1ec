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

from codegen.config import Config
from codegen.refmap.lookup import Lookup
from codegen.refmap.map import ReferenceMap
from codegen.refmap.storage import Real
from codegen.refmap.total import TotalMap
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

    @property
    def percent(self) -> float:
        """Up, to a tenth: what a trim has to be allowed to take back at least."""
        return math.ceil(1e3 * self.share - 1e-6) / 10.0

    @property
    def trim_percent(self) -> int:
        """The whole number of percent that is enough."""
        return math.ceil(self.percent)


def model_excess(reference_map: ReferenceMap, total: TotalMap, config: Config, real: Real = np.float32) -> Excess:
    """Over the feasible cells of a solved map, with the yaw rates and rear angles that the lookup of a build gives there.

    Args:
        total: what the build holds. real: its numbers.

    Where the model has no steady turn near the map's, a cell is left out.
    """
    assert reference_map.sideslip is not None  # a solved map has one
    moving = reference_map.feasible & (reference_map.speed > 0.0)[:, np.newaxis]
    row, column = np.nonzero(moving)
    speed, front_angle = reference_map.speed[row], reference_map.front_angle[column]
    wanted, rear_angle = (values.astype(np.float64) for values in Lookup.from_map(total, real).reference(speed, front_angle))
    largest = total.steering.rear_angle_max  # the laws hold it there
    friction = np.full(speed.size, config.road.friction)
    inputs = np.array([speed, front_angle, np.clip(rear_angle, -largest, largest), friction])
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


def asks_for_more(reference_map: ReferenceMap, config: Config) -> bool:
    """Whether the question is asked: of the kind of controller with a reference model, and a map that the nonlinear car set."""
    return config.controller.kind == "tracking" and reference_map.solved and reference_map.tyre_model != "linear"
