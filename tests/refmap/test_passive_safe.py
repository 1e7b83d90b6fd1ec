"""A case that leaves out what the car could not do without its rear steering."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from codegen.config import Config, parse
from codegen.errors import MapError
from codegen.refmap import exact
from codegen.refmap import map as npz
from codegen.refmap.extend import Rule, extend
from codegen.refmap.lookup import Lookup
from codegen.refmap.loss import loss_of_function
from codegen.refmap.map import ReferenceMap
from codegen.refmap.problem import SteadyTurnProblem
from codegen.refmap.solve import solve_case

STOP = math.radians(35.0)
WEIGHTS = {"4ws-1": 100.0, "4ws-2": 3000.0}


def with_safe_cases(paper: Config, **tables: Mapping[str, Any]) -> Config:
    """The paper's car with the cases "safe-4ws-1" and "safe-4ws-2", and other tables replaced in part."""
    data = paper.model_dump(mode="json")
    for case, weight in WEIGHTS.items():
        data["cases"][f"safe-{case}"] = {"sideslip_weight_per_s2": weight, "passive_safe": True}
    for name, changes in tables.items():
        data[name] |= changes
    return parse(data, "test")


@pytest.fixture(scope="module")
def safe_config(paper: Config) -> Config:
    return with_safe_cases(paper)


@pytest.fixture(scope="module")
def safe(safe_config: Config) -> ReferenceMap:
    """The paper's 4WS-2, passive-safe."""
    return solve_case(safe_config, "safe-4ws-2")


@pytest.mark.parametrize("case", WEIGHTS)
def test_what_is_left_is_what_the_passive_car_can_do(safe_config: Config, maps: Mapping[str, ReferenceMap], case: str) -> None:
    """Rear steer takes nothing away, so these are all cells of the FWS map; and there the optimum is still the optimum."""
    left, all_of_it = solve_case(safe_config, f"safe-{case}"), maps[case]
    np.testing.assert_array_equal(left.feasible, maps["fws"].feasible)
    assert left.feasible.sum() < all_of_it.feasible.sum()
    for name in ("yaw_rate", "sideslip", "rear_angle"):
        values = getattr(left, name)
        np.testing.assert_array_equal(values[left.feasible], getattr(all_of_it, name)[left.feasible])
        assert np.isnan(values[~left.feasible]).all()
    assert left.active is not None and all_of_it.active is not None
    np.testing.assert_array_equal(left.active[left.feasible], all_of_it.active[left.feasible])
    assert not left.active[~left.feasible].any()


def test_no_cell_needs_the_rear_steering(safe_config: Config, safe: ReferenceMap) -> None:
    lost = loss_of_function(safe, safe_config)
    assert lost.only_with_rear_steer is not None and not lost.only_with_rear_steer.any()
    assert lost.share_of_feasible == lost.share_of_grid == 0.0
    assert lost.passively_feasible is not None and lost.passively_feasible.all()


def test_the_car_stays_within_the_sideslip_bound_when_it_loses_the_function(
    safe_config: Config, safe: ReferenceMap, maps: Mapping[str, ReferenceMap]
) -> None:
    """What the option is for. The bound is that of the steady turn; the plant's tyres, not linear, stay inside it too."""
    lost = loss_of_function(safe, safe_config)
    assert lost.settles.all() and not lost.spins.any()
    assert lost.sideslip_max.max() <= safe_config.limits.sideslip_max
    assert loss_of_function(maps["4ws-2"], safe_config).sideslip_max.max() > safe_config.limits.sideslip_max


@pytest.mark.parametrize("passive_safe", [False, True])
def test_a_case_without_rear_steering_loses_nothing(
    paper: Config, maps: Mapping[str, ReferenceMap], passive_safe: bool
) -> None:
    data = paper.model_dump(mode="json")
    data["cases"]["fws"]["passive_safe"] = passive_safe
    np.testing.assert_array_equal(solve_case(parse(data, "test"), "fws").yaw_rate, maps["fws"].yaw_rate)


def test_both_methods_leave_out_the_same(paper: Config) -> None:
    """On a grid that the edges of both the passive and the steered car cross. Tolerance: that of IPOPT's optimum."""
    speeds, angles = [25.0, 45.0, 70.0, 110.0], [0.5, 1.2, 3.0, 5.0, 7.0]
    config = with_safe_cases(paper, grid={"speed_breakpoints_km_h": speeds, "front_angle_breakpoints_deg": angles})
    found, reference = (solve_case(config, "safe-4ws-2", method) for method in ("exact", "ipopt"))
    steered = solve_case(config, "4ws-2").feasible
    assert 0 < found.feasible.sum() < steered.sum() < steered.size
    np.testing.assert_array_equal(found.feasible, reference.feasible)
    assert found.rear_angle is not None and reference.rear_angle is not None
    np.testing.assert_allclose(found.rear_angle, reference.rear_angle, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found.yaw_rate, reference.yaw_rate, rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal(found.active, reference.active)


def test_nothing_left_is_refused_in_one_line(paper: Config) -> None:
    """At 9.5 deg and more the rear wheels must help at any speed of the grid."""
    config = with_safe_cases(paper, grid={"front_angle_min_deg": 9.5})
    assert solve_case(config, "4ws-2").feasible.any()
    with pytest.raises(MapError) as caught:
        solve_case(config, "safe-4ws-2")
    assert caught.value.where == "[cases.safe-4ws-2].passive_safe"
    assert "without rear steering" in caught.value.what and "false" in caught.value.remedy
    assert "\n" not in str(caught.value)


def test_nothing_feasible_at_all_is_not_blamed_on_the_option(paper: Config) -> None:
    config = with_safe_cases(paper, grid={"speed_min_km_h": 119.0, "front_angle_min_deg": 9.0})
    with pytest.raises(MapError, match="no operating point of the grid is feasible;") as caught:
        solve_case(config, "safe-4ws-2")
    assert caught.value.where == "[cases.safe-4ws-2]"


def test_it_goes_through_a_file(safe: ReferenceMap) -> None:
    again = npz.from_bytes(npz.to_bytes(safe), "test")
    assert again.config is not None and again.case is not None and again.config.case(again.case).passive_safe
    np.testing.assert_array_equal(again.feasible, safe.feasible)
    np.testing.assert_array_equal(again.yaw_rate, safe.yaw_rate)


# --- its extension ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", WEIGHTS)
def test_it_extends_to_a_total_map(safe_config: Config, case: str) -> None:
    """Its own cells as solved; everywhere finite, rising with the front angle, zero straight ahead, never above the cap."""
    reference_map = solve_case(safe_config, f"safe-{case}")
    total = extend(reference_map, safe_config)
    inside = np.zeros(total.rule.shape, dtype=bool)
    inside[1:, 1:-1] = reference_map.feasible
    np.testing.assert_array_equal(total.rule == Rule.SOLVED.value, inside)
    assert np.isfinite(total.yaw_rate).all()
    lookup = Lookup.from_map(total, np.float64)
    speed, angle = np.linspace(0.1, 60.0, 400), np.linspace(0.0, STOP, 701)
    asked = lookup(speed[:, np.newaxis], angle)
    assert not asked[:, 0].any()
    assert np.diff(asked, axis=1).min() >= -1e-12  # rad/s, rounding
    assert np.all(asked * speed[:, np.newaxis] <= total.lateral_acceleration_cap)


@pytest.mark.parametrize("case", WEIGHTS)
def test_beyond_its_edge_the_passive_slope_from_where_the_passive_car_ends(safe_config: Config, case: str) -> None:
    """From the edge on the continuous problem: from the last cell below it, the reference would step from speed to speed.

    Also where grip ends the passive car: the optimum there is mostly below what grip allows, and must not jump up to that.
    """
    reference_map = solve_case(safe_config, f"safe-{case}")
    total = extend(reference_map, safe_config)
    problem = SteadyTurnProblem.from_config(safe_config, safe_config.case(f"safe-{case}"))
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
