"""What a build knows of its own safety before it runs: margins of its feedback, and what losing the function means."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from codegen.config import KM_H, Config
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG, Weakest, weakest
from codegen.emit.laws import law_of
from codegen.refmap.loss import MODES, LossOfFunction, loss_of_function
from codegen.refmap.map import ReferenceMap


@dataclass(frozen=True)
class Evidence:
    """Of one build: `margins` is None where the kind of controller has no feedback."""

    config: Config
    margins: Weakest | None
    loss: LossOfFunction

    @classmethod
    def of(cls, reference_map: ReferenceMap, config: Config) -> Evidence:
        """Of a map and the configuration that it is built for. Raises BuildError: see `law_of`."""
        gains = law_of(config).gains(config)
        return cls(
            config,
            None if gains is None else weakest(config, gains),
            loss_of_function(reference_map, config),
        )

    def to_dict(self) -> dict[str, Any]:
        """For the manifest. Margins are rounded so that no machine's last bits show."""
        return {"margins": self._margins(), "loss_of_function": self.loss.to_dict()}

    def _margins(self) -> dict[str, Any] | None:
        found = self.margins
        if found is None:
            return None
        return {
            "gain_margin_db": _rounded(found.gain_margin_db),
            "gain_margin_at_km_h": _rounded(found.gain_margin_speed / KM_H),
            "phase_margin_deg": _rounded(found.phase_margin_deg),
            "phase_margin_at_km_h": _rounded(found.phase_margin_speed / KM_H),
            "warning_below": {"gain_margin_db": WARN_GAIN_MARGIN_DB, "phase_margin_deg": WARN_PHASE_MARGIN_DEG},
            "enough": found.enough,
            "delay_samples": self.config.tuning.delay_samples,
        }

    def margins_text(self) -> str:
        """For the README."""
        if self.margins is None:
            return "no feedback, so no margins"
        gain, phase = self.margins.gain_margin_db, self.margins.phase_margin_deg
        return (
            f"{gain:.1f} dB at {self.margins.gain_margin_speed / KM_H:.0f} km/h, "
            f"{phase:.0f} deg at {self.margins.phase_margin_speed / KM_H:.0f} km/h"
        )

    def loss_rows(self) -> list[tuple[str, ...]]:
        """For the README: speed, front angle, rear angle, and the largest sideslip after each kind of loss; the last angle of each
        speed."""
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


def _text(value: float) -> str:
    return "-" if math.isnan(value) else f"{value + 0.0:.1f}"


def _rounded(value: float) -> float | None:
    return round(value, 2) if math.isfinite(value) else None


def margin_note(manifest: Mapping[str, Any]) -> str:
    """What to warn of; "" where the margins are enough or there is no feedback."""
    margins = manifest["margins"]
    if margins is None or margins["enough"]:
        return ""
    kind = manifest["options"]["kind"]
    return (
        f'the feedback of kind "{kind}" has little margin: {margins["gain_margin_db"]} dB at {margins["gain_margin_at_km_h"]} km/h, '
        f"{margins['phase_margin_deg']} deg at {margins['phase_margin_at_km_h']} km/h "
        f"(below {WARN_GAIN_MARGIN_DB:g} dB or {WARN_PHASE_MARGIN_DEG:g} deg); lower the gains, or take the kind \"tracking\" with "
        "`codegen tune`"
    )
