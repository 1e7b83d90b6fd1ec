"""The total map: each rule separately, then the properties of the whole, and cases that the passive car could reach."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.extend import RULE_TEXT, Rule, TotalMap, extend
from codegen.ecu_map.lookup import Lookup
from codegen.errors import MapError
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.optimum import exact
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.solve import solve_case
from tests.optimum.cars import CASES, PAPER, SteadyModel, changed, paper_map, paper_total

STOP = math.radians(35.0)
ROUNDING = 1e-12  # rad/s, of a few operations in double precision on values of order one


def bare(speed: list[float], front_angle: list[float], yaw_rate: Any, feasible: Any = None) -> ReferenceMap:
    """Return a bare map, as from another tool."""
    arrays = {"vx": np.array(speed), "delta_f": np.array(front_angle), "yaw_rate": np.array(yaw_rate, dtype=float)}
    return npz.from_arrays(arrays if feasible is None else {**arrays, "feasible": np.array(feasible)}, "test")


def passive_gain(config: Config, speed: float) -> float:
    """Return the steady yaw rate per rad of front angle with straight rear wheels, 1/s, from the CasADi model."""
    model = SteadyModel.of(config, config.case("fws"))
    return float(model.turns(speed, 1.0, np.zeros(1)).yaw_rate[0])


def rules(total: TotalMap) -> list[str]:
    """Return the rule letters of each speed."""
    return ["".join(row) for row in total.rule]


SMALL = bare([10.0, 20.0], [0.02, 0.05], [[0.06, 0.12], [0.08, 0.18]])


def test_linear_from_zero_then_the_passive_slope_then_the_cap() -> None:
    total = extend(SMALL, PAPER)
    np.testing.assert_array_equal(total.speed, [0.0, 10.0, 20.0])
    np.testing.assert_array_equal(total.front_angle, [0.0, 0.02, 0.05, STOP])
    assert not total.yaw_rate[0].any() and not total.yaw_rate[:, 0].any()
    np.testing.assert_array_equal(total.yaw_rate[1:, 1:3], SMALL.yaw_rate)
    assert rules(total) == ["zzzz", "zssp", "zssp"]
    for row, speed, last in ((1, 10.0, 0.12), (2, 20.0, 0.18)):
        assert total.yaw_rate[row, 3] == pytest.approx(last + passive_gain(PAPER, speed) * (STOP - 0.05), rel=1e-12)
    assert total.lateral_acceleration_cap == pytest.approx(20.0 * 0.18, rel=1e-15)  # the largest in the table
    assert total.friction == PAPER.road.friction
    # A map that starts at zero gets no additional breakpoint; its values there become zero.
    total = extend(bare([0.0, 20.0], [0.0, 0.05], [[0.3, 0.4], [0.01, 0.18]]), PAPER)
    np.testing.assert_array_equal(total.speed, [0.0, 20.0])
    np.testing.assert_array_equal(total.yaw_rate[:, :2], [[0.0, 0.0], [0.0, 0.18]])


def test_gaps_between_feasible_cells_are_interpolated_over_the_front_angle() -> None:
    """This includes the range from zero to the first feasible cell. The content of infeasible cells has no effect, not even on
    the cap."""
    angles = [0.01, 0.02, 0.03, 0.05, 0.06, 0.08]
    feasible = [False, True, False, False, True, False]
    total = extend(bare([10.0, 20.0], angles, [[9.0, 0.1, 9.0, 9.0, 0.3, 9.0]] * 2, [feasible] * 2), PAPER)
    np.testing.assert_allclose(total.yaw_rate[1, :6], [0.0, 0.05, 0.1, 0.15, 0.25, 0.3], rtol=1e-14)
    assert rules(total)[1:] == ["zisiispp"] * 2
    expected = 0.3 + passive_gain(PAPER, 10.0) * np.array([0.02, STOP - 0.06])
    np.testing.assert_allclose(total.yaw_rate[1, 6:], expected, rtol=1e-12)
    assert total.lateral_acceleration_cap == pytest.approx(20.0 * 0.3, rel=1e-15)


def test_a_speed_without_a_feasible_cell_takes_its_neighbours() -> None:
    yaw_rate = np.outer([1.0, 2.0, 3.0, 4.0, 6.0, 7.0], [0.01, 0.02])
    feasible = [[some] * 2 for some in (False, True, False, False, True, False)]
    total = extend(bare([2.0, 10.0, 12.0, 13.0, 20.0, 30.0], [0.02, 0.05], yaw_rate, feasible), PAPER)
    assert rules(total) == ["zzzz", "znnn", "zssp", "znnn", "znnn", "zssp", "znnn"]
    np.testing.assert_allclose(total.yaw_rate[1:, 1], 0.01 * np.array([2.0, 2.0, 2.8, 3.2, 6.0, 6.0]), rtol=1e-14)
    low, high = total.yaw_rate[2, 3], total.yaw_rate[5, 3]
    np.testing.assert_allclose(total.yaw_rate[[1, 3, 4, 6], 3], [low, 0.8 * low + 0.2 * high, 0.7 * low + 0.3 * high, high])


def test_maps_that_cannot_be_extended_are_refused() -> None:
    with pytest.raises(MapError, match="every yaw rate is zero"):
        extend(bare([10.0, 20.0], [0.02, 0.05], np.zeros((2, 2))), PAPER)
    tyres = {"front": {"cornering_stiffness_n_per_rad": 120e3}, "rear": {"cornering_stiffness_n_per_rad": 90e3}}
    with pytest.raises(MapError, match=r"vx: .*unstable from.*`config=`"):
        extend(bare([10.0, 80.0], [0.02, 0.05], [[0.06, 0.12], [0.02, 0.03]]), changed(PAPER, tyre=tyres))


@pytest.fixture(scope="module")
def narrow() -> tuple[Config, ReferenceMap, TotalMap]:
    """Return the paper's car with tight bounds on sideslip and rear angle, which limit it at low speed; grip does at high
    speed."""
    config = changed(PAPER, limits={"sideslip_max_deg": 1.0, "rear_angle_max_deg": 1.0})
    reference_map = solve_case(config, "4ws-2")
    return config, reference_map, extend(reference_map, config)


def test_beyond_the_edges_of_the_continuous_problem(narrow: tuple[Config, ReferenceMap, TotalMap]) -> None:
    """The edges come from linear programming, independent of the exact solution; its tolerance is 1e-7 of a bound."""
    config, reference_map, total = narrow
    model = SteadyModel.of(config, config.case("4ws-2"))
    cap = model.problem.lateral_acceleration_cap
    assert total.lateral_acceleration_cap == cap
    seen = set()
    for row in range(0, reference_map.speed.size, 5):
        speed, last = float(reference_map.speed[row]), int(np.flatnonzero(reference_map.feasible[row])[-1])
        front, rear = model.widest_turn(speed)
        beyond = slice(last + 2, None)  # the total map has a zero column first
        edge_rate = float(model.turns(speed, front, np.array([rear])).yaw_rate[0])
        if math.isclose(edge_rate * speed, cap, rel_tol=1e-6):
            expected, letter = np.full(total.front_angle[beyond].shape, cap / speed), Rule.HOLD
        else:
            expected = edge_rate + passive_gain(config, speed) * (total.front_angle[beyond] - front)
            letter = Rule.PASSIVE_SLOPE
        np.testing.assert_allclose(total.yaw_rate[row + 1, beyond], expected, rtol=1e-6)
        assert set(total.rule[row + 1, beyond]) == {letter.value}
        seen.add(letter)
    assert seen == {Rule.HOLD, Rule.PASSIVE_SLOPE}


def with_safe_cases(**tables: Mapping[str, Any]) -> Config:
    """Return the paper's car with passively safe cases in addition to the usual ones, and other tables partly replaced."""
    safe = {f"safe-{name}": {**case.model_dump(mode="json"), "passive_safe": True} for name, case in PAPER.cases.items()}
    return changed(PAPER, cases=safe, **tables)


CONFIG = with_safe_cases()


@pytest.fixture(scope="module")
def maps(narrow: tuple[Config, ReferenceMap, TotalMap]) -> Mapping[str, TotalMap]:
    """Return several maps: sideslip-limited edges, feasible angles that end before the first breakpoint, passively safe, and a
    bare one with holes of all kinds over uneven axes."""
    speed = np.array([4.0, 8.0, 9.0, 12.0, 20.0, 30.0, 45.0])
    angles = np.radians([0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0])
    yaw_rate = np.minimum(np.outer([passive_gain(PAPER, float(v)) for v in speed], 1.2 * angles), 6.0 / speed[:, np.newaxis])
    feasible = np.ones(yaw_rate.shape, dtype=bool)
    feasible[1, 2:5] = False  # a gap
    feasible[2] = False  # an empty row
    feasible[3, :2] = False  # no beginning
    feasible[4, 4:] = False  # no end
    feasible[6] = False  # an empty row at the end
    holes = extend(bare(speed.tolist(), angles.tolist(), yaw_rate, feasible), PAPER)
    assert set(np.unique(holes.rule)) == {"z", "s", "p", "i", "n"}
    late_map = solve_case(changed(PAPER, grid={"front_angle_min_deg": 5.0, "front_angle_points": 20}), "fws")
    assert not late_map.feasible[-1].any()
    solved = {case: paper_total(case) for case in CASES}
    safe = extend(solve_case(CONFIG, "safe-4ws-2"), CONFIG)
    return {**solved, "narrow": narrow[2], "late": extend(late_map, PAPER), "safe": safe, "holes": holes}


WHOLE = (*CASES, "narrow", "late", "safe", "holes")
SPECIAL = np.array([0.0, -0.0, 1e-45, -1e-45, 1e-38, 1.0, -1.0, 3.4e38, -3.4e38, np.inf, -np.inf, np.nan], dtype=np.float32)


def dense_points(breakpoints: FloatArray, top: float, count: int) -> FloatArray:
    """Return evenly spaced points from 0 to `top`, and each breakpoint with its close neighbours on both sides."""
    near = [breakpoints * (1.0 + sign * width) for sign in (-1.0, 1.0) for width in (1e-15, 1e-9)]
    return np.unique(np.concatenate([np.linspace(0.0, top, count), breakpoints, *near]))


@pytest.mark.parametrize("name", WHOLE)
def test_the_total_map_is_finite_odd_rising_and_capped(maps: Mapping[str, TotalMap], name: str) -> None:
    """The map is finite, zero where it must be, rising with the front angle, odd and never above the cap, at dense and random
    points."""
    total = maps[name]
    assert np.all(np.isfinite(total.yaw_rate)) and total.yaw_rate.min() >= 0.0
    assert total.speed[0] == total.front_angle[0] == 0.0
    assert set(np.unique(total.rule)) <= {str(rule) for rule in RULE_TEXT} == {str(rule) for rule in Rule}
    cap = total.lateral_acceleration_cap
    speed, angle = (
        dense_points(total.speed, 3.0 * total.speed[-1], 400),
        dense_points(total.front_angle, 1.1 * total.front_angle[-1], 400),
    )
    rate = Lookup.from_map(total, np.float64)(speed[:, np.newaxis], angle)
    assert np.diff(rate, axis=1).min() >= -ROUNDING
    assert np.all(rate * speed[:, np.newaxis] <= cap)
    rng = np.random.default_rng(20_240_619)
    bits = rng.integers(0, 2**32, (2, 20_000), dtype=np.uint64).astype(np.uint32).view(np.float32)
    usual = rng.uniform([[0.0], [-1.2]], [[120.0], [1.2]], (2, 20_000)).astype(np.float32)
    single = Lookup.from_map(total)
    for v, a in (bits, usual, (bits[0], usual[1]), (usual[0], bits[1]), np.meshgrid(SPECIAL, SPECIAL)):
        found = single(v, a)
        assert np.all(np.isfinite(found)) and np.all(single(v, -a) == -found)
        finite = np.isfinite(v)
        assert np.all(np.abs(found[finite].astype(np.float64)) * v[finite].astype(np.float64) <= cap)
        assert not np.any(found[~(v > 0.0)])


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_the_feasible_cells_are_those_of_the_passive_car(case: str) -> None:
    """Rear steering removes no cell, so these are all cells of the FWS map, with the optimum unchanged."""
    left, whole = solve_case(CONFIG, f"safe-{case}"), paper_map(case)
    np.testing.assert_array_equal(left.feasible, paper_map("fws").feasible)
    for name in ("yaw_rate", "sideslip", "rear_angle", "active"):
        values = getattr(left, name)
        np.testing.assert_array_equal(values[left.feasible], getattr(whole, name)[left.feasible])
        assert not np.any(np.nan_to_num(values[~left.feasible]))


def test_the_option_is_named_if_no_cell_is_left() -> None:
    """At 9.5 deg and more the rear wheels must help at any speed of the grid."""
    with pytest.raises(MapError, match=r"^\[cases\.safe-4ws-2\]\.passive_safe: .*without rear steering.*; .*false"):
        solve_case(with_safe_cases(grid={"front_angle_min_deg": 9.5}), "safe-4ws-2")


@pytest.mark.parametrize("case", ["safe-4ws-1", "safe-4ws-2"])
def test_beyond_its_edge_the_passive_slope_from_where_the_passive_car_ends(case: str) -> None:
    """It starts at the edge of the continuous problem: from the last cell below it, the reference would jump between speeds.

    This includes edges where grip limits the passive car: the optimum is mostly below the grip limit and must not jump up to
    it.
    """
    reference_map = solve_case(CONFIG, case)
    total = extend(reference_map, CONFIG)
    inside = np.zeros(total.rule.shape, dtype=bool)
    inside[1:, 1:-1] = reference_map.feasible
    np.testing.assert_array_equal(total.rule == Rule.SOLVED.value, inside)
    problem = SteadyTurnProblem.from_config(CONFIG, CONFIG.case(case))
    checked = 0
    for row, speed in enumerate(reference_map.speed, start=1):
        one = np.array([speed])
        edge = exact.edge(replace(problem, rear_angle_max=0.0), one).front_angle
        if edge[0] >= reference_map.front_angle[-1]:
            continue
        at_edge = float(exact.solve(problem, one, edge * (1.0 - 1e-12)).yaw_rate[0, 0])
        beyond = total.front_angle > edge[0] * (1.0 + 1e-9)
        line = at_edge + problem.car.yaw_gain(speed) * (total.front_angle[beyond] - edge[0])
        np.testing.assert_allclose(total.yaw_rate[row, beyond], line, rtol=1e-9)
        checked += 1
    assert checked > 90  # of 101 speeds
