"""View model of the safety limiter: its parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

from codegen.config import KM_H, Config
from codegen.emit.parameters import RATE_OFF, Parameter, ParameterView, parameter_views
from codegen.emit.text import Precision, literal
from codegen.vehicle.single_track import SingleTrack

POINTS = "{PREFIX}_LIMITER_POINTS"


@dataclass(frozen=True)
class LimiterView:
    """Everything that the limiter's templates print."""

    parameters: tuple[ParameterView, ...]
    points: int
    sampling_time: str
    period_text: str


def _opposite_phase_max(config: Config) -> list[float]:
    """rad at each breakpoint."""
    limiter = config.limiter
    bounds = limiter.opposite_phase_max_deg
    if bounds == "off":
        return [math.inf] * len(limiter.opposite_phase_speed_km_h)
    if bounds == "from-car":
        car, wanted = SingleTrack.from_config(config), limiter.opposite_phase_lateral_acceleration_m_s2
        squares = [(speed * KM_H) ** 2 for speed in limiter.opposite_phase_speed_km_h]
        # An oversteering car reaches it with less and less, beyond its critical speed with none.
        return [max(wanted * (car.wheelbase + car.understeer_coefficient * square) / square, 0.0) for square in squares]
    return [math.radians(angle) for angle in bounds]


def limiter_parameters(config: Config) -> tuple[Parameter, ...]:
    """The fields of `<prefix>_limiter_parameters_t`, in order."""
    limiter, inputs, angle_max = config.limiter, config.controller.inputs, config.rear_actuator.angle_max
    rate, bounds = limiter.rear_rate_max_deg_s, limiter.opposite_phase_max_deg
    off = bounds == "off"
    angles = [min(angle, angle_max) for angle in _opposite_phase_max(config)]
    return (
        Parameter("rear_angle_max", angle_max, "rad, of the demand in any case", 1e-4, 1.0),
        Parameter(
            "rear_rate_max",
            RATE_OFF if rate == "off" else math.radians(rate),
            "rad/s" + (" (off)" if rate == "off" else ""),
            1e-4,
            RATE_OFF,
        ),
        Parameter(
            "opposite_phase_speed",
            tuple(speed * KM_H for speed in limiter.opposite_phase_speed_km_h),
            "m/s, breakpoints, increasing",
            0.0,
            200.0,
            POINTS,
            increasing=True,
        ),
        Parameter(
            "opposite_phase_max",
            tuple(angles),
            "rad against the front wheels, at those speeds" + (" (off)" if off else ""),
            0.0,
            1.0,
            POINTS,
        ),
        Parameter(
            "in_phase_from_front_angle",
            limiter.in_phase_from_front_angle,
            "rad of front angle from which on all of rear_angle_max is free in phase",
            1e-4,
            1.0,
        ),
        Parameter("speed_max", inputs.speed_max_km_h * KM_H, "m/s, beyond it a speed is none", 1.0, 200.0),
        Parameter(
            "front_angle_max", math.radians(inputs.front_angle_max_deg), "rad, beyond it a front angle is none", 0.01, 1.5
        ),
    )


def limiter_view(config: Config, prefix: str, precision: Precision, real: str) -> LimiterView:
    """The view of a configuration's limiter."""
    period = config.controller.sampling_time_s
    return LimiterView(
        parameters=parameter_views(limiter_parameters(config), prefix, precision, real),
        points=len(config.limiter.opposite_phase_speed_km_h),
        sampling_time=literal(period, precision),
        period_text=f"{period * 1e3:g} ms",
    )
