"""The pictures of the test set show what was measured, and nothing stands over anything else."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from codegen.report import style, suite_plots
from codegen.report.suite_looks import COLOURS
from hil_sim.suite.conditions import SLIPPERY
from hil_sim.suite.tracking import Outside, SuiteResult
from tests.report.made_suite import CELLS, RISE, SUBJECTS, made

NAMES = ("overview", "steps", "cells", "conditions", "margins", "friction", "price")


@pytest.fixture(scope="module")
def good() -> SuiteResult:
    return made()


@pytest.fixture(scope="module")
def figures(good: SuiteResult) -> dict[str, Figure]:
    """Drawn, so that everything has its place."""
    drawn = suite_plots.figures(good)
    for figure in drawn.values():
        with style.style():
            figure.draw_without_rendering()
    return drawn


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for found in figure.legends for text in found.get_texts()]


def lines_in(axes: Axes, colour: str) -> list[Any]:
    return [line for line in axes.get_lines() if to_rgba(line.get_color()) == to_rgba(colour)]


def overlapping(boxes: list[Any]) -> list[tuple[Any, Any]]:
    """Pairs that share more than a pixel both ways."""
    return [
        (one, other)
        for one, other in combinations(boxes, 2)
        if min(min(one.x1, other.x1) - max(one.x0, other.x0), min(one.y1, other.y1) - max(one.y0, other.y0)) > 1.0
    ]


def test_there_is_a_picture_for_each_table(figures: dict[str, Figure]) -> None:
    assert tuple(figures) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_clipped_or_covered(figures: dict[str, Figure], name: str) -> None:
    figure = figures[name]
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    outer = [*figure.legends, *(text for text in figure.texts if text.get_text())]
    parts = [axes.get_tightbbox(renderer) for axes in figure.axes] + [one.get_window_extent(renderer) for one in outer]
    for box in parts:
        assert box.x0 >= -1.0 and box.y0 >= -1.0 and box.x1 <= figure.bbox.width + 1.0 and box.y1 <= figure.bbox.height + 1.0
    assert overlapping(parts) == []
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            labels = [label for label in axis.get_ticklabels() if label.get_visible() and label.get_text()]
            assert overlapping([label.get_window_extent(renderer) for label in labels]) == []
        written = [text.get_window_extent(renderer) for text in axes.texts if text.get_text()]
        assert overlapping(written) == []


@pytest.mark.parametrize("name", NAMES)
def test_axes_and_subjects_are_named(figures: dict[str, Figure], name: str) -> None:
    figure = figures[name]
    shown = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
    assert all("(" in text or text in ("Peak sensitivity", "Spins, of 24 cells") or "over the map's" in text for text in shown)
    wanted = {"cells": ["the car spins"], "margins": ["tracking: worst of the family", "asked for", "a build warns below"]}
    assert set(wanted.get(name, SUBJECTS)) <= set(legend(figure))
    if name == "cells":
        assert [axes.get_title(loc="left") for axes in figure.axes[:5]] == list(SUBJECTS)


def test_same_bytes_each_time(good: SuiteResult) -> None:
    one, other = (style.to_png(suite_plots.margins_figure(good)) for _ in range(2))
    assert one == other


def test_steps_show_each_subject_until_it_spins(good: SuiteResult, figures: dict[str, Figure]) -> None:
    axes = figures["steps"].axes[0]
    drawn = {name: lines_in(axes, colour)[0] for name, colour in COLOURS.items()}
    for name in SUBJECTS:
        time, yaw_rate = drawn[name].get_data()
        record = good.shown[0].records[name]
        place = int(np.argmin(np.abs(time - 0.5)))
        assert yaw_rate[place] == pytest.approx(math.degrees(record[150, 3]), rel=1e-9)  # 1 s + 0.5 s
        assert time[-1] == pytest.approx(1.0 if name == "passive" else 2.0, abs=0.011)
    across = [line.get_ydata()[0] for line in axes.get_lines() if list(line.get_xdata()) == [0, 1]]
    assert across == pytest.approx([math.degrees(0.3)])  # the map's value
    assert any("spin" in text for text in legend(figures["steps"]))


def test_cells_are_written_and_coloured(good: SuiteResult, figures: dict[str, Figure]) -> None:
    pi, passive = figures["cells"].axes[1], figures["cells"].axes[4]
    assert [text.get_text() for text in pi.texts[:4]] == ["20", "40", "60", "80"]
    assert [text.get_text() for text in passive.texts[-3:]] == ["spin"] * 3
    table = passive.collections[0].get_array()
    assert table is not None
    assert np.ma.count_masked(table) == 3
    assert len(pi.texts) == len(CELLS)


def test_conditions_have_a_mark_for_each_subject(good: SuiteResult, figures: dict[str, Figure]) -> None:
    overshoot, sideslip, spins = figures["conditions"].axes
    place = [condition.name for condition in good.conditions].index("friction-60")
    (marks,) = lines_in(overshoot, COLOURS["pi"])
    assert marks.get_xdata()[place] == pytest.approx(80.0)
    assert abs(marks.get_ydata()[place] - place) < 0.5
    assert lines_in(sideslip, COLOURS["tracking"])[0].get_xdata() == pytest.approx([2.5] * len(good.conditions))
    (marks,) = lines_in(spins, COLOURS["pi"])
    assert marks.get_xdata()[place] == 3.0
    assert math.isnan(marks.get_xdata()[0])  # none, as configured


def test_margins_have_the_lines_that_are_asked_for(figures: dict[str, Figure]) -> None:
    gain, phase, sensitivity = figures["margins"].axes
    panels = (gain, phase, sensitivity)
    levels = [{line.get_ydata()[0] for line in axes.get_lines() if list(line.get_xdata()) == [0, 1]} for axes in panels]
    assert levels == [{8.0, 6.0}, {45.0, 30.0}, {1.8}]
    own, worst = lines_in(phase, COLOURS["tracking"])
    assert (list(own.get_ydata()), list(worst.get_ydata())) == ([80.0] * 3, [60.0, 46.0, 47.0])
    assert math.isnan(lines_in(sensitivity, COLOURS["pi"])[1].get_ydata()[-1])  # an unstable loop has none


def test_bars_of_slippery_roads(figures: dict[str, Figure]) -> None:
    spins, sideslip = figures["friction"].axes
    heights = [bar.get_height() for bar in spins.patches]  # one road after the other for each subject
    assert heights == [0.0] * 6 + [3.0] * 6 + [0.0] * 12 + [3.0] * 6
    assert {text.get_text() for text in spins.texts} == {"0", "3"}
    limits = [line.get_ydata()[0] for line in sideslip.get_lines()]
    assert limits == [3.5, 3.5, 3.5, 5.5, 5.5]  # without an estimate nothing is asked on snow
    assert len(sideslip.get_xticklabels()) == len(SLIPPERY)


def test_price_over_speed_and_frequency(figures: dict[str, Figure]) -> None:
    rise, _, phase = figures["price"].axes
    (line,) = lines_in(rise, COLOURS["tracking"])
    assert line.get_ydata() == pytest.approx([RISE["tracking"]] * 6)
    (line,) = lines_in(phase, COLOURS["pi"])
    assert (list(line.get_xdata()), line.get_ydata()) == ([0.5, 1.0, 1.5], pytest.approx([-12.5, -25.0, -37.5]))
    assert "120 km/h" in phase.get_ylabel()


NO_CONDITION: dict[str, Any] = {"conditions": (), "results": {name: {} for name in SUBJECTS}, "rise_times": {}}


@pytest.mark.parametrize(
    ("changes", "missing"),
    [
        ({"margins": {}}, {"margins"}),
        (NO_CONDITION, {"cells", "conditions", "friction", "price"}),
    ],
)
def test_what_was_not_driven_is_not_drawn(good: SuiteResult, changes: dict[str, Any], missing: set[str]) -> None:
    little = replace(good, **changes).with_outside(Outside())
    assert set(NAMES) - set(suite_plots.figures(little)) == missing


def test_a_grid_that_ends_sooner_has_no_sines(good: SuiteResult) -> None:
    slow = replace(good, sine=dict.fromkeys(SUBJECTS, ()))
    assert len(suite_plots.price_figure(slow).axes) == 1
