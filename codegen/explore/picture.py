"""Data that the page shows of one setting: the map, a cut through it, the step response, the margins, figures.

Everything is in the units of the page: km/h, deg, deg/s, m/s^2, dB. Arrays of a whole grid go as base64 of single precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.family import members
from codegen.design.margins import Margins, concatenate, family_margins, margin_speeds, nominal_margins
from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import Lookup
from codegen.emit.laws import law_of
from codegen.explore.controls import Step
from codegen.explore.recalibrated import Calibration, Recalibrated
from codegen.map_file.bounds import binding_text
from codegen.map_file.map import ReferenceMap
from codegen.plausibility.build import family_warnings
from codegen.report.html import charts
from codegen.report.map_plots import BINDING_COLOURS, OTHER_COLOURS
from codegen.report.style import GREY, phase_lines
from codegen.units import KM_H
from hil_sim import manoeuvres
from hil_sim.manoeuvres import Settings
from hil_sim.metrics.run import column, spin_time
from hil_sim.metrics.step import step_metrics
from hil_sim.scenarios import SCENARIOS

Data = dict[str, Any]

STEER_TIME, DURATION = 0.5, 4.5
"""s. From straight ahead nothing happens before the step; the paper's own recording is longer on both sides of it."""

FAMILY_SPEEDS = 22
CUT_ANGLES = 121
UNBOUNDED_DB, UNBOUNDED_DEG = 40.0, 180.0
"""Larger margins, and unlimited ones, are drawn at this value; a note on the page states it."""


def numbers(values: npt.ArrayLike, digits: int = 4) -> list[float | None]:
    """A list for JSON, rounded; None for what is not finite."""
    array = np.round(np.asarray(values, dtype=np.float64), digits)
    return [value if math.isfinite(value) else None for value in array.tolist()]


def binding_colours(known: Sequence[int]) -> list[str]:
    """The colours of sets of binding constraints, those of the report; a set keeps its own while others are added behind it."""
    others = iter(OTHER_COLOURS)
    return [BINDING_COLOURS.get(flags) or next(others, GREY) for flags in known]


def map_data(reference_map: ReferenceMap, known: list[int]) -> Data:
    """The map in cells; packed tables have rows of front angles and columns of speeds.

    Args:
        known: sets of binding constraints in the order of their colours; those that are new are added.
    """
    active, feasible = reference_map.active, reference_map.feasible
    assert active is not None  # a solved map has all tables
    assert reference_map.sideslip is not None
    assert reference_map.rear_angle is not None
    present, counts = np.unique(active[feasible], return_counts=True)
    known += [int(flags) for flags in present[np.argsort(-counts, kind="stable")] if int(flags) not in known]
    places = np.full(256, 255, dtype=np.uint8)
    places[known] = np.arange(len(known))
    return {
        "speed_km_h": numbers(reference_map.speed / KM_H),
        "front_angle_deg": numbers(np.degrees(reference_map.front_angle)),
        "yaw_rate": charts.numbers(np.degrees(reference_map.yaw_rate).T),
        "sideslip": charts.numbers(np.degrees(reference_map.sideslip).T),
        "rear_angle": charts.numbers(np.degrees(reference_map.rear_angle).T),
        "binding": charts.small(np.where(feasible, places[active], np.uint8(255)).T),
        "binding_names": [binding_text(flags) for flags in known],
        "binding_colours": binding_colours(known),
        "phase_lines": [[numbers(piece[:, 0], 3), numbers(piece[:, 1], 3)] for piece in phase_lines(reference_map)],
        "feasible_percent": round(100.0 * float(feasible.mean()), 1),
    }


def cut_data(total: TotalMap, last_angle: float, speed: float) -> Data:
    """Return the yaw rates that the ECU looks up at one speed (m/s), from zero to the map's last front angle (rad)."""
    angles = np.linspace(0.0, last_angle, CUT_ANGLES)
    yaw_rate, rear_angle = Lookup.from_map(total).reference(speed, angles)
    return {
        "front_angle_deg": numbers(np.degrees(angles)),
        "yaw_rate_deg_s": numbers(np.degrees(yaw_rate)),
        "rear_angle_deg": numbers(np.degrees(rear_angle)),
    }


def drive(software: Recalibrated, calibration: Calibration, step: Step, *, controlled: bool = True) -> FloatArray:
    """The step at the steering wheel in closed loop, in C: a recording (samples, 12), columns RECORD_COLUMNS."""
    config = calibration.config
    scenario = replace(
        SCENARIOS["step-steer"],
        duration=DURATION,
        steer_time=STEER_TIME,
        drive=manoeuvres.step(STEER_TIME),
        settings=Settings(step.speed / KM_H, step.angle_deg, config.road.friction * step.road_share),
    )
    return software.run(calibration, scenario.inputs(config), controlled=controlled)


_CURVES = (
    ("yaw_rate_deg_s", "yaw_rate_rad_s"),
    ("reference_deg_s", "yaw_rate_reference_rad_s"),
    ("sideslip_deg", "sideslip_rad"),
    ("rear_angle_deg", "rear_angle_rad"),
)


def run_data(record: FloatArray) -> Data:
    """The curves of a recording."""
    return {name: numbers(np.degrees(column(record, source))) for name, source in _CURVES}


def figures(record: FloatArray, config: Config) -> Data:
    """The figures of a step, None where there is no steady value for them. Angles and accelerations: magnitudes."""
    if spin_time(record) is not None:
        return {"spins": True}
    found = step_metrics(record, STEER_TIME, config.steering.ratio)
    turns = found.settled and abs(found.yaw_rate_steady_deg_s) > 1e-3
    return {
        "settled": found.settled,
        "overshoot_percent": round(found.overshoot_percent, 2) if turns else None,
        "rise_time_s": round(found.rise_time_s, 3) if turns else None,
        "yaw_rate_steady_deg_s": round(found.yaw_rate_steady_deg_s, 3) if found.settled else None,
        "sideslip_peak_deg": round(found.sideslip_abs_max_deg, 3),
        "rear_angle_peak_deg": round(max(abs(found.rear_angle_min_deg), abs(found.rear_angle_max_deg)), 3),
        "lateral_acceleration_m_s2": round(found.lateral_acceleration_max_m_s2, 3),
    }


def margins_of(config: Config) -> tuple[FloatArray, Margins] | None:
    """Speeds (n,) in m/s and the margins of the configured car there; None for a law without feedback."""
    gains = law_of(config).gains(config)
    if gains is None:
        return None
    speeds = margin_speeds(config)
    return speeds, nominal_margins(config, speeds, *gains(speeds))


def margin_data(config: Config) -> Data | None:
    """Return the margins over speed and their design targets."""
    found = margins_of(config)
    if found is None:
        return None
    speeds, margins = found
    gain, phase = int(margins.gain_margin_db.argmin()), int(margins.phase_margin_deg.argmin())
    return {
        "speed_km_h": numbers(speeds / KM_H, 2),
        "gain_db": numbers(np.minimum(margins.gain_margin_db, UNBOUNDED_DB), 3),
        "phase_deg": numbers(np.minimum(margins.phase_margin_deg, UNBOUNDED_DEG), 3),
        "drawn_to_gain_db": UNBOUNDED_DB,
        "drawn_to_phase_deg": UNBOUNDED_DEG,
        "asked_gain_db": config.tuning.gain_margin_db,
        "asked_phase_deg": config.tuning.phase_margin_deg,
        "worst": {
            "gain_db": _least(margins.gain_margin_db, gain),
            "gain_at_km_h": round(float(speeds[gain]) / KM_H, 1),
            "phase_deg": _least(margins.phase_margin_deg, phase),
            "phase_at_km_h": round(float(speeds[phase]) / KM_H, 1),
            "stable": bool(margins.stable.all()),
        },
    }


def family_data(config: Config, is_stale: Callable[[], bool]) -> Data | None:
    """The worst margins of the whole family of cars, over the speeds of the map; None where they are no longer wanted.

    Raises:
        ConfigError: the family is too large.
    """
    gains = law_of(config).gains(config)
    if gains is None:
        return None
    speeds = np.linspace(config.controller.enable_speed_km_h, _last_speed(config), FAMILY_SPEEDS) * KM_H
    found = []
    for k in range(speeds.size):
        if is_stale():
            return None
        here = speeds[k : k + 1]
        found.append(family_margins(config, here, *gains(here))[0])
    margins = concatenate(found)
    return {
        "cars": len(members(config)),
        "speed_km_h": numbers(speeds / KM_H, 2),
        "gain_db": numbers(np.minimum(margins.gain_margin_db, UNBOUNDED_DB), 3),
        "phase_deg": numbers(np.minimum(margins.phase_margin_deg, UNBOUNDED_DEG), 3),
        "stable": bool(margins.stable.all()),
        "warnings": list(family_warnings(config, margins)),
    }


def _last_speed(config: Config) -> float:
    """km/h, of the map; above where the controller switches on."""
    return max(config.grid.last_speed_km_h, 1.2 * config.controller.enable_speed_km_h)


def _least(values: FloatArray, place: int) -> float | None:
    value = float(values[place])
    return round(value, 2) if math.isfinite(value) else None


def time_axis(record: FloatArray) -> Sequence[float | None]:
    """s, from the step on."""
    return numbers(column(record, "time_s") - STEER_TIME, 4)
