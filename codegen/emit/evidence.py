"""Facts about the safety of a build before it runs: margins of its feedback, what losing the function means, what the
limiter cuts off the map, and by how much its reference model turns more than a map of the nonlinear car allows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from codegen.config import KM_H, Config
from codegen.controller_sections import TRIM_MAX_PERCENT
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG, Weakest, weakest
from codegen.emit.laws import law_of
from codegen.emit.limiter_cut import LimiterCut, cut_text
from codegen.refmap.loss import MODES, LossOfFunction, loss_of_function, rounded
from codegen.refmap.map import ReferenceMap
from codegen.refmap.model_excess import COARSE, Excess, asks_for_more, model_excess
from codegen.refmap.storage import Real
from codegen.refmap.total import TotalMap
from codegen.vehicle.single_track import SingleTrack

MUCH = 2.0
"""Times the trim that is needed: what is beyond is told, for it costs overshoot."""


@dataclass(frozen=True)
class Evidence:
    """Of one build: `margins` is None where the kind of controller has no feedback, `excess` where it is not asked for."""

    config: Config
    margins: Weakest | None
    loss: LossOfFunction
    limiter_cut: LimiterCut
    excess: Excess | None

    @classmethod
    def of(cls, reference_map: ReferenceMap, total: TotalMap, config: Config, real: Real) -> Evidence:
        """Of a map, what a build holds of it in which numbers, and the configuration that it is built for.

        Raises:
            BuildError: see `law_of`.
        """
        return cls(
            config,
            margins_of(config),
            loss_of_function(reference_map, config),
            LimiterCut.of_map(reference_map, config),
            model_excess(reference_map, total, config, real) if asks_for_more(reference_map, config) else None,
        )

    def to_dict(self) -> dict[str, Any]:
        """For the manifest. Margins and excess are rounded so that no machine's last bits show."""
        excess = {} if self.excess is None else {"reference_model_excess": self._excess(self.excess)}
        facts = {"margins": self._margins(), "loss_of_function": self.loss.to_dict(), "limiter_cut": self.limiter_cut.to_dict()}
        return {**facts, **excess}

    def _excess(self, found: Excess) -> dict[str, Any]:
        return {
            "percent": found.percent,
            "at_km_h": round(found.speed / KM_H, 1),
            "at_front_angle_deg": round(math.degrees(found.front_angle), 2),
            "at_friction": found.friction,
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
            "delay_samples": self.config.tuning.delay_samples,
        }

    def loss_rows(self) -> list[tuple[str, ...]]:
        """For the README, at the largest front angle of each speed: km/h, angles and sideslip in deg before the loss, and the
        largest sideslip after each kind of loss."""
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
    """Of the feedback that a configuration asks for; None without one. Raises BuildError: see `law_of`."""
    gains = law_of(config).gains(config)
    return None if gains is None else weakest(config, gains)


def margins_text(margins: Weakest | None) -> str:
    """Of a feedback (None: there is none), for the README."""
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


def margin_note(manifest: Mapping[str, Any]) -> str:
    """What to warn of; "" where the margins are enough or there is no feedback."""
    margins = manifest["margins"]
    if margins is None or margins["enough"]:
        return ""
    least = f"{margins['gain_margin_db']:g} dB, {margins['phase_margin_deg']:g} deg"
    unstable = margins["unstable_from_km_h"]
    found = f"{least} at least" if unstable is None else f"unstable from {unstable:.0f} km/h"
    return (
        f'the feedback of kind "{manifest["options"]["kind"]}" has little margin from {margins["warns_from_km_h"]:.0f} km/h '
        f"({found}; below {WARN_GAIN_MARGIN_DB:g} dB or {WARN_PHASE_MARGIN_DEG:g} deg counts as little); lower its gains or "
        'controller.inputs.speed_max_km_h, or take kind "tracking" with `codegen tune`'
    )


def cut_note(manifest: Mapping[str, Any]) -> str:
    """Return a warning where the limiter makes part of the map unreachable, else ""."""
    found = manifest["limiter_cut"]
    if not found["cells"]:
        return ""
    return (
        f"the limiter cuts {cut_text(found)}; raise its bounds, "
        'or take limiter.opposite_phase_speed_km_h = "from-car" with opposite_phase_max_deg = "from-car"'
    )


def critical_speed_note(config: Config) -> str:
    """Return a warning where the controller accepts speeds at which its reference model is unstable, else ""."""
    critical, top = SingleTrack.from_config(config).critical_speed / KM_H, config.controller.inputs.speed_max_km_h
    if config.controller.kind != "tracking" or critical > top:
        return ""
    return (
        f"the car is unstable from {critical:.0f} km/h without rear steering, and so is the controller's reference model: "
        f"margins do not count there; set controller.inputs.speed_max_km_h below that (it is {top:g})"
    )


def excess_note(manifest: Mapping[str, Any]) -> str:
    """What to warn of; "" where the trim takes back what the reference model turns too much and not much more, or nothing is
    asked."""
    found = manifest.get("reference_model_excess")
    if found is None:
        return ""
    trim, needed = found["trim_max_percent"], max(math.ceil(found["percent"]), 1)
    if found["enough"]:
        if trim <= MUCH * needed:
            return ""
        return (
            f"the trim may take {trim:g} % of the yaw rate back, and {needed} % are enough on these breakpoints: "
            f"controller.tracking.trim_max_percent = {needed} has less overshoot"
        )
    place = f"{found['at_km_h']:.0f} km/h, {found['at_front_angle_deg']:.1f} deg, friction {found['at_friction']:g}"
    enough = f"controller.tracking.trim_max_percent = {needed} keeps them, with more overshoot"
    remedy = enough if needed <= TRIM_MAX_PERCENT else f"no trim takes back so much, and {_closer(manifest['options'])}"
    return (
        f"in steady state the reference model turns up to {found['percent']:.1f} % more than this map allows "
        f"({place}), and its trim takes "
        f"{trim:g} % back: there the slip bounds of the map are exceeded; {remedy}"
    )


def _closer(options: Mapping[str, Any]) -> str:
    """What brings a build's tables closer to the optimum."""
    for key, how in (("max_error_rad_s", "a smaller --max-error"), ("max_flash_bytes", "a larger --max-flash")):
        if options.get(key) is not None:
            return f"{how} brings what is interpolated closer to the optimum"
    return COARSE
