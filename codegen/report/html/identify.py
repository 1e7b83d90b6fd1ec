"""Sections of the report of `codegen identify`: values, prediction of drives, tyre curves, spread of the map, measured data.

With `--plan` instead: drives, predicted uncertainties, and what is not determined.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.figures.data import BLUE, GREEN, MUTED, VERMILION, Chart, axis, layout, line, numbers, scale_of
from codegen.identify.candidates import Candidate
from codegen.identify.drive_plan import DrivePlan
from codegen.identify.identifiability import DETERMINED_SHARE_MAX
from codegen.identify.map_spread import map_spread
from codegen.identify.model import OUTPUTS
from codegen.identify.outcome import Outcome
from codegen.identify.plan_output import DRIVE_HEADER, PREDICTED_HEADER, drive_rows, need_lines, predicted_rows
from codegen.identify.reached import Reached
from codegen.identify.reading import Reading
from codegen.identify.run import Identification
from codegen.identify.summary import (
    FINDING_HEADER,
    QUANTITY_HEADER,
    SIGNAL_HEADER,
    VALIDATION_HEADER,
    WHITENESS_HEADER,
    finding_rows,
    quantity_rows,
    reached_lines,
    signal_rows,
    significant,
    validation_rows,
    whiteness_rows,
)
from codegen.identify.validation import Validation
from codegen.report.html.page import Block, Gallery, Section, Table, Text
from codegen.units import DEGREE, KM_H
from codegen.vehicle.population import BAND, BAND_SHARE, draw
from codegen.vehicle.tyre import AxleTyres

POINTS_MAX = 3_000
"""Points of a line over time: more do not show."""
CURVE_POINTS = 200
CURVE_END_DEG = 12.0
BAND_CARS = 1_000
"""Cars that are drawn for the bands of the tyre curves."""
BANDS = ((BLUE, "rgba(0, 114, 178, 0.25)"), (VERMILION, "rgba(213, 94, 0, 0.25)"), (GREEN, "rgba(0, 158, 115, 0.25)"))
"""Colour of the line and of the band for each speed."""


def identify_sections(outcome: Outcome, identified: Config) -> list[Section]:
    """Return the sections.

    Args:
        identified: configuration with the identified values.
    """
    found = outcome.found
    return [
        Section("values", "Identified values", list(_values(outcome)), is_open=True),
        Section("prediction", "Prediction of drives", list(_prediction(outcome)), is_open=True),
        Section("tyres", "Tyre curves", [Gallery(_curves(found, identified, outcome.reached))], is_open=True),
        Section("map", "Spread of the map", list(_spread(identified)), is_open=True),
        Section("correlation", "Correlation", [_correlation(found)]),
    ]


def data_section(reading: Reading) -> Section:
    """Return the section of the signals of all drives and of the findings about their data."""
    blocks: list[Block] = [Table("Signals of the drives", SIGNAL_HEADER, signal_rows(reading), words=(0, 1, 2, 3))]
    if reading.findings:
        caption = "Findings: lost samples have no value in the identification"
        blocks.append(Table(caption, FINDING_HEADER, finding_rows(reading), words=(0, 1, 2, 4)))
    else:
        blocks.append(Text("No findings."))
    return Section("signals", "Measured data", blocks, is_open=True)


def _spread(identified: Config) -> Iterator[Block]:
    try:
        spread = map_spread(identified)
    except CodegenError as error:
        yield Text(f"There is no map of the identified car: {error}.", "notice")
        return
    if spread is None:
        yield Text("No case steers the rear wheels, or nothing was determined.", "notice")
        return
    if spread.failed:
        yield Text(f"{spread.failed} of {spread.cars} drawn cars have no map on this grid.", "notice")
    data: list[dict[str, Any]] = []
    angle = spread.front_angle / DEGREE
    for speed, nominal, low, high, (colour, shade) in zip(
        spread.speed, spread.nominal, spread.low, spread.high, cycle(BANDS), strict=False
    ):
        known = np.isfinite(low)
        name = f"{speed / KM_H:.0f} km/h"
        edge = {"legendgroup": name, "showlegend": False, "hoverinfo": "skip", "width": 0}
        data += [
            line(angle[known], low[known] / DEGREE, name, colour, **edge),
            line(angle[known], high[known] / DEGREE, name, colour, fill="tonexty", fillcolor=shade, **edge),
            line(angle, nominal / DEGREE, name, colour, legendgroup=name),
        ]
    look = layout(xaxis=axis("Front angle (deg)"), yaxis=axis("Yaw rate (deg/s)", rangemode="tozero"))
    caption = (
        f"Yaw rate of the case {spread.case}. Lines: the identified car. Bands: {100.0 * BAND_SHARE:g} % of "
        f"{spread.cars} cars drawn from the values, standard deviations and correlations above, no key with less than "
        f"±{identified.identified.interval_floor_percent:g} %. A line ends where its car has "
        "no feasible turn, a band where half of the cars have none. The line need not lie in the middle: a limit that one car "
        "meets first is another one for another car."
    )
    yield Chart("spread", {"data": data, "layout": look}, caption, caption)
    width = (spread.high - spread.low) / DEGREE
    rows = [
        (f"{speed / KM_H:.0f}", *(f"{value:.2f}" for value in (np.nanmax(each), np.nanmean(each))))
        for speed, each in zip(spread.speed, width, strict=True)
        if np.isfinite(each).any()
    ]
    yield Table("Width of the bands", ("speed (km/h)", "largest (deg/s)", "mean (deg/s)"), rows, words=())
    yield Text("`codegen solve --uncertain 0.99` solves a map whose limits 99 % of such cars keep.")


def _values(outcome: Outcome) -> Sequence[Block]:
    found = outcome.found
    rows = quantity_rows(found)
    blocks: list[Block] = [
        Table(
            "Values with their 95 % intervals; a dash: not determined by the drives; parentheses: an assumed interval",
            QUANTITY_HEADER,
            rows,
            words=(0, 3, 5),
        )
    ]
    if found.directions:
        texts = [
            (direction.text, f"{100.0 * direction.share:.0f} %", significant(direction.singular_value, 2))
            for direction in found.directions
        ]
        caption = (
            "What these drives do not determine. Left: its standard deviation as a fraction of that before the drives. Effect: "
            "by how many standard deviations of the noise one standard deviation before changes the drives (singular value)"
        )
        blocks.append(Table(caption, ("combination", "left", "effect"), texts))
    blocks += [Text(f"In doubt: {doubt}.", "notice") for doubt in outcome.doubts]
    blocks += [Text(note, "notice") for note in found.notes]
    blocks += [Text(text) for text in reached_lines(outcome)]
    return blocks


def _prediction(outcome: Outcome) -> Sequence[Block]:
    blocks: list[Block] = []
    if not outcome.is_held_out:
        blocks.append(Text("No drive was held out: the values were identified from these drives.", "notice"))
    caption = (
        "Errors of the yaw rate, simulated from speed and steering angles alone (free run) and one sample ahead (one step); "
        "the measured yaw rate itself; and the errors of the lateral acceleration in the free run. rms: root mean square"
    )
    blocks.append(Table(caption, VALIDATION_HEADER, validation_rows(outcome.validations), words=(0, 1)))
    for number, each in enumerate(outcome.validations):
        blocks.append(Gallery(list(_run_charts(each, f"run-{number}"))))
        blocks.append(
            Table(f"Whiteness of the errors in {each.name} (Ljung-Box)", WHITENESS_HEADER, whiteness_rows(each), words=(0, 5))
        )
    return blocks


def _run_charts(one: Validation, name: str) -> Iterator[Chart]:
    """Yield a chart for each measured output."""
    run, before = one.identified, one.configured
    every = max(1, math.ceil(run.time.size / POINTS_MAX))
    for k, output in enumerate(OUTPUTS):
        if not np.isfinite(run.measured[:, k]).any():
            continue
        title = output.replace("_", " ").capitalize()
        unit, size = ("m/s²", 1.0) if output == "lateral_acceleration" else ("deg/s" if output == "yaw_rate" else "deg", DEGREE)
        data = [
            line(run.time[::every], run.measured[::every, k] / size, "measured", MUTED),
            line(run.time[::every], run.simulated[::every, k] / size, "identified", BLUE),
            line(before.time[::every], before.simulated[::every, k] / size, "configured", VERMILION, dash="dot", width=1),
        ]
        look = layout(xaxis=axis("Time (s)"), yaxis=axis(f"{title} ({unit})"))
        caption = f"{title} in {one.name}: measured, and simulated from the measured speed and steering angles."
        yield Chart(f"{name}-{output}", {"data": data, "layout": look}, caption, caption)


def _curves(found: Identification, identified: Config, one: Reached) -> list[Chart]:
    before, after = AxleTyres.from_config(found.config), AxleTyres.from_config(identified)
    drawn = [AxleTyres.from_config(car) for car in draw(identified, BAND_CARS, 1)] if identified.identified.keys else []
    charts = []
    for axle, slip in zip(("front", "rear"), one.slip, strict=True):
        slips = np.linspace(0.0, max(CURVE_END_DEG * DEGREE, 1.2 * slip), CURVE_POINTS)

        def force(tyres: AxleTyres, axle: str = axle, slips: FloatArray = slips) -> FloatArray:
            result: FloatArray = 2e-3 * getattr(tyres, axle).force(slips)
            return result

        data: list[dict[str, Any]] = []
        if drawn:
            low, high = np.quantile([force(tyres) for tyres in drawn], BAND, axis=0)
            look = {"fill": "toself", "fillcolor": BANDS[0][1], "hoverinfo": "skip", "width": 0}
            edges = np.concatenate([low, high[::-1]])
            data.append(
                line(np.concatenate([slips, slips[::-1]]) / DEGREE, edges, f"{100.0 * BAND_SHARE:g} % band", BLUE, **look)
            )
        data += [
            line(slips / DEGREE, force(after), "identified", BLUE),
            line(slips / DEGREE, force(before), "configured", VERMILION, dash="dot"),
        ]
        edge = {"type": "line", "x0": slip / DEGREE, "x1": slip / DEGREE, "yref": "paper", "y0": 0, "y1": 1}
        shapes = [{**edge, "line": {"color": MUTED, "width": 1, "dash": "dash"}}]
        look = layout(xaxis=axis("Slip angle (deg)"), yaxis=axis("Side force (kN)", rangemode="tozero"), shapes=shapes)
        caption = f"Side force of the {axle} axle at static load. The dashed line is the largest slip of the drives."
        if drawn:
            caption += " The band has the curves of 95 % of the cars drawn from [identified], at each slip."
            caption += f" No key varies less than ±{identified.identified.interval_floor_percent:g} %."
        charts.append(Chart(f"curve-{axle}", {"data": data, "layout": look}, caption, caption))
    return charts


def _correlation(found: Identification) -> Chart:
    titles = [found.quantities[name].parameter.title for name in found.names]
    heat = {
        "type": "heatmap",
        "x": titles,
        "y": titles,
        "z": numbers(found.correlation),
        "zmin": -1,
        "zmax": 1,
        "colorscale": scale_of("coolwarm"),
        "hovertemplate": "%{x}, %{y}: %{z:.2f}<extra></extra>",
    }
    look = layout(
        xaxis=axis("", tickangle=-45), yaxis=axis("", autorange="reversed"), margin={"l": 160, "r": 20, "t": 30, "b": 140}
    )
    caption = "Correlation of the identified values. Close to 1 or -1: the drives hardly tell the two apart."
    return Chart("correlations", {"data": [heat], "layout": look}, caption, caption, 620)


def plan_sections(plan: DrivePlan) -> list[Section]:
    """Return the sections."""
    return [
        Section("drives", "Drives", list(_drives(plan)), is_open=True),
        Section("uncertainty", "Predicted uncertainty", list(_uncertainty(plan)), is_open=True),
    ]


def _drives(plan: DrivePlan) -> Sequence[Block]:
    caption = f"Drives within {plan.lateral_acceleration_max:g} m/s² of lateral acceleration"
    same: dict[int, list[int]] = {}
    for number, one in enumerate(plan.drives):
        same.setdefault(id(one), []).append(number)
    charts = [_drive_chart([plan.names[k] for k in numbers], plan.drives[numbers[0]], plan) for numbers in same.values()]
    return [Table(caption, DRIVE_HEADER, drive_rows(plan), words=(0, 1)), Gallery(charts)]


def _drive_chart(names: Sequence[str], one: Candidate, plan: DrivePlan) -> Chart:
    """Return the chart of a drive, and of those that repeat it."""
    name = names[0] if len(names) == 1 else f"{names[0]}, {len(names)} times"
    signals, time, limit = one.drive.signals, one.drive.time, plan.lateral_acceleration_max
    data = [
        line(time, signals["delta_f"] / DEGREE, "front wheels", BLUE),
        line(time, signals["delta_r_command"] / DEGREE, "rear angle command", GREEN),
        line(time, signals["lateral_acceleration"], "lateral acceleration", VERMILION, yaxis="y2"),
    ]
    edges = [
        {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y2", "y0": side * limit, "y1": side * limit}
        for side in (-1.0, 1.0)
    ]
    look = layout(
        xaxis=axis("Time (s)", anchor="y2"),
        yaxis=axis("Angle (deg)", domain=[0.55, 1.0]),
        yaxis2=axis("m/s²", domain=[0.0, 0.45], range=[-1.2 * limit, 1.2 * limit]),
        shapes=[{**edge, "line": {"color": MUTED, "width": 1, "dash": "dash"}} for edge in edges],
    )
    caption = f"{name}: {one.manoeuvre.what}, {one.speed / KM_H:.0f} km/h. Dashed: the limit of the lateral acceleration."
    return Chart(f"drive-{names[0]}", {"data": data, "layout": look}, caption, caption)


def _uncertainty(plan: DrivePlan) -> Sequence[Block]:
    blocks: list[Block] = [_bars(plan)]
    caption = "Standard deviations that the identification of these drives will have, if the car is the configured one"
    verdicts = {"yes": "good", "no": "bad"}
    blocks.append(Table(caption, PREDICTED_HEADER, predicted_rows(plan), words=(0, 2, 5), verdicts=verdicts))
    blocks += [Text(f"Not determined: {text}.", "notice") for text in need_lines(plan)]
    return blocks


def _bars(plan: DrivePlan) -> Chart:
    known = [each for each in plan.quantities if math.isfinite(each.standard_deviation)][::-1]
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": [100.0 * each.share for each in known],
        "y": [each.parameter.title for each in known],
        "marker": {"color": [BLUE if each.is_determined else VERMILION for each in known]},
        "hovertemplate": "%{y}: %{x:.2g} %<extra></extra>",
    }
    lowest = math.floor(math.log10(100.0 * min(each.share for each in known)))
    edge = {
        "type": "line",
        "x0": 100.0 * DETERMINED_SHARE_MAX,
        "x1": 100.0 * DETERMINED_SHARE_MAX,
        "yref": "paper",
        "y0": 0,
        "y1": 1,
    }
    look = layout(
        xaxis=axis("Standard deviation, % of that before the drives", type="log", range=[lowest, 2.05], dtick=1),
        yaxis=axis(""),
        shapes=[{**edge, "line": {"color": MUTED, "width": 1, "dash": "dash"}}],
        margin={"l": 190, "r": 20, "t": 30, "b": 50},
    )
    caption = (
        f"Predicted standard deviation of each quantity. Left of the dashed line, at {100.0 * DETERMINED_SHARE_MAX:.0f} %, "
        "it is determined; a tyre curve is determined with its D."
    )
    return Chart("uncertainty", {"data": [bars], "layout": look}, caption, caption, 640)
