"""Comparison of IPOPT with the exact solution, point by point. The two methods share only the description of the problem.

The tests cover every cell of the default grid on the paper's car, and random cars, which a brute-force scan solves too. Cells
whose feasible interval of rear angles is under 1e-6 rad are counted but not compared: rounding decides their feasibility.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from codegen.arrays import FloatArray
from codegen.configuration import REFERENCE_CASES, Case, Config
from codegen.map_file.bounds import Binding
from codegen.optimum import exact, ipopt
from codegen.optimum.exact import Solution
from codegen.optimum.problem import BINDING_TOLERANCE, SteadyTurnProblem, breakpoints
from codegen.optimum.solve import solve_stack
from codegen.optimum.turns import LinearTurns
from tests.optimum.cars import CASE, PAPER, SteadyModel, changed, check_against_scan, random_config

YAW_RATE_TOLERANCE = 1e-6  # rad/s
MARGIN_MIN = 1e-6  # rad
CONCAVE = "lambda 10"
CASES = ("fws", "4ws-1", "4ws-2", CONCAVE, *REFERENCE_CASES)
PART_COUNT = 10
"""Parts of the default grid. Each takes about two seconds; the quick form compares one of each case."""
VEHICLE_COUNT = 40
"""Vehicles in each batch."""


def near_binding(problem: SteadyTurnProblem, speed: FloatArray, found: Solution) -> npt.NDArray[np.uint8]:
    """Return the constraints whose use is within a hundredth of the binding tolerance from it, where rounding decides."""
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


def both_methods(config: Config, case: Case, speed: FloatArray, front_angle: FloatArray) -> list[tuple[int, int]]:
    """Solve one case with both methods and compare. Return the cells (indices) that are too thin to compare."""
    problem = SteadyTurnProblem.from_config(config, case)
    reference, other = exact.solve(problem, speed, front_angle), ipopt.solve(config, LinearTurns(problem), speed, front_angle)
    wide = np.abs(reference.margin) >= MARGIN_MIN
    both = reference.feasible & other.feasible & wide
    near = both & (np.abs(reference.yaw_rate - other.yaw_rate) <= YAW_RATE_TOLERANCE)
    unequal_binding = (reference.active ^ other.active) & ~near_binding(problem, speed, reference)
    for what, cells in (
        ("feasibility", (reference.feasible != other.feasible) & wide),
        ("yaw rate", both & ~near),
        ("binding", both & (unequal_binding != 0)),
    ):
        assert not cells.any(), (what, np.argwhere(cells), config)
    return [(int(i), int(j)) for i, j in np.argwhere(~wide)]


def case_of(config: Config, name: str) -> Case:
    """Return a case of the paper, one for comparison, or the one whose small weight makes the objective concave."""
    return Case(sideslip_weight_per_s2=10.0) if name == CONCAVE else config.case(name)


def quick_and_long(count: int) -> list[Any]:
    """Return 0 for the quick form and the other numbers for the long one."""
    return [0, *(pytest.param(number, marks=pytest.mark.long) for number in range(1, count))]


@pytest.mark.parametrize("part", quick_and_long(PART_COUNT))
@pytest.mark.parametrize("name", CASES)
def test_whole_grid(name: str, part: int) -> None:
    speed, front_angle = breakpoints(PAPER)
    assert (speed.size, front_angle.size) == (101, 100)
    # Few of the roughly 1000 cells are thin, so the comparison is not empty. Together the parts cover the whole grid.
    assert len(both_methods(PAPER, case_of(PAPER, name), speed[part::PART_COUNT], front_angle)) <= 5


@pytest.mark.parametrize("batch", quick_and_long(6))
def test_random_vehicles(batch: int) -> None:
    """Cars of any mass, geometry, tyres, limits and weight; about half of them oversteer."""
    rng = np.random.default_rng((20_240_615, batch))
    oversteering = thin = 0
    for _ in range(VEHICLE_COUNT):
        config = random_config(rng)
        thin += len(both_methods(config, config.case(CASE), *breakpoints(config)))
        oversteering += SteadyTurnProblem.from_config(config, config.case(CASE)).car.understeer_coefficient < 0.0
    assert thin <= 5 and oversteering >= VEHICLE_COUNT // 5


@pytest.mark.parametrize("batch", quick_and_long(4))
def test_brute_force_on_random_cars(batch: int) -> None:
    rng = np.random.default_rng((20_240_612, batch))
    for _ in range(25):
        config = random_config(rng)
        check_against_scan(SteadyModel.of(config, config.case(CASE)), *breakpoints(config))


@pytest.mark.parametrize("weight", [10.0, 32.5, 32.7, 100.0, 3_000.0])
def test_brute_force_on_the_papers_car(weight: float) -> None:
    """The objective is concave for weights below 32.6."""
    speeds, angles = breakpoints(PAPER)
    check_against_scan(SteadyModel.of(PAPER, Case(sideslip_weight_per_s2=weight)), speeds[::12], angles[::11])


def test_without_a_weight_on_sideslip() -> None:
    """Turns to either side can then be equally good: both methods choose the left one."""
    rng = np.random.default_rng(20_240_616)
    for _ in range(12):
        config = random_config(rng, rear_steering=True)
        both_methods(config, Case(sideslip_weight_per_s2=0.0), *breakpoints(config))


def test_a_stack_and_a_passively_safe_case() -> None:
    safe = {**PAPER.cases["4ws-2"].model_dump(mode="json"), "passive_safe": True}
    config = changed(PAPER, grid={"speed_points": 6, "front_angle_points": 5}, cases={"safe": safe})
    for case in ("4ws-2", "safe"):
        found, expected = (solve_stack(config, case, (0.5, 0.9), method) for method in ("ipopt", "exact"))
        for one, other in ((found, expected), (found.layers[0].map, expected.layers[0].map)):
            np.testing.assert_array_equal(one.feasible, other.feasible)
            np.testing.assert_array_equal(one.active, other.active)
            np.testing.assert_allclose(one.yaw_rate, other.yaw_rate, rtol=0.0, atol=YAW_RATE_TOLERANCE)
            np.testing.assert_allclose(one.rear_angle, other.rear_angle, rtol=0.0, atol=YAW_RATE_TOLERANCE)
