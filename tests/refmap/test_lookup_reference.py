"""The NumPy lookup against SciPy's interpolator, and its bound on the rounding error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import RegularGridInterpolator

from codegen.config import Config
from codegen.errors import MapError
from codegen.refmap import map as npz
from codegen.refmap.extend import TotalMap, extend
from codegen.refmap.lookup import Lookup, Real, cap_in_precision, error_bound
from codegen.refmap.solve import solve_case
from tests.refmap.cars import CASE, random_config

FloatArray = npt.NDArray[np.float64]
NAMES = ("fws", "4ws-1", "4ws-2", "uneven", "rough")
REALS: tuple[Real, ...] = (np.float32, np.float64)


def bare(config: Config, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray) -> TotalMap:
    """The extension of a table without a configuration."""
    return extend(npz.from_arrays({"vx": speed, "delta_f": front_angle, "yaw_rate": yaw_rate}, "test"), config)


@pytest.fixture(scope="module")
def all_totals(paper: Config, totals: Mapping[str, TotalMap]) -> Mapping[str, TotalMap]:
    """The paper's three; a smooth table over uneven axes; random numbers, which no car has, so that no cell is like another."""
    rng = np.random.default_rng(20_240_617)
    speed = np.array([4.0, 7.0, 7.5, 12.0, 20.0, 33.0, 50.0])
    front_angle = np.radians([0.3, 1.0, 1.2, 4.0, 9.0])
    smooth = np.minimum(np.outer(speed / (3.0 + 0.002 * speed**2), front_angle), 5.0 / speed[:, np.newaxis])
    rough = rng.uniform(0.0, 1.0, (30, 40)) / np.linspace(1.0, 5.0, 30)[:, np.newaxis]
    return {
        **totals,
        "uneven": bare(paper, speed, front_angle, smooth),
        "rough": bare(paper, np.linspace(6.0, 40.0, 30), np.linspace(0.01, 0.3, 40), rough),
    }


def interpolate(total: TotalMap, speed: Any, front_angle: Any, friction: float | None = None) -> FloatArray:
    """The rule in double precision by SciPy: clamp, interpolate, cap, sign."""
    v, magnitude = np.maximum(np.asarray(speed, dtype=np.float64), 0.0), np.abs(np.asarray(front_angle, dtype=np.float64))
    table = RegularGridInterpolator((total.speed, total.front_angle), total.yaw_rate)
    inside = np.stack([np.minimum(v, total.speed[-1]), np.minimum(magnitude, total.front_angle[-1])], axis=-1)
    scale = 1.0 if friction is None else min(max(friction, 0.0) / total.friction, 1.0)
    cap = np.full(v.shape, np.inf)
    np.divide(scale * total.lateral_acceleration_cap, v, out=cap, where=v > 0.0)
    value = np.minimum(table(inside), cap)
    result: FloatArray = np.copysign(value, front_angle)
    return result


def points(total: TotalMap, count: int, real: Real, seed: int) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Random pairs in and around the table, in the given precision: a quarter each anywhere, beside breakpoints (a few units
    in the last place), where the cap begins, and at small values."""
    rng = np.random.default_rng(seed)
    quarter = count // 4
    v = rng.uniform(-5.0, 1.5 * total.speed[-1], count)
    angle = rng.uniform(-1.2, 1.2, count) * total.front_angle[-1]
    ulp = float(np.finfo(real).eps)
    v[:quarter] = rng.choice(total.speed, quarter) * (1.0 + ulp * rng.integers(-4, 5, quarter))
    angle[:quarter] = rng.choice(total.front_angle, quarter) * (1.0 + ulp * rng.integers(-4, 5, quarter))
    begins = total.lateral_acceleration_cap / np.maximum(interpolate(total, v, angle), 0.02)
    v[quarter : 2 * quarter] = begins[quarter : 2 * quarter] * (1.0 + ulp * rng.integers(-4, 5, quarter))
    v[2 * quarter : 3 * quarter] *= 10.0 ** rng.uniform(-6.0, 0.0, quarter)
    angle[2 * quarter : 3 * quarter] *= 10.0 ** rng.uniform(-6.0, 0.0, quarter)
    return v.astype(real), angle.astype(real)


@pytest.mark.parametrize("name", NAMES)
def test_double_precision_against_scipy(all_totals: Mapping[str, TotalMap], name: str) -> None:
    """Rounding alone differs: the stated bound for double precision, some 1e-14 rad/s."""
    total = all_totals[name]
    v, angle = points(total, 200_000, np.float64, 1)
    difference = np.abs(Lookup.from_map(total, np.float64)(v, angle) - interpolate(total, v, angle))
    assert error_bound(total, np.float64) < 1e-12
    assert difference.max() <= error_bound(total, np.float64)


@pytest.mark.parametrize("name", NAMES)
def test_error_bound_of_single_precision(all_totals: Mapping[str, TotalMap], name: str) -> None:
    """Held on a million points, and at most fifty times the largest error found: it adds up worst cases that do not meet."""
    total = all_totals[name]
    v, angle = points(total, 1_000_000, np.float32, 2)
    difference = np.abs(Lookup.from_map(total)(v, angle).astype(np.float64) - interpolate(total, v, angle))
    bound = error_bound(total)
    assert difference.max() <= bound
    assert bound <= 50.0 * difference.max()


@pytest.mark.parametrize("across", [False, True])
def test_error_bound_where_the_position_decides(paper: Config, across: bool) -> None:
    """A thousand even cells and all of the rise in the last: the rounding of the position, worth thousands of units in the last
    place of a cell, is most of the error."""
    axis, short = np.arange(1.0, 1_001.0) * (math.pi / 30.0), np.array([0.1, 0.2])  # a step that no binary fraction is
    table = np.full((1_000, 2), 1e-3)
    table[-1] = 0.3
    total = bare(paper, short, axis * 0.01, table.T) if across else bare(paper, axis, short, table)
    steep = total.front_angle if across else total.speed  # both axes end here: the stop is inside the table
    inside = np.random.default_rng(20_240_620).uniform(steep[-2], steep[-1], 100_000).astype(np.float32)
    short_value = np.full_like(inside, 0.2)
    v, angle = (short_value, inside) if across else (inside, short_value)
    difference = np.abs(Lookup.from_map(total)(v, angle).astype(np.float64) - interpolate(total, v, angle))
    assert 0.08 * error_bound(total) < difference.max() <= error_bound(total)


def test_error_bound_of_the_papers_map_is_small(totals: Mapping[str, TotalMap]) -> None:
    """A tenth of what the yaw rate's signal on CAN resolves, 2e-4 rad/s."""
    assert error_bound(totals["4ws-2"]) < 2e-5


@pytest.mark.parametrize("seed", range(4))
def test_random_solved_maps(seed: int) -> None:
    rng = np.random.default_rng((20_240_618, seed))
    done = 0
    while done < 8:
        config = random_config(rng)
        try:
            total = extend(solve_case(config, CASE), config)
        except MapError:
            continue
        done += 1
        for real in REALS:
            v, angle = points(total, 20_000, real, seed)
            difference = np.abs(Lookup.from_map(total, real)(v, angle).astype(np.float64) - interpolate(total, v, angle))
            assert difference.max() <= error_bound(total, real)


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.45, 0.89, 0.9, 1.2, -1.0])
def test_friction_scales_the_cap(totals: Mapping[str, TotalMap], friction: float) -> None:
    """Less than the map's own (0.9) lowers it in proportion; more does not raise it."""
    total = totals["4ws-2"]
    v, angle = points(total, 20_000, np.float64, 3)
    found = Lookup.from_map(total, np.float64)(v, angle, friction)
    np.testing.assert_allclose(found, interpolate(total, v, angle, friction), rtol=0.0, atol=1e-13)
    asked = np.abs(found[v > 0.0]) * v[v > 0.0]
    assert asked.max() == pytest.approx(min(max(friction, 0.0) / 0.9, 1.0) * total.lateral_acceleration_cap, rel=1e-12)


def test_unknown_friction_is_the_maps_own(totals: Mapping[str, TotalMap]) -> None:
    lookup = Lookup.from_map(totals["4ws-2"])
    v, angle = points(totals["4ws-2"], 10_000, np.float32, 4)
    assert lookup(v, angle, float("nan")).tobytes() == lookup(v, angle).tobytes() == lookup(v, angle, 0.9).tobytes()


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", NAMES)
def test_breakpoints_give_the_table(all_totals: Mapping[str, TotalMap], name: str, real: Real) -> None:
    """At a breakpoint, below the cap, the entry itself comes back to within rounding of the position."""
    total = all_totals[name]
    v, angle = np.meshgrid(total.speed, total.front_angle, indexing="ij")
    found = Lookup.from_map(total, real)(v, angle)
    with np.errstate(divide="ignore"):
        expected = np.minimum(total.yaw_rate, total.lateral_acceleration_cap / v)
    assert found.dtype == real
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=error_bound(total, real))


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("value", [0.3, 1.0, 5.611226313527058, 7.3, 1e-3])
def test_cap_is_rounded_down(value: float, real: Real) -> None:
    """By a few units in the last place: what comes out times the speed stays below it in exact arithmetic."""
    cap = float(cap_in_precision(value, real))
    assert value * (1.0 - 6.0 * float(np.finfo(real).eps)) <= cap <= value * (1.0 - 2.0 * float(np.finfo(real).eps))


def test_shapes_broadcast(totals: Mapping[str, TotalMap]) -> None:
    lookup = Lookup.from_map(totals["4ws-2"])
    table = lookup(np.linspace(0.0, 40.0, 5)[:, np.newaxis], np.linspace(-0.2, 0.2, 7))
    assert table.shape == (5, 7)
    assert lookup(12.0, 0.05).shape == ()
    assert lookup(12.0, 0.05) == lookup(np.array([12.0]), 0.05)[0]
