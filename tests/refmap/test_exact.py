"""The exact solution: against the paper, against a brute-force scan of an independent model, and where it ends."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pytest

from codegen.config import KM_H, Case, Config, parse
from codegen.errors import ConfigError, MapError
from codegen.refmap import exact
from codegen.refmap.map import Binding, ReferenceMap
from codegen.refmap.problem import BINDING_TOLERANCE, SteadyTurnProblem, breakpoints
from codegen.refmap.solve import solve_case
from tests.refmap.cars import CASE, SteadyModel, random_config

FloatArray = npt.NDArray[np.float64]
SLIPS = int(Binding.SLIP_FRONT | Binding.SLIP_REAR)


@dataclass(frozen=True)
class Point:
    """One operating point of the paper's car in degrees."""

    yaw_rate: float
    sideslip: float
    rear_angle: float


def point(config: Config, case: str, speed_km_h: float, front_angle_deg: float) -> Point:
    """The optimum of a case of the paper's car."""
    problem = SteadyTurnProblem.from_config(config, config.case(case))
    found = exact.solve(problem, np.array([speed_km_h * KM_H]), np.radians([front_angle_deg]))
    yaw_rate, sideslip, rear_angle = (
        math.degrees(values[0, 0]) for values in (found.yaw_rate, found.sideslip, found.rear_angle)
    )
    return Point(yaw_rate, sideslip, rear_angle)


# --- the paper's numbers ------------------------------------------------------------------------------------------------

PAPER_TABLE = {"fws": 15.35, "4ws-1": 26.82, "4ws-2": 21.35}


@pytest.mark.parametrize("case", PAPER_TABLE)
@pytest.mark.parametrize(("speed", "tolerance"), [(43.9, 0.02), (43.35, 0.006)])
def test_yaw_rates_of_the_papers_table(paper: Config, case: str, speed: float, tolerance: float) -> None:
    """The table names 43.9 km/h and fits 43.35 km/h better: most likely it was read one grid column beside its label."""
    assert point(paper, case, speed, 4.0).yaw_rate == pytest.approx(PAPER_TABLE[case], rel=tolerance)


@pytest.mark.parametrize(
    ("speed", "case", "yaw_rate", "sideslip", "half_a_digit"),
    [
        (43.9, "fws", 15.544, 1.070, 5e-4),
        (43.9, "4ws-1", 26.4, 0.97, (0.05, 0.005)),
        (43.9, "4ws-2", 21.424, 0.038, 5e-4),
        (43.35, "fws", 15.349, 1.093, 5e-4),
        (43.35, "4ws-1", 26.7, 1.05, (0.05, 0.01)),  # worked out as "about": 1.056
        (43.35, "4ws-2", 21.321, 0.038, 5e-4),
    ],
)
def test_exact_figures_worked_out_from_the_paper(
    paper: Config, speed: float, case: str, yaw_rate: float, sideslip: float, half_a_digit: float | tuple[float, float]
) -> None:
    found = point(paper, case, speed, 4.0)
    of_yaw_rate, of_sideslip = half_a_digit if isinstance(half_a_digit, tuple) else (half_a_digit, half_a_digit)
    assert found.yaw_rate == pytest.approx(yaw_rate, abs=of_yaw_rate)
    assert abs(found.sideslip) == pytest.approx(sideslip, abs=of_sideslip)


def test_gain_of_4ws_2_over_fws(paper: Config) -> None:
    """The paper prints +38.1 %."""
    rates = {case: point(paper, case, 43.9, 4.0).yaw_rate for case in ("fws", "4ws-2")}
    assert 100.0 * (rates["4ws-2"] / rates["fws"] - 1.0) == pytest.approx(37.8, abs=0.5)


@pytest.mark.parametrize(("case", "expected"), [("4ws-2", 27.25), ("fws", 25.4)])
def test_reference_of_the_papers_step_steer(paper: Config, case: str, expected: float) -> None:
    """C1 and C2: 90 deg at the steering wheel are 6.75 deg at the road wheel."""
    assert point(paper, case, 42.5, 90.0 / paper.steering.ratio).yaw_rate == pytest.approx(expected, abs=0.1)


def test_shares_of_the_grid(maps: Mapping[str, ReferenceMap], paper: Config) -> None:
    """About 11 % of the feasible 4WS-2 cells sit at the rear angle's bound; 28 % of the grid needs rear steer."""
    steered, passive = maps["4ws-2"], maps["fws"]
    assert steered.rear_angle is not None
    at_bound = np.abs(steered.rear_angle[steered.feasible]) >= (1.0 - 1e-9) * paper.limits.rear_angle_max
    assert at_bound.mean() == pytest.approx(0.11, abs=0.005)
    assert (steered.feasible & ~passive.feasible).mean() == pytest.approx(0.28, abs=0.005)
    assert not (passive.feasible & ~steered.feasible).any()


# --- what binds ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", ["4ws-1", "4ws-2"])
def test_slips_bind_together_and_lateral_acceleration_never(maps: Mapping[str, ReferenceMap], case: str) -> None:
    active = maps[case].active
    assert active is not None
    assert set(np.unique(active)) == {0, SLIPS, int(Binding.REAR_ANGLE)}


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_cap_is_the_slip_bound(paper: Config, case: str) -> None:
    """5.61 m/s^2 = 0.572 g, in front and at the rear within rounding; the bound on lateral acceleration is 0.8 g."""
    problem = SteadyTurnProblem.from_config(paper, paper.case(case))
    front = problem.front_slip_max / problem.car.front_slip_per_lateral_acceleration
    rear = problem.rear_slip_max / problem.car.rear_slip_per_lateral_acceleration
    assert problem.lateral_acceleration_cap == pytest.approx(5.61, abs=0.005)
    assert problem.lateral_acceleration_cap / 9.81 == pytest.approx(0.572, abs=5e-4)
    assert front == pytest.approx(rear, rel=1e-9)


def test_binding_sets_are_those_of_the_definitions() -> None:
    """Against slips and angles of the independent model; bounds used to within a tenth of the tolerance of it are left out."""
    rng = np.random.default_rng(20_240_611)
    seen = 0
    for _ in range(60):
        config = random_config(rng)
        model = SteadyModel.of(config, config.case(CASE))
        speeds, angles = breakpoints(config)
        found = exact.solve(model.problem, speeds, angles)
        for i, j in np.argwhere(found.feasible):
            used = model.turns(speeds[i], angles[j], found.rear_angle[i, j : j + 1]).used
            for flag, share in used.items():
                beyond = float(share[0]) - (1.0 - BINDING_TOLERANCE)
                if abs(beyond) > 0.1 * BINDING_TOLERANCE:
                    assert bool(found.active[i, j] & flag) == (beyond > 0.0)
            seen |= int(found.active[i, j])
    assert seen == sum(Binding)


@pytest.mark.parametrize("flag", Binding)
def test_binding_tolerance_is_a_millionth_of_the_bound(paper: Config, flag: Binding) -> None:
    """One bound at a time used up to 0.9 and 1.1 millionths, on both sides of zero; the slips by what the definitions make of a
    yaw rate."""
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    model, speed = SteadyModel.of(paper, paper.case("4ws-2")), 15.0
    one = model.turns(speed, 0.05, np.zeros(1))
    bound = {
        Binding.SIDESLIP: problem.sideslip_max,
        Binding.REAR_ANGLE: problem.rear_angle_max,
        Binding.LATERAL_ACCELERATION: float((one.yaw_rate / one.used[Binding.LATERAL_ACCELERATION])[0]),
        Binding.SLIP_FRONT: float((one.yaw_rate / one.used[Binding.SLIP_FRONT])[0]),
        Binding.SLIP_REAR: float((one.yaw_rate / one.used[Binding.SLIP_REAR])[0]),
    }[flag]
    for sign in (-1.0, 1.0):
        values = sign * bound * np.array([1.0 - 1.1e-6, 1.0 - 0.9e-6, 1.0, np.nan])
        sideslip, rear_angle = (values if flag == own else np.zeros(4) for own in (Binding.SIDESLIP, Binding.REAR_ANGLE))
        yaw_rate = np.zeros(4) if flag in (Binding.SIDESLIP, Binding.REAR_ANGLE) else values
        found = exact.binding(problem, np.full(4, speed), yaw_rate, sideslip, rear_angle)
        assert ((found & flag) != 0).tolist() == [False, True, True, False]


def test_infeasible_cells_hold_nothing(maps: Mapping[str, ReferenceMap]) -> None:
    for reference_map in maps.values():
        infeasible = ~reference_map.feasible
        assert infeasible.any() and not infeasible.all()
        for values in (reference_map.yaw_rate, reference_map.sideslip, reference_map.rear_angle):
            assert values is not None
            np.testing.assert_array_equal(np.isnan(values), infeasible)
        assert reference_map.active is not None
        assert not reference_map.active[infeasible].any()


# --- against brute force ------------------------------------------------------------------------------------------------


def check_against_scan(model: SteadyModel, speeds: FloatArray, angles: FloatArray) -> None:
    """The scan starts at a spacing of 2 limit / 4000, so it may miss an interval that is narrower; it ends below 1e-12 rad.

    Near the vertex of a parabola the objective does not resolve the rear angle better than the root of the rounding error
    (1e-8 rad), and the yaw gain reaches 30/s: hence 1e-6 rad/s. The objective itself agrees to 1e-8 of the larger of one and
    its size.
    """
    problem = model.problem
    found = exact.solve(problem, speeds, angles)
    spacing = 2.0 * problem.rear_angle_max / 4_000
    for i, j in itertools.product(range(speeds.size), range(angles.size)):
        best = model.scan(speeds[i], angles[j])
        if best is None:
            assert found.margin[i, j] <= spacing + 1e-12
            continue
        assert found.feasible[i, j] or found.margin[i, j] > -1e-12
        if not found.feasible[i, j]:
            continue
        turns = model.turns(speeds[i], angles[j], np.array([found.rear_angle[i, j], best[0]]))
        assert max(float(share[0]) for share in turns.used.values()) <= 1.0 + 1e-9
        mine, scanned = turns.objective(problem.sideslip_weight)
        assert mine == pytest.approx(scanned, abs=1e-8 * max(1.0, abs(scanned)))
        assert found.yaw_rate[i, j] == pytest.approx(turns.yaw_rate[1], abs=1e-6)
        assert found.yaw_rate[i, j] == pytest.approx(turns.yaw_rate[0], abs=1e-12)
        assert found.sideslip[i, j] == pytest.approx(turns.sideslip[0], abs=1e-12)


def test_brute_force_on_random_cars() -> None:
    rng = np.random.default_rng(20_240_612)
    concave = convex = passive = 0
    for _ in range(80):
        config = random_config(rng)
        model = SteadyModel.of(config, config.case(CASE))
        speeds, angles = breakpoints(config)
        check_against_scan(model, speeds, angles)
        curvature = np.diff(
            model.turns(speeds[0], 0.0, np.array([-0.01, 0.0, 0.01])).objective(model.problem.sideslip_weight), 2
        )
        passive += model.problem.rear_angle_max == 0.0
        concave += float(curvature[0]) < 0.0
        convex += float(curvature[0]) > 0.0
    assert min(concave, convex) > 10 and passive > 3


@pytest.mark.parametrize("weight", [10.0, 32.5, 32.7, 100.0, 3_000.0])
def test_brute_force_on_the_papers_car(paper: Config, weight: float) -> None:
    """Weights on both sides of 32.6, below which the objective turns concave."""
    model = SteadyModel.of(paper, Case(sideslip_weight_per_s2=weight))
    speeds, angles = breakpoints(paper)
    check_against_scan(model, speeds[::12], angles[::11])


def test_small_weight_goes_to_an_end_of_the_feasible_interval(paper: Config) -> None:
    """The objective is concave: nothing between the ends can be optimal, so a constraint binds in every cell."""
    model = SteadyModel.of(paper, Case(sideslip_weight_per_s2=10.0))
    speeds, angles = breakpoints(paper)
    found = exact.solve(model.problem, speeds, angles)
    assert np.all(found.active[found.feasible] != 0)
    # It is the end with the larger yaw rate: a little less rear angle breaks a bound.
    for i, j in np.argwhere(found.feasible)[::97]:
        turns = model.turns(speeds[i], angles[j], found.rear_angle[i, j] + np.array([1e-9, -1e-9]))
        assert turns.feasible.tolist() == [True, False]


def test_a_left_turn_even_without_a_weight_on_sideslip() -> None:
    """Where grip limits the turn to both sides, -r^2 alone is the same to the right: rounding must not choose."""
    rng = np.random.default_rng(20_240_613)
    for _ in range(200):
        config = random_config(rng, rear_steering=True)
        problem = replace(SteadyTurnProblem.from_config(config, config.case(CASE)), sideslip_weight=0.0)
        found = exact.solve(problem, *breakpoints(config))
        assert np.all(found.yaw_rate[found.feasible] > 0.0)


# --- where feasibility ends ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rear_steering", [False, True])
def test_edge_is_where_feasibility_ends(rear_steering: bool) -> None:
    """Just inside feasible and just outside not, by a part in 1e9; the place itself against linear programming, whose
    tolerance is 1e-7 of a bound."""
    rng = np.random.default_rng(20_240_614)
    grip_limited: list[bool] = []
    for _ in range(120):
        config = random_config(rng, rear_steering=rear_steering)
        model = SteadyModel.of(config, config.case(CASE))
        speeds, _ = breakpoints(config)
        edge = exact.edge(model.problem, speeds)
        for i, speed in enumerate(speeds):
            near = exact.solve(model.problem, speeds[i : i + 1], edge.front_angle[i] * np.array([1.0 - 1e-9, 1.0 + 1e-9]))
            assert near.feasible.tolist() == [[True, False]]
            assert near.yaw_rate[0, 0] == pytest.approx(edge.yaw_rate[i], rel=1e-6)
            cap = model.problem.lateral_acceleration_cap
            at_cap = math.isclose(speed * edge.yaw_rate[i], cap, rel_tol=1e-9)
            assert at_cap == edge.grip_limited[i]
            assert speed * edge.yaw_rate[i] <= cap * (1.0 + 1e-12)
        grip_limited.extend(edge.grip_limited)
        assert edge.front_angle[0] == pytest.approx(model.widest_turn(speeds[0])[0], rel=1e-6)
        assert edge.front_angle[-1] == pytest.approx(model.widest_turn(speeds[-1])[0], rel=1e-6)
    assert 0.2 < np.mean(grip_limited) < 0.95  # both kinds are met


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_edge_moves_smoothly_with_speed(paper: Config, case: str) -> None:
    """Halving the spacing halves every step: no jumps. Angle and yaw rate turn at most once: no sawtooth. On the cells of the
    grid instead, the edge would jump by 0.1 deg at a time."""
    problem = SteadyTurnProblem.from_config(paper, paper.case(case))

    def steps(points: int) -> tuple[FloatArray, FloatArray]:
        edge = exact.edge(problem, np.linspace(5.0, 60.0, points))
        return np.diff(edge.front_angle), np.diff(edge.yaw_rate)

    for coarse, fine in zip(steps(4_001), steps(8_001), strict=True):
        assert np.abs(fine).max() <= 0.52 * np.abs(coarse).max()
        assert np.count_nonzero(np.diff(np.sign(fine))) <= 1


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_optimum_moves_smoothly_over_the_grid(paper: Config, case: str) -> None:
    """Along both axes, halving the spacing halves the largest step between feasible neighbours."""
    problem = SteadyTurnProblem.from_config(paper, paper.case(case))

    def largest(points: int) -> list[float]:
        speeds = np.linspace(20.0, 120.0, points) * KM_H
        found = exact.solve(problem, speeds, np.radians(np.linspace(0.1, 10.0, points)))
        return [float(np.nanmax(np.abs(np.diff(found.yaw_rate, axis=axis)))) for axis in (0, 1)]

    for coarse, fine in zip(largest(401), largest(801), strict=True):
        assert fine <= 0.52 * coarse


# --- refused ------------------------------------------------------------------------------------------------------------


def oversteering(top_km_h: float) -> Config:
    """A car with soft rear tyres: critical speed about 130 km/h."""
    return parse(
        {
            "tyre": {"front": {"cornering_stiffness_n_per_rad": 120e3}, "rear": {"cornering_stiffness_n_per_rad": 90e3}},
            "grid": {"speed_max_km_h": top_km_h},
        },
        "test",
    )


def test_speeds_beyond_the_critical_one_are_refused() -> None:
    """Critical: vx^2 = L/-K, from the definitions."""
    vehicle = oversteering(100.0).vehicle
    understeer = vehicle.mass_kg / vehicle.wheelbase * (vehicle.cg_to_rear_axle_m / 240e3 - vehicle.cg_to_front_axle_m / 180e3)
    critical = math.sqrt(vehicle.wheelbase / -understeer) / KM_H
    solve_case(oversteering(0.97 * critical), "4ws-2")
    with pytest.raises(ConfigError) as caught:
        solve_case(oversteering(0.99 * critical), "4ws-2")
    assert caught.value.where == "grid.speed_max_km_h"
    assert f"unstable from {critical:.1f} km/h" in caught.value.what
    assert f"{0.98 * critical:.0f} km/h" in caught.value.remedy


def test_listed_speeds_beyond_the_critical_one_are_refused() -> None:
    grid = {"speed_breakpoints_km_h": [20.0, 50.0, 399.0]}
    config = parse({**oversteering(100.0).model_dump(exclude={"grid"}), "grid": grid}, "test")
    with pytest.raises(ConfigError, match="unstable from"):
        solve_case(config, "fws")


@pytest.mark.parametrize("method", ["exact", "ipopt"])
def test_map_that_is_infeasible_everywhere_is_refused(paper: Config, method: str) -> None:
    grid = paper.grid.model_copy(
        update={"speed_min_km_h": 100.0, "speed_points": 3, "front_angle_min_deg": 9.0, "front_angle_points": 3}
    )
    with pytest.raises(MapError) as caught:
        solve_case(paper.model_copy(update={"grid": grid}), "fws", method)  # type: ignore[arg-type]
    assert caught.value.what == "no operating point of the grid is feasible"
    assert caught.value.where == "[cases.fws]"
    assert "limits" in caught.value.remedy
