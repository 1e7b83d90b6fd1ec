"""Warnings about a build, from its manifest and from the files beside it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.configuration.controller import TRIM_MAX_PERCENT
from codegen.design.family import members
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG, Margins, family_margins, gains_of
from codegen.ecu_map.model_excess import COARSE, TRIM_WARNING_FACTOR
from codegen.emit.folder import MANIFEST, VERIFICATION_FILES, verify_hashes
from codegen.errors import CodegenError
from codegen.files import read_file
from codegen.text import distinct
from codegen.units import KM_H

MARGIN_TOLERANCE_DB, MARGIN_TOLERANCE_DEG, SENSITIVITY_TOLERANCE = 0.05, 0.2, 0.02
"""`codegen tune` rounds gains to four digits."""
AHEAD_TOLERANCE = 0.02
RECORD_BYTES_MAX = 2**24
"""Size limit of verify.json, far above the size of a record with findings in every check."""


def margins_line(margins: Mapping[str, Any] | None) -> str:
    """Return a line about a manifest's margins, which are None for a controller without feedback."""
    if margins is None:
        return "no feedback, so no margins"
    if margins["unstable_from_km_h"] is None:
        least = f"at least {_margin(margins['gain_margin_db'])} dB and {_margin(margins['phase_margin_deg'])} deg"
    else:
        least = f"little from {margins['warns_from_km_h']:.0f} km/h, unstable from {margins['unstable_from_km_h']:.0f} km/h"
    return f"margins of the configured car: {least}"


def _margin(value: float | None) -> str:
    """Format a margin; None is unlimited."""
    return "unlimited" if value is None else f"{value:g}"


def build_warnings(manifest: Mapping[str, Any]) -> Iterator[str]:
    """Yield the warnings about the margins and the trim of the reference model in a build's manifest."""
    yield from filter(None, (margin_warning(manifest), excess_warning(manifest)))


def margin_warning(manifest: Mapping[str, Any]) -> str:
    """Return a warning about small margins of the configured car; "" if they suffice or there is no feedback."""
    margins = manifest["margins"]
    if margins is None or margins["enough"]:
        return ""
    least = f"{_margin(margins['gain_margin_db'])} dB, {_margin(margins['phase_margin_deg'])} deg"
    unstable = margins["unstable_from_km_h"]
    found = f"{least} at least" if unstable is None else f"unstable from {unstable:.0f} km/h"
    # A build refuses a largest speed below the map's last one.
    is_beyond_map = margins["warns_from_km_h"] > manifest["map"]["speed_m_s"][-1] / KM_H
    remedy = "lower its gains or controller.inputs.speed_max_km_h" if is_beyond_map else "lower its gains"
    return (
        f'the feedback of kind "{manifest["options"]["kind"]}" has little margin from {margins["warns_from_km_h"]:.0f} km/h '
        f"({found}; below {WARN_GAIN_MARGIN_DB:g} dB or {WARN_PHASE_MARGIN_DEG:g} deg counts as little); {remedy}, "
        'or use kind "tracking" with `codegen tune`'
    )


def excess_warning(manifest: Mapping[str, Any]) -> str:
    """Return a warning if the trim is smaller or much larger than the reference model's excess yaw rate requires; else ""."""
    found = manifest.get("reference_model_excess")
    if found is None:
        return ""
    trim, needed = found["trim_max_percent"], max(math.ceil(found["percent"]), 1)
    if found["enough"]:
        if trim <= TRIM_WARNING_FACTOR * needed:
            return ""
        return (
            f"the trim may take {trim:g} % of the yaw rate back, and {needed} % are enough on these breakpoints: "
            f"controller.tracking.trim_max_percent = {needed} has less overshoot"
        )
    position = f"{found['at_km_h']:.0f} km/h, {found['at_front_angle_deg']:.1f} deg, friction {found['at_friction']:g}"
    if acceleration := found.get("at_longitudinal_acceleration_m_s2"):
        position += f", longitudinal acceleration {acceleration:g} m/s^2"
    enough = f"controller.tracking.trim_max_percent = {needed} keeps them, with more overshoot"
    remedy = enough if needed <= TRIM_MAX_PERCENT else f"no trim takes back so much, and {_closer(manifest['options'])}"
    return (
        f"in steady state the reference model turns up to {found['percent']:.1f} % more than this map allows "
        f"({position}), and its trim takes "
        f"{trim:g} % back: there the slip bounds of the map are exceeded; {remedy}"
    )


def _closer(options: Mapping[str, Any]) -> str:
    """Return the build option that reduces the interpolation error of the tables."""
    for key, how in (("max_error_rad_s", "a smaller `max_error=`"), ("max_flash_bytes", "a larger `max_flash=`")):
        if options.get(key) is not None:
            return f"{how} brings what is interpolated closer to the optimum"
    return COARSE


def schedule_warnings(config: Config) -> Iterator[str]:
    """Return warnings about a gain schedule that does not suit the car: family margins, and the lag that it was tuned for."""
    tracking, lag = config.controller.tracking, config.rear_actuator.lag_s
    schedule = tracking.schedule
    if config.controller.kind != "tracking" or schedule is None:
        return
    last = config.grid.last_speed_km_h
    speed = np.array([value for value in schedule.speed_km_h if value <= last] or schedule.speed_km_h[:1]) * KM_H
    gains = gains_of(schedule)(speed)
    found = list(family_warnings(config, family_margins(config, speed, *gains)[0]))
    if not found and any(member.is_slow for member in members(config)):
        found = list(family_warnings(config, family_margins(config, speed, *gains, slow=True)[0], slow=True))
    yield from found
    if schedule.lead_s is None:
        return
    if min(abs(tracking.response_ahead_s / choice - 1.0) for choice in config.response_aheads_s) > AHEAD_TOLERANCE:
        yield (
            f"lead and response gain of the schedule were tuned for another actuator than rear_actuator.lag_s = {lag:g} with a "
            f"delay of {config.driven_delay_samples} sample(s); run `codegen tune`"
        )


def family_warnings(config: Config, margins: Margins, *, slow: bool = False) -> Iterator[str]:
    """Return a warning where the worst margins of the family of cars are below what [tuning] demands, with `slow` of those with
    twice the lag and a relaxation length."""
    prefix, cars = ("slow_", "the slow cars of the family") if slow else ("", "the family of cars")
    least_db, least_deg = (getattr(config.tuning, f"{prefix}{key}") for key in ("gain_margin_db", "phase_margin_deg"))
    gain, phase = float(margins.gain_margin_db.min()), float(margins.phase_margin_deg.min())
    peak, peak_max = float(margins.sensitivity.max()), getattr(config.tuning, f"{prefix}sensitivity_max")
    if gain < least_db - MARGIN_TOLERANCE_DB or phase < least_deg - MARGIN_TOLERANCE_DEG:
        kept = f"{distinct(gain, least_db)} dB and {distinct(phase, least_deg)} deg"
        yield (
            f"over {cars} the gains keep {kept if margins.stable.all() else 'no margin (a car is unstable)'}, less "
            f"than the {least_db:g} dB and {least_deg:g} deg of [tuning]; run `codegen tune`"
        )
    elif peak > peak_max + SENSITIVITY_TOLERANCE:
        yield (
            f"over {cars} the sensitivity of the loop has a peak of {distinct(peak, peak_max)}, more than the {peak_max:g} of "
            "[tuning]; run `codegen tune`"
        )


def read_record(folder: Path) -> dict[str, Any] | None:
    """Return the record of `codegen verify` in a build; None if it is missing, damaged or of another version."""
    try:
        record = json.loads(read_file(folder / VERIFICATION_FILES[0], RECORD_BYTES_MAX, "verify the build again"))
        counts, checks = record["counts"], record["checks"].values()
        requirements = record.get("requirements", [])
        complete = (
            isinstance(record["build"]["manifest_sha256"], str)
            and isinstance(requirements, list)
            and all(row.keys() == requirements[0].keys() and set(map(type, row.values())) == {str} for row in requirements)
            and all(isinstance(counts[key], int) for key in ("passed", "failed"))
            and all({"shows", "figure", "verdict", "findings", "limits"} <= check.keys() for check in checks)
        )
    except (CodegenError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return None
    return dict(record) if complete else None


def is_current(record: Mapping[str, Any], folder: Path) -> bool:
    """Return whether a record belongs to the current state of the build."""
    return bool(record["build"]["manifest_sha256"] == hashlib.sha256((folder / MANIFEST).read_bytes()).hexdigest())


def folder_notes(folder: Path) -> Iterator[str]:
    """Yield the next step for a build whose current state has not been verified."""
    if not (folder / VERIFICATION_FILES[0]).exists():
        yield f"not verified yet; next: `codegen verify {folder}`"
    elif (record := read_record(folder)) is not None and not is_current(record, folder):
        yield f"{VERIFICATION_FILES[0]} is of an older build; next: `codegen verify {folder}`"


def folder_warnings(folder: Path) -> Iterator[str]:
    """Yield warnings about the files of a build: edited ones, and a damaged record of a verification or a failed one.

    Raises:
        BuildError: not a build folder.
    """
    edited = verify_hashes(folder)
    if edited:
        yield f"changed since the build: {', '.join(edited[:3])}{' and more' if len(edited) > 3 else ''}; build again"
    if not (folder / VERIFICATION_FILES[0]).exists():
        return
    record = read_record(folder)
    if record is None:
        yield f"{VERIFICATION_FILES[0]} cannot be read; run `codegen verify {folder}`"
    elif is_current(record, folder) and (failed := record["counts"]["failed"]):
        yield f"{failed} check{'s' if failed > 1 else ''} of `codegen verify` failed; see {folder / VERIFICATION_FILES[1]}"
