"""From factors to the numbers of the plant: those that a configuration with the same changes has."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from codegen.config import Config
from codegen.errors import ConfigError
from codegen.sweep.lanes import cars
from codegen.vehicle.plant_car import PLANT_PARAMETERS, plant_parameters
from hil_sim.suite import plants
from hil_sim.suite.plants import changed
from tests import builds

ROUNDING = 1e-13
"""Relative: a few roundings of double precision, in another order."""


def shifted(config: Config) -> Config:
    """The centre of gravity 0.1 m further ahead, the tyres' slopes as they were."""
    vehicle = config.vehicle
    arms = {"cg_to_front_axle_m": vehicle.cg_to_front_axle_m - 0.1, "cg_to_rear_axle_m": vehicle.cg_to_rear_axle_m + 0.1}
    return changed(plants.stiffness(0.0, 0.0)(config), {"vehicle": arms})


def inert(config: Config) -> Config:
    return changed(config, {"vehicle": {"yaw_inertia_kg_m2": 1.3 * config.vehicle.yaw_inertia_kg_m2}})


@pytest.mark.parametrize(
    ("factors", "change"),
    [
        ({}, plants.unchanged),
        ({"mass_percent": 20.0}, plants.mass(20.0)),
        ({"yaw_inertia_percent": 30.0}, inert),
        ({"cg_shift_m": 0.1}, shifted),
        ({"front_stiffness_percent": -20.0, "rear_stiffness_percent": 15.0}, plants.stiffness(-20.0, 15.0)),
        ({"tyre_peak_percent": -10.0}, plants.peak(-10.0)),
        ({"rear_lag_s": 0.1}, plants.actuator_lag(0.1)),
        (
            {
                "mass_percent": 20.0,
                "front_stiffness_percent": -20.0,
                "rear_stiffness_percent": -20.0,
                "tyre_peak_percent": -10.0,
            },
            plants.together(plants.mass(20.0), plants.stiffness(-20.0, -20.0), plants.peak(-10.0)),
        ),
    ],
)
def test_cars_are_those_of_the_changed_configuration(factors: Mapping[str, float], change: Callable[[Config], Config]) -> None:
    (found,) = cars(builds.CONFIG, {key: np.array([value]) for key, value in factors.items()}, 1)
    wanted = plant_parameters(change(builds.CONFIG))
    for name, one, other in zip(PLANT_PARAMETERS, found, wanted, strict=True):
        assert one == pytest.approx(other, rel=ROUNDING), name


def test_a_centre_of_gravity_beyond_an_axle_is_refused() -> None:
    with pytest.raises(ConfigError, match="cg_shift_m"):
        cars(builds.CONFIG, {"cg_shift_m": np.array([0.0, 1.5])}, 2)
