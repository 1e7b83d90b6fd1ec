"""Common parts of all pictures: palette, fonts, names, map panels, legends, and the output file.

Matplotlib is used through its object interface, never pyplot, and imported only where a picture is drawn.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.errors import one_line
from codegen.figures.data import AFTER_STEP, BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, WHITE
from codegen.figures.draw import new_figure, style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

__all__ = ["AFTER_STEP", "BLACK", "BLUE", "GREEN", "ORANGE", "PURPLE", "SKY", "VERMILION", "WHITE", "new_figure", "style"]

GREY = "#777777"
CONTROLLER_COLOURS = {"tracking": BLUE, "pi": VERMILION, "feedforward": GREEN, "proportional": PURPLE, "passive": BLACK}
"""Colour of each kind of controller, in all pictures."""

FRONT_ANGLE, REAR_ANGLE = r"$\delta_f$", r"$\delta_r$"
SPEED_LABEL = "Speed (km/h)"
FRONT_ANGLE_LABEL = f"Front angle {FRONT_ANGLE} (deg)"

SPIN_MARKER: dict[str, Any] = {"linestyle": "", "marker": "X", "markersize": 8, "markeredgecolor": WHITE}


def plain(text: object) -> str:
    """Return a user's text on one line, unchanged: a dollar sign starts no formula, an underscore hides no legend entry."""
    line = one_line(text, 80).replace("$", r"\$")
    return f" {line}" if line.startswith("_") else line


def line_handle(**look: Any) -> Artist:
    """Return a legend entry with a line; arguments of `matplotlib.lines.Line2D`."""
    from matplotlib.lines import Line2D

    return Line2D([], [], **look)


def patch_handle(**look: Any) -> Artist:
    """Return a legend entry with an area; arguments of `matplotlib.patches.Patch`."""
    from matplotlib.patches import Patch

    return Patch(**look)


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
