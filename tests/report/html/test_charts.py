"""The charts of a report hold the numbers of maps, runs, tyres, losses and budgets."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from codegen.config import KM_H, preset
from codegen.emit.folder import read_manifest
from codegen.refmap import exact
from codegen.refmap import map as npz
from codegen.refmap.loss import loss_of_function
from codegen.refmap.loss_simulation import MODES
from codegen.refmap.map import from_arrays
from codegen.refmap.place_sweep import FlashPoint, FlashTable
from codegen.refmap.problem import SteadyTurnProblem
from codegen.refmap.total import Rule
from codegen.report.flash import flash_dict, flash_figure, flash_rows
from codegen.report.html import maps
from codegen.report.html.blocks import Chart, Table
from codegen.report.html.build import verification_blocks
from codegen.report.html.charts import cell_edges, numbers
from codegen.report.html.compare import comparison, difference_in_figures
from codegen.report.html.curves import front_angle_chart
from codegen.report.html.ecu_table import extended
from codegen.report.html.loop import margins_chart
from codegen.report.html.loss import loss_blocks
from codegen.report.html.maps import NamedMap
from codegen.report.html.report import to_compare
from codegen.report.html.runs import PANELS, is_passive, run_chart
from codegen.report.map_difference import map_difference
from codegen.report.published import PAPER_TABLE
from codegen.sil.software import RECORD_COLUMNS
from codegen.vehicle.tyre import AxleTyres
from tests.report.figures import unpacked

GENERATED = Path(__file__).resolve().parents[3] / "generated"
SPEED, ANGLE = np.array([10.0, 20.0, 30.0]), np.radians([1.0, 2.0])
RATES = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])
FEASIBLE = np.array([[True, True], [True, True], [True, False]])


@pytest.fixture(scope="module")
def solved() -> NamedMap:
    return NamedMap("4ws2", npz.load(GENERATED / "4ws2.npz"))


@pytest.fixture(scope="module")
def bare() -> NamedMap:
    """Return a map with another number in each cell, one of them infeasible."""
    arrays = {"vx": SPEED, "delta_f": ANGLE, "yaw_rate": np.where(FEASIBLE, RATES, np.nan), "feasible": FEASIBLE}
    return NamedMap("bare", from_arrays(arrays, "test"))


def test_a_bare_map_is_drawn_with_speed_to_the_right(bare: NamedMap) -> None:
    (chart,) = maps.heat_maps(bare).charts
    trace = chart.figure["data"][0]
    expected = {"x": SPEED / KM_H, "y": [1.0, 2.0], "z": np.degrees(np.where(FEASIBLE, RATES, np.nan)).T}
    for key, values in expected.items():
        np.testing.assert_allclose(unpacked(trace[key]), values, rtol=1e-6)  # single precision
    assert [chart.name for chart in maps.surfaces([bare]).charts] == ["surface-yaw-rate"]
    data = maps.cuts([bare]).data["maps"][0]
    assert (list(data["tables"]), data["binding"]) == (["yaw_rate"], None)
    assert to_compare(bare.map) is None
    for values in (np.array([1.0, np.nan]), np.array([[1.0, 2.0], [3.0, np.nan]])):
        np.testing.assert_array_equal(unpacked(numbers(values)), values.astype(np.float32))
    # A cell beside a wide gap keeps the width of its neighbour.
    np.testing.assert_allclose(cell_edges([0.0, 20.0, 21.0, 22.0, 50.0]), [0.0, 19.5, 20.5, 21.5, 22.5, 50.0])


def test_maps_are_compared_on_the_axes_of_the_first(bare: NamedMap) -> None:
    """The second is linear in both axes, so that linear interpolation is exact, but for single precision."""
    speed, angle = np.array([5.0, 40.0]), np.radians([0.5, 3.0])
    plane = 0.01 * speed[:, np.newaxis] + angle[np.newaxis, :]
    other = NamedMap("plane", from_arrays({"vx": speed, "delta_f": angle, "yaw_rate": plane}, "test"))
    charts = {chart.name: chart for chart in comparison(bare, other).charts}
    expected = np.degrees(np.where(FEASIBLE, RATES, np.nan) - (0.01 * SPEED[:, np.newaxis] + ANGLE))
    difference = unpacked(charts["compare-difference-1"].figure["data"][0]["z"])
    np.testing.assert_allclose(difference, expected.T, rtol=1e-5, atol=1e-5)
    far = NamedMap("far", from_arrays({"vx": SPEED + 50.0, "delta_f": ANGLE, "yaw_rate": 0.1 * RATES}, "test"))
    (text,) = difference_in_figures(bare, far)
    assert text.text.startswith("Not compared in figures: no operating point in common")


def test_a_map_is_compared_with_the_one_without_rear_steering(solved: NamedMap) -> None:
    other = to_compare(solved.map)
    assert (other.name, other.map.case) == ("FWS", "fws")
    assert not other.map.rear_angle[other.map.feasible].any()
    assert to_compare(other.map) is None
    found = map_difference(solved.map, other.map)
    tables = [block for block in difference_in_figures(solved, other) if isinstance(block, Table)]
    assert [table.rows for table in tables] == [found.rows, [found.difference_row], found.point_rows]


def test_cells_of_the_ecu_are_counted_as_in_the_manifest(solved: NamedMap, tmp_path: Path) -> None:
    chart, table = extended(solved, preset())
    manifest = read_manifest(GENERATED / "4ws2")
    counts = {row[1].partition(", from there")[0]: int(row[2].replace(",", "")) for row in table.rows}
    assert counts == {rule["text"]: rule["cells"] for rule in manifest["map"]["rules"].values()}
    codes = chart.figure["data"][0]["codes"]
    assert unpacked(codes).shape == (len(manifest["map"]["front_angle_rad"]), len(manifest["map"]["speed_m_s"]))
    assert codes["names"][unpacked(codes)[0, 0]] == "linear, from zero"
    # A build with chosen breakpoints has cells of its own.
    cells = [Rule.ZERO + Rule.SOLVED, Rule.SOLVED + Rule.SOLVED, Rule.SOLVED + Rule.CONTINUED]
    axes = {"speed_m_s": [5.0, 10.0, 20.0], "front_angle_rad": [0.0, 0.1], "rule_by_speed_and_front_angle": cells}
    placed = {**manifest, "map": {**manifest["map"], **axes, "placement": {}}}
    (tmp_path / "manifest.json").write_text(json.dumps(placed), encoding="utf-8")
    chart, table = extended(solved, preset(), tmp_path)
    found = {row[0]: row[2] for row in table.rows}
    assert found == {"as in the map": "4", "linear, from zero": "1", "beyond the cap, continued": "1"}
    codes = chart.figure["data"][0]["codes"]
    names = [[codes["names"][code] for code in row] for row in unpacked(codes)]
    assert (names[0][0], names[1][2]) == ("linear, from zero", "beyond the cap, continued")


def test_error_against_flash_agrees_in_figure_table_and_json() -> None:
    """The points are made by hand: their search takes seconds. No table with even axes holds the smaller bound."""

    def placed(size: int, error: float) -> Any:
        total = SimpleNamespace(speed=np.zeros(size // 100), front_angle=np.zeros(7))
        errors = SimpleNamespace(yaw_rate=error, yaw_rate_whole=error)
        return SimpleNamespace(flash_bytes=size, bounded_error=error, total=total, error=errors, spacing="uneven", tables=1)

    sizes = {1.0: {"even": 2_000, "uneven": 1_200, "int16": 700}, 0.5: {"even": None, "uneven": 1_800, "int16": 900}}
    points = tuple(
        FlashPoint(way, math.radians(bound), size and placed(size, 0.9 * math.radians(bound)))
        for bound, ways in sizes.items()
        for way, size in ways.items()
    )
    grid_error: Any = SimpleNamespace(yaw_rate_whole=math.radians(0.3), bounded=lambda tables: math.radians(0.3))
    found = FlashTable(points, 1, "optimum", (20, 30), 4_000, grid_error)
    (axes,) = flash_figure(found, "name").axes
    drawn = {str(line.get_label()): np.column_stack(line.get_data()).tolist() for line in axes.get_lines()}
    assert drawn["even axes, float"] == [[2000.0, pytest.approx(0.9)]]
    assert drawn["uneven axes, float"] == [[1200.0, pytest.approx(0.9)], [1800.0, pytest.approx(0.45)]]
    assert drawn["the map's own grid, float"] == [[4000.0, pytest.approx(0.3)]]
    assert flash_rows(found) == [
        ("1", "2,000", "1,200", "700", "50.0", "30.0", "17.5", "12 x 7"),
        ("0.5", "-", "1,800", "900", "-", "45.0", "22.5", "18 x 7"),
    ]
    data = flash_dict(found)
    assert [point["flash_bytes"] for point in data["placed"]] == [2_000, 1_200, 700, None, 1_800, 900]
    assert data["grid"] == {"breakpoints": [20, 30], "flash_bytes": 4_000, "error_rad_s": math.radians(0.3)}


def record(scale: float = 1.0) -> np.ndarray:
    """Return a run in which each column is a line of its own slope. With scale 8 the speed is not held."""
    time = 0.01 * np.arange(400)
    made = np.stack([scale * (k + 1) * time / 40.0 for k in range(len(RECORD_COLUMNS))], axis=1)
    made[:, 0], made[:, -1] = time, 0.0
    return made


def test_each_panel_shows_its_columns() -> None:
    chart = run_chart({"mine": record(8.0)}, preset(), "title")
    layout = chart.figure["layout"]
    drawn = {(each["name"], each.get("yaxis", "y")): unpacked(each["y"]) for each in chart.figure["data"]}
    words = {"yaw_rate_reference_rad_s": "mine, reference", "rear_angle_command_rad": "mine, command"}
    for row, panel in enumerate(PANELS):
        number = "" if row == 0 else str(row + 1)
        assert layout[f"yaxis{number}"]["title"]["text"] == panel.title
        for name, _ in panel.columns:
            values = record(8.0)[:, RECORD_COLUMNS.index(name)]
            expected = values / KM_H if name == "speed_m_s" else values if name.endswith("_s2") else np.degrees(values)
            np.testing.assert_allclose(drawn[words.get(name, "mine"), f"y{number}"], expected, rtol=1e-6, err_msg=name)
    held = record()
    held[:, RECORD_COLUMNS.index("speed_m_s")] = 10.0
    layout = run_chart({"mine": held}, preset(), "title").figure["layout"]
    assert "yaxis7" in layout and "yaxis8" not in layout  # no panel for a speed that is held


def test_limits_are_those_of_the_configuration() -> None:
    """The smaller limit of actuator and optimisation is drawn; for slips, the end of the linear range."""
    config = preset()
    slower = config.model_copy(update={"rear_actuator": config.rear_actuator.model_copy(update={"angle_max_deg": 2.0})})
    tyres = AxleTyres.from_config(config)
    shapes = run_chart({"mine": record(8.0)}, slower, "title").figure["layout"]["shapes"]
    slips = {"y5": math.degrees(tyres.front_slip_bound), "y6": math.degrees(tyres.rear_slip_bound)}
    assert {shape["yref"]: shape["y0"] for shape in shapes} == pytest.approx({"y2": 3.0, "y3": 2.0, "y4": 0.8 * 9.81, **slips})
    # A limit far away would squeeze the curves.
    assert run_chart({"mine": record(0.001)}, preset(), "title").figure["layout"]["shapes"] == []


def test_runs_differ_without_colour_and_the_passive_car_has_no_controller() -> None:
    chart = run_chart({name: record() for name in ("a", "b", "passive car")}, preset(), "title")
    assert len({each["marker"]["symbol"] for each in chart.figure["data"] if "marker" in each}) == 3
    assert not any("passive car, " in each["name"] for each in chart.figure["data"])
    assert [is_passive(name) for name in ("passive", "Passive car", "passive_safe", "pi")] == [True, True, False, False]


def test_the_cut_is_the_optimum_and_the_published_marks_are_on_its_side() -> None:
    chart = front_angle_chart(preset(), 4.0, paper=True)
    drawn = {(each["name"], each["yaxis"]): each for each in chart.figure["data"] if each["mode"] == "lines"}
    for case in ("fws", "4ws-1", "4ws-2"):
        shown = drawn[case.upper(), "y2"]
        speed = unpacked(shown["x"])
        problem = SteadyTurnProblem.from_config(preset(), preset().case(case))
        expected = np.degrees(exact.solve(problem, speed.astype(float) * KM_H, np.array([math.radians(4.0)])).sideslip[:, 0])
        # Single precision of speed and sideslip; at an edge of the feasible speeds it may decide.
        both = np.isfinite(expected) & np.isfinite(unpacked(shown["y"]))
        assert both.sum() > 100
        np.testing.assert_allclose(unpacked(shown["y"])[both], expected[both], atol=1e-4)
    marks = {(each["yaxis"], each["y"][0]) for each in chart.figure["data"] if each["mode"] == "markers"}
    rates = {("y", PAPER_TABLE[case][0]) for case in PAPER_TABLE}
    # 4WS-1 and 4WS-2 have a sideslip to the right at that speed, the front-steered car to the left.
    assert marks == rates | {("y2", 1.101), ("y2", -1.08), ("y2", -0.03)}


def test_losses_are_those_of_the_simulation(solved: NamedMap) -> None:
    config = solved.map.config
    loss = loss_of_function(solved.map, config)
    chart = next(block for block in loss_blocks(solved, config) if isinstance(block, Chart))
    cells, *traces = chart.figure["data"]
    expected = np.where(solved.map.feasible, loss.only_with_rear_steer.astype(float), np.nan).T
    np.testing.assert_array_equal(unpacked(cells["z"]), expected)
    names = ["feasible with straight rear wheels too", "feasible only with rear steering"]
    legend = list(zip(names, (cells["colorscale"][k][1] for k in (0, 2)), strict=True))
    assert [(each["name"], each["marker"]["color"]) for each in traces[:2]] == legend
    spinning = next(each for each in traces if each.get("name", "").startswith("spins"))
    zero = loss.spins[MODES.index("zero")] & loss.settles
    assert 0 < zero.sum() < loss.settles.sum()
    np.testing.assert_allclose(spinning["x"], loss.speed[zero] / KM_H, atol=0.005)
    np.testing.assert_allclose(spinning["y"], np.degrees(loss.front_angle[zero]), atol=5e-4)
    assert all("set straight at once: spins" in text for text in spinning["text"])


def test_margins_are_those_of_the_design() -> None:
    """The recommended controller keeps the margins of its design; the paper's does not, at speed."""
    config = npz.load(GENERATED / "4ws2-tracking.npz").config
    chart = margins_chart({"tracking": config, "pi": preset()})

    def least(name: str, axis: str) -> float:
        trace = next(each for each in chart.figure["data"] if each["name"] == name and each["yaxis"] == axis)
        return float(np.nanmin(unpacked(trace["y"])))

    # Half a decibel and two degrees may be missing between the breakpoints of the design.
    assert least("tracking, worst of the family", "y") > config.tuning.gain_margin_db - 0.5
    assert least("tracking, worst of the family", "y2") > config.tuning.phase_margin_deg - 2.0
    assert least("pi, worst of the family", "y2") == 0.0
    feedforward = preset().model_copy(update={"controller": preset().controller.model_copy(update={"kind": "feedforward"})})
    assert margins_chart({"feedforward": feedforward}) is None


def test_budgets_and_memory_are_those_of_the_record() -> None:
    folder = GENERATED / "4ws2-tracking"
    figures = json.loads((folder / "verify.json").read_text(encoding="utf-8"))["checks"]["budgets"]["figures"]
    tables = {block.caption.partition(" (")[0]: block for block in verification_blocks(folder) if isinstance(block, Table)}
    rows = {row[0]: row for row in tables["Budgets on a Cortex-M4F"].rows}
    cycle, limits = figures["functions"]["cycle"]["instructions"], figures["budgets"]
    shown = rows["cycle: both frames received, and the task"]
    assert (shown[1], shown[4]) == (f"{cycle['max']:,}", f"{limits['task_instructions_max']:,}")
    assert rows["controller_step, its limiter apart"][4] == f"{limits['step_instructions_max']:,}"
    totals = [f"{sum(sizes[kind] for sizes in figures['objects'].values()):,}" for kind in ("text", "rodata")]
    assert tables["Memory map"].rows[-1] == ("all", *totals, "0", "0")
    assert ("one controller", f"{figures['struct_bytes']['controller']:,}", "RAM") in tables["What the caller provides"].rows
