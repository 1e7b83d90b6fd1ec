"""Charts of runs, curves, losses and margins hold the numbers that they are named after, and their limits."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.config import KM_H, Config, preset
from codegen.refmap import exact
from codegen.refmap import map as npz
from codegen.refmap.loss import loss_of_function
from codegen.refmap.loss_simulation import MODES
from codegen.refmap.problem import SteadyTurnProblem
from codegen.report.html.blocks import Chart, Table
from codegen.report.html.build import verification_blocks
from codegen.report.html.curves import front_angle_chart, tyre_charts
from codegen.report.html.loss import loss_blocks
from codegen.report.html.maps import NamedMap
from codegen.report.html.runs import PANELS, is_passive, run_chart
from codegen.report.published import PAPER_TABLE
from codegen.sil.software import RECORD_COLUMNS
from codegen.vehicle.tyre import AxleTyres

GENERATED = Path(__file__).resolve().parents[3] / "generated"
SAMPLES = 400


def unpacked(packed: Any) -> np.ndarray:
    if isinstance(packed, list):
        return np.array(packed, dtype=float)
    values = np.frombuffer(base64.b64decode(packed["bdata"]), dtype={"f4": "<f4", "u1": "u1"}[packed["dtype"]])
    return values.reshape([int(size) for size in packed["shape"].split(",")]) if "shape" in packed else values


def record(scale: float = 1.0) -> np.ndarray:
    """Each column a line of its own slope; status TRACKING. With scale 8 the speed is not held."""
    time = 0.01 * np.arange(SAMPLES)
    made = np.stack([scale * (k + 1) * time / 40.0 for k in range(len(RECORD_COLUMNS))], axis=1)
    made[:, 0], made[:, -1] = time, 0.0
    return made


def lines(chart: Chart) -> dict[tuple[str, str], np.ndarray]:
    """(name, axis) -> what is drawn."""
    return {(each["name"], each.get("yaxis", "y")): unpacked(each["y"]) for each in chart.figure["data"]}


# --- runs --------------------------------------------------------------------------------------------------------------


def test_each_panel_shows_its_columns() -> None:
    """Angles in deg, speed in km/h, acceleration as it is; to single precision."""
    chart = run_chart({"mine": record(8.0)}, preset(), "title")
    drawn = lines(chart)
    words = {"yaw_rate_reference_rad_s": "mine, reference", "rear_angle_command_rad": "mine, command"}
    titles = [chart.figure["layout"][f"yaxis{row or ''}"]["title"]["text"] for row in ("", *range(2, len(PANELS) + 1))]
    assert titles == [panel.title for panel in PANELS]
    for row, panel in enumerate(PANELS):
        for name, _ in panel.columns:
            values = record(8.0)[:, RECORD_COLUMNS.index(name)]
            expected = values / KM_H if name == "speed_m_s" else values if name.endswith("_s2") else np.degrees(values)
            shown = drawn[words.get(name, "mine"), "y" if row == 0 else f"y{row + 1}"]
            np.testing.assert_allclose(shown, expected, rtol=1e-6, err_msg=name)


def test_speed_is_left_out_where_it_is_held() -> None:
    held = record()
    held[:, RECORD_COLUMNS.index("speed_m_s")] = 10.0
    layout = run_chart({"mine": held}, preset(), "title").figure["layout"]
    assert "yaxis7" in layout
    assert "yaxis8" not in layout


def test_limits_stand_where_the_configuration_has_them() -> None:
    """Of what the actuator and the optimisation allow the smaller one; of slips the end of the linear range."""
    config = preset()
    slower = config.model_copy(update={"rear_actuator": config.rear_actuator.model_copy(update={"angle_max_deg": 2.0})})
    tyres = AxleTyres.from_config(config)
    shapes = run_chart({"mine": record(8.0)}, slower, "title").figure["layout"]["shapes"]
    at = {(shape["yref"], round(shape["y0"], 6)) for shape in shapes}
    assert at == {
        ("y2", 3.0),
        ("y3", 2.0),
        ("y4", round(0.8 * 9.81, 6)),
        ("y5", round(math.degrees(tyres.front_slip_bound), 6)),
        ("y6", round(math.degrees(tyres.rear_slip_bound), 6)),
    }


def test_a_limit_far_away_squeezes_nothing() -> None:
    assert run_chart({"mine": record(0.001)}, preset(), "title").figure["layout"]["shapes"] == []


def test_runs_are_told_apart_without_colour() -> None:
    chart = run_chart({name: record() for name in ("a", "b", "passive car")}, preset(), "title")
    symbols = {each["name"]: each["marker"]["symbol"] for each in chart.figure["data"] if "marker" in each}
    assert len(set(symbols.values())) == 3
    # The passive car has no controller that could ask for anything.
    assert not any("passive car, " in each["name"] for each in chart.figure["data"])


@pytest.mark.parametrize(
    ("name", "passive"), [("passive", True), ("Passive car", True), ("passive_safe", False), ("pi", False)]
)
def test_which_run_is_without_control(name: str, passive: bool) -> None:
    assert is_passive(name) is passive


# --- curves ------------------------------------------------------------------------------------------------------------


def test_tyres_show_their_own_force_and_range() -> None:
    """A car with a stiffer rear axle, so that the axles differ."""
    config = preset()
    rear = config.tyre.rear.model_copy(update={"cornering_stiffness_n_per_rad": 150_000.0})
    config = config.model_copy(update={"tyre": config.tyre.model_copy(update={"rear": rear})})
    tyres = AxleTyres.from_config(config)
    charts = tyre_charts(config).charts
    for chart, tyre, bound in zip(
        charts, (tyres.front, tyres.rear), (tyres.front_slip_bound, tyres.rear_slip_bound), strict=True
    ):
        (shade,) = chart.figure["layout"]["shapes"]
        assert shade["x1"] == pytest.approx(math.degrees(bound))
        static = next(each for each in chart.figure["data"] if each["name"] == "100 % load")
        slip = np.radians(unpacked(static["x"]))
        # Single precision of the slip.
        np.testing.assert_allclose(unpacked(static["y"]), tyre.force(slip) / 1e3, rtol=1e-5, atol=1e-6)
    assert charts[0].figure["layout"]["shapes"][0]["x1"] != charts[1].figure["layout"]["shapes"][0]["x1"]


def test_the_cut_is_the_optimum_and_the_papers_marks_are_on_its_side() -> None:
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


# --- loss of function --------------------------------------------------------------------------------------------------


def test_losses_are_those_that_were_simulated() -> None:
    one = NamedMap("4ws2", npz.load(GENERATED / "4ws2.npz"))
    config = one.map.config
    assert isinstance(config, Config)
    loss = loss_of_function(one.map, config)
    chart = next(block for block in loss_blocks(one, config) if isinstance(block, Chart))
    cells, *_ = chart.figure["data"]
    assert loss.only_with_rear_steer is not None
    expected = np.where(one.map.feasible, loss.only_with_rear_steer.astype(float), np.nan).T
    np.testing.assert_array_equal(unpacked(cells["z"]), expected)
    names = [each["name"] for each in chart.figure["data"][1:3]]
    assert names == ["feasible with straight rear wheels too", "feasible only with rear steering"]
    assert [each["marker"]["color"] for each in chart.figure["data"][1:3]] == [cells["colorscale"][k][1] for k in (0, 2)]
    spinning = next(each for each in chart.figure["data"] if each.get("name", "").startswith("spins"))
    zero = loss.spins[MODES.index("zero")] & loss.settles
    assert 0 < zero.sum() < loss.settles.sum()
    np.testing.assert_allclose(spinning["x"], loss.speed[zero] / KM_H, atol=0.005)
    np.testing.assert_allclose(spinning["y"], np.degrees(loss.front_angle[zero]), atol=5e-4)
    assert all("set straight at once: spins" in text for text in spinning["text"])


# --- budgets and memory ------------------------------------------------------------------------------------------------


def test_budgets_and_memory_are_those_of_the_record() -> None:
    folder = GENERATED / "4ws2-tracking"
    figures = json.loads((folder / "verify.json").read_text(encoding="utf-8"))["checks"]["budgets"]["figures"]
    tables = {block.caption.partition(" (")[0]: block for block in verification_blocks(folder) if isinstance(block, Table)}
    rows = {row[0]: row for row in tables["Budgets on a Cortex-M4F"].rows}
    cycle, asked = figures["functions"]["cycle"]["instructions"], figures["budgets"]
    shown = rows["cycle: both frames received, and the task"]
    assert (shown[1], shown[4]) == (f"{cycle['max']:,}", f"{asked['task_instructions_max']:,}")
    assert rows["controller_step, its limiter apart"][4] == f"{asked['step_instructions_max']:,}"
    code = sum(sizes["text"] for sizes in figures["objects"].values())
    constants = sum(sizes["rodata"] for sizes in figures["objects"].values())
    assert tables["Memory map"].rows[-1] == ("all", f"{code:,}", f"{constants:,}", "0", "0")
    assert ("one controller", f"{figures['struct_bytes']['controller']:,}", "RAM") in tables["What the caller provides"].rows
