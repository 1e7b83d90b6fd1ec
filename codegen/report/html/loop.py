"""Stability margins of the yaw-rate loop over speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG, family_margins, nominal_margins
from codegen.emit.laws import law_of
from codegen.report.html.blocks import INK, MUTED, Chart
from codegen.report.html.charts import axis, layout, line
from codegen.report.html.maps import SPEED
from codegen.report.run_plots import RUN_COLOURS
from codegen.units import KM_H

POINTS, FAMILY_POINTS = 80, 12


def margins_chart(configs: Mapping[str, Config]) -> Chart | None:
    """Gain and phase margins over speed, of the configured car and the worst of its family; None where nothing has feedback.

    Args:
        configs: name to configuration; those whose law has no feedback are left out.
    """
    data: list[dict[str, Any]] = []
    colours = iter(RUN_COLOURS * len(configs))
    shown = []
    for name, config in configs.items():
        gains = law_of(config).gains(config)
        if gains is None:
            continue
        shown.append(name)
        colour = next(colours)
        first = config.controller.enable_speed_km_h * KM_H
        last = max(config.tuning.speed_km_h) * KM_H
        for count, dash, whose in ((POINTS, "solid", "the car itself"), (FAMILY_POINTS, "dash", "worst of the family")):
            speed = np.linspace(first, last, count)
            if count == POINTS:
                margins = nominal_margins(config, speed, *gains(speed))
            else:
                margins, _ = family_margins(config, speed, *gains(speed))
            for row, values in enumerate((margins.gain_margin_db, margins.phase_margin_deg)):
                unit = ("dB", "deg")[row]
                finite = np.where(np.isfinite(values), values, np.nan)
                told = f"{name}, {whose}: %{{y:.1f}} {unit} at %{{x:.0f}} km/h<extra></extra>"
                where = {"yaxis": "y" if row == 0 else "y2", "legendgroup": f"{name}{dash}", "showlegend": row == 0}
                data.append(line(speed / KM_H, finite, f"{name}, {whose}", colour, dash=dash, hovertemplate=told, **where))
    if not shown:
        return None
    asked = next(iter(configs.values())).tuning
    shapes = []
    for row, (wanted, warned) in enumerate(
        ((asked.gain_margin_db, WARN_GAIN_MARGIN_DB), (asked.phase_margin_deg, WARN_PHASE_MARGIN_DEG))
    ):
        for value, dash, colour in ((wanted, "dash", INK), (warned, "dot", MUTED)):
            place = {"xref": "paper", "x0": 0, "x1": 1, "yref": "y" if row == 0 else "y2", "y0": value, "y1": value}
            shapes.append({"type": "line", "line": {"color": colour, "width": 1.2, "dash": dash}, **place})
    look = layout(
        xaxis=axis(SPEED, anchor="y2"),
        yaxis=axis("Gain margin (dB)", domain=[0.54, 1.0], rangemode="tozero"),
        yaxis2=axis("Phase margin (deg)", domain=[0.0, 0.46], rangemode="tozero"),
        shapes=shapes,
    )
    caption = (
        f"Margins of the yaw-rate loop over speed, delay {asked.delay_samples} sample(s). Both are zero where it is unstable; "
        "a line ends where no change of gain, or of phase, would make it so. "
        f"Level: {asked.gain_margin_db:g} dB and {asked.phase_margin_deg:g} deg that `codegen tune` designs for (dashed), "
        f"{WARN_GAIN_MARGIN_DB:g} dB and {WARN_PHASE_MARGIN_DEG:g} deg below which a build warns (dotted)."
    )
    return Chart("margins", {"data": data, "layout": look}, caption, f"Margins over speed of {', '.join(shown)}.", 560)
