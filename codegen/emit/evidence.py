"""Facts of a build for its manifest and README: chosen breakpoints, margins of its feedback, consequences of a loss of
function, cells of the map that the limiter cuts, and the excess yaw rate of its reference model over a map of the nonlinear
car."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from codegen.configuration import Config
from codegen.design.loss import MODES, LossOfFunction, loss_of_function, rounded
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG, Weakest, weakest
from codegen.ecu_map.model_excess import Excess, asks_for_more, model_excess
from codegen.ecu_map.placement import Placed, Request
from codegen.ecu_map.reference_surface import GAP_POINTS
from codegen.ecu_map.storage import Real
from codegen.ecu_map.total import TotalMap
from codegen.emit.laws import law_of
from codegen.emit.limiter_view import LimiterCut
from codegen.map_file.map import ReferenceMap
from codegen.units import KM_H

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
    return f", of which {degrees:.2g} deg/s is the error of the fine grid, found at {GAP_POINTS} x {GAP_POINTS} other points"


def _rear_text(rear_angle: float, as_yaw_rate: float) -> str:
    angle, rate = (math.degrees(_rounded(error)) for error in (rear_angle, as_yaw_rate))
    return f"; error of the rear angle at most {angle:.2g} deg, which changes the yaw rate by at most {rate:.3g} deg/s"


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


@dataclass(frozen=True)
class Evidence:
    """Design results of one build, each computed when it is first read: from a map, its extension as stored in a number type,
    and the configuration."""

    reference_map: ReferenceMap
    total: TotalMap
    config: Config
    real: Real

    @cached_property
    def margins(self) -> Weakest | None:
        """Margins of the feedback; None without one."""
        return margins_of(self.config)

    @cached_property
    def loss(self) -> LossOfFunction:
        """Consequences of losing rear steering."""
        return loss_of_function(self.reference_map, self.config)

    @cached_property
    def limiter_cut(self) -> LimiterCut:
        """Cells of the map that the limiter cuts."""
        return LimiterCut.of_map(self.reference_map, self.config)

    @cached_property
    def excess(self) -> Excess | None:
        """Excess yaw rate of the reference model; None if none is possible."""
        if not asks_for_more(self.reference_map, self.config):
            return None
        return model_excess(self.reference_map, self.total, self.config, self.real)

    def to_dict(self, with_loss: bool = True) -> dict[str, Any]:
        """Return the results for the manifest. Margins and excess are rounded, so that they do not depend on the machine."""
        loss = {"loss_of_function": self.loss.to_dict()} if with_loss else {}
        excess = {} if self.excess is None else {"reference_model_excess": self._excess(self.excess)}
        return {"margins": self._margins(), **loss, "limiter_cut": self.limiter_cut.to_dict(), **excess}

    def _excess(self, found: Excess) -> dict[str, Any]:
        return {
            "percent": found.percent,
            "at_km_h": round(found.speed / KM_H, 1),
            "at_front_angle_deg": round(math.degrees(found.front_angle), 2),
            "at_friction": found.friction,
            **({"at_longitudinal_acceleration_m_s2": found.acceleration} if found.acceleration else {}),
            "trim_max_percent": self.config.controller.tracking.trim_max_percent,
            "enough": found.percent <= self.config.controller.tracking.trim_max_percent,
        }

    def _margins(self) -> dict[str, Any] | None:
        found = self.margins
        if found is None:
            return None
        return {
            "gain_margin_db": rounded(found.gain_margin_db, 2),
            "gain_margin_at_km_h": rounded(found.gain_margin_speed / KM_H, 2),
            "phase_margin_deg": rounded(found.phase_margin_deg, 2),
            "phase_margin_at_km_h": rounded(found.phase_margin_speed / KM_H, 2),
            "warning_below": {"gain_margin_db": WARN_GAIN_MARGIN_DB, "phase_margin_deg": WARN_PHASE_MARGIN_DEG},
            "enough": found.enough,
            "warns_from_km_h": _km_h(found.warns_from),
            "unstable_from_km_h": _km_h(found.unstable_from),
            "delay_samples": self.config.designed_delay_samples,
        }

    def loss_rows(self) -> list[tuple[str, ...]]:
        """Return rows for the README, for the largest front angle of each speed: km/h, angles and sideslip in deg before the
        loss, and the largest sideslip after each kind of loss."""
        loss = self.loss
        rows = []
        last = {float(speed): k for k, speed in enumerate(loss.speed)}
        for speed, k in last.items():
            sideslips = []
            for row in range(len(MODES)):
                spun, reached = bool(loss.spins[row, k]), math.degrees(float(loss.sideslip_max[row, k]))
                sideslips.append("-" if not loss.settles[k] else "**spins**" if spun else f"{reached:.1f}")
            angles = (math.degrees(loss.front_angle[k]), math.degrees(loss.rear_angle[k]), math.degrees(loss.sideslip[k]))
            rows.append((f"{speed / KM_H:.0f}", f"{angles[0]:.1f}", f"{angles[1]:.1f}", _text(angles[2]), *sideslips))
        return rows


def margins_of(config: Config) -> Weakest | None:
    """Return the margins of the configured feedback; None without one. Raises BuildError: see `law_of`."""
    gains = law_of(config).gains(config)
    return None if gains is None else weakest(config, gains)


def margins_text(margins: Weakest | None) -> str:
    """Return the margins of a feedback (None: there is none) as text for the README."""
    if margins is None:
        return "no feedback, so no margins"
    if margins.unstable_from is not None:
        little, none = _km_h(margins.warns_from), _km_h(margins.unstable_from)
        return f"little margin from {little:.0f} km/h, **unstable from {none:.0f} km/h**"
    gain, phase = margins.gain_margin_db, margins.phase_margin_deg
    return (
        f"{gain:.1f} dB at {margins.gain_margin_speed / KM_H:.0f} km/h, "
        f"{phase:.0f} deg at {margins.phase_margin_speed / KM_H:.0f} km/h"
    )


def _text(value: float) -> str:
    return "-" if math.isnan(value) else f"{value + 0.0:.1f}"


def _km_h(speed: float | None) -> float | None:
    return None if speed is None else round(speed / KM_H, 1)
