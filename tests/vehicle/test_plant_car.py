"""The plant with its car left open against the plant of a configuration."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import Config, parse
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_PARAMETERS, plant_parameters, two_track, two_track_of_parameters
from codegen.vehicle.tyre import AxleTyres

TYRES = {
    "front": {
        "cornering_stiffness_n_per_rad": 1e5,
        "shape_factor_c": 1.5,
        "curvature_factor_e": 0.2,
        "peak_factor_p1": 1.1,
        "peak_load_sensitivity_p2": -0.2,
        "horizontal_shift_deg": 0.3,
        "vertical_shift_n": 50.0,
    },
    "rear": {"stiffness_factor_b_per_rad": 12.0, "peak_load_sensitivity_p2": 0.1},
}
CONFIGS: dict[str, Config] = {
    "paper": configuration.preset(),
    "loaded tyres": parse({"tyre": TYRES}, "test"),
    "relaxation": parse({"plant": {"relaxation_length_m": 0.6}}, "test"),
    "all of it": parse({"tyre": TYRES, "plant": {"relaxation_length_m": 0.3, "load_transfer": "paper"}}, "test"),
}


def points(states: int) -> list[tuple[Any, Any]]:
    """States and inputs, from driving straight to sliding with a lifted wheel and saturated actuators."""
    generator = np.random.default_rng(1)
    size = np.array([0.3, 0.3, 1.0, 0.05, 5.0, 5.0, 1.0, *[0.1] * 4])[:states]
    drawn = [(size * generator.normal(size=states) * scale, scale) for scale in (0.0, 0.01, 0.1, 1.0, 5.0) for _ in range(5)]
    return [(x, np.array([generator.uniform(0.1, 40.0), scale, 0.1 * scale, 0.7, 1e3 * scale])) for x, scale in drawn]


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_with_the_numbers_of_a_configuration_it_is_that_plant(config: Config) -> None:
    fixed, open_model = two_track(config), two_track_of_parameters(config)
    assert (open_model.states, open_model.inputs, open_model.outputs) == (fixed.states, fixed.inputs, fixed.outputs)
    assert fixed.output is not None
    car = plant_parameters(config)
    for x, u in points(len(fixed.states)):
        for found, wanted in (
            (open_model.derivative(x, u, car), fixed.derivative(x, u)),
            (open_model.output(x, u, car), fixed.output(x, u)),
        ):
            # The same operations; CasADi puts numbers together beforehand where it knows them.
            np.testing.assert_allclose(np.array(found), np.array(wanted), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", [name for name in PLANT_PARAMETERS if name != "relaxation_length"])
def test_each_parameter_makes_another_car(name: str) -> None:
    model = two_track_of_parameters(CONFIGS["loaded tyres"])
    car = plant_parameters(CONFIGS["loaded tyres"])
    other = car.copy()
    other[PLANT_PARAMETERS.index(name)] = 1.1 * other[PLANT_PARAMETERS.index(name)] + 1e-3
    results = [
        np.array(ca.vertcat(model.derivative(x, u, values), model.output(x, u, values)))
        for values in (car, other)
        for x, u in points(len(model.states))
    ]
    half = len(results) // 2
    assert any(not np.array_equal(one, two) for one, two in zip(results[:half], results[half:], strict=True))


def test_the_relaxation_length_is_a_parameter_where_the_tyres_have_one() -> None:
    model = two_track_of_parameters(CONFIGS["relaxation"])
    x, u = np.full(11, 0.02), np.array([20.0, 0.0, 0.0, 0.9, 0.0])
    car = plant_parameters(CONFIGS["relaxation"])
    half = car.copy()
    half[PLANT_PARAMETERS.index("relaxation_length")] *= 0.5
    rates, twice = (np.array(model.derivative(x, u, values))[7:] for values in (car, half))
    np.testing.assert_allclose(twice, 2.0 * rates, rtol=1e-14)


def test_names_and_numbers() -> None:
    config = CONFIGS["all of it"]
    row = dict(zip(PLANT_PARAMETERS, plant_parameters(config), strict=True))
    tyres = AxleTyres.from_config(config)
    assert row["mass"] == config.vehicle.mass_kg
    assert row["cg_to_rear_axle"] == config.vehicle.cg_to_rear_axle_m
    assert row["relaxation_length"] == 0.3
    assert row["rear_angle_max"] == pytest.approx(np.radians(config.rear_actuator.angle_max_deg), rel=1e-15)
    assert row["front_stiffness_factor"] == tyres.front.stiffness_factor
    assert row["rear_static_load"] == tyres.rear.static_load
    assert len(set(PLANT_PARAMETERS)) == len(PLANT_PARAMETERS)
    assert not any("nominal" in name for name in PLANT_PARAMETERS)
    assert len(PLANT_INPUTS) == 5
