"""The third-party multi-body car: its rear-steer hook, compared with the original model and with itself, and its cells.

Longer drives, compared with linear theory and in closed loop, are in `tests/evidence/drives/test_second_plant.py`.
"""

import copy
import functools
import math
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.sil.plant import Plant, PlantInput
from codegen.sil.software import Status
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres
from hil_sim.metrics import column, spin_time
from hil_sim.second_plant import MultiBodyPlant, car_of, cells, published, run
from hil_sim.second_plant.plant import PUBLISHED, ROLL, RearSteeredCar
from hil_sim.second_plant.plant import module as model_module
from tests import builds


@functools.cache
def config() -> Config:
    return car_of(published(), builds.CONFIG)


@functools.cache
def reference_map() -> ReferenceMap:
    return solve_case(config(), "4ws-2")


@pytest.fixture
def car() -> RearSteeredCar:
    return RearSteeredCar(published())


def turning_state(car: RearSteeredCar, seed: int) -> list[float]:
    """Return a state in a turn with every component disturbed."""
    rng = np.random.default_rng(seed)
    state = np.array(car.straight_ahead(float(rng.uniform(8.0, 35.0))))
    state += rng.uniform(-1.0, 1.0, len(state)) * 0.01
    state[2], state[5], state[10] = rng.uniform(-0.1, 0.1), rng.uniform(-0.4, 0.4), rng.uniform(-0.5, 0.5)
    state[23:27] *= rng.uniform(0.98, 1.02, 4)
    return [float(value) for value in state]


def test_the_hook_changes_no_bit_without_rear_angle_and_nothing_outside_itself(car: RearSteeredCar) -> None:
    module, tyres = model_module("vehicle_dynamics_mb"), model_module("utils.tire_model")
    before, functions = dict(vars(module)), dict(vars(tyres))
    for seed in range(10):
        state = turning_state(car, seed)
        kept, straight = list(state), module.vehicle_dynamics_mb(list(state), [0.1, -0.5], published())
        assert car.derivative(state, 0.1, -0.5) == straight
        assert car.derivative(state, 0.1, -0.5, rear_angle=0.05) != straight
        assert car.derivative(state, 0.1, -0.5) == straight
        assert state == kept
        state[25] = -1.0  # the model holds a wheel with a negative speed
        assert car.derivative(state, 0.0, 0.0, rear_angle=0.05)[25] == 0.0
    assert vars(module) == before
    assert vars(tyres) == functions


@pytest.mark.parametrize("seed", range(2))
def test_rear_wheels_steer_like_the_model_s_front_wheels(seed: int) -> None:
    """The car's rear half mirrors its front half: turned rear wheels act like turned front wheels.

    Exchanging front and rear exchanges left and right and reverses the yaw rate. The front is the third party's own code.
    """
    parameters = published()
    axles = ("a b", "T_f T_r", "K_sf K_sr", "K_sdf K_sdr", "K_tsf K_tsr", "D_f D_r", "m_uf m_ur", "I_uf I_ur")
    for front, rear in (names.split() for names in axles):
        setattr(parameters, rear, getattr(parameters, front))
    parameters.K_lt = 0.0  # uses wheel axes for the force at the front, car axes at the rear
    car = RearSteeredCar(parameters)
    rng = np.random.default_rng(seed)
    angle, yaw_rate, side = rng.uniform(-0.1, 0.1), rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5)
    spin = rng.uniform(0.97, 1.03, 4) * 20.0 / parameters.R_w
    steered_front, steered_rear = car.straight_ahead(20.0), car.straight_ahead(20.0)
    steered_front[2], steered_front[5], steered_front[10], steered_front[23:27] = angle, yaw_rate, side, spin
    steered_rear[5], steered_rear[10], steered_rear[23:27] = -yaw_rate, side, spin[[3, 2, 1, 0]]
    front_rates = car.derivative(steered_front, 0.0, 0.0)
    rear_rates = car.derivative(steered_rear, 0.0, 0.0, rear_angle=angle)
    exact = {"rel": 1e-9, "abs": 1e-9}  # only rounding: the order of the sums differs
    # The longitudinal acceleration has a term of the rotating frame, r v.
    assert front_rates[3] - yaw_rate * side == pytest.approx(rear_rates[3] + yaw_rate * side, **exact)
    assert front_rates[5] == pytest.approx(-rear_rates[5], **exact)
    assert front_rates[15] + yaw_rate * 20.0 == pytest.approx(rear_rates[20] - yaw_rate * 20.0, **exact)
    assert front_rates[14] == pytest.approx(rear_rates[19], **exact)
    assert front_rates[23:27] == pytest.approx([rear_rates[place] for place in (26, 25, 24, 23)], **exact)


def test_friction_scales_the_force_and_a_yaw_moment_turns_to_the_left(car: RearSteeredCar) -> None:
    # One turned wheel in a car that rolls straight ahead: no load transfer yet.
    state = car.straight_ahead(20.0)
    dry, wet = (car.derivative(state, 0.0, 0.0, 0.05, friction)[20] for friction in (1.0, 0.5))
    assert wet == pytest.approx(0.5 * dry, rel=1e-12)
    left, none = (car.derivative(state, 0.0, 0.0, 0.0, 1.0, moment)[5] for moment in (500.0, 0.0))
    assert left - none == pytest.approx(500.0 / published().I_z, rel=1e-9)  # axes of the package: z down
    # The plant scales the road by the friction of the tyre data.
    plant, nominal = MultiBodyPlant(config(), 20.0), published().tire.p_dy1
    plant.advance([PlantInput(20.0, math.radians(30.0), 0.0, nominal)] * 100)
    dry, wet = (plant.sample(PlantInput(20.0, 0.0, 0.0, friction)).lateral_acceleration for friction in (nominal, 0.4))
    assert dry > 1.0
    assert wet == pytest.approx(0.4 / nominal * dry, rel=1e-9)


def test_actuators_equal_those_of_our_own_plant() -> None:
    ours, theirs = Plant(config()), MultiBodyPlant(config(), 20.0)
    for command in (math.radians(5.0), math.radians(-1.0)):
        acting = PlantInput(20.0, math.radians(30.0), command, config().road.friction)
        for _ in range(16):  # long enough for rate, lag and angle to limit in turn
            for plant in (ours, theirs):
                plant.advance([acting] * 10)
            here, there = ours.sample(acting), theirs.sample(acting)
            # The same equations and the same method; radians at the wheel or at the steering wheel round differently.
            assert there.rear_angle == pytest.approx(here.rear_angle, abs=1e-14)
            assert there.front_angle == pytest.approx(here.front_angle, abs=1e-14)


@pytest.mark.parametrize("number", PUBLISHED)
def test_the_configuration_of_each_published_car_has_its_tyres_and_mass(number: int) -> None:
    parameters = published(number)
    car = car_of(parameters, builds.CONFIG)
    tyres, tyre, weight = AxleTyres.from_config(car), parameters.tire, parameters.m * 9.81
    # The four wheels carry the car, and this tyre's stiffness is its load times -p_ky1.
    total = 2.0 * (tyres.front.cornering_stiffness + tyres.rear.cornering_stiffness)
    assert total == pytest.approx(-tyre.p_ky1 * weight, rel=1e-5)  # m is rounded, and the slope is taken over 0.01 deg
    slip = np.linspace(-0.3, 0.3, 61)
    own = model_module("utils.tire_model").formula_lateral
    theirs = [-own(float(value), 0.0, tyres.front.static_load, tyre)[0] for value in slip]
    # The load differs by up to 3 %, because ours counts the axle's mass as body, and so does B; the peak does not.
    np.testing.assert_allclose(tyres.front.force(slip), theirs, rtol=0.03)
    assert 0.5 < car.vehicle.front_roll_share < 0.8
    others = {"vehicle", "tyre", "road"}
    assert car.model_dump(exclude=others) == builds.CONFIG.model_dump(exclude=others)


def test_nine_cells_at_shares_of_the_feasible_front_angle() -> None:
    found = reference_map()
    assert [(cell.speed_km_h, cell.share) for cell in cells(found)] == [(v, s) for v in (40, 70, 100) for s in (0.3, 0.6, 0.9)]
    for cell in cells(found):
        feasible = found.feasible[int(np.argmin(np.abs(found.speed - cell.speed_km_h * KM_H)))]
        assert cell.front_angle == pytest.approx(cell.share * found.front_angle[feasible].max(), rel=1e-9)


def test_a_run_that_leaves_the_model_ends_as_a_spin(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rest of the record has the time, NaN and the last status."""
    advance, calls = MultiBodyPlant.advance, []

    def roll_over(plant: MultiBodyPlant, acting: Any) -> None:
        advance(plant, acting)
        calls.append(1)
        if len(calls) == 10:
            plant._state[ROLL] = math.pi

    monkeypatch.setattr(MultiBodyPlant, "advance", roll_over)
    record = run(None, config(), replace(cells(reference_map())[0].scenario, duration=0.65))
    assert spin_time(record) == pytest.approx(0.1)
    assert record[:, 0] == pytest.approx(0.01 * np.arange(65))
    assert set(column(record, "status")) == {Status.STANDBY}
    assert np.isfinite(record[:10]).all() and np.isnan(record[10:, 1:-1]).all()


def test_an_impossible_run_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    parameters, base = published(), config()
    with pytest.raises(CodegenError, match=r"no multi-body car 4; known: 1 \(Ford Escort\), 2 \(BMW 320i\)"):
        published(4)
    with pytest.raises(CodegenError, match="cannot start at 0 m/s; begin above 1 m/s"):
        MultiBodyPlant(base, 0.0)

    monkeypatch.setattr(model_module("vehicle_dynamics_mb"), "vehicle_dynamics_mb", lambda state, _, car: list(state))
    with pytest.raises(CodegenError, match="this release is not known"):
        RearSteeredCar(copy.deepcopy(parameters))
    for name in ["vehiclemodels", *(name for name in sys.modules if name.startswith("vehiclemodels."))]:
        monkeypatch.setitem(sys.modules, name, None)
    for use in (published, lambda: car_of(parameters), lambda: MultiBodyPlant(base, 20.0, parameters)):
        with pytest.raises(CodegenError, match=r'pip install "commonroad-vehicle-models>=3\.0\.2,<3\.1"$'):
            use()
