"""The family of a measured car: points of its distribution instead of the deviations of [tuning]."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, norm

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.family import MEASURABLE, Member, measured_keys, members, nominal, origin
from codegen.design.gains import design
from codegen.design.margins import gains_of, loop_margins
from codegen.design.sampled import frequency_grid, sample
from codegen.design.search import Demands
from codegen.errors import ConfigError
from codegen.units import KM_H
from codegen.vehicle.population import Population, draw

from .conftest import small_config

KEYS = ["tyre.front.cornering_stiffness_n_per_rad", "tyre.rear.cornering_stiffness_n_per_rad", "vehicle.yaw_inertia_kg_m2"]
LAG, RELAXATION = "rear_actuator.lag_s", "plant.relaxation_length_m"
DEVIATIONS = [2_400.0, 2_800.0, 100.0]
CORRELATIONS = [[1.0, 0.8, 0.5], [0.8, 1.0, 0.6], [0.5, 0.6, 1.0]]


def measured(keys: list[str], deviations: list[float], correlations: list[list[float]], **tuning: Any) -> Config:
    table = {"keys": keys, "standard_deviations": deviations, "correlations": correlations, "interval_floor_percent": 0.0}
    return small_config({"identified": table}, **tuning)


def car() -> Config:
    return measured(KEYS, DEVIATIONS, CORRELATIONS, relaxation_length_m=[0.0])


def values(config: Config, member: Member) -> FloatArray:
    """Return the values of KEYS of a member."""
    factors = member.front_stiffness_factor, member.rear_stiffness_factor, member.yaw_inertia_factor
    return np.array(factors) * [
        config.tyre.front.cornering_stiffness_n_per_rad or math.nan,
        config.tyre.rear.cornering_stiffness_n_per_rad or math.nan,
        config.vehicle.yaw_inertia_kg_m2,
    ]


def test_members_lie_on_the_ellipsoid_of_99_percent_and_the_rest_comes_from_tuning() -> None:
    config = measured(KEYS, DEVIATIONS, CORRELATIONS, mass_percent=[-20.0, 20.0], relaxation_length_m=[0.0, 0.6])
    family = members(config)
    points = 2 * 3 + 2**3 + 1  # ends of the axes, corners, the car itself
    assert len(family) == 2 * 2 * points + 1  # the configured car has the configured mass
    inverse = np.linalg.inv(np.outer(DEVIATIONS, DEVIATIONS) * np.array(CORRELATIONS))
    apart = np.array([values(config, member) - values(config, nominal(config)) for member in family])
    distance = np.einsum("mi,ij,mj->m", apart, inverse, apart)
    on_ellipsoid = np.isclose(distance, chi2.ppf(0.99, 3), rtol=1e-6)  # correlations and factors, rounded
    assert (on_ellipsoid | np.isclose(distance, 0.0, atol=1e-9)).all()
    assert on_ellipsoid.sum() == 2 * 2 * (points - 1)
    others = {(member.mass_factor, member.relaxation_length, member.actuator_lag) for member in family}
    assert others == {(mass, length, 0.05) for mass in (0.8, 1.2) for length in (0.0, 0.6)} | {(1.0, 0.0, 0.05)}
    assert origin(config) == f"{', '.join(KEYS)} from [identified] (99 % of the cars); lag, mass, relaxation from [tuning]"
    assert origin(small_config()) == ""


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_a_linear_figure_of_99_5_percent_of_the_cars_is_no_worse_than_the_worst_member(count: int) -> None:
    """The quantile of a linear figure is known; directions of the figure are random."""
    config = small_config({"plant": {"relaxation_length_m": 0.5}})
    keys = list(MEASURABLE)[:count]
    rng = np.random.default_rng(count)
    factor = rng.standard_normal((count, count))
    correlations = factor @ factor.T
    size = np.sqrt(np.diag(correlations))
    correlations = np.round(correlations / np.outer(size, size), 9)
    np.fill_diagonal(correlations, 1.0)
    deviations = np.array([0.001, 40.0, 800.0, 900.0, 0.01])[:count]
    own = Config.model_validate(
        {
            **{name: getattr(config, name) for name in Config.model_fields},
            "identified": {
                "keys": keys,
                "standard_deviations": deviations.tolist(),
                "correlations": correlations.tolist(),
                "interval_floor_percent": 0.0,
            },
        }
    )
    population = Population.of(own, keys)
    points = np.array([population.values(point) for point in (*population.axes(0.99), *population.corners(0.99))])
    figures = rng.standard_normal((2000, count)) / deviations
    worst = ((points - population.mean) @ figures.T).max(axis=0)
    covariance = np.outer(deviations, deviations) * correlations
    spread = np.sqrt(np.einsum("fi,ij,fj->f", figures, covariance, figures))
    assert (worst / spread).min() > norm.ppf(0.995) - 1e-6
    assert (worst / spread).max() < math.sqrt(chi2.ppf(0.99, count)) + 1e-6


def test_the_gains_suit_99_percent_of_the_cars_and_are_larger_than_those_of_the_wide_family() -> None:
    config, speeds = car(), np.array([15.0, 42.5, 80.0, 120.0])
    made = design(config)
    wide = design(config.model_copy(update={"identified": small_config().identified})).schedule
    own = made.schedule
    at = [own.speed_km_h.index(speed) for speed in speeds]
    assert all(own.integral_gain[k] > 1.05 * wide.integral_gain[k] for k in at)
    family = [
        Member(
            0.05,
            1.0,
            (one.tyre.front.cornering_stiffness_n_per_rad or math.nan)
            / (config.tyre.front.cornering_stiffness_n_per_rad or math.nan),
            (one.tyre.rear.cornering_stiffness_n_per_rad or math.nan)
            / (config.tyre.rear.cornering_stiffness_n_per_rad or math.nan),
            yaw_inertia_factor=one.vehicle.yaw_inertia_kg_m2 / config.vehicle.yaw_inertia_kg_m2,
        )
        for one in draw(config, 1000, 1)
    ]
    frequency = frequency_grid(config.controller.sampling_time_s)
    kept = np.ones(len(family), dtype=bool)
    for speed in speeds:
        kp, ki = gains_of(own)(np.array([speed * KM_H]))
        margins = loop_margins(sample(config, family, [speed * KM_H]), kp, ki, frequency)
        kept &= Demands.of(config.tuning, family[:1]).met(margins)[:, 0]
    assert kept.mean() >= 0.99
    assert any(member.yaw_inertia_factor != 1.0 for member in made.limiting)


def test_a_measured_lag_and_relaxation_replace_their_lists() -> None:
    table = {
        "keys": [LAG, RELAXATION, "tyre.front.peak_factor_p1"],
        "standard_deviations": [0.002, 0.02, 0.05],
        "correlations": np.eye(3).tolist(),
        "interval_floor_percent": 0.0,
    }
    config = small_config({"identified": table, "plant": {"relaxation_length_m": 0.4}}, actuator_lag_s=[0.02, 0.1])
    assert measured_keys(config) == (LAG, RELAXATION)  # the gains do not depend on D
    radius = math.sqrt(chi2.ppf(0.99, 2))
    lags = {round(member.actuator_lag, 9) for member in members(config)}
    lengths = {round(member.relaxation_length, 9) for member in members(config)}
    for found, mean, deviation in ((lags, 0.05, 0.002), (lengths, 0.4, 0.02)):
        steps = (-1.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5), 1.0)
        assert found == {round(mean + step * radius * deviation, 9) for step in steps}


def test_a_family_in_doubt_is_that_of_tuning_until_it_is_accepted() -> None:
    config = car()
    for accepted in (False, True):
        known = config.identified.model_copy(update={"doubts": ["a doubt"], "doubts_accepted": accepted})
        doubted = config.model_copy(update={"identified": known})
        assert bool(measured_keys(doubted)) == accepted
        assert bool(origin(doubted)) == accepted
        assert members(doubted) == members(config if accepted else small_config(relaxation_length_m=[0.0]))


def test_a_family_without_gains_names_the_remedy() -> None:
    with pytest.raises(ConfigError, match=r"drive with more excitation, remove \[identified\], or end the grid sooner"):
        design(measured(KEYS[:2], [15_000.0, 30_000.0], [[1.0, 0.96], [0.96, 1.0]]))
