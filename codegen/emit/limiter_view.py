"""View model of the safety limiter: its parameters; and the cells of a map whose steady rear angle lies outside its range."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.configuration.controller import REAR_RATE_MIN_DEG_S
from codegen.emit.parameters import RATE_OFF, Parameter, rate_key
from codegen.map_file.map import ReferenceMap
from codegen.units import KM_H, M_S, RAD, RAD_S
from codegen.vehicle.single_track import SingleTrack

POINTS = "LIMITER_POINTS"
POINTS_FROM_CAR = 6
"""Number of breakpoints of the opposite-phase bound if they are derived from the car."""
FIRST_SPEED_SHARE_MAX = 0.9
"""The first of them is at most this share of the last, so that they differ in any precision."""


def opposite_phase_speeds_km_h(config: Config) -> list[float]:
    """Return the breakpoints of the opposite-phase bound: as listed, or derived from the car.

    If they come from the car, the first is the speed at which a (L + K vx^2) / vx^2 falls to the actuator's angle, rounded
    down. The last is the largest speed that the controller accepts. They are evenly spaced in 1/vx, which minimises the largest
    interpolation error: the curvature of a bound in 1/vx^2 is proportional to 1/vx^4, and the best density of breakpoints to
    the square root of the curvature (C. de Boor, A Practical Guide to Splines, chapter III).
    """
    limiter, top = config.limiter, config.controller.inputs.speed_max_km_h
    if not isinstance(limiter.opposite_phase_speed_km_h, str):
        return limiter.opposite_phase_speed_km_h
    wheelbase, understeer = _wheelbase_and_understeer(config)
    wanted = limiter.opposite_phase_lateral_acceleration_m_s2
    falling = config.rear_actuator.angle_max / wanted - understeer  # the share of L / vx^2
    first = math.sqrt(wheelbase / falling) / KM_H if falling > 0.0 else math.inf
    first = math.floor(10.0 * min(first, FIRST_SPEED_SHARE_MAX * top)) / 10.0
    steps = POINTS_FROM_CAR - 1
    inside = (1.0 / (1.0 / first + (1.0 / top - 1.0 / first) * k / steps) for k in range(1, steps))
    return [first, *(round(speed, 1) for speed in inside), top]


def opposite_phase_max(config: Config) -> list[float]:
    """Return the opposite-phase bound at each of these breakpoints, in rad. It is at most the actuator's angle."""
    limiter, speeds, largest = config.limiter, opposite_phase_speeds_km_h(config), config.rear_actuator.angle_max
    bounds = limiter.opposite_phase_max_deg
    if bounds == "off":
        return [largest] * len(speeds)
    if bounds == "from-car":
        wheelbase, understeer = _wheelbase_and_understeer(config)
        wanted = limiter.opposite_phase_lateral_acceleration_m_s2
        return [min(wanted * (wheelbase / (speed * KM_H) ** 2 + understeer), largest) for speed in speeds]
    return [min(math.radians(angle), largest) for angle in bounds]


def _wheelbase_and_understeer(config: Config) -> tuple[float, float]:
    """Return L in m and K in s^2/m. K of an oversteering car counts as zero.

    The bound of an oversteering car would reach zero at its critical speed, where only feedback keeps the car stable. The
    limiter must leave some angle to that feedback.
    """
    car = SingleTrack.from_config(config)
    return car.wheelbase, max(car.understeer_coefficient, 0.0)


def limiter_parameters(config: Config) -> tuple[Parameter, ...]:
    """Return the fields of `<prefix>_limiter_parameters_t`, in order."""
    limiter, inputs, angle_max = config.limiter, config.controller.inputs, config.rear_actuator.angle_max
    rate, off = limiter.rear_rate_max_deg_s, limiter.opposite_phase_max_deg == "off"
    return (
        Parameter("rear_angle_max", angle_max, RAD, "largest command", 1e-4, 1.0),
        Parameter(
            "rear_rate_max",
            RATE_OFF if rate == "off" else math.radians(rate),
            RAD_S,
            "largest rate of the command" + (" (off)" if rate == "off" else ""),
            math.radians(REAR_RATE_MIN_DEG_S),
            RATE_OFF,
            key="limiter.rear_rate_max_deg_s",
            to_key=rate_key,
        ),
        Parameter(
            "opposite_phase_speed",
            tuple(speed * KM_H for speed in opposite_phase_speeds_km_h(config)),
            M_S,
            "speeds of the opposite-phase bound",
            0.0,
            200.0,
            POINTS,
            increasing=True,
            key="limiter.opposite_phase_speed_km_h",
            to_key=lambda speed: speed / KM_H,
        ),
        Parameter(
            "opposite_phase_max",
            tuple(opposite_phase_max(config)),
            RAD,
            "largest angle opposite to the front wheels at those speeds" + (" (off)" if off else ""),
            0.0,
            1.0,
            POINTS,
            key="limiter.opposite_phase_max_deg",
            to_key=math.degrees,
        ),
        Parameter(
            "in_phase_from_front_angle",
            limiter.in_phase_from_front_angle,
            RAD,
            "front angle from which the full in-phase angle is allowed",
            1e-4,
            1.0,
            key="limiter.in_phase_from_front_angle_deg",
            to_key=math.degrees,
        ),
        Parameter("speed_max", inputs.speed_max_km_h * KM_H, M_S, "largest valid speed; larger ones are ignored", 1.0, 200.0),
        Parameter(
            "front_angle_max",
            math.radians(inputs.front_angle_max_deg),
            RAD,
            "largest valid front angle; larger ones are ignored",
            0.01,
            1.5,
        ),
    )


@dataclass(frozen=True)
class LimiterView:
    """Values that the templates of the limiter print."""

    config: Config

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Fields of `<prefix>_limiter_parameters_t`."""
        return limiter_parameters(self.config)

    @property
    def points(self) -> int:
        """Number of breakpoints of the opposite-phase bound."""
        return len(opposite_phase_speeds_km_h(self.config))


CUT_MIN_RAD = 1e-6
"""Smallest difference that counts, in rad: single precision resolves an angle of 0.1 rad to 7e-9, a solver to about 1e-8."""


def limiter_bounds(config: Config, speed: FloatArray, front_angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the largest rear angles in opposite phase and in phase, in rad, for speeds in m/s and |front angles| in rad."""
    bound = np.interp(speed, np.array(opposite_phase_speeds_km_h(config)) * KM_H, opposite_phase_max(config))
    share = np.clip(front_angle / config.limiter.in_phase_from_front_angle, 0.0, 1.0)
    return bound, bound + share * (config.rear_actuator.angle_max - bound)


@dataclass(frozen=True)
class LimiterCut:
    """Cells of a map that the limiter makes unreachable in steady state.

    Attributes:
        cells, of: number of feasible cells that are cut, and of all feasible cells, including the layers of a stack.
        largest: largest change of the steady yaw rate in rad/s, with the gain of the linear car.
        speed, front_angle: m/s and rad of that cell; NaN if nothing is cut.
    """

    cells: int
    of: int
    largest: float
    speed: float
    front_angle: float

    @classmethod
    def of_map(cls, reference_map: ReferenceMap, config: Config) -> LimiterCut:
        """Return the cut of a configuration's limiter. A map without rear angles is assumed to have those of the linear car."""
        speed, front_angle = np.meshgrid(reference_map.speed, reference_map.front_angle, indexing="ij")
        gain = SingleTrack.from_config(config).yaw_gain(np.fmax(speed, 1e-9))
        bound, in_phase = limiter_bounds(config, speed, front_angle)
        cells = total = 0
        worst = (0.0, math.nan, math.nan)
        for own in (reference_map, *(layer.map for layer in reference_map.layers)):
            rear = front_angle - own.yaw_rate / gain if own.rear_angle is None else own.rear_angle
            outside = np.where(own.feasible, np.abs(rear - np.clip(rear, -bound, in_phase)), 0.0)
            total += int(own.feasible.sum())
            cells += int((outside > CUT_MIN_RAD).sum())
            lost = np.where(outside > CUT_MIN_RAD, np.abs(gain) * outside, 0.0)
            at = np.unravel_index(int(lost.argmax()), lost.shape)
            if lost[at] > worst[0]:
                worst = (float(lost[at]), float(speed[at]), float(front_angle[at]))
        return cls(cells, total, *worst)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values, rounded so that they do not depend on the machine. The location is null if nothing is cut."""
        return {
            "cells": self.cells,
            "of": self.of,
            "largest_deg_s": round(math.degrees(self.largest), 2),
            "at_km_h": round(self.speed / KM_H, 1) if self.cells else None,
            "at_front_angle_deg": round(math.degrees(self.front_angle), 2) if self.cells else None,
        }


def cut_text(found: Mapping[str, Any]) -> str:
    """Return a line for console, README and report from `LimiterCut.to_dict`."""
    if not found["cells"]:
        return "nothing"
    return (
        f"{found['cells']} of {found['of']} feasible cells ({100.0 * found['cells'] / found['of']:.1f} %), by up to "
        f"{found['largest_deg_s']:g} deg/s ({found['at_km_h']:g} km/h, {found['at_front_angle_deg']:g} deg)"
    )
