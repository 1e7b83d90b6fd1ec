"""The exact solution compared with the paper, a brute-force scan of an independent model and IPOPT, and the limit of
feasibility."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.errors import ConfigError, MapError
from codegen.map_file.bounds import BOUNDS
from codegen.optimum import exact, ipopt
from codegen.optimum.problem import BINDING_TOLERANCE, SteadyTurnProblem, breakpoints
from codegen.optimum.solve import solve_case
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from tests.optimum.cars import CASE, PAPER, SteadyModel, changed, check_against_scan, random_config


@pytest.mark.parametrize(("case", "printed"), [("fws", 15.35), ("4ws-1", 26.82), ("4ws-2", 21.35)])
def test_yaw_rates_of_the_papers_table(case: str, printed: float) -> None:
    """The table names 43.9 km/h but fits 43.35 km/h better, probably one grid column off its label."""
    problem = SteadyTurnProblem.from_config(PAPER, PAPER.case(case))
    for speed_km_h, tolerance in ((43.9, 0.02), (43.35, 0.006)):
        found = exact.solve(problem, np.array([speed_km_h * KM_H]), np.radians([4.0])).yaw_rate[0, 0]
        assert math.degrees(found) == pytest.approx(printed, rel=tolerance)


def test_binding_sets_follow_their_definitions() -> None:
    """Slips and angles of the independent model decide, except within a tenth of the tolerance around it."""
    rng = np.random.default_rng(20_240_611)
    seen = 0
    for number in range(60):
        config = random_config(rng)
        model = SteadyModel.of(config, config.case(CASE))
        if number % 2:  # with an envelope about as wide as the other bounds
            envelope = {
                "envelope_rear_slip_max": rng.uniform(0.01, 0.1),
                "envelope_lateral_acceleration_max": rng.uniform(2.0, 9.0),
            }
            model = replace(model, problem=replace(model.problem, **envelope))
        speeds, angles = breakpoints(config)
        found = exact.solve(model.problem, speeds, angles)
        for i, j in np.argwhere(found.feasible)[::4]:
            used = model.turns(speeds[i], angles[j], found.rear_angle[i, j : j + 1]).used
            for flag, share in used.items():
                beyond = float(share[0]) - (1.0 - BINDING_TOLERANCE)
                if abs(beyond) > 0.1 * BINDING_TOLERANCE:
                    assert bool(found.active[i, j] & flag) == (beyond > 0.0)
            seen |= int(found.active[i, j])
    assert seen == sum(bound.flag for bound in BOUNDS)


def test_brute_force_on_random_cars() -> None:
    """The evidence tier scans more cars."""
    rng = np.random.default_rng(20_240_612)
    for _ in range(10):
        config = random_config(rng)
        check_against_scan(SteadyModel.of(config, config.case(CASE)), *breakpoints(config))


def test_a_left_turn_even_without_a_weight_on_sideslip() -> None:
    """If grip limits the turn to both sides, -r^2 is equal on the right and the left: rounding must not choose."""
    rng = np.random.default_rng(20_240_613)
    for _ in range(100):
        config = random_config(rng, rear_steering=True)
        problem = replace(SteadyTurnProblem.from_config(config, config.case(CASE)), sideslip_weight=0.0)
        found = exact.solve(problem, *breakpoints(config))
        assert np.all(found.yaw_rate[found.feasible] > 0.0)


def test_ipopt_solves_a_map_without_the_closed_forms(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tolerance is the required agreement of the two methods; evidence compares whole grids."""
    grid = {"speed_breakpoints_km_h": [40.0, 90.0], "front_angle_breakpoints_deg": [1.0, 2.0, 9.0]}
    config, calls = changed(PAPER, grid=grid), list[tuple[int, int]]()
    expected = solve_case(config, "4ws-2")
    for name in ("solve", "edge", "_intervals"):
        monkeypatch.setattr(exact, name, None)
    for name in ("yaw_gain", "sideslip_per_yaw_rate"):
        monkeypatch.setattr(SingleTrack, name, None)
    found = solve_case(config, "4ws-2", "ipopt", lambda done, total: calls.append((done, total)))
    assert calls == [(3, 6), (6, 6)]
    assert (found.meta["method"], expected.meta["method"]) == ("ipopt", "exact")
    np.testing.assert_array_equal(found.feasible, expected.feasible)
    np.testing.assert_allclose(found.yaw_rate, expected.yaw_rate, rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal(found.active, expected.active)


def test_a_point_that_ipopt_cannot_finish_is_an_error_not_an_infeasible_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ipopt, "_run", lambda *_: None)
    with pytest.raises(MapError, match=r"^36 km/h, 2 deg: .*exact"):
        ipopt.solve(PAPER, turns_of(PAPER, PAPER.case("4ws-2")), np.array([36.0 / 3.6]), np.radians([2.0]))


@pytest.mark.parametrize("rear_steering", [False, True])
def test_the_edge_is_where_feasibility_ends(rear_steering: bool) -> None:
    """Points 1e-9 inside are feasible, 1e-9 outside infeasible. Linear programming gives the edge to 1e-7 of a bound."""
    rng = np.random.default_rng(20_240_614)
    grip_limited: list[bool] = []
    for _ in range(40):
        config = random_config(rng, rear_steering=rear_steering)
        model = SteadyModel.of(config, config.case(CASE))
        speeds, _ = breakpoints(config)
        edge = exact.edge(model.problem, speeds)
        for i, speed in enumerate(speeds):
            near = exact.solve(model.problem, speeds[i : i + 1], edge.front_angle[i] * np.array([1.0 - 1e-9, 1.0 + 1e-9]))
            assert near.feasible.tolist() == [[True, False]]
            assert near.yaw_rate[0, 0] == pytest.approx(edge.yaw_rate[i], rel=1e-6)
            cap = model.problem.lateral_acceleration_cap
            assert math.isclose(speed * edge.yaw_rate[i], cap, rel_tol=1e-9) == edge.grip_limited[i]
            assert speed * edge.yaw_rate[i] <= cap * (1.0 + 1e-12)
        grip_limited.extend(edge.grip_limited)
        assert edge.front_angle[-1] == pytest.approx(model.widest_turn(speeds[-1])[0], rel=1e-6)
    assert 0.2 < np.mean(grip_limited) < 0.95  # both kinds occur


def test_speeds_beyond_the_critical_one_are_refused() -> None:
    """The car has soft rear tyres; its critical speed is vx^2 = L/-K, by definition."""
    tyre = {"front": {"cornering_stiffness_n_per_rad": 120e3}, "rear": {"cornering_stiffness_n_per_rad": 90e3}}
    vehicle = PAPER.vehicle
    understeer = vehicle.mass_kg / vehicle.wheelbase * (vehicle.cg_to_rear_axle_m / 240e3 - vehicle.cg_to_front_axle_m / 180e3)
    critical = math.sqrt(vehicle.wheelbase / -understeer) / KM_H
    solve_case(changed(PAPER, tyre=tyre, grid={"speed_max_km_h": 0.97 * critical, "speed_points": 5}), "4ws-2")
    message = rf"^grid\.speed_max_km_h: .*unstable from {critical:.1f} .*{0.98 * critical:.0f} km/h"
    with pytest.raises(ConfigError, match=message):
        solve_case(changed(PAPER, tyre=tyre, grid={"speed_max_km_h": 0.99 * critical}), "4ws-2")


@pytest.mark.parametrize("method", ["exact", "ipopt"])
def test_a_map_that_is_infeasible_everywhere_is_refused(method: str) -> None:
    grid = {"speed_min_km_h": 100.0, "speed_points": 2, "front_angle_min_deg": 9.0, "front_angle_points": 2}
    with pytest.raises(MapError, match=r"^\[cases\.fws\]: no operating point of the grid is feasible; .*limits"):
        solve_case(changed(PAPER, grid=grid), "fws", method)
