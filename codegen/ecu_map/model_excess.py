"""By how much the reference model of kind "tracking" turns more than its map, in steady state with the map's rear angle.

The model is the single-track car of `vehicle.dynamics.single_track(config, "load-transfer")`, which has what track and load
transfer cost the nonlinear car. What the tables of a build and the model's other simplifications leave is for the trim
(`controller.tracking.trim_max_percent`). A map of linear tyres asks for at least what the model can do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen.configuration import KM_H, Config
from codegen.ecu_map.lookup import Lookup
from codegen.ecu_map.storage import Real
from codegen.ecu_map.total import TotalMap
from codegen.map_file.map import ReferenceMap
from codegen.optimum.stack import layer_configs
from codegen.optimum.turns import turns_of
from codegen.vehicle.dynamics import single_track

FloatArray = npt.NDArray[np.float64]

STEPS = 30
"""Of Newton's method, which starts at the map's own turn, a few percent off."""
RESIDUAL_MAX = 1e-8
"""1/s^2 and rad/s^2."""
SPEEDS, EDGE_SHARES = 121, (*np.arange(0.05, 0.95, 0.05), 0.95, 0.97, 0.98, 0.99, 1.0)
"""Where it is asked: so many speeds from a map's first to its last, and shares of the front angle at which it ends there."""
EDGE_ALLOWANCE = 0.0075
"""Share of the yaw rate that is not counted at the edge itself: the last cell of a grid cuts across the kink there. It is less
than the 1 % to which a slip bound is kept, for the slip grows 1.3 times as fast as the yaw rate there."""

COARSE = "a finer [grid], or codegen build --max-error, brings what is interpolated closer to the optimum"
"""What to do where no trim is enough."""


@dataclass(frozen=True)
class Excess:
    """The largest excess over a map, as a share of its yaw rate, and where it is: m/s, rad, friction."""

    share: float
    speed: float
    front_angle: float
    friction: float

    @property
    def percent(self) -> float:
        """Up, to a tenth: what a trim has to be allowed to take back at least."""
        return math.ceil(1e3 * self.share - 1e-6) / 10.0

    @property
    def trim_percent(self) -> int:
        """The whole number of percent that is enough."""
        return math.ceil(self.percent)


def model_excess(reference_map: ReferenceMap, total: TotalMap, config: Config, real: Real = np.float32) -> Excess:
    """Of a solved map and each lower friction of its stack, with what the lookup of a build gives there.

    Args:
        total: what the build holds. real: its numbers.

    Where the model has no steady turn near the map's, a point is left out.

    Raises:
        MapError: a steady turn is not found.
    """
    lookup = Lookup.from_map(total, real)
    return max(
        (_on_one_road(reference_map, lookup, road) for road in (*layer_configs(reference_map, config), config)),
        key=lambda found: found.share,
    )


def _on_one_road(reference_map: ReferenceMap, lookup: Lookup, config: Config) -> Excess:
    assert reference_map.case is not None  # a solved map has one
    case = config.case(reference_map.case)
    turns = turns_of(config, case)
    moving = reference_map.speed[reference_map.speed > 0.0]
    speeds = np.linspace(moving[0], moving[-1], SPEEDS)
    last = float(reference_map.front_angle[-1])
    ends = [turns.edge(speeds, last), *([turns.without_rear_steering().edge(speeds, last)] if case.passive_safe else [])]
    edge = np.minimum.reduce([end.front_angle for end in ends], initial=last)
    speed, front_angle = np.repeat(speeds, len(EDGE_SHARES)), np.outer(edge, EDGE_SHARES).ravel()
    optimum = turns.at(speed, front_angle)
    friction = config.road.friction
    yaw_rate, rear_angle = lookup.reference(speed, front_angle, friction)
    wanted, largest = yaw_rate.astype(np.float64), lookup.cars[-1].rear_angle_max  # the laws hold the rear angle there
    inputs = np.array([speed, front_angle, rear_angle, np.full(speed.size, friction), wanted, _response_gain(config, speed)])
    state = np.array([optimum.sideslip, wanted])
    derivative = single_track(config, "load-transfer").derivative
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 6)
    rear = ca.fmax(ca.fmin(u[2] - u[5] * (u[4] - x[1]), largest), -largest)
    rate = derivative(x, ca.vertcat(u[0], u[1], rear, u[3]))
    newton = ca.Function("newton", [x, u], [x - ca.solve(ca.jacobian(rate, x), rate)])
    residual = ca.Function("residual", [x, u], [rate])
    for _ in range(STEPS):
        state = np.asarray(newton(state, inputs))
    settled = np.abs(np.asarray(residual(state, inputs))).max(axis=0) <= RESIDUAL_MAX  # false for NaN
    # What the table is below the optimum is no excess; where it is above, the trim draws to the table.
    excess = state[1] - np.fmax(wanted, optimum.yaw_rate)
    excess -= np.tile(np.where(np.array(EDGE_SHARES) == 1.0, EDGE_ALLOWANCE, 0.0), SPEEDS) * wanted
    share = np.where(settled & (wanted > 0.0), excess / np.where(wanted > 0.0, wanted, 1.0), -math.inf)
    worst = int(share.argmax())
    return Excess(float(share[worst]), float(speed[worst]), float(front_angle[worst]), friction)


def _response_gain(config: Config, speed: FloatArray) -> FloatArray:
    """s, for speeds (n,) in m/s: with it the feedforward steers for the yaw rate that the model lacks or has too much."""
    schedule = config.controller.tracking.schedule
    if schedule is None or schedule.response_gain_s is None:
        return np.zeros(speed.shape)
    gain: FloatArray = np.interp(speed / KM_H, schedule.speed_km_h, schedule.response_gain_s)
    return gain


def asks_for_more(reference_map: ReferenceMap, config: Config) -> bool:
    """Whether the question is asked: of the kind of controller with a reference model, and a map that the nonlinear car set."""
    return config.controller.kind == "tracking" and reference_map.solved and reference_map.tyre_model != "linear"
