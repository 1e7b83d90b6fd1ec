"""Charts of a report: they show the numbers of maps, runs, tyres, losses and budgets."""

import math
from pathlib import Path

import numpy as np
import pytest

from codegen.configuration import preset
from codegen.design.loss import MODES, loss_of_function
from codegen.emit.folder import read_manifest
from codegen.figures.curves import front_angle_chart
from codegen.figures.data import AFTER_STEP, Chart, cell_edges
from codegen.figures.maps import NamedMap, heat_map_charts
from codegen.figures.paper_tables import PAPER_TABLE
from codegen.figures.runs import PANELS, run_chart
from codegen.map_file import map as npz
from codegen.map_file.map import from_arrays
from codegen.optimum import exact
from codegen.optimum.problem import SteadyTurnProblem
from codegen.report.html import maps
from codegen.report.html.maps import loss_blocks
from codegen.report.html.report import extended, to_compare
from codegen.report.html.robust import margins_chart
from codegen.report.map_difference import difference_charts
from codegen.sil.software import RECORD_COLUMNS
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres
from tests.report.figures import unpacked

GENERATED = Path(__file__).resolve().parents[3] / "generated"
SPEED, ANGLE = np.array([10.0, 20.0, 30.0]), np.radians([1.0, 2.0])
RATES = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])
FEASIBLE = np.array([[True, True], [True, True], [True, False]])


@pytest.fixture(scope="module")
def solved() -> NamedMap:
    return NamedMap("4ws2", npz.load(GENERATED / "4ws2-paper.npz"))


@pytest.fixture(scope="module")
def bare() -> NamedMap:
    """Return a map with a different number in each cell, one of them infeasible."""
    arrays = {"vx": SPEED, "delta_f": ANGLE, "yaw_rate": np.where(FEASIBLE, RATES, np.nan), "feasible": FEASIBLE}
    return NamedMap("bare", from_arrays(arrays, "test"))


def test_a_bare_map_is_drawn_with_speed_to_the_right(bare: NamedMap) -> None:
    chart, acceleration = heat_map_charts(bare)
    trace = chart.figure["data"][0]
    expected = {"x": SPEED / KM_H, "y": [1.0, 2.0], "z": np.degrees(np.where(FEASIBLE, RATES, np.nan)).T}
    for key, values in expected.items():
        np.testing.assert_allclose(unpacked(trace[key]), values, rtol=1e-6)  # single precision
    shown = acceleration.figure["data"][0]["z"]
    np.testing.assert_allclose(shown, (SPEED[:, np.newaxis] * np.where(FEASIBLE, RATES, np.nan)).T, rtol=1e-12)
    data = maps.cuts([bare]).data["maps"][0]
    assert (list(data["tables"]), data["binding"]) == (["yaw_rate", "lateral_acceleration"], None)
    assert to_compare(bare.map) is None
    # A cell next to a wide gap has the width of its other neighbour.
    np.testing.assert_allclose(cell_edges([0.0, 20.0, 21.0, 22.0, 50.0]), [0.0, 19.5, 20.5, 21.5, 22.5, 50.0])


def test_maps_are_compared_on_the_axes_of_the_first(bare: NamedMap) -> None:
    """The second is linear in both axes, so that linear interpolation is exact up to single precision."""
    speed, angle = np.array([5.0, 40.0]), np.radians([0.5, 3.0])
    plane = 0.01 * speed[:, np.newaxis] + angle[np.newaxis, :]
    other = NamedMap("plane", from_arrays({"vx": speed, "delta_f": angle, "yaw_rate": plane}, "test"))
    charts = {chart.name: chart for chart in difference_charts(bare, other)}
    expected = np.degrees(np.where(FEASIBLE, RATES, np.nan) - (0.01 * SPEED[:, np.newaxis] + ANGLE))
    difference = unpacked(charts["compare-difference-1"].figure["data"][0]["z"])
    np.testing.assert_allclose(difference, expected.T, rtol=1e-5, atol=1e-5)


def test_cells_of_the_ecu_match_the_manifest(solved: NamedMap) -> None:
    chart, table = extended(solved, preset())
    manifest = read_manifest(GENERATED / "4ws2-paper")
    counts = {row[1].partition(", from there")[0]: int(row[2].replace(",", "")) for row in table.rows}
    assert counts == {rule["text"]: rule["cells"] for rule in manifest["map"]["rules"].values()}
    codes = chart.figure["data"][0]["codes"]
    assert codes["cells"].shape == (len(manifest["map"]["front_angle_rad"]), len(manifest["map"]["speed_m_s"]))
    assert codes["names"][codes["cells"][0, 0]] == "linear, from zero"


def record() -> np.ndarray:
    """Return a run without a spin in which each column is a line with its own slope."""
    time = 0.01 * np.arange(400)
    made = np.stack([(k + 1) * time / 250.0 for k in range(len(RECORD_COLUMNS))], axis=1)
    made[:, 0], made[:, -1] = time, 0.0
    for name in ("speed_m_s", "lateral_acceleration_m_s2"):
        made[:, RECORD_COLUMNS.index(name)] *= 50.0
    return made


def test_each_panel_shows_its_columns() -> None:
    chart = run_chart({"mine": record()}, preset(), "title")
    layout = chart.figure["layout"]
    drawn = {(each["name"], each.get("yaxis", "y")): unpacked(each["y"]) for each in chart.figure["data"]}
    words = {"yaw_rate_reference_rad_s": "mine, reference", "rear_angle_command_rad": "mine, command"}
    for row, panel in enumerate(PANELS):
        number = "" if row == 0 else str(row + 1)
        assert layout[f"yaxis{number}"]["title"]["text"] == panel.label
        for name in (panel.column, *(panel.dashed or ())[:1]):
            values = record()[:, RECORD_COLUMNS.index(name)]
            expected = values / KM_H if name == "speed_m_s" else values if name.endswith("_s2") else np.degrees(values)
            np.testing.assert_allclose(drawn[words.get(name, "mine"), f"y{number}"], expected, rtol=1e-6, err_msg=name)


def test_time_starts_at_the_step_and_the_legend_names_only_what_is_drawn() -> None:
    """The yaw rate has no limit, and a passive car no reference."""
    chart = run_chart({"mine": record()}, preset(), "title", PANELS[:1], origin=3.0, time_label=AFTER_STEP)
    axis = chart.figure["layout"]["xaxis"]
    assert axis["title"]["text"] == "Time after the step (s)" and axis["range"][0] == -3.0
    np.testing.assert_allclose(unpacked(chart.figure["data"][0]["x"])[[0, -1]], [-3.0, 0.99], atol=1e-6)
    assert [trace["name"] for trace in chart.figure["data"]] == ["mine", "mine, reference", "reference"]
    assert "limits" not in chart.caption
    alone = run_chart({"passive": record()}, preset(), "title", PANELS[:1])
    assert [trace["name"] for trace in alone.figure["data"]] == ["passive car"] and alone.caption == "title."
    assert {trace["name"] for trace in run_chart({"mine": record()}, preset(), "title").figure["data"]} >= {"limit"}


def test_limits_are_those_of_the_configuration() -> None:
    """The smaller limit of actuator and optimisation is drawn; for slips, the end of the linear range."""
    config = preset()
    slower = config.model_copy(update={"rear_actuator": config.rear_actuator.model_copy(update={"angle_max_deg": 2.0})})
    tyres = AxleTyres.from_config(config)
    shapes = run_chart({"mine": record()}, slower, "title").figure["layout"]["shapes"]
    slips = {"y5": math.degrees(tyres.front_slip_bound), "y6": math.degrees(tyres.rear_slip_bound)}
    limits = {"y2": 0.8 * 9.81, "y3": 3.0, "y4": 2.0, **slips}
    assert {shape["yref"]: abs(shape["y0"]) for shape in shapes} == pytest.approx(limits)


def test_the_cut_shows_the_optimum_and_the_published_marks() -> None:
    chart = front_angle_chart(preset(), 4.0, paper=True)
    drawn = {(each["name"], each["yaxis"]): each for each in chart.figure["data"] if each["mode"] == "lines"}
    for case in ("fws", "4ws-1", "4ws-2"):
        shown = drawn[case.upper(), "y2"]
        speed = unpacked(shown["x"])
        problem = SteadyTurnProblem.from_config(preset(), preset().case(case))
        expected = np.degrees(exact.solve(problem, speed.astype(float) * KM_H, np.array([math.radians(4.0)])).sideslip[:, 0])
        # Single precision of speed and sideslip may decide at an edge of the feasible speeds.
        both = np.isfinite(expected) & np.isfinite(unpacked(shown["y"]))
        assert both.sum() > 100
        np.testing.assert_allclose(unpacked(shown["y"])[both], expected[both], atol=1e-4)
    marked = (each for each in chart.figure["data"] if each["mode"] == "markers" and not each["showlegend"])
    marks = {(each["yaxis"], each["y"][0]) for each in marked}
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
    """The recommended controller meets the margins of its design; the paper's does not at high speed."""
    config = npz.load(GENERATED / "4ws2.npz").config
    chart = margins_chart({"tracking": config, "pi": preset()})

    def least(name: str, axis: str) -> float:
        trace = next(each for each in chart.figure["data"] if each["name"] == name and each["yaxis"] == axis)
        return float(np.nanmin(unpacked(trace["y"])))

    # Half a decibel and two degrees may be missing between the breakpoints of the design.
    assert least("tracking, worst of the family", "y") > config.tuning.gain_margin_db - 0.5
    assert least("tracking, worst of the family", "y2") > config.tuning.phase_margin_deg - 2.0
    assert least("pi, the car itself", "y2") == 0.0


@pytest.mark.parametrize(("top", "car", "family"), [(None, 120.0, 120.0), (180.0, 180.0, 120.0), (90.0, 90.0, 90.0)])
def test_margins_are_drawn_up_to_the_top_speed(top: float | None, car: float, family: float) -> None:
    """Beyond the map only the configured car must keep them; the other cars are drawn where all must."""
    config = npz.load(GENERATED / "4ws2.npz").config.replace({"vehicle.top_speed_km_h": top})
    ends = {each["name"]: unpacked(each["x"])[-1] for each in margins_chart({"x": config}).figure["data"]}
    assert ends == pytest.approx({"x, the car itself": car, "x, worst of the family": family}, rel=1e-6)


def test_the_cut_ends_with_listed_breakpoints() -> None:
    config = preset().replace({"grid.speed_breakpoints_km_h": [30.0, 60.0, 150.0]})
    for line in (each for each in front_angle_chart(config, 4.0, paper=False).figure["data"] if each["mode"] == "lines"):
        assert unpacked(line["x"])[[0, -1]] == pytest.approx([30.0, 150.0])
