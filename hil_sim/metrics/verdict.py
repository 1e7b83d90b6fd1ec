"""One line that judges a controlled run: whether the car followed its map, and what kept it from doing so."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from codegen.sil.software import Status
from hil_sim.metrics.run import FloatArray, Metric, column

STEADY_ERROR_MAX_PERCENT = 2.0
"""A car within this of its map or reference follows it."""
OVERSHOOT_MAX_PERCENT = 5.0
SLIP_MAX_PERCENT = 101.0
"""Steady slip over its bound that counts as kept."""
OTHER_STATES = {
    Status.LIMITED: "a limit acted",
    Status.DEGRADED: "a signal was replaced",
    Status.FAIL_SAFE: "the fail-safe acted",
    Status.STANDBY: "control was off",
}


def verdict(metrics: tuple[Metric, ...], spun_at: float | None, record: FloatArray) -> str:
    """Return the verdict on a controlled run.

    Args:
        metrics: figures of the run, of any scenario; those of a step steer say whether it follows its map.
        spun_at: s, or None for a car that stays on the road.
        record: (samples, 12) recording of the run.
    """
    values = {metric.key: metric.value for metric in metrics}
    parts = [f"the car spins at t = {spun_at:.2f} s" if spun_at is not None else _following(values)]
    parts += [] if spun_at is not None else _excess(values)
    status = column(record, "status")
    for state, text in OTHER_STATES.items():
        count = int(np.count_nonzero(status == state))
        if count:
            parts.append(f"{text} in {count} of {len(status)} samples")
    return "verdict: " + "; ".join(part for part in parts if part)


def _following(values: dict[str, float | bool | None]) -> str:
    """Return whether the steady yaw rate is that of the map, or of the reference where no map is known."""
    if "settled" not in values:
        return "the car stays on the road"
    if not values["settled"]:
        return "the yaw rate does not settle"
    error, of = values.get("map_error_percent"), "the map"
    if error is None:
        steady, reference = values.get("yaw_rate_steady_deg_s"), values.get("yaw_rate_reference_deg_s")
        if not reference or steady is None:
            return "settles; there is no reference to compare with"
        error, of = 100.0 * (steady / reference - 1.0), "the reference"
    if abs(error) <= STEADY_ERROR_MAX_PERCENT:
        return f"follows {of} in steady state"
    return f"steady yaw rate {abs(error):.0f} % {'above' if error > 0.0 else 'below'} {of}"


def _excess(values: dict[str, float | bool | None]) -> Iterator[str]:
    peak = values.get("map_overshoot_percent") or values.get("overshoot_percent") or 0.0
    if peak > OVERSHOOT_MAX_PERCENT:
        yield f"overshoots by {peak:.0f} %"
    for axle in ("front", "rear"):
        percent = values.get(f"slip_{axle}_steady_of_bound_percent") or 0.0
        if percent > SLIP_MAX_PERCENT:
            yield f"steady {axle} slip at {percent:.0f} % of its bound"
