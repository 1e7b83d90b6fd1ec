"""A measurement programme as scenarios of the bench, and its tables for the terminal, for JSON and for the report."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from codegen.identify.candidates import Candidate
from codegen.identify.drive_plan import DrivePlan, Predicted
from codegen.identify.summary import significant
from codegen.units import DEGREE, KM_H
from hil_sim.scenario_files import OVERRIDE_COLUMN, STEERING_COLUMNS

DRIVE_HEADER = ("drive", "manoeuvre", "km/h", "steering wheel ±deg", "rear angle ±deg", "s", "largest m/s^2")
PREDICTED_HEADER = ("quantity", "configured", "unit", "standard deviation", "of that before %", "determined")

MANIFEST_WHAT = "measurement programme"
"""Entry of the manifest of a programme's folder."""


def scenario_csv(one: Candidate, *, has_rear_command: bool) -> bytes:
    """Return a drive as a scenario file of the bench, see `hil_sim.scenario_files`: a row for each sample of the controller."""
    signals = one.drive.signals
    columns = {"time_s": one.drive.time, "speed_m_s": signals["vx"], STEERING_COLUMNS[0]: signals["steering_wheel_angle"]}
    if has_rear_command:
        columns[OVERRIDE_COLUMN] = signals["delta_r_command"]
    rows = [",".join(f"{value:.6g}" for value in row) for row in np.stack(list(columns.values()), axis=1).tolist()]
    return ("\n".join([",".join(columns), *rows]) + "\n").encode("ascii")


def files_of(plan: DrivePlan) -> dict[str, bytes]:
    """Return the scenario files by name."""
    has_rear_command = any(each.manoeuvre.rear is not None for each in plan.drives) or "delta_r_command" in plan.signals
    return {
        f"{name}.csv": scenario_csv(one, has_rear_command=has_rear_command)
        for name, one in zip(plan.names, plan.drives, strict=True)
    }


def drive_rows(plan: DrivePlan) -> list[tuple[str, ...]]:
    """Return rows of DRIVE_HEADER, the sum last."""
    rows = []
    for name, one in zip(plan.names, plan.drives, strict=True):
        speeds = [f"{float(speed) / KM_H:.0f}" for speed in one.drive.signals["vx"][[0, -1]]]
        wheel, rear = plan.config.steering.ratio * one.front_amplitude / DEGREE, one.rear_amplitude / DEGREE
        rows.append(
            (
                name,
                one.manoeuvre.title,
                "-".join(dict.fromkeys(speeds)),
                f"{wheel:.1f}" if wheel else "0",
                f"{rear:.2f}" if rear else "0",
                f"{one.duration:g}",
                f"{one.largest_acceleration:.2f}",
            )
        )
    return [
        *rows,
        ("all", "", "", "", "", f"{plan.duration:g}", f"{max(each.largest_acceleration for each in plan.drives):.2f}"),
    ]


def predicted_rows(plan: DrivePlan) -> list[tuple[str, ...]]:
    """Return rows of PREDICTED_HEADER, without the quantities that the signals do not contain."""
    return [
        (
            each.parameter.title,
            significant(each.value / each.parameter.size, 5),
            each.parameter.unit,
            significant(each.standard_deviation / each.parameter.size, 2),
            f"{100.0 * each.share:.2g}",
            "yes" if each.is_determined else "no",
        )
        for each in plan.quantities
        if math.isfinite(each.standard_deviation)
    ]


def need_lines(plan: DrivePlan) -> list[str]:
    """Return what each quantity needs that is not determined; quantities with the same need share a line."""
    needs: dict[str, list[str]] = {}
    for each in plan.quantities:
        if not each.is_determined:
            needs.setdefault(each.need, []).append(each.parameter.title)
    return [f"{', '.join(titles)}: {need}" for need, titles in needs.items()]


def to_dict(plan: DrivePlan) -> dict[str, Any]:
    """Return all figures as JSON values, in the units that the names state."""
    return {
        "lateral_acceleration_max_m_s2": plan.lateral_acceleration_max,
        "duration_s": plan.duration,
        "signals": list(plan.signals),
        "drives": [
            {
                "scenario": f"{name}.csv",
                "manoeuvre": one.manoeuvre.name,
                "what": one.manoeuvre.what,
                "speed_km_h": [float(speed) / KM_H for speed in one.drive.signals["vx"][[0, -1]]],
                "steering_wheel_amplitude_deg": plan.config.steering.ratio * one.front_amplitude / DEGREE,
                "rear_angle_amplitude_deg": one.rear_amplitude / DEGREE,
                "duration_s": one.duration,
                "lateral_acceleration_m_s2": one.largest_acceleration,
            }
            for name, one in zip(plan.names, plan.drives, strict=True)
        ],
        "quantities": {each.parameter.name: _facts(each) for each in plan.quantities},
        "not_determined": [direction.text for direction in plan.directions],
    }


def _facts(one: Predicted) -> dict[str, Any]:
    known = math.isfinite(one.standard_deviation)
    return {
        "unit": one.parameter.unit,
        "configured": one.value / one.parameter.size,
        "standard_deviation": one.standard_deviation / one.parameter.size if known else None,
        "share": one.share,
        "is_determined": one.is_determined,
        "need": one.need,
    }
