"""Sections of the report of `codegen identify --plan`: drives, predicted uncertainties, what is not determined."""

from __future__ import annotations

import math
from collections.abc import Sequence

from codegen.figures.data import BLUE, GREEN, MUTED, VERMILION, Chart, axis, layout, line
from codegen.identify.candidates import Candidate
from codegen.identify.drive_plan import DrivePlan
from codegen.identify.identifiability import DETERMINED_SHARE_MAX
from codegen.identify.plan_output import DRIVE_HEADER, PREDICTED_HEADER, drive_rows, need_lines, predicted_rows
from codegen.report.html.blocks import Block, Gallery, Section, Table, Text
from codegen.units import DEGREE, KM_H


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
