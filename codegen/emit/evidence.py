"""Safety facts of a build: margins of its feedback, consequences of a loss of function, cells of the map that the limiter cuts,
and the excess yaw rate of its reference model over a map of the nonlinear car."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from codegen.configuration import Config
from codegen.design.loss import MODES, LossOfFunction, loss_of_function, rounded
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG, Weakest, weakest
from codegen.ecu_map.model_excess import Excess, asks_for_more, model_excess
from codegen.ecu_map.storage import Real
from codegen.ecu_map.total import TotalMap
from codegen.emit.laws import law_of
from codegen.emit.limiter_cut import LimiterCut
from codegen.map_file.map import ReferenceMap
from codegen.units import KM_H


@dataclass(frozen=True)
class Evidence:
    """Design results of one build. `margins` is None for a kind without feedback, `excess` if it does not apply."""

    config: Config
    margins: Weakest | None
    loss: LossOfFunction
    limiter_cut: LimiterCut
    excess: Excess | None

    @classmethod
    def of(cls, reference_map: ReferenceMap, total: TotalMap, config: Config, real: Real) -> Evidence:
        """Compute the results from a map, its extension as stored in a number type, and the configuration.

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
        """Return the results for the manifest. Margins and excess are rounded, so that they do not depend on the machine."""
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
