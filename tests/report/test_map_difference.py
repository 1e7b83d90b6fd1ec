"""Differences of two maps in figures, counted independently, on equal and on different axes; and the summary of a stack."""

import json
import math
from typing import Any

import numpy as np
import pytest

from benchmarks.nonlinear_map import nonlinear
from codegen.errors import MapError
from codegen.map_file.bounds import Binding
from codegen.map_file.map import ReferenceMap, from_arrays
from codegen.optimum.solve import solve_case
from codegen.report.map_difference import interpolated, map_difference, on_axes_of
from tests import shared
from tests.report.test_plots import CONFIG


@pytest.fixture(scope="module")
def linear() -> ReferenceMap:
    return solve_case(CONFIG, "4ws-2")


@pytest.fixture(scope="module")
def ours() -> ReferenceMap:
    return shared.once("report: nonlinear map", lambda: solve_case(nonlinear(CONFIG, "4ws-2"), "4ws-2"))


def bare(speed: Any, front_angle_deg: Any, yaw_rate: Any) -> ReferenceMap:
    values = np.asarray(yaw_rate, dtype=np.float64)
    arrays = {"vx": np.asarray(speed), "delta_f": np.radians(front_angle_deg), "yaw_rate": values}
    return from_arrays({**arrays, "feasible": np.isfinite(values)}, "test")


def test_on_equal_axes_the_cells_are_compared(linear: ReferenceMap, ours: ReferenceMap) -> None:
    found, gain = map_difference(linear, ours), np.degrees(linear.yaw_rate - ours.yaw_rate)
    both = linear.feasible & ours.feasible
    assert (found.both, found.outside) == (both.sum(), 0)
    assert (found.only_first, found.only_second) == ((linear.feasible & ~both).sum(), (ours.feasible & ~both).sum())
    assert found.only_first > 0
    assert found.mean_deg_s == pytest.approx(gain[both].mean(), rel=1e-12)
    assert found.rms_deg_s == pytest.approx(math.sqrt((gain[both] ** 2).mean()), rel=1e-12)
    i, j = np.unravel_index(np.nanargmax(np.abs(gain)), gain.shape)
    assert found.largest_deg_s == gain[i, j]
    at = (found.largest_at.speed_km_h / 3.6, math.radians(found.largest_at.front_angle_deg))
    assert at == pytest.approx((linear.speed[i], linear.front_angle[j]))
    other = map_difference(ours, linear)
    assert (other.mean_deg_s, other.largest_deg_s, other.rms_deg_s) == (-found.mean_deg_s, -gain[i, j], found.rms_deg_s)
    assert (other.first, other.second, other.only_second) == (found.second, found.first, found.only_first)


def test_the_figures_of_each_map(linear: ReferenceMap, ours: ReferenceMap) -> None:
    found = map_difference(linear, ours)
    for side, one, tyre in ((found.first, linear, "linear"), (found.second, ours, "magic-formula")):
        assert (side.tyre_model, side.feasible_cells, side.cells) == (tyre, one.feasible.sum(), one.feasible.size)
        assert side.lateral_acceleration_max_m_s2 == np.nanmax(one.speed[:, np.newaxis] * one.yaw_rate)
        assert one.active is not None and side.binding_cells is not None
        flags = one.active[one.feasible]
        assert side.binding_cells["front grip"] == (flags & Binding.SLIP_FRONT).astype(bool).sum()
        assert (side.binding_cells["none"], side.unreached_cells) == ((flags == 0).sum(), 0)
    first, second = found.first.front_slip, found.second.front_slip
    assert first is not None and second is not None
    assert first.largest_percent > 110.0 and first.cells_above > 20
    assert (second.largest_percent, second.cells_above) == (pytest.approx(100.0, abs=1e-4), 0)


def test_between_breakpoints_the_second_is_interpolated_where_all_corners_are_feasible(linear: ReferenceMap) -> None:
    """The second map is a plane, so that linear interpolation is exact; its last corner is infeasible."""
    speed, angle = np.array([5.0, 20.0, 35.0]), np.array([1.0, 3.0, 5.0])
    plane = 0.01 * speed[:, np.newaxis] + 0.02 * angle
    plane[2, 2] = np.nan
    other = bare(speed, angle, plane)
    mine_speed, mine_angle = np.array([4.0, 10.0, 20.0, 30.0]), np.array([1.0, 2.0, 3.0, 4.0])
    one = bare(mine_speed, mine_angle, 0.015 * mine_speed[:, np.newaxis] + 0.02 * mine_angle)
    found = map_difference(one, other)
    # 4 km/h is outside; at 30 m/s and 4 deg the cell has an infeasible corner.
    assert (found.outside, found.both, found.only_first, found.only_second) == (4, 11, 1, 0)
    assert found.largest_deg_s == pytest.approx(np.degrees(0.005 * 30.0))
    assert found.mean_deg_s == pytest.approx(np.degrees(0.005 * np.mean([10.0] * 4 + [20.0] * 4 + [30.0] * 3)))
    assert np.isnan(on_axes_of(one, other)[3]).tolist() == [False, False, False, True]
    other = bare([10.0, 20.0], [1.0, 2.0], [[0.1, 0.2], [np.nan, 0.3]])
    found = map_difference(bare([10.0, 20.0], [1.0, 2.0], [[0.1, 0.2], [0.2, np.nan]]), other)
    assert (found.both, found.only_first, found.only_second) == (2, 1, 1)
    # On a breakpoint, up to rounding, the neighbours have no influence.
    again = interpolated(linear, linear.yaw_rate, linear.speed * (1.0 + 1e-14), linear.front_angle)
    np.testing.assert_array_equal(again, np.where(linear.feasible, linear.yaw_rate, np.nan))


def test_maps_without_a_common_point_are_rejected(linear: ReferenceMap) -> None:
    far = bare([100.0, 140.0], [1.0, 2.0], [[0.01, 0.02], [0.01, 0.02]])
    with pytest.raises(MapError, match=r"no operating point in common: 20 to 120 km/h and 0\.5 to 10 deg beside 360 to 504"):
        map_difference(linear, far)
    one = bare([10.0, 20.0], [1.0, 2.0], [[0.1, np.nan], [0.1, np.nan]])
    other = bare([10.0, 20.0], [1.0, 2.0], [[np.nan, 0.1], [np.nan, 0.1]])
    with pytest.raises(MapError, match="no operating point is feasible in both"):
        map_difference(one, other)


def test_unknown_figures_of_a_bare_map_are_omitted(linear: ReferenceMap) -> None:
    one = bare(linear.speed, np.degrees(linear.front_angle), linear.yaw_rate)
    found = map_difference(one, linear)
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    for key in ("tyre_model", "binding_cells", "front_slip", "rear_slip", "unreached_cells"):
        assert data["first"][key] is None and data["second"][key] is not None
    assert {point["first_rear_angle_deg"] for point in data["points"]} == {None}
    assert next(found.rows()) == ("tyre of the optimisation", "-", "linear")
