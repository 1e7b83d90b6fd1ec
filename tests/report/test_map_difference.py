"""Two maps compared in figures: by counting them anew, on equal and on other axes."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.nonlinear_map import nonlinear
from codegen import config as configuration
from codegen.errors import MapError
from codegen.refmap.map import Binding, ReferenceMap, from_arrays
from codegen.refmap.slip_use import slip_use
from codegen.refmap.solve import solve_case
from codegen.report.map_difference import (
    CAR_HEADER,
    DIFFERENCE_HEADER,
    POINT_HEADER,
    interpolated,
    map_difference,
    on_axes_of,
    same_car,
)
from codegen.report.summary import table

CONFIG = configuration.parse(
    {"grid": {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20}, "controller": {"kind": "pi"}},
    "configuration of the test",
)
WIDTH = 80


@pytest.fixture(scope="module")
def linear() -> ReferenceMap:
    return solve_case(CONFIG, "4ws-2")


@pytest.fixture(scope="module")
def ours() -> ReferenceMap:
    return solve_case(nonlinear(CONFIG, "4ws-2"), "4ws-2")


def bare(speed: Any, front_angle_deg: Any, yaw_rate: Any) -> ReferenceMap:
    values = np.asarray(yaw_rate, dtype=np.float64)
    arrays = {"vx": np.asarray(speed), "delta_f": np.radians(front_angle_deg), "yaw_rate": values}
    return from_arrays({**arrays, "feasible": np.isfinite(values)}, "test")


def test_on_equal_axes_the_cells_themselves_are_compared(linear: ReferenceMap, ours: ReferenceMap) -> None:
    found = map_difference(linear, ours)
    gain = np.degrees(linear.yaw_rate - ours.yaw_rate)
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


def test_the_other_way_round_the_signs_turn(linear: ReferenceMap, ours: ReferenceMap) -> None:
    one, two = map_difference(linear, ours), map_difference(ours, linear)
    assert (one.mean_deg_s, one.largest_deg_s, one.rms_deg_s) == (-two.mean_deg_s, -two.largest_deg_s, two.rms_deg_s)
    assert (one.first, one.second, one.only_first) == (two.second, two.first, two.only_second)
    swapped = [replace(point, first_yaw_rate_deg_s=point.second_yaw_rate_deg_s,
                       second_yaw_rate_deg_s=point.first_yaw_rate_deg_s,
                       first_rear_angle_deg=point.second_rear_angle_deg,
                       second_rear_angle_deg=point.first_rear_angle_deg) for point in two.points]  # fmt: skip
    assert list(one.points) == swapped


def test_each_map_for_itself(linear: ReferenceMap, ours: ReferenceMap) -> None:
    found = map_difference(linear, ours)
    for side, one, tyre in ((found.first, linear, "linear"), (found.second, ours, "magic-formula")):
        assert side.tyre_model == tyre
        assert (side.feasible_cells, side.cells) == (one.feasible.sum(), one.feasible.size)
        assert side.lateral_acceleration_max_m_s2 == np.nanmax(one.speed[:, np.newaxis] * one.yaw_rate)
        assert one.active is not None and side.binding_cells is not None
        flags = one.active[one.feasible]
        assert side.binding_cells["front slip"] == (flags & Binding.SLIP_FRONT).astype(bool).sum()
        assert side.binding_cells["none"] == (flags == 0).sum()
        assert side.unreached_cells == 0
    assert found.first.front_slip is not None and found.second.front_slip is not None
    assert found.first.front_slip.largest_percent > 110.0 and found.first.front_slip.cells_above > 20
    assert found.second.front_slip.largest_percent == pytest.approx(100.0, abs=1e-4)
    assert found.second.front_slip.cells_above == 0
    used = slip_use(ours)
    assert used is not None
    i, j = np.argwhere(used.front > 100.0 - 1e-6)[0]  # the first of many that are equal but for rounding
    at = found.second.front_slip.at
    assert (at.speed_km_h / 3.6, math.radians(at.front_angle_deg)) == pytest.approx((ours.speed[i], ours.front_angle[j]))


def test_points_are_those_of_the_tables(linear: ReferenceMap, ours: ReferenceMap) -> None:
    """30, 60 and 100 km/h, 2, 5 and 10 deg are breakpoints; 150 km/h is outside."""
    points = {(point.at.speed_km_h, point.at.front_angle_deg): point for point in map_difference(linear, ours).points}
    assert {speed for speed, _ in points} == {30.0, 60.0, 100.0}
    i, j = int(np.argmin(np.abs(linear.speed * 3.6 - 60.0))), int(np.argmin(np.abs(np.degrees(linear.front_angle) - 2.0)))
    assert linear.rear_angle is not None and ours.rear_angle is not None
    point = points[60.0, 2.0]
    assert point.first_yaw_rate_deg_s == np.degrees(linear.yaw_rate[i, j])
    assert point.second_yaw_rate_deg_s == np.degrees(ours.yaw_rate[i, j])
    assert point.first_rear_angle_deg == np.degrees(linear.rear_angle[i, j])
    assert point.second_rear_angle_deg == np.degrees(ours.rear_angle[i, j])
    assert (60.0, 10.0) not in points  # infeasible in both


def test_on_other_axes_between_breakpoints_that_are_feasible() -> None:
    """A plane, so that linear interpolation is exact; its last corner is infeasible, and so is what lies beside that."""
    speed, angle = np.array([5.0, 20.0, 35.0]), np.array([1.0, 3.0, 5.0])
    plane = 0.01 * speed[:, np.newaxis] + 0.02 * angle
    plane[2, 2] = np.nan
    other = bare(speed, angle, plane)
    mine_speed, mine_angle = np.array([4.0, 10.0, 20.0, 30.0]), np.array([1.0, 2.0, 3.0, 4.0])
    one = bare(mine_speed, mine_angle, 0.01 * mine_speed[:, np.newaxis] + 0.02 * mine_angle + 0.005 * mine_speed[:, np.newaxis])
    found = map_difference(one, other)
    # 4 km/h is outside; at 30 m/s and 4 deg the cell has an infeasible corner.
    assert (found.outside, found.both, found.only_first, found.only_second) == (4, 11, 1, 0)
    assert found.largest_deg_s == pytest.approx(np.degrees(0.005 * 30.0))
    assert found.mean_deg_s == pytest.approx(np.degrees(0.005 * np.mean([10.0] * 4 + [20.0] * 4 + [30.0] * 3)))
    assert np.isnan(on_axes_of(one, other)[3]).tolist() == [False, False, False, True]


def test_where_the_second_alone_is_feasible() -> None:
    speed, angle = [10.0, 20.0], [1.0, 2.0]
    one = bare(speed, angle, [[0.1, 0.2], [0.2, np.nan]])
    other = bare(speed, angle, [[0.1, 0.2], [np.nan, 0.3]])
    found = map_difference(one, other)
    assert (found.both, found.only_first, found.only_second) == (2, 1, 1)
    assert (found.largest_deg_s, found.mean_deg_s, found.rms_deg_s) == (0.0, 0.0, 0.0)


def test_on_a_breakpoint_its_neighbours_have_no_say(linear: ReferenceMap) -> None:
    again = interpolated(linear, linear.yaw_rate, linear.speed * (1.0 + 1e-14), linear.front_angle)
    np.testing.assert_array_equal(np.isfinite(again), linear.feasible)
    np.testing.assert_array_equal(again[linear.feasible], linear.yaw_rate[linear.feasible])


def test_nothing_in_common_is_said_in_one_line(linear: ReferenceMap) -> None:
    far = bare([100.0, 140.0], [1.0, 2.0], [[0.01, 0.02], [0.01, 0.02]])
    with pytest.raises(MapError, match=r"no operating point in common: 20 to 120 km/h and 0\.5 to 10 deg beside 360 to 504"):
        map_difference(linear, far)
    one = bare([10.0, 20.0], [1.0, 2.0], [[0.1, np.nan], [0.1, np.nan]])
    other = bare([10.0, 20.0], [1.0, 2.0], [[np.nan, 0.1], [np.nan, 0.1]])
    with pytest.raises(MapError, match="no operating point is feasible in both"):
        map_difference(one, other)


def test_json_has_no_nan_and_says_what_is_not_known(linear: ReferenceMap) -> None:
    one = bare(linear.speed, np.degrees(linear.front_angle), linear.yaw_rate)
    told = json.loads(json.dumps(map_difference(one, linear).to_dict(), allow_nan=False))
    for key in ("tyre_model", "binding_cells", "front_slip", "rear_slip", "unreached_cells"):
        assert told["first"][key] is None
        assert told["second"][key] is not None
    assert {point["first_rear_angle_deg"] for point in told["points"]} == {None}
    assert told["largest_deg_s"] == 0.0


def test_tables_fit_a_terminal(linear: ReferenceMap, ours: ReferenceMap) -> None:
    """At its widest: places with the most digits, every row, every count of five digits."""
    found = map_difference(linear, ours)
    assert found.first.front_slip is not None
    slip = replace(found.first.front_slip, at=replace(found.largest_at, speed_km_h=119.97, front_angle_deg=33.333))
    names = ["none", "sideslip", "lateral acceleration", "front slip", "rear slip", "rear angle"]
    counts = dict.fromkeys(names, 99_999)
    side = replace(found.first, front_slip=slip, rear_slip=slip, binding_cells=counts, unreached_cells=99_999)
    wide = replace(found, first=side, second=side, outside=10_000, largest_at=slip.at, largest_deg_s=-12.345)
    assert len(wide.rows) == 19
    tables = ((CAR_HEADER, wide.rows), (DIFFERENCE_HEADER, [wide.difference_row]), (POINT_HEADER, wide.point_rows))
    lines = [line for header, rows in tables for line in table(header, rows).splitlines()]
    assert max(len(line) for line in lines) <= WIDTH
    assert all("nan" not in line for line in lines)


def test_rows_tell_unknown_and_unneeded_ones() -> None:
    one = bare([10.0, 20.0], [1.0, 2.0], [[0.1, 0.2], [0.2, 0.3]])
    rows = {row[0]: row[1:] for row in map_difference(one, one).rows}
    assert rows == {
        "tyre of the optimisation": ("-", "-"),
        "feasible cells": ("4 of 4", "4 of 4"),
        "feasible in both": ("4", "4"),
        "feasible in this map alone": ("0", "0"),
        "lateral acceleration up to [m/s^2]": ("6", "6"),
    }


def test_cars_are_told_apart(linear: ReferenceMap, ours: ReferenceMap) -> None:
    assert same_car(linear, ours) is True
    assert linear.config is not None
    heavier = linear.config.vehicle.model_copy(update={"mass_kg": 2000.0})
    other = replace(linear, config=linear.config.model_copy(update={"vehicle": heavier}))
    assert same_car(linear, other) is False
    assert same_car(linear, replace(linear, config=None, case=None, meta={})) is None
