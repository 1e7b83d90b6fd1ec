"""Samples of a campaign and the cars they describe."""

import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.sweep.lanes import BLOCK, cars, draw, noise
from codegen.sweep.spec import Spec, parse
from codegen.vehicle.plant_car import PLANT_PARAMETERS, plant_parameters
from hil_sim.suite import cells
from tests import builds

ROUNDING = 1e-13
"""Relative tolerance: a few roundings of double precision, in another order."""
FRICTION = {"friction": {"uniform": [0.4, 0.9]}}
MIXED = {**FRICTION, "mass_percent": {"normal": [5.0, 10.0], "within": [-10.0, 20.0]}, "delay_samples": [0, 1, 3]}


def spec(**tables: Any) -> Spec:
    return parse({"samples": 1000, "seed": 3, "controllers": {"pi": "a"}, **tables}, "sweep.toml")


def test_a_factorial_design_has_every_combination_once() -> None:
    factors = {"friction": [0.4, 0.6, 0.9], "mass_percent": [0, 10], "speed_km_h": [60, 80]}
    made = parse({"design": "factorial", "controllers": {"pi": "a"}, "factors": factors}, "sweep.toml")
    parts = [draw(made, range(5 * chunk, min(5 * chunk + 5, 12))) for chunk in range(3)]
    rows = list(zip(*(np.concatenate([part[key] for part in parts]) for key in factors), strict=True))
    assert rows == list(itertools.product(*factors.values()))


def test_a_sample_depends_only_on_its_number_and_the_seed() -> None:
    """It is the same in every chunk and with more factors; other blocks and seeds have other samples."""
    made, count = spec(factors=MIXED), 2 * BLOCK + 100
    whole, whole_noise = draw(made, range(count)), noise(made, range(count), 0, 5)
    for size in (1, 85, BLOCK, BLOCK + 1):
        first = count - count % size - size  # the larger chunks span two blocks
        part = range(first, first + size)
        assert all(np.array_equal(values, whole[key][first : first + size]) for key, values in draw(made, part).items())
        assert np.array_equal(noise(made, part, 0, 5), whole_noise[:, :, first : first + size])
    friction = draw(spec(factors=FRICTION), range(BLOCK))["friction"]
    assert np.array_equal(friction, whole["friction"][:BLOCK])
    assert not np.intersect1d(friction, whole["friction"][BLOCK : 2 * BLOCK]).size
    assert not np.array_equal(friction, draw(spec(seed=4, factors=FRICTION), range(BLOCK))["friction"])


def test_distributions() -> None:
    """Tolerances: five standard errors of 100,000 draws."""
    drawn, count = draw(spec(factors=MIXED), range(100_000)), 100_000
    assert drawn["friction"].min() >= 0.4 and drawn["friction"].max() <= 0.9
    assert abs(drawn["friction"].mean() - 0.65) < 5 * 0.5 / 12**0.5 / count**0.5
    assert drawn["mass_percent"].min() >= -10.0 and drawn["mass_percent"].max() <= 20.0
    assert abs(drawn["mass_percent"].mean() - 5.0) < 5 * 10.0 / count**0.5  # symmetric truncation keeps the mean
    values, counts = np.unique(drawn["delay_samples"], return_counts=True)
    assert values.tolist() == [0.0, 1.0, 3.0]
    assert np.all(np.abs(counts - count / 3) < 5 * (count * 2 / 9) ** 0.5)
    narrow = draw(spec(factors={"mass_percent": {"normal": [0, 1], "within": [3.999, 3.9990001]}}), range(100))
    assert ((narrow["mass_percent"] >= 3.999) & (narrow["mass_percent"] <= 3.9990001)).all()
    one, other = noise(spec(), range(50), 0, 400), noise(spec(), range(50), 1, 400)  # standard normal and independent
    assert one.shape == (400, 3, 50)
    assert abs(one.std() - 1.0) < 5.0 / (2 * one.size) ** 0.5
    assert not np.array_equal(one, other)
    assert not np.array_equal(one[:, :, 0], one[:, :, 1])


BY_B = builds.CONFIG.replace(
    {f"tyre.{axle}": {"stiffness_factor_b_per_rad": 18.0, "cornering_stiffness_n_per_rad": None} for axle in ("front", "rear")}
)
"""A car whose tyres are given by B."""
FRONT_ARM, REAR_ARM = builds.CONFIG.vehicle.cg_to_front_axle_m, builds.CONFIG.vehicle.cg_to_rear_axle_m
HEAVIER = ("mass", "yaw_inertia", "load_transfer_front", "load_transfer_rear", "front_static_load", "rear_static_load")


@pytest.mark.parametrize("base", [builds.CONFIG, BY_B], ids=["by slope", "by B"])
@pytest.mark.parametrize(
    ("factors", "change", "ratios"),
    [
        ({}, cells.unchanged, {}),
        ({"yaw_inertia_percent": 30.0}, None, {"yaw_inertia": 1.3}),
        (
            {"cg_shift_m": 0.1},  # with the same tyre slopes
            None,
            {
                "cg_to_front_axle": 1.0 - 0.1 / FRONT_ARM,
                "cg_to_rear_axle": 1.0 + 0.1 / REAR_ARM,
                "front_static_load": 1.0 + 0.1 / REAR_ARM,
                "rear_static_load": 1.0 - 0.1 / FRONT_ARM,
                "front_stiffness_factor": 1.0 / (1.0 + 0.1 / REAR_ARM),
                "rear_stiffness_factor": 1.0 / (1.0 - 0.1 / FRONT_ARM),
            },
        ),
        (
            {"rear_lag_s": 0.1},
            cells.actuator_lag(2.0),
            {"rear_lag": 0.1 / builds.CONFIG.rear_actuator.lag_s},
        ),
        (
            {
                "mass_percent": 20.0,
                "front_stiffness_percent": -20.0,
                "rear_stiffness_percent": 15.0,
                "tyre_peak_percent": -10.0,
            },
            cells.together(cells.mass(20.0), cells.stiffness(-20.0, 15.0), cells.peak(-10.0)),
            {
                **dict.fromkeys(HEAVIER, 1.2),
                **dict.fromkeys(("front_peak_factor", "rear_peak_factor"), 0.9),
                "front_stiffness_factor": 0.8 / (1.2 * 0.9),
                "rear_stiffness_factor": 1.15 / (1.2 * 0.9),
            },
        ),
    ],
)
def test_factors_change_what_they_name(
    factors: Mapping[str, float], change: Callable[[Config], Config] | None, ratios: Mapping[str, float], base: Config
) -> None:
    """As rows of a campaign, around a measured car, and as a condition of the suites."""
    drawn = {key: np.array([value, 0.0 if key != "rear_lag_s" else value]) for key, value in factors.items()}
    own = plant_parameters(base)
    wanted = own * [ratios.get(name, 1.0) for name in PLANT_PARAMETERS]
    found = [cars(base, drawn, 2)[0], cars(builds.CONFIG, drawn, 2, [base, base])[0]]
    found += [] if change is None else [plant_parameters(change(base))]
    for row in found:
        for name, one, other in zip(PLANT_PARAMETERS, row, wanted, strict=True):
            assert one == pytest.approx(other, rel=ROUNDING), name
    if "rear_lag_s" not in factors:
        assert cars(base, drawn, 2)[1] == pytest.approx(own, rel=ROUNDING)
