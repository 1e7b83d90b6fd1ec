"""The NumPy lookup compared with SciPy's interpolator, its rounding error bound, and its axes. tests/sil compares the C."""

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from codegen.arrays import FloatArray
from codegen.ecu_map.extend import TotalMap, extend
from codegen.ecu_map.lookup import AxisConstants, Lookup, Real, error_bound
from codegen.ecu_map.storage import Axis
from codegen.map_file import map as npz
from tests.optimum.cars import PAPER, paper_total

REALS: tuple[Real, ...] = (np.float32, np.float64)


def bare(speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray) -> TotalMap:
    """Return the extension of a table without a configuration."""
    return extend(npz.from_arrays({"vx": speed, "delta_f": front_angle, "yaw_rate": yaw_rate}, "test"), PAPER)


@pytest.fixture(scope="module")
def maps() -> Mapping[str, TotalMap]:
    """Return the paper's map, a smooth table over uneven axes, and a table of random numbers."""
    rng = np.random.default_rng(20_240_617)
    speed = np.array([4.0, 7.0, 7.5, 12.0, 20.0, 33.0, 50.0])
    front_angle = np.radians([0.3, 1.0, 1.2, 4.0, 9.0])
    smooth = np.minimum(np.outer(speed / (3.0 + 0.002 * speed**2), front_angle), 5.0 / speed[:, np.newaxis])
    rough = rng.uniform(0.0, 1.0, (30, 40)) / np.linspace(1.0, 5.0, 30)[:, np.newaxis]
    return {
        "4ws-2": paper_total(),
        "uneven": bare(speed, front_angle, smooth),
        "rough": bare(np.linspace(6.0, 40.0, 30), np.linspace(0.01, 0.3, 40), rough),
    }


def interpolate(total: TotalMap, speed: Any, front_angle: Any, friction: float | None = None) -> FloatArray:
    """Return the rule in double precision by SciPy: clamp, interpolate, cap, sign."""
    v, magnitude = np.maximum(np.asarray(speed, dtype=np.float64), 0.0), np.abs(np.asarray(front_angle, dtype=np.float64))
    table = RegularGridInterpolator((total.speed, total.front_angle), total.yaw_rate)
    inside = np.stack([np.minimum(v, total.speed[-1]), np.minimum(magnitude, total.front_angle[-1])], axis=-1)
    scale = 1.0 if friction is None else min(max(friction, 0.0) / total.friction, 1.0)
    cap = np.full(v.shape, np.inf)
    np.divide(scale * total.lateral_acceleration_cap, v, out=cap, where=v > 0.0)
    result: FloatArray = np.copysign(np.minimum(table(inside), cap), front_angle)
    return result


def points(total: TotalMap, count: int, real: Real, seed: int) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Return random pairs in and around the table, in the given precision.

    A quarter each: anywhere, next to breakpoints (a few units in the last place), where the cap begins, and at small values.
    """
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


@pytest.mark.parametrize("name", ["4ws-2", "uneven", "rough"])
@pytest.mark.parametrize("real", REALS)
def test_against_scipy_within_the_error_bound(maps: Mapping[str, TotalMap], name: str, real: Real) -> None:
    """The bound adds worst cases that do not coincide; it is at most 50 times the largest error in single precision."""
    total = maps[name]
    v, angle = points(total, 200_000, real, 2)
    found = Lookup.from_map(total, real)(v, angle)
    assert found.dtype == real
    difference = np.abs(found.astype(np.float64) - interpolate(total, v, angle))
    bound = error_bound(total, real)
    assert difference.max() <= bound
    assert bound < 1e-12 if real is np.float64 else bound <= 50.0 * difference.max()
    assert name != "4ws-2" or bound < 2e-5  # a tenth of the resolution on CAN


@pytest.mark.parametrize("friction", [0.0, 0.45, 0.9, 1.2, -1.0])
def test_friction_scales_the_cap(friction: float) -> None:
    """A friction below the map's own (0.9) lowers the cap in proportion; a higher one does not raise it; NaN means the map's
    own."""
    total = paper_total()
    v, angle = points(total, 20_000, np.float64, 3)
    found = Lookup.from_map(total, np.float64)(v, angle, friction)
    np.testing.assert_allclose(found, interpolate(total, v, angle, friction), rtol=0.0, atol=1e-13)
    fastest = (np.abs(found[v > 0.0]) * v[v > 0.0]).max()
    assert fastest == pytest.approx(min(max(friction, 0.0) / 0.9, 1.0) * total.lateral_acceleration_cap, rel=1e-12)
    single = Lookup.from_map(total)
    assert single(v, angle, float("nan")).tobytes() == single(v, angle).tobytes() == single(v, angle, 0.9).tobytes()


@pytest.mark.parametrize(
    ("breakpoints", "first", "last", "step"),
    [
        ([0.0, 1.0, 2.0, 3.0, 4.0], False, False, 1.0),
        ([0.0, 0.1, 1.1, 2.1, 3.1], True, False, 1.0),
        ([0.0, 1.0, 2.0, 3.0, 9.0], False, True, 1.0),
        ([0.0, 5.0, 5.5, 6.0, 6.5, 40.0], True, True, 0.5),
        ([0.0, 2.0], False, False, 2.0),
        ([0.0, 2.0, 3.0], True, False, 1.0),  # one of the two cells is the core
        # Uneven: one different cell away from the ends, two different cells at one end.
        ([0.0, 1.0, 2.0, 3.5, 4.5], False, False, None),
        ([0.0, 0.5, 1.0, 1.5, 3.0, 5.0], False, False, None),
    ],
)
def test_an_even_axis_has_at_most_one_other_cell_at_either_end(
    breakpoints: list[float], first: bool, last: bool, step: float | None
) -> None:
    found = Axis.from_breakpoints(np.array(breakpoints))
    assert found.even == (step is not None)
    assert (found.has_first_cell, found.has_last_cell) == (first, last)
    assert (found.core_start, found.core_end) == (int(first), len(breakpoints) - 1 - int(last))
    assert step is None or found.step == pytest.approx(step, rel=1e-15)


@pytest.mark.parametrize("n", [5, 6, 9, 10, 33, 34, 1000])
def test_search_steps_reach_every_cell_and_no_further(n: int) -> None:
    """The lower end of a cell belongs to it."""
    axis = Axis.from_breakpoints(np.cumsum(1.0 + 0.37 * np.arange(n)) - 1.0)
    assert not axis.even
    steps = axis.search_steps
    assert all(a == 2 * b for a, b in itertools.pairwise(steps)) and steps[-1] == 1
    assert sum(steps) >= n - 2 > sum(steps) // 2  # reaches the last cell with no step to spare
    cell, _ = AxisConstants(axis, np.float64).locate(axis.breakpoints[:-1])
    np.testing.assert_array_equal(cell, np.arange(n - 1))


@given(st.lists(st.floats(1e-3, 10.0) | st.just(1.0), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_position_on_any_axis(widths: list[float], fraction: float) -> None:
    constants = AxisConstants(Axis.from_breakpoints(np.concatenate([[0.0], np.cumsum(widths)])), np.float64)
    breakpoints = constants.axis.breakpoints
    x = np.array([0.0, fraction * breakpoints[-1], breakpoints[-1]])
    cell, position = constants.locate(x)
    # EVENNESS of a step, at most.
    np.testing.assert_allclose(cell + position, np.interp(x, breakpoints, np.arange(breakpoints.size)), rtol=0.0, atol=1e-8)
