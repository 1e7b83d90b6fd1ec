"""A case without the operating points that the car could not reach without its rear steering."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from codegen.config import Config
from codegen.errors import MapError
from codegen.refmap import exact
from codegen.refmap import map as npz
from codegen.refmap.extend import Rule, extend
from codegen.refmap.lookup import Lookup
from codegen.refmap.problem import SteadyTurnProblem
from codegen.refmap.solve import solve_case
from tests.refmap.cars import PAPER, changed, paper_map


def with_safe_cases(**tables: Mapping[str, Any]) -> Config:
    """The paper's car with passively safe cases beside the usual ones, and other tables replaced in part."""
    safe = {f"safe-{name}": {**case.model_dump(mode="json"), "passive_safe": True} for name, case in PAPER.cases.items()}
    return changed(PAPER, cases=safe, **tables)


CONFIG = with_safe_cases()


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_the_feasible_cells_are_those_of_the_passive_car(case: str) -> None:
    """Rear steering takes no cell away, so these are all cells of the FWS map; and there the optimum is unchanged."""
    left, whole = solve_case(CONFIG, f"safe-{case}"), paper_map(case)
    np.testing.assert_array_equal(left.feasible, paper_map("fws").feasible)
    for name in ("yaw_rate", "sideslip", "rear_angle", "active"):
        values = getattr(left, name)
        np.testing.assert_array_equal(values[left.feasible], getattr(whole, name)[left.feasible])
        assert not np.any(np.nan_to_num(values[~left.feasible]))
    again = npz.from_bytes(npz.to_bytes(left), "test")
    assert again.config is not None and again.config.case(f"safe-{case}").passive_safe
    np.testing.assert_array_equal(again.yaw_rate, left.yaw_rate)


def test_the_option_is_named_only_where_it_leaves_nothing() -> None:
    """At 9.5 deg and more the rear wheels must help at any speed of the grid; at 119 km/h and 9 deg nothing is feasible."""
    with pytest.raises(MapError) as caught:
        solve_case(with_safe_cases(grid={"front_angle_min_deg": 9.5}), "safe-4ws-2")
    assert caught.value.where == "[cases.safe-4ws-2].passive_safe"
    assert "without rear steering" in caught.value.what and "false" in caught.value.remedy and "\n" not in str(caught.value)
    with pytest.raises(MapError, match=r"^\[cases\.safe-4ws-2\]: no operating point of the grid is feasible;"):
        solve_case(with_safe_cases(grid={"speed_min_km_h": 119.0, "front_angle_min_deg": 9.0}), "safe-4ws-2")


@pytest.mark.parametrize("case", ["safe-4ws-1", "safe-4ws-2"])
def test_beyond_its_edge_the_passive_slope_from_where_the_passive_car_ends(case: str) -> None:
    """From the edge on the continuous problem: from the last cell below it, the reference would step from speed to speed.

    Also where grip ends the passive car: the optimum there is mostly below what grip allows, and must not jump up to that.
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
    found = Lookup.from_map(total, np.float64)(np.linspace(0.1, 60.0, 400)[:, np.newaxis], np.linspace(0.0, 0.6, 701))
    assert np.isfinite(found).all() and not found[:, 0].any()
    assert np.diff(found, axis=1).min() >= -1e-12  # rad/s, rounding
