"""The figures of the guide: all are drawn from the code, the committed maps and runs of the committed builds.

Same code, same bytes.
"""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
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
from codegen.figures.curves import tyre_picture
from codegen.figures.data import (
    AFTER_STEP,
    BLUE,
    EMPTY,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY,
    SPEED_TITLE,
    VERMILION,
    WHITE,
    Chart,
    Picture,
    axis,
    entry,
    legend_at,
    level,
    line,
    panel,
    points,
    span,
    text,
)
from codegen.figures.draw import draw, to_bytes
from codegen.figures.maps import NamedMap, front_angle_cut_picture, map_picture
from codegen.figures.runs import run_chart, run_picture
from codegen.files import write_atomically
from codegen.map_file import map as npz
from codegen.optimum.nonlinear import slip_use
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.solve import solve_case
from codegen.report.html.report import extended
from codegen.report.map_difference import map_difference_picture
from codegen.report.paper import overview_picture
from scripts.guide import frame_layout, gust_margins, map_choice, sketches

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hil_sim.scenarios import Scenario

ROOT = Path(__file__).resolve().parents[2]
BUILD, RECOMMENDED = ROOT / "generated/4ws2-paper", ROOT / "generated/4ws2"
REAR_ANGLE = "Rear angle δ<sub>r</sub> (deg)"
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
    from hil_sim.scenario_files import find
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
        "sideslip": (np.abs(sideslip) / problem.sideslip_max, PURPLE),
        "lateral acceleration": (acceleration / problem.lateral_acceleration_max, GREEN),
        "front slip": (acceleration * car.front_slip_per_lateral_acceleration / problem.front_slip_max, VERMILION),
        "rear slip": (acceleration * car.rear_slip_per_lateral_acceleration / problem.rear_slip_max, ORANGE),
        "rear angle": (np.abs(rear) / problem.rear_angle_max, BLUE),
    }
    allowed = np.all([share <= 1.0 for share, _ in used.values()], axis=0)
    degrees = np.degrees(rear)
    edges = degrees[np.flatnonzero(np.diff(allowed))]
    shades = [span(degrees[0], edges[0], EMPTY), span(edges[-1], degrees[-1], EMPTY)]
    objectives, notes = [], []
    for weight, colour in ((100.0, VERMILION), (3000.0, BLUE)):
        objective = -(yaw_rate**2) + weight * sideslip**2
        best = int(np.argmin(np.where(allowed, objective, np.inf)))
        at = degrees[best], objective[best]
        objectives += [line(degrees, objective, f"λ = {weight:g} s⁻²", colour), points(at[:1], at[1:], "", colour, size=11)]
        words = f"{np.degrees(yaw_rate[best]):.1f} deg/s<br>at −{-degrees[best]:.2f} deg"
        left = {"xanchor": "right", "yanchor": "bottom", "xshift": -8, "yshift": 8}
        right = {"xanchor": "left", "yanchor": "top", "xshift": 6, "yshift": -2}
        notes.append(text(words, *at, font={"color": colour}, **(left if weight < 1000.0 else right)))
    shares = [
        line(degrees, share, name, colour, dash="dash" if name == "rear slip" else "solid")
        for name, (share, colour) in used.items()
    ]
    x = axis(REAR_ANGLE, range=[degrees[0], degrees[-1]])
    own = {"shapes": shades, "legend": legend_at(1.0, 0.98)}
    above = axis("Objective −r² + λβ² (rad²/s²)", range=[-0.5, 1.5])
    below = axis("Share of the bound used", range=[0.0, 2.0])
    title = f"Front angle {front_angle_deg:g} deg at {speed_km_h:g} km/h"
    limit = {**own, "shapes": [*shades, level(1.0, colour=INK, dash="solid")]}
    rows = [[panel(objectives, x, above, title=title, annotations=notes, **own)], [panel(shares, x, below, **limit)]]
    return draw(Picture(rows, (WIDTH, 5.6)))


def rules() -> Figure:
    """Draw the rule that each cell of the total map comes from, for the paper's map."""
    chart, _ = extended(NamedMap("", npz.load(BUILD.with_suffix(".npz"))), configuration.preset())
    return draw(Picture([[replace(chart, title="Where the total map comes from")]], (WIDTH, 4.4)))


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
        ("kind pi, the paper's fixed gains: nominal car", VERMILION, nominal_margins(paper, speed, *constant)),
        ("kind tracking: nominal car", BLUE, nominal_margins(recommended, speed, *gains_of(schedule)(speed))),
    )
    designed = np.array(schedule.speed_km_h)
    families = [
        family_margins(recommended, designed * KM_H, *gains_of(schedule)(designed * KM_H), slow=s)[0] for s in (False, True)
    ]
    sides = (
        ("Gain margin (dB)", "gain_margin_db", WARN_GAIN_MARGIN_DB),
        ("Phase margin (deg)", "phase_margin_deg", WARN_PHASE_MARGIN_DEG),
    )
    groups = (("", "triangle-down", BLUE, "all but slow cars"), ("slow_", "triangle-up", ORANGE, "slow cars"))
    charts: list[Chart | None] = []
    for label, field, warning in sides:
        data = [line(speed_km_h, getattr(found, field), name, colour) for name, colour, found in lines]
        shapes = [level(warning)]
        for (prefix, symbol, colour, whose), found in zip(groups, families, strict=True):
            ring = {"color": WHITE, "line": {"color": colour, "width": 1.5}}
            name = f"kind tracking: worst of {whose}"
            data.append(points(designed, getattr(found, field), name, colour, symbol, 9, marker=ring))
            data.append(entry(f"required of {whose}", colour, "dash", 1.4))
            shapes.append(level(getattr(recommended.tuning, f"{prefix}{field}"), colour=colour, dash="dash", width=1.4))
        data.append(entry("codegen build warns below", MUTED, "dot"))
        x = axis(SPEED_TITLE, range=[speed_km_h[0] - 4.0, speed_km_h[-1] + 4.0])
        charts.append(panel(data, x, axis(label, rangemode="tozero"), shapes=shapes))
    return draw(Picture([charts], (WIDTH, 3.8)))


def bounds() -> Figure:
    """Range of the limiter over speed."""
    from codegen.sil.software import load

    parameters = load(RECOMMENDED).parameters()  # owns the memory of the limiter's
    limiter = parameters.limiter
    speeds, angles = (np.array(list(values)) for values in (limiter.opposite_phase_speed, limiter.opposite_phase_max))
    speed = np.linspace(0.0, _recommended().top_speed_km_h, 641)
    opposite = np.degrees(np.interp(speed * KM_H, speeds, angles))
    in_phase = np.full(speed.shape, math.degrees(limiter.rear_angle_max))
    data = [line(speed, in_phase, "", BLUE), line(speed, -opposite, "", BLUE, fill="tonexty", fillcolor=f"{SKY}59")]
    left = {"xanchor": "left", "font": {"color": BLUE}}
    notes = [
        text("in phase: the full angle,<br>once the front wheels are turned", 8.0, 1.9, **left),
        text("opposite phase:<br>a smaller angle at speed", 78.0, -2.6, **left),
    ]
    zero = [level(0.0, dash="solid")]
    chart = panel(
        data,
        axis(SPEED_TITLE),
        axis(REAR_ANGLE),
        title="Range of the rear angle command in a left turn",
        shapes=zero,
        annotations=notes,
    )
    return draw(Picture([[chart]], (WIDTH, 3.3)))


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
