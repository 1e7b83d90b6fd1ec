"""Pictures of the results of the test set of rear-steering controllers. Each function returns a Matplotlib Figure.

Labels are in degrees and km/h, arguments in SI units.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from codegen.design.margins import WARN_PHASE_MARGIN_DEG
from codegen.report.style import (
    new_figure,
    plain,
    style,
)
from codegen.report.suite_cell_plots import (
    FRICTION_TITLE,
    cells_figure,
    conditions_figure,
    draw_spins,
    friction_figure,
    road_ticks,
    slippery,
)
from codegen.report.suite_step_plots import (
    MARGIN_PANELS,
    cell_title,
    draw_margins,
    draw_step,
    margins_figure,
    price_figure,
    reference_handles,
    spin_handle,
    steps_figure,
)
from codegen.report.suite_styles import lines_of, name_handles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hil_sim.suite.tracking import SuiteResult


def figures(result: SuiteResult) -> dict[str, Figure]:
    """Return name -> picture, with the file name without extension, for everything that was simulated."""
    made: dict[str, Figure] = {"overview": overview_figure(result), "steps": steps_figure(result)}
    if result.conditions:
        made["cells"] = cells_figure(result)
        made["conditions"] = conditions_figure(result)
    if result.margins:
        made["margins"] = margins_figure(result)
    if slippery(result):
        made["friction"] = friction_figure(result)
    if result.rise_times:
        made["price"] = price_figure(result)
    return made


def overview_figure(result: SuiteResult) -> Figure:
    """Draw the paper's step, a fast one, margins and slippery roads in one picture."""
    looks = lines_of(result)
    with style():
        figure = new_figure(12.0, 8.6)
        panels = figure.subplots(2, 2)
        spun = False
        for axes, shown in zip(panels[0], (result.shown[0], result.shown[-1]), strict=True):
            spun |= draw_step(axes, result, shown, "yaw_rate_rad_s", looks)
            axes.set(xlabel="Time after the step (s)", ylabel="Yaw rate (deg/s)", title=f"Step steer, {cell_title(shown)}")
        draw_margins(panels[1, 0], result, *MARGIN_PANELS[1])
        asked = result.limits.phase_margin_deg
        for level, text in ((asked, "required of the worst car"), (WARN_PHASE_MARGIN_DEG, "a build warns below")):
            place = {"xytext": (4, -4), "textcoords": "offset points", "va": "top", "fontsize": 8.5}
            panels[1, 0].annotate(text, (panels[1, 0].get_xlim()[0], level), **place)
        panels[1, 0].set_title("Phase margin of the car itself (thin), and the worst of the family of cars")
        if slippery(result):
            draw_spins(panels[1, 1], result)
            panels[1, 1].set_xticks(*road_ticks(result, (", ", "estimated ")))
        panels[1, 1].set_title(FRICTION_TITLE)
        figure.suptitle(f"The controller under test ({plain(result.tested)}) beside its baselines")
        handles = [*name_handles(result, looks), *reference_handles(result), *([spin_handle()] if spun else [])]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure
