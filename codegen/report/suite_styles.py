"""Colours and markers of the subjects of the test set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from codegen.report.style import (
    BLACK,
    CONTROLLER_COLOURS,
    GREY,
    ORANGE,
    WHITE,
    plain,
)

if TYPE_CHECKING:
    from hil_sim.suite.tracking import SuiteResult

MORE_COLOURS = (ORANGE, GREY)
MARKERS = ("o", "s", "^", "D", "v", "P", "*")
LIMIT: dict[str, Any] = {"color": BLACK, "linewidth": 1.0, "linestyle": (0, (5, 2)), "zorder": 1.5, "label": "_"}
WARNING: dict[str, Any] = {"color": GREY, "linewidth": 1.0, "linestyle": (0, (1, 1.5)), "zorder": 1.5, "label": "_"}
REFERENCE: dict[str, Any] = {"color": GREY, "linewidth": 1.2, "linestyle": (0, (4, 2)), "zorder": 2}


def lines_of(result: SuiteResult) -> dict[str, dict[str, Any]]:
    """Return colour and line style of each subject; the one under test has the widest line."""
    spare = iter(MORE_COLOURS * len(result.subjects))
    looks: dict[str, dict[str, Any]] = {}
    for name in result.subjects:
        looks[name] = {"color": CONTROLLER_COLOURS.get(name) or next(spare), "linewidth": 2.2 if name == result.tested else 1.3}
        if name == "passive":
            looks[name]["linestyle"] = ":"
        looks[name]["zorder"] = 4 if name == result.tested else 3
    return looks


def markers_of(result: SuiteResult) -> dict[str, dict[str, Any]]:
    """Return colour and marker of each subject, for pictures without lines."""
    return {
        name: {"color": look["color"], "marker": marker, "linestyle": "", "markersize": 5.5, "markeredgecolor": WHITE}
        for (name, look), marker in zip(lines_of(result).items(), MARKERS, strict=False)
    }


def name_handles(result: SuiteResult, looks: Mapping[str, Mapping[str, Any]]) -> list[Any]:
    """Return legend entries: names of the subjects, with lines or markers."""
    from matplotlib.lines import Line2D

    return [Line2D([], [], label=plain(name), **{**looks[name], "zorder": 2}) for name in result.subjects]
