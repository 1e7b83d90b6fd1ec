"""Checks shared by all figures, and access to their content."""

import base64
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from codegen.figures.draw import style

UNITS = ("km/h", "deg", "deg/s", "kN", "m/s²", "g", "s", "Hz", "dB", "%", "m")

RATIOS = ("Status", "Peak sensitivity", "Spins, of 24 cells", "Sine at 120 km/h: gain over the map's")
"""Labels of axes without a unit."""


def overlapping(boxes: list[Any]) -> list[tuple[Any, Any]]:
    """Return pairs that share more than a pixel in both directions."""
    return [
        (one, other)
        for one, other in combinations(boxes, 2)
        if min(min(one.x1, other.x1) - max(one.x0, other.x0), min(one.y1, other.y1) - max(one.y0, other.y0)) > 1.0
    ]


def check_layout(figure: Figure, *, shared_labels: bool = False) -> None:
    """Check that nothing is clipped or overlaps, that text is readable and that numeric axes name a unit.

    With `shared_labels`, panels in a row or a column may share the label of one of them.
    """
    with style():  # as the figure is saved
        figure.draw_without_rendering()
        renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
        outer = [*figure.legends, *(text for text in figure.texts if text.get_text())]
        boxes = [axes.get_tightbbox(renderer) for axes in figure.axes] + [one.get_window_extent(renderer) for one in outer]
        for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
            shown = [label for label in axis.get_ticklabels() if label.get_visible() and label.get_text()]
            assert overlapping([label.get_window_extent(renderer) for label in shown]) == [], axis.get_label_text()
    for box in boxes:  # one pixel for rounding
        assert -1.0 <= box.x0 <= box.x1 <= figure.bbox.width + 1.0, box
        assert -1.0 <= box.y0 <= box.y1 <= figure.bbox.height + 1.0, box
    assert overlapping(boxes) == []
    labels = []
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        texts = [label.get_text() for label in axis.get_ticklabels() if label.get_visible() and label.get_text()]
        if any(text.lstrip("−").replace(".", "").isdigit() for text in texts):
            labels.append(axis.get_label_text())
    units = [label for label in labels if label in UNITS or any(f"({unit})" in label for unit in UNITS)]
    others = [label for label in labels if label not in units and (label or not shared_labels)]
    assert units and all(label.startswith(RATIOS) for label in others), others
    assert min(text.get_fontsize() for text in figure.findobj(Text)) >= 8.0  # type: ignore[attr-defined]


def names(figure: Figure) -> list[str]:
    """Return every entry of every legend."""
    legends = [*figure.legends, *(legend for axes in figure.axes if (legend := axes.get_legend()) is not None)]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def line_of(axes: Axes, label: str) -> Any:
    """Return the only line with a label."""
    (found,) = [line for line in axes.get_lines() if line.get_label() == label]
    return found


def unpacked(packed: Any) -> np.ndarray:
    """Return an array of a chart, or of its JSON as Plotly would decode it."""
    if isinstance(packed, (list, np.ndarray)):
        return np.array(packed, dtype=float)
    values = np.frombuffer(base64.b64decode(packed["bdata"]), dtype={"f4": "<f4", "u1": "u1"}[packed["dtype"]])
    return values.reshape([int(size) for size in packed["shape"].split(",")]) if "shape" in packed else values
