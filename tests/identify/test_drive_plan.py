"""The measurement programme: information against an independent simulation, choice of drives, scenarios on the bench."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.identify.drive import Drive
from codegen.identify.drive_plan import (
    BENCH_SIGNALS,
    DrivePlan,
    candidates_of,
    criterion,
    of_interest,
    plan_drives,
    select,
    shares_of,
    signals_of,
)
from codegen.identify.information import information_of
from codegen.identify.names import Names
from codegen.identify.parameters import BY_NAME, configured
from codegen.identify.plan_output import files_of
from codegen.sil.software import RECORD_COLUMNS
from codegen.units import DEGREE
from codegen.vehicle.dynamics import two_track
from hil_sim.bench import run
from hil_sim.scenario_files import find
from tests import builds

LIMIT, DURATION = 4.0, 60.0


def _one_speed(config: Config) -> Config:
    """Return a configuration whose grid leaves the library one speed."""
    return config.model_copy(update={"grid": config.grid.model_copy(update={"speed_breakpoints_km_h": [70.0, 71.0]})})


CAR = _one_speed(builds.TRACKING_CONFIG)


@pytest.fixture(scope="module")
def plan() -> DrivePlan:
    return plan_drives(CAR, LIMIT, DURATION)


# Fisher information

STEP, BLOCK, SETTLING = 0.01, 5, 20
"""Sampling time; samples whose mean counts; samples at the start of a segment that are not compared."""


def _car(**changes: float) -> Config:
    """Return a car with other values, by the names of the table, of whose sensors only those of the outputs have noise."""
    data = configuration.preset("recommended").with_ideal_plant().model_dump(mode="json")
    data["plant"]["relaxation_length_m"] = 0.2
    quiet = {"noise_deg": 1e-9, "resolution_deg": 0.0}
    data["sensors"] |= {"speed": {"noise_km_h": 1e-9, "resolution_km_h": 0.0}, "front_angle": quiet, "rear_angle": quiet}
    data["sensors"]["yaw_rate"]["delay_samples"] = 0
    for axle in ("front", "rear"):
        if f"{axle}_stiffness" in changes:
            data["tyre"][axle]["cornering_stiffness_n_per_rad"] = changes[f"{axle}_stiffness"]
            data["tyre"][axle].pop("stiffness_factor_b_per_rad", None)
    data["vehicle"]["yaw_inertia_kg_m2"] = changes.get("yaw_inertia", data["vehicle"]["yaw_inertia_kg_m2"])
    return configuration.parse(data, "car")


SPEED, TIME = 20.0, np.arange(300) * STEP
FRONT = 1.5 * DEGREE * np.sin(2.0 * np.pi * 0.8 * TIME)


def _motion(config: Config, start: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Return yaw rate, lateral acceleration and sideslip (n, 3) of a sine at the front wheels, by an adaptive integrator.

    Args:
        start: lateral speed in m/s and yaw rate in rad/s at the start.
    """
    model = two_track(config)
    at = {name: k for k, name in enumerate(model.states)}
    inputs = [SPEED, 0.0, 0.0, config.road.friction, 0.0, 0.0]

    def steered(time: float, state: FloatArray) -> FloatArray:
        state = state.copy()
        state[at["steering_wheel_angle"]] = config.steering.ratio * 1.5 * DEGREE * np.sin(2.0 * np.pi * 0.8 * time)
        return state

    def rates(time: float, state: FloatArray) -> FloatArray:
        return np.array(model.derivative(steered(time, state), inputs)).ravel()

    first = np.zeros(len(model.states))
    first[[at["lateral_speed"], at["yaw_rate"]]] = start
    states = solve_ivp(rates, (0.0, TIME[-1]), first, "LSODA", TIME, rtol=1e-7, atol=1e-9).y.T
    rows = []
    for time, state in zip(TIME, states, strict=True):
        seen = dict(zip(model.outputs, np.array(model.output(steered(time, state), inputs)).ravel(), strict=True))
        rows.append((state[at["yaw_rate"]], seen["lateral_acceleration"], seen["sideslip_angle"]))
    return np.array(rows)


def test_the_information_equals_that_of_finite_differences_of_another_simulation() -> None:
    config, names = _car(), ("front_stiffness", "rear_stiffness", "yaw_inertia")
    motion = _motion(config)
    signals = {"vx": np.full(TIME.size, SPEED), "delta_f": FRONT, "delta_r": np.zeros(TIME.size)}
    signals |= dict(zip(("yaw_rate", "lateral_acceleration", "sideslip"), motion.T, strict=True))
    measured = [name for name in signals if name != "sideslip"]
    information = information_of([Drive("sine", TIME, signals)], config, measured)

    columns, values = [], configured(config)
    for name in names:
        high, low = (_motion(_car(**{name: values[name] * factor})) for factor in (1.01, 0.99))
        columns.append((high - low) / 0.02 * BY_NAME[name].spread)
    for start in ((0.02, 0.0), (0.0, 0.02)):
        high, low = (_motion(config, (sign * start[0], sign * start[1])) for sign in (1.0, -1.0))
        columns.append((high - low) / 0.04)
    sensors = config.sensors.yaw_rate, config.sensors.lateral_acceleration
    noise = np.array([np.hypot(each.noise, each.resolution / np.sqrt(12.0)) for each in sensors])
    slopes = np.stack(columns, axis=2)[SETTLING:, :2] / noise[:, None] / np.sqrt(BLOCK)
    jacobian = slopes.reshape(-1, BLOCK, 2, 5).sum(axis=1).reshape(-1, 5)
    # The initial states are free, with spreads of 3 m/s and 0.5 rad/s.
    whole = jacobian.T @ jacobian + np.diag([0.0, 0.0, 0.0, 1.0 / 9.0, 4.0])
    expected = whole[:3, :3] - whole[:3, 3:] @ np.linalg.solve(whole[3:, 3:], whole[3:, :3])
    at = [information.names.index(name) for name in names]
    # 1 %: differences over 1 % of a value, and the slip of the tyres at the start, which is steady in one of the two only.
    np.testing.assert_allclose(information.each[0][np.ix_(at, at)], expected, rtol=0.01)


# Choice


def test_exchanges_find_the_best_of_all_programmes_where_adding_drives_does_not() -> None:
    rng, durations, interest = np.random.default_rng(15), np.array([1.0, 1.0, 2.0, 2.0, 3.0]), np.array([True, True, False])
    roots = rng.standard_normal((5, 3, 1)) * durations[:, None, None]
    each = roots @ roots.transpose(0, 2, 1)
    chosen = select(each, durations, interest, 5.0)
    programmes = [p for n in range(1, 6) for p in itertools.combinations_with_replacement(range(5), n)]
    fitting = [list(p) for p in programmes if durations[list(p)].sum() <= 5.0]
    best = max(float(criterion(each[p].sum(axis=0), interest)) for p in fitting)
    assert float(criterion(each[chosen].sum(axis=0), interest)) == pytest.approx(best)


def test_the_programme_beats_random_ones_of_the_same_library_and_length(plan: DrivePlan) -> None:
    candidates, information = candidates_of(CAR, LIMIT, BENCH_SIGNALS)
    durations, interest = np.array([one.duration for one in candidates]), of_interest(information.parameters)
    reached = float(criterion(plan.information.each.sum(axis=0), interest))
    assert DURATION - durations.min() < plan.duration <= DURATION
    rng = np.random.default_rng(0)
    for _ in range(200):
        chosen: list[int] = []
        while (fitting := np.flatnonzero(durations <= DURATION - durations[chosen].sum())).size:
            chosen.append(int(rng.choice(fitting)))
        assert float(criterion(information.each[chosen].sum(axis=0), interest)) < reached


# Scenarios


def test_the_bench_drives_the_programme_within_the_limit_and_as_predicted(
    plan: DrivePlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    software = builds.of_kind("tracking").software
    column = {name: RECORD_COLUMNS.index(name) for name in RECORD_COLUMNS}
    for (name, content), one in zip(files_of(plan).items(), plan.drives, strict=True):
        Path(name).write_bytes(content)
        record = run(software, find(f"./{name}", software.config))
        acceleration = record[:, column["lateral_acceleration_m_s2"]]
        assert np.abs(acceleration).max() <= LIMIT
        assert one.largest_acceleration <= LIMIT
        # The bench takes steps of 1 ms instead of 10 ms, and the file has six digits.
        assert acceleration == pytest.approx(one.drive.signals["lateral_acceleration"], abs=0.02 * LIMIT)
        assert record[:, column["rear_angle_command_rad"]] == pytest.approx(one.drive.signals["delta_r_command"], abs=1e-6)
        assert record[:, column["yaw_rate_rad_s"]] == pytest.approx(one.drive.signals["yaw_rate"], abs=0.1 * DEGREE)


# What it determines


def test_a_need_that_is_named_is_met_by_a_drive_beyond_the_limit(plan: DrivePlan) -> None:
    quantities = {each.parameter.name: each for each in plan.quantities}
    assert quantities["yaw_inertia"].is_determined
    assert quantities["actuator_rate"].share < 0.01
    front = quantities["front_peak"]
    assert not front.is_determined
    assert front.need.startswith(("slow turns", "steps", "sine sweep"))
    higher = float(front.need.removesuffix(" m/s^2").rpartition(" ")[2])
    assert higher > LIMIT
    _, information = candidates_of(CAR, 1.02 * higher, BENCH_SIGNALS)
    at = information.names.index("front_peak")
    shares = shares_of(plan.information.each.sum(axis=0) + information.each)
    assert shares[:, at].min() < 0.3 < front.share


def test_only_measured_signals_count() -> None:
    without_rear = signals_of(Names.model_validate({"without": ["delta_r", "delta_r_command"]}))
    candidates, information = candidates_of(CAR, LIMIT, (*without_rear, "sideslip"))
    assert all(one.manoeuvre.rear is None for one in candidates)
    assert {"sideslip_offset", "sideslip_delay"} < set(information.names)
    assert "actuator_lag" not in information.names
    named = {"vx": {"signal": "v"}, "yaw_rate": {"signal": "r"}}
    with pytest.raises(CodegenError, match="delta_f or steering_wheel_angle is not measured"):
        signals_of(Names.model_validate(named))
    wheel = signals_of(Names.model_validate({**named, "steering_wheel_angle": {"signal": "s"}}))
    assert "steering_ratio" in candidates_of(CAR, LIMIT, wheel)[1].names
