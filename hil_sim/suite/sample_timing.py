"""Unevenly timed samples without a loss: a car held straight against a yaw moment, with three timings of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hil_sim.clocks import FREE_RUNNING
from hil_sim.faults import Fault
from hil_sim.metrics.run import column
from hil_sim.runs import run_through_can
from hil_sim.scenarios import Scenario, find
from hil_sim.suite.subjects import Subject

SETTLING_TIME_S = 3.0
"""Time in s after the onset of the moment. Before, the age of the samples delays the correction under any law."""

DISTURBANCE = find("yaw-moment")
TIMINGS: Mapping[str, Scenario] = {
    "in step": DISTURBANCE,
    "free-running clocks": replace(DISTURBANCE, clocks=FREE_RUNNING),
    "0 and 2 frames in turn": replace(DISTURBANCE, faults=(Fault("burst", 0.0, DISTURBANCE.duration),)),
}
IN_STEP = next(iter(TIMINGS))


@dataclass(frozen=True)
class TimingError:
    """RMS of the yaw rate (rad/s), whose reference is zero: once settled, and from the onset of the moment."""

    settled_rad_s: float
    whole_rad_s: float

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)


def timing_errors(subject: Subject) -> dict[str, TimingError]:
    """Return timing name -> error of a controlled subject. Raises BuildError."""
    software = subject.around(subject.config)
    errors = {}
    for name, scenario in TIMINGS.items():
        record = run_through_can(software, scenario).record
        time, yaw_rate = column(record, "time_s"), column(record, "yaw_rate_rad_s")
        settled, whole = (
            float(np.sqrt(np.mean(yaw_rate[time >= scenario.steer_time + after - 1e-9] ** 2)))
            for after in (SETTLING_TIME_S, 0.0)
        )
        errors[name] = TimingError(settled, whole)
    return errors
