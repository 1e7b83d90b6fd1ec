"""The figures and tables of the test suite show the values of its result."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from codegen.report import suite_plots, suite_tables
from codegen.report.suite_looks import COLOURS
from codegen.report.suite_tables import WIDTH, columns, failures, sections, verdict
from hil_sim.suite.conditions import CONDITIONS, LAGS, NOMINAL
from hil_sim.suite.requirements import Requirement
from hil_sim.suite.tracking import Outside, SuiteResult
from tests.report.figures import check_layout, names, overlapping
from tests.report.made_suite import CELLS, SUBJECTS, cell_result, made, spun, third_party, with_table

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


def text_of(result: SuiteResult, start: str, between: str = " ") -> str:
    """Return a section as one line."""
    (text,) = [text for title, text in sections(result) if title.startswith(start)]
    return between.join(text.split("\n" if between == "\n" else None))


def section(result: SuiteResult, start: str) -> list[list[str]]:
    """Return the rows of a section without its ruler, split at two blanks or more."""
    lines = [line for line in text_of(result, start, "\n").splitlines() if not set(line) <= {"-", " "}]
    return [[cell.strip() for cell in line.split("  ") if cell.strip()] for line in lines]


def row(result: SuiteResult, start: str, first: str) -> list[str]:
    (found,) = [line[1:] for line in section(result, start) if line and line[0] == first]
    return found


def test_every_table_fits_the_page_and_names_the_subjects(good: SuiteResult) -> None:
    bad = with_table(good, "tracking", "friction-40-wrong", tuple(spun("tracking", cell, "x") for cell in CELLS))
    for result in (good, bad):
        text = "\n".join(f"{title}\n{text}" for title, text in sections(result))
        assert max(map(len, text.splitlines())) <= WIDTH == 120
        assert text.isascii()
    for start in ("Overshoot", "Settling", "Largest", "Spins", "The paper's step", "Rise time", "Sine", "Third party"):
        assert tuple(section(good, start)[0]) == SUBJECTS
    text = columns([("", "a", "bb")], [("x", "1", "22"), ("long", "333", "4")])
    assert text == "        a  bb\n----  ---  --\nx       1  22\nlong  333   4"


def test_requirements_are_met_missed_or_not_measured(good: SuiteResult) -> None:
    lines = section(good, "What is asked")
    assert lines[1:3] == [["C1, actuator lag 20 ms"], ["overshoot", "at most 2 %", "2.00 %", "met"]]
    flat = [cell for line in lines for cell in line]
    assert "NOT MET" not in flat
    assert flat.count("met") == len(good.requirements)
    assert ["instructions of the worst step", "at most 1500", "1040", "met"] in lines
    slow = tuple(cell_result("tracking", cell, "lag-100", overshoot_percent=9.0) for cell in CELLS)
    missed_goal = with_table(good, "tracking", "lag-100", slow)
    assert failures(missed_goal.requirements) == []
    goals = [line[3] for line in section(missed_goal, "What is asked") if line[:2] == ["overshoot", "at most 5 %"]]
    assert goals == ["goal, missed"]
    wide = tuple(cell_result("tracking", cell, "nominal", sideslip_max_deg=4.25) for cell in CELLS)
    failed = with_table(good, "tracking", "nominal", wide)
    assert failures(failed.requirements) == ["all cells, as configured: |sideslip| 4.25 deg (at most 3.2 deg)"]
    assert ["|sideslip|", "at most 3.2 deg", "4.25 deg", "NOT MET", CELLS[0].title] in section(failed, "What is asked")
    alone = good.with_outside(Outside())
    assert ["instructions of the worst step", "at most 1500", "-", "not measured"] in section(alone, "What is asked")
    assert not any(title.startswith("Third party") for title, _ in sections(alone))
    assert verdict(Requirement("m", "f", "", "at most", 1.0, None, False)) == "NOT MET"


def test_overshoot_settling_and_spins_of_each_condition(good: SuiteResult) -> None:
    # 0.5, 1, 1.5 and 2 % over the shares for tracking; 20 to 80 % for the PI; the passive car without its last three cells.
    kept = [8.0 * (cell.share or 0.0) / 0.25 for cell in CELLS[:-3]]
    wanted = ["1.2 / 2.0", "50.0 / 80.0", "10.0 / 16.0", "12.5 / 20.0", f"{sum(kept) / len(kept):.1f} / 32.0"]
    assert row(good, "Overshoot", "as configured") == wanted
    assert [line[0] for line in section(good, "Overshoot")[1:]] == [condition.title for condition in CONDITIONS]
    assert row(good, "Settling", "friction 0.6, no estimate") == ["0.50", "1 never", "0.50", "0.50", "0.50"]
    assert row(good, "Spins, of 24 cells", "friction 0.6, no estimate") == ["-", "3", "-", "-", "3"]
    assert row(good, "Spins, of 24 cells", "as configured") == ["-", "-", "-", "-", "3"]
    none_left = with_table(good, "pi", "nominal", tuple(spun("pi", cell, "nominal") for cell in CELLS))
    assert [row(none_left, start, "as configured")[1] for start in ("Overshoot", "Largest")] == ["-", "-"]


def test_step_margins_sines_and_third_party(good: SuiteResult) -> None:
    c1 = {**good.c1, "pi": {lag.name: spun("pi", CELLS[0], lag.name) for lag in LAGS}}
    lines = section(replace(good, c1=c1), "The paper's step")
    assert [line[0] for line in lines[1::4]] == [lag.title for lag in LAGS]
    assert lines[1][1:4] == ["overshoot (%)", "2.0", "spin"]
    assert lines[3] == ["rise to 90 % (s)", "0.30", "spin", "0.28", "0.31", "0.33"]
    assert row(good, "Margins", "60 km/h") == ["20.0 / 80 / 1.20", "8.5 / 46 / 1.70"] * 2
    assert row(good, "Margins", "120 km/h")[-1] == "unstable"
    assert not any(title.startswith("Margins") for title, _ in sections(replace(good, margins={})))
    assert row(good, "Sine", "120 km/h, 0.5 Hz") == ["0.90 / -15", "0.90 / -12", "0.90 / -14", "0.90 / -16", "spin"]
    assert row(good, "Third party", third_party()["pi"][-1].cell.title)[:2] == ["1.8 / 0.50 / 2.5", "spin"]


def test_the_trade_offs_are_named_with_figures(good: SuiteResult) -> None:
    worse = text_of(good, "Where tracking is worse")
    assert "It rises to 90 % later than pi at 25 km/h by 0.05 s (0.30 against 0.25), at 42.5 km/h" in worse
    # 100 times the rise time at 1 Hz.
    assert "at 120 km/h and 1 Hz phase -30 deg against -25" in worse
    assert "of the map's" not in worse  # the gain is the same for both
    assert "Nobody whose car never spins overshoots less." in worse
    # Only cells in which both cars survive are compared.
    fast = tuple(
        spun("pi", cell, "nominal") if cell.speed_km_h == 25.0 else cell_result("pi", cell, "nominal", rise_time_s=0.4)
        for cell in CELLS
    )
    assert "It rises no slower than pi at any speed." in text_of(with_table(good, "pi", "nominal", fast), "Where")
    soft = tuple(cell_result("tracking", cell, "relaxation-600", overshoot_percent=32.0) for cell in CELLS)
    worse = text_of(with_table(good, "tracking", "relaxation-600", soft), "Where tracking is worse")
    assert "relaxation length 0.6 m 32 % against 16 % of feedforward" in worse


def test_the_sets_are_stated_and_a_part_of_them_is_enough(good: SuiteResult) -> None:
    sets, speeds = text_of(good, "What was tuned"), "at 25, 42.5, 60, 80, 100 and 120 km/h with 25, 50, 75 and 100 %"
    for expected in (
        "243 linear cars",
        "at 30, 50, 70, 90 and 110 km/h with 35, 65 and 95 %",
        speeds,
        suite_tables.STRUCTURE_SET,
    ):
        assert expected in sets
    little = replace(good, conditions=(), results={name: {} for name in SUBJECTS}, rise_times={}).with_outside(Outside())
    assert not any(title.startswith(("Overshoot", "Rise time", "Third party")) for title, _ in sections(little))
    text = "\n".join(f"{title}\n{text}" for title, text in sections(little))
    assert "Rise times were not compared in this run." in text
    assert NOMINAL.title not in text.split("The paper's step")[1]
