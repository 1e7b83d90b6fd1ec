"""Events of the task in closed loop: none without a cause, and the outcome of a bus that loses most samples.

`tests/sil` compares the time of each event with a second implementation.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from codegen.sil.software import Software, Status
from hil_sim import manoeuvres
from hil_sim.bench import run_in_process, run_through_can
from hil_sim.clocks import FREE_RUNNING
from hil_sim.codec import DIAGNOSTICS
from hil_sim.faults import Fault
from hil_sim.metrics import column
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import SCENARIOS, Scenario, find
from tests import builds

BIT = {name: 1 << bit for bit, (name, _) in DIAGNOSTICS.items()}
LATE, INTERMITTENT, STUCK = BIT["TASK_LATE"], BIT["INTERMITTENT"], BIT["ACTUATOR_STUCK"]


def step_steer(duration: float, *faults: Fault) -> Scenario:
    return replace(find("step-steer"), duration=duration, steer_time=0.5, drive=manoeuvres.step(0.5), faults=faults)


def test_silence_and_a_lasting_fault_are_not_intermittent(software: Software) -> None:
    for fault in (Fault("bus-down", 0.2, 0.5), Fault("corrupt", 0.2, 0.5), Fault("drop", 0.2, 0.01)):
        assert not np.bitwise_or.reduce(run_through_can(software, step_steer(1.5, fault)).diagnostics) & INTERMITTENT


def test_three_of_four_samples_lost_end_in_the_fail_safe(software: Software) -> None:
    faults = (Fault("drop", start, 0.03) for start in np.arange(1.0, 3.0, 0.04))
    assert (column(run_through_can(software, step_steer(3.0, *faults)).record, "status")[110:] == Status.FAIL_SAFE).all()


def check_healthy_car(lag: float, scenarios: Iterable[str]) -> None:
    """Check that a car with an actuator of this lag (s) shows no event, with two clocks."""
    software = builds.of_kind("tracking").software
    config = software.config.replace({"rear_actuator": {"lag_s": lag}})
    for name, scenario in ((name, SCENARIOS[name]) for name in scenarios):
        if not scenario.faults:
            node = PlantNode(config, replace(scenario, clocks=FREE_RUNNING))
            seen = int(np.bitwise_or.reduce(run_in_process(node, software).diagnostics))
            assert not seen & (LATE | INTERMITTENT | STUCK), name


LAGS = (0.02, 0.1)
"""s: the actuator is twice as fast or as slow as configured."""


@pytest.mark.parametrize("half", [0, 1])
def test_a_healthy_car_shows_none(half: int) -> None:
    """Every scenario has one of the lags. tests/evidence/drives has both."""
    check_healthy_car(LAGS[half], list(SCENARIOS)[half::2])
