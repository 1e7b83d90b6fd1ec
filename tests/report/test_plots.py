"""The figures show the right numbers, with units, nothing over anything else, and the same bytes each time."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.text import Text

from codegen import config as configuration
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.errors import CodegenError
from codegen.refmap.map import Binding, ReferenceMap
from codegen.refmap.slip_use import slip_use
from codegen.refmap.solve import solve_case
from codegen.report import plots, run_plots, style, tyre_plots
from codegen.report.summary import binding_text
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Status, compile_build
from codegen.vehicle.tyre import AxleTyres
from hil_sim.scenarios import find

# A coarse grid with breakpoints at 4 deg and at whole km/h.
CONFIG = configuration.parse(
    {"grid": {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20}, "controller": {"kind": "pi"}},
    "configuration of the test",
)
RATIO = CONFIG.steering.ratio
CASES = ("fws", "4ws-1", "4ws-2")
FOUR_DEGREES = math.radians(4.0)
PHASE = "phase conversion"
INFEASIBLE = "no feasible steady turn"

Runs = dict[str, Any]


@pytest.fixture(scope="module")
def maps() -> dict[str, ReferenceMap]:
    return {case: solve_case(CONFIG, case) for case in CASES}


@pytest.fixture(scope="module")
def solved(maps: dict[str, ReferenceMap]) -> ReferenceMap:
    return maps["4ws-2"]


@pytest.fixture(scope="module")
def bare(solved: ReferenceMap) -> ReferenceMap:
    return ReferenceMap(solved.speed, solved.front_angle, solved.yaw_rate, solved.feasible)


@pytest.fixture(scope="module")
def runs(solved: ReferenceMap) -> Runs:
    """4 s of the generated C: a step steer at 1 s."""
    folder = build(solved, CONFIG, BuildOptions("4ws2"), BuildInputs("4ws2.npz", "0" * 64, "map"))
    software = compile_build(folder.files, folder.manifest)
    inputs = np.tile([42.5 / 3.6, 0.0, 0.9, np.nan, 0.0, 0.0], (4000, 1))
    inputs[1000:, 1] = math.radians(90.0)
    options = {"C1": LoopOptions(), "C2": LoopOptions(delay_samples=3), "passive": LoopOptions(controlled=False)}
    return {name: ClosedLoop(software, option).run(inputs) for name, option in options.items()}


def made_run(**columns: Any) -> Any:
    """6 s, the front angle stepping at 2 s; columns of RECORD_COLUMNS may be given."""
    time = 0.01 * np.arange(601)
    run = np.zeros((time.size, len(RECORD_COLUMNS)))
    for name, values in {"time_s": time, "speed_m_s": 12.0, "front_angle_rad": 0.1 * (time >= 2.0), **columns}.items():
        run[:, RECORD_COLUMNS.index(name)] = values
    return run


Draw = Callable[[dict[str, ReferenceMap], Runs], Figure]
FIGURES: dict[str, Draw] = {
    "map": lambda maps, runs: plots.map_figure(maps["4ws-2"], "4ws2.npz"),
    "map-fws": lambda maps, runs: plots.map_figure(maps["fws"], "fws.npz"),
    "difference": lambda maps, runs: difference(maps["4ws-2"], maps["fws"]),
    "difference-bare": lambda maps, runs: difference(without_car(maps["4ws-1"]), without_car(maps["fws"])),
    "three-maps": lambda maps, runs: plots.three_maps_figure(maps),
    "cut": lambda maps, runs: plots.front_angle_cut_figure(maps, FOUR_DEGREES),
    "tyre": lambda maps, runs: plots.tyre_figure(CONFIG),
    "run": lambda maps, runs: plots.run_figure(runs, "Step steer"),
    "run-status": lambda maps, runs: plots.run_figure({"C1": with_status(), "passive": made_run(status=2.0)}, "Faults"),
    "overview": lambda maps, runs: plots.overview_figure(CONFIG, maps, runs),
    "speed-ramp": lambda maps, runs: plots.scenario_figure(find("speed-ramp"), CONFIG, speed_ramp_runs(), "4ws2"),
    "ramp-steer": lambda maps, runs: plots.scenario_figure(find("ramp-steer"), CONFIG, ramp_runs(), "4ws2"),
    "sine-sweep": lambda maps, runs: plots.scenario_figure(find("sine-sweep"), CONFIG, sweep_runs(), "4ws2"),
    "sine-with-dwell": lambda maps, runs: plots.scenario_figure(find("sine-with-dwell"), CONFIG, dwell_runs(), "4ws2"),
    "ecu-loss": lambda maps, runs: plots.scenario_figure(find("ecu-loss"), CONFIG, {"controlled": with_status()}, "4ws2"),
    "long-title": lambda maps, runs: plots.scenario_figure(
        find("low-friction-estimated"), CONFIG, {"a": made_run()}, "a-build-with-a-long-name"
    ),
}


def without_car(one: ReferenceMap) -> ReferenceMap:
    return ReferenceMap(one.speed, one.front_angle, one.yaw_rate, one.feasible)


def difference(one: ReferenceMap, other: ReferenceMap) -> Figure:
    return plots.map_difference_figure((one, other), (slip_use(one), slip_use(other)), ("a" * 63, "$b_1$"))


def driven(name: str, **columns: Any) -> Any:
    """A run of the length of a scenario, its front angle as the driver of the scenario steers."""
    inputs = find(name).inputs(CONFIG)[::10]
    run = np.zeros((len(inputs), len(RECORD_COLUMNS)))
    given = {
        "time_s": 0.01 * np.arange(len(inputs)),
        "speed_m_s": inputs[:, 0],
        "front_angle_rad": inputs[:, 1] / RATIO,
        **columns,
    }
    for column, values in given.items():
        run[:, RECORD_COLUMNS.index(column)] = values(run[:, 2]) if callable(values) else values
    return run


def speed_ramp_runs() -> Runs:
    return {"controlled": driven("speed-ramp"), "passive": driven("speed-ramp", status=2.0)}


def ramp_runs() -> Runs:
    one, other = (
        driven("ramp-steer", front_angle_rad=lambda _, end=end: np.linspace(0.0, end, 6200), sideslip_rad=lambda a: -0.3 * a)
        for end in (0.04, 0.05)
    )
    for run in (one, other):
        run[:, RECORD_COLUMNS.index("lateral_acceleration_m_s2")] = np.linspace(0.0, 6.0, len(run))
    return {"controlled": one, "passive": other}


def sweep_runs() -> Runs:
    """Yaw rates that follow by a lag of 0.15 s and of 0.3 s; a third car that spins."""
    runs = {}
    for name, lag in (("controlled", 0.15), ("passive", 0.3)):
        run = driven("sine-sweep")
        for row in range(1, len(run)):
            run[row, 3] = run[row - 1, 3] + (5.0 * run[row - 1, 2] - run[row - 1, 3]) * 0.01 / lag
        runs[name] = run
    return {**runs, "other": driven("sine-sweep", sideslip_rad=0.2, slip_rear_rad=0.2)}


def dwell_runs() -> Runs:
    """The first car spins at 3 s."""
    run = driven("sine-with-dwell", yaw_rate_rad_s=lambda angle: 4.0 * angle)
    spinning = run.copy()
    for column in ("sideslip_rad", "slip_rear_rad"):
        spinning[:, RECORD_COLUMNS.index(column)] = np.where(run[:, 0] >= 3.0, 0.2, 0.0)
    return {"controlled": spinning, "passive": run}


def with_status() -> Any:
    status = np.zeros(601)
    status[100:150], status[250:300], status[300:400], status[400:420], status[450:] = 2, 1, 3, 4, 0
    return made_run(status=status, yaw_rate_reference_rad_s=0.3)


def names(figure: Figure) -> list[str]:
    """Every entry of every legend."""
    legends = [*figure.legends, *(legend for axes in figure.axes if (legend := axes.get_legend()) is not None)]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def mesh(axes: Axes) -> QuadMesh:
    (found,) = [collection for collection in axes.collections if isinstance(collection, QuadMesh)]
    return found


def panel(figure: Figure, title: str) -> Axes:
    (found,) = [axes for axes in figure.axes if axes.get_title(loc="left").startswith(title)]
    return found


def cells(axes: Axes) -> Any:
    """The masked array that a panel shows."""
    return mesh(axes).get_array()


def texts(figure: Figure) -> Any:
    return figure.findobj(Text)


def line_of(axes: Axes, label: str) -> Any:
    (found,) = [line for line in axes.get_lines() if line.get_label() == label]
    return found


# --- every figure ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FIGURES)
def test_nothing_is_clipped_or_covered(name: str, maps: dict[str, ReferenceMap], runs: Runs) -> None:
    figure = FIGURES[name](maps, runs)
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    outer = [*figure.legends, *(text for text in figure.texts if text.get_text())]
    parts: list[tuple[Any, Any]] = [(axes, axes.get_tightbbox(renderer)) for axes in figure.axes]
    parts += [(artist, artist.get_window_extent(renderer)) for artist in outer]
    for artist, box in parts:
        # One pixel for rounding.
        assert -1.0 <= box.x0 <= box.x1 <= figure.bbox.width + 1.0, artist
        assert -1.0 <= box.y0 <= box.y1 <= figure.bbox.height + 1.0, artist
    for (one, box), (other, other_box) in combinations(parts, 2):
        overlap_x = min(box.x1, other_box.x1) - max(box.x0, other_box.x0)
        overlap_y = min(box.y1, other_box.y1) - max(box.y0, other_box.y0)
        assert min(overlap_x, overlap_y) <= 1.0, f"{one} and {other} overlap"


@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_with_numbers_has_a_unit(name: str, maps: dict[str, ReferenceMap], runs: Runs) -> None:
    figure = FIGURES[name](maps, runs)
    figure.draw_without_rendering()
    units = ("km/h", "deg", "deg/s", "kN", "m/s²", "s", "Hz", "dB", "%")
    named = 0
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            numbers = [label for label in axis.get_ticklabels() if label.get_visible() and label.get_text()]
            label = axis.get_label_text()
            if numbers and label != "Status":
                assert label.endswith(tuple(f"({unit})" for unit in units)) or label in units, f"{label!r} of {axes}"
                named += 1
    assert named >= 2
    assert min(text.get_fontsize() for text in texts(figure)) >= 8.0


@pytest.mark.parametrize("name", FIGURES)
def test_same_input_same_bytes_whatever_the_user_has_set(name: str, maps: dict[str, ReferenceMap], runs: Runs) -> None:
    first = style.to_png(FIGURES[name](maps, runs))
    with matplotlib.rc_context({"font.size": 20.0, "axes.grid": True, "figure.dpi": 50.0, "savefig.bbox": "tight"}):
        second = style.to_png(FIGURES[name](maps, runs))
        assert matplotlib.rcParams["font.size"] == 20.0
    assert first == second


def png_chunks(data: bytes) -> Iterator[bytes]:
    place = 8
    while place < len(data):
        yield data[place + 4 : place + 8]
        place += 12 + int.from_bytes(data[place : place + 4], "big")


def test_png_holds_no_date_and_no_software(bare: ReferenceMap) -> None:
    data = style.to_png(plots.map_figure(bare, "bare"))
    assert data.startswith(b"\x89PNG\r\n")
    assert set(png_chunks(data)) == {b"IHDR", b"pHYs", b"IDAT", b"IEND"}


def test_import_is_cheap_and_drawing_needs_no_pyplot(tmp_path: Path) -> None:
    program = f"""
import sys
from codegen.report import plots
assert not {{"matplotlib", "casadi", "cffi", "scipy"}} & set(sys.modules)
import numpy as np
from codegen.refmap.map import ReferenceMap
table = np.ones((3, 2))
one = ReferenceMap(np.array([5.0, 6.0, 7.0]), np.array([0.1, 0.2]), table, table > 0.0)
plots.save(plots.map_figure(one, "bare"), __import__("pathlib").Path({str(tmp_path / "bare.png")!r}))
assert "matplotlib" in sys.modules and "matplotlib.pyplot" not in sys.modules
"""
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "bare.png").stat().st_size > 1000


# --- maps --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("title", "table"), [("Yaw rate", "yaw_rate"), ("Sideslip", "sideslip"), ("Rear angle", "rear_angle")])
def test_map_shows_its_tables_in_degrees(title: str, table: str, solved: ReferenceMap) -> None:
    drawn = cells(panel(plots.map_figure(solved, "map"), title))
    expected = np.degrees(getattr(solved, table)).T  # speed to the right, front angle upwards
    assert np.array_equal(np.ma.getmaskarray(drawn), ~solved.feasible.T)
    assert np.array_equal(drawn.compressed(), expected[solved.feasible.T])


def test_map_axes_are_km_h_and_degrees(solved: ReferenceMap) -> None:
    axes = panel(plots.map_figure(solved, "map"), "Yaw rate")
    # Half a cell of 5 km/h and of 0.5 deg around 20 to 120 km/h and 0.5 to 10 deg.
    assert axes.get_xlim() == pytest.approx((17.5, 122.5))
    assert axes.get_ylim() == pytest.approx((0.25, 10.25))


def test_a_difference_shows_what_the_first_has_more_and_the_worse_axle(maps: dict[str, ReferenceMap]) -> None:
    one, other = maps["4ws-2"], maps["fws"]
    figure = difference(one, other)
    more = mesh(panel(figure, "First less second"))
    both = (one.feasible & other.feasible).T
    expected = np.degrees(one.yaw_rate - other.yaw_rate).T
    gain: Any = more.get_array()
    assert np.array_equal(np.ma.getmaskarray(gain), ~both)
    assert np.array_equal(gain.compressed(), expected[both])
    assert more.norm.vmax == -more.norm.vmin == np.abs(expected[both]).max()  # type: ignore[operator]
    used = slip_use(one)
    assert used is not None
    assert np.array_equal(
        cells(panel(figure, "Slip used, first")).compressed(), np.fmax(used.front, used.rear).T[one.feasible.T]
    )
    where = cells(panel(figure, "Where feasible"))
    assert [int((where == kind).sum()) for kind in range(3)] == [
        int(both.sum()),
        int((one.feasible & ~other.feasible).sum()),
        0,
    ]
    assert names(figure) == ["both", "the first alone", INFEASIBLE, "slip meets its bound"]


def test_diverging_colours_are_centred_at_zero(solved: ReferenceMap) -> None:
    for title, table in (("Sideslip", solved.sideslip), ("Rear angle", solved.rear_angle)):
        norm: Any = mesh(panel(plots.map_figure(solved, "map"), title)).norm
        assert table is not None
        assert norm.vmax == -norm.vmin == pytest.approx(np.degrees(np.nanmax(np.abs(table))))


def test_phase_line_is_where_the_rear_angle_is_zero(solved: ReferenceMap) -> None:
    from scipy.interpolate import RegularGridInterpolator

    assert solved.rear_angle is not None
    rear_angle = RegularGridInterpolator((solved.speed, solved.front_angle), solved.rear_angle)
    line: Any = panel(plots.map_figure(solved, "map"), "Rear angle").get_lines()[0]
    speed, front_angle = line.get_data()
    assert len(speed) > 10
    # Rounding only: the line bends where it crosses cell edges, and along an edge zero is found by linear interpolation.
    at_line = rear_angle(np.column_stack([speed / 3.6, np.radians(front_angle)]))
    assert np.nanmax(np.abs(at_line)) < 1e-9
    assert np.isfinite(at_line).mean() > 0.8  # beside infeasible cells the interpolator gives none


def test_phase_line_is_named_only_where_there_is_one(maps: dict[str, ReferenceMap]) -> None:
    assert any(PHASE in name for name in names(plots.map_figure(maps["4ws-2"], "map")))
    assert not any(PHASE in name for name in names(plots.map_figure(maps["fws"], "map")))


def test_each_set_of_binding_constraints_has_the_colour_of_its_name(solved: ReferenceMap) -> None:
    # Planted sets beside the solved ones: alone, and one without a colour of its own.
    assert solved.active is not None
    active = solved.active.copy()
    active[0, 0], active[1, 0] = Binding.SIDESLIP, Binding.SIDESLIP | Binding.REAR_ANGLE
    figure = plots.map_figure(replace(solved, active=active), "map")
    drawn = mesh(panel(figure, "Binding"))
    values: Any = drawn.get_array()
    legend = next(one for one in figure.legends if "none" in [text.get_text() for text in one.get_texts()])
    colours = {
        text.get_text(): patch.get_facecolor() for text, patch in zip(legend.get_texts(), legend.get_patches(), strict=True)
    }
    sets = np.unique(active[solved.feasible])
    assert set(colours) == {binding_text(int(flags)) for flags in sets}
    assert len(set(colours.values())) == sets.size >= 5
    shown = drawn.to_rgba(values)
    for flags in sets:
        those = shown[(active == flags).T & solved.feasible.T]
        assert np.allclose(those, to_rgba(colours[binding_text(int(flags))])), binding_text(int(flags))


def test_sets_too_many_to_tell_apart_share_a_name(solved: ReferenceMap) -> None:
    active = np.resize(np.arange(32, dtype=np.uint8), solved.feasible.shape)
    found = names(plots.map_figure(replace(solved, active=active), "map"))
    assert any(name.endswith("rarer sets") for name in found)
    assert len(found) <= 15


def test_bare_map_shows_only_its_yaw_rate(bare: ReferenceMap) -> None:
    figure = plots.map_figure(bare, "a user's own")
    assert [axes.get_title(loc="left")[:8] for axes in figure.axes if axes.get_title(loc="left")] == ["Yaw rate"]
    assert names(figure) == [INFEASIBLE]
    assert len(style.to_png(figure)) > 1000


@pytest.mark.parametrize("kept", ["sideslip", "rear_angle", "active"])
def test_a_map_with_one_more_table_shows_that(kept: str, bare: ReferenceMap, solved: ReferenceMap) -> None:
    figure = plots.map_figure(replace(bare, **{kept: getattr(solved, kept)}), "map")
    titles = [axes.get_title(loc="left").split(" ")[0] for axes in figure.axes if axes.get_title(loc="left")]
    assert titles == ["Yaw", {"sideslip": "Sideslip", "rear_angle": "Rear", "active": "Binding"}[kept]]
    assert len(style.to_png(figure)) > 1000


def test_infeasible_cells_are_hatched_and_named(solved: ReferenceMap) -> None:
    figure = plots.map_figure(solved, "map")
    assert INFEASIBLE in names(figure)
    assert panel(figure, "Yaw rate").patch.get_hatch()
    everywhere = replace(solved, feasible=np.ones_like(solved.feasible), yaw_rate=np.nan_to_num(solved.yaw_rate))
    assert INFEASIBLE not in names(plots.map_figure(everywhere, "map"))


def test_text_of_the_user_is_shown_as_it_is(bare: ReferenceMap) -> None:
    figure = plots.map_figure(bare, "a $\\frac{1}{$ map\nof mine.npz")
    assert len(style.to_png(figure)) > 1000  # read as a formula, this would not draw
    assert [text.get_text().replace(r"\$", "$") for text in figure.texts] == ["a $\\frac{1}{$ map of mine.npz"]


def test_three_maps_share_a_scale_in_each_column(maps: dict[str, ReferenceMap]) -> None:
    figure = plots.three_maps_figure(maps)
    panels = np.reshape(np.array(figure.axes[:9], dtype=object), (3, 3))
    for column, table in enumerate(("yaw_rate", "sideslip", "rear_angle")):
        largest = np.degrees(max(np.nanmax(np.abs(getattr(one, table))) for one in maps.values()))
        assert [mesh(axes).norm.vmax for axes in panels[:, column]] == pytest.approx([largest] * 3)
        for axes, one in zip(panels[:, column], maps.values(), strict=True):
            drawn = cells(axes)
            assert np.array_equal(drawn.compressed(), np.degrees(getattr(one, table)).T[one.feasible.T])
    lines = [[bool(axes.get_lines()) for axes in row] for row in panels]
    assert lines == [[False] * 3, [True] * 3, [True] * 3]
    shown = {text.get_text() for axes in panels.flat for text in axes.texts}
    assert {"FWS", "4WS-1", "4WS-2"} <= shown


def test_three_maps_say_what_a_bare_map_lacks(bare: ReferenceMap) -> None:
    figure = plots.three_maps_figure({"bare": bare})
    assert [text.get_text() for axes in figure.axes for text in axes.texts].count("not in this map") == 2


def test_no_map_is_refused() -> None:
    with pytest.raises(plots.PlotError, match="no maps"):
        plots.three_maps_figure({})
    with pytest.raises(plots.PlotError, match="no maps"):
        plots.front_angle_cut_figure({}, FOUR_DEGREES)


# --- the cut -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spelt", [str.lower, str.upper])
def test_cut_shows_the_values_of_the_map(spelt: Callable[[str], str], maps: dict[str, ReferenceMap]) -> None:
    figure = plots.front_angle_cut_figure({spelt(case): one for case, one in maps.items()}, FOUR_DEGREES)
    yaw_axes, sideslip_axes = figure.axes
    assert names(figure)[:3] == ["FWS", "4WS-1", "4WS-2"]
    for case, one in maps.items():
        column = int(np.argmin(np.abs(one.front_angle - FOUR_DEGREES)))
        for axes, table in ((yaw_axes, one.yaw_rate), (sideslip_axes, one.sideslip)):
            line = line_of(axes, case.upper())
            assert table is not None
            assert np.allclose(line.get_xdata(), one.speed * 3.6, rtol=1e-12)
            # Equal, NaN where infeasible: 4 deg is a breakpoint, so nothing is interpolated.
            assert np.array_equal(line.get_ydata(), np.degrees(table[:, column]), equal_nan=True)
    assert np.isnan(line_of(yaw_axes, "FWS").get_ydata()).any()


def test_cut_between_breakpoints_is_linear(maps: dict[str, ReferenceMap]) -> None:
    one = maps["4ws-2"]
    line = line_of(plots.front_angle_cut_figure({"mine": one}, math.radians(4.1)).axes[0], "mine")
    below, above = (np.degrees(one.yaw_rate[:, column]) for column in (7, 8))  # 4 and 4.5 deg
    assert np.allclose(line.get_ydata(), 0.8 * below + 0.2 * above, rtol=1e-9, equal_nan=True)


def paper_marks(figure: Figure) -> list[list[float]]:
    lines: list[list[Any]] = [axes.get_lines() for axes in figure.axes]
    return [[line.get_ydata()[0] for line in lines_of_one if line.get_marker() == "o"] for lines_of_one in lines]


def test_cut_marks_the_published_values_of_the_published_car_alone(maps: dict[str, ReferenceMap]) -> None:
    yaw_rate, sideslip = paper_marks(plots.front_angle_cut_figure(maps, FOUR_DEGREES))
    assert yaw_rate == [15.35, 26.82, 21.35]
    # |beta| in the paper; here on the side where the map has it.
    assert sideslip == [1.101, -1.08, -0.03]
    assert paper_marks(plots.front_angle_cut_figure(maps, math.radians(5.0))) == [[], []]
    heavier = configuration.parse({**CONFIG.model_dump(), "vehicle": {"mass_kg": 2400.0}}, "test")
    other = {case: solve_case(heavier, case) for case in CASES}
    assert paper_marks(plots.front_angle_cut_figure(other, FOUR_DEGREES)) == [[], []]


@pytest.mark.parametrize("degrees", [0.3, 10.1, math.nan])
def test_cut_outside_the_map_is_refused(degrees: float, maps: dict[str, ReferenceMap]) -> None:
    with pytest.raises(plots.PlotError, match=r"outside the map's front angles; choose 0\.5 to 10 deg"):
        plots.front_angle_cut_figure(maps, math.radians(degrees))


# --- tyres -------------------------------------------------------------------------------------------------------------


def test_tyre_curves_tangent_and_linear_range() -> None:
    tyres = AxleTyres.from_config(CONFIG)
    figure = plots.tyre_figure(CONFIG)
    bounds = (tyres.front_slip_bound, tyres.rear_slip_bound)
    for axes, tyre, bound in zip(figure.axes, (tyres.front, tyres.rear), bounds, strict=True):
        *curves, tangent, dot = axes.get_lines()
        assert len(curves) == len(tyre_plots.LOAD_SHARES) >= 3
        for curve, share in zip(curves, tyre_plots.LOAD_SHARES, strict=True):
            slip, force = curve.get_data()
            assert np.allclose(force, tyre.force(np.radians(slip), share * tyre.static_load) / 1e3, rtol=1e-12)
        slip, force = (np.asarray(values) for values in tangent.get_data())
        slope = 1e3 * (force[1] - force[0]) / np.radians(slip[1] - slip[0])
        assert slope == pytest.approx(tyre.cornering_stiffness, rel=1e-9)
        # At the end of the linear range the curve lies 10 % below the tangent.
        end, force_there = (float(np.asarray(values)[0]) for values in dot.get_data())
        assert end == pytest.approx(math.degrees(bound), rel=1e-12)
        assert 1e3 * force_there == pytest.approx(0.9 * slope * bound, rel=1e-9)
        assert any(f"{math.degrees(bound):.3f} deg" in text.get_text() for text in axes.texts)
    assert any("10 %" in name for name in names(figure))


# --- runs --------------------------------------------------------------------------------------------------------------


def test_run_shows_its_columns_in_degrees_and_si(runs: Runs) -> None:
    figure = plots.run_figure(runs, "Step steer")
    columns = ("yaw_rate_rad_s", "sideslip_rad", "rear_angle_rad", "front_angle_rad", "lateral_acceleration_m_s2")
    run = runs["C1"]
    for axes, name in zip(figure.axes, columns, strict=True):
        line = line_of(axes, "C1 (4WS-2 map, PI)")
        time, values = (np.asarray(data) for data in line.get_data())
        expected = np.interp(time, run[:, 0], run[:, RECORD_COLUMNS.index(name)])
        assert np.allclose(values, expected if name.endswith("m_s2") else np.degrees(expected), rtol=1e-9, atol=1e-12)
        assert line.get_color() == style.BLUE
    assert names(figure) == ["C1 (4WS-2 map, PI)", "C2 (FWS map, PI)", "passive car", "reference, command"]
    assert max(line_of(figure.axes[0], "passive car").get_ydata()) > 20.0  # deg/s; the paper's car at its step


def dashed(axes: Axes) -> list[Any]:
    return [line for line in axes.get_lines() if line.get_label() == "_"]


def test_reference_and_command_are_dashed_and_the_passive_car_has_none(runs: Runs) -> None:
    figure = plots.run_figure(runs, "Step steer")
    for axes, name in ((figure.axes[0], "yaw_rate_reference_rad_s"), (figure.axes[2], "rear_angle_command_rad")):
        lines = dashed(axes)
        assert [line.get_color() for line in lines] == [style.BLUE, style.GREY]
        for line, run in zip(lines, (runs["C1"], runs["C2"]), strict=True):
            expected = np.interp(line.get_xdata(), run[:, 0], np.degrees(run[:, RECORD_COLUMNS.index(name)]))
            assert np.allclose(line.get_ydata(), expected, rtol=1e-9, atol=1e-12)
    assert not dashed(figure.axes[1])


def test_window_starts_half_a_second_before_the_steering(runs: Runs) -> None:
    assert run_plots.run_window({"a": made_run()}) == pytest.approx((1.5, 5.0))
    # The front wheels of the run follow with a lag: they are seen to move in the first samples after 1 s.
    assert run_plots.run_window(runs) == pytest.approx((0.5, 3.99), abs=0.03)
    straight = made_run(front_angle_rad=0.0)
    assert run_plots.run_window({"a": straight}) == pytest.approx((0.0, 6.0))
    late = 0.3 * (straight[:, 0] >= 5.4)
    assert run_plots.run_window({"a": made_run(yaw_rate_rad_s=late)})[1] == pytest.approx(5.4 + 0.5, abs=0.02)
    figure = plots.run_figure({"a": made_run()}, "made")
    assert figure.axes[0].get_xlim() == pytest.approx((1.5, 5.0))


def test_status_other_than_normal_is_shown_when_it_was() -> None:
    figure = plots.run_figure({"C1": with_status(), "passive": made_run(status=2.0)}, "Faults")
    strip = figure.axes[-1]
    assert strip.get_ylabel() == "Status"
    assert [label.get_text() for label in strip.get_yticklabels()] == ["C1"]  # a passive car has no controller
    bars: list[Any] = list(strip.collections)
    boxes = {tuple(bar.get_facecolor()[0]): bar.get_paths()[0].get_extents() for bar in bars}
    spans = {colour: (box.x0, box.x1) for colour, box in boxes.items()}
    expected = {"LIMITED": (2.5, 3.0), "DEGRADED": (3.0, 4.0), "FAIL_SAFE": (4.0, 4.2)}
    for status, span in expected.items():
        assert spans[to_rgba(run_plots.STATUS_COLOURS[status])] == pytest.approx(span), status
    assert {"limited", "degraded", "fail-safe"} <= set(names(figure))
    assert "standby" not in names(figure)  # it was before the time shown


@pytest.mark.parametrize("status", [Status.TRACKING, Status.LIMITED])
def test_no_strip_without_an_incident(status: Status) -> None:
    assert len(plots.run_figure({"C1": made_run(status=float(status))}, "made").axes) == len(run_plots.SIGNALS)


def test_no_reference_is_drawn_where_the_controller_gives_none() -> None:
    (line,) = dashed(plots.run_figure({"C1": with_status()}, "Faults").axes[0])
    time = np.asarray(line.get_xdata())
    hidden = np.isnan(np.asarray(line.get_ydata(), dtype=float))
    assert np.array_equal(hidden, (time > 3.995) & (time < 4.195))  # fail-safe, not degraded


def test_runs_of_other_names_are_told_apart() -> None:
    figure = plots.run_figure({"controlled": made_run(), "_other": made_run(), "Passive car": made_run(status=2.0)}, "x")
    colours = [line.get_color() for line in figure.axes[1].get_lines()]
    assert len(set(colours)) == 3
    assert colours[2] == style.BLACK
    assert [name.strip() for name in names(figure)[:3]] == ["controlled", "_other", "Passive car"]


@pytest.mark.parametrize("run", [np.zeros((5, 11)), np.zeros((1, 12)), np.zeros(12)])
def test_run_of_another_shape_is_refused(run: Any) -> None:
    with pytest.raises(plots.PlotError, match=r"run mine: shape .*\(samples, 12\)"):
        plots.run_figure({"mine": run}, "x")


def test_no_run_is_refused() -> None:
    with pytest.raises(plots.PlotError, match="no runs"):
        plots.run_figure({}, "x")


def test_speed_is_shown_where_it_is_not_held() -> None:
    figure = plots.run_figure(speed_ramp_runs(), "made")
    (axes,) = [axes for axes in figure.axes if axes.get_ylabel().startswith("Speed")]
    assert max(line_of(axes, "controlled").get_ydata()) == pytest.approx(30.0)  # twice the enable speed, km/h


def test_run_ends_where_the_car_spins() -> None:
    figure = plots.scenario_figure(find("sine-with-dwell"), CONFIG, dwell_runs())
    for axes in figure.axes[:5]:
        assert line_of(axes, "controlled").get_xdata()[-1] == pytest.approx(3.0)
        assert line_of(axes, "passive car").get_xdata()[-1] == pytest.approx(5.99)
        (mark,) = [line for line in axes.get_lines() if line.get_marker() == "X"]
        assert mark.get_xdata()[0] == pytest.approx(3.0)
        assert mark.get_color() == line_of(axes, "controlled").get_color()
    assert any("spin" in name for name in names(figure))
    assert not any("spin" in name for name in names(plots.run_figure({"a": made_run()}, "x")))


def test_times_of_the_standard_are_marked() -> None:
    figure = plots.scenario_figure(find("sine-with-dwell"), CONFIG, dwell_runs())
    marks = {text.get_text(): text.xy[0] for text in figure.axes[0].texts if hasattr(text, "xy")}
    end = 1.0 + 1.0 / 0.7 + 0.5
    # The beginning is where the wheel reaches 5 deg, 16 ms after it starts; the end is met within 2 ms.
    expected = {"begin": 1.016, "+1.07 s": 2.086, "end": end, "+1 s": end + 1.0, "+1.75 s": end + 1.75}
    assert marks == pytest.approx(expected, abs=2e-3)
    for axes in figure.axes[:5]:
        drawn = {line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2 and line.get_linewidth() < 1.0}
        assert sorted(drawn) == pytest.approx(sorted(expected.values()), abs=2e-3)


def test_faults_are_shaded_where_they_act() -> None:
    figure = plots.scenario_figure(find("ecu-loss"), CONFIG, {"controlled": made_run()})
    assert "fault: ecu-restart" in names(figure)
    for axes in figure.axes:
        (patch,) = axes.patches
        assert (patch.get_x(), patch.get_x() + patch.get_width()) == pytest.approx((9.0, 10.0))


def lag_response(lag: float, frequency: Any) -> Any:
    """The recurrence of `sweep_runs` over frequency."""
    share, z = 0.01 / lag, np.exp(2j * np.pi * frequency * 0.01)
    return share / (z - 1.0 + share)


def test_gain_and_phase_over_frequency() -> None:
    figure = plots.scenario_figure(find("sine-sweep"), CONFIG, sweep_runs())
    gain, phase = figure.axes
    frequency, level = (np.asarray(values) for values in line_of(gain, "controlled").get_data())
    exact = lag_response(0.15, frequency)
    drawn = [line for line in phase.get_lines() if len(line.get_xdata()) > 10]
    # What the estimate leaves: 0.2 %, and 0.3 deg.
    assert level == pytest.approx(20.0 * np.log10(np.abs(exact / exact[0])), abs=0.02)
    assert np.asarray(drawn[0].get_ydata()) == pytest.approx(np.degrees(np.angle(exact)), abs=0.3)
    assert "other: none" in names(figure)  # it spins
    dots = [float(np.asarray(line.get_xdata())[0]) for line in phase.get_lines() if line.get_marker() == "o"]
    fine = np.geomspace(0.2, 3.5, 5000)
    expected = [fine[np.argmax(np.angle(lag_response(lag, fine)) < -math.pi / 4.0)] for lag in (0.15, 0.3)]
    assert dots == pytest.approx(expected, rel=0.005)


def test_front_angle_over_lateral_acceleration() -> None:
    figure = plots.scenario_figure(find("ramp-steer"), CONFIG, ramp_runs())
    top, sideslip, rear = figure.axes
    lateral, angle = (np.asarray(values) for values in line_of(top, "controlled").get_data())
    assert lateral[-1] == pytest.approx(6.0)
    assert angle[-1] == pytest.approx(np.degrees(0.04))
    fitted = [line for line in top.get_lines() if line.get_marker() == "|"]
    assert [float(np.ptp(line.get_ydata()) / np.ptp(line.get_xdata())) for line in fitted] == pytest.approx(
        [np.degrees(0.04 / 6.0), np.degrees(0.05 / 6.0)]
    )
    neutral = line_of(top, "neutral car, slope $L/v^2$")
    assert np.ptp(neutral.get_ydata()) / 6.0 == pytest.approx(np.degrees(3.14 / (80.0 / 3.6) ** 2))
    assert line_of(sideslip, "controlled").get_ydata()[-1] == pytest.approx(np.degrees(-0.3 * 0.04))
    assert not line_of(rear, "controlled").get_ydata().any()


def test_panel_of_a_car_that_does_not_move_shows_no_rounding() -> None:
    low, high = plots.run_figure({"a": made_run(sideslip_rad=1e-12)}, "x").axes[1].get_ylim()
    assert high - low == pytest.approx(run_plots.LEAST_HEIGHT)


def test_a_long_title_goes_on_two_lines() -> None:
    figure = FIGURES["long-title"]({}, {})
    assert figure.get_suptitle().splitlines() == [
        "a-build-with-a-long-name",
        "Low friction: 2 deg at the front wheels, 80 km/h, friction 0.5, estimated 0.5",
    ]
    assert (
        plots.scenario_figure(find("speed-ramp"), CONFIG, speed_ramp_runs(), "a$b\nc")
        .get_suptitle()
        .startswith(r"a\$b c – Speed")
    )


def test_long_details_of_a_run_are_wrapped_and_whole() -> None:
    details = ", ".join(f"factor number {number} +{number} %" for number in range(12))
    scenario = replace(find("low-friction-estimated"), subject="A scenario of my own with quite a long name")
    figure = plots.scenario_figure(scenario, CONFIG, {"a": made_run()}, "run 7, pi", details)
    lines = figure.get_suptitle().splitlines()
    assert lines[0] == "run 7, pi"
    assert " ".join(lines[1:]) == f"{scenario.title} {details}"
    assert max(map(len, lines)) <= 78
    figure.draw_without_rendering()
    (title,) = [text for text in figure.texts if text.get_text() == figure.get_suptitle()]
    box, whole = title.get_window_extent(), figure.bbox
    assert whole.x0 <= box.x0 <= box.x1 <= whole.x1
    assert box.y1 <= whole.y1


# --- the overview ------------------------------------------------------------------------------------------------------


def test_overview_is_wide_and_shows_map_and_runs(maps: dict[str, ReferenceMap], runs: Runs) -> None:
    figure = plots.overview_figure(CONFIG, maps, runs)
    data = style.to_png(figure)
    assert (int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")) == (1600, 620)
    left, right = figure.axes[:2]
    drawn = cells(left)
    assert drawn.compressed() == pytest.approx(np.degrees(maps["4ws-2"].yaw_rate.T[maps["4ws-2"].feasible.T]))
    assert any("42.5 km/h, 6.75 deg" in name for name in names(figure))
    assert len(right.get_lines()) == 5  # three runs, two references
    # Shown 900 pixels wide, the smallest text is still 9 pixels high or more.
    smallest = min(text.get_fontsize() for text in texts(figure))
    assert smallest * 130.0 / 72.0 * 900.0 / 1600.0 >= 9.0


def test_legend_of_the_overview_covers_no_curve(maps: dict[str, ReferenceMap], runs: Runs) -> None:
    figure = plots.overview_figure(CONFIG, maps, runs)
    figure.draw_without_rendering()
    for axes in figure.axes[:2]:
        legend = axes.get_legend()
        assert legend is not None
        box = legend.get_window_extent()
        for line in axes.get_lines():
            assert not box.count_contains(line.get_transform().transform(line.get_xydata())), line


def test_overview_takes_names_in_any_case_and_refuses_other_maps(maps: dict[str, ReferenceMap], runs: Runs) -> None:
    plots.overview_figure(CONFIG, {"4WS-2": maps["4ws-2"]}, runs)
    with pytest.raises(plots.PlotError, match="no map 4ws-2"):
        plots.overview_figure(CONFIG, {"fws": maps["fws"]}, runs)


# --- saving ------------------------------------------------------------------------------------------------------------


def test_save_replaces_and_leaves_nothing_else(bare: ReferenceMap, tmp_path: Path) -> None:
    figure = plots.map_figure(bare, "bare")
    path = tmp_path / "map.PNG"
    path.write_bytes(b"old")
    plots.save(figure, path)
    assert path.read_bytes() == style.to_png(figure)
    assert os.listdir(tmp_path) == ["map.PNG"]


@pytest.mark.parametrize("name", ["map.pdf", "map", "map.png.txt", ".png"])
def test_save_refuses_other_formats(name: str, bare: ReferenceMap, tmp_path: Path) -> None:
    with pytest.raises(plots.PlotError, match=r"only PNG .*; name it .*\.png$"):
        plots.save(plots.map_figure(bare, "bare"), tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_save_into_a_missing_folder_or_over_a_folder(bare: ReferenceMap, tmp_path: Path) -> None:
    figure = plots.map_figure(bare, "bare")
    (tmp_path / "folder.png").mkdir()
    for path in (tmp_path / "missing" / "map.png", tmp_path / "folder.png"):
        with pytest.raises(CodegenError) as caught:
            plots.save(figure, path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
        assert caught.value.exit_code == 2
    assert os.listdir(tmp_path) == ["folder.png"]


def test_failed_save_leaves_what_stood(bare: ReferenceMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.png"
    path.write_bytes(b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CodegenError, match="No space left"):
        plots.save(plots.map_figure(bare, "bare"), path)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["map.png"]


@pytest.mark.parametrize("letter", ["W", "i", "a_b "])
@pytest.mark.parametrize("count", [1, 3, 7])
def test_long_names_fit_into_the_legend(letter: str, count: int) -> None:
    """Entries lie within the picture, not on each other, and take nothing from the panels."""

    def figure_of(names: list[str]) -> Figure:
        figure = plots.run_figure({name: made_run() for name in names}, "made")
        style.to_png(figure)
        return figure

    figure = figure_of([(f"{number}" + letter * 63)[:63] for number in range(count)])
    (legend,) = figure.legends
    boxes = [text.get_window_extent() for text in legend.get_texts()]
    assert len(boxes) == count + 1
    assert all(figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1 and figure.bbox.y0 <= box.y0 for box in boxes)
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    short = figure_of(["a"]).axes[0].get_window_extent().height
    assert figure.axes[0].get_window_extent().height > 0.9 * short
