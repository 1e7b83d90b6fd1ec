"""Facts about chosen breakpoints for the manifest and the README of a build."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from codegen.ecu_map.placement import Placed, Request
from codegen.ecu_map.reference_surface import GAP_POINTS
from codegen.ecu_map.total import TotalMap

REFERENCES = {
    "optimum": "the optimum, solved at every point",
    "surfaces": "the optimum, solved on a fine grid",
    "table": "the bilinear interpolation of the map's own table",
}
"""Name of each reference that an error is measured against."""


def request_facts(request: Request) -> dict[str, Any]:
    """Return the request for the options in the manifest."""
    return {"max_error_rad_s": request.max_error, "max_flash_bytes": request.max_flash, "storage": request.storage}


def grip_facts(total: TotalMap) -> dict[str, Any]:
    """Return the facts on grip for the map in the manifest: the axes of the table of the share of the cap, if there is one, and
    the rear-axle slip from which the lookup computes the sideslip of the optimum."""
    if total.grip is None:
        return {}
    speed, front_angle = ([float(value) for value in axis] for axis in (total.grip.speed, total.grip.front_angle))
    facts = {"speed_m_s": speed, "front_angle_rad": front_angle, "least_share": float(total.grip.share.min())}
    slips = [layer.steering.rear_slip_per_lateral_acceleration for layer in total.stack]
    return {"grip": {**facts, "rear_slip_per_lateral_acceleration_rad_s2_m": slips}}


def placement_facts(placed: Placed) -> dict[str, Any]:
    """Return the placement for the map in the manifest. Errors are maxima, after the cap, in the stored numbers."""
    error, scales, with_rear_angle = placed.error, placed.total.scales, placed.tables > 1
    facts: dict[str, Any] = {
        "axes": placed.spacing,
        "own_speed_range_m_s": list(placed.own_speed),
        "own_front_angle_range_rad": list(placed.own_front_angle),
        "error_against": REFERENCES[placed.origin],
        "error_rad_s": _rounded(error.yaw_rate),
        "error_whole_domain_rad_s": _rounded(error.yaw_rate_whole),
    }
    if placed.origin == "surfaces":
        facts["fine_grid_error_rad_s"] = _rounded(placed.gap)
    if with_rear_angle:
        facts["rear_angle_error_rad"] = _rounded(error.rear_angle)
        facts["rear_angle_error_whole_domain_rad"] = _rounded(error.rear_angle_whole)
        facts["rear_angle_error_as_yaw_rate_rad_s"] = _rounded(error.rear_yaw_rate_whole)
    found: dict[str, Any] = {"placement": facts}
    if scales is not None:
        storage: dict[str, Any] = {
            "type": "int16",
            "yaw_rate": {"scale_rad_s": scales.yaw_rate, "largest_rounding_rad_s": placed.rounding[0]},
        }
        if placed.total.grip is not None:
            storage["grip_share"] = {"scale": placed.total.grip.scale}
        if with_rear_angle:
            storage["rear_angle"] = {"scale_rad": scales.rear_angle, "largest_rounding_rad": placed.rounding[1]}
        found["storage"] = storage
    return found


def _rounded(error: float) -> float:
    """Round up to four digits. A search on a lattice is not more accurate, and the result does not depend on the machine."""
    if error <= 0.0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(error)) - 3)
    return float(f"{math.ceil(error / step - 1e-9) * step:.4g}")


def placement_text(placed: Placed) -> str:
    """Return the placement as text for the README."""
    own, whole = (math.degrees(_rounded(error)) for error in (placed.error.yaw_rate, placed.error.yaw_rate_whole))
    stored = "" if placed.total.scales is None else ", stored as int16"
    return (
        f"{placed.spacing}{stored}: after the cap at most {own:.3g} deg/s from {REFERENCES[placed.origin]}, over the map's own "
        f"breakpoints; {whole:.3g} deg/s over the whole domain{_gap_text(placed.gap)}"
        f"{_rear_text(placed.error.rear_angle_whole, placed.error.rear_yaw_rate_whole) if placed.tables > 1 else ''}"
    )


def _gap_text(gap: float) -> str:
    if gap <= 0.0:
        return ""
    degrees = math.degrees(_rounded(gap))
    return f"; of that, {degrees:.2g} deg/s for what the fine grid is off at {GAP_POINTS} x {GAP_POINTS} other points"


def _rear_text(rear_angle: float, as_yaw_rate: float) -> str:
    angle, rate = (math.degrees(_rounded(error)) for error in (rear_angle, as_yaw_rate))
    return f"; the rear angle at most {angle:.2g} deg off, worth at most {rate:.3g} deg/s"


def placement_summary(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of a request for JSON."""
    table = manifest["map"]
    shape = [len(table["speed_m_s"]), len(table["front_angle_rad"])]
    storage = {"storage": table["storage"]} if "storage" in table else {}
    return {**table["placement"], "breakpoints": shape, "flash_bytes": table["flash_bytes"], **storage}


def placement_line(manifest: Mapping[str, Any]) -> str:
    """Return the result of a request as text."""
    facts = placement_summary(manifest)
    error, whole = (math.degrees(facts[key]) for key in ("error_rad_s", "error_whole_domain_rad_s"))
    rows, columns = facts["breakpoints"]
    rear_text = ""
    if "rear_angle_error_whole_domain_rad" in facts:
        rear_text = _rear_text(facts["rear_angle_error_whole_domain_rad"], facts["rear_angle_error_as_yaw_rate_rad_s"])
    return (
        f"{rows} x {columns} breakpoints, {facts['axes']}, {facts['flash_bytes']:,} bytes: at most {error:.3g} deg/s off "
        f"{facts['error_against']}; {whole:.3g} deg/s over the whole domain"
        f"{_gap_text(facts.get('fine_grid_error_rad_s', 0.0))}{rear_text}"
    )
