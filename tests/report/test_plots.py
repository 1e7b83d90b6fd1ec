"""Figures of maps, tyres and runs: the data drawn, units, layout, and reproducible bytes."""

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from scipy.interpolate import RegularGridInterpolator

from codegen.figures import curves, runs, scenarios
from codegen.figures import maps as map_charts
from codegen.figures.data import MUTED, VERMILION, PlotError
from codegen.figures.draw import THEME_COLOURS, draw, new_figure, save, to_bytes
from codegen.map_file.bounds import Binding, binding_text
from codegen.map_file.map import ReferenceMap
from codegen.optimum.nonlinear import slip_use
from codegen.optimum.solve import solve_case
from codegen.report import map_difference, paper
from codegen.sil.software import RECORD_COLUMNS
from codegen.vehicle.tyre import AxleTyres
from hil_sim.scenario_files import find
from tests.hil_sim.made import record
from tests.report.figures import check_layout, line_of, names
from tests.whole_car import car

# A coarse grid with breakpoints at 4 deg and at whole km/h.
CONFIG = car(
    {"grid": {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20}, "controller": {"kind": "pi"}}
).with_tyre_model("linear")
CASES = ("fws", "4ws-1", "4ws-2")
FOUR_DEGREES = math.radians(4.0)
INFEASIBLE = "no feasible steady turn"

Runs = dict[str, Any]
Maps = dict[str, ReferenceMap]


@pytest.fixture(scope="module")
def maps() -> Maps:
    return {case: solve_case(CONFIG, case) for case in CASES}


TIME = 0.01 * np.arange(601)


def made_run(rows: int = TIME.size, **columns: Any) -> Any:
    """Return a run whose front angle steps at 2 s; other columns of RECORD_COLUMNS can be given."""
    return record(0.01 * rows, **{"speed_m_s": 12.0, "front_angle_rad": lambda time: 0.1 * (time >= 2.0), **columns})


def step_run(scale: float) -> Any:
    """Return the response to a step at 2 s; each column has its own value."""
    rise = 1.0 - np.exp(-4.0 * np.clip(TIME - 2.0, 0.0, None))
    held = {"time_s": TIME, "status": 0.0, "speed_m_s": 12.0, "front_angle_rad": 0.117 * (rise > 0.0)}
    return made_run(**{name: scale * (0.05 + 0.005 * k) * rise for k, name in enumerate(RECORD_COLUMNS)} | held)


RUNS = {"C1": step_run(1.0), "C2": step_run(0.9), "passive": step_run(0.7)}


def driven(name: str, **columns: Any) -> Any:
    """Return a run of a scenario's length with the front angle of its driver."""
    inputs = find(name).inputs(CONFIG)[::10]
    given = {"speed_m_s": inputs[:, 0], "front_angle_rad": inputs[:, 1] / CONFIG.steering.ratio, **columns}
    return made_run(len(inputs), **given)


def ramp_runs() -> Runs:
    def run(end: float) -> Any:
        angle = np.linspace(0.0, end, 6200)
        lateral = {"lateral_acceleration_m_s2": np.linspace(0.0, 6.0, 6200)}
        return driven("ramp-steer", front_angle_rad=angle, sideslip_rad=-0.3 * angle, **lateral)

    return {"controlled": run(0.04), "passive": run(0.05)}


def sweep_runs() -> Runs:
    """Return yaw rates that lag by 0.15 s and 0.3 s, and a third car that spins."""
    made = {}
    for name, lag in (("controlled", 0.15), ("passive", 0.3)):
        run = driven("sine-sweep")
        for row in range(1, len(run)):
            run[row, 3] = run[row - 1, 3] + (5.0 * run[row - 1, 2] - run[row - 1, 3]) * 0.01 / lag
        made[name] = run
    return {**made, "other": driven("sine-sweep", sideslip_rad=0.2, slip_rear_rad=0.2)}


def dwell_runs() -> Runs:
    """Return runs; the first spins at 3 s."""
    run = driven("sine-with-dwell")
    late = np.where(run[:, 0] >= 3.0, 0.2, 0.0)
    return {"controlled": driven("sine-with-dwell", sideslip_rad=late, slip_rear_rad=late), "passive": run}


def with_status() -> Any:
    status = np.zeros(601)
    status[100:150], status[250:300], status[300:400], status[400:420], status[450:] = 2, 1, 3, 4, 0
    return made_run(status=status, yaw_rate_reference_rad_s=0.3)


def difference(one: ReferenceMap, other: ReferenceMap) -> Figure:
    uses = slip_use(one), slip_use(other)
    return draw(map_difference.map_difference_picture((one, other), uses, ("a" * 63, "$b_1$")))


def run_figure(records: Runs, title: str) -> Figure:
    return draw(runs.run_picture(runs.run_chart(records, None, title), title))


def scenario(name: str, records: Runs, *texts: str) -> Figure:
    return draw(scenarios.scenario_picture(find(name), CONFIG, records, *texts))


FIGURES: dict[str, Callable[[Maps], Figure]] = {
    "map": lambda maps: draw(map_charts.map_picture(maps["4ws-2"], "4ws2.npz")),
    "difference": lambda maps: difference(maps["4ws-2"], maps["fws"]),
    "three-maps": lambda maps: draw(map_charts.three_maps_picture(maps)),
    "cut": lambda maps: draw(map_charts.front_angle_cut_picture(maps, FOUR_DEGREES)),
    "tyre": lambda maps: draw(curves.tyre_picture(CONFIG)),
    "run-status": lambda maps: run_figure({"C1": with_status(), "passive": made_run(status=2.0)}, "Faults"),
    "overview": lambda maps: draw(paper.overview_picture(maps["4ws-2"], RUNS, "map", 2.0)),
    "ramp-steer": lambda maps: scenario("ramp-steer", ramp_runs(), "4ws2"),
    "sine-sweep": lambda maps: scenario("sine-sweep", sweep_runs(), "4ws2"),
    "sine-with-dwell": lambda maps: scenario("sine-with-dwell", dwell_runs(), "4ws2"),
}


def mesh(axes: Axes) -> QuadMesh:
    return next(collection for collection in axes.collections if isinstance(collection, QuadMesh))


def panel(figure: Figure, title: str) -> Axes:
    return next(axes for axes in figure.axes if axes.get_title(loc="left").startswith(title))


@pytest.mark.parametrize("name", FIGURES)
def test_layout_and_units(name: str, maps: Maps) -> None:
    check_layout(FIGURES[name](maps))


def test_a_map_figure_shows_the_tables_in_degrees(maps: Maps) -> None:
    solved = maps["4ws-2"]
    figure = draw(map_charts.map_picture(solved, "map"))
    for title, table in (("Yaw rate", "yaw_rate"), ("Sideslip", "sideslip"), ("Rear angle", "rear_angle")):
        drawn, expected = mesh(panel(figure, title)), np.degrees(getattr(solved, table)).T  # front angle upward
        assert np.array_equal(drawn.get_array().filled(np.nan), expected, equal_nan=True)
        if table != "yaw_rate":  # diverging colours are centred at zero
            assert drawn.norm.vmax == -drawn.norm.vmin == pytest.approx(np.nanmax(np.abs(expected)))
    acceleration = np.where(solved.feasible, solved.speed[:, np.newaxis] * solved.yaw_rate, np.nan).T
    shown = mesh(panel(figure, "Lateral acceleration")).get_array().filled(np.nan)
    assert np.array_equal(shown, acceleration, equal_nan=True)
    axes = panel(figure, "Yaw rate")
    # Half a cell of 5 km/h and of 0.5 deg around 20 to 120 km/h and 0.5 to 10 deg.
    assert axes.get_xlim() == pytest.approx((17.5, 122.5))
    assert axes.get_ylim() == pytest.approx((0.25, 10.25))
    assert INFEASIBLE in names(figure) and axes.patch.get_hatch()


def test_a_difference_shows_the_yaw_rate_gained_and_the_worse_axle(maps: Maps) -> None:
    one, other = maps["4ws-2"], maps["fws"]
    figure = difference(one, other)
    more, gain = mesh(panel(figure, "First less second")), np.degrees(one.yaw_rate - other.yaw_rate).T
    assert np.array_equal(more.get_array().filled(np.nan), gain, equal_nan=True)
    assert more.norm.vmax == -more.norm.vmin == np.nanmax(np.abs(gain))
    used, where = slip_use(one), mesh(panel(figure, "Where feasible")).get_array()
    shown = mesh(panel(figure, "Slip used, first")).get_array().compressed()
    assert np.array_equal(shown, np.fmax(used.front, used.rear).T[one.feasible.T])
    assert [(where == kind).sum() for kind in range(3)] == [np.isfinite(gain).sum(), (one.feasible & ~other.feasible).sum(), 0]
    assert names(figure) == ["slip meets its bound", "both", "the first alone", INFEASIBLE]


def test_the_phase_line_is_where_the_rear_angle_is_zero(maps: Maps) -> None:
    solved = maps["4ws-2"]
    figure = draw(map_charts.map_picture(solved, "map"))
    speed, front_angle = panel(figure, "Rear angle").get_lines()[1].get_data()
    speed, front_angle = speed[:-1], front_angle[:-1]  # the last is a gap
    # Only rounding remains: the line bends at cell edges, where linear interpolation gives the zero.
    rear_angle = RegularGridInterpolator((solved.speed, solved.front_angle), solved.rear_angle)
    at_line = rear_angle(np.column_stack([np.divide(speed, 3.6), np.radians(front_angle)]))
    assert len(speed) > 10 and np.nanmax(np.abs(at_line)) < 1e-9
    assert np.isfinite(at_line).mean() > 0.8  # the interpolator returns NaN next to infeasible cells
    assert any("phase conversion" in name for name in names(figure))


def test_the_phase_line_does_not_follow_the_grid_where_a_floor_holds_the_rear_angle(maps: Maps) -> None:
    solved = maps["4ws-2"]
    zero_at = 60.0 - 2.0 * np.degrees(solved.front_angle)  # km/h
    rising = np.radians(0.1 * (solved.speed[:, np.newaxis] * 3.6 - zero_at))
    held = rising > 0.0
    made = replace(
        solved,
        rear_angle=np.where(held, 0.01 * rising, rising),
        feasible=np.full(held.shape, True),
        active=np.where(held, Binding.FLOOR, 0).astype(solved.active.dtype),
    )
    (piece,) = map_charts.phase_lines(made)
    assert len(piece) > 10 and np.abs(piece[:, 0] - (60.0 - 2.0 * piece[:, 1])).max() < 1e-9


def test_each_set_of_binding_constraints_has_the_colour_of_its_name(maps: Maps) -> None:
    solved = maps["4ws-2"]
    active = solved.active.copy()
    # Two sets that the map lacks; the second has no separate colour.
    active[0, 0], active[1, 0] = Binding.SIDESLIP, Binding.SIDESLIP | Binding.REAR_ANGLE
    figure = draw(map_charts.map_picture(replace(solved, active=active), "map"))
    (legend,) = figure.legends
    entries = zip(legend.get_texts(), legend.legend_handles, strict=True)
    colours = {text.get_text(): entry.get_facecolor() for text, entry in entries if isinstance(entry, Patch)}
    del colours[INFEASIBLE]
    sets = {binding_text(int(flags)): flags for flags in np.unique(active[solved.feasible])}
    assert colours.keys() == sets.keys()
    assert len(set(colours.values())) == len(sets) >= 5
    drawn = mesh(panel(figure, "Binding"))
    shown = drawn.to_rgba(drawn.get_array())
    for name, flags in sets.items():
        assert np.allclose(shown[(active == flags).T & solved.feasible.T], to_rgba(colours[name]))


def test_a_cut_shows_the_values_of_the_maps(maps: Maps) -> None:
    figure = draw(map_charts.front_angle_cut_picture({case.upper(): one for case, one in maps.items()}, FOUR_DEGREES))
    assert names(figure)[:3] == ["FWS", "4WS-1", "4WS-2"]
    for case, one in maps.items():
        for axes, table in zip(figure.axes, (one.yaw_rate, one.sideslip), strict=True):
            line = line_of(axes, case.upper())
            assert np.allclose(line.get_xdata(), one.speed * 3.6, rtol=1e-12)
            # Equal, NaN where infeasible: 4 deg is breakpoint 7, so nothing is interpolated.
            assert np.array_equal(line.get_ydata(), np.degrees(table[:, 7]), equal_nan=True)
    one = maps["4ws-2"]
    line = line_of(draw(map_charts.front_angle_cut_picture({"mine": one}, math.radians(4.1))).axes[0], "mine")
    expected = np.degrees(0.8 * one.yaw_rate[:, 7] + 0.2 * one.yaw_rate[:, 8])
    assert np.allclose(line.get_ydata(), expected, rtol=1e-9, equal_nan=True)


def test_tyre_curves_tangent_and_linear_range() -> None:
    tyres = AxleTyres.from_config(CONFIG)
    bounds = (tyres.front_slip_bound, tyres.rear_slip_bound)
    for axes, tyre, bound in zip(draw(curves.tyre_picture(CONFIG)).axes, (tyres.front, tyres.rear), bounds, strict=True):
        *drawn, tangent, dot = axes.get_lines()
        for curve, share in zip(drawn, curves.LOAD_SHARES, strict=True):
            slip, force = curve.get_data()
            assert np.allclose(force, tyre.force(np.radians(slip), share * tyre.static_load) / 1e3, rtol=1e-12)
        slope = 1e3 * np.ptp(tangent.get_ydata()) / np.radians(np.ptp(tangent.get_xdata()))
        assert slope == pytest.approx(tyre.cornering_stiffness, rel=1e-9)
        # At the end of the linear range the curve lies 10 % below the tangent.
        assert dot.get_xdata()[0] == pytest.approx(math.degrees(bound), rel=1e-12)
        assert 1e3 * dot.get_ydata()[0] == pytest.approx(0.9 * slope * bound, rel=1e-9)
        assert any(f"{math.degrees(bound):.3f} deg" in text.get_text() for text in axes.texts)


def test_a_tyre_figure_shows_the_use_of_grip_where_that_bounds() -> None:
    """Also of a tyre whose linear range has no end."""
    changes = {"limits.grip_use_max": 0.95, "limits.slip_departure_percent": 50.0, "tyre.front.shape_factor_c": 1.0}
    config = CONFIG.replace({**changes, "tyre.front.curvature_factor_e": 0.5})
    tyres = AxleTyres.from_config(config)
    figure = draw(curves.tyre_picture(config))
    for axes, tyre in zip(figure.axes, (tyres.front, tyres.rear), strict=True):
        slip, force = (values[0] for values in axes.get_lines()[-1].get_data())
        largest = tyre.force(np.linspace(0.0, math.radians(45.0), 100_001)).max()
        assert 1e3 * force == pytest.approx(0.95 * largest, rel=1e-6) and slip < axes.get_xlim()[1] <= 45.0
    words = {text.get_text() for text in figure.legends[0].get_texts()}
    assert "slip limit: 95 % of the largest force (nonlinear tyre)" in words
    captions = [chart.caption for chart in curves.tyre_charts(config)]
    assert all("95 % of the largest force" in caption for caption in captions)


def dashed(axes: Axes) -> list[Any]:
    """Return the lines of references and commands."""
    return [line for line in axes.get_lines() if line.get_label().endswith((", reference", ", command"))]


def test_a_run_shows_its_columns_with_dashed_reference_and_command() -> None:
    figure = run_figure(RUNS, "Step steer")
    slips = ("slip_front_rad", "slip_rear_rad")
    columns = ("yaw_rate_rad_s", "lateral_acceleration_m_s2", "sideslip_rad", "rear_angle_rad", *slips, "front_angle_rad")
    dashes = {"yaw_rate_rad_s": "yaw_rate_reference_rad_s", "rear_angle_rad": "rear_angle_command_rad"}
    for axes, name in zip(figure.axes, columns, strict=True):
        line, others = line_of(axes, runs.RUN_NAMES["C1"]), dashed(axes)
        assert line.get_color() == VERMILION
        assert [one.get_color() for one in others] == ([VERMILION, THEME_COLOURS[MUTED]] if name in dashes else [])
        drawn = [(line, "C1", name), *((one, run, dashes[name]) for one, run in zip(others, ("C1", "C2"), strict=False))]
        for one, run, column in drawn:
            expected = np.interp(one.get_xdata(), TIME, RUNS[run][:, RECORD_COLUMNS.index(column)])
            wanted = expected if name.endswith("m_s2") else np.degrees(expected)
            assert np.allclose(one.get_ydata(), wanted, rtol=1e-9, atol=1e-12)
    assert names(figure) == [runs.RUN_NAMES["C1"], runs.RUN_NAMES["C2"], "passive car", "reference, command"]


def test_an_abnormal_status_is_shown_for_its_duration() -> None:
    figure = run_figure({"C1": with_status(), "passive": made_run(status=2.0)}, "Faults")
    strip = figure.axes[-1]
    assert strip.get_ylabel() == "Status"
    assert [label.get_text() for label in strip.get_yticklabels()] == ["C1"]  # a passive car has no controller
    boxes = {tuple(bar.get_facecolor()[0]): bar.get_paths()[0].get_extents() for bar in strip.collections}
    for status, span in {"LIMITED": (2.5, 3.0), "DEGRADED": (3.0, 4.0), "FAIL_SAFE": (4.0, 4.2)}.items():
        box = boxes[to_rgba(runs.STATUS_COLOURS[status])]
        assert (box.x0, box.x1) == pytest.approx(span), status
    assert {"limited", "degraded", "fail-safe"} <= set(names(figure))
    assert "standby" not in names(figure)  # it ends before the shown time
    (line,) = dashed(figure.axes[0])
    time, hidden = line.get_xdata(), np.isnan(line.get_ydata())
    assert np.array_equal(hidden, (time > 3.995) & (time < 4.195))  # no reference in fail-safe; there is one while degraded


def test_sine_with_dwell_marks_the_times_of_the_standard_and_the_spin() -> None:
    figure = scenario("sine-with-dwell", dwell_runs())
    marks = {text.get_text(): text.xy[0] for text in figure.axes[0].texts if hasattr(text, "xy")}
    end = 1.0 + 1.0 / 0.7 + 0.5
    # The beginning is when the wheel reaches 5 deg, 16 ms after its start; the end is accurate to 2 ms.
    expected = {"begin": 1.016, "+1.07 s": 2.086, "end": end, "+1 s": end + 1.0, "+1.75 s": end + 1.75}
    assert marks == pytest.approx(expected, abs=2e-3)
    for axes in figure.axes[:7]:
        drawn = {line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2 and line.get_linewidth() < 1.0}
        assert sorted(drawn) == pytest.approx(sorted(expected.values()), abs=2e-3)
        assert line_of(axes, "pi").get_xdata()[-1] == pytest.approx(3.0)
        assert line_of(axes, "passive car").get_xdata()[-1] == pytest.approx(5.99)
        (mark,) = [line for line in axes.get_lines() if line.get_marker() == "X"]
        assert mark.get_xdata()[0] == pytest.approx(3.0)
        assert mark.get_color() == line_of(axes, "pi").get_color()
    assert any("spin" in name for name in names(figure))


def test_gain_and_phase_over_frequency() -> None:
    def exact(lag: float, frequency: Any) -> Any:
        share, z = 0.01 / lag, np.exp(2j * np.pi * frequency * 0.01)  # the recurrence of `sweep_runs`
        return share / (z - 1.0 + share)

    figure = scenario("sine-sweep", sweep_runs())
    gain, phase = figure.axes
    frequency, level = line_of(gain, "pi").get_data()
    response = exact(0.15, frequency)
    (drawn, _) = [line for line in phase.get_lines() if len(line.get_xdata()) > 10]
    # Error of the estimate: 0.2 % and 0.3 deg.
    assert level == pytest.approx(20.0 * np.log10(np.abs(response / response[0])), abs=0.02)
    assert np.asarray(drawn.get_ydata()) == pytest.approx(np.degrees(np.angle(response)), abs=0.3)
    assert "other: none" in names(figure)  # it spins
    fine = np.geomspace(0.2, 3.5, 5000)
    falls = [np.abs(exact(lag, fine)) / np.abs(exact(lag, 0.2)) < 10.0 ** (-3.0 / 20.0) for lag in (0.15, 0.3)]
    lags = [np.angle(exact(lag, fine)) < -math.pi / 4.0 for lag in (0.15, 0.3)]
    for axes, beyond in ((gain, falls), (phase, lags)):
        crossings = [line.get_xdata()[0] for line in axes.get_lines() if line.get_marker() == "o"]
        assert crossings == pytest.approx([fine[np.argmax(each)] for each in beyond], rel=0.005)


def test_front_angle_over_lateral_acceleration() -> None:
    top, sideslip, rear = scenario("ramp-steer", ramp_runs()).axes
    lateral, angle = line_of(top, "pi").get_data()
    assert (lateral[-1], angle[-1]) == pytest.approx((6.0, np.degrees(0.04)))
    fitted = [line for line in top.get_lines() if line.get_marker() == "|"]
    slopes = [float(np.ptp(line.get_ydata()) / np.ptp(line.get_xdata())) for line in fitted]
    assert slopes == pytest.approx([np.degrees(0.04 / 6.0), np.degrees(0.05 / 6.0)])
    neutral = line_of(top, "neutral car, slope L/v²")
    assert np.ptp(neutral.get_ydata()) / 6.0 == pytest.approx(np.degrees(3.14 / (80.0 / 3.6) ** 2))
    assert line_of(sideslip, "pi").get_ydata()[-1] == pytest.approx(np.degrees(-0.3 * 0.04))
    assert not line_of(rear, "pi").get_ydata().any()


def test_the_overview_shows_map_and_runs(maps: Maps) -> None:
    one = maps["4ws-2"]
    figure = draw(paper.overview_picture(one, RUNS, "map", 0.0))
    figure.draw_without_rendering()
    assert mesh(figure.axes[0]).get_array().compressed() == pytest.approx(np.degrees(one.yaw_rate.T[one.feasible.T]))
    assert any("43.2 km/h, 6.7 deg" in name for name in names(figure))
    panels = {axes.get_ylabel().partition("\n")[0]: axes for axes in figure.axes}
    assert len(panels["Yaw rate"].get_lines()) == 5  # three runs, two references
    for label, column in (("Lateral acc.", "lateral_acceleration_m_s2"), ("Sideslip β", "sideslip_rad")):
        line = line_of(panels[label], runs.RUN_NAMES["C1"])
        expected = np.interp(line.get_xdata(), TIME, RUNS["C1"][:, RECORD_COLUMNS.index(column)])
        assert np.allclose(line.get_ydata(), expected if column.endswith("m_s2") else np.degrees(expected), rtol=1e-9)


def test_messages_for_input_that_cannot_be_drawn(maps: Maps) -> None:
    for expected, make in (
        (r"run mine: shape \(5, 11\).*\(samples, 12\)", lambda: run_figure({"mine": np.zeros((5, 11))}, "x")),
        ("no runs", lambda: run_figure({}, "x")),
        ("front angles; choose 0\\.5 to 10 deg", lambda: map_charts.front_angle_cut_picture(maps, math.radians(10.1))),
    ):
        with pytest.raises(PlotError, match=expected):
            make()


def test_save_replaces_a_file_by_the_same_bytes_each_time(tmp_path: Path) -> None:
    figure, path = new_figure(1.0, 1.0), tmp_path / "map.PNG"
    with pytest.raises(PlotError, match=r"only PNG and SVG .*; name it .*\.png$"):
        save(figure, tmp_path / "map.pdf")
    path.write_bytes(b"old")
    save(figure, path)
    first = path.read_bytes()
    with matplotlib.rc_context({"font.size": 20.0, "figure.dpi": 50.0, "savefig.bbox": "tight"}):
        assert to_bytes(figure) == first
    assert not [chunk for chunk in (b"tEXt", b"zTXt", b"iTXt", b"tIME") if chunk in first[:100]]  # neither a date nor a version
    assert os.listdir(tmp_path) == ["map.PNG"]
