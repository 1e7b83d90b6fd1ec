"""The samples of a campaign."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from codegen.sweep.draw import BLOCK, draw, noise
from codegen.sweep.spec import Spec, parse


def spec(**tables: Any) -> Spec:
    return parse({"samples": 1000, "seed": 3, "controllers": {"pi": "a"}, **tables}, "sweep.toml")


def test_factorial_has_every_combination_once_whatever_the_chunks() -> None:
    factors = {"friction": [0.4, 0.6, 0.9], "mass_percent": [0, 10], "speed_km_h": [60, 80]}
    made = parse({"design": "factorial", "controllers": {"pi": "a"}, "factors": factors}, "sweep.toml")
    parts = [draw(made, range(5 * chunk, min(5 * chunk + 5, 12))) for chunk in range(3)]
    rows = list(zip(*(np.concatenate([part[key] for part in parts]) for key in factors), strict=True))
    assert rows == list(itertools.product(*factors.values()))


def test_a_factor_more_leaves_the_others_as_they_were() -> None:
    few = draw(spec(factors={"friction": {"uniform": [0.4, 0.9]}}), range(100))
    more = draw(
        spec(factors={"mass_percent": {"uniform": [0, 9]}, "friction": {"uniform": [0.4, 0.9]}, "speed_km_h": [50, 60]}),
        range(100),
    )
    assert np.array_equal(few["friction"], more["friction"])


def test_blocks_and_seeds_differ() -> None:
    made = spec(factors={"friction": {"uniform": [0.4, 0.9]}})
    one, other = draw(made, range(BLOCK))["friction"], draw(made, range(BLOCK, 2 * BLOCK))["friction"]
    assert not np.intersect1d(one, other).size
    assert np.array_equal(one, draw(made, range(BLOCK))["friction"])
    assert not np.array_equal(one, draw(spec(seed=4, factors={"friction": {"uniform": [0.4, 0.9]}}), range(BLOCK))["friction"])


def test_a_sample_is_the_same_in_whatever_chunk() -> None:
    made = spec(
        factors={
            "friction": {"uniform": [0.4, 0.9]},
            "mass_percent": {"normal": [0, 10], "within": [-20, 20]},
            "delay_samples": [0, 1, 2],
        }
    )
    count = 2 * BLOCK + 100
    whole, whole_noise = draw(made, range(count)), noise(made, range(count), 0, 5)
    for size in (1, 85, 256, BLOCK, BLOCK + 1):
        first = count - count % size - size  # across the border of two blocks, for the larger ones
        part = range(first, first + size)
        assert all(np.array_equal(values, whole[key][first : first + size]) for key, values in draw(made, part).items())
        assert np.array_equal(noise(made, part, 0, 5), whole_noise[:, :, first : first + size])


def test_distributions_are_what_they_say() -> None:
    factors = {
        "friction": {"uniform": [0.4, 0.9]},
        "mass_percent": {"normal": [5.0, 10.0], "within": [-10.0, 20.0]},
        "delay_samples": [0, 1, 3],
    }
    drawn = draw(spec(factors=factors), range(100_000))
    # Bounds: five standard errors of 100,000 draws.
    assert drawn["friction"].min() >= 0.4
    assert drawn["friction"].max() <= 0.9
    assert abs(drawn["friction"].mean() - 0.65) < 5 * 0.5 / 12**0.5 / 100_000**0.5
    assert drawn["mass_percent"].min() >= -10.0
    assert drawn["mass_percent"].max() <= 20.0
    # Symmetric truncation leaves the mean where it was.
    assert abs(drawn["mass_percent"].mean() - 5.0) < 5 * 10.0 / 100_000**0.5
    values, counts = np.unique(drawn["delay_samples"], return_counts=True)
    assert values.tolist() == [0.0, 1.0, 3.0]
    assert np.all(np.abs(counts - 100_000 / 3) < 5 * (100_000 * 2 / 9) ** 0.5)


def test_noise_is_standard_normal_and_each_scenario_has_its_own() -> None:
    one, other = noise(spec(), range(50), 0, 400), noise(spec(), range(50), 1, 400)
    assert one.shape == (400, 3, 50)
    assert abs(one.std() - 1.0) < 5.0 / (2 * one.size) ** 0.5
    assert not np.array_equal(one, other)
    assert not np.array_equal(one[:, :, 0], one[:, :, 1])


def test_a_narrow_window_far_out_is_drawn_at_once() -> None:
    drawn = draw(spec(factors={"mass_percent": {"normal": [0, 1], "within": [3.999, 3.9990001]}}), range(100))["mass_percent"]
    assert drawn.min() >= 3.999
    assert drawn.max() <= 3.9990001
