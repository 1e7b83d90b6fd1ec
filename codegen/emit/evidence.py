"""What a build knows of its own safety before it runs: margins of its feedback, and what losing the function means."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from codegen.config import KM_H, Config
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG, Weakest, weakest
from codegen.emit.laws import law_of
from codegen.refmap.loss import MODES, LossOfFunction, loss_of_function, rounded
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

    def margins_text(self) -> str:
        """For the README."""
        if self.margins is None:
            return "no feedback, so no margins"
        if self.margins.unstable_from is not None:
            little, none = _km_h(self.margins.warns_from), _km_h(self.margins.unstable_from)
            return f"little margin from {little:.0f} km/h, **unstable from {none:.0f} km/h**"
        gain, phase = self.margins.gain_margin_db, self.margins.phase_margin_deg
        return (
            f"{gain:.1f} dB at {self.margins.gain_margin_speed / KM_H:.0f} km/h, "
            f"{phase:.0f} deg at {self.margins.phase_margin_speed / KM_H:.0f} km/h"
        )

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
