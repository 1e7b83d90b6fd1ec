"""Random cars with load transfer, and random operating points of theirs."""

from __future__ import annotations

import math

import numpy as np

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.optimum.nonlinear import NonlinearTurns
from tests.optimum.cars import random_config


def random_car(rng: np.random.Generator) -> Config:
    """Draw a car with its own load transfer and load sensitivity, in addition to the variations of `random_config`."""
    data = random_config(rng).model_dump(mode="json")
    drawn = {"cg_height_m": (0.3, 0.9), "track_m": (1.3, 1.9), "front_roll_share": (0.3, 0.7)}
    data["vehicle"] |= {key: float(rng.uniform(*ends)) for key, ends in drawn.items()}
    for axle in ("front", "rear"):
        data["tyre"][axle]["peak_load_sensitivity_p2"] = float(rng.uniform(-0.4, 0.1))
    return configuration.parse(data, "random car")


def using_grip(config: Config, rng: np.random.Generator) -> Config:
    """Return a car with its nonlinear tyres bounded by grip, and with a floor of the yaw rate."""
    drawn = {"grip_use_max": (0.6, 0.99), "yaw_gain_floor": (0.5, 1.2), "reference_characteristic_speed_km_h": (60.0, 150.0)}
    return config.replace({"limits": {key: float(rng.uniform(*ends)) for key, ends in drawn.items()}}, "random car")


def random_cells(turns: NonlinearTurns, config: Config, rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Draw speeds (m/s) and front angles (rad), (count,) each, from zero to a third beyond the map."""
    grid = config.grid
    speed = rng.uniform(grid.speed_min_km_h, grid.speed_max_km_h, count) / 3.6
    largest = math.radians(grid.front_angle_max_deg)
    edge = turns.edge(speed, largest).front_angle
    return speed, rng.uniform(0.0, 1.0, count) * np.minimum(1.3 * edge, largest)
