"""Scenarios: what they do to the car, worked out from the car, with the numbers of their standards."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.errors import CodegenError
from codegen.refmap.solve import solve_case
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sil.software import Software, compile_build
from codegen.vehicle.single_track import SingleTrack
from hil_sim import manoeuvres
from hil_sim.metrics import evaluate
from hil_sim.runs import run
from hil_sim.scenarios import DEFAULT, SCENARIOS, Scenario, find, listing

CONFIG = configuration.preset()
DEGREE = math.radians(1.0)


def parsed(**tables: dict[str, float]) -> Config:
    """The paper's car with some keys changed."""
    data = CONFIG.model_dump()
    for table, keys in tables.items():
        data[table] = {**data[table], **keys}
    return configuration.parse(data, "configuration of the test")


def column(scenario: Scenario, name: str, config: Config = CONFIG) -> np.ndarray:
    return scenario.inputs(config)[:, INPUT_COLUMNS.index(name)]


@pytest.fixture(scope="module")
def software() -> Software:
    tables = {"grid": {"speed_points": 21, "front_angle_points": 20}, "controller": {"kind": "pi"}}
    config = configuration.parse(tables, "configuration of the test")
    folder = build(solve_case(config, "4ws-2"), config, BuildOptions("4ws2"), BuildInputs("4ws2.npz", "0" * 64, "map"))
    return compile_build(folder.files, folder.manifest)


# --- all of them -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENARIOS)
def test_inputs_are_complete_and_something_a_car_can_do(name: str) -> None:
    scenario = find(name)
    inputs = scenario.inputs(CONFIG)
    assert inputs.shape == (round(scenario.duration * 1000), len(INPUT_COLUMNS))
    speed, wheel, friction, estimate, moment, inhibit = inputs.T
    assert np.isfinite(inputs[:, [0, 1, 2, 4, 5]]).all()
    assert ((speed > 0.0) & (speed < 60.0)).all()
    assert (np.abs(wheel) <= CONFIG.steering.front_angle_stop * CONFIG.steering.ratio).all()
    assert ((friction >= 0.3) & (friction <= 0.9)).all()
    assert np.isnan(estimate).all() or (estimate == 0.5).all()
    assert (np.abs(moment) < 1e4).all()
    assert (inhibit == 0.0).all()
    # Something happens from the named time on, and not before.
    begun = np.abs(wheel) + np.abs(moment) > 0.0
    assert np.flatnonzero(begun)[0] == pytest.approx(1000.0 * scenario.steer_time, abs=2.0)


@pytest.mark.parametrize("name", SCENARIOS)
def test_each_runs_beside_the_passive_car_and_has_its_figures(name: str, software: Software) -> None:
    scenario = replace(find(name), faults=())
    records = {"controlled": run(software, scenario), "passive": run(software, scenario, controlled=False)}
    found = evaluate(scenario, software.config, records)
    text = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert set(text) == {"controlled", "passive"}
    assert set(text["controlled"]) == set(text["passive"])
    assert len(found.rows) >= 7
    assert text["passive"]["rear_angle_max_deg"] in (0.0, None)


def test_list_names_all_with_their_sources() -> None:
    rows = listing()
    assert [row.name for row in rows] == list(SCENARIOS)
    assert rows[0].name == DEFAULT
    assert all(row.what and row.source and row.duration_s > 0.0 for row in rows)
    assert next(row.faults for row in rows if row.name == "ecu-loss") == ("ecu-restart at 9 s for 1 s",)


def test_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(CodegenError, match="did you mean 'sine-with-dwell'"):
        find("sine-with-dwel")


@pytest.mark.parametrize("name", SCENARIOS)
def test_title_tells_speed_and_angle(name: str) -> None:
    title = find(name).title
    assert title.isascii()
    assert "km/h" in title or name == "speed-ramp"
    assert "deg" in title or name in ("split-friction", "ramp-steer", "sine-sweep", "sine-with-dwell")


# --- one by one --------------------------------------------------------------------------------------------------------


def test_angle_for_a_lateral_acceleration_is_that_of_the_linear_car() -> None:
    car = SingleTrack.from_config(CONFIG)
    for speed, lateral in ((80.0 / 3.6, 2.0), (30.0, 4.0)):
        angle = manoeuvres.steering_wheel_angle(CONFIG, speed, lateral)
        assert speed * float(car.yaw_gain(speed)) * angle / CONFIG.steering.ratio == pytest.approx(lateral, rel=1e-12)


def test_sine_with_dwell_is_the_standards() -> None:
    wheel = column(find("sine-with-dwell"), "steering_wheel_command")
    # By hand: L/v^2 + K = 3.14/22.22^2 - 1.3e-5 rad s^2/m, times 0.3 * 9.80665 m/s^2, times 13.33: 14.26 deg for 0.3 g.
    assert wheel.max() == pytest.approx(5.0 * 14.26 * DEGREE, rel=1e-3)
    unit = wheel / wheel.max()
    period = 1.0 / 0.7
    at = {1.0: 0.0, 1.0 + period / 4: 1.0, 1.0 + period / 2: 0.0, 1.0 + 0.75 * period: -1.0, 1.0 + 0.75 * period + 0.49: -1.0}
    for time, expected in at.items():
        # A row lies up to half a millisecond from the moment: 0.7 Hz turns through 0.0022 of the amplitude in that time.
        assert unit[round(1000.0 * time)] == pytest.approx(expected, abs=0.0025), time
    assert unit[round(1000.0 * (1.0 + period + 0.5)) + 1 :].max() == 0.0 == unit[:1000].min()
    assert np.diff(
        unit[round(1000 * (1.0 + 0.75 * period)) + 1 : round(1000 * (1.0 + 0.75 * period + 0.5)) - 1]
    ) == pytest.approx(0.0)


def test_sine_with_dwell_follows_the_car() -> None:
    longer = parsed(vehicle={"cg_to_front_axle_m": 2.0, "cg_to_rear_axle_m": 2.0})
    ours, other = (column(find("sine-with-dwell"), "steering_wheel_command", config).max() for config in (CONFIG, longer))
    assert other / ours > 1.2


def test_ramp_gains_lateral_acceleration_at_the_named_rate() -> None:
    car = SingleTrack.from_config(CONFIG)
    speed = 80.0 / 3.6
    wheel = column(find("ramp-steer"), "steering_wheel_command")
    lateral = speed * float(car.yaw_gain(speed)) * wheel / CONFIG.steering.ratio
    assert np.diff(lateral[2001:61_999]) * 1000.0 == pytest.approx(0.1, rel=1e-6)


def test_sweep_starts_and_ends_at_rest_and_covers_its_band() -> None:
    scenario = find("sine-sweep")
    wheel = column(scenario, "steering_wheel_command")
    assert not wheel[:1000].any()
    assert not wheel[81_001:].any()
    rising = np.flatnonzero((wheel[:-1] < 0.0) & (wheel[1:] >= 0.0)) / 1000.0
    frequency = 1.0 / np.diff(rising)
    # The first period begins at 0.1 Hz and ends, ten seconds and four fifths of an octave later, above it.
    assert 0.1 < frequency[0] < 0.17
    assert frequency[-2] == pytest.approx(4.0, rel=0.05)
    assert (np.diff(frequency[1:-1]) > -0.02).all()


def test_speed_ramp_passes_the_thresholds_of_the_controller() -> None:
    config = parsed(controller={"enable_speed_km_h": 40.0, "disable_speed_km_h": 30.0})
    for chosen, low, high in ((CONFIG, 6.0, 30.0), (config, 15.0, 80.0)):
        speed = 3.6 * column(find("speed-ramp"), "speed", chosen)
        assert (speed.min(), speed.max()) == pytest.approx((low, high))
        assert speed[0] == pytest.approx(speed[-1]) == pytest.approx(low)


def test_low_friction_tells_the_controller_nothing_or_the_truth() -> None:
    for name, estimate in (("low-friction", math.nan), ("low-friction-estimated", 0.5)):
        scenario = find(name)
        assert column(scenario, "friction")[0] == 0.5
        np.testing.assert_equal(column(scenario, "friction_estimate")[0], estimate)
        assert column(scenario, "steering_wheel_command")[-1] / CONFIG.steering.ratio == pytest.approx(2.0 * DEGREE)


def test_split_friction_is_the_difference_of_the_front_wheels() -> None:
    """By hand: a front wheel carries 2335.07 * 9.81 * 1.566 / (2 * 3.14) = 5712 N, a rear one 5741 N; 0.9 against 0.3."""
    braking = manoeuvres.split_braking(CONFIG)
    assert braking.yaw_moment == pytest.approx(0.5 * 1.627 * (0.9 - 0.3) * 5712.0, rel=1e-3)
    assert braking.deceleration == pytest.approx((1.2 * 5712.0 + 0.6 * 5741.0) / 2335.07, rel=1e-3)
    scenario = find("split-friction")
    moment, speed = column(scenario, "yaw_moment"), column(scenario, "speed")
    assert moment[1999] == moment[5000] == 0.0
    assert moment[2250] == pytest.approx(0.5 * braking.yaw_moment)
    assert moment[2500:5000] == pytest.approx(braking.yaw_moment)  # to the left, where the road grips
    assert (speed[2000] - speed[5000]) / 3.0 == pytest.approx(braking.deceleration)
    assert column(scenario, "friction")[0] == pytest.approx(0.6)


def test_wheels_grip_side_pulls_the_car_to_it(software: Software) -> None:
    record = run(software, find("split-friction"), controlled=False)
    assert record[300:500, 3].min() > 0.0


# --- refusals ----------------------------------------------------------------------------------------------------------


def test_faults_need_a_bus_and_the_passive_car_does_not(software: Software) -> None:
    scenario = find("ecu-loss")
    with pytest.raises(CodegenError, match=r"^scenario ecu-loss: .*\(ecu-restart\), and this run has no bus; .*`codegen hil`"):
        run(software, scenario)
    assert len(run(software, scenario, controlled=False)) == 1400


def test_oversteering_car_beyond_its_critical_speed_is_refused() -> None:
    tail_heavy = parsed(vehicle={"cg_to_front_axle_m": 2.0, "cg_to_rear_axle_m": 1.0})
    critical = 3.6 * SingleTrack.from_config(tail_heavy).critical_speed
    assert critical < 200.0
    fast = replace(find("sine-sweep"), settings=manoeuvres.Settings(speed_km_h=critical + 1.0))
    with pytest.raises(CodegenError, match="unstable at"):
        fast.inputs(tail_heavy)
    given = replace(fast, settings=manoeuvres.Settings(speed_km_h=critical + 1.0, steering_wheel_angle_deg=5.0))
    assert given.inputs(tail_heavy)[:, 1].max() == pytest.approx(5.0 * DEGREE, rel=1e-2)


def test_an_angle_beyond_the_stop_is_refused() -> None:
    slow = replace(find("sine-with-dwell"), settings=manoeuvres.Settings(speed_km_h=10.0))
    with pytest.raises(CodegenError, match=r"beyond steering\.front_angle_stop_deg"):
        slow.inputs(CONFIG)


def test_a_run_of_too_many_steps_is_refused() -> None:
    fine = parsed(plant={"sampling_time_s": 1e-5})
    with pytest.raises(CodegenError, match="more than 10000000"):
        replace(find("step-steer"), duration=101.0).inputs(fine)
