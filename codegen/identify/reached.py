"""Speeds, accelerations and slip angles that the drives of a fit reached."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.identify.estimate import Fit
from codegen.identify.model import OUTPUTS
from codegen.vehicle.tyre import static_wheel_loads


@dataclass(frozen=True)
class Reached:
    """Ranges that the drives reached.

    Attributes:
        speed: smallest and largest speed, m/s. lateral_acceleration: largest, m/s^2.
        slip: largest slip angle of front and rear axle, rad. friction: largest side force over load of both axles.
    """

    speed: tuple[float, float]
    lateral_acceleration: float
    slip: tuple[float, float]
    friction: tuple[float, float]


def reached(fitted: Fit, config: Config) -> Reached:
    """Return what the drives of a fit of the car reached, as simulated. Peaks are those of 99.9 % of the samples."""
    problem, vehicle = fitted.problem, config.vehicle
    values = {**fitted.named(), **{f"{output}_{kind}": 0.0 for output in OUTPUTS for kind in ("offset", "delay")}}
    values["lateral_acceleration_factor"] = 1.0
    count = problem.model.constants.index("friction") + 1
    constants = problem.constants.copy()
    constants[count:] = 0.0
    simulation = problem.simulation(np.array([values[name] for name in problem.prior.names]), fitted.starts)
    output = replace(simulation, constants=constants).output()
    rows = problem.segments.rows
    samples = problem.samples
    speed = (samples.signal("vx")[rows] - values["speed_offset"]) / values["speed_factor"]
    inputs = problem.inputs(0.0).reshape(len(samples), problem.substeps * 3, -1)[rows, 0]
    front = inputs[:, 1] / values["steering_ratio"] - values["front_offset"]
    lateral = speed * np.tan(output[:, 2])
    arms = vehicle.cg_to_front_axle_m, vehicle.cg_to_rear_axle_m
    slips = (
        np.arctan((lateral + arms[0] * output[:, 0]) / speed) - front,
        np.arctan((lateral - arms[1] * output[:, 0]) / speed) - inputs[:, 2],
    )
    yaw_acceleration = np.concatenate(
        [np.gradient(output[low:high, 0], samples.step) for low, high in pairwise(problem.segments.offsets)]
    )
    turning = values["yaw_inertia"] * yaw_acceleration
    forces = (
        (vehicle.mass_kg * output[:, 1] * arms[1] + turning) / vehicle.wheelbase,
        (vehicle.mass_kg * output[:, 1] * arms[0] - turning) / vehicle.wheelbase,
    )

    compared = np.isfinite(problem.measured[:, 0])  # without the first samples of a segment, whose initial state is free

    def peak(signal: FloatArray) -> float:
        return float(np.quantile(np.abs(signal[compared]), 0.999))

    loads = static_wheel_loads(config)
    return Reached(
        (float(speed.min()), float(speed.max())),
        peak(output[:, 1]),
        (peak(slips[0]), peak(slips[1])),
        (peak(forces[0]) / (2.0 * loads[0]), peak(forces[1]) / (2.0 * loads[1])),
    )
