"""Use of grip, floor and cap of the yaw rate: properties of the map, compared with the plant, and all solvers with each other.

The cars are those of the benchmark `better`, which differ in what limits them, and random ones.
"""

import functools
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.optimize import fsolve

from benchmarks.judged_cars import five_cars
from codegen.arrays import FloatArray
from codegen.configuration import Config, Identified, preset
from codegen.map_file.bounds import Binding
from codegen.map_file.map import from_bytes, to_bytes
from codegen.optimum import exact, ipopt
from codegen.optimum.demand import bent
from codegen.optimum.nonlinear import NonlinearTurns
from codegen.optimum.problem import PEAK_SHARE, SteadyTurnProblem, breakpoints
from codegen.optimum.solve import solve_acceleration_stack, solve_case
from codegen.optimum.turns import LinearTurns, Solution
from codegen.units import KM_H
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, Model, two_track
from codegen.vehicle.tyre import AxleTyres
from hil_sim.suite.cars import DEVELOPMENT_SEED, random_cars
from tests.optimum.cars import CASE, PAPER, SteadyModel, changed, nonlinear, random_config

MAP = "4ws-2"
CARS = {**five_cars(), **{f"random {number}": car for number, car in enumerate(random_cars(DEVELOPMENT_SEED, 4))}}
ROUNDING = 1e-14
"""Relative; a yaw rate at the cap rises by less than rounding."""
CAPPED = 0.5**0.02
"""Share of the cap that a demand as large as the cap reaches."""

HEAVY = "heavy, 10 deg, 90 ms"


def turns_of(config: Config, **changes: object) -> NonlinearTurns:
    """Return the turns of the recommended case, perhaps with other bounds of the problem."""
    turns = NonlinearTurns.from_config(config, config.cases[MAP])
    return replace(turns, problem=replace(turns.problem, **changes))  # type: ignore[arg-type]


@functools.cache
def drawn(name: str) -> tuple[FloatArray, FloatArray, Solution]:
    """Return random speeds (n,), random front angles (m,), and the map of a car there."""
    rng, grid = np.random.default_rng(20_261_128), CARS[name].grid
    speed = np.sort(rng.uniform(*grid.speed_ends_km_h, 24)) * KM_H
    front_angle = np.radians(np.sort(rng.uniform(*grid.front_angle_ends_deg, 250)))
    return speed, front_angle, turns_of(CARS[name]).solve(speed, front_angle)


# --- grip -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_the_bound_on_grip_is_a_share_of_the_largest_force_of_the_axle(axle: str) -> None:
    """The plant's force is compared. At a very large speed both wheels of an axle have one slip angle; the other axle has none,
    and the wheels do not turn: the force across the car is that of the axle. The scan of the force reaches its peak to 1e-8."""
    for name, lateral_acceleration, friction in itertools.product((HEAVY, "light, rear-heavy"), (0.0, 3.0, 6.0), (0.4, 0.9)):
        config = CARS[name]
        bound = getattr(turns_of(config).problem, f"{axle}_slip_max")
        slips = np.append(np.linspace(0.0, math.radians(45.0), 20_001), bound)
        force = axle_force(config, axle, lateral_acceleration, friction, slips)
        assert force[-1] / force.max() == pytest.approx(config.limits.grip_use_max, abs=1e-7)
        assert slips[force.argmax()] > bound


def axle_force(config: Config, axle: str, lateral_acceleration: float, friction: float, slips: FloatArray) -> FloatArray:
    """Return the plant's force across the car (n,) in N of one axle at slip angles (n,) in rad, the other axle without slip."""
    speed = 2e4
    yaw_rate = lateral_acceleration / speed
    model, vehicle = two_track(config.with_ideal_plant()), config.vehicle
    front, rear = (slips, 0.0 * slips) if axle == "front" else (0.0 * slips, slips)
    # The wheels of the axle are straight, so that its slip gives the lateral speed, and the other wheels run along.
    arm = vehicle.cg_to_front_axle_m if axle == "front" else -vehicle.cg_to_rear_axle_m
    lateral = speed * np.tan(slips) - arm * yaw_rate
    ahead, behind = lateral + vehicle.cg_to_front_axle_m * yaw_rate, lateral - vehicle.cg_to_rear_axle_m * yaw_rate
    states, inputs = (np.zeros((len(names), slips.size)) for names in (PLANT_STATES, PLANT_INPUTS))
    states[PLANT_STATES.index("lateral_speed")], states[PLANT_STATES.index("yaw_rate")] = lateral, yaw_rate
    states[PLANT_STATES.index("steering_wheel_angle")] = (np.arctan(ahead / speed) - front) * config.steering.ratio
    states[PLANT_STATES.index("rear_angle")] = np.arctan(behind / speed) - rear
    inputs[PLANT_INPUTS.index("speed")], inputs[PLANT_INPUTS.index("friction")] = speed, friction
    rates = np.array(model.derivative.map(slips.size)(states, inputs))
    return np.asarray(-vehicle.mass_kg * (rates[0] + speed * yaw_rate))


def test_what_the_drives_did_not_reach_is_not_used() -> None:
    """A use of grip refers to the force that is known."""
    config = CARS[HEAVY]
    known = config.model_copy(update={"identified": Identified(front_grip_reached=0.7, rear_grip_reached=0.9)})
    tyres, whole = AxleTyres.from_config(known), AxleTyres.from_config(config)
    assert tyres.grip_slips is not None
    for tyre, slip, share in zip((whole.front, whole.rear), tyres.grip_slips, (0.7, 0.9), strict=True):
        assert tyre.force(slip) / tyre.force(tyre.peak_slip) == pytest.approx(0.98 * share, rel=1e-9)


def test_maps_without_a_use_of_grip_stay_as_they_were() -> None:
    """Neither bounds nor file know the new keys; `test_against_a_dense_search` compares such maps."""
    config = changed(nonlinear(PAPER, MAP), grid={"speed_points": 3, "front_angle_points": 4})
    turns, tyres = NonlinearTurns.from_config(config, config.cases[MAP]), AxleTyres.from_config(config)
    limits = [PEAK_SHARE * tyres.front.peak_slip, PEAK_SHARE * tyres.rear.peak_slip]
    bounds = np.minimum([tyres.front_slip_bound, tyres.rear_slip_bound], limits)
    assert [turns.problem.front_slip_max, turns.problem.rear_slip_max] == bounds.tolist()
    assert turns.demand(np.array([20.0]), np.array([0.03])) is None and not turns.problem.is_bent
    found = from_bytes(to_bytes(solve_case(config, MAP)), "test")
    keys = {"grip_use_max", "yaw_gain_floor", "reference_characteristic_speed_km_h"}
    assert not keys & found.meta["configuration"]["limits"].keys()
    assert "floor" not in found.meta["active_bits"]
    assert "floor" in solve_case(changed(preset("recommended"), grid=config.grid.model_dump()), MAP).meta["active_bits"]


# --- floor ----------------------------------------------------------------------------------------------------------------


def passive_yaw_rate(config: Config, model: Model, speed: float, front_angle: float) -> float:
    """Return the yaw rate in rad/s of the plant's steady turn with straight rear wheels; NaN where there is none."""
    u = [{"speed": speed, "friction": config.road.friction}.get(name, 0.0) for name in PLANT_INPUTS]

    def rates(unknown: FloatArray, angle: float) -> FloatArray:
        steering = {"steering_wheel_angle": angle * config.steering.ratio}
        x = [{"lateral_speed": unknown[0], "yaw_rate": unknown[1], **steering}.get(name, 0.0) for name in PLANT_STATES]
        return np.asarray(model.derivative(x, u)).ravel()[:2]

    turn = np.zeros(2)
    for angle in np.linspace(0.0, front_angle, 6)[1:]:
        turn = fsolve(rates, turn, (angle,), full_output=True, xtol=1e-13)[0]
    return float(turn[1]) if np.abs(rates(turn, front_angle)).max() < 1e-9 else math.nan


def floor_of(config: Config, model: Model, speed: float, front_angle: float) -> float:
    """Return the floor by its definition, from the plant up to the bound on its lateral acceleration; NaN without a turn."""
    limit = config.limits.lateral_acceleration_max_g * config.road.gravity_m_s2 / speed
    passive = min(passive_yaw_rate(config, model, speed, front_angle), limit)
    characteristic = config.limits.reference_characteristic_speed_km_h * KM_H
    understeering = speed * front_angle / config.vehicle.wheelbase / (1.0 + (speed / characteristic) ** 2)
    return float(config.limits.yaw_gain_floor * blended(speed, passive, min(passive, understeering)))


def blended(speed: float, slow: float, fast: float) -> float:
    """Return the cubic without a slope at 60 and 80 km/h between two values."""
    cubic = BPoly([[0.0], [0.0], [1.0], [1.0]], [60.0, 80.0])
    return slow + float(cubic(min(max(speed / KM_H, 60.0), 80.0))) * (fast - slow)


@pytest.mark.parametrize("name", [HEAVY, "light, rear-heavy", "van, loaded"])
def test_the_floor_by_its_definition(name: str) -> None:
    """An optimum under the floor is raised to it, and any other one stays. The plant's turn is solved to 1e-7."""
    config, rng = CARS[name], np.random.default_rng(5)
    turns, free, model = turns_of(config), turns_of(config, floor=None), two_track(config.with_ideal_plant())
    speed = np.concatenate([rng.uniform(*ends, 30) for ends in ((20.0, 60.0), (60.0, 80.0), (80.0, 120.0))]) * KM_H
    front_angle = np.radians(rng.uniform(0.2, 1.0, speed.size)) * np.minimum(9.0, (90.0 * KM_H / speed) ** 2 * 4.0)
    found, optimum, cap = turns.at(speed, front_angle), free.at(speed, front_angle), turns.cap(speed)
    others = Binding.SIDESLIP | Binding.SLIP_FRONT | Binding.SLIP_REAR | Binding.REAR_ANGLE
    counts = np.zeros(3)
    for k in np.flatnonzero(found.feasible):
        floor = floor_of(config, model, speed[k], front_angle[k])
        floor /= (1.0 + (floor * speed[k] / cap[k]) ** 50) ** 0.02
        capped = bool(found.active[k] & Binding.LATERAL_ACCELERATION)
        is_floor = bool(found.active[k] & Binding.FLOOR)
        if not math.isfinite(floor) or floor * speed[k] > 0.9 * cap[k]:
            continue
        assert not capped or optimum.yaw_rate[k] > floor
        if is_floor:
            assert found.yaw_rate[k] == pytest.approx(floor, rel=2e-6) and optimum.yaw_rate[k] <= floor * (1.0 + 2e-6)
        elif optimum.yaw_rate[k] < floor * (1.0 - 2e-6):  # the bounds win
            assert found.active[k] & others and optimum.yaw_rate[k] <= found.yaw_rate[k] <= floor
        else:
            assert found.yaw_rate[k] == pytest.approx(optimum.yaw_rate[k], rel=1e-9)
        band = int(np.searchsorted([60.0, 80.0], speed[k] / KM_H))
        counts[band] += is_floor
    assert counts[1:].all() and counts.sum() > 20, counts  # below, some cars turn more than passive anyway


def test_the_floor_of_a_car_that_oversteers_near_the_limit() -> None:
    """Its tyres turn the passive car more than its gain at small angles; the floor is the former."""
    tyre = {"rear": {"peak_load_sensitivity_p2": -0.3}}
    config = changed(CARS["light, rear-heavy"], vehicle={"front_roll_share": 0.3}, tyre=tyre, limits={"yaw_gain_floor": 1.1})
    turns, model, speed, front_angle = turns_of(config), two_track(config.with_ideal_plant()), 52.0 * KM_H, math.radians(4.3)
    found = turns.at(np.array([speed]), np.array([front_angle]))
    passive = passive_yaw_rate(config, model, speed, front_angle)
    linear = SteadyModel.of(config, config.cases[MAP]).turns(speed, front_angle, np.zeros(1)).yaw_rate[0]
    floor = 1.1 * passive / (1.0 + (1.1 * passive * speed / turns.cap(np.array([speed]))[0]) ** 50) ** 0.02
    assert passive > 1.005 * linear and found.active[0] & Binding.FLOOR
    assert found.yaw_rate[0] == pytest.approx(floor, rel=2e-6)


@pytest.mark.parametrize("name", CARS)
def test_the_car_turns_at_least_as_much_as_the_passive_one_up_to_the_cap(name: str) -> None:
    """20 to 60 km/h. The plant decides. The bend takes 1.4 % where the passive car reaches the cap; bounds win."""
    config, rng = CARS[name], np.random.default_rng(6)
    turns, model = turns_of(config), two_track(config.with_ideal_plant())
    speed, front_angle = rng.uniform(20.0, 60.0, 12) * KM_H, np.radians(rng.uniform(0.5, 9.0, 12))
    found, cap = turns.at(speed, front_angle), turns.cap(speed) / speed
    bounds = Binding.SIDESLIP | Binding.SLIP_FRONT | Binding.SLIP_REAR | Binding.REAR_ANGLE
    compared = 0
    for k in np.flatnonzero(found.feasible):
        passive = passive_yaw_rate(config, model, speed[k], front_angle[k])
        if math.isfinite(passive) and not found.active[k] & bounds:
            assert found.yaw_rate[k] >= min(passive, cap[k]) * (CAPPED - 1e-6)
            compared += 1
    assert compared >= 4


# --- cap ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CARS)
def test_the_yaw_rate_never_falls_with_the_front_angle(name: str) -> None:
    """It rises, by more than rounding, at least up to 98 % of the cap."""
    speed, front_angle, found = drawn(name)
    rise = np.diff(found.yaw_rate, axis=1) / found.yaw_rate[:, 1:]
    assert np.isfinite(rise).mean() > 0.7 and np.nanmin(rise) >= -ROUNDING
    below = found.yaw_rate[:, 1:] * speed[:, np.newaxis] < 0.98 * turns_of(CARS[name]).cap(speed)[:, np.newaxis]
    steps = (rise / (np.diff(front_angle) / front_angle[1:]))[below & np.isfinite(rise)]
    assert steps.size > 1000 and steps.min() > 0.03  # of the front angle's relative rise: steering counts as dead below


def test_it_does_not_fall_where_the_optimum_is_at_the_limit_of_grip() -> None:
    """That limit falls with the front angle, and so would an optimum with little weight on sideslip, without a floor."""
    changes = {"floor": None, "sideslip_weight": 10.0}
    speed, front_angle = np.array([60.0, 90.0, 118.0]) * KM_H, np.radians(np.linspace(1.0, 10.0, 120))
    found = turns_of(CARS[HEAVY], **changes).solve(speed, front_angle)
    without = turns_of(CARS[HEAVY], **changes, is_bent=False).solve(speed, front_angle)
    assert (np.diff(without.yaw_rate, axis=1) < -1e-6).any()
    assert np.nanmin(np.diff(found.yaw_rate, axis=1) / found.yaw_rate[:, 1:]) >= -ROUNDING


@pytest.mark.parametrize("name", [HEAVY, "paper's", "light, rear-heavy"])
def test_the_yaw_rate_bends_within_the_last_percent_of_the_cap(name: str) -> None:
    """Compared with the same map without a bend, up to the front angle at which that meets the cap, and a tenth beyond."""
    config = CARS[name]
    turns, straight = turns_of(config), turns_of(config, is_bent=False)
    speed, front_angle = np.array([30.0, 50.0, 90.0]) * KM_H, np.radians(np.linspace(0.1, 10.0, 1200))
    found, plain = turns.solve(speed, front_angle), straight.solve(speed, front_angle)
    cap = turns.cap(speed)[:, np.newaxis] / speed[:, np.newaxis]
    rising = np.logical_and.accumulate(np.diff(plain.yaw_rate, axis=1, prepend=0.0) > 0.0, axis=1)
    use = np.where(rising & found.feasible & plain.feasible, plain.yaw_rate / cap, np.nan)
    taken = 1.0 - found.yaw_rate / plain.yaw_rate
    assert np.nanmax(taken[use < 0.9]) < 2e-4 and np.nanmax(taken[use < 0.95]) < 2e-3
    assert np.nanmax(taken[use <= 1.0]) < 0.0138 and np.nanmax(found.yaw_rate / cap) <= 1.0 + ROUNDING
    free = ((found.active | plain.active) & ~(Binding.FLOOR | Binding.LATERAL_ACCELERATION)) == 0
    near = free & (use > 0.9) & (use < 1.0 - 1e-9)  # below, the optimum without a bend is free too
    np.testing.assert_allclose((found.yaw_rate / cap)[near], (use / (1.0 + use**50) ** 0.02)[near], rtol=1e-9)
    assert near.sum() > 20


def test_the_bend_has_no_corner() -> None:
    """Its slope falls from one to zero, by at most 0.02 in a thousandth of the limit."""
    use = np.arange(0.5, 1.5, 0.001)
    slope = np.diff(bent(use, np.ones(use.size))) / np.diff(use)
    assert slope[0] == pytest.approx(1.0, abs=1e-9) and slope[-1] < 1e-6
    assert (np.diff(slope) < 1e-9).all() and np.diff(slope).min() > -0.02


@pytest.mark.parametrize("name", CARS)
def test_the_cap_is_just_below_the_limit_of_grip(name: str) -> None:
    """That limit is taken at every front angle of a dense grid up to the edge, by the same bounds without a bend."""
    config = CARS[name]
    turns, straight = turns_of(config), turns_of(config, is_bent=False)
    speed = np.linspace(*config.grid.speed_ends_km_h, 40)[1:-1] * KM_H
    front_angle = np.radians(np.linspace(*config.grid.front_angle_ends_deg, 60))
    pairs = [values.ravel() for values in np.meshgrid(speed, front_angle, indexing="ij")]
    optimum, grip = straight.at_with_grip(*pairs)
    ends = optimum.feasible & np.isfinite(grip)
    reached = np.where(ends, pairs[0] * grip, np.inf).reshape(speed.size, -1).min(axis=1)
    largest, cap = turns.problem.lateral_acceleration_max, turns.cap(speed)
    smallest = np.minimum(reached, largest)
    assert (cap <= smallest * (1.0 + ROUNDING)).all() and (cap >= 0.95 * smallest).all(), cap / smallest


@pytest.mark.parametrize("name", CARS)
def test_the_map_has_no_step_over_the_speed(name: str) -> None:
    """At 0.05 km/h from one speed to the next, no yaw rate changes by more than four times the share of the speed."""
    config = CARS[name]
    speed = np.arange(config.grid.speed_min_km_h, config.grid.speed_max_km_h, 0.05)
    for front_angle in (0.7, 2.5, 6.0):
        yaw_rate = turns_of(config).at(speed * KM_H, np.full(speed.shape, math.radians(front_angle))).yaw_rate
        change = np.abs(np.diff(np.log(yaw_rate))) / np.diff(np.log(speed))
        assert np.isfinite(change).sum() > 200 and np.nanmax(change) < 4.0


@pytest.mark.parametrize("name", CARS)
def test_the_flag_of_the_cap_by_its_definition(name: str) -> None:
    speed, _, found = drawn(name)
    share = found.yaw_rate * speed[:, np.newaxis] / turns_of(CARS[name]).cap(speed)[:, np.newaxis]
    clear = found.feasible & (np.abs(share - CAPPED) > 1e-9)
    is_marked = (found.active & Binding.LATERAL_ACCELERATION) != 0
    np.testing.assert_array_equal(is_marked[clear], (share > CAPPED)[clear])
    both = is_marked & ((found.active & Binding.FLOOR) != 0)
    assert is_marked.any() and not is_marked[found.feasible].all() and not both.any()


# --- the solvers ----------------------------------------------------------------------------------------------------------


def test_the_yaw_rate_never_falls_while_braking() -> None:
    """The rear axle of a braking car is weak: beyond its stability limit, turns with straight rear wheels exist once more."""
    grid = {
        "speed_min_km_h": 50.0,
        "speed_max_km_h": 80.0,
        "speed_points": 16,
        "front_angle_max_deg": 2.0,
        "front_angle_points": 20,
    }
    config = changed(preset("recommended"), grid=grid)
    for layer in solve_acceleration_stack(config, MAP, (-6.0, -4.0, 0.0)).layers:
        assert np.nanmin(np.diff(layer.map.yaw_rate, axis=1)) >= -ROUNDING


FLOORS = {"yaw_gain_floor": 1.1, "reference_characteristic_speed_km_h": 70.0}


def test_the_linear_floor_on_random_cars() -> None:
    """The independent model has the passive yaw rate and the ends of the feasible range, by a scan of the rear angle."""
    rng, counts = np.random.default_rng(20_261_129), np.zeros(4)
    for _ in range(80):
        config = changed(random_config(rng, rear_steering=True), limits=FLOORS)
        model = SteadyModel.of(config, config.case(CASE))
        speeds, angles = breakpoints(config)
        found, free = (
            exact.solve(model.problem, speeds, angles),
            exact.solve(replace(model.problem, floor=None), speeds, angles),
        )
        for i, j in np.argwhere(found.feasible):
            passive = float(model.turns(speeds[i], angles[j], np.zeros(1)).yaw_rate[0])
            other = speeds[i] * angles[j] / config.vehicle.wheelbase / (1.0 + (speeds[i] / (70.0 * KM_H)) ** 2)
            floor = 1.1 * blended(speeds[i], passive, min(passive, other))
            ours, optimum = float(found.yaw_rate[i, j]), float(free.yaw_rate[i, j])
            marked = bool(found.active[i, j] & Binding.FLOOR)
            if optimum >= floor:
                assert ours == pytest.approx(optimum, rel=1e-12)
            elif ours < floor * (1.0 - 1e-9):  # at a bound that does not allow more: a little more breaks it
                little = np.array([found.rear_angle[i, j] - 1e-7])
                assert not marked and not model.turns(speeds[i], angles[j], little).feasible[0]
                counts[2] += 1
            else:
                assert ours == pytest.approx(floor, rel=1e-9) and marked
                counts[int(speeds[i] > 80.0 * KM_H)] += 1
            assert not marked or abs(ours - floor) <= 2e-6 * floor
            counts[3] += optimum >= floor
    assert (counts > 4).all(), counts  # at the floor below and from 80 km/h, a bound against it, and optima above


GRID = {"speed_breakpoints_km_h": [45.0, 70.0, 110.0], "front_angle_breakpoints_deg": [0.8, 2.5, 5.0, 9.0]}


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
@pytest.mark.parametrize("name", ["van, loaded", "paper's"])
def test_against_ipopt(name: str, tyre_model: str) -> None:
    """IPOPT converges to 1e-12 of its scaled variables, and then to the feasible turn nearest to the yaw rate asked for."""
    limits = {"yaw_gain_floor": 1.3, "reference_characteristic_speed_km_h": 90.0}
    config = changed(CARS[name], grid=GRID, limits=limits).with_tyre_model(tyre_model)
    case = config.cases[MAP]
    linear = LinearTurns(SteadyTurnProblem.from_config(config, case))
    turns = linear if tyre_model == "linear" else NonlinearTurns.from_config(config, case)
    speed, front_angle = breakpoints(config)
    ours, peer = turns.solve(speed, front_angle), ipopt.solve(config, turns, speed, front_angle, None, tyre_model)  # type: ignore[arg-type]
    np.testing.assert_array_equal(ours.feasible, peer.feasible)
    np.testing.assert_array_equal(ours.active, peer.active)
    assert np.nanmax(np.abs(ours.yaw_rate - peer.yaw_rate)) < 1e-7
    assert np.nanmax(np.abs(ours.rear_angle - peer.rear_angle)) < 1e-7
    assert ((ours.active & Binding.FLOOR) != 0).sum() >= 2
    assert tyre_model == "linear" or ((ours.active & Binding.LATERAL_ACCELERATION) != 0).any()
