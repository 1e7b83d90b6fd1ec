"""Find the cells of a map that the limiter cuts: cells whose steady rear angle lies outside its range."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.emit.limiter_view import opposite_phase_max, opposite_phase_speeds_km_h
from codegen.map_file.map import ReferenceMap
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack

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
        for layer in (reference_map, *(layer.map for layer in reference_map.layers)):
            rear = front_angle - layer.yaw_rate / gain if layer.rear_angle is None else layer.rear_angle
            outside = np.where(layer.feasible, np.abs(rear - np.clip(rear, -bound, in_phase)), 0.0)
            total += int(layer.feasible.sum())
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
