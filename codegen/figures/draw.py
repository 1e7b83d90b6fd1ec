"""The renderer: draws charts, figures of Plotly as plain data, with Matplotlib as PNG or SVG.

It draws what the charts of this package use: lines, markers, bars, heat maps and contours; lines, rectangles and texts on them;
y axes that share an x axis, one below the other. Other settings, such as those of hovering, have no effect.

Matplotlib is used through its object interface, never pyplot, and imported only where a picture is drawn.
"""

from __future__ import annotations

import functools
import io
import math
import re
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.figures.data import EMPTY, GRID, GROUND, INK, MUTED, Chart, Picture, PlotError
from codegen.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

THEME_COLOURS = {INK: "#000000", MUTED: "#777777", GRID: "#DDDDDD", GROUND: "#FFFFFF", EMPTY: "#E2E2E2"}
HATCH = {"hatch": "////", "hatchcolor": "#A6A6A6"}
"""Look of an empty ground, in addition to its colour."""
DASHES: Mapping[str, Any] = {"solid": "-", "dash": (0, (4, 2)), "dot": (0, (1, 1.5)), "dashdot": "-."}
SYMBOLS: Mapping[str, Any] = {
    **{"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "triangle-down": "v", "cross": "P", "x": "X"},
    **{"star": "*", "line-ns": "|"},
}
LINE_WIDTH, SYMBOL_SIZE = 0.8, 0.65
"""Points of a picture per px of a page."""
VERTICAL = {"top": "upper", "middle": "center", "bottom": "lower"}
SHADES = 512
LEGEND_COLUMNS_MAX = 5
ABOVE_CHART = 1.0
"""Place of a page's legend, as a fraction of a chart's height: charts with a lower one have their own in a picture."""
HEIGHT_WITHOUT_GROWING = 0.5
"""Height in inches that a picture has for the legend under its panels without growing."""

_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": False,
    "grid.color": THEME_COLOURS[GRID],
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "figure.dpi": 150.0,
    "figure.titlesize": 12.0,
    "svg.hashsalt": "codegen",
}


@contextmanager
def style(font_scale: float = 1.0) -> Iterator[None]:
    """Apply Matplotlib's defaults and the project's style, independent of the user's matplotlibrc; restore them at the end."""
    import matplotlib

    sizes = {key: font_scale * value for key, value in _STYLE.items() if key.endswith(("size", "font.size"))}
    parameters: dict[Any, Any] = {**matplotlib.rcParamsDefault, **_STYLE, **sizes}
    with matplotlib.rc_context({key: value for key, value in parameters.items() if not key.startswith("backend")}):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, width by height in inches, whose layout makes room for the labels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def to_bytes(figure: Figure, kind: str = "png") -> bytes:
    """Return the PNG or SVG of a figure. It contains no date or software version, so equal figures give equal bytes."""
    stream = io.BytesIO()
    with style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box stands for a character that the font lacks
        # Each drawing shifts the layout slightly, so it is fixed after the first one.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        if kind == "svg":
            figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
        else:
            # `savefig` would draw it once more before it writes.
            figure.canvas.print_png(stream, metadata={"Software": None})  # type: ignore[attr-defined]
    return stream.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG or SVG, by the ending of the name, atomically.

    Raises:
        PlotError: another ending.
        CodegenError: the file cannot be written.
    """
    write_atomically(path, to_bytes(figure, kind_of(path)))


def kind_of(path: Path) -> str:
    """Return "png" or "svg", by the ending of a name. Raises PlotError: another ending."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise PlotError("only PNG and SVG pictures are written", where=path, remedy=f"name it {path.stem or 'picture'}.png")
    return kind


def draw(picture: Picture) -> Figure:
    """Return the picture of charts as a Matplotlib figure."""
    with style(picture.font_scale):
        figure = new_figure(*picture.size)
        if picture.title:
            figure.suptitle(words(picture.title))
        columns = math.lcm(*(len(row) for row in picture.rows))
        grid = figure.add_gridspec(len(picture.rows), columns, height_ratios=picture.heights, width_ratios=picture.widths)
        drawn: dict[tuple[int, int], list[Axes]] = {}
        bars: dict[str, tuple[Any, dict[str, Any], list[tuple[int, int]]]] = {}
        for row, charts in enumerate(picture.rows):
            wide = columns // len(charts)
            for column, chart in enumerate(charts):
                if chart is not None:
                    place = row, column
                    drawn[place] = _draw_chart(figure, grid[row, column * wide : (column + 1) * wide], chart, place, bars)
                    if _has_own_legend(chart):
                        _own_legend(drawn[place], chart)
        _share_titles(picture, drawn)
        for mesh, bar, places in bars.values():
            _draw_colour_bar(figure, mesh, bar, places, drawn)
        shown = (chart for row in picture.rows for chart in row if chart is not None)
        _draw_legend(figure, [chart for chart in shown if not _has_own_legend(chart)])
        for column in range(columns):
            figure.align_ylabels([axes for place, panels in drawn.items() if place[1] == column for axes in panels])
    return figure


def words(text: str) -> str:
    """Return a text of a chart for Matplotlib: a dollar sign starts no formula, an underscore hides no legend entry."""
    shown = re.sub(r"<br ?/?>", "\n", text.replace("$", r"\$"))
    shown = re.sub(r"<sub>(.*?)</sub>", r"$_\\mathrm{\1}$", shown)
    return f" {shown}" if shown.startswith("_") else shown


def colour(name: str) -> Any:
    """Return a colour of a chart for Matplotlib."""
    return THEME_COLOURS.get(name, name)


def _title(axis: Mapping[str, Any]) -> str:
    return words(str(axis.get("title", {}).get("text", "")))


# --- panels -----------------------------------------------------------------------------------------------------------


def _draw_chart(figure: Figure, cell: Any, chart: Chart, place: tuple[int, int], bars: dict[str, Any]) -> list[Axes]:
    """Draw a chart and return its panels from the top; add its colour bars to `bars`."""
    data, layout = chart.figure["data"], chart.figure["layout"]
    named = {key.replace("axis", ""): axis for key, axis in layout.items() if key.startswith("yaxis")}
    order = sorted(named, key=lambda y: -named[y].get("domain", (0.0, 1.0))[1])
    sizes = [np.ptp(named[y].get("domain", (0.0, 1.0))) for y in order]
    rows = [cell] if len(order) == 1 else cell.subgridspec(len(order), 1, height_ratios=sizes)
    panels: dict[str, Axes] = {}
    for k, y in enumerate(order):
        panels[y] = axes = figure.add_subplot(rows[k], sharex=panels[order[0]] if k else None)
        own = [trace for trace in data if trace.get("yaxis", "y") == y]
        _prepare(axes, layout, named[y], is_last=k == len(order) - 1)
        for trace in own:
            if trace["type"] == "heatmap":
                mesh = _draw_heat_map(axes, trace)
                if trace.get("showscale", True):
                    bar = trace.get("colorbar", {})
                    key = repr((trace["colorscale"], trace.get("zmin"), trace.get("zmax"), bar.get("title")))
                    bars.setdefault(key, (mesh, bar, []))[2].append(place)
            else:
                _DRAWN[trace["type"]](axes, trace)
        _finish(axes, layout, named[y], own)
    for shape in layout.get("shapes", ()):
        _draw_shape(panels, order, shape)
    for note in layout.get("annotations", ()):
        _draw_text(panels[order[0]] if note.get("yref") == "paper" else panels[note.get("yref", "y")], note)
    has_marks = any(_is_above(note) for note in layout.get("annotations", ()))
    panels[order[0]].set_title(words(chart.title), pad=16 if has_marks else None)
    return [panels[y] for y in order]


def _prepare(axes: Axes, layout: Mapping[str, Any], y_axis: Mapping[str, Any], is_last: bool) -> None:
    x_axis = layout.get("xaxis", {})
    for name, axis in (("x", x_axis), ("y", y_axis)):
        if axis.get("type") == "log":
            getattr(axes, f"set_{name}scale")("log")
        if axis.get("showgrid", True):
            axes.grid(axis=name)  # type: ignore[arg-type]
    axes.set_ylabel(_title(y_axis))
    axes.set_xlabel(_title(x_axis) if is_last else "")
    axes.tick_params(labelbottom=is_last)
    if layout.get("plot_bgcolor") == EMPTY:
        axes.patch.set(facecolor=THEME_COLOURS[EMPTY], **HATCH)


def _finish(axes: Axes, layout: Mapping[str, Any], y_axis: Mapping[str, Any], data: Sequence[Mapping[str, Any]]) -> None:
    """Set limits and ticks after the data of a panel."""
    lines = [trace for trace in data if trace["type"] == "scatter" and "lines" in trace["mode"]]
    if lines and not any("markers" in trace["mode"] and "maxdisplayed" not in trace.get("marker", {}) for trace in lines):
        axes.margins(x=0.0)
    for name, axis in (("x", layout.get("xaxis", {})), ("y", y_axis)):
        limits = getattr(axes, f"set_{name}lim")
        if "tickvals" in axis:
            shown = [words(each) for each in axis.get("ticktext") or [f"{value:g}" for value in axis["tickvals"]]]
            getattr(axes, f"set_{name}ticks")(list(axis["tickvals"]), shown)
            getattr(axes, f"set_{name}ticks")([], minor=True)
        if axis.get("ticks") == "":
            axes.tick_params(axis=name, length=0)  # type: ignore[arg-type]
        if "range" in axis:
            limits(*(10.0**end if axis.get("type") == "log" else end for end in axis["range"]))
        elif axis.get("rangemode") == "tozero":
            limits(*((0.0, None) if axes.dataLim.intervaly[0] >= 0.0 or name == "x" else (None, None)))


def _share_titles(picture: Picture, drawn: Mapping[tuple[int, int], list[Axes]]) -> None:
    """Keep a title that neighbouring charts share at the outer one only, and the numbers of an axis with the same range."""
    titles = {place: [axes.get_ylabel() for axes in panels] for place, panels in drawn.items()}
    for (row, column), panels in drawn.items():
        left = drawn.get((row, column - 1))
        for k, axes in enumerate(panels):
            if left is not None and len(left) == len(panels) and titles[row, column - 1][k] == axes.get_ylabel() != "":
                axes.set_ylabel("")
                axes.tick_params(labelleft=left[k].get_ylim() != axes.get_ylim())
        below = drawn.get((row + 1, column))
        is_grid = row + 1 < len(picture.rows) and len(picture.rows[row]) == len(picture.rows[row + 1])
        if is_grid and below is not None and panels[-1].get_xlabel() == below[-1].get_xlabel() != "":
            panels[-1].set_xlabel("")
            panels[-1].tick_params(labelbottom=panels[-1].get_xlim() != below[-1].get_xlim())


def _draw_colour_bar(
    figure: Figure, mesh: Any, bar: Mapping[str, Any], places: Sequence[tuple[int, int]], drawn: Mapping[Any, list[Axes]]
) -> None:
    """Draw the colour bar of a heat map, or of all that have the same one: above a column of them, else to the right."""
    upward = len({row for row, _ in places}) > len({column for _, column in places})
    where: dict[str, Any] = {"location": "top", "aspect": 30, "shrink": 0.9, "pad": 0.015} if upward else {}
    ticks = bar.get("tickvals")
    title = words(bar.get("title", {}).get("text", ""))
    figure.colorbar(mesh, ax=[axes for place in places for axes in drawn[place]], label=title, ticks=ticks, **where)


# --- traces -----------------------------------------------------------------------------------------------------------


def _look(trace: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of Matplotlib for lines and markers."""
    mode, drawn, marker = trace["mode"], trace.get("line", {}), trace.get("marker", {})
    tone = colour(drawn.get("color") or marker.get("color"))
    look: dict[str, Any] = {"color": tone, "linestyle": "", "linewidth": LINE_WIDTH * drawn.get("width", 2)}
    if "lines" in mode:
        look["linestyle"] = DASHES[drawn.get("dash", "solid")]
    if "markers" in mode:
        symbol, edge = marker.get("symbol", "circle"), marker.get("line", {})
        look |= {"marker": SYMBOLS[symbol.removesuffix("-open")], "markersize": SYMBOL_SIZE * marker.get("size", 7)}
        look["markerfacecolor"] = "none" if symbol.endswith("-open") else colour(marker.get("color") or tone)
        look["markeredgecolor"] = colour(edge.get("color", marker.get("color") or tone))
        look["markeredgewidth"] = LINE_WIDTH * edge.get("width", 1.5 if symbol == "line-ns" else 0)
    return look


def _draw_scatter(axes: Axes, trace: Mapping[str, Any]) -> None:
    x, y = (np.asarray(trace[name], dtype=np.float64) for name in "xy")
    if not np.isfinite(y).any():  # also without any point
        return
    look, most = _look(trace), trace.get("marker", {}).get("maxdisplayed")
    if most:
        look["markevery"] = max(1, x.size // most)
    if trace.get("fill") == "tonexty":
        before = axes.get_lines()[-1]
        axes.fill_between(x, np.asarray(before.get_ydata()), y, color=colour(trace["fillcolor"]), linewidth=0.0)
    axes.plot(x, y, zorder=3, label=words(str(trace.get("name", ""))) or "_", clip_on=trace.get("cliponaxis", True), **look)
    shown = trace.get("text", ()) if "text" in trace["mode"] else ()
    for at, height, said in zip(x, y, shown, strict=False):
        axes.text(at, height, words(said), ha="center", va="center", fontsize=8.5, color=colour(trace["textfont"]["color"]))


def _draw_bars(axes: Axes, trace: Mapping[str, Any]) -> None:
    tone, size = colour(trace["marker"]["color"]), trace.get("width", 0.8)
    x, y = (np.asarray(trace[name], dtype=np.float64) for name in "xy")
    label = words(str(trace.get("name", ""))) or "_"
    if trace.get("orientation") == "h":
        drawn = axes.barh(y, x, size, color=tone, zorder=3, label=label)
    else:
        drawn = axes.bar(x, y, size, color=tone, zorder=3, label=label)
    if "text" in trace:
        ground = {"facecolor": THEME_COLOURS[GROUND], "edgecolor": "none", "pad": 0.6}  # a line of a limit may pass there
        axes.bar_label(drawn, list(trace["text"]), padding=2.0, fontsize=8.0, bbox=ground)
        axes.margins(y=0.12)


def _draw_heat_map(axes: Axes, trace: Mapping[str, Any]) -> Any:
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    x, y, z = (np.asarray(trace[name], dtype=np.float64) for name in "xyz")
    stops = [(share, colour(name)) for share, name in trace["colorscale"]]
    scale = LinearSegmentedColormap.from_list("scale", stops, SHADES)
    norm = Normalize(trace["zmin"], trace["zmax"])
    shading: Any = "nearest" if z.shape == (y.size, x.size) else "flat"
    mesh = axes.pcolormesh(x, y, np.ma.masked_invalid(z), norm=norm, cmap=scale, shading=shading, rasterized=True)
    axes.autoscale_view()
    axes.autoscale(enable=False)
    return mesh


def _draw_contour(axes: Axes, trace: Mapping[str, Any]) -> None:
    x, y, z = (np.asarray(trace[name], dtype=np.float64) for name in "xyz")
    asked, drawn = trace["contours"], trace["line"]
    levels = np.arange(asked["start"], asked["end"] + 0.5 * asked["size"], asked["size"])
    levels = levels[(levels > np.nanmin(z)) & (levels < np.nanmax(z))]
    if levels.size:
        look = {"colors": colour(drawn["color"]), "linewidths": LINE_WIDTH * drawn["width"], "linestyles": "-"}
        lines = axes.contour(x, y, np.ma.masked_invalid(z), levels, **look)
        if asked.get("showlabels"):
            axes.clabel(lines, fmt="%g", fontsize=8.0)


_DRAWN = {"scatter": _draw_scatter, "bar": _draw_bars, "contour": _draw_contour}


def _draw_shape(panels: Mapping[str, Axes], order: Sequence[str], shape: Mapping[str, Any]) -> None:
    y = shape.get("yref", "y")
    for axes in [panels[each] for each in order] if y == "paper" else [panels[y]]:
        below = {"zorder": 0.5 if shape.get("layer") == "below" else 1.5}
        if shape["type"] == "rect":
            look = {"facecolor": colour(shape["fillcolor"]), "alpha": shape.get("opacity", 1.0), "linewidth": 0.0, **below}
            if y == "paper":
                axes.axvspan(shape["x0"], shape["x1"], **look)
            elif shape.get("xref") == "paper":
                axes.axhspan(shape["y0"], shape["y1"], **look)
            else:
                axes.fill_between([shape["x0"], shape["x1"]], shape["y0"], shape["y1"], **look)
            continue
        drawn = shape["line"]
        look = {"color": colour(drawn["color"]), "linewidth": LINE_WIDTH * drawn.get("width", 1), **below}
        look |= {"linestyle": DASHES[drawn.get("dash", "solid")], "label": "_"}
        if y == "paper":
            axes.axvline(shape["x0"], **look)
        elif shape.get("xref") == "paper":
            axes.axhline(shape["y0"], **look)
        else:
            axes.plot([shape["x0"], shape["x1"]], [shape["y0"], shape["y1"]], **look)


def _draw_text(axes: Axes, note: Mapping[str, Any]) -> None:
    x, y = ("axes fraction" if note.get(f"{name}ref") == "paper" else "data" for name in "xy")
    align = {"ha": note.get("xanchor", "center"), "va": note.get("yanchor", "center")}
    shift = (0.0, 3.0) if _is_above(note) else (note.get("xshift", 0), note.get("yshift", 0))
    tone = colour(note.get("font", {}).get("color", INK))
    axes.annotate(
        words(note["text"]), (note["x"], note["y"]), xycoords=(x, y), xytext=shift, textcoords="offset points", color=tone,
        fontsize=8.5, annotation_clip=False, **align,
    )  # fmt: skip


def _is_above(note: Mapping[str, Any]) -> bool:
    """Return whether a text stands above the first panel."""
    return bool(note.get("yref") == "paper" and note["y"] == 1)


# --- legends ----------------------------------------------------------------------------------------------------------


def _handles(charts: Iterable[Chart]) -> dict[str, Any]:
    """Return name -> handle of each legend entry."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found: dict[str, Any] = {}
    shown = (chart.figure for chart in charts if chart.figure["layout"].get("showlegend", True))
    for trace in (trace for figure in shown for trace in figure["data"]):
        name = words(str(trace.get("name", "")))
        if not name or name in found or not trace.get("showlegend", True) or trace["type"] in ("heatmap", "contour"):
            continue
        marker = trace.get("marker", {})
        if trace["type"] == "bar" or (marker.get("symbol") == "square" and marker.get("size") == 12):
            hatch = HATCH if marker["color"] == EMPTY else {"edgecolor": THEME_COLOURS[MUTED], "linewidth": 0.5}
            found[name] = Patch(facecolor=colour(marker["color"]), **hatch)
        else:
            found[name] = Line2D([], [], **_look(trace))
    return found


def _draw_legend(figure: Figure, charts: Sequence[Chart]) -> None:
    """Add the legend of all charts below them, with as many columns as fit. A picture grows with a legend of many lines."""
    entries = _handles(charts)
    if not entries:
        return
    look: dict[str, Any] = {"loc": "outside lower center", "handles": list(entries.values())}
    make = functools.partial(figure.legend, **look)
    legend = _fitted(make, list(entries), figure.bbox.width)
    tall = legend.get_window_extent(figure.canvas.get_renderer()).height / figure.dpi  # type: ignore[attr-defined]
    figure.set_figheight(figure.get_figheight() + max(0.0, tall - HEIGHT_WITHOUT_GROWING))


def _has_own_legend(chart: Chart) -> bool:
    return bool(chart.figure["layout"].get("legend", {}).get("y", ABOVE_CHART) < ABOVE_CHART)


def _own_legend(panels: Sequence[Axes], chart: Chart) -> None:
    """Add the legend of a chart at its place in the first panel, or below the last one."""
    entries, at = _handles([chart]), chart.figure["layout"]["legend"]
    axes = panels[0 if at["y"] >= 0.0 else -1]
    side = f"{VERTICAL[at['yanchor']]} {at['xanchor']}".replace("center center", "center")
    look: dict[str, Any] = {"loc": side, "bbox_to_anchor": (at["x"], at["y"]), "handles": list(entries.values())}
    axes.figure.draw_without_rendering()  # type: ignore[union-attr]
    _fitted(
        functools.partial(axes.legend, **look),
        list(entries),
        axes.bbox.width,
        LEGEND_COLUMNS_MAX if at["orientation"] == "h" else 1,
    )


def _fitted(make: Any, labels: Sequence[str], room: float, most: int = LEGEND_COLUMNS_MAX) -> Any:
    """Return a legend at most `room` px wide: with fewer columns, or, if one is too wide, with wrapped labels."""
    for columns in range(min(most, len(labels)), 0, -1):
        legend = make(labels=labels, ncols=columns)
        wide = legend.get_window_extent(legend.figure.canvas.get_renderer()).width
        if wide <= room:
            return legend
        legend.remove()
    longest = max(map(len, labels))
    wrapped = ["\n".join(textwrap.wrap(each, int(longest * 0.9 * room / wide), break_on_hyphens=False)) for each in labels]
    return make(labels=wrapped, ncols=1)
