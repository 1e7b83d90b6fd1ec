"""Metrics of slowly increasing steer at constant speed (ISO 4138:2021; FMVSS 126, S7.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from hil_sim.manoeuvres import DWELL_ACCELERATION, STANDARD_GRAVITY
from hil_sim.metrics.run import Metric, Run, common

FIT_FROM, FIT_TO = 0.1 * STANDARD_GRAVITY, 0.375 * STANDARD_GRAVITY
"""Range of lateral acceleration, in m/s^2, over which a line is fitted (FMVSS 126, S7.6.1); tyres are nearly linear there."""


@dataclass(frozen=True)
class Line:
    """Straight line fitted to an angle over the lateral acceleration: rad s^2/m and rad."""

    slope: float
    offset: float


def fit_samples(run: Run) -> BoolArray:
    """Return the samples of the ramp from where the lateral acceleration enters the range of the fit to where it leaves it."""
    lateral = np.abs(run["lateral_acceleration_m_s2"])
    beyond = np.flatnonzero(run.after & (lateral > FIT_TO))
    before = np.arange(len(lateral)) < (beyond[0] if beyond.size else len(lateral))
    result: BoolArray = run.after & before & (lateral >= FIT_FROM)
    return result


def fit(run: Run, angle: FloatArray) -> Line | None:
    """Return the line of an angle (samples,) in rad over the lateral acceleration; None where the range was not driven."""
    lateral, chosen = run["lateral_acceleration_m_s2"], fit_samples(run)
    if chosen.sum() < 10 or np.ptp(lateral[chosen]) < 0.5 * (FIT_TO - FIT_FROM):
        return None
    slope, offset = np.polyfit(lateral[chosen], angle[chosen], 1)
    return Line(float(slope), float(offset))


def understeer_gradient(run: Run) -> float | None:
    """Return the slope of the front angle over the lateral acceleration minus L/vx^2 of a neutral car, in rad s^2/m."""
    line = fit(run, run["front_angle_rad"])
    if line is None:
        return None
    speed = float(run["speed_m_s"][fit_samples(run)].mean())
    return line.slope - run.config.vehicle.wheelbase / speed**2


def measure(run: Run) -> list[Metric]:
    """Return the understeer and sideslip gradients, in deg for each m/s^2, and the angles at 0.3 g."""
    chosen = fit_samples(run)
    end = float(run.time[chosen][-1]) if chosen.any() else math.inf
    gradient = understeer_gradient(run)
    sideslip, wheel, rear = (
        fit(run, values) for values in (run["sideslip_rad"], run.steering_wheel_angle, run["rear_angle_rad"])
    )

    def degrees(value: float | None) -> float | None:
        return None if value is None else math.degrees(value)

    def at_03_g(line: Line | None) -> float | None:
        return (
            None
            if line is None
            else line.slope * math.copysign(DWELL_ACCELERATION, run.at(end, "front_angle_rad")) + line.offset
        )

    return [
        Metric("understeer_gradient_deg_s2_m", "understeer gradient", "deg s^2/m", degrees(gradient), 4, end),
        Metric(
            "sideslip_gradient_deg_s2_m",
            "sideslip gradient",
            "deg s^2/m",
            degrees(sideslip.slope if sideslip else None),
            4,
            end,
        ),
        Metric("steering_wheel_at_0_3_g_deg", "steering wheel angle at 0.3 g", "deg", degrees(at_03_g(wheel)), 2, end),
        Metric("rear_angle_at_0_3_g_deg", "rear angle at 0.3 g", "deg", degrees(at_03_g(rear)), 2, end),
        *common(run),
    ]
