"""The comparison of references as a table and a picture, from a result made by hand."""

import numpy as np

from codegen.figures.draw import draw
from codegen.figures.suites import references_picture
from codegen.report.reference_tables import ROWS, beaten, reference_sections
from hil_sim.suite.references import ReferencesResult
from tests.optimum.cars import paper_map
from tests.report import made_suite
from tests.report.figures import check_layout


def made() -> ReferencesResult:
    """Return a result whose subjects are named like the controllers of `made_suite`; the first two have a map."""
    suite = made_suite.made()
    everywhere = dict.fromkeys(suite.subjects, np.ones(len(suite.cells), dtype=np.bool_))
    inside = {**everywhere, "pi": np.arange(len(suite.cells)) < 1}
    feasible = {name: 10.0 * place for place, name in enumerate(suite.subjects, start=1)}
    return ReferencesResult(
        suite, {"tracking": paper_map("4ws-2"), "pi": paper_map("4ws-1")}, {"envelope": "pi"}, feasible, inside
    )


def value(result: ReferencesResult, title: str, name: str) -> float | None:
    (row,) = [row for row in ROWS if row.title.startswith(title)]
    return row.value(result, name)


def test_the_figures_of_the_table() -> None:
    """All yaw rates are 20 deg/s, and the overshoot rises with the share: 1 % for the first subject at 25 %, half of that."""
    result = made()
    assert value(result, "overshoot, largest (%)", "tracking") == 2.0
    assert value(result, "overshoot, mean", "tracking") == 1.25
    # Only its first cell, of 25 %, is inside the map.
    assert value(result, "overshoot, largest of the cells with a turn", "pi") == 20.0
    assert value(result, "overshoot, largest (%)", "pi") == 80.0
    assert value(result, "yaw rate over", "pi") == 0.0 and value(result, "yaw rate over", "passive") is None
    assert value(result, "spins under all conditions", "passive") == 3.0 * len(result.suite.conditions)
    assert value(result, "cells with a turn of the reference", "pi") == 1.0
    assert value(result, "lag of a sine", "tracking") == 30.0 and value(result, "lag of a sine", "passive") is None


def test_where_others_are_better() -> None:
    """The first subject rises later than two others, and its feasible part is made the smallest."""
    lines = beaten(made())
    assert "feasible part of the grid (%): pi 20.0, feedforward 30.0, proportional 40.0, passive 50.0; tracking 10.0" in lines
    assert "rise to 90 %, to 60 km/h, mean (s): pi 0.25, feedforward 0.28; tracking 0.30" in lines
    assert not any(line.startswith(("overshoot", "spins", "the same from")) for line in lines)


def test_sections_and_picture() -> None:
    result = made()
    sections = dict(reference_sections(result))
    titles = list(sections)
    assert titles[0] == "References under the same controller, as configured: 24 step steers"
    assert titles[1:3] == ["Not driven again", "Where tracking is not the best"]
    assert sections["Not driven again"] == "envelope: its map, and so its figures, are those of pi"
    assert max(len(line) for line in sections[titles[2]].splitlines()) <= 120
    head, _, *rows = sections[titles[0]].splitlines()
    assert head.split() == [*result.suite.subjects[:-1], "envelope", "passive"] and len(rows) == len(ROWS)
    (feasible,) = [row.split() for row in rows if row.startswith("feasible")]
    assert feasible[-6:] == ["10.0", "20.0", "30.0", "40.0", "20.0", "50.0"]
    figure = draw(references_picture(result))
    above, below = figure.axes[:4], figure.axes[4:]
    assert [len(axes.get_lines()) for axes in above] == [2, 2, 2, 2]
    assert [len(axes.get_lines()) for axes in below] == [5, 5, 5, 5]
    assert above[0].get_title(loc="left") == "The maps at δ$_\\mathrm{f}$ = 2 deg"
    check_layout(figure, shared_labels=True)
    (line,) = [line for line in below[0].get_lines() if line.get_color() == "#0072B2"]
    np.testing.assert_array_equal(np.asarray(line.get_ydata()), 2.0)
