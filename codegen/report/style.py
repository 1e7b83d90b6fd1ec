"""What all pictures share: palette, fonts, names, and the file they are written to.

Matplotlib is used through its object interface, never pyplot, and imported only where a picture is drawn.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from codegen.errors import CodegenError, one_line
from codegen.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# M. Okabe, K. Ito, Color Universal Design (2008): told apart by all common kinds of colour vision.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
GREY, BLACK, WHITE = "#777777", "#000000", "#FFFFFF"
INFEASIBLE_FACE, INFEASIBLE_HATCH = "#ECECEC", "#BDBDBD"

FRONT_ANGLE, REAR_ANGLE = r"$\delta_f$", r"$\delta_r$"
SPEED_LABEL = "Speed (km/h)"
FRONT_ANGLE_LABEL = f"Front angle {FRONT_ANGLE} (deg)"

CASE_NAMES = {"fws": "FWS", "4ws-1": "4WS-1", "4ws-2": "4WS-2"}
RUN_NAMES = {"C1": "C1 (4WS-2 map)", "C2": "C2 (FWS map)", "passive": "passive car"}

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
    """A picture cannot be drawn from what is given, or cannot be written."""


@contextmanager
def style(font_scale: float = 1.0) -> Iterator[None]:
    """Matplotlib's defaults and the project's style, whatever the user's matplotlibrc says; restored at the end."""
    import matplotlib

    sizes = {key: font_scale * value for key, value in _STYLE.items() if key.endswith(("size", "font.size"))}
    defaults = {key: value for key, value in matplotlib.rcParamsDefault.items() if not key.startswith("backend")}
    with matplotlib.rc_context({**defaults, **_STYLE, **sizes}):
        yield


def new_figure(width: float, height: float, dpi: float | None = None) -> Figure:
    """An empty figure, width by height in inches, that finds room for its labels by itself."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plain(text: object) -> str:
    """Text of the user's on one line, as it is: a dollar sign starts no formula, an underscore hides no legend entry."""
    line = one_line(text, 80).replace("$", r"\$")
    return f" {line}" if line.startswith("_") else line


def to_png(figure: Figure) -> bytes:
    """The PNG of a figure, without date or software: the same figure gives the same bytes."""
    stream = io.BytesIO()
    with style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box stands for a character that the font lacks
        figure.savefig(stream, format="png", dpi="figure", metadata={"Software": None})
    return stream.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all.

    Raises:
        PlotError: the name does not end in .png.
        CodegenError: the file cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise PlotError("only PNG pictures are written", where=path, remedy=f"name it {path.stem or 'picture'}.png")
    write_atomically(path, to_png(figure))
