"""Charts of maps hold the numbers of the map, in the place where they belong."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.config import KM_H, preset
from codegen.refmap import map as npz
from codegen.refmap.map import from_arrays
from codegen.report.html import maps
from codegen.report.html.blocks import Table, Text
from codegen.report.html.charts import cell_edges, numbers
from codegen.report.html.compare import comparison, difference_in_figures
from codegen.report.html.ecu_table import extended
from codegen.report.html.maps import NamedMap
from codegen.report.html.report import to_compare
from codegen.report.map_difference import map_difference, on_axes_of

GENERATED = Path(__file__).resolve().parents[3] / "generated"
SPEED, ANGLE = np.array([10.0, 20.0, 30.0]), np.radians([1.0, 2.0])
RATES = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])
FEASIBLE = np.array([[True, True], [True, True], [True, False]])


def unpacked(packed: Any) -> np.ndarray:
    values = np.frombuffer(base64.b64decode(packed["bdata"]), dtype={"f4": "<f4", "u1": "u1"}[packed["dtype"]])
    return values.reshape([int(size) for size in packed["shape"].split(",")]) if "shape" in packed else values


def bare() -> NamedMap:
    """Another number in each cell, one of them infeasible."""
    arrays = {"vx": SPEED, "delta_f": ANGLE, "yaw_rate": np.where(FEASIBLE, RATES, np.nan), "feasible": FEASIBLE}
    return NamedMap("bare", from_arrays(arrays, "test"))


def test_a_heat_map_has_rows_of_front_angles_and_columns_of_speeds() -> None:
    (chart,) = maps.heat_maps(bare()).charts
    trace = chart.figure["data"][0]
    # Single precision.
    np.testing.assert_allclose(unpacked(trace["x"]), SPEED / KM_H, rtol=1e-6)
    np.testing.assert_allclose(unpacked(trace["y"]), [1.0, 2.0], rtol=1e-6)
    np.testing.assert_allclose(unpacked(trace["z"]), np.degrees(np.where(FEASIBLE, RATES, np.nan)).T, rtol=1e-6)


def test_a_bare_map_shows_what_it_has() -> None:
    assert [chart.name for chart in maps.surfaces([bare()]).charts] == ["surface-yaw-rate"]
    data = maps.cuts([bare()]).data["maps"][0]
    assert (list(data["tables"]), data["binding"]) == (["yaw_rate"], None)
    assert to_compare(bare().map) is None


def test_a_solved_map_shows_everything() -> None:
    one = NamedMap("4ws2", npz.load(GENERATED / "4ws2.npz"))
    names = [chart.name for chart in (*maps.heat_maps(one).charts, *maps.surfaces([one]).charts)]
    tables = ("yaw-rate", "sideslip", "rear-angle")
    assert names == [*(f"map-{name}" for name in tables), "map-binding", *(f"surface-{name}" for name in tables)]
    assert any(trace.get("name") == "δr = 0" for trace in maps.heat_maps(one).charts[0].figure["data"])


def test_two_maps_are_compared_on_the_axes_of_the_first() -> None:
    """The second is linear in both axes, so that linear interpolation is exact, but for single precision."""
    speed, angle = np.array([5.0, 40.0]), np.radians([0.5, 3.0])
    plane = 0.01 * speed[:, np.newaxis] + angle[np.newaxis, :]
    other = NamedMap("plane", from_arrays({"vx": speed, "delta_f": angle, "yaw_rate": plane}, "test"))
    charts = {chart.name: chart for chart in comparison(bare(), other).charts}
    expected = np.degrees(np.where(FEASIBLE, RATES, np.nan) - (0.01 * SPEED[:, np.newaxis] + ANGLE))
    difference = unpacked(charts["compare-difference-1"].figure["data"][0]["z"])
    np.testing.assert_allclose(difference, expected.T, rtol=1e-5, atol=1e-5)


def test_a_map_on_its_own_axes_is_itself() -> None:
    """Up to its edge: there an infeasible neighbour has no say."""
    one = npz.load(GENERATED / "4ws2.npz")
    table = on_axes_of(one, one)
    np.testing.assert_array_equal(np.isfinite(table), one.feasible)
    np.testing.assert_array_equal(table[one.feasible], one.yaw_rate[one.feasible])


def test_the_figures_of_a_comparison_are_those_of_the_command() -> None:
    one = NamedMap("4ws2", npz.load(GENERATED / "4ws2.npz"))
    other = to_compare(one.map)
    assert other is not None
    found = map_difference(one.map, other.map)
    tables = [block for block in difference_in_figures(one, other) if isinstance(block, Table)]
    assert [table.rows for table in tables] == [found.rows, [found.difference_row], found.point_rows]
    assert all(len(row) == len(table.header) for table in tables for row in table.rows)


def test_maps_without_a_point_in_common_are_told_so() -> None:
    far = NamedMap("far", from_arrays({"vx": SPEED + 50.0, "delta_f": ANGLE, "yaw_rate": 0.1 * RATES}, "test"))
    (told,) = difference_in_figures(bare(), far)
    assert isinstance(told, Text)
    assert told.text.startswith("Not compared in figures: no operating point in common")


def test_the_map_without_rear_steering_is_the_one_to_compare_with() -> None:
    one = npz.load(GENERATED / "4ws2.npz")
    other = to_compare(one)
    assert other is not None
    assert (other.name, other.map.case) == ("FWS", "fws")
    assert other.map.rear_angle is not None
    assert not other.map.rear_angle[other.map.feasible].any()
    assert to_compare(other.map) is None


def test_cells_of_the_ecu_are_counted_as_in_the_manifest() -> None:
    one = NamedMap("4ws2", npz.load(GENERATED / "4ws2.npz"))
    chart, table = extended(one, preset())
    manifest = json.loads((GENERATED / "4ws2" / "manifest.json").read_text(encoding="utf-8"))
    rules = manifest["map"]["rules"].values()
    assert {row[1].partition(", from there")[0]: int(row[2].replace(",", "")) for row in table.rows} == {
        rule["text"]: rule["cells"] for rule in rules
    }
    codes = unpacked(chart.figure["data"][0]["codes"])
    assert codes.shape == (len(manifest["map"]["front_angle_rad"]), len(manifest["map"]["speed_m_s"]))
    assert chart.figure["data"][0]["codes"]["names"][codes[0, 0]] == "linear, from zero"


def test_a_cell_beside_a_wide_gap_keeps_the_width_of_its_neighbour() -> None:
    np.testing.assert_allclose(cell_edges([0.0, 20.0, 21.0, 22.0, 50.0]), [0.0, 19.5, 20.5, 21.5, 22.5, 50.0])
    np.testing.assert_allclose(cell_edges([0.0, 1.0, 3.0]), [0.0, 0.5, 2.0, 3.0])


@pytest.mark.parametrize("values", [np.array([1.0, np.nan]), np.array([[1.0, 2.0], [3.0, np.nan]])])
def test_arrays_come_back(values: np.ndarray) -> None:
    np.testing.assert_array_equal(unpacked(numbers(values)), values.astype(np.float32))
