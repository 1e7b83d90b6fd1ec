"""Excess of the yaw rate of the reference model (kind "tracking") over its map, in steady state with the map's rear angle.

The model is the single-track car of `vehicle.dynamics.single_track(config, "load-transfer")`, which includes the effect of
track and load transfer on the nonlinear car. The trim (`controller.tracking.trim_max_percent`) takes back the excess that the
tables of a build and the model's other simplifications leave. A map of linear tyres demands at least what the model reaches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.ecu_map.storage import Real
from codegen.ecu_map.total import TotalMap
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK
from codegen.optimum.solve import layer_configs
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from codegen.vehicle.dynamics import single_track

STEPS = 30
"""Steps of Newton's method, which starts at the map's own turn, within a few percent of the solution."""
CHANGE_MAX = 1e-13
"""Largest change of the last step, rad and rad/s: rounding."""
RESIDUAL_MAX = 1e-8
"""Largest residual of a steady turn, 1/s^2 and rad/s^2."""
SPEEDS, EDGE_SHARES = 121, (*np.arange(0.05, 0.95, 0.05), 0.95, 0.97, 0.98, 0.99, 1.0)
"""Number of speeds from the first to the last of a map, and fractions of the last front angle at each speed."""
EDGE_ALLOWANCE = 0.0075
"""Fraction of the yaw rate that is not counted at the edge itself, where the last cell of a grid cuts across the kink. It is
less than the 1 % to which a slip bound is kept, because the slip grows 1.3 times as fast as the yaw rate there."""

TRIM_WARNING_FACTOR = 2.0
"""Warn when the trim exceeds this multiple of the required trim; extra trim increases overshoot."""

COARSE = "a finer [grid], or a build with `max_error=`, brings what is interpolated closer to the optimum"
"""Remedy where no trim is enough."""


@dataclass(frozen=True)
class Excess:
    """Largest excess over a map as a fraction of its yaw rate, and its operating point: m/s, rad, friction, m/s^2."""

    share: float
    speed: float
    front_angle: float
    friction: float
    acceleration: float = 0.0

    @property
    def percent(self) -> float:
        """Excess in percent, rounded up to a tenth: the least trim that removes it."""
        return math.ceil(1e3 * self.share - 1e-6) / 10.0

    @property
    def trim_percent(self) -> int:
        """Smallest whole percentage of trim that is enough."""
        return math.ceil(self.percent)


def model_excess(reference_map: ReferenceMap, total: TotalMap, config: Config, real: Real = np.float32) -> Excess:
    """Return the largest excess over a solved map and the layers of its stack, by the lookup of a build.

    Args:
        total: the map of the build. real: its number type.

    Points are left out if Newton's method finds no steady turn of the model there.

    Raises:
        MapError: a steady turn is not found.
    """
    lookup, cars = Lookup.from_map(total, real), layer_configs(reference_map, config)
    if reference_map.quantity is ACCELERATION_STACK:
        layers = [(car, config, layer.value) for car, layer in zip(cars, reference_map.layers, strict=True)]
    else:
        layers = [(car, car, 0.0) for car in cars]
    found = (_on_one_layer(reference_map, lookup, *layer) for layer in (*layers, (config, config, 0.0)))
    return max(found, key=lambda one: one.share)


def _on_one_layer(reference_map: ReferenceMap, lookup: Lookup, car: Config, config: Config, acceleration: float) -> Excess:
    """Return the excess over one layer. `car` is solved for it; the model is that of `config` with the grip of the layer."""
    assert reference_map.case is not None  # a solved map has one
    case = car.case(reference_map.case)
    turns = turns_of(car, case)
    moving = reference_map.speed[reference_map.speed > 0.0]
    speeds = np.linspace(moving[0], moving[-1], SPEEDS)
    last = float(reference_map.front_angle[-1])
    ends = [turns.edge(speeds, last), *([turns.without_rear_steering().edge(speeds, last)] if case.passive_safe else [])]
    edge = np.minimum.reduce([end.front_angle for end in ends], initial=last)
    speed, front_angle = np.repeat(speeds, len(EDGE_SHARES)), np.outer(edge, EDGE_SHARES).ravel()
    optimum = turns.at(speed, front_angle)
    friction = config.road.friction
    yaw_rate, rear_angle = lookup.reference(speed, front_angle, friction, acceleration)
    wanted, largest = yaw_rate.astype(np.float64), lookup.cars[lookup.own].rear_angle_max  # the laws hold the rear angle there
    inputs = np.array([speed, front_angle, rear_angle, np.full(speed.size, friction), wanted, _response_gain(config, speed)])
    state = np.array([optimum.sideslip, wanted])
    shares = lookup.axle_shares_at(friction, acceleration).tolist() if acceleration else (1.0, 1.0)
    derivative = single_track(config, "load-transfer", shares).derivative
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 6)
    rear = ca.fmax(ca.fmin(u[2] - u[5] * (u[4] - x[1]), largest), -largest)
    rate = derivative(x, ca.vertcat(u[0], u[1], rear, u[3]))
    newton = ca.Function("newton", [x, u], [x - ca.solve(ca.jacobian(rate, x), rate)])
    residual = ca.Function("residual", [x, u], [rate])
    for _ in range(STEPS):
        before, state = state, np.asarray(newton(state, inputs))
        if not (np.abs(state - before) > CHANGE_MAX).any():  # NaN stays
            break
    settled = np.abs(np.asarray(residual(state, inputs))).max(axis=0) <= RESIDUAL_MAX  # false for NaN
    # The excess counts from the larger of table and optimum: the trim takes the model back to the table only.
    excess = state[1] - np.fmax(wanted, optimum.yaw_rate)
    excess -= np.tile(np.where(np.array(EDGE_SHARES) == 1.0, EDGE_ALLOWANCE, 0.0), SPEEDS) * wanted
    share = np.where(settled & (wanted > 0.0), excess / np.where(wanted > 0.0, wanted, 1.0), -math.inf)
    worst = int(share.argmax())
    return Excess(float(share[worst]), float(speed[worst]), float(front_angle[worst]), friction, acceleration)


def _response_gain(config: Config, speed: FloatArray) -> FloatArray:
    """Return the response gain in s at speeds (n,) in m/s, with which the feedforward steers for the model's yaw rate error."""
    schedule = config.controller.tracking.schedule
    if schedule is None or schedule.response_gain_s is None:
        return np.zeros(speed.shape)
    gain: FloatArray = np.interp(speed / KM_H, schedule.speed_km_h, schedule.response_gain_s)
    return gain


def asks_for_more(reference_map: ReferenceMap, config: Config) -> bool:
    """Return whether an excess is possible: the controller has a reference model and the nonlinear car limits the map."""
    return config.controller.kind == "tracking" and reference_map.solved and reference_map.tyre_model != "linear"
