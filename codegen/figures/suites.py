"""Pictures of the results of the test set of rear-steering controllers, and of the comparison of references.

Labels are in degrees and km/h, arguments in SI units.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG
from codegen.figures.data import (
    AFTER_STEP,
    BLUE,
    CONTROLLER_COLOURS,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY,
    SPEED_TITLE,
    SYMBOLS,
    VERMILION,
    WHITE,
    Chart,
    Picture,
    axis,
    entry,
    level,
    line,
    panel,
    patches,
    plain,
    points,
    symlog,
    upright,
)
from codegen.figures.maps import MAP_QUANTITIES, at_front_angle, category_trace
from codegen.figures.runs import MOTION_PANELS, PANELS, SPIN_NAME, Panel, column, until_spin
from codegen.units import KM_H
from hil_sim.suite.cells import CELL_STEER_TIME, NOMINAL
from hil_sim.suite.references import ReferencesResult
from hil_sim.suite.requirements import sideslip_limit
from hil_sim.suite.runs import CellResult
from hil_sim.suite.tracking import CellRuns, SuiteResult

MORE_COLOURS = (ORANGE, BLUE, GREEN, PURPLE, VERMILION, MUTED)
ROW_SHARE, ROW_FACE = 0.9, "#F2F2F2"
"""Fraction of the row height that its marks take; background of every other row."""
SHADE_LEVELS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Bounds of the colours, in % of overshoot."""
LEVEL_COLOURS = ("#F7FBFF", "#D6E6F4", "#ABD0E6", "#F9D1B0", "#F0935A", "#B8401A")
SPIN_FACE = "#333333"
OVERSHOOT_TICKS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
MARGIN_PANELS = (
    ("Gain margin (dB)", "gain_margin_db", WARN_GAIN_MARGIN_DB),
    ("Phase margin (deg)", "phase_margin_deg", WARN_PHASE_MARGIN_DEG),
    ("Peak sensitivity", "sensitivity", None),
)
SENSITIVITY_TOP = 5.0
BEFORE, AFTER = 0.2, 2.0
"""Time before and after the step that is shown, in s."""
FRICTION_TITLE = "Slippery roads, with and without an estimate of the friction"
CUT_FRONT_ANGLE = math.radians(2.0)
Traces = list[dict[str, Any]]


def pictures(result: SuiteResult) -> dict[str, Picture]:
    """Return name -> picture, with the file name without extension, for everything that was simulated."""
    made = {"overview": overview_picture(result), "steps": steps_picture(result)}
    if result.conditions:
        made |= {"cells": cells_picture(result), "conditions": conditions_picture(result)}
    if result.margins:
        made["margins"] = margins_picture(result)
    if slippery(result):
        made["friction"] = friction_picture(result)
    if result.rise_times:
        made["price"] = price_picture(result)
    return made


def looks_of(result: SuiteResult) -> dict[str, dict[str, Any]]:
    """Return colour, width and dash of each subject; the one under test has the widest line."""
    taken = {CONTROLLER_COLOURS.get(name) for name in result.subjects}
    spare = itertools.cycle([colour for colour in MORE_COLOURS if colour not in taken])
    return {
        name: {
            "colour": CONTROLLER_COLOURS.get(name) or next(spare),
            "width": 2.7 if name == result.tested else 1.6,
            "dash": "dot" if name == "passive" else "solid",
        }
        for name in result.subjects
    }


def _names(result: SuiteResult) -> Traces:
    """Return legend entries of the subjects."""
    return [entry(plain(name), look["colour"], look["dash"], look["width"]) for name, look in looks_of(result).items()]


def _hidden(**more: Any) -> dict[str, Any]:
    return {"showlegend": False, **more}


# --- steps ------------------------------------------------------------------------------------------------------------


def steps_picture(result: SuiteResult) -> Picture:
    """Return the paper's step and some cells in columns: motion of the car, with map and reference, and rear angle."""
    signals = (*MOTION_PANELS, PANELS[3])
    rows = [[_step_panel(result, shown, signal) for shown in result.shown] for signal in signals]
    for place, shown in enumerate(result.shown):
        first = rows[0][place]
        rows[0][place] = Chart("", first.figure, title=f"{'C1: ' if place == 0 else ''}{_cell_title(shown)}")
    title = f"Step steer, as configured: {result.delay_text} in the computation"
    return Picture(rows, (3.1 * len(result.shown) + 0.6, 9.6), title)


def _cell_title(shown: CellRuns) -> str:
    return f"{shown.cell.speed_km_h:g} km/h, {shown.cell.front_angle_deg:.3g} deg"


def _step_panel(result: SuiteResult, shown: CellRuns, signal: Panel, title: str = "") -> Chart:
    """Return one signal of all subjects until the car spins."""
    looks, data, shapes = looks_of(result), _names(result), []
    data += [entry(f"reference of {plain(result.tested)}", SKY, "dash"), entry("the map's value", MUTED, "dash")]
    spins: Traces = []
    for subject in reversed(result.subjects):
        whole = shown.records[subject]
        run = _around_step(until_spin(whole))
        time, values = column(run, "time_s") - CELL_STEER_TIME, column(run, signal.column)
        data.append(line(time, values, subject, **looks[subject], **_hidden()))
        if len(until_spin(whole)) < len(whole) and time[-1] < AFTER - 0.02:
            look = {"marker": {"line": {"color": WHITE, "width": 1}}, **_hidden()}
            spins.append(points(time[-1:], values[-1:], "", looks[subject]["colour"], "x", 12, **look))
    if signal is MOTION_PANELS[0]:
        inside = _around_step(shown.records[result.tested])
        reference = column(inside, "yaw_rate_reference_rad_s")
        data.append(line(column(inside, "time_s") - CELL_STEER_TIME, reference, "", SKY, dash="dash", width=1.5, **_hidden()))
        shapes.append(level(math.degrees(shown.map_yaw_rate), colour=MUTED, dash="dash", width=1.5))
    data += spins + ([points([np.nan], [np.nan], SPIN_NAME, MUTED, "x", 12)] if spins else [])
    return panel(data, axis(AFTER_STEP, range=[-BEFORE, AFTER]), axis(signal.label), title=title, shapes=shapes)


def _around_step(run: FloatArray) -> FloatArray:
    time = run[:, 0] - CELL_STEER_TIME
    inside = run[(time >= -BEFORE - 1e-9) & (time <= AFTER + 1e-9)]
    return inside if len(inside) >= 2 else run[:2]


def overview_picture(result: SuiteResult) -> Picture:
    """Return the paper's step and a fast one with the motion of the car, and below them margins and slippery roads."""
    rows: list[list[Chart | None]] = []
    for signal in MOTION_PANELS:
        ends = (result.shown[0], result.shown[-1])
        titles = [f"Step steer, {_cell_title(shown)}" if signal is MOTION_PANELS[0] else "" for shown in ends]
        rows.append([_step_panel(result, shown, signal, title) for shown, title in zip(ends, titles, strict=True)])
    about = ("Margins of the car itself (thin), and the worst of the family without slow cars", "")
    rows.append([_margin_panel(result, *each, title=title) for each, title in zip(MARGIN_PANELS, about, strict=False)])
    heights = [1.5, 1.0, 1.0, 1.3]
    if slippery(result):
        rows.append([_spins_panel(result, (", ", "estimated "), FRICTION_TITLE)])
        heights.append(1.3)
    title = f"The controller under test ({plain(result.tested)}) beside its baselines"
    return Picture(rows, (12.0, 14.6), title, heights)


# --- margins ----------------------------------------------------------------------------------------------------------


def margins_picture(result: SuiteResult) -> Picture:
    """Return gain margin, phase margin and peak sensitivity over speed, of the configured car and the worst of the family
    without its slow cars (`family_margins`)."""
    panels = [_margin_panel(result, label, field, warning, is_alone=True) for label, field, warning in MARGIN_PANELS]
    title = "Margins of the feedback: of the configured car, and the worst of the family without slow cars"
    return Picture([panels], (11.0, 4.4), title)


def _margin_panel(
    result: SuiteResult, label: str, field: str, warning: float | None, title: str = "", is_alone: bool = False
) -> Chart:
    """Return a margin over speed; `is_alone`: with legend entries for all lines, else only for the levels."""
    looks, data = looks_of(result), []
    for name in (name for name in result.subjects if name in result.margins):
        found, colour = result.margins[name], looks[name]["colour"]
        for each, text_, width, more in (
            (found.configured, "the car itself", 1.5, {}),
            (found.points, "worst of the family", 3.0, {"mode": "lines+markers", "marker": {"size": 5.5, "color": colour}}),
        ):
            values = [math.nan if (value := getattr(point, field)) is None else value for point in each]
            drawn = line([point.speed_km_h for point in each], values, f"{plain(name)}: {text_}", colour, width=width)
            data.append({**drawn, **more, "showlegend": is_alone})
    required = getattr(result.limits, field)
    levels = [(required, INK, "dash", "required of the worst car")]
    levels += [] if warning is None else [(warning, MUTED, "dot", "codegen build warns below")]
    data += [entry(name, colour, dash, 1.2) for _, colour, dash, name in levels]
    y = axis(label, rangemode="tozero") if warning is not None else axis(label, range=[1.0, SENSITIVITY_TOP])
    shapes = [level(value, colour=colour, dash=dash) for value, colour, dash, _ in levels]
    return panel(data, axis(SPEED_TITLE), y, title=title, shapes=shapes)


# --- cells and conditions ---------------------------------------------------------------------------------------------


def cells_picture(result: SuiteResult) -> Picture:
    """Return the overshoot in every cell as configured and with the largest actuator lag, one panel for each subject."""
    names = {"nominal", "relaxation-300", *[each.name for each in result.conditions if each.group == "lag"][-1:]}
    wanted = [condition for condition in result.conditions if condition.name in names] or list(result.conditions[:1])
    rows = [
        [
            _cells_panel(result.results[name][each.name], f"{each.title}<br>{SPEED_TITLE}", plain(name) * (k == 0))
            for name in result.subjects
        ]
        for k, each in enumerate(wanted)
    ]
    title = "Overshoot (%) of step steers over speed and share of the largest feasible front angle"
    return Picture(rows, (2.35 * len(result.subjects) + 0.6, 2.5 * len(wanted) + 1.1), title)


def _cells_panel(results: Sequence[CellResult], label: str, title: str) -> Chart:
    speeds = list(dict.fromkeys(one.cell.speed_km_h for one in results))
    shares = list(dict.fromkeys(one.cell.share for one in results))
    codes, said = np.zeros((len(shares), len(speeds)), dtype=np.uint8), []
    is_known = np.zeros(codes.shape, dtype=np.bool_)
    for one in results:
        place = shares.index(one.cell.share), speeds.index(one.cell.speed_km_h)
        value = math.nan if one.overshoot_percent is None else one.overshoot_percent
        codes[place] = len(SHADE_LEVELS) if one.spun else max(int(np.searchsorted(SHADE_LEVELS, value, side="right")) - 1, 0)
        is_known[place] = one.spun or not math.isnan(value)
        is_dark = one.spun or value >= SHADE_LEVELS[-1]
        words = "spin" if one.spun else f"{value:.1f}" if value < 9.95 else f"{value:.0f}"
        said.append((*place, words, WHITE if is_dark else INK))
    bounds = [f"{each:g}" for each in SHADE_LEVELS]
    names = [*(f"{low} to {high} %" for low, high in pairwise(bounds)), f"above {bounds[-1]} %", "the car spins"]
    colours = (*LEVEL_COLOURS, SPIN_FACE)
    at = (np.arange(len(shares), dtype=np.float64), np.arange(len(speeds), dtype=np.float64))
    data = [category_trace(*at, codes, ~is_known, names, colours), *patches(names, colours)]
    for tone in (INK, WHITE):
        own = [each for each in said if each[3] == tone]
        marks = points([each[0] for each in own], [each[1] for each in own], "", tone)
        data.append({**marks, "mode": "text", "text": [each[2] for each in own], "textfont": {"color": tone}})
    ticks = {"showgrid": False, "ticks": ""}
    x_axis = axis(
        "Share of the angle (%)", tickvals=at[0].tolist(), ticktext=[f"{100.0 * (each or 0.0):g}" for each in shares], **ticks
    )
    y_axis = axis(label, tickvals=at[1].tolist(), ticktext=[f"{each:g}" for each in speeds], **ticks)
    x_axis["range"], y_axis["range"] = [-0.5, len(shares) - 0.5], [-0.5, len(speeds) - 0.5]
    edges = [upright(k - 0.5, WHITE, "solid") for k in range(1, len(shares))]
    return panel(
        data, x_axis, y_axis, title=title, shapes=edges + [level(k - 0.5, "y", WHITE, "solid") for k in range(1, len(speeds))]
    )


def conditions_picture(result: SuiteResult) -> Picture:
    """Return the largest overshoot, sideslip and map error over the cells, and spins: a row for each condition."""
    panels = (
        (lambda each: each.overshoot_percent and symlog(each.overshoot_percent.value), _overshoot_axis(result)),
        (lambda each: each.sideslip_max_deg and each.sideslip_max_deg.value, axis("Largest |sideslip| (deg)")),
        (lambda each: each.map_error_percent and each.map_error_percent.value, axis("Error to the map, steady (%)")),
        (lambda each: float(len(each.spins)) or None, axis(f"Spins, of {len(result.cells)} cells<br>(no mark: none)")),
    )
    count = len(result.conditions)
    bands: Traces = [
        {
            "type": "rect",
            "xref": "paper",
            "x0": 0,
            "x1": 1,
            "y0": k - 0.5,
            "y1": k + 0.5,
            "fillcolor": ROW_FACE,
            "layer": "below",
        }
        for k in range(0, count, 2)
    ]
    charts = []
    for k, (figure_of, x) in enumerate(panels):
        titles = [each.title if k == 0 else "" for each in result.conditions]
        y = axis("", tickvals=list(range(count)), ticktext=titles, range=[count - 0.5, -0.5], showgrid=False, ticks="")
        zero = [upright(0.0, dash="solid", width=1.0)] if k == 2 else []
        marks = _condition_marks(result, figure_of)
        charts.append(panel(marks, {"range": _room(marks), **x}, y, shapes=bands + zero))
    title = "All cells under each condition; all but the spins are of those in which the car stays on the road"
    return Picture([charts], (13.0, 0.34 * count + 1.6), title, widths=(1.3, 1.0, 1.0, 0.8))


def _room(marks: Traces) -> list[float]:
    """Return a range of x with zero and all marks, and space for the outermost."""
    values = np.concatenate([[0.0], *(trace["x"] for trace in marks)])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    space = 0.04 * ((high - low) or 1.0)
    return [low - space, high + space]


def _overshoot_axis(result: SuiteResult) -> dict[str, Any]:
    """Return an axis for transformed values: logarithmic above 1 %."""
    ticks = {"tickvals": [symlog(tick) for tick in OVERSHOOT_TICKS], "ticktext": [f"{tick:g}" for tick in OVERSHOOT_TICKS]}
    found = [result.summary(name, each.name).overshoot_percent for name in result.subjects for each in result.conditions]
    top = max((symlog(each.value) for each in found if each is not None), default=1.0)
    return axis("Largest overshoot (%)", range=[-0.12, top + 0.12], **ticks)


def _condition_marks(result: SuiteResult, figure_of: Callable[[Any], float | None]) -> Traces:
    data = []
    for number, ((name, look), symbol) in enumerate(zip(looks_of(result).items(), itertools.cycle(SYMBOLS), strict=False)):
        # Shifted slightly, so that marks of equal values do not cover each other.
        shift = ROW_SHARE * ((number + 0.5) / len(result.subjects) - 0.5)
        found = [figure_of(result.summary(name, condition.name)) for condition in result.conditions]
        values = [math.nan if value is None else value for value in found]
        data.append(points(values, np.arange(len(found)) + shift, plain(name), look["colour"], symbol, 7, cliponaxis=False))
    return data


# --- roads ------------------------------------------------------------------------------------------------------------


def slippery(result: SuiteResult) -> list[Any]:
    """Return the conditions on slippery roads."""
    return [condition for condition in result.conditions if condition.group == "friction"]


def friction_picture(result: SuiteResult) -> Picture:
    """Return the spins, and the largest sideslip of the other cells, on slippery roads with and without an estimate."""
    roads = slippery(result)
    limits = [(place, sideslip_limit(result.limits, road)) for place, road in enumerate(roads)]
    drawn = {"color": INK, "width": 1.2, "dash": "dash"}
    shapes = [
        {"type": "line", "x0": place - 0.45, "x1": place + 0.45, "y0": limit, "y1": limit, "line": drawn}
        for place, limit in limits
        if limit is not None
    ]
    data = _bars(result, lambda each: each.sideslip_max_deg and each.sideslip_max_deg.value, "{:.1f}")
    data.append(entry(f"limit for {plain(result.tested)}", INK, "dash", 1.2))
    label = "Largest |sideslip| (deg)<br>where the car stays on the road"
    below = panel(data, _road_axis(result, (", ",)), axis(label), shapes=shapes)
    return Picture([[_spins_panel(result, (", ",))], [below]], (1.35 * len(roads) + 1.4, 7.0), FRICTION_TITLE)


def _spins_panel(result: SuiteResult, ends: Iterable[str], title: str = "") -> Chart:
    data = _bars(result, lambda each: float(len(each.spins)), "{:.0f}")
    return panel(data, _road_axis(result, ends), axis(f"Spins, of {len(result.cells)} cells"), title=title)


def _bars(result: SuiteResult, figure_of: Callable[[Any], float | None], words: str) -> Traces:
    looks, roads, data = looks_of(result), slippery(result), []
    width = 0.82 / len(result.subjects)
    for place, name in enumerate(result.subjects):
        values = [figure_of(result.summary(name, road.name)) or 0.0 for road in roads]
        at = np.arange(len(roads)) + (place - 0.5 * (len(result.subjects) - 1)) * width
        colour = MUTED if looks[name]["colour"] == INK else looks[name]["colour"]
        bar = {"type": "bar", "x": at, "y": values, "width": 0.92 * width, "marker": {"color": colour}, "name": plain(name)}
        data.append({**bar, "text": [words.format(value) for value in values]})
    return data


def _road_axis(result: SuiteResult, ends: Iterable[str]) -> dict[str, Any]:
    """Return the axis of the roads; lines of their names end after each of `ends`."""
    names = [road.title for road in slippery(result)]
    for end in ends:
        names = [name.replace(end, end.strip(", ") + "<br>") for name in names]
    return axis("", tickvals=list(range(len(names))), ticktext=names, range=[-0.5, len(names) - 0.5], ticks="", showgrid=False)


# --- rise times and sines ---------------------------------------------------------------------------------------------


def price_picture(result: SuiteResult) -> Picture:
    """Return the rise time over speed, and gain and phase of sines at the steering wheel at the highest simulated speed."""
    looks, data = looks_of(result), _names(result)
    fastest = max((row.speed_km_h for row in result.sine[result.tested]), default=None)
    for name in reversed(result.subjects):
        rows = [row for row in result.rise_times.get(name, ()) if row.mean_s is not None]
        data.append(line([row.speed_km_h for row in rows], [row.mean_s for row in rows], name, **looks[name], **_hidden()))
    speeds = list(dict.fromkeys(cell.speed_km_h for cell in result.cells))
    y = axis("Rise time to 90 %, mean over the cells (s)", rangemode="tozero")
    charts = [panel(data, axis(SPEED_TITLE, tickvals=speeds), y)]
    if fastest is not None:
        charts += [_sine_panel(result, fastest, "gain_of_map", "gain over the map's", 1.0)]
        charts += [_sine_panel(result, fastest, "phase_deg", "phase (deg)", 0.0)]
    title = "Response of the yaw rate to the steering wheel, as configured"
    return Picture([charts], (11.0 if fastest is not None else 5.0, 4.2), title)


def _sine_panel(result: SuiteResult, speed: float, field: str, label: str, ideal: float) -> Chart:
    looks, data = looks_of(result), []
    symbols = dict(zip(result.subjects, itertools.cycle(SYMBOLS), strict=False))
    for name in reversed(result.subjects):
        rows = [row for row in result.sine[name] if row.speed_km_h == speed and row.phase_deg is not None]
        drawn = line(
            [row.frequency_hz for row in rows], [getattr(row, field) for row in rows], name, **looks[name], **_hidden()
        )
        marker = {"symbol": symbols[name], "size": 8, "color": looks[name]["colour"]}
        data.append({**drawn, "mode": "lines+markers", "marker": marker})
    frequencies = list(dict.fromkeys(row.frequency_hz for row in result.sine[result.tested]))
    y = axis(f"Sine at {speed:g} km/h: {label}")
    return panel(data, axis("Frequency (Hz)", tickvals=frequencies), y, shapes=[level(ideal, dash="dash")])


# --- references -------------------------------------------------------------------------------------------------------


def _lateral_acceleration(each: CellResult) -> float | None:
    """Return the steady lateral acceleration in m/s^2."""
    steady = each.yaw_rate_steady_deg_s
    return None if steady is None else math.radians(steady) * each.cell.speed_km_h * KM_H


STEP_FIGURES: tuple[tuple[str, Callable[[CellResult], float | None]], ...] = (
    ("Largest overshoot (%)", lambda each: each.overshoot_percent),
    ("Largest rise time (s)", lambda each: each.rise_time_s),
    ("Largest lateral acc., steady (m/s²)", _lateral_acceleration),
    ("Largest |β| (deg)", lambda each: each.sideslip_max_deg),
)


def references_picture(result: ReferencesResult) -> Picture:
    """Return the maps at one front angle above, and figures of the step steers over speed below."""
    looks = looks_of(result.suite)
    grid = next(iter(result.maps.values())).front_angle
    cut = float(np.clip(CUT_FRONT_ANGLE, grid[0], grid[-1]))
    above, below = [], []
    for k, quantity in enumerate(MAP_QUANTITIES):
        data = _names(result.suite)
        for name, one in reversed(list(result.maps.items())):
            table = quantity.displayed(one)
            if table is not None:
                data.append(line(one.speed / KM_H, at_front_angle(one, table, cut), name, **looks[name], **_hidden()))
        title = f"The maps at δ<sub>f</sub> = {math.degrees(cut):.3g} deg" if k == 0 else ""
        above.append(panel(data, axis(SPEED_TITLE), axis(quantity.label), title=title))
    for k, (label, figure_of) in enumerate(STEP_FIGURES):
        title = "Step steers without a spin" if k == 0 else ""
        below.append(panel(_step_lines(result, figure_of), axis(SPEED_TITLE), axis(label, rangemode="tozero"), title=title))
    return Picture([above, below], (14.0, 7.2), "References under the same controller")


def _step_lines(result: ReferencesResult, figure_of: Callable[[CellResult], float | None]) -> Traces:
    looks, data = looks_of(result.suite), []
    speeds = list(dict.fromkeys(cell.speed_km_h for cell in result.suite.cells))
    for name in reversed(result.suite.subjects):
        cells = result.suite.results[name][NOMINAL.name]
        found = [[figure_of(each) for each in cells if each.cell.speed_km_h == speed] for speed in speeds]
        values = [max((value for value in each if value is not None), default=math.nan) for each in found]
        marker = {"mode": "lines+markers", "marker": {"size": 5.5, "color": looks[name]["colour"]}}
        data.append({**line(speeds, values, name, **looks[name], **_hidden()), **marker})
    return data
