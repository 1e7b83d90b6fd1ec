"""The figures of the guide: all are drawn from the code, the committed maps and runs of the committed builds.

Same code, same bytes.
"""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import KM_H
from codegen.design.margins import (
    WARN_GAIN_MARGIN_DB,
    WARN_PHASE_MARGIN_DEG,
    family_margins,
    gains_of,
    margin_range_km_h,
    nominal_margins,
)
from codegen.ecu_map.extend import extend
from codegen.ecu_map.total import RULE_TEXT, Rule
from codegen.figures.curves import tyre_picture
from codegen.figures.data import AFTER_STEP, EMPTY
from codegen.figures.draw import COLOURS, draw, to_bytes
from codegen.figures.maps import front_angle_cut_picture, map_picture
from codegen.figures.runs import run_chart, run_picture
from codegen.files import write_atomically
from codegen.map_file import map as npz
from codegen.optimum.nonlinear import slip_use
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.solve import solve_case
from codegen.report import style as look
from codegen.report.map_difference import map_difference_picture
from codegen.report.paper import overview_picture
from scripts.guide import frame_layout, gust_margins, map_choice, sketches

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hil_sim.scenarios import Scenario

ROOT = Path(__file__).resolve().parents[2]
BUILD, RECOMMENDED = ROOT / "generated/4ws2-paper", ROOT / "generated/4ws2"
WIDTH = 7.4
"""inches of a figure over the whole width of a page."""


@functools.cache
def _recommended_map() -> npz.ReferenceMap:
    return npz.load(RECOMMENDED.with_suffix(".npz"))


def _recommended() -> configuration.Config:
    config = _recommended_map().config
    assert config is not None
    return config


def tyre() -> Figure:
    """The tyre's force over slip, its tangent, its linear range."""
    return draw(tyre_picture(configuration.preset()))


def reference_map() -> Figure:
    """The map of the committed build: yaw rate, sideslip, rear angle, and what binds."""
    return draw(map_picture(_recommended_map(), "The recommended 4WS-2 map"))


def cut() -> Figure:
    """The three cases of the paper over speed at 4 deg."""
    paper = configuration.preset()
    maps = {name: solve_case(paper, case) for name, case in (("FWS", "fws"), ("4WS-1", "4ws-1"), ("4WS-2", "4ws-2"))}
    return draw(front_angle_cut_picture(maps, math.radians(4.0)))


@functools.cache
def _steps() -> tuple[Scenario, Mapping[str, FloatArray]]:
    """Return the paper's step steer, driven with the committed builds, with the paper's PI on its FWS map, and without."""
    from codegen.sil.software import load
    from hil_sim.bench import run
    from hil_sim.scenarios import find
    from hil_sim.suite.subjects import of_config

    paper, recommended = load(BUILD), load(RECOMMENDED)
    scenario = find("step-steer", paper.config)
    front_steered = of_config("C2", solve_case(paper.config, "fws"), paper.config).around(paper.config)
    runs = {
        "recommended": run(recommended, find("step-steer", recommended.config)),
        "C1": run(paper, scenario),
        "C2": run(front_steered, scenario),
        "passive": run(paper, scenario, controlled=False),
    }
    return scenario, runs


def overview() -> Figure:
    """The map of the committed build, and the paper's step."""
    scenario, runs = _steps()
    title = f"Optimal yaw-rate map, road friction {_recommended().road.friction:g}"
    return draw(overview_picture(_recommended_map(), runs, title, scenario.steer_time))


def step() -> Figure:
    """The paper's step steer: both kinds of controller, and the passive car."""
    scenario, runs = _steps()
    shown = {name: runs[name] for name in ("recommended", "C1", "passive")}
    chart = run_chart(shown, None, scenario.title, origin=scenario.steer_time, time_label=AFTER_STEP)
    return draw(run_picture(chart, scenario.title))


def choice(speed_km_h: float = 43.35, front_angle_deg: float = 4.0) -> Figure:
    """One operating point of the optimisation: the objective, and how much of each bound is used, over the rear angle."""
    paper = configuration.preset()
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    car, speed, front = problem.car, np.array(speed_km_h * KM_H), math.radians(front_angle_deg)
    rear = np.radians(np.linspace(-4.5, 3.0, 601))
    yaw_rate = car.yaw_gain(speed) * (front - rear)
    sideslip = rear + yaw_rate * car.sideslip_per_yaw_rate(speed)
    acceleration = np.abs(speed * yaw_rate)
    used = {
        "sideslip": (np.abs(sideslip) / problem.sideslip_max, look.PURPLE),
        "lateral acceleration": (acceleration / problem.lateral_acceleration_max, look.GREEN),
        "front slip": (acceleration * car.front_slip_per_lateral_acceleration / problem.front_slip_max, look.VERMILION),
        "rear slip": (acceleration * car.rear_slip_per_lateral_acceleration / problem.rear_slip_max, look.ORANGE),
        "rear angle": (np.abs(rear) / problem.rear_angle_max, look.BLUE),
    }
    allowed = np.all([share <= 1.0 for share, _ in used.values()], axis=0)
    degrees = np.degrees(rear)
    with look.style():
        figure = look.new_figure(WIDTH, 5.6)
        above, below = figure.subplots(2, 1, sharex=True)
        for weight, colour in ((100.0, look.VERMILION), (3000.0, look.BLUE)):
            objective = -(yaw_rate**2) + weight * sideslip**2
            best = int(np.argmin(np.where(allowed, objective, np.inf)))
            above.plot(degrees, objective, color=colour, label=rf"$\lambda$ = {weight:g} s$^{{-2}}$")
            above.plot(degrees[best], objective[best], "o", color=colour, markersize=7)
            place = f"{np.degrees(yaw_rate[best]):.1f} deg/s\nat {degrees[best]:.2f} deg"
            side = {"ha": "right", "xytext": (-8, 8)} if weight < 1000.0 else {"ha": "left", "xytext": (6, -24)}
            at = (degrees[best], objective[best])
            above.annotate(place, at, textcoords="offset points", color=colour, **side)
        above.set(ylabel=r"Objective $-r^2+\lambda\beta^2$", ylim=(-0.5, 1.5))
        above.legend(loc="upper right")
        above.set_title(rf"Front angle {front_angle_deg:g} deg at {speed_km_h:g} km/h")
        for name, (share, colour) in used.items():
            below.plot(degrees, share, color=colour, label=name, linestyle="--" if name == "rear slip" else "-")
        below.axhline(1.0, color=look.BLACK, linewidth=0.9)
        below.set(ylabel="Share of the bound used", xlabel=f"Rear angle {look.REAR_ANGLE} (deg)", ylim=(0.0, 1.6))
        below.legend(loc="upper right", ncols=2)
        for axes in (above, below):
            axes.fill_between(degrees, *axes.get_ylim(), where=~allowed, color=COLOURS[EMPTY], linewidth=0.0, zorder=0)
            axes.set_xlim(degrees[0], degrees[-1])
            axes.grid(True)
    return figure


def rules() -> Figure:
    """Draw the rule that each cell of the total map comes from, for the paper's map, which has all of them."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    total = extend(npz.load(BUILD.with_suffix(".npz")), configuration.preset())
    colours = {Rule.ZERO: "#BDBDBD", Rule.SOLVED: "#9ECAE1", Rule.HOLD: look.ORANGE, Rule.PASSIVE_SLOPE: look.GREEN}
    words = {**RULE_TEXT, Rule.ZERO: "linear, from zero at zero speed and at zero front angle"}
    kinds = list(colours)
    table = np.array([[kinds.index(Rule(letter)) for letter in row] for row in total.rule])
    # What lies between two breakpoints shows the rule of the upper one; the first cells rise from zero.
    between = table[1:, 1:].copy()
    between[0, :], between[:, 0] = kinds.index(Rule.ZERO), kinds.index(Rule.ZERO)
    with look.style():
        figure = look.new_figure(WIDTH, 4.4)
        axes = figure.subplots()
        speed, angle = total.speed / KM_H, np.degrees(total.front_angle)
        shades = ListedColormap([colours[kind] for kind in kinds])
        axes.pcolormesh(speed, angle, between.T, cmap=shades, vmin=-0.5, vmax=len(kinds) - 0.5, shading="flat", rasterized=True)
        axes.set(xlabel=look.SPEED_LABEL, ylabel=look.FRONT_ANGLE_LABEL, xlim=(0.0, speed[-1]), ylim=(0.0, angle[-1]))
        figure.legend(
            handles=[Patch(color=colours[kind], label=words[kind]) for kind in kinds], loc="outside lower center", ncols=1
        )
        axes.set_title("Where the total map comes from")
    return figure


def nonlinear() -> Figure:
    """The map of the committed build beside that of the same case with the linear tyre."""
    maps = solve_case(_recommended().with_tyre_model("linear"), "4ws-2"), _recommended_map()
    names = "linear tyre", "nonlinear tyre"
    return draw(map_difference_picture(maps, (slip_use(maps[0]), slip_use(maps[1])), names))


def margins() -> Figure:
    """Gain and phase margin over speed of the configured car, and of the worst of the family where the gains were designed."""
    recommended, paper = _recommended(), configuration.preset()
    schedule = recommended.controller.tracking.schedule
    assert schedule is not None
    speed_km_h = np.geomspace(*margin_range_km_h(recommended), 120)
    speed = speed_km_h * KM_H
    constant = [np.full(speed.shape, gain) for gain in (paper.controller.proportional_gain_s, paper.controller.integral_gain)]
    lines = (
        ("kind pi, the paper's fixed gains", look.VERMILION, nominal_margins(paper, speed, *constant)),
        ("kind tracking, scheduled", look.BLUE, nominal_margins(recommended, speed, *gains_of(schedule)(speed))),
    )
    designed = np.array(schedule.speed_km_h)
    families = [
        family_margins(recommended, designed * KM_H, *gains_of(schedule)(designed * KM_H), slow=s)[0] for s in (False, True)
    ]
    sides = (
        ("Gain margin (dB)", "gain_margin_db", WARN_GAIN_MARGIN_DB),
        ("Phase margin (deg)", "phase_margin_deg", WARN_PHASE_MARGIN_DEG),
    )
    groups = (("", "v", look.BLUE, "all but slow cars"), ("slow_", "^", look.ORANGE, "slow cars"))
    with look.style():
        figure = look.new_figure(WIDTH, 3.6)
        for axes, (label, field, warning) in zip(figure.subplots(1, 2), sides, strict=True):
            for name, colour, found in lines:
                axes.plot(speed_km_h, getattr(found, field), color=colour, label=f"{name}: the car itself")
            for (prefix, marker, colour, whose), found in zip(groups, families, strict=True):
                worst, demand = getattr(found, field), getattr(recommended.tuning, f"{prefix}{field}")
                axes.plot(
                    designed, worst, marker, color=colour, markerfacecolor=look.WHITE, label=f"worst of {whose}, designed"
                )
                axes.axhline(demand, color=colour, linestyle="--", linewidth=1.1, label=f"required of {whose}")
            axes.axhline(warning, color=look.GREY, linestyle=":", linewidth=1.1, label="a build warns below")
            axes.set(xlabel=look.SPEED_LABEL, ylabel=label, xlim=(speed_km_h[0] - 4.0, speed_km_h[-1] + 4.0), ylim=(0.0, None))
            axes.grid(True)
        handles = axes.get_legend_handles_labels()[0]
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def bounds() -> Figure:
    """Range of the limiter over speed."""
    from codegen.sil.software import load

    parameters = load(RECOMMENDED).parameters()  # owns the memory of the limiter's
    limiter = parameters.limiter
    speeds, angles = (np.array(list(values)) for values in (limiter.opposite_phase_speed, limiter.opposite_phase_max))
    speed = np.linspace(0.0, _recommended().top_speed_km_h, 641)
    opposite = np.degrees(np.interp(speed * KM_H, speeds, angles))
    with look.style():
        figure = look.new_figure(WIDTH, 3.3)
        axes = figure.subplots()
        largest = math.degrees(limiter.rear_angle_max)
        axes.fill_between(speed, -opposite, largest, color=look.SKY, alpha=0.35, linewidth=0.0)
        axes.plot(speed, -opposite, color=look.BLUE)
        axes.axhline(largest, color=look.BLUE)
        axes.axhline(0.0, color=look.GREY, linewidth=0.8)
        axes.text(8.0, 1.6, "in phase: the whole angle,\nonce the front wheels are turned", color=look.BLUE)
        axes.text(78.0, -2.9, "opposite phase:\nless at speed", color=look.BLUE)
        axes.set(title="The limiter, in a left turn", xlabel=look.SPEED_LABEL, ylabel=f"Rear angle {look.REAR_ANGLE} (deg)")
        axes.set_xlim(speed[0], speed[-1])
        axes.grid(True)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "overview": overview,
    "signs": sketches.signs,
    "dataflow": sketches.data_flow,
    "status": sketches.status_machine,
    "frames": functools.partial(frame_layout.frames, RECOMMENDED / "ars.dbc"),
    "tracking-law": sketches.tracking_law,
    "tyre": tyre,
    "choice": choice,
    "map": reference_map,
    "cut": cut,
    "nonlinear": nonlinear,
    "rules": rules,
    "choose-paper": functools.partial(map_choice.maps_figure, "paper"),
    "choose-van": functools.partial(map_choice.maps_figure, "van"),
    "choose-keys-paper": functools.partial(map_choice.keys_figure, "paper", 60.0),
    "choose-keys-van": functools.partial(map_choice.keys_figure, "van", 120.0),
    "margins": margins,
    "gust": gust_margins.figure,
    "bounds": bounds,
    "step": step,
}


SHADED = ("overview", "map", "nonlinear")
"""Figures with shades of colour, which 256 colours would turn into bands."""


def _small(png: bytes, shaded: bool) -> bytes:
    """Return a picture without transparency. One that is not `shaded` gets at most 256 colours, each within 14 of 255 of the
    original: a third of the bytes."""
    from PIL import Image

    small = io.BytesIO()
    with Image.open(io.BytesIO(png)) as picture:
        plain = picture.convert("RGB")
        reduced = plain if shaded else plain.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        reduced.save(small, "png", optimize=True, dpi=picture.info["dpi"])
    return small.getvalue()


def draw_all(folder: Path) -> list[Path]:
    """Draw every figure into a folder, and return those that are new or have changed."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, make in FIGURES.items():
        path, content = folder / f"{name}.png", _small(to_bytes(make()), name in SHADED)
        if not path.is_file() or path.read_bytes() != content:
            write_atomically(path, content)
            written.append(path)
    return written
