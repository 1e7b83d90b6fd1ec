"""Rate of the fail-safe: the outcome of each candidate, simulated alone step by step, and the choice among them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.design import tune
from codegen.design.lead import compile_controller
from codegen.design.tune import (
    DRIVE_END,
    DRIVER_TIME,
    FAIL_SAFE_DRIVERS,
    LOSS_TIME,
    STEER_DURATION,
    STEER_START,
    Driver,
    RateOutcome,
    best,
    tune_fail_safe,
    with_controller,
)
from codegen.metrics.runs import SPIN_REAR_SLIP, SPIN_SIDESLIP
from codegen.optimum.turns import turns_of
from codegen.sil.plant import Plant, PlantInput
from codegen.sil.software import Measurement
from codegen.units import KM_H
from hil_sim.suite.subjects import of_config
from tests import builds

SPEED = 120.0 * KM_H
SLOW, FAST = 0.5, 25.0
"""deg/s: the first spins when the driver straightens, the other when the driver holds the wheel."""


def spins_alone(rate_deg_s: float, driver: Driver) -> bool:
    """Return whether the configured car spins at the edge of the map at 120 km/h, with plant and controller in a Python
    loop."""
    config = with_controller(builds.TRACKING_CONFIG, {"fail_safe": {"rate_deg_s": rate_deg_s}}, "test")
    plant, controller = Plant(config), of_config("alone", builds.paper_map(), config).around(config).controller()
    period, steps = config.controller.sampling_time_s, round(config.controller.sampling_time_s / config.plant.sampling_time_s)
    edge = turns_of(config, config.case("4ws-2")).edge(np.array([SPEED]), 1.0).front_angle[0] * config.steering.ratio
    commands = [0.0] * config.tuning.delay_samples
    for sample in range(round(DRIVE_END / period)):
        time = sample * period
        share = min(max((time - STEER_START) / STEER_DURATION, 0.0), 1.0)
        if time >= DRIVER_TIME:
            share = float(driver(np.array([time - DRIVER_TIME]))[0])
        car = plant.sample(PlantInput(SPEED, share * edge, commands[0], config.road.friction))
        measured = Measurement(SPEED, car.front_angle, car.yaw_rate, car.rear_angle)
        if time >= LOSS_TIME - 0.5 * period:
            measured = replace(measured, speed=math.nan, front_angle=math.nan, yaw_rate=math.nan)
        if abs(car.sideslip_angle) > SPIN_SIDESLIP and abs(car.slip_rear) > SPIN_REAR_SLIP:
            return True
        commands.append(controller.step(measured).rear_angle)
        plant.advance([PlantInput(SPEED, share * edge, commands.pop(0), config.road.friction)] * steps)
    return False


def test_each_rate_spins_as_often_as_alone_and_wrong_ones_lose(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "SPEED_SHARES", (1.0,))
    monkeypatch.setattr(tune, "ANGLE_SHARES", (1.0,))
    config = builds.TRACKING_CONFIG
    planted = with_controller(config, {"fail_safe": {"rate_deg_s": FAST}}, "test")
    done: list[tuple[int, int]] = []
    software = compile_controller(builds.paper_map(), config)
    found = tune_fail_safe(builds.paper_map(), planted, software, lambda *step: done.append(step), (SLOW, 2.5))
    assert [one.rate_deg_s for one in found.outcomes] == [FAST, SLOW, 2.5]
    for one in found.outcomes:
        assert one.spins == sum(spins_alone(one.rate_deg_s, driver) for driver in FAIL_SAFE_DRIVERS)
    assert found.rate_deg_s == 2.5
    each = len(FAIL_SAFE_DRIVERS)
    assert done == [(step, total) for total in (4 * each, 2 * each) for step in range(1, total + 1)]
    assert [one.family_runs > 0 for one in found.outcomes] == [False, False, True]
    assert [one.family_spins is None for one in found.outcomes] == [True, True, False]


def test_a_spin_counts_before_the_sideslip_angle_and_the_configured_rate_stays_among_equals() -> None:
    calm, spinning = RateOutcome(2.0, 0, 9, 3, 9, 9.0), RateOutcome(4.0, 1, 9, 0, 9, 2.0)
    assert best([spinning, calm]) == calm
    assert best([calm, RateOutcome(5.0, 0, 9, 2, 9, 9.5)]).rate_deg_s == 5.0
    assert best([calm, RateOutcome(5.0, 0, 9, 3, 9, 8.9)]).rate_deg_s == 5.0
    assert best([calm, replace(calm, rate_deg_s=1.0)]) == calm
    assert best([RateOutcome(1.0, 0, 9, None, 0, 1.0), calm]) == calm
