"""The third party's multi-body car: its rear-steer hook against the untouched model, against itself and against theory."""

from __future__ import annotations

import copy
import functools
import math
import sys
from typing import Any

import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import KM_H, Config
from codegen.errors import CodegenError
from codegen.refmap.map import ReferenceMap
from codegen.refmap.solve import solve_case
from codegen.sil.plant import Plant, PlantInput, PlantSample
from codegen.sil.software import RECORD_COLUMNS, Status
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import AxleTyres
from hil_sim.metrics import column, evaluate, spin_time
from hil_sim.second_plant import Cell, MultiBodyPlant, car_of, cells, package, published, run
from hil_sim.second_plant.plant import LeftModelError
from hil_sim.second_plant.rear_steer import RearSteeredCar
from tests import builds

STATES = 29
LATERAL = (1, 2, 4, 5, 6, 7, 10, 13, 14, 15, 18, 19, 20, 27, 28)
"""States that change sign when left and right are exchanged; the four wheel speeds change places."""
MIRROR_WHEELS = [*range(23), 24, 23, 26, 25, 27, 28]


@functools.cache
def config() -> Config:
    return car_of(published(), configuration.preset())


@functools.cache
def reference_map() -> ReferenceMap:
    return solve_case(config(), "4ws-2")


@functools.cache
def software() -> Any:
    return builds.make(reference_map(), config()).software


def turning_state(car: RearSteeredCar, seed: int) -> list[float]:
    """A car in a turn, every state of it disturbed."""
    rng = np.random.default_rng(seed)
    state = np.array(car.straight_ahead(float(rng.uniform(8.0, 35.0))))
    state += rng.uniform(-1.0, 1.0, STATES) * 0.01
    state[2], state[5], state[10] = rng.uniform(-0.1, 0.1), rng.uniform(-0.4, 0.4), rng.uniform(-0.5, 0.5)
    state[23:27] *= rng.uniform(0.98, 1.02, 4)
    return [float(value) for value in state]


def steady(speed: float, front_angle: float, rear_angle: float = 0.0, time: float = 2.0) -> PlantSample:
    """The car after a step to both angles (rad), long after its yaw motion has settled."""
    plant = MultiBodyPlant(config(), speed)
    acting = PlantInput(speed, front_angle * config().steering.ratio, rear_angle, config().road.friction)
    plant.advance([acting] * round(time / config().plant.sampling_time_s))
    return plant.sample(acting)


def test_without_rear_angle_the_hook_changes_no_bit() -> None:
    original = package.module("vehicle_dynamics_mb").vehicle_dynamics_mb
    parameters = published()
    car = RearSteeredCar(parameters)
    for seed in range(50):
        state = turning_state(car, seed)
        assert car.derivative(state, 0.1, -0.5) == original(list(state), [0.1, -0.5], parameters)


def test_the_hook_changes_nothing_outside_itself() -> None:
    module, tyres = package.module("vehicle_dynamics_mb"), package.module("utils.tire_model")
    before, functions = dict(vars(module)), dict(vars(tyres))
    car, other = RearSteeredCar(published()), RearSteeredCar(published())
    state = turning_state(car, 1)
    kept, straight = list(state), other.derivative(state, 0.0, 0.0)
    assert car.derivative(state, 0.0, 0.0, rear_angle=0.05) != straight
    assert other.derivative(state, 0.0, 0.0) == straight
    assert state == kept
    assert vars(module) == before
    assert vars(tyres) == functions


@pytest.mark.parametrize("seed", range(5))
def test_rear_wheels_steer_as_the_front_wheels_of_the_model_do(seed: int) -> None:
    """A car whose rear half is its front half, seen in a mirror: turned rear wheels do what turned front wheels do.

    Exchanging front and rear exchanges left and right and turns the yaw rate around. The front is the third party's own code.
    """
    parameters = published()
    axles = ("a b", "T_f T_r", "K_sf K_sr", "K_sdf K_sdr", "K_tsf K_tsr", "D_f D_r", "m_uf m_ur", "I_uf I_ur")
    for front, rear in (names.split() for names in axles):
        setattr(parameters, rear, getattr(parameters, front))
    parameters.K_lt = 0.0  # takes the force in the axes of the wheel at the front, of the car at the rear
    car = RearSteeredCar(parameters)
    rng = np.random.default_rng(seed)
    angle, yaw_rate, side = rng.uniform(-0.1, 0.1), rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5)
    spin = rng.uniform(0.97, 1.03, 4) * 20.0 / parameters.R_w
    straight = car.straight_ahead(20.0)
    steered_front, steered_rear = list(straight), list(straight)
    steered_front[2], steered_front[5], steered_front[10] = angle, yaw_rate, side
    steered_rear[5], steered_rear[10] = -yaw_rate, side
    steered_front[23:27] = spin
    steered_rear[23:27] = spin[[3, 2, 1, 0]]
    front_rates = car.derivative(steered_front, 0.0, 0.0)
    rear_rates = car.derivative(steered_rear, 0.0, 0.0, rear_angle=angle)
    exact = {"rel": 1e-9, "abs": 1e-9}  # rounding only: the sums are taken in another order
    # The acceleration along the car has a part of the turning frame, r v.
    assert front_rates[3] - yaw_rate * side == pytest.approx(rear_rates[3] + yaw_rate * side, **exact)
    assert front_rates[5] == pytest.approx(-rear_rates[5], **exact)
    assert front_rates[15] + yaw_rate * 20.0 == pytest.approx(rear_rates[20] - yaw_rate * 20.0, **exact)
    assert front_rates[14] == pytest.approx(rear_rates[19], **exact)
    assert front_rates[23:27] == pytest.approx([rear_rates[place] for place in (26, 25, 24, 23)], **exact)


def test_left_is_right_in_a_mirror() -> None:
    parameters = published()
    for name in ("r_by3", "r_hx1", "r_vy1", "r_vy3"):
        setattr(parameters.tire, name, 0.0)  # ply steer and conicity of the published tyre, the same on both sides
    car = RearSteeredCar(parameters)
    sign = np.ones(STATES)
    sign[list(LATERAL)] = -1.0
    for seed in range(10):
        state = np.array(turning_state(car, seed))
        mirrored = (sign * state)[MIRROR_WHEELS]
        right = np.array(car.derivative(state.tolist(), 0.1, 0.5, 0.05, 0.8, 500.0))
        left = np.array(car.derivative(mirrored.tolist(), -0.1, 0.5, -0.05, 0.8, -500.0))
        np.testing.assert_allclose(left, (sign * right)[MIRROR_WHEELS], rtol=1e-9, atol=1e-8)


def test_the_published_car_turns_left_as_it_turns_right() -> None:
    left, right = (steady(15.0, sign * math.radians(2.0), sign * math.radians(1.0)) for sign in (1.0, -1.0))
    assert left.yaw_rate > 0.0
    assert left.rear_angle == -right.rear_angle > 0.0
    # The published tyre has ply steer and conicity: 0.05 % here.
    assert left.yaw_rate == pytest.approx(-right.yaw_rate, rel=3e-3)


@pytest.mark.parametrize(("speed_km_h", "tolerance"), [(40.0, 0.02), (70.0, 0.05)])
def test_rear_steer_gain_is_that_of_the_linear_car(speed_km_h: float, tolerance: float) -> None:
    """Slope around a slight turn: at zero, the tyre data have a step over camber.

    The tolerance is for what the linear car lacks: roll and camber, lateral compliance. It grows with speed, since the car is
    close to neutral. The gain of the front wheels departs as much, so that their ratio is known far better.
    """
    speed, angle, change = speed_km_h * KM_H, math.radians(1.0), math.radians(0.2)
    base = steady(speed, angle).yaw_rate
    by_rear = (steady(speed, angle, change).yaw_rate - base) / change
    by_front = (steady(speed, angle + change).yaw_rate - base) / change
    gain = float(SingleTrack.from_config(config()).yaw_gain(speed))
    assert by_rear == pytest.approx(-gain, rel=tolerance)
    assert by_rear == pytest.approx(-by_front, rel=0.005)


def test_friction_scales_the_force() -> None:
    # One wheel turned in a car that rolls straight ahead: no load has moved yet.
    car = RearSteeredCar(published())
    state = car.straight_ahead(20.0)
    dry, wet = (car.derivative(state, 0.0, 0.0, 0.05, friction)[20] for friction in (1.0, 0.5))
    assert wet == pytest.approx(0.5 * dry, rel=1e-12)


def test_the_road_is_held_against_the_tyre_data() -> None:
    plant, nominal = MultiBodyPlant(config(), 20.0), published().tire.p_dy1
    plant.advance([PlantInput(20.0, math.radians(30.0), 0.0, nominal)] * 500)
    dry, wet = (plant.sample(PlantInput(20.0, 0.0, 0.0, friction)).lateral_acceleration for friction in (nominal, 0.4))
    assert dry > 3.0
    assert wet == pytest.approx(0.4 / nominal * dry, rel=1e-9)


def test_a_wheel_that_the_model_holds_stays_held() -> None:
    car = RearSteeredCar(published())
    state = turning_state(car, 0)
    state[25] = -1.0
    assert car.derivative(state, 0.0, 0.0, rear_angle=0.05)[25] == 0.0


def test_a_yaw_moment_turns_the_car_to_the_left() -> None:
    plant = MultiBodyPlant(config(), 20.0)
    plant.advance([PlantInput(20.0, 0.0, 0.0, config().road.friction, 2000.0)] * 50)
    assert plant.sample(PlantInput(20.0, 0.0, 0.0, config().road.friction)).yaw_rate > 0.01


def test_actuators_are_those_of_our_own_plant() -> None:
    ours, theirs = Plant(config()), MultiBodyPlant(config(), 20.0)
    for command in (math.radians(5.0), math.radians(-1.0)):
        acting = PlantInput(20.0, math.radians(30.0), command, config().road.friction)
        for _ in range(30):  # long enough for rate, lag and angle to be the limit in turn
            for plant in (ours, theirs):
                plant.advance([acting] * 10)
            here, there = ours.sample(acting), theirs.sample(acting)
            # The same equations and the same method; radians at the wheel or at the steering wheel round differently.
            assert there.rear_angle == pytest.approx(here.rear_angle, abs=1e-14)
            assert there.front_angle == pytest.approx(here.front_angle, abs=1e-14)


def test_outputs_agree_with_each_other_in_a_steady_turn() -> None:
    speed, front, rear = 20.0, math.radians(2.0), math.radians(-0.5)
    car = steady(speed, front, rear, time=3.0)
    vehicle = config().vehicle
    # Steady, so ay = vx r; the speed is held to 0.1 %.
    assert car.lateral_acceleration == pytest.approx(speed * car.yaw_rate, rel=2e-3)
    beta = math.tan(car.sideslip_angle)
    slip_front = math.atan(beta + vehicle.cg_to_front_axle_m * car.yaw_rate / speed) - front
    slip_rear = math.atan(beta - vehicle.cg_to_rear_axle_m * car.yaw_rate / speed) - rear
    assert car.slip_front == pytest.approx(slip_front, rel=5e-3)
    assert car.slip_rear == pytest.approx(slip_rear, rel=5e-3)
    assert slip_front < 0.0 > slip_rear


@pytest.mark.parametrize("number", package.PUBLISHED)
def test_the_configuration_of_each_published_car_is_solved(number: int) -> None:
    parameters = published(number)
    car = car_of(parameters, configuration.preset())
    tyres = AxleTyres.from_config(car)
    tyre, weight = parameters.tire, parameters.m * 9.81
    # Both wheels of both axles carry the car, and this tyre's stiffness is its load times -p_ky1.
    total = 2.0 * (tyres.front.cornering_stiffness + tyres.rear.cornering_stiffness)
    assert total == pytest.approx(-tyre.p_ky1 * weight, rel=1e-5)  # m is rounded, and the slope taken over 0.01 deg
    slip = np.linspace(-0.3, 0.3, 61)
    own = package.module("utils.tire_model").formula_lateral
    theirs = [-own(float(value), 0.0, tyres.front.static_load, tyre)[0] for value in slip]
    # The load differs: ours takes the axle's mass for part of the body, 3 % at the most; so does B, and the peak not at all.
    np.testing.assert_allclose(tyres.front.force(slip), theirs, rtol=0.03)
    assert 0.5 < car.vehicle.front_roll_share < 0.8
    assert solve_case(car, "4ws-2").feasible.any()


def test_the_base_keeps_everything_but_vehicle_tyres_and_road() -> None:
    base = configuration.preset()
    others = {"vehicle", "tyre", "road"}
    assert config().model_dump(exclude=others) == base.model_dump(exclude=others)


def test_half_the_step_changes_the_yaw_rate_by_less_than_a_hundredth_of_a_degree_per_second() -> None:
    data = config().model_dump(mode="json")
    data["plant"]["sampling_time_s"] *= 0.5
    cell = Cell(70.0, 0.6, cells(reference_map())[4].front_angle)
    coarse, fine = (
        column(run(None, car, cell.scenario), "yaw_rate_rad_s") for car in (config(), configuration.parse(data, "half"))
    )
    assert np.rad2deg(np.abs(coarse).max()) > 20.0
    assert np.rad2deg(np.abs(coarse - fine).max()) < 0.01


def test_nine_cells_at_shares_of_the_feasible_front_angle() -> None:
    nine = cells(reference_map())
    assert [(cell.speed_km_h, cell.share) for cell in nine] == [(v, s) for v in (40.0, 70.0, 100.0) for s in (0.3, 0.6, 0.9)]
    speed, angle = reference_map().speed, reference_map().front_angle
    for cell in nine:
        feasible = reference_map().feasible[int(np.argmin(np.abs(speed - cell.speed_km_h * KM_H)))]
        assert cell.front_angle == pytest.approx(cell.share * angle[feasible].max(), rel=1e-9)


def test_a_map_that_ends_too_early_has_no_cells() -> None:
    data = config().model_dump(mode="json")
    data["grid"]["speed_max_km_h"] = 90.0
    with pytest.raises(CodegenError, match="no speed of 100 km/h"):
        cells(solve_case(configuration.parse(data, "slow"), "4ws-2"))


def test_the_controller_closes_the_loop() -> None:
    cell = cells(reference_map())[1]
    record = run(software(), config(), cell.scenario)
    assert record.shape == (400, len(RECORD_COLUMNS))
    assert spin_time(record) is None
    end = slice(-50, None)
    yaw_rate, reference = column(record, "yaw_rate_rad_s")[end], column(record, "yaw_rate_reference_rad_s")[end]
    np.testing.assert_allclose(yaw_rate, reference, rtol=0.002)
    passive = run(None, config(), cell.scenario)
    assert column(passive, "yaw_rate_rad_s")[-1] < 0.8 * reference[-1]
    assert set(column(passive, "status")) == {Status.STANDBY}
    assert not column(passive, "rear_angle_command_rad").any()
    # Held by the car's own engine: 0.05 m/s at 11 m/s.
    for one in (record, passive):
        np.testing.assert_allclose(column(one, "speed_m_s"), cell.speed_km_h * KM_H, atol=0.05)


def test_the_command_acts_after_the_delay() -> None:
    cell = cells(reference_map())[1]
    moved = []
    for delay in (0, 1, 3):
        record = run(software(), config(), cell.scenario, delay_samples=delay)
        first = int(np.flatnonzero(column(record, "rear_angle_command_rad"))[0])
        moved.append(int(np.flatnonzero(column(record, "rear_angle_rad"))[0]) - first)
    # A command of the sample at t acts from t, and is seen at the next sample.
    assert moved == [1, 2, 4]


def test_a_car_that_rolls_over_is_said_to_have_spun() -> None:
    cell = Cell(100.0, 0.9, math.radians(5.0))
    record = run(None, config(), cell.scenario)
    spun_at = spin_time(record)
    assert spun_at is not None
    assert cell.scenario.steer_time < spun_at < cell.scenario.duration
    assert record.shape == (400, len(RECORD_COLUMNS))
    assert np.isfinite(column(record, "time_s")).all()
    assert np.isfinite(column(record, "status")).all()
    assert np.isnan(record[-1, 1:-1]).all()
    assert evaluate(cell.scenario, config(), {"passive": record}).runs["passive"].spun_at == spun_at


def test_a_car_outside_its_model_is_refused() -> None:
    plant = MultiBodyPlant(config(), 28.0)
    acting = PlantInput(28.0, math.radians(90.0), 0.0, config().road.friction)

    def drive() -> None:
        for _ in range(500):
            plant.advance([acting] * 10)
            plant.sample(acting)

    with pytest.raises(LeftModelError, match=r"has left the range of its model \(roll"):
        drive()


def test_a_standing_car_is_refused() -> None:
    with pytest.raises(CodegenError, match="cannot start at 0 m/s; begin above 1 m/s"):
        MultiBodyPlant(config(), 0.0)


def test_an_unknown_car_is_refused() -> None:
    with pytest.raises(CodegenError, match=r"no multi-body car 4; known: 1 \(Ford Escort\), 2 \(BMW 320i\)"):
        published(4)


def test_without_the_package_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    parameters, base = published(), config()
    for name in [name for name in sys.modules if name.split(".")[0] == "vehiclemodels"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, "vehiclemodels", None)
    for use in (published, lambda: car_of(parameters), lambda: MultiBodyPlant(base, 20.0, parameters)):
        with pytest.raises(CodegenError, match=r'pip install "ars-codegen\[crosscheck\]"') as caught:
            use()
        assert "\n" not in str(caught.value)


def test_a_model_that_calls_its_tyres_otherwise_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def two_wheels(state: list[float], _: object, car: Any) -> list[float]:
        for _ in range(2):
            tireModel.formula_longitudinal(0.0, 0.0, 3000.0, car.tire)  # type: ignore[name-defined]  # noqa: F821
        return list(state)

    parameters = copy.deepcopy(published())
    monkeypatch.setattr(package.module("vehicle_dynamics_mb"), "vehicle_dynamics_mb", two_wheels)
    with pytest.raises(CodegenError, match="this release is not known"):
        RearSteeredCar(parameters)
