"""Scenarios: their effect on the car, with the numbers of their standards."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sil.software import Software
from codegen.vehicle.single_track import SingleTrack
from hil_sim import manoeuvres
from hil_sim.bench import run
from hil_sim.metrics import evaluate
from hil_sim.scenario_files import find
from hil_sim.scenarios import SCENARIOS
from tests import builds

CONFIG = builds.CONFIG
DEGREE = math.radians(1.0)


def column(name: str, signal: str, config: Config = CONFIG) -> np.ndarray:
    return find(name).inputs(config)[:, INPUT_COLUMNS.index(signal)]


@pytest.mark.parametrize("name", SCENARIOS)
def test_each_scenario_runs_and_has_its_figures(name: str, software: Software) -> None:
    scenario = replace(find(name), faults=())
    inputs = scenario.inputs(CONFIG)
    assert inputs.shape == (round(scenario.duration * 1000), len(INPUT_COLUMNS))
    speed, wheel, friction, estimate, moment, inhibit, acceleration = inputs.T
    assert np.isfinite(inputs[:, [0, 1, 2, 4, 5, 6]]).all()
    assert np.cumsum(acceleration[:-1])[-1] * 1e-3 == pytest.approx(speed[-1] - speed[0], abs=0.01)  # a kink takes half a step
    assert ((speed > 0.0) & (speed < 60.0)).all()
    assert (np.abs(wheel) <= CONFIG.steering.front_angle_stop * CONFIG.steering.ratio).all()
    assert ((friction >= 0.3) & (friction <= 0.9)).all()
    assert np.isnan(estimate).all() or (estimate == 0.5).all()
    assert (np.abs(moment) < 1e4).all() and not inhibit.any()
    # Inputs change from the stated time on, and not before.
    assert np.flatnonzero(np.abs(wheel) + np.abs(moment))[0] == pytest.approx(1000.0 * scenario.steer_time, abs=2.0)
    runs = {name: run(software, scenario, controlled=name == "controlled") for name in ("controlled", "passive")}
    found = evaluate(scenario, CONFIG, runs)
    figures = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert set(figures["controlled"]) == set(figures["passive"])
    assert len(found.rows) >= 7
    assert figures["passive"]["rear_angle_max_deg"] in (0.0, None)


def test_sine_with_dwell_follows_the_standard() -> None:
    wheel = column("sine-with-dwell", "steering_wheel_command")
    # By hand: L/v^2 + K = 3.14/22.22^2 - 1.3e-5 rad s^2/m, times 0.3 * 9.80665 m/s^2, times 13.33: 14.26 deg for 0.3 g.
    assert wheel.max() == pytest.approx(5.0 * 14.26 * DEGREE, rel=1e-3)
    unit = wheel / wheel.max()
    period = 1.0 / 0.7
    dwell = 1.0 + 0.75 * period
    for time, expected in {1.0: 0.0, 1.0 + period / 4: 1.0, 1.0 + period / 2: 0.0, dwell: -1.0, dwell + 0.49: -1.0}.items():
        # A row is up to half a millisecond away, in which 0.7 Hz changes by 0.0022 of the amplitude.
        assert unit[round(1000.0 * time)] == pytest.approx(expected, abs=0.0025), time
    assert unit[round(1000.0 * (1.0 + period + 0.5)) + 1 :].max() == 0.0 == unit[:1000].min()
    assert np.ptp(unit[round(1000 * dwell) + 1 : round(1000 * (dwell + 0.5)) - 1]) == pytest.approx(0.0)


def test_ramp_gains_lateral_acceleration_at_the_named_rate() -> None:
    wheel = column("ramp-steer", "steering_wheel_command")
    speed = 80.0 / 3.6
    lateral = speed * float(SingleTrack.from_config(CONFIG).yaw_gain(speed)) * wheel / CONFIG.steering.ratio
    assert np.diff(lateral[2001:61_999]) * 1000.0 == pytest.approx(0.1, rel=1e-6)


def test_split_friction_is_the_difference_of_the_front_wheels(software: Software) -> None:
    """Worked out by hand: a front wheel carries 2335.07 * 9.81 * 1.566 / (2 * 3.14) = 5712 N, a rear one 5741 N."""
    braking = manoeuvres.split_braking(CONFIG)
    assert braking.yaw_moment == pytest.approx(0.5 * 1.627 * (0.9 - 0.3) * 5712.0, rel=1e-3)
    assert braking.deceleration == pytest.approx((1.2 * 5712.0 + 0.6 * 5741.0) / 2335.07, rel=1e-3)
    moment, speed = column("split-friction", "yaw_moment"), column("split-friction", "speed")
    assert moment[1999] == moment[5000] == 0.0
    assert moment[2250] == pytest.approx(0.5 * braking.yaw_moment)
    assert moment[2500:5000] == pytest.approx(braking.yaw_moment)
    assert (speed[2000] - speed[5000]) / 3.0 == pytest.approx(braking.deceleration)
    assert column("split-friction", "friction")[0] == pytest.approx(0.6)
    # The car turns to the left, the side with grip.
    assert run(software, find("split-friction"), controlled=False)[300:500, 3].min() > 0.0


def test_an_impossible_scenario_is_rejected(software: Software) -> None:
    lost = find("ecu-loss")
    assert len(run(software, lost, controlled=False)) == 1400
    tail_heavy = CONFIG.replace({"vehicle": {"cg_to_front_axle_m": 2.0, "cg_to_rear_axle_m": 1.0}})
    fast = replace(find("sine-sweep"), settings=manoeuvres.Settings(speed_km_h=200.0))
    slow = replace(find("sine-with-dwell"), settings=manoeuvres.Settings(speed_km_h=10.0))
    for refused, words in (
        (lambda: run(software, lost), r"^scenario ecu-loss: .*\(ecu-restart\), and this run has no bus; .*codegen hil"),
        (lambda: fast.inputs(tail_heavy), "unstable at"),
        (lambda: slow.inputs(CONFIG), r"beyond steering\.front_angle_stop_deg"),
    ):
        with pytest.raises(CodegenError, match=words):
            refused()
