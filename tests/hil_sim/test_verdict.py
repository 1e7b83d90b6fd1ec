"""The verdict on a run: whether the car follows its map, and what acted."""

from typing import Any

import numpy as np
import pytest

from codegen.sil.software import RECORD_COLUMNS, Status
from hil_sim.metrics import Metric, verdict

STEADY = {"settled": True, "map_error_percent": 0.4, "map_overshoot_percent": 1.0}


def judged(values: dict[str, Any], statuses: dict[Status, int], spun_at: float | None = None) -> str:
    """The verdict on 100 samples, TRACKING but for some."""
    record = np.zeros((100, len(RECORD_COLUMNS)))
    first = 0
    for status, count in statuses.items():
        record[first : first + count, RECORD_COLUMNS.index("status")] = status
        first += count
    return verdict(tuple(Metric(key, key, "", value) for key, value in values.items()), spun_at, record)


@pytest.mark.parametrize(
    ("values", "statuses", "text"),
    [
        (STEADY, {}, "follows the map in steady state"),
        (
            {**STEADY, "map_error_percent": -11.2},
            {Status.LIMITED: 33},
            "steady yaw rate 11 % below the map; a limit acted in 33 of",
        ),
        ({**STEADY, "map_error_percent": 30.0}, {}, "steady yaw rate 30 % above the map"),
        ({**STEADY, "map_overshoot_percent": 16.5}, {}, "follows the map in steady state; overshoots by 16 %"),
        ({**STEADY, "slip_rear_steady_of_bound_percent": 115.0}, {}, "steady rear slip at 115 % of its bound"),
        ({**STEADY, "settled": False}, {Status.DEGRADED: 3}, "does not settle; a signal was replaced in 3 of 100 samples"),
        (
            {"settled": True, "map_error_percent": None, "yaw_rate_steady_deg_s": 8.0, "yaw_rate_reference_deg_s": 10.0},
            {Status.FAIL_SAFE: 4},
            "steady yaw rate 20 % below the reference; the fail-safe acted in 4 of 100 samples",
        ),
        ({}, {Status.STANDBY: 100}, "the car stays on the road; control was off in 100 of 100 samples"),
    ],
)
def test_verdict(values: dict[str, Any], statuses: dict[Status, int], text: str) -> None:
    assert text in judged(values, statuses)


def test_a_spin_comes_first() -> None:
    assert judged(STEADY, {Status.LIMITED: 1}, 2.5) == "verdict: the car spins at t = 2.50 s; a limit acted in 1 of 100 samples"
