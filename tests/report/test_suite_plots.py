"""The figures of the test suite show the values of its result."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from codegen.report import suite_plots
from codegen.report.suite_looks import COLOURS
from hil_sim.suite.tracking import Outside, SuiteResult
from tests.report.figures import check_layout, names, overlapping
from tests.report.made_suite import CELLS, SUBJECTS, made

FIGURES = ("overview", "steps", "cells", "conditions", "margins", "friction", "price")


@pytest.fixture(scope="module")
def good() -> SuiteResult:
    return made()


@pytest.fixture(scope="module")
def figures(good: SuiteResult) -> dict[str, Figure]:
    return suite_plots.figures(good)


def lines_in(axes: Axes, colour: str) -> list[Any]:
    return [line for line in axes.get_lines() if to_rgba(line.get_color()) == to_rgba(colour)]


def test_there_is_a_legible_figure_for_each_table(figures: dict[str, Figure]) -> None:
    assert tuple(figures) == FIGURES
    for name, figure in figures.items():
        check_layout(figure, shared_labels=True)
        for axes in figure.axes:
            for texts in (axes.get_xticklabels(), axes.get_yticklabels(), axes.texts):
                shown = [text for text in texts if text.get_visible() and text.get_text()]
                assert overlapping([text.get_window_extent() for text in shown]) == []
        wanted = {"cells": ["the car spins"], "margins": ["tracking: worst of the family", "asked for", "a build warns below"]}
        assert set(wanted.get(name, SUBJECTS)) <= set(names(figure))
    assert [axes.get_title(loc="left") for axes in figures["cells"].axes[:5]] == list(SUBJECTS)


def test_steps_show_each_subject_until_it_spins(good: SuiteResult, figures: dict[str, Figure]) -> None:
    axes = figures["steps"].axes[0]
    for name in SUBJECTS:
        time, yaw_rate = lines_in(axes, COLOURS[name])[0].get_data()
        place = int(np.argmin(np.abs(time - 0.5)))
        assert yaw_rate[place] == pytest.approx(math.degrees(good.shown[0].records[name][150, 3]), rel=1e-9)  # 1 s + 0.5 s
        assert time[-1] == pytest.approx(1.0 if name == "passive" else 2.0, abs=0.011)
    across = [line.get_ydata()[0] for line in axes.get_lines() if list(line.get_xdata()) == [0, 1]]
    assert across == pytest.approx([math.degrees(0.3)])  # the value of the map
    assert any("spin" in text for text in names(figures["steps"]))


def test_cells_and_conditions_show_every_value(good: SuiteResult, figures: dict[str, Figure]) -> None:
    pi, passive = figures["cells"].axes[1], figures["cells"].axes[4]
    assert [text.get_text() for text in pi.texts[:4]] == ["20", "40", "60", "80"]
    assert [text.get_text() for text in passive.texts[-3:]] == ["spin"] * 3
    assert np.ma.count_masked(passive.collections[0].get_array()) == 3
    assert len(pi.texts) == len(CELLS)
    overshoot, sideslip, spins = figures["conditions"].axes
    place = [condition.name for condition in good.conditions].index("friction-60")
    (marks,) = lines_in(overshoot, COLOURS["pi"])
    assert marks.get_xdata()[place] == pytest.approx(80.0)
    assert abs(marks.get_ydata()[place] - place) < 0.5
    assert lines_in(sideslip, COLOURS["tracking"])[0].get_xdata() == pytest.approx([2.5] * len(good.conditions))
    (marks,) = lines_in(spins, COLOURS["pi"])
    assert marks.get_xdata()[place] == 3.0
    assert math.isnan(marks.get_xdata()[0])  # none, as configured


def test_margins_show_the_requirements(figures: dict[str, Figure]) -> None:
    gain, phase, sensitivity = figures["margins"].axes
    panels = (gain, phase, sensitivity)
    levels = [{line.get_ydata()[0] for line in axes.get_lines() if list(line.get_xdata()) == [0, 1]} for axes in panels]
    assert levels == [{8.0, 6.0}, {45.0, 30.0}, {1.8}]
    own, worst = lines_in(phase, COLOURS["tracking"])
    assert (list(own.get_ydata()), list(worst.get_ydata())) == ([80.0] * 3, [60.0, 46.0, 47.0])
    assert math.isnan(lines_in(sensitivity, COLOURS["pi"])[1].get_ydata()[-1])  # an unstable loop has none


def test_what_was_not_driven_is_not_drawn(good: SuiteResult) -> None:
    none: dict[str, Any] = {"conditions": (), "results": {name: {} for name in SUBJECTS}, "rise_times": {}}
    for changes, missing in (({"margins": {}}, {"margins"}), (none, {"cells", "conditions", "friction", "price"})):
        little = replace(good, **changes).with_outside(Outside())
        assert set(FIGURES) - set(suite_plots.figures(little)) == missing
