"""The plant with its car left open against the plant of a configuration."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.config import Config, parse
from codegen.vehicle.dynamics import PLANT_PARAMETERS, plant_parameters, two_track, two_track_of_parameters

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
    "paper": parse({}, "test"),
    "loaded tyres": parse({"tyre": TYRES}, "test"),
    "every parameter": parse({"tyre": TYRES, "plant": {"relaxation_length_m": 0.3, "load_transfer": "paper"}}, "test"),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_with_the_numbers_of_a_configuration_it_is_that_plant(name: str) -> None:
    """The points reach from driving straight to sliding with a lifted wheel and saturated actuators."""
    config = CONFIGS[name]
    fixed, open_model = two_track(config), two_track_of_parameters(config)
    assert (open_model.states, open_model.inputs, open_model.outputs) == (fixed.states, fixed.inputs, fixed.outputs)
    assert fixed.output is not None
    car = plant_parameters(config)
    assert len(car) == len(set(PLANT_PARAMETERS))
    generator = np.random.default_rng(1)
    size = np.array([0.3, 0.3, 1.0, 0.05, 5.0, 5.0, 1.0, *[0.1] * 4])[: len(fixed.states)]
    for scale in (0.0, 0.01, 0.1, 1.0, 5.0):
        x = size * generator.normal(size=size.size) * scale
        u = np.array([generator.uniform(0.1, 40.0), scale, 0.1 * scale, 0.7, 1e3 * scale])
        for found, wanted in (
            (open_model.derivative(x, u, car), fixed.derivative(x, u)),
            (open_model.output(x, u, car), fixed.output(x, u)),
        ):
            # The same operations; CasADi folds constants beforehand where it knows them.
            np.testing.assert_allclose(np.array(found), np.array(wanted), rtol=1e-12, atol=1e-14)
