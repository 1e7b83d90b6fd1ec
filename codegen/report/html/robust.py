"""Stable region of each controller's loop over speed, friction and mass: heat maps of its gain margin, and tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from codegen.configuration import Config, preset
from codegen.design.margins import (
    WARN_GAIN_MARGIN_DB,
    WARN_PHASE_MARGIN_DEG,
    family_margins,
    family_range_km_h,
    margin_range_km_h,
    nominal_margins,
)
from codegen.emit.laws import LAWS, law_of
from codegen.figures.data import INK, MUTED, SERIES_COLOURS, SPEED_TITLE, Chart, axis, layout, line, numbers, scale_of
from codegen.figures.maps import colour_bar
from codegen.report.html.page import Block, Gallery, Table, Text
from codegen.sweep.region import MARGIN_SHARES, TURN_SHARE, Region
from codegen.units import KM_H

POINTS, FAMILY_POINTS = 80, 12


def margins_chart(configs: Mapping[str, Config]) -> Chart | None:
    """Plot gain and phase margins over speed, of the configured car and the worst of its family; None without any feedback.

    Args:
        configs: name -> configuration; those without feedback are omitted.
    """
    data: list[dict[str, Any]] = []
    colours = iter(SERIES_COLOURS * len(configs))
    shown = []
    for name, config in configs.items():
        gains = law_of(config).gains(config)
        if gains is None:
            continue
        shown.append(name)
        colour = next(colours)
        for count, dash, whose in ((POINTS, "solid", "the car itself"), (FAMILY_POINTS, "dash", "worst of the family")):
            ends = margin_range_km_h(config) if count == POINTS else family_range_km_h(config)
            speed = np.linspace(*ends, count) * KM_H
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
    first = next(iter(configs.values()))
    asked = first.tuning
    shapes = []
    for row, (wanted, warned) in enumerate(
        ((asked.gain_margin_db, WARN_GAIN_MARGIN_DB), (asked.phase_margin_deg, WARN_PHASE_MARGIN_DEG))
    ):
        for value, dash, colour in ((wanted, "dash", INK), (warned, "dot", MUTED)):
            place = {"xref": "paper", "x0": 0, "x1": 1, "yref": "y" if row == 0 else "y2", "y0": value, "y1": value}
            shapes.append({"type": "line", "line": {"color": colour, "width": 1.2, "dash": dash}, **place})
    look = layout(
        xaxis=axis(SPEED_TITLE, anchor="y2"),
        yaxis=axis("Gain margin (dB)", domain=[0.54, 1.0], rangemode="tozero"),
        yaxis2=axis("Phase margin (deg)", domain=[0.0, 0.46], rangemode="tozero"),
        shapes=shapes,
    )
    caption = (
        f"Margins of the yaw-rate loop over speed, delay {first.designed_delay_samples} sample(s). Both are zero where it "
        "is unstable; a line ends where no change of gain, or of phase, would make it so. "
        f"Level: {asked.gain_margin_db:g} dB and {asked.phase_margin_deg:g} deg that `codegen tune` designs for (dashed), "
        f"{WARN_GAIN_MARGIN_DB:g} dB and {WARN_PHASE_MARGIN_DEG:g} deg below which a build warns (dotted). The worst of "
        "the family is without cars that have both at least twice the lag and a relaxation length, which need "
        f"{asked.slow_gain_margin_db:g} dB and {asked.slow_phase_margin_deg:g} deg."
    )
    return Chart("margins", {"data": data, "layout": look}, caption, f"Margins over speed of {', '.join(shown)}.", 560)


GAIN_MARGIN_SHOWN = 30.0
"""Largest gain margin shown, in dB; larger values would hide small ones."""
GAIN_MARGIN_LINE_DB = 6.0
"""Usual minimum gain margin, in dB."""
NO_FEEDBACK_LABEL = "without feedback"


def region_blocks(regions: Mapping[str, Region]) -> Iterator[Block]:
    """Yield charts and tables for each controller, and the outcome of the simulations."""
    yield Text(
        "CasADi linearises the two-track plant at each speed, friction and mass. The poles and margins of the loop around it "
        "are computed straight ahead, and in a turn at "
        f"{100.0 * TURN_SHARE:.0f} % of the road's grip, with straight rear wheels and without a friction estimate. "
        "Straight ahead, the generated C is then simulated with the nonlinear plant and a small steering pulse in every cell: "
        "it must be stable where the linearised loop is. Every third cell with a gain margin is simulated twice more, with a "
        "factor on the command to the plant's rear actuator, which scales the gain of the loop exactly: at "
        f"{MARGIN_SHARES[0]:g} times the margin it must be stable, at {MARGIN_SHARES[1]:g} times unstable. "
        "The map sets the reference and is not part of the loop, so the region applies to the controller with any map."
    )
    yield Text(
        f"Kinds without feedback ({', '.join(_open_loop())}) have neither loop nor margins: they steer the rear wheels by "
        "speed and front angle alone, so the car is as stable as with its rear wheels held. They therefore have no "
        f'chart; the rows "{NO_FEEDBACK_LABEL}" of the first table apply to all of them.'
    )
    for name, region in regions.items():
        if region.disagreement:
            yield Text(f"{name}: {region.disagreement}.", "notice")
        yield Gallery([_chart(name, region, mass) for mass in range(len(region.masses_percent))], "17rem")
    header = ("controller", "mass", *(f"friction {friction:g}" for friction in _shown(next(iter(regions.values())))))
    yield Table(
        "First speed of the grid at which it is unstable straight ahead, km/h", header, list(_rows(regions)), words=(0,)
    )
    yield Table(
        "Computed, and simulated straight ahead with the generated C", DRIVEN_HEADER, list(_driven(regions)), words=(0, 1)
    )
    yield Table("Least margins of the stable cells", SMALLEST_MARGINS_HEADER, list(_smallest_margins(regions)), words=(0, 1))


SMALLEST_MARGINS_HEADER = ("controller", "where", "cells", "stable", "gain margin (dB)", "phase margin (deg)")


DRIVEN_HEADER = ("controller", "what", "cells", "undecided", "as computed", "contradicted")


def _driven(regions: Mapping[str, Region]) -> Iterator[tuple[str, ...]]:
    for name, region in regions.items():
        if region.driven is None:
            yield name, "not simulated", "0", "-", "-", "-"
            continue
        every = np.ones_like(region.stable)
        shares = " and ".join(f"{share:g}" for share in MARGIN_SHARES)
        for what, cells, undecided, contradicted in (
            ("stable or not", every, region.undecided, region.contradicted),
            (f"gain margin, at {shares} times", region.margin_sample, region.margin_undecided, region.margin_contradicted),
        ):
            total, near, otherwise = (int(chosen.sum()) for chosen in (cells, undecided, contradicted))
            yield name, what, str(total), str(near), str(total - near - otherwise), str(otherwise)


def _shown(region: Region) -> tuple[float, ...]:
    return region.frictions[::2]


def _open_loop() -> Iterator[str]:
    """Yield the kinds of controller without feedback."""
    paper = preset()
    yield from (kind for kind, law in LAWS.items() if not law.scheduled and law.gains(paper) is None)


def _rows(regions: Mapping[str, Region]) -> Iterator[tuple[str, ...]]:
    first = next(iter(regions.values()))
    shown = [(name, region, True) for name, region in regions.items()]
    for name, region, feedback in (*shown, (NO_FEEDBACK_LABEL, first, False)):
        for place, mass in enumerate(region.masses_percent):
            found = [region.unstable_from(place, at, feedback) for at in range(0, len(region.frictions), 2)]
            last = f"not up to {region.speeds_km_h[-1]:g}"
            yield (
                name,
                f"{mass:+g} %" if mass else "as configured",
                *(last if speed is None else f"{speed:g}" for speed in found),
            )


def _smallest_margins(regions: Mapping[str, Region]) -> Iterator[tuple[str, ...]]:
    for name, region in regions.items():
        every = np.ones_like(region.stable)
        for where, chosen, stable, gain, phase in (
            ("straight ahead", every, region.stable, region.gain_margin_db, region.phase_margin_deg),
            ("in the turn", region.turn_found, region.turn_stable, region.turn_gain_margin_db, region.turn_phase_margin_deg),
        ):
            count = int(chosen.sum())
            least = (
                f"{np.nanmin(values[chosen & stable]):.1f}" if (chosen & stable).any() else "-" for values in (gain, phase)
            )
            yield name, where, str(count), str(int(stable[chosen].sum())), *least


def _chart(name: str, region: Region, mass: int) -> Chart:
    margin = np.minimum(region.gain_margin_db[mass], GAIN_MARGIN_SHOWN)
    percent = region.masses_percent[mass]
    weight = f"mass {percent:+g} %" if percent else "mass as configured"
    look = {"x": list(region.speeds_km_h), "y": list(region.frictions)}
    data: list[dict[str, Any]] = [
        {
            "type": "heatmap",
            **look,
            "z": numbers(margin),
            "zmin": 0.0,
            "zmax": GAIN_MARGIN_SHOWN,
            "colorscale": scale_of("viridis"),
            "colorbar": {**colour_bar("gain margin (dB)"), "orientation": "h", "y": -0.28, "yanchor": "top"},
            "hovertemplate": f"{name}, {weight}: %{{z:.1f}} dB<br>%{{x:.0f}} km/h, friction %{{y:g}}<extra></extra>",
        },
        {
            "type": "contour",
            **look,
            "z": numbers(margin),
            "contours": {
                "coloring": "lines",
                "start": GAIN_MARGIN_LINE_DB,
                "end": GAIN_MARGIN_LINE_DB,
                "size": 1,
                "showlabels": False,
            },
            "line": {"width": 2},
            "colorscale": [[0, "white"], [1, "white"]],
            "showscale": False,
            "showlegend": False,
            "hoverinfo": "skip",
        },
    ]
    told = (
        [f"line: {GAIN_MARGIN_LINE_DB:g} dB"]
        if (margin < GAIN_MARGIN_LINE_DB).any() and (margin > GAIN_MARGIN_LINE_DB).any()
        else []
    )
    for title, symbol, sign, cells in _marks(region, mass):
        at = np.argwhere(cells)
        if at.size:
            told.append(f"{sign} {title}")
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": [region.speeds_km_h[column] for _, column in at],
                    "y": [region.frictions[row] for row, _ in at],
                    "name": title,
                    "marker": {"symbol": symbol, "size": 9, "color": "white", "line": {"width": 1.5, "color": "white"}},
                    "hovertemplate": f"{title}<br>%{{x:.0f}} km/h, friction %{{y:g}}<extra></extra>",
                }
            )
    figure = {
        "data": data,
        "layout": layout(
            xaxis=axis(
                SPEED_TITLE, showgrid=False, zeroline=False, range=[region.speeds_km_h[0] - 10.0, region.speeds_km_h[-1] + 10.0]
            ),
            yaxis=axis("Friction of the road", showgrid=False, zeroline=False),
            showlegend=False,
            margin={"l": 60, "r": 20, "t": 20, "b": 120},
        ),
    }
    share = f"{100.0 * region.stable[mass].mean():.0f} % of the cells are stable"
    if region.driven is not None:
        share += f" as computed, and of {100.0 * region.driven[mass].mean():.0f} % as simulated"
    otherwise = int((region.contradicted | region.margin_contradicted)[mass].sum())
    share += f"; contradicted by simulation in {otherwise}" if otherwise else ""
    signs = f"In white: {', '.join(told)}. " if told else ""
    caption = (
        f"{name}, {weight}: gain margin straight ahead; {share}. {signs}More than {GAIN_MARGIN_SHOWN:g} dB is drawn as that."
    )
    return Chart(f"region-{name}-{mass}", figure, caption, caption, 400)


def _marks(region: Region, mass: int) -> Iterator[tuple[str, str, str, Any]]:
    """Yield name, symbol, its sign in a text, and the cells of each mark."""
    yield "unstable", "x-thin", "×", ~region.stable[mass]
    if region.driven is not None:
        yield "simulation contradicts", "diamond", "◆", region.contradicted[mass]
        yield "simulation contradicts the gain margin", "diamond-open", "◇", region.margin_contradicted[mass]
        yield "undecided, near the border", "square-open", "□", (region.undecided | region.margin_undecided)[mass]
    yield "unstable in the turn", "circle-open", "○", region.stable[mass] & region.turn_found[mass] & ~region.turn_stable[mass]
