"""Figures and tables of the test suite: they show the values of its result."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from codegen.figures import suites as suite_charts
from codegen.figures.data import CONTROLLER_COLOURS, symlog
from codegen.figures.draw import THEME_COLOURS as INKS
from codegen.figures.draw import draw
from codegen.report.suite_tables import WIDTH, failures, sections
from hil_sim.suite.tracking import ExternalFigures, SuiteResult
from tests.report.figures import check_layout, names
from tests.report.made_suite import CELLS, CONDITIONS, LAGS, SUBJECTS, cell_result, made, spun, third_party, with_table

COLOURS = {name: INKS.get(colour, colour) for name, colour in CONTROLLER_COLOURS.items()}
FIGURES = ("overview", "steps", "cells", "conditions", "margins", "friction", "price")


@pytest.fixture(scope="module")
def good() -> SuiteResult:
    return made()


@pytest.fixture(scope="module")
def figures(good: SuiteResult) -> dict[str, Figure]:
    return {name: draw(picture) for name, picture in suite_charts.pictures(good).items()}


def lines_in(axes: Axes, colour: str) -> list[Any]:
    return [line for line in axes.get_lines() if to_rgba(line.get_color()) == to_rgba(colour)]


def test_there_is_a_legible_figure_for_each_table(figures: dict[str, Figure]) -> None:
    assert tuple(figures) == FIGURES
    for name, figure in figures.items():
        check_layout(figure, shared_labels=True)
        wanted = {
            "cells": ["the car spins"],
            "margins": ["tracking: worst of the family", "required of the worst car", "codegen build warns below"],
        }
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
    assert across == pytest.approx([math.degrees(0.3)])  # value of the map


def test_cells_and_conditions_show_every_value(good: SuiteResult, figures: dict[str, Figure]) -> None:
    pi, passive = figures["cells"].axes[1], figures["cells"].axes[4]
    assert [text.get_text() for text in pi.texts[:4]] == ["20", "40", "60", "80"]
    assert [text.get_text() for text in passive.texts].count("spin") == 3
    assert (passive.collections[0].get_array() == len(suite_charts.SHADE_LEVELS)).sum() == 3  # spins
    assert len(pi.texts) == len(CELLS)
    overshoot, sideslip, error, spins = figures["conditions"].axes
    place = [condition.name for condition in good.conditions].index("friction-60")
    (marks,) = lines_in(overshoot, COLOURS["pi"])
    assert marks.get_xdata()[place] == pytest.approx(symlog(80.0))
    assert abs(marks.get_ydata()[place] - place) < 0.5
    assert lines_in(sideslip, COLOURS["tracking"])[0].get_xdata() == pytest.approx([2.5] * len(good.conditions))
    assert lines_in(error, COLOURS["tracking"])[0].get_xdata() == pytest.approx([-1.0] * len(good.conditions))
    assert lines_in(spins, COLOURS["pi"])[0].get_xdata()[place] == 3.0


def test_a_large_overshoot_is_inside_the_axes(good: SuiteResult) -> None:
    far = tuple(cell_result("pi", cell, "nominal", overshoot_percent=431.0) for cell in CELLS)
    overshoot = draw(suite_charts.conditions_picture(with_table(good, "pi", "nominal", far))).axes[0]
    assert overshoot.get_xlim()[1] > symlog(431.0)


def text_of(result: SuiteResult, start: str) -> str:
    (text,) = [text for title, text in sections(result) if title.startswith(start)]
    return text


def section(result: SuiteResult, start: str) -> list[list[str]]:
    """Return the rows of a section without its rule, split at two blanks or more."""
    lines = [line for line in text_of(result, start).splitlines() if not set(line) <= {"-", " "}]
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


def test_requirements_are_met_missed_or_not_measured(good: SuiteResult) -> None:
    lines = section(good, "Requirements")
    assert lines[1:3] == [["C1, actuator lag 20 ms"], ["overshoot", "at most 12 %", "2.00 %", "met"]]
    assert [cell for line in lines for cell in line].count("met") == len(good.requirements)
    assert ["instructions of the worst step", "at most 1320", "1040", "met"] in lines
    short = tuple(cell_result("tracking", cell, "nominal", map_error_percent=-2.0) for cell in CELLS)
    missed_goal = with_table(good, "tracking", "nominal", short)
    assert failures(missed_goal.requirements) == []
    wide = tuple(cell_result("tracking", cell, "nominal", sideslip_excess_deg=1.25) for cell in CELLS)
    failed = with_table(good, "tracking", "nominal", wide)
    figure = "|sideslip| beyond its bound"
    assert failures(failed.requirements) == [f"all cells, as configured: {figure} 1.25 deg (at most 0.2 deg)"]
    assert [figure, "at most 0.2 deg", "1.25 deg", "NOT MET", CELLS[0].title] in section(failed, "Requirements")
    alone = good.with_outside(ExternalFigures())
    assert ["instructions of the worst step", "at most 1320", "-", "not measured"] in section(alone, "Requirements")


def test_overshoot_settling_and_spins_of_each_condition(good: SuiteResult) -> None:
    # 0.5, 1, 1.5 and 2 % over the shares for tracking; 20 to 80 % for the PI; the passive car without its last three cells.
    kept = [8.0 * (cell.share or 0.0) / 0.25 for cell in CELLS[:-3]]
    wanted = ["1.2 / 2.0", "50.0 / 80.0", "10.0 / 16.0", "12.5 / 20.0", f"{sum(kept) / len(kept):.1f} / 32.0"]
    assert row(good, "Overshoot", "as configured") == wanted
    assert [line[0] for line in section(good, "Overshoot")[1:]] == [condition.title for condition in CONDITIONS]
    assert row(good, "Settling", "friction 0.6, no estimate") == ["0.50", "1 never", "0.50", "0.50", "0.50"]
    assert row(good, "Spins, of 24 cells", "friction 0.6, no estimate") == ["-", "3", "-", "-", "3"]
    assert row(good, "Spins, of 24 cells", "as configured") == ["-", "-", "-", "-", "3"]


def test_step_margins_sines_and_third_party(good: SuiteResult) -> None:
    c1 = {**good.c1, "pi": {lag.name: spun("pi", CELLS[0], lag.name) for lag in LAGS}}
    lines = section(replace(good, c1=c1), "The paper's step")
    assert lines[1][1:4] == ["overshoot (%)", "2.0", "spin"]
    assert lines[2:4] == [
        ["error to the map, steady (%)", "-1.0", "spin", *["-1.0"] * 3],
        ["overshoot of the map (%)", "0.5", "spin", *["0.5"] * 3],
    ]
    assert lines[5] == ["rise to 90 % (s)", "0.30", "spin", "0.28", "0.31", "0.33"]
    assert row(good, "Error to the map, largest", "as configured") == ["-1.0 / +0.5"] * 5
    assert row(good, "Error to the map on", third_party()["pi"][-1].cell.title)[:2] == ["-1.0 / 0.5", "spin"]
    assert row(good, "Margins", "60 km/h") == ["20.0 / 80 / 1.20", "8.5 / 46 / 1.70"] * 2
    assert row(good, "Margins", "120 km/h")[-1] == "unstable"
    assert row(good, "Sine", "120 km/h, 0.5 Hz") == ["0.90 / -15", "0.90 / -12", "0.90 / -14", "0.90 / -16", "spin"]
    assert row(good, "Third party", third_party()["pi"][-1].cell.title)[:2] == ["1.8 / 0.50 / 2.5", "spin"]


def test_the_trade_offs_are_named_with_figures(good: SuiteResult) -> None:
    worse = " ".join(text_of(good, "Where tracking is worse").split())
    assert "It rises to 90 % later than pi at 25 km/h by 0.05 s (0.30 against 0.25), at 42.5 km/h" in worse
    # 100 times the rise time at 1 Hz.
    assert "at 120 km/h and 1 Hz phase -30 deg against -25" in worse
    # Only cells without spins of either car are compared.
    fast = tuple(
        spun("pi", cell, "nominal") if cell.speed_km_h == 25.0 else cell_result("pi", cell, "nominal", rise_time_s=0.4)
        for cell in CELLS
    )
    worse = " ".join(text_of(with_table(good, "pi", "nominal", fast), "Where").split())
    assert "It rises no slower than pi at any speed." in worse
