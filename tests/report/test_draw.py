"""The renderer: what a PNG and an SVG show of charts that are plain data."""

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

from codegen.figures.data import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILION,
    Picture,
    axis,
    level,
    line,
    panel,
    points,
    scale_of,
    span,
    text,
    upright,
)
from codegen.figures.draw import draw, save, to_bytes

X, Y = np.linspace(0.0, 10.0, 11), np.linspace(0.0, 4.0, 5)
TABLE = Y[:, np.newaxis] + X


def lines_and_marks() -> Any:
    data = [line(X, X**2, "curve_1", BLUE, dash="dash"), points(X, X, "$marks", VERMILION, "square", 9)]
    shapes = [level(50.0, colour=GREEN, dash="dash"), upright(5.0), span(2.0, 4.0, ORANGE, 0.5)]
    notes = [text("v<sub>x</sub>", 1.0, 90.0)]
    y = axis("Square (m²)", range=[0.0, 100.0])
    return panel(data, axis("Time (s)"), y, title="Lines", shapes=shapes, annotations=notes)


def bars() -> Any:
    bar = {"type": "bar", "x": [0.0, 1.0], "y": [3.0, 7.0], "text": ["three", "seven"], "name": "bars"}
    ticks = axis("", tickvals=[0, 1], ticktext=["a", "b"])
    return panel([{**bar, "marker": {"color": PURPLE}}], ticks, axis("Count"), title="Bars")


def table() -> Any:
    bar = {"title": {"text": "deg/s"}}
    common = {"x": X, "y": Y, "z": TABLE}
    heat = {"type": "heatmap", **common, "zmin": 0.0, "zmax": 14.0, "colorscale": scale_of("viridis"), "colorbar": bar}
    asked = {"start": 2.0, "end": 12.0, "size": 5.0, "showlabels": True}
    contour = {"type": "contour", **common, "contours": asked, "line": {"color": "#FF0000", "width": 2.0}, "name": "contour"}
    return panel([heat, contour], axis("Speed (km/h)"), axis("Angle (deg)"), title="Map")


def picture() -> Picture:
    return Picture([[lines_and_marks(), bars()], [table(), None]], (9.0, 6.0), "All kinds")


def test_lines_marks_shapes_and_texts() -> None:
    axes = draw(picture()).axes[0]
    assert (axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()) == ("Lines", "Time (s)", "Square (m²)")
    curve, marks, *drawn = axes.get_lines()
    assert np.array_equal(curve.get_ydata(), X**2) and curve.is_dashed() and to_hex(curve.get_color()) == BLUE.lower()
    assert marks.get_marker() == "s" and marks.get_linestyle() == "None" and np.array_equal(marks.get_ydata(), X)
    assert [one.get_ydata()[0] for one in drawn] == [50.0, 0.0] and drawn[1].get_xdata()[0] == 5.0
    assert axes.get_ylim() == (0.0, 100.0)
    assert [patch.get_extents().transformed(axes.transData.inverted()).x1 for patch in axes.patches] == [pytest.approx(4.0)]
    assert [note.get_text() for note in axes.texts] == [r"v$_\mathrm{x}$"]


def test_bars_with_their_texts_and_ticks() -> None:
    axes = draw(picture()).axes[1]
    assert [bar.get_height() for bar in axes.patches] == [3.0, 7.0]
    assert {to_hex(bar.get_facecolor()) for bar in axes.patches} == {PURPLE.lower()}
    assert [note.get_text() for note in axes.texts] == ["three", "seven"]
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["a", "b"]


def test_heat_map_with_colour_bar_and_contours() -> None:
    figure = draw(picture())
    axes, bar = figure.axes[2:]
    mesh, contours = axes.collections
    assert axes.get_xlim() == (-0.5, 10.5) and axes.get_ylim() == (-0.5, 4.5)
    assert np.array_equal(mesh.get_array().reshape(TABLE.shape), TABLE) and mesh.get_clim() == (0.0, 14.0)
    assert bar.get_ylabel() == "deg/s"
    assert list(contours.levels) == [2.0, 7.0, 12.0]
    for height, path in zip(contours.levels, contours.get_paths(), strict=True):
        assert len(path.vertices) and np.allclose(path.vertices.sum(axis=1), height)


def test_one_legend_below_all_panels_names_lines_marks_and_bars() -> None:
    """Names stand as written: an underscore or a dollar sign has no meaning. A table has no entry."""
    figure = draw(picture())
    (legend,) = figure.legends
    assert [each.get_text() for each in legend.get_texts()] == ["curve_1", r"\$marks", "bars"]
    figure.draw_without_rendering()
    top = legend.get_window_extent().y1
    assert all(axes.get_tightbbox().y0 >= top for axes in figure.axes)


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_equal_charts_give_equal_bytes(kind: str) -> None:
    assert to_bytes(draw(picture()), kind) == to_bytes(draw(picture()), kind)


def test_a_png_has_the_size_and_the_colours_of_the_charts(tmp_path: Path) -> None:
    save(draw(picture()), tmp_path / "a.png")
    with Image.open(io.BytesIO((tmp_path / "a.png").read_bytes())) as image:
        assert image.size == (1350, 900)
        counts = {f"#{r:02x}{g:02x}{b:02x}": count for count, (r, g, b) in image.convert("RGB").getcolors(1 << 20)}
    for tone in (BLUE, VERMILION, PURPLE):
        assert counts.get(tone.lower(), 0) > 100
    assert counts["#ffffff"] < 0.9 * 1350 * 900


def test_an_svg_contains_lines_texts_and_the_picture_of_the_table(tmp_path: Path) -> None:
    save(draw(picture()), tmp_path / "a.svg")
    content = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert content.startswith("<?xml") and content.rstrip().endswith("</svg>")
    for tone in (BLUE, VERMILION, PURPLE, "#ff0000"):
        assert tone.lower() in content.lower()
    assert "<image" in content and "<!-- All kinds -->" in content and "<!-- Square (m²) -->" in content
    assert not re.search(r"<dc:date>|Matplotlib v\d", content)
