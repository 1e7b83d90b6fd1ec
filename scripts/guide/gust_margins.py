"""Figure of the page on controllers: a gust against the margins, over the integral gain.

The gust is that of the benchmark `law`, row 10. The linear car is that of the design, `continuous` of `codegen.design.sampled`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.family import Member, nominal
from codegen.design.margins import family_margins, gains_of
from codegen.design.sampled import BETA, YAW_RATE, continuous, matrix_exponential
from codegen.emit.laws import schedule_of
from codegen.figures.data import (
    BLUE,
    GREEN,
    VERMILION,
    Chart,
    Picture,
    axis,
    entry,
    level,
    line,
    panel,
    points,
    upright,
)
from codegen.figures.draw import draw
from codegen.map_file.map import load
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from scripts.guide.suite_tables import BUILD

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FACTORS = 2.0 ** np.linspace(-2.0, 1.5, 29)
"""Integral gains over the designed one."""
DESIGN = 16
"""Place of the factor 1."""


@dataclass(frozen=True)
class Gust:
    """Side force at the front axle in N, its duration in s, and the time in s after its end of the reading."""

    force: float
    duration: float
    read_after: float


def respond(config: Config, member: Member, gust: Gust, speed: FloatArray, kp: FloatArray, ki: FloatArray) -> FloatArray:
    """Return heading in rad and lateral deviation in m after a gust, (2, ...) for gains (..., n) at speeds (n,) in m/s.

    The car goes straight ahead with ideal sensors, and the command acts with the delay of `[tuning]`.
    """
    car, period = SingleTrack.from_config(config), config.controller.sampling_time_s
    a, b = continuous(config, [member], speed)
    size = b.shape[-1]
    heading, path, command, force = range(size, size + 4)
    whole = np.zeros((speed.size, size + 4, size + 4))
    whole[:, :size, :size], whole[:, :size, command] = a[0], b[0]
    mass = car.mass * member.mass_factor
    whole[:, BETA, force] = 1.0 / (mass * speed)
    whole[:, YAW_RATE, force] = car.front_arm / (car.yaw_inertia * member.mass_factor * member.yaw_inertia_factor)
    whole[:, heading, YAW_RATE] = 1.0
    whole[:, path, BETA] = whole[:, path, heading] = speed
    step = matrix_exponential(whole * period)
    state = np.zeros((*np.broadcast_shapes(kp.shape, ki.shape), size + 4))
    integral = np.zeros(state.shape[:-1])
    waiting = [integral] * config.designed_delay_samples
    for k in range(round((gust.duration + gust.read_after) / period)):
        integral = integral + period * state[..., YAW_RATE]
        waiting.append(kp * state[..., YAW_RATE] + ki * integral)
        state[..., command], state[..., force] = waiting.pop(0), gust.force if k < round(gust.duration / period) else 0.0
        state = (step @ state[..., np.newaxis])[..., 0]
    return np.stack((state[..., heading], state[..., path]))


def figure() -> Figure:
    """Draw heading and path after the gust over gain and phase margin, for multiples of the designed integral gain."""
    from benchmarks import law_response as row

    config = load(BUILD.with_suffix(".npz")).config
    assert config is not None
    speed = np.array(row.GUST_SPEEDS_KM_H) * KM_H
    kp, ki = gains_of(schedule_of(config))(speed)
    gust = Gust(row.GUST_N, row.GUST_S, row.GUST_READ_S)
    after = np.abs(respond(config, nominal(config), gust, speed, kp, FACTORS[:, np.newaxis] * ki)).max(axis=-1)
    designed = speed <= config.top_speed_km_h * KM_H
    tuning = config.tuning
    kinds = (
        ("all but slow cars", False, BLUE, (tuning.gain_margin_db, tuning.phase_margin_deg)),
        ("slow cars", True, VERMILION, (tuning.slow_gain_margin_db, tuning.slow_phase_margin_deg)),
    )
    sides = (
        (f"Heading {row.GUST_READ_S:g} s<br>after the gust (deg)", np.degrees(after[0]), row.HEADING_MAX_DEG),
        (f"Path {row.GUST_READ_S:g} s<br>after the gust (m)", after[1], row.PATH_MAX_M),
    )
    margins = [_worst_margins(config, speed[designed], kp[designed], ki[designed], slow) for _, slow, _, _ in kinds]
    rows: list[list[Chart | None]] = []
    for label, values, goal in sides:
        charts: list[Chart | None] = []
        for k, title in enumerate(("Gain margin (dB)", "Phase margin (deg)")):
            data, shapes = [], [level(goal, colour=GREEN, dash="dash", width=2)]
            for (whose, _, colour, required), found in zip(kinds, margins, strict=True):
                data.append(line(found[k], values, f"worst of {whose}", colour))
                data.append(points(found[k][[DESIGN]], values[[DESIGN]], f"{whose}: as designed", colour, size=10))
                data.append(entry(f"{whose}: required margin", colour, "dot", 2))
                shapes.append(upright(required[k], colour, width=2))
            data.append(entry("goal", GREEN, "dash", 2))
            x = axis(title, range=[0.0, 1.05 * max(found[k].max() for found in margins)])
            y = axis(label, range=[0.0, 1.05 * values.max()])
            charts.append(panel(data, x, y, shapes=shapes))
        rows.append(charts)
    return draw(Picture(rows, (7.4, 5.6)))


def _worst_margins(config: Config, speed: FloatArray, kp: FloatArray, ki: FloatArray, slow: bool) -> FloatArray:
    """Return the least gain margin in dB and phase margin in deg of a family, (2, k) for each of FACTORS."""
    found = [family_margins(config, speed, kp, each * ki, slow=slow)[0] for each in FACTORS]
    return np.array([[each.gain_margin_db.min() for each in found], [each.phase_margin_deg.min() for each in found]])
