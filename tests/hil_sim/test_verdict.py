"""The verdict on a run: whether the car follows its map, and which limits acted."""

import re
from typing import Any

import numpy as np
import pytest

from codegen.configuration import preset
from codegen.sil.software import RECORD_COLUMNS, Status
from hil_sim.metrics import Metric, Run, coverage, verdict
from hil_sim.scenario_files import find
from tests import builds
from tests.hil_sim.made import record

STEADY = {"settled": True, "map_error_percent": 0.4, "map_overshoot_percent": 1.0}


def judged(values: dict[str, Any], statuses: dict[Status, int], spun_at: float | None = None) -> str:
    """Return the verdict on 100 samples, all TRACKING except `statuses`."""
    made = record(1.0)
    first = 0
    for status, count in statuses.items():
        made[first : first + count, RECORD_COLUMNS.index("status")] = status
        first += count
    metrics = tuple(Metric(key, key, "", value) for key, value in values.items())
    return verdict(Run(made, find("step-steer"), builds.CONFIG), metrics, spun_at)


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
        ({**STEADY, "overshoot_percent": 16.5}, {}, "follows the map in steady state; overshoots its steady yaw rate by 16 %"),
        (
            {"settled": True, "map_error_percent": 47.0, "map_overshoot_percent": 76.0, "overshoot_percent": 20.0},
            {},
            "steady yaw rate 47 % above the map; overshoots its steady yaw rate by 20 %",
        ),
        ({"cone_clearance_min_m": -0.25}, {}, "hits a cone, by 0.25 m"),
        ({"cone_clearance_min_m": 0.03}, {}, "keeps clear of the cones"),
        ({**STEADY, "slip_rear_steady_of_bound_percent": 115.0}, {}, "steady rear slip at 115 % of its bound"),
        ({**STEADY, "settled": False}, {Status.DEGRADED: 3}, "does not settle; a signal was replaced in 3 of 100 samples"),
        (
            {"settled": True, "map_error_percent": None, "yaw_rate_steady_deg_s": 8.0, "yaw_rate_reference_deg_s": 10.0},
            {Status.FAIL_SAFE: 4},
            "steady yaw rate 20 % below the reference; the fail-safe acted in 4 of 100 samples",
        ),
        (
            {"settled": True, "map_error_percent": -34.0},
            {Status.STANDBY: 100},
            "the car stays on the road; control was off in 100 of 100 samples; "
            "it is meant to be on from 15 km/h until below 12 km/h",
        ),
    ],
)
def test_verdict(values: dict[str, Any], statuses: dict[Status, int], text: str) -> None:
    assert text in judged(values, statuses)


def test_a_spin_comes_first() -> None:
    text = "verdict: the car spins at t = 2.50 s; a limit acted in 1 of 100 samples (range of the feedback 1)"
    assert judged(STEADY, {Status.LIMITED: 1}, 2.5) == text


def test_missed_criteria_of_fmvss_126_come_first() -> None:
    """The car weighs 2,335 kg, so 1.83 m are required."""
    missed = {"meets_fmvss_126": False, "lateral_displacement_m": 1.674, "yaw_rate_ratio_1_00_s_percent": 40.0}
    text = judged(missed, {Status.LIMITED: 1})
    first = "verdict: misses FMVSS 126: displacement 1.67 m (at least 1.83 m), yaw-rate ratio 40 % after 1 s (at most 35 %); "
    assert text == f"{first}the car stays on the road; a limit acted in 1 of 100 samples (range of the feedback 1)"
    assert judged(missed, {}, 2.5).startswith("verdict: misses FMVSS 126: the car spins at t = 2.50 s, displacement 1.67 m")
    met = {"meets_fmvss_126": True, "lateral_displacement_m": 1.9}
    assert judged(met, {}) == "verdict: the car stays on the road"


@pytest.mark.parametrize(
    ("command", "achieved", "front_angle", "name"),
    [
        (lambda t: np.deg2rad(25.0) * t, lambda t: np.deg2rad(25.0) * t, 0.1, "rate"),
        (np.deg2rad(3.5), np.deg2rad(3.5), 0.1, "rear angle"),
        (np.deg2rad(-0.9), np.deg2rad(-0.9), 0.1, "opposite phase"),
        (np.deg2rad(2.4), np.deg2rad(2.4), 0.01, "in phase"),
        (np.deg2rad(2.0), np.deg2rad(-2.0), 0.1, "distance to the measured angle"),
        (np.deg2rad(0.1), np.deg2rad(0.1), 0.1, "range of the feedback"),
    ],
)
def test_the_limit_that_acted_is_named(command: Any, achieved: Any, front_angle: float, name: str) -> None:
    """At 108 km/h the bound in opposite phase is near 0.7 deg; in phase it is 2.3 deg at a front angle of 0.01 rad."""
    angles = {"rear_angle_command_rad": command, "rear_angle_rad": achieved, "front_angle_rad": front_angle}
    made = record(1.0, speed_m_s=30.0, status=float(Status.LIMITED), **angles)
    text = verdict(Run(made[50:], find("step-steer"), preset("recommended")), (), None)
    assert re.search(rf"a limit acted in 50 of 50 samples \(.*{name} (49|50)\b", text)


def test_samples_beyond_the_edge_of_the_map_are_counted() -> None:
    rules = ["zzzz", "zsss", "zssh"]
    covers = coverage(
        {
            "map": {
                "speed_m_s": [0.0, 10.0, 20.0],
                "front_angle_rad": [0.0, 0.1, 0.2, 0.3],
                "rule_by_speed_and_front_angle": rules,
            }
        }
    )
    speed, angle = np.array([5.0, 10.0, 15.0, 20.0, 15.0, 21.0, 5.0]), np.array([0.3, 0.3, -0.2, 0.2, -0.25, 0.1, 0.4])
    assert covers(speed, angle).tolist() == [True, True, True, True, False, False, False]
    made = record(1.0, speed_m_s=15.0, front_angle_rad=lambda t: np.where(t < 0.2, 0.1, -0.25))
    text = verdict(Run(made, find("step-steer"), builds.CONFIG), (), None, covers)
    assert text == "verdict: the car stays on the road; outside the map in 80 of 100 samples (up to 54 km/h, 14.3 deg)"
