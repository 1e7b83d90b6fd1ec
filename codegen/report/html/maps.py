"""Charts of a map: heat maps, binding constraints, cuts, and the loss of the rear steering."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.loss import MODES, LossOfFunction, loss_of_function
from codegen.map_file.bounds import binding_text
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ALL_BINDING, BindingArray
from codegen.report.html.blocks import (
    EMPTY,
    INK,
    Block,
    Chart,
    Cuts,
    Gallery,
    Text,
    axis,
    layout,
    numbers,
    patches,
    scale_of,
    small,
)
from codegen.report.map_plots import binding_colours
from codegen.report.style import BLACK, QUANTITIES, SKY, VERMILION, WHITE, Quantity, phase_lines
from codegen.report.summary import tyre_note
from codegen.units import KM_H

SPEED, FRONT_ANGLE = "Speed vx (km/h)", "Front angle δf (deg)"
INFEASIBLE = "grey: no steady turn inside the limits"


@dataclass(frozen=True)
class NamedMap:
    """A map and its name in the report."""

    name: str
    map: ReferenceMap

    @property
    def title(self) -> str:
        """Name, with the tyre of the optimisation if it is not linear, for captions and legends."""
        return f"{self.name}{tyre_note(self.map.tyre_model)}"

    @property
    def speed_km_h(self) -> FloatArray:
        """Speeds (n,) in km/h."""
        return np.asarray(self.map.speed / KM_H)

    @property
    def front_angle_deg(self) -> FloatArray:
        """Front angles (m,) in deg."""
        return np.degrees(self.map.front_angle)


def colour_limits(tables: Sequence[FloatArray], diverging: bool = False) -> tuple[float, float]:
    """Return the ends of a colour scale that several tables share; `diverging` ones are centred at zero."""
    finite = [float(np.nanmax(np.abs(table))) for table in tables if np.isfinite(table).any()]
    largest = max([*finite, 1e-6])
    return (-largest if diverging else 0.0), largest


def heat_maps(one: NamedMap) -> Gallery:
    """Plot yaw rate, sideslip, rear angle and binding constraints as far as available, with the line of phase conversion."""
    tables = ((quantity, quantity.degrees(one.map)) for quantity in QUANTITIES)
    charts = [_heat_map(one, quantity, table) for quantity, table in tables if table is not None]
    if one.map.active is not None:
        charts.append(_binding(one, one.map.active))
    return Gallery(charts)


def _heat_map(one: NamedMap, quantity: Quantity, table: FloatArray) -> Chart:
    limits = colour_limits([table], quantity.diverging)
    trace = heat_map(one, table, quantity.plain_name, quantity.unit, quantity.colours, limits)
    finite = table[np.isfinite(table)]
    span = f"{finite.min():.3g} to {finite.max():.3g} {quantity.unit}" if finite.size else "nowhere feasible"
    spoken = f"Heat map of {quantity.plain_name} over speed and front angle: {span}."
    lines = _phase_traces(one.map)
    figure = {"data": [trace, *lines], "layout": map_layout(one, legend=bool(lines))}
    name = f"map-{quantity.attribute.replace('_', '-')}"
    hidden = "" if one.map.feasible.all() else f"; {INFEASIBLE}"
    return Chart(name, figure, f"{quantity.plain_name}, {span}{hidden}.", spoken, 420)


def heat_map(
    one: NamedMap, table: FloatArray, title: str, unit: str, colours: str, limits: tuple[float, float]
) -> dict[str, Any]:
    """Return a heat map of a table (n, m) over the axes of a map."""
    return {
        "type": "heatmap",
        "x": numbers(one.speed_km_h),
        "y": numbers(one.front_angle_deg),
        "z": numbers(table.T),
        "zmin": limits[0],
        "zmax": limits[1],
        "colorscale": scale_of(colours),
        "colorbar": colour_bar(unit),
        "hoverongaps": False,
        "hovertemplate": f"{title}: %{{z:.3f}} {unit}<br>vx %{{x:.1f}} km/h, δf %{{y:.2f}} deg<extra></extra>",
    }


def colour_bar(unit: str) -> dict[str, Any]:
    """Return the colour bar of a heat map."""
    return {"title": {"text": unit, "side": "top"}, "thickness": 14, "outlinewidth": 0, "len": 1.0}


def map_layout(one: NamedMap, legend: bool = True) -> dict[str, Any]:
    """Return the layout of a chart over speed and front angle. Its background shows infeasible cells."""
    speed, angle = one.speed_km_h, one.front_angle_deg
    return layout(
        xaxis=axis(SPEED, range=[float(speed[0]), float(speed[-1])], showgrid=False, zeroline=False),
        yaxis=axis(FRONT_ANGLE, range=[0.0, float(angle[-1])], showgrid=False, zeroline=False),
        plot_bgcolor=EMPTY,
        showlegend=legend,
    )


def _phase_traces(one: ReferenceMap) -> list[dict[str, Any]]:
    """Return the line delta_r = 0, dark with a light rim, visible on any colour."""
    pieces = phase_lines(one)
    if not pieces:
        return []
    gap = np.full((1, 2), np.nan)
    points = np.concatenate([part for piece in pieces for part in (piece, gap)])
    common = {"type": "scatter", "mode": "lines", "x": numbers(points[:, 0]), "y": numbers(points[:, 1]), "hoverinfo": "skip"}
    return [
        {**common, "line": {"color": WHITE, "width": 5}, "showlegend": False},
        {**common, "line": {"color": BLACK, "width": 2}, "showlegend": False},
        {**common, "x": [None], "y": [None], "line": {"color": INK, "width": 2}, "name": "δr = 0"},
    ]


def _binding(one: NamedMap, active: BindingArray) -> Chart:
    found, count = np.unique(active[one.map.feasible], return_counts=True)
    flags = found[np.argsort(-count, kind="stable")].tolist()
    names, colours = [binding_text(flag) for flag in flags], binding_colours(flags)
    index = np.zeros(ALL_BINDING + 1, dtype=np.uint8)
    index[flags] = np.arange(len(flags))
    codes = np.where(one.map.feasible, index[active], 0).astype(np.uint8)
    trace = category_trace(one.speed_km_h, one.front_angle_deg, codes, ~one.map.feasible, names, colours)
    figure = {"data": [trace, *patches(names, colours), *_phase_traces(one.map)], "layout": map_layout(one)}
    spoken = f"Which constraints bind over speed and front angle: {', '.join(names)}."
    return Chart("map-binding", figure, "Which constraints bind at the optimum.", spoken, 420)


def category_trace(
    speed: FloatArray,
    angle: FloatArray,
    codes: npt.NDArray[np.uint8],
    hidden: npt.NDArray[np.bool_],
    names: Sequence[str],
    colours: Sequence[str],
) -> dict[str, Any]:
    """Return a heat map of names: codes (speeds, front angles) into `names` and `colours`; gaps where `hidden`."""
    return {
        "type": "heatmap",
        "x": numbers(speed),
        "y": numbers(angle),
        "z": numbers(np.where(hidden, np.nan, codes.astype(float)).T),
        "zmin": -0.5,
        "zmax": len(names) - 0.5,
        "colorscale": [[edge / len(names), colours[k]] for k in range(len(names)) for edge in (k, k + 1)],
        "showscale": False,
        "codes": {**small(codes.T), "names": list(names)},  # the page derives hover texts from them
        "hoverongaps": False,
        "hovertemplate": "%{text}<br>vx %{x:.1f} km/h, δf %{y:.2f} deg<extra></extra>",
    }


def cuts(maps: Sequence[NamedMap]) -> Cuts:
    """Return the data from which the page cuts all maps at any speed and front angle."""
    data = {"maps": [_cut_data(one) for one in maps]}
    return Cuts(data, "The maps cut along both axes. Where a line ends, no steady turn inside the limits exists.")


def _cut_data(one: NamedMap) -> dict[str, Any]:
    tables = {quantity.attribute: quantity.degrees(one.map) for quantity in QUANTITIES}
    binding: Mapping[str, Any] | None = None
    if one.map.active is not None:
        flags, places = np.unique(one.map.active, return_inverse=True)
        binding = {
            "codes": small(places.reshape(one.map.active.shape)),
            "names": [binding_text(flag) for flag in flags.tolist()],
        }
    return {
        "name": one.title,
        "speed_km_h": numbers(one.speed_km_h),
        "front_angle_deg": numbers(one.front_angle_deg),
        "tables": {name: numbers(table) for name, table in tables.items() if table is not None},
        "binding": binding,
    }


AFTER = {"hold": "held", "ramp": "led back by the fail-safe's ramp", "zero": "set straight at once"}
"""Description of the rear angle after the loss, by mode."""

CELLS = ("feasible with straight rear wheels too", "feasible only with rear steering")


def loss_blocks(one: NamedMap, config: Config) -> Iterator[Block]:
    """Yield a chart of the cells and of the operating points whose loss was simulated."""
    loss = loss_of_function(one.map, config)
    if loss.only_with_rear_steer is None:
        yield Text("It is not known which cells of a bare map need rear steering; the points below were simulated.")
    yield _chart(one, loss)
    yield Text(
        "Each mark is a steady turn in which the function is lost: the nonlinear car is simulated with the rear angle held, "
        "led back by the fail-safe's ramp, and set straight at once. A car spins where its sideslip angle passes 10 deg while "
        "its rear axle slides. A rear angle of zero is not by itself a safe state."
    )


def _chart(one: NamedMap, loss: LossOfFunction) -> Chart:
    data: list[dict[str, Any]] = []
    if loss.only_with_rear_steer is not None:
        codes = loss.only_with_rear_steer.astype(np.uint8)
        trace = category_trace(one.speed_km_h, one.front_angle_deg, codes, ~one.map.feasible, CELLS, (SKY, VERMILION))
        data += [trace, *patches(CELLS, (SKY, VERMILION))]
    data += _points(loss)
    look = layout(
        xaxis=axis(SPEED, zeroline=False, showgrid=False),
        yaxis=axis(FRONT_ANGLE, zeroline=False, showgrid=False, rangemode="tozero"),
        plot_bgcolor=EMPTY,
    )
    share = "" if loss.share_of_feasible is None else f" {100.0 * loss.share_of_feasible:.0f} % of the feasible cells need it."
    spins = ", ".join(f"{int(loss.spins[k].sum())} with the rear angle {AFTER[mode]}" for k, mode in enumerate(MODES))
    of = f"Of {loss.speed.size} simulated losses the car spins in {spins}."
    caption = f"Where the loss of the rear steering is dangerous.{share} {of}"
    return Chart("map-loss", {"data": data, "layout": look}, caption, caption, 480)


def _points(loss: LossOfFunction) -> Iterator[dict[str, Any]]:
    at_once = loss.spins[MODES.index("zero")]
    groups = (
        ("spins with the rear wheels straight at once", "x", loss.settles & at_once),
        ("does not spin", "circle-open", loss.settles & ~at_once),
        ("no steady turn before the loss", "diamond-open", ~loss.settles),
    )
    for name, symbol, chosen in groups:
        if chosen.any():
            yield {
                "type": "scatter",
                "mode": "markers",
                "x": (loss.speed[chosen] / KM_H).round(2).tolist(),
                "y": np.degrees(loss.front_angle[chosen]).round(3).tolist(),
                "name": name,
                "marker": {"symbol": symbol, "size": 11, "color": INK, "line": {"width": 2, "color": INK}},
                "text": [_told(loss, int(k)) for k in np.flatnonzero(chosen)],
                "hovertemplate": "%{text}<extra></extra>",
            }


def _told(loss: LossOfFunction, k: int) -> str:
    lines = [f"vx {loss.speed[k] / KM_H:.0f} km/h, δf {np.degrees(loss.front_angle[k]):.2f} deg"]
    if not loss.settles[k]:
        return "<br>".join([*lines, "no steady turn before the loss"])
    lines.append(f"before: δr {np.degrees(loss.rear_angle[k]):.2f} deg, β {np.degrees(loss.sideslip[k]):.1f} deg")
    for row, mode in enumerate(MODES):
        end = "spins" if loss.spins[row, k] else f"|β| up to {np.degrees(loss.sideslip_max[row, k]):.1f} deg"
        lines.append(f"{AFTER[mode]}: {end}")
    return "<br>".join(lines)
