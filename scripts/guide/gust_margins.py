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
from codegen.map_file.map import load
from codegen.report import style as look
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
        ("worst of the family without slow cars", False, look.BLUE, (tuning.gain_margin_db, tuning.phase_margin_deg)),
        ("worst of its slow cars", True, look.VERMILION, (tuning.slow_gain_margin_db, tuning.slow_phase_margin_deg)),
    )
    sides = (
        (f"Heading {row.GUST_READ_S:g} s\nafter the gust (deg)", np.degrees(after[0]), row.HEADING_MAX_DEG),
        (f"Path {row.GUST_READ_S:g} s\nafter the gust (m)", after[1], row.PATH_MAX_M),
    )
    with look.style():
        made = look.new_figure(7.4, 5.4)
        panels = made.subplots(2, 2, sharex="col", sharey="row")
        for title, slow, colour, required in kinds:
            found = [
                family_margins(config, speed[designed], kp[designed], each * ki[designed], slow=slow)[0] for each in FACTORS
            ]
            margins = ([each.gain_margin_db.min() for each in found], [each.phase_margin_deg.min() for each in found])
            for column, margin, least in zip(panels.T, margins, required, strict=True):
                for axes, (_, values, _) in zip(column, sides, strict=True):
                    axes.plot(margin, values, color=colour, label=title)
                    axes.plot(margin[DESIGN], values[DESIGN], "o", color=colour, label=f"{title}: as designed")
                    axes.axvline(least, color=colour, linestyle=":", label=f"{title}: required margin")
        for line, (label, _, goal) in zip(panels, sides, strict=True):
            line[0].set_ylabel(label)
            for axes in line:
                axes.axhline(goal, color=look.GREEN, linestyle="--", label="goal")
                axes.set_ylim(bottom=0.0)
                axes.grid(True)
        for axes, label in zip(panels[1], ("Gain margin (dB)", "Phase margin (deg)"), strict=True):
            axes.set_xlabel(label)
        handles = axes.get_legend_handles_labels()[0]
        made.legend(handles=handles, loc="outside lower center", ncols=2)
    return made
