"""Drawings that explain: signs, the way of the data, the law, the status. Drawn by code, as all figures are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from codegen.figures.data import BLACK, BLUE, GREEN, MUTED, ORANGE, PURPLE, VERMILION, WHITE
from codegen.figures.draw import THEME_COLOURS, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY = THEME_COLOURS[MUTED]
FILL = "#EAF3FA"
"""Ground of a box that holds a thing of this project."""
PLAIN = "#F4F4F4"


def _bare(axes: Axes, width: float, height: float) -> None:
    axes.set(xlim=(0.0, width), ylim=(0.0, height), aspect="equal")
    axes.set_axis_off()


def _box(axes: Axes, x: float, y: float, text: str, size: tuple[float, float] = (2.3, 0.9), **given: Any) -> None:
    """A box around its middle (x, y)."""
    from matplotlib.patches import FancyBboxPatch

    width, height = size
    look = {"facecolor": FILL, "edgecolor": BLUE, "linewidth": 1.1} | given
    corner = (x - width / 2, y - height / 2)
    axes.add_patch(FancyBboxPatch(corner, width, height, boxstyle="round,pad=0,rounding_size=0.12", **look))
    axes.text(x, y, text, ha="center", va="center", linespacing=1.35)


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], **given: Any) -> None:
    look = {"color": BLACK, "linewidth": 1.2, "arrowstyle": "-|>", "connectionstyle": "arc3,rad=0"} | given
    colour, line = look.pop("color"), look.pop("linewidth")
    axes.annotate(
        "", end, start, arrowprops={**look, "color": colour, "lw": line, "shrinkA": 0.0, "shrinkB": 0.0, "mutation_scale": 11}
    )


def _polyline(axes: Axes, *points: tuple[float, float], **given: Any) -> None:
    """A line round corners with an arrow at its end."""
    xs, ys = zip(*points[:-1], strict=True)
    axes.plot(xs, ys, color=given.get("color", BLACK), linewidth=1.2, linestyle=given.get("linestyle", "-"))
    _arrow(axes, points[-2], points[-1], **given)


# --- signs -------------------------------------------------------------------------------------------------------------


def _turned(angle: float, length: float) -> tuple[float, float]:
    """A vector of that length at `angle` rad from forward (up), positive to the left."""
    return -length * math.sin(angle), length * math.cos(angle)


def _wheel(axes: Axes, x: float, y: float, angle: float) -> None:
    from matplotlib.patches import FancyBboxPatch
    from matplotlib.transforms import Affine2D

    patch = FancyBboxPatch(
        (-0.13, -0.42), 0.26, 0.84, boxstyle="round,pad=0,rounding_size=0.1", facecolor="#555555", edgecolor=BLACK
    )
    patch.set_transform(Affine2D().rotate(angle).translate(x, y) + axes.transData)
    axes.add_patch(patch)


def _angle(axes: Axes, at: tuple[float, float], span: tuple[float, float], radius: float, text: str, colour: str) -> None:
    """An arc from the first to the second angle (rad from forward, positive to the left), an arrow at its end."""
    points = [
        (
            at[0] + _turned(span[0] + k / 24 * (span[1] - span[0]), radius)[0],
            at[1] + _turned(span[0] + k / 24 * (span[1] - span[0]), radius)[1],
        )
        for k in range(25)
    ]
    xs, ys = zip(*points, strict=True)
    axes.plot(xs[:-1], ys[:-1], color=colour, linewidth=1.3)
    _arrow(axes, points[-3], points[-1], color=colour)
    # Beside the middle of the arc; a steer angle's beyond its end, where no other arrow is.
    steered = text.startswith(r"$\delta")
    away = _turned(span[1] + 0.22, radius) if steered else _turned(0.5 * (span[0] + span[1]), radius + 0.28)
    axes.text(at[0] + away[0], at[1] + away[1], text, color=colour, ha="center", va="center", fontsize=11)


def _ray(axes: Axes, at: tuple[float, float], angle: float, length: float, colour: str, dashed: bool = False) -> None:
    x, y = _turned(angle, length)
    if dashed:
        axes.plot([at[0], at[0] + x], [at[1], at[1] + y], color=colour, linewidth=1.0, linestyle="--")
    else:
        _arrow(axes, at, (at[0] + x, at[1] + y), color=colour, linewidth=1.7)


def signs() -> Figure:
    """The single-track car from above with every angle positive, and what the sign of the rear angle means."""
    with style():
        figure = new_figure(7.4, 5.2)
        left, right = figure.subplots(1, 2, width_ratios=(1.55, 1.0))
        _draw_signs(left)
        _draw_phases(right)
    return figure


def _draw_signs(axes: Axes) -> None:
    _bare(axes, 6.6, 7.4)
    x, front, centre, rear = 3.3, 5.6, 3.55, 1.5
    axes.plot([x, x], [rear, front], color=GREY, linewidth=5.0, solid_capstyle="round", zorder=0)
    delta_f, delta_r, beta = math.radians(34), math.radians(22), math.radians(16)
    for y, delta, name in ((front, delta_f, r"$\delta_f$"), (rear, delta_r, r"$\delta_r$")):
        _wheel(axes, x, y, delta)
        _ray(axes, (x, y), 0.0, 1.5, GREY, dashed=True)
        _ray(axes, (x, y), delta, 1.6, BLUE, dashed=True)
        _angle(axes, (x, y), (0.0, delta), 1.2, name, BLUE)
    travel = math.radians(22)
    _ray(axes, (x, front), travel, 1.75, GREEN)
    axes.annotate(
        r"$\alpha_f$ = direction of travel" + "\n" + r"less steer angle: here $\alpha_f<0$",
        (x - 0.76, front + 1.38),
        (4.0, 6.75),
        color=GREEN,
        arrowprops={"arrowstyle": "-", "color": GREEN, "lw": 0.8},
        va="center",
    )
    _arrow(axes, (x, front), (x - 1.35, front - 0.75), color=VERMILION, linewidth=1.9)
    axes.text(x - 1.5, front - 0.8, r"$F_{yf}>0$", color=VERMILION, ha="right", va="center", fontsize=11)
    axes.plot(x, centre, "o", color=BLACK, markersize=7)
    _ray(axes, (x, centre), beta, 1.55, GREEN)
    axes.text(x - 0.62, centre + 1.4, "$v$", color=GREEN, ha="right", fontsize=11)
    _angle(axes, (x, centre), (0.0, beta), 0.85, "", GREEN)
    axes.text(x + 0.12, centre + 0.72, r"$\beta$", color=GREEN, fontsize=11)
    _angle(axes, (x, centre), (math.radians(-120), math.radians(-35)), 0.75, "$r$", PURPLE)
    for y, name, other in ((0.5 * (front + centre), "$l_f$", front), (0.5 * (rear + centre), "$l_r$", rear)):
        axes.annotate("", (5.35, other), (5.35, centre), arrowprops={"arrowstyle": "<->", "color": GREY, "lw": 0.9})
        axes.text(5.5, y, name, color=GREY, va="center", fontsize=11)
    _arrow(axes, (1.4, 0.9), (1.4, 2.0))
    _arrow(axes, (1.4, 0.9), (0.3, 0.9))
    axes.text(1.5, 2.0, "$x$ forward", va="top")
    axes.text(0.3, 0.7, "$y$ left", va="top")
    axes.set_title("Every angle here is positive, but the slip angles", loc="center")


def _draw_phases(axes: Axes) -> None:
    _bare(axes, 4.2, 7.4)
    kinds = (
        (5.4, -16.0, r"$\delta_r<0$: opposite phase", "the car turns more", VERMILION, 0.55),
        (1.55, 16.0, r"$\delta_r>0$: in phase", "the car turns less", BLUE, 0.16),
    )
    for y, angle, title, text, colour, bend in kinds:
        _wheel(axes, 2.6, y + 0.8, math.radians(22))
        _wheel(axes, 2.6, y - 0.8, math.radians(angle))
        axes.plot([2.6, 2.6], [y - 0.8, y + 0.8], color=GREY, linewidth=5.0, zorder=0)
        _arrow(axes, (2.05, y), (0.9, y + 1.1), color=colour, linewidth=2.2, connectionstyle=f"arc3,rad={bend}")
        axes.text(2.1, y + 1.72, title, color=colour, ha="center", fontsize=10.5)
        axes.text(2.1, y - 1.55, text, color=colour, ha="center")


# --- the way of the data -----------------------------------------------------------------------------------------------


def data_flow() -> Figure:
    """From the data of a car to C, and to all that runs that same C."""
    with style():
        figure = new_figure(7.4, 4.9)
        axes = figure.subplots()
        _bare(axes, 14.5, 9.2)
        tall = (2.9, 1.15)
        _box(axes, 1.65, 8.2, "ars.toml\ncar, tyres, limits", tall, facecolor=PLAIN, edgecolor=GREY)
        _box(axes, 1.65, 5.6, ".tir, .mat, .csv\nof your own", tall, facecolor=PLAIN, edgecolor=GREY)
        _box(axes, 6.0, 8.2, "codegen solve\noptimal map", tall)
        _box(axes, 6.0, 5.6, "map.npz\nwith its configuration", tall, facecolor=PLAIN, edgecolor=GREY)
        _box(axes, 10.4, 8.2, "codegen tune\ngains over speed", tall)
        _box(axes, 10.4, 5.6, "codegen build\nC, DBC, A2L, CMake", tall)
        _arrow(axes, (3.1, 8.2), (4.55, 8.2))
        _arrow(axes, (6.0, 7.62), (6.0, 6.18))
        _arrow(axes, (3.1, 5.6), (4.55, 5.6))
        axes.text(3.82, 5.78, "import", ha="center", va="bottom", fontsize=8)
        _polyline(axes, (7.0, 6.18), (7.0, 6.9), (10.0, 6.9), (10.0, 7.62), color=GREY)
        _polyline(axes, (10.8, 7.62), (10.8, 7.2), (7.2, 7.2), (7.2, 6.18), color=GREY)
        _arrow(axes, (7.45, 5.6), (8.95, 5.6))
        uses = (
            ("codegen sil\nin one process", BLUE),
            ("codegen hil\non a CAN bus", BLUE),
            ("codegen firmware\nCortex-M, QEMU", BLUE),
            ("codegen fmu\nother simulators", BLUE),
            ("your ECU\nproject", VERMILION),
        )
        axes.plot([1.35, 12.65], [3.9, 3.9], color=BLACK, linewidth=1.2)
        _polyline(axes, (10.4, 5.02), (10.4, 3.9))
        for index, (text, colour) in enumerate(uses):
            x = 1.35 + 2.825 * index
            _arrow(axes, (x, 3.9), (x, 3.0))
            own = {"facecolor": "#FCEEE5"} if colour == VERMILION else {}
            _box(axes, x, 2.4, text, (2.6, 1.15), edgecolor=colour, **own)
        axes.text(7.0, 4.08, "the same C in all of them", ha="center", va="bottom", color=GREY)
        _box(
            axes,
            7.0,
            0.55,
            "codegen verify: compiles, analyses, emulates, counts, proves, fuzzes",
            (9.2, 0.8),
            edgecolor=GREEN,
            facecolor="#E9F6F1",
        )
        _polyline(axes, (12.1, 5.6), (14.3, 5.6), (14.3, 0.55), (11.6, 0.55), color=GREEN)
        axes.plot([11.85, 12.2], [5.6, 5.6], color=GREEN, linewidth=1.2)
    return figure


# --- the control law ---------------------------------------------------------------------------------------------------


def tracking_law() -> Figure:
    """Draw the signal flow of kind "tracking"."""
    with style():
        figure = new_figure(7.4, 5.0)
        axes = figure.subplots()
        _bare(axes, 14.0, 10.2)
        axes.set_ylim(bottom=0.6)
        wide, small = (2.6, 1.1), 8
        _box(axes, 3.0, 9.4, "map, with lead\nyaw rate, rear angle", (3.1, 1.1))
        _box(axes, 7.4, 9.4, "response gain", (2.1, 0.9))
        _box(axes, 12.75, 9.4, "limiter", (1.4, 1.1))
        _box(axes, 6.0, 6.7, "reference model", wide)
        _box(axes, 9.1, 5.3, "reference,\nbounded", (2.2, 1.1))
        _box(axes, 6.0, 3.7, "sideslip observer", wide)
        _box(axes, 2.45, 4.9, "grip", (1.5, 0.9))
        _box(axes, 11.45, 3.7, "PI over speed,\nbounded", (2.2, 1.1))
        _box(axes, 2.45, 1.3, "learned offsets\nsubtracted", (2.6, 1.1))
        # Feedforward.
        axes.text(0.05, 9.4, r"$v_x,\ \delta_f$", va="center")
        _arrow(axes, (0.95, 9.4), (1.45, 9.4))
        _arrow(axes, (4.55, 9.4), (6.35, 9.4), color=BLUE)
        _arrow(axes, (8.45, 9.4), (11.25, 9.4), color=BLUE)
        axes.text(9.75, 9.55, r"feedforward $\delta_{r,\mathrm{ff}}$", color=BLUE, ha="center", va="bottom")
        _polyline(axes, (9.0, 9.4), (9.0, 8.2), (6.6, 8.2), (6.6, 7.25), color=BLUE)
        _polyline(axes, (7.3, 6.9), (7.7, 6.9), (7.7, 8.95))
        axes.text(7.8, 8.55, "$r_m$", va="center")
        axes.plot(11.45, 9.4, "o", color=BLACK, markersize=13, markerfacecolor=WHITE)
        axes.text(11.45, 9.4, "+", ha="center", va="center")
        _arrow(axes, (11.65, 9.4), (12.05, 9.4))
        _arrow(axes, (13.45, 9.4), (13.95, 9.4))
        axes.text(13.7, 9.6, r"$\delta_r$", ha="center", va="bottom")
        # Reference.
        _polyline(axes, (4.1, 8.85), (4.1, 7.85), (9.7, 7.85), (9.7, 5.85))
        axes.text(4.2, 8.3, r"$r_\mathrm{map}$, for the trim", va="center", fontsize=small)
        axes.text(5.0, 7.5, r"$v_x,\ \delta_f$", ha="right", va="center")
        _polyline(axes, (5.05, 7.5), (5.5, 7.5), (5.5, 7.25))
        _polyline(axes, (7.3, 6.5), (9.1, 6.5), (9.1, 5.85))
        axes.text(8.2, 6.6, "$r_m,\\ a_m$", ha="center", va="bottom")
        _polyline(axes, (10.2, 5.3), (11.0, 5.3), (11.0, 4.25))
        axes.text(10.3, 5.4, r"$r_\mathrm{ref}$", va="bottom")
        _arrow(axes, (6.0, 6.15), (6.0, 4.25))
        axes.text(6.1, 5.2, r"$\beta_m$", va="center")
        # Sideslip: share of the lead, and authority of the feedback.
        _polyline(axes, (7.3, 3.9), (8.6, 3.9), (8.6, 4.75))
        _arrow(axes, (7.3, 3.5), (10.35, 3.5))
        axes.text(7.4, 3.98, r"$\beta_o$", va="bottom")
        # Grip.
        _polyline(axes, (4.7, 6.45), (2.8, 6.45), (2.8, 5.35))
        axes.text(3.7, 6.35, "$a_m$", ha="center", va="top")
        _polyline(axes, (2.1, 5.35), (2.1, 8.85))
        _arrow(axes, (2.1, 6.85), (4.7, 6.85))
        axes.text(2.0, 7.4, r"friction $\mu$", ha="right", va="center", fontsize=small)
        axes.text(0.05, 4.9, r"estimate $\hat\mu$", va="center", fontsize=small)
        _arrow(axes, (1.28, 4.9), (1.7, 4.9))
        # Measured motion.
        axes.text(0.05, 1.3, "$r,\\ a_y$", va="center")
        _arrow(axes, (0.7, 1.3), (1.15, 1.3))
        axes.plot([3.75, 11.45], [1.3, 1.3], color=BLACK, linewidth=1.2)
        axes.text(4.0, 1.4, "$r,\\ a_y$", va="bottom")
        _polyline(axes, (2.45, 1.85), (2.45, 4.45))
        axes.text(2.55, 3.1, "$a_y$", va="center")
        _arrow(axes, (6.0, 1.3), (6.0, 3.15))
        axes.text(6.1, 2.2, "$r,\\ a_y$", va="center")
        _arrow(axes, (9.1, 1.3), (9.1, 4.75))
        axes.text(9.2, 2.2, "$a_y$", va="center")
        _polyline(axes, (11.45, 1.3), (11.45, 3.15))
        axes.text(11.55, 2.2, "$r$", va="center")
        # Feedback.
        _polyline(axes, (12.0, 4.25), (12.0, 6.2), (11.45, 6.2), (11.45, 9.15), color=VERMILION)
        axes.text(11.65, 7.4, "feedback, limited\nwhere it turns more", color=VERMILION, va="center", fontsize=small)
    return figure


# --- the status --------------------------------------------------------------------------------------------------------


def status_machine() -> Figure:
    """Draw the values of `status` with the states of the supervision, and how one follows another."""
    green, orange, red = (
        {"edgecolor": edge, "facecolor": face}
        for edge, face in ((GREEN, "#E9F6F1"), (ORANGE, "#FDF3E1"), (VERMILION, "#FCEEE5"))
    )
    with style():
        figure = new_figure(7.4, 6.0)
        axes = figure.subplots()
        _bare(axes, 14.0, 11.6)
        _box(axes, 2.4, 10.4, "FAIL_SAFE 4\nSTART: no command", (3.6, 1.15), **red)
        _box(axes, 2.4, 7.8, "STANDBY 2\nno control", (3.0, 1.15))
        _box(axes, 8.1, 7.8, "TRACKING 0\nRUN, INHIBITED", (3.1, 1.15), **green)
        _box(axes, 12.2, 7.8, "LIMITED 1\nthe same, at a limit", (3.0, 1.15), **green)
        _box(axes, 8.1, 3.9, "DEGRADED 3\nPREDICTED, DEGRADED", (3.7, 1.15), **orange)
        _box(axes, 2.4, 3.9, "FAIL_SAFE 4\nLOST: ramp to zero", (3.6, 1.15), **red)
        _box(axes, 2.4, 0.8, "FAIL_SAFE 4\nRESYNCHRONISE: no command", (4.6, 1.15), **red)
        axes.plot(0.2, 11.4, "o", color=BLACK, markersize=7)
        _arrow(axes, (0.25, 11.35), (0.6, 11.0))
        axes.text(0.5, 11.4, "init", va="center")
        _arrow(axes, (2.4, 9.8), (2.4, 8.75))
        axes.text(2.55, 9.3, "rear angle measured, or\nnot available for 100 ms", va="center", fontsize=8)
        _arrow(axes, (3.9, 8.05), (6.55, 8.05))
        axes.text(5.25, 8.12, "first speed;\npi: enable speed", ha="center", va="bottom", fontsize=8)
        _arrow(axes, (6.55, 7.55), (3.9, 7.55))
        axes.text(5.25, 7.45, "Inhibit for good; pi:\ndisable speed", ha="center", va="top", fontsize=8)
        _arrow(axes, (9.65, 8.0), (10.7, 8.0))
        _arrow(axes, (10.7, 7.6), (9.65, 7.6))
        axes.add_patch(_frame(0.45, 6.4, 13.4, 2.35))
        axes.text(10.6, 9.0, "all signals are valid", ha="center", color=GREY)
        _arrow(axes, (7.5, 6.4), (7.5, 4.5), color=ORANGE)
        axes.text(7.35, 5.45, "a signal is missing or\nwrong, or the loop\nis impaired", ha="right", va="center", fontsize=8)
        _arrow(axes, (8.7, 4.5), (8.7, 6.4))
        axes.text(8.85, 5.45, "it is back,\nor agrees again", va="center", fontsize=8)
        _arrow(axes, (6.25, 3.9), (4.2, 3.9), color=VERMILION)
        axes.text(5.25, 3.75, "neither front\nangle nor yaw\nrate is valid", ha="center", va="top", fontsize=8)
        _arrow(axes, (2.4, 4.5), (2.4, 6.4))
        axes.text(2.55, 5.45, "enough good\nsamples", va="center", fontsize=8)
        _arrow(axes, (1.6, 3.3), (1.6, 1.4), color=VERMILION)
        axes.text(1.45, 2.35, "new data\nafter a\nsilence", ha="right", va="center", fontsize=8)
        _arrow(axes, (3.2, 1.4), (3.2, 3.3))
        axes.text(3.35, 2.0, "rear angle measured,\nor 100 ms", va="center", fontsize=8)
        axes.text(
            9.9,
            1.5,
            "INHIBITED: the car sets Inhibit, and the\nintegrator is held. Every sample decides anew\n"
            "which state of the dashed frame follows.",
            ha="center",
            va="center",
            color=GREY,
            fontsize=8.5,
        )
    return figure


def _frame(x: float, y: float, width: float, height: float) -> Any:
    from matplotlib.patches import FancyBboxPatch

    return FancyBboxPatch(
        (x, y), width, height, boxstyle="round,pad=0,rounding_size=0.2", facecolor="none", edgecolor=GREY, linestyle="--"
    )
