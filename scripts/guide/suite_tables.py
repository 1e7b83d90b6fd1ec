"""Tables of the page on controllers, from records of what `codegen suite ... --json` prints: for the committed build, and
for random cars."""

from __future__ import annotations

import hashlib
import json
import math
import statistics
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from codegen.files import write_atomically
from codegen.units import KM_H
from scripts.guide.markdown import table

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "generated/4ws2"
TRACKING = ROOT / "docs/suites/tracking.json"
REFERENCES = ROOT / "docs/suites/references.txt"
CARS = ROOT / "docs/suites/cars.json"

NOMINAL, C1 = "nominal", "lag-50"
LAG, RELAXATION = "lag-100", "relaxation-600"
ROADS = ("friction-60", "friction-40", "friction-40-exact", "friction-40-wrong")
FASTEST_KM_H, SINE_HZ = 120.0, 1.0
DIGITS = 5
"""Significant digits of the record."""


def build_digest() -> str:
    """Return the SHA-256 of the committed build's manifest, which names all its files."""
    return hashlib.sha256((BUILD / "manifest.json").read_bytes()).hexdigest()


def write_record(result: Path) -> Path:
    """Condense the JSON of the suite into the record, and return its path."""
    suite: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))
    rows = ("subject_matter", "figure", "unit", "asked", "measured", "passed", "stretch", "note")
    figures = {
        "manifest": build_digest(),
        "cells": len(suite["cells"]),
        "instructions": suite["instructions"],
        "requirements": [{key: row[key] for key in rows} for row in suite["requirements"]],
        "subjects": {name: _figures(suite, name) for name in suite["subjects"]},
    }
    return _write(TRACKING, figures)


def write_cars(result: Path) -> Path:
    """Condense the JSON of the suite of random cars into its record, and return its path."""
    suite: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))
    cars, figures = suite["cars"], dict[str, dict[str, Any]]()
    for row in (row for car in cars for row in car["requirements"]):
        of = figures.setdefault(row["figure"], {"unit": row["unit"], "asked": row["asked"], "missed": 0, "measured": []})
        of["missed"] += row["passed"] is False
        of["measured"] += [] if row["measured"] is None else [row["measured"]]
    for of in figures.values():
        of["median"], of["largest"] = statistics.median(of["measured"]), max(of["measured"])
        of["smallest"] = min(of.pop("measured"))
    counts = {
        "seed": suite["seed"],
        "cars": len(cars),
        "passed": suite["passed"],
        "errors": sum(bool(car["error"]) for car in cars),
    }
    return _write(CARS, {**counts, "figures": figures})


def _write(path: Path, record: Mapping[str, Any]) -> Path:
    path.parent.mkdir(exist_ok=True)
    write_atomically(path, (json.dumps(_rounded(record), indent=1) + "\n").encode())
    return path


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_rounded(inner) for inner in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _largest(values: Iterable[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _figures(suite: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the figures of one subject."""
    conditions = {each["condition"]: each for each in suite["summaries"] if each["subject"] == name}
    step, nominal = suite["c1"][name][C1], conditions[NOMINAL]
    steady = [each for each in suite["results"][name][NOMINAL] if each["spun_at_s"] is None and each["settled"]]
    margins = suite["margins"].get(name, {"points": []})["points"]
    (sine,) = (row for row in suite["sine"][name] if (row["speed_km_h"], row["frequency_hz"]) == (FASTEST_KM_H, SINE_HZ))
    (rise,) = (row for row in suite["rise_times"][name] if row["speed_km_h"] == FASTEST_KM_H)

    def value(condition: str, key: str) -> float | None:
        found = conditions[condition][key]
        return None if found is None else float(found["value"])

    return {
        "c1_yaw_rate_deg_s": step["yaw_rate_steady_deg_s"],
        "c1_lateral_acceleration_m_s2": _lateral_acceleration(step),
        "c1_sideslip_deg": step["sideslip_max_deg"],
        "overshoot_mean_percent": nominal["overshoot_mean_percent"],
        "overshoot_percent": value(NOMINAL, "overshoot_percent"),
        "lateral_acceleration_m_s2": _largest(map(_lateral_acceleration, steady)),
        "sideslip_deg": value(NOMINAL, "sideslip_max_deg"),
        "map_error_percent": value(NOMINAL, "map_error_percent"),
        "lag_overshoot_percent": value(LAG, "overshoot_percent"),
        "relaxation_overshoot_percent": value(RELAXATION, "overshoot_percent"),
        "third_party_overshoot_percent": _largest(each["overshoot_percent"] for each in suite["third_party"].get(name, ())),
        "spins": {road: len(conditions[road]["spins"]) for road in (NOMINAL, *ROADS)},
        "rise_s": rise["mean_s"],
        "sine_gain": sine["gain_of_map"],
        "sine_phase_deg": sine["phase_deg"],
        "gain_margin_db": min((point["gain_margin_db"] for point in margins), default=None),
        "phase_margin_deg": min((point["phase_margin_deg"] for point in margins), default=None),
        "unstable_from_km_h": next((point["speed_km_h"] for point in margins if not point["stable"]), None),
        "path_errors_m": suite["path_errors"][name],
        "timing_deg_s": {
            clock: [math.degrees(found["whole_rad_s"]), math.degrees(found["settled_rad_s"])]
            for clock, found in suite["timing"].get(name, {}).items()
        },
    }


def _lateral_acceleration(each: Mapping[str, Any]) -> float | None:
    steady = each["yaw_rate_steady_deg_s"]
    return None if steady is None else math.radians(steady) * float(each["cell"]["speed_km_h"]) * KM_H


def _record() -> dict[str, Any]:
    record: dict[str, Any] = json.loads(TRACKING.read_text(encoding="utf-8"))
    return record


# --- tables ------------------------------------------------------------------------------------------------------------


def _number(value: float | None, digits: int, unit: str = "") -> str:
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def _margins(of: Mapping[str, Any]) -> str:
    if of["gain_margin_db"] is None:
        return "none needed"
    if of["unstable_from_km_h"] is not None:
        return f"unstable from {of['unstable_from_km_h']:g} km/h"
    return f"{of['gain_margin_db']:.1f} dB, {of['phase_margin_deg']:.0f} deg"


ROWS: tuple[tuple[str, Callable[[Mapping[str, Any]], str]], ...] = (
    ("C1, yaw rate, steady", lambda of: _number(of["c1_yaw_rate_deg_s"], 1, " deg/s")),
    ("C1, lateral acceleration, steady", lambda of: _number(of["c1_lateral_acceleration_m_s2"], 2, " m/s²")),
    ("C1, sideslip, largest", lambda of: _number(of["c1_sideslip_deg"], 2, " deg")),
    ("lateral acceleration, largest steady", lambda of: _number(of["lateral_acceleration_m_s2"], 2, " m/s²")),
    ("sideslip, largest without a spin", lambda of: _number(of["sideslip_deg"], 1, " deg")),
    (
        "overshoot as configured, mean / largest",
        lambda of: f"{_number(of['overshoot_mean_percent'], 1)} / {_number(of['overshoot_percent'], 1, ' %')}",
    ),
    ("overshoot with an actuator lag of 100 ms, largest", lambda of: _number(of["lag_overshoot_percent"], 1, " %")),
    ("overshoot with a tyre relaxation of 0.6 m, largest", lambda of: _number(of["relaxation_overshoot_percent"], 1, " %")),
    ("overshoot on the third party's car, largest", lambda of: _number(of["third_party_overshoot_percent"], 1, " %")),
    ("error to the map in steady state, largest", lambda of: _number(of["map_error_percent"], 1, " %")),
    (
        "spins as configured; at friction 0.6 and 0.4 without an estimate; at 0.4 estimated as 0.4, as 0.6",
        lambda of: "; ".join(", ".join(str(of["spins"][road]) for road in part) for part in ((NOMINAL,), ROADS[:2], ROADS[2:])),
    ),
    ("rise to 90 % at 120 km/h, mean", lambda of: _number(of["rise_s"], 2, " s")),
    (
        "sine of 1 Hz at 120 km/h: gain over the map's, phase",
        lambda of: f"{_number(of['sine_gain'], 2)}, {_number(of['sine_phase_deg'], 0, ' deg')}",
    ),
    ("margins, worst of the family without slow cars, 20 to 120 km/h", _margins),
)


def results() -> str:
    """Return the table of all subjects."""
    record = _record()
    subjects: Mapping[str, Any] = record["subjects"]
    rows = [(title, *(text(of) for of in subjects.values())) for title, text in ROWS]
    made = table(("", *subjects), rows)
    return f"{made}\nOne step with the limiter takes at most {record['instructions']:,} instructions on a Cortex-M4F.\n"


def missed() -> str:
    """Return the requirements that the committed build misses."""
    required = [row for row in _record()["requirements"] if not row["stretch"] and row["passed"] is not None]
    rows = [
        (row["subject_matter"], row["figure"], f"{_measured(row['measured'])} {row['unit']}".strip(), row["asked"], row["note"])
        for row in required
        if not row["passed"]
    ]
    if not rows:
        return f"The committed build meets all {len(required)} requirements.\n"
    met = len(required) - len(rows)
    head = f"The committed build meets {met} of {len(required)} requirements. The command ends with exit code 1 for these:"
    return f"{head}\n\n{table(('missed', 'figure', 'measured', 'required', 'where'), rows)}"


def _measured(value: float | None) -> str:
    return "none" if value is None else f"{value:,.0f}" if abs(value) >= 1_000.0 else f"{value:.3g}"


def paths() -> str:
    """Return the path errors of the scenarios with a driver."""
    subjects = _record()["subjects"]
    names = next(iter(subjects.values()))["path_errors_m"]
    rows = [(name, *(_number(of["path_errors_m"][name], 3) for of in subjects.values())) for name in names]
    return table(("rms distance from the path, m", *subjects), rows)


def clocks() -> str:
    """Return the yaw rates under a yaw moment for the timings of the frames."""
    subjects = {name: of["timing_deg_s"] for name, of in _record()["subjects"].items() if of["timing_deg_s"]}
    rows = [
        (clock, *(f"{of[clock][0]:.3f} / {of[clock][1]:.3f}" for of in subjects.values()))
        for clock in next(iter(subjects.values()))
    ]
    return table(("rms yaw rate from the onset / after settling, deg/s", *subjects), rows)


def cars() -> str:
    """Return how many random cars meet all limits, and a row for each limit."""
    record: dict[str, Any] = json.loads(CARS.read_text(encoding="utf-8"))
    rows = []
    for name, of in record["figures"].items():
        values = (f"{_measured(of[key])} {of['unit']}".strip() for key in ("smallest", "median", "largest"))
        rows.append((name, of["asked"], str(of["missed"]), *values))
    errors = f" {record['errors']} cannot be solved, tuned or built." if record["errors"] else ""
    head = f"Of {record['cars']} cars of seed {record['seed']}, {record['passed']} meet all limits.{errors}"
    return f"{head}\n\n{table(('figure', 'required', 'cars that miss it', 'smallest', 'median', 'largest'), rows)}"


def references() -> str:
    """Return the first sections that `codegen suite references` prints for the committed build."""
    first, _, _ = REFERENCES.read_text(encoding="utf-8").partition("\nOvershoot of the steady yaw rate")
    return f"```console\n$ codegen suite references --build generated/4ws2\n{first.rstrip()}\n...\n```\n"
