"""IPOPT against the exact solution, point by point: two ways that share the problem's description and nothing else.

On the paper's car every cell of the default grid; then random cars. Cells whose feasible interval of rear angles is under
1e-6 rad are listed, not compared: there feasibility itself is decided by rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from codegen.config import Case, Config
from codegen.errors import MapError
from codegen.refmap import exact, ipopt
from codegen.refmap.exact import Solution
from codegen.refmap.map import Binding
from codegen.refmap.problem import BINDING_TOLERANCE, SteadyTurnProblem, breakpoints
from codegen.refmap.solve import solve_case
from tests.refmap.cars import CASE, random_config

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

YAW_RATE_TOLERANCE = 1e-6  # rad/s
MARGIN_MIN = 1e-6  # rad
CONCAVE = "lambda 10"
CASES = ("fws", "4ws-1", "4ws-2", CONCAVE)
SHARES = 5  # parts of the default grid, each of about three seconds: workers can share them
VEHICLES = 240
BATCHES = 6


@dataclass(frozen=True)
class Comparison:
    """Cells (indices) where two solutions of one problem differ, and those too thin to say."""

    thin: list[tuple[int, int]]
    feasibility: list[tuple[int, int]]
    yaw_rate: list[tuple[int, int]]
    binding: list[tuple[int, int]]
    largest_difference: float

    @property
    def agrees(self) -> bool:
        """Whether no cell that is wide enough differs."""
        return not (self.feasibility or self.yaw_rate or self.binding)


def cells(where: BoolArray) -> list[tuple[int, int]]:
    """Indices of the true elements."""
    return [(int(i), int(j)) for i, j in np.argwhere(where)]


def near_binding(problem: SteadyTurnProblem, speed: FloatArray, found: Solution) -> npt.NDArray[np.uint8]:
    """Constraints used to within a hundredth of the binding tolerance of that tolerance: on either side by rounding."""
    car = problem.car
    lateral_acceleration = np.abs(speed[:, np.newaxis] * found.yaw_rate)
    shares = {
        Binding.SIDESLIP: np.abs(found.sideslip) / problem.sideslip_max,
        Binding.LATERAL_ACCELERATION: lateral_acceleration / problem.lateral_acceleration_max,
        Binding.SLIP_FRONT: lateral_acceleration * car.front_slip_per_lateral_acceleration / problem.front_slip_max,
        Binding.SLIP_REAR: lateral_acceleration * car.rear_slip_per_lateral_acceleration / problem.rear_slip_max,
    }
    if problem.rear_angle_max > 0.0:
        shares[Binding.REAR_ANGLE] = np.abs(found.rear_angle) / problem.rear_angle_max
    near = np.zeros(found.feasible.shape, dtype=np.uint8)
    for flag, share in shares.items():
        near[np.abs(share - (1.0 - BINDING_TOLERANCE)) < 0.01 * BINDING_TOLERANCE] |= np.uint8(flag)
    return near


def compare(problem: SteadyTurnProblem, speed: FloatArray, reference: Solution, other: Solution) -> Comparison:
    """Compare `other` with the exact `reference`, whose margin says which cells are too thin."""
    thin = np.abs(reference.margin) < MARGIN_MIN
    both = reference.feasible & other.feasible & ~thin
    difference = np.where(both, np.abs(reference.yaw_rate - other.yaw_rate), 0.0)
    unequal_binding = (reference.active ^ other.active) & ~near_binding(problem, speed, reference)
    return Comparison(
        thin=cells(thin),
        feasibility=cells((reference.feasible != other.feasible) & ~thin),
        yaw_rate=cells(~(difference <= YAW_RATE_TOLERANCE)),
        binding=cells(both & (unequal_binding != 0)),
        largest_difference=float(difference.max()),
    )


def both_ways(config: Config, case: Case, speed: FloatArray, front_angle: FloatArray) -> Comparison:
    """Solve one case both ways and compare."""
    problem = SteadyTurnProblem.from_config(config, case)
    found = exact.solve(problem, speed, front_angle)
    return compare(problem, speed, found, ipopt.solve(config, problem, speed, front_angle))


def case_of(config: Config, name: str) -> Case:
    """One of the paper's cases, or the one whose small weight makes the objective concave."""
    return Case(sideslip_weight_per_s2=10.0) if name == CONCAVE else config.case(name)


@pytest.mark.parametrize("share", range(SHARES))
@pytest.mark.parametrize("name", CASES)
def test_whole_grid(paper: Config, name: str, share: int, record_property: Any) -> None:
    speed, front_angle = breakpoints(paper)
    assert (speed.size, front_angle.size) == (101, 100)
    rows = speed[share::SHARES]  # together the shares are the whole grid
    found = both_ways(paper, case_of(paper, name), rows, front_angle)
    for i, j in found.thin:
        record_property("too thin to compare", f"{rows[i] * 3.6:.6g} km/h, {np.degrees(front_angle[j]):.6g} deg")
    assert found.agrees, found
    assert len(found.thin) <= 5  # of about 2000: the comparison is not empty
    assert found.largest_difference < YAW_RATE_TOLERANCE


@pytest.mark.parametrize("batch", range(BATCHES))
def test_random_vehicles(batch: int, record_property: Any) -> None:
    """240 cars in all, of any mass, geometry, tyres, limits and weight; about half of them oversteer."""
    rng = np.random.default_rng((20_240_615, batch))
    compared = oversteering = thin = 0
    for number in range(VEHICLES // BATCHES):
        config = random_config(rng)
        speed, front_angle = breakpoints(config)
        found = both_ways(config, config.case(CASE), speed, front_angle)
        assert found.agrees, (batch, number, found, config)
        for cell in found.thin:
            record_property("too thin to compare", f"vehicle {number}, cell {cell}")
        compared += 16 - len(found.thin)
        thin += len(found.thin)
        oversteering += SteadyTurnProblem.from_config(config, config.case(CASE)).car.understeer_coefficient < 0.0
    assert compared >= 16 * VEHICLES // BATCHES - 5 and thin <= 5
    assert oversteering >= VEHICLES // BATCHES // 5


def test_without_a_weight_on_sideslip() -> None:
    """Turns to both sides can then be equally good: both ways take the left one."""
    rng = np.random.default_rng(20_240_616)
    for _ in range(12):
        config = random_config(rng, rear_steering=True)
        found = both_ways(config, Case(sideslip_weight_per_s2=0.0), *breakpoints(config))
        assert found.agrees, (found, config)


# --- the comparison itself, and what it would find ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def solved(paper: Config) -> tuple[SteadyTurnProblem, FloatArray, Solution]:
    """A coarse 4WS-2 map."""
    speed, front_angle = (values[::11] for values in breakpoints(paper))
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    return problem, speed, exact.solve(problem, speed, front_angle)


def test_comparison_sees_each_kind_of_difference(solved: tuple[SteadyTurnProblem, FloatArray, Solution]) -> None:
    problem, speed, found = solved
    i, j = cells(found.feasible & (found.active != 0))[3]

    def changed(name: str, value: Any) -> Solution:
        array = getattr(found, name).copy()
        array[i, j] = value
        return replace(found, **{name: array})

    assert compare(problem, speed, found, found).agrees
    assert compare(problem, speed, found, changed("yaw_rate", found.yaw_rate[i, j] + 2e-6)).yaw_rate == [(i, j)]
    assert compare(problem, speed, found, changed("yaw_rate", np.nan)).yaw_rate == [(i, j)]
    assert compare(problem, speed, found, changed("feasible", False)).feasibility == [(i, j)]
    assert compare(problem, speed, found, changed("active", 0)).binding == [(i, j)]


def test_thin_cells_are_listed_and_not_compared(paper: Config) -> None:
    """Front angles on the very edge: a rounding decides whether they are feasible."""
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    speed = np.array([80.0, 100.0]) / 3.6
    edge = exact.edge(problem, speed).front_angle
    found = both_ways(paper, paper.case("4ws-2"), speed[:1], np.array([0.5, 1.0 - 1e-9, 1.0 + 1e-9, 1.2]) * edge[0])
    assert found.thin == [(0, 1), (0, 2)]
    assert found.agrees


def test_interval_just_wide_enough_is_compared(paper: Config) -> None:
    """2e-6 rad of rear angle left, or missing: IPOPT tells the two apart and finds the optimum in between."""
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    for speed in np.array([[45.0], [80.0], [118.0]]) / 3.6:
        edge = exact.edge(problem, speed).front_angle[0]
        angles = np.array([edge - 2e-6, edge + 2e-6])
        assert exact.solve(problem, speed, angles).feasible.tolist() == [[True, False]]
        found = both_ways(paper, paper.case("4ws-2"), speed, angles)
        assert found.thin == []
        assert found.agrees, found


# --- its own behaviour --------------------------------------------------------------------------------------------------


def test_map_made_with_it(paper: Config) -> None:
    """The same map as the exact one, told apart in `meta`; progress counts the cells."""
    grid = paper.grid.model_copy(update={"speed_points": 4, "front_angle_points": 5})
    config = paper.model_copy(update={"grid": grid})
    calls: list[tuple[int, int]] = []
    found = solve_case(config, "4ws-2", "ipopt", lambda done, total: calls.append((done, total)))
    reference = solve_case(config, "4ws-2")
    assert calls == [(5, 20), (10, 20), (15, 20), (20, 20)]
    assert (found.meta["method"], reference.meta["method"]) == ("ipopt", "exact")
    np.testing.assert_array_equal(found.feasible, reference.feasible)
    np.testing.assert_allclose(found.yaw_rate, reference.yaw_rate, rtol=0.0, atol=YAW_RATE_TOLERANCE)


def test_neither_way_uses_the_other(paper: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """IPOPT solves with the closed forms of the steady turn taken away."""
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    speed, front_angle = np.array([12.0]), np.array([0.05, 0.1])
    expected = exact.solve(problem, speed, front_angle)

    def gone(*_: object) -> None:
        raise AssertionError("used")

    for name in ("solve", "edge", "_intervals"):
        monkeypatch.setattr(exact, name, gone)
    for name in ("yaw_gain", "sideslip_per_yaw_rate"):
        monkeypatch.setattr(type(problem.car), name, gone)
    found = ipopt.solve(paper, problem, speed, front_angle)
    np.testing.assert_allclose(found.yaw_rate, expected.yaw_rate, rtol=0.0, atol=YAW_RATE_TOLERANCE)


def test_a_point_that_ipopt_cannot_finish_is_an_error_not_an_infeasible_cell(
    paper: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ipopt, "_run", lambda *_: None)
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    with pytest.raises(MapError) as caught:
        ipopt.solve(paper, problem, np.array([36.0 / 3.6]), np.radians([2.0]))
    assert caught.value.where == "36 km/h, 2 deg"
    assert "exact" in caught.value.remedy
