"""Common parts of all pictures: palette, fonts, names, map panels, legends, and the output file.

Matplotlib is used through its object interface, never pyplot, and imported only where a picture is drawn.
"""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.errors import CodegenError, one_line
from codegen.files import write_atomically
from codegen.map_file.map import ReferenceMap
from codegen.units import KM_H

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure, SubFigure


# M. Okabe, K. Ito, Color Universal Design (2008): distinguishable with all common kinds of colour vision.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
GREY, BLACK, WHITE = "#777777", "#000000", "#FFFFFF"
CONTROLLER_COLOURS = {"tracking": BLUE, "pi": VERMILION, "feedforward": GREEN, "proportional": PURPLE, "passive": BLACK}
"""Colour of each kind of controller, in all pictures."""
INFEASIBLE_FACE, INFEASIBLE_HATCH = "#E2E2E2", "#A6A6A6"

FRONT_ANGLE, REAR_ANGLE = r"$\delta_f$", r"$\delta_r$"
SPEED_LABEL = "Speed (km/h)"
AFTER_STEP = "Time after the step (s)"
FRONT_ANGLE_LABEL = f"Front angle {FRONT_ANGLE} (deg)"
FREQUENCY_TICKS = (0.2, 0.5, 1.0, 2.0, 3.0)
"""Ticks of a frequency axis, in Hz."""

RUN_NAMES = {
    "recommended": "recommended controller",
    "C1": "C1 (paper's PI, 4WS-2 map)",
    "C2": "C2 (paper's PI, FWS map)",
    "passive": "passive car",
}

_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "figure.dpi": 150.0,
    "figure.titlesize": 12.0,
}


class PlotError(CodegenError):
    """A picture cannot be drawn from the given data, or cannot be written."""


@contextmanager
def style(font_scale: float = 1.0) -> Iterator[None]:
    """Apply Matplotlib's defaults and the project's style, independent of the user's matplotlibrc; restore them at the end."""
    import matplotlib

    sizes = {key: font_scale * value for key, value in _STYLE.items() if key.endswith(("size", "font.size"))}
    parameters: dict[Any, Any] = {**matplotlib.rcParamsDefault, **_STYLE, **sizes}
    with matplotlib.rc_context({key: value for key, value in parameters.items() if not key.startswith("backend")}):
        yield


def new_figure(width: float, height: float, dpi: float | None = None) -> Figure:
    """Return an empty figure, width by height in inches, whose layout makes room for the labels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plain(text: object) -> str:
    """Return a user's text on one line, unchanged: a dollar sign starts no formula, an underscore hides no legend entry."""
    line = one_line(text, 80).replace("$", r"\$")
    return f" {line}" if line.startswith("_") else line


def to_png(figure: Figure) -> bytes:
    """Return the PNG of a figure. It contains no date or software version, so equal figures give equal bytes."""
    stream = io.BytesIO()
    with style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box stands for a character that the font lacks
        # Each drawing shifts the layout slightly, so it is fixed after the first one.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        # `savefig` would draw it once more before it writes.
        figure.canvas.print_png(stream, metadata={"Software": None})  # type: ignore[attr-defined]
    return stream.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, atomically.

    Raises:
        PlotError: the name does not end in .png.
        CodegenError: the file cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise PlotError("only PNG pictures are written", where=path, remedy=f"name it {path.stem or 'picture'}.png")
    write_atomically(path, to_png(figure))


# --- the panel of a map ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Quantity:
    """One table of a map and its display.

    Attributes:
        attribute: attribute of the map with the values in SI, (n, m), or None if the map lacks them.
        name: name with its symbol, with formulas. plain_name: the same in Unicode. unit: unit of the displayed values.
        colours: name of the colour map; a diverging one is centred at zero.
    """

    attribute: str
    name: str
    plain_name: str
    unit: str
    colours: str
    diverging: bool

    @property
    def label(self) -> str:
        """Name and unit, for axes and colour bars."""
        return f"{self.name} ({self.unit})"

    def degrees(self, reference_map: ReferenceMap) -> FloatArray | None:
        """Return the displayed values, (n, m) in `unit`; NaN where infeasible."""
        values = getattr(reference_map, self.attribute)
        return None if values is None else np.degrees(np.where(reference_map.feasible, values, np.nan))

    def colour_bar(self, figure: Figure | SubFigure, axes: Any, scale: Normalize, **look: Any) -> None:
        """Add the colour bar of one or several panels."""
        from matplotlib.cm import ScalarMappable

        figure.colorbar(ScalarMappable(scale, self.colours), ax=axes, **look)

    def scale(self, maps: Iterable[ReferenceMap]) -> Normalize:
        """Return a common colour scale for several maps: from zero to the largest value, or symmetric about zero."""
        from matplotlib.colors import Normalize

        tables = [table for one in maps if (table := self.degrees(one)) is not None]
        largest = max((float(np.nanmax(np.abs(table))) for table in tables if np.isfinite(table).any()), default=0.0)
        largest = largest if largest > 1e-6 else 1.0
        return Normalize(-largest if self.diverging else 0.0, largest)


YAW_RATE = Quantity("yaw_rate", "Yaw rate $r$", "Yaw rate r", "deg/s", "viridis", False)
SIDESLIP = Quantity("sideslip", r"Sideslip angle $\beta$", "Sideslip β", "deg", "PuOr_r", True)
REAR_STEER = Quantity("rear_angle", f"Rear angle {REAR_ANGLE}", "Rear angle δr", "deg", "RdBu_r", True)
QUANTITIES = (YAW_RATE, SIDESLIP, REAR_STEER)


def draw_quantity(axes: Axes, reference_map: ReferenceMap, quantity: Quantity, scale: Normalize) -> bool:
    """Draw one table of a map with the phase line. Return whether there is such a line."""
    table = quantity.degrees(reference_map)
    if table is None:
        axes.text(0.5, 0.5, "not in this map", transform=axes.transAxes, ha="center")
        return False
    draw_table(axes, reference_map, table, scale, quantity.colours)
    if quantity is REAR_STEER and not np.nanmax(np.abs(table)) > 0.0:
        axes.text(0.04, 0.06, f"{REAR_ANGLE} = 0", transform=axes.transAxes)
    return draw_phase_line(axes, reference_map)


def draw_table(
    axes: Axes, reference_map: ReferenceMap, table: npt.NDArray[Any], scale: Normalize, colours: str | Colormap
) -> None:
    """Draw a coloured cell for each operating point of `table` (n, m); NaN shows the hatched background."""
    axes.patch.set(facecolor=INFEASIBLE_FACE, hatch="////", hatchcolor=INFEASIBLE_HATCH)
    speed, front_angle = reference_map.speed / KM_H, np.degrees(reference_map.front_angle)
    masked = np.ma.masked_invalid(table.T)
    axes.pcolormesh(speed, front_angle, masked, norm=scale, cmap=colours, shading="nearest", rasterized=True)
    axes.set(xlim=_ends(speed), ylim=_ends(front_angle), autoscale_on=False)


def _ends(breakpoints: FloatArray) -> tuple[float, float]:
    """Return the outer breakpoints, extended by half a step on even axes as the cells are drawn; not below zero."""
    steps = np.diff(breakpoints)
    margin = 0.5 * float(steps[0]) if np.allclose(steps, steps[0], rtol=1e-6) else 0.0
    return max(0.0, float(breakpoints[0]) - margin), float(breakpoints[-1]) + margin


def phase_lines(reference_map: ReferenceMap) -> list[FloatArray]:
    """Return the pieces (k, 2) of the line delta_r = 0, with speed in km/h and front angle in deg.

    There the rear wheels change from the opposite to the same direction as the front wheels. Empty if there is no such line.
    Where another bound begins between two speeds, such as the floor of the yaw rate that keeps the angle near zero, it has a
    kink there. The zero is then extrapolated from the lower speeds; a straight line across the kink would follow the grid.
    """
    from contourpy import contour_generator

    rear_angle = REAR_STEER.degrees(reference_map)
    if rear_angle is None or not (np.any(rear_angle > 1e-6) and np.any(rear_angle < -1e-6)):
        return []
    speed, front_angle = reference_map.speed / KM_H, np.degrees(reference_map.front_angle)
    if reference_map.active is not None:
        before, last, first = rear_angle[:-2], rear_angle[1:-1], rear_angle[2:]
        steps = np.diff(speed)[:, np.newaxis]
        extrapolated = last + (last - before) * steps[1:] / steps[:-1]
        begins = reference_map.active[2:] != reference_map.active[1:-1]
        is_kink = begins & (last < 0.0) & (first >= 0.0) & (extrapolated > first)
        rear_angle[2:] = np.where(is_kink, extrapolated, first)
    pieces: Any = contour_generator(speed, front_angle, np.ma.masked_invalid(rear_angle.T)).lines(0.0)
    # Where the line runs into infeasible cells, it leaves short pieces.
    longest = max((len(piece) for piece in pieces), default=0)
    return [piece for piece in pieces if len(piece) > SPECK * longest]


def draw_phase_line(axes: Axes, reference_map: ReferenceMap) -> bool:
    """Draw the line delta_r = 0. Return whether there is one."""
    from matplotlib.patheffects import withStroke

    pieces = phase_lines(reference_map)
    for piece in pieces:
        halo = [withStroke(linewidth=3.6, foreground=WHITE)]
        axes.plot(piece[:, 0], piece[:, 1], color=BLACK, linewidth=1.8, path_effects=halo, label=PHASE_NAME)
    return bool(pieces)


SPECK = 0.15
"""Pieces of the phase line with at most this fraction of the points of the longest one are not drawn."""

PHASE_NAME = f"phase conversion, {REAR_ANGLE} = 0"
INFEASIBLE_NAME = "no feasible steady turn"


def line_handle(**look: Any) -> Artist:
    """Return a legend entry with a line; arguments of `matplotlib.lines.Line2D`."""
    from matplotlib.lines import Line2D

    return Line2D([], [], **look)


def patch_handle(**look: Any) -> Artist:
    """Return a legend entry with an area; arguments of `matplotlib.patches.Patch`."""
    from matplotlib.patches import Patch

    return Patch(**look)


def map_legend(phase_line: bool, infeasible: bool) -> list[Artist]:
    """Return legend entries for the phase line and infeasible cells of map panels."""
    entries: list[Artist] = []
    if phase_line:
        entries.append(line_handle(color=BLACK, linewidth=1.8, label=PHASE_NAME))
    if infeasible:
        entries.append(
            patch_handle(facecolor=INFEASIBLE_FACE, hatch="////", hatchcolor=INFEASIBLE_HATCH, label=INFEASIBLE_NAME)
        )
    return entries


POINTS_PER_INCH = 72.0
LINE_HEIGHT = 1.7
"""Height of an entry including its spacing, as a multiple of the font size."""
HEIGHT_WITHOUT_GROWING = 0.5
"""Height in inches that a picture has for the legend under its panels without growing."""


def fitted(handles: Sequence[Artist], room: float, most: int) -> dict[str, Any]:
    """Return arguments of `legend`: at most `most` columns, fewer if they would be wider than `room` (in).

    If one column is too wide, its labels are wrapped.
    """
    labels = [str(handle.get_label()) for handle in handles]
    for columns in range(min(most, len(labels)), 0, -1):
        width_of_texts = sum(max(map(_text_width, column)) for column in _split(labels, columns))
        if _width_of_spaces(columns) + width_of_texts <= room:
            break
    else:
        columns, labels = 1, [_wrapped(label, room) for label in labels]
    return {"handles": list(handles), "labels": labels, "ncols": columns}


def height(arguments: dict[str, Any]) -> float:
    """Return the height in inches of a legend with the arguments of `fitted`."""
    lines = max(sum(label.count("\n") + 1 for label in column) for column in _split(arguments["labels"], arguments["ncols"]))
    return lines * LINE_HEIGHT * _font_size()


def legend_below(figure: Figure, handles: Sequence[Artist]) -> None:
    """Add the legend of all panels below them. The picture grows with a legend of many lines."""
    legend = fitted(handles, figure.get_figwidth(), 4)
    figure.set_figheight(figure.get_figheight() + max(0.0, height(legend) - HEIGHT_WITHOUT_GROWING))
    figure.legend(loc="outside lower center", **legend)


def _font_size() -> float:
    """Font size of the current style, in inches."""
    from matplotlib import rcParams

    return float(rcParams["legend.fontsize"]) / POINTS_PER_INCH


def _split(labels: Sequence[str], columns: int) -> list[list[str]]:
    """Split entries into columns as Matplotlib does: one column after the other."""
    return [list(part) for part in np.array_split(np.array(labels, dtype=object), columns)]


def _width_of_spaces(columns: int) -> float:
    """Return the width of a legend without its text, in inches."""
    from matplotlib import rcParams

    handle = rcParams["legend.handlelength"] + rcParams["legend.handletextpad"]
    between, around = rcParams["legend.columnspacing"], 2.0 * (rcParams["legend.borderpad"] + rcParams["legend.borderaxespad"])
    return float(columns * handle + (columns - 1) * between + around) * _font_size()


def _text_width(text: str) -> float:
    """Return the width of the longest line in inches."""
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=rcParams["legend.fontsize"])
    points = max(text_to_path.get_text_width_height_descent(line, font, ismath=False)[0] for line in text.split("\n"))
    return float(points) / POINTS_PER_INCH


def _wrapped(label: str, room: float) -> str:
    """Return a label wrapped into lines that fit, broken between words where possible."""
    share = (room - _width_of_spaces(1)) / _text_width(label)
    return label if share >= 1.0 else "\n".join(textwrap.wrap(label, int(len(label) * share), break_on_hyphens=False))
