"""Maps of the plant's own steady turns compared with a dense search, IPOPT and the plant. The evidence tier tests more."""

import functools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

from benchmarks.agreement import SAME, cap_of
from benchmarks.dense_search import DenseSearch
from benchmarks.judged_cars import five_cars
from benchmarks.random_cars import random_car, random_cells, using_grip
from codegen.configuration import Config, preset
from codegen.ecu_map.extend import extend
from codegen.ecu_map.model_excess import model_excess
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.judgement.build_warnings import excess_warning
from codegen.map_file.bounds import Binding
from codegen.map_file.map import ReferenceMap, load
from codegen.optimum import ipopt
from codegen.optimum.nonlinear import ABOVE, NonlinearTurns, slip_use
from codegen.optimum.problem import breakpoints
from codegen.optimum.solve import solve_case
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_OUTPUTS, PLANT_STATES, single_track, two_track
from codegen.vehicle.tyre import AxleTyres
from hil_sim.suite.cars import DEVELOPMENT_SEED, random_cars
from tests import shared
from tests.optimum.cars import CASE, PAPER, changed, nonlinear, paper_map


def test_against_a_dense_search() -> None:
    """The cases are a random cell; a heavy car whose rear tyre is nearly flat at its bound, so that stability ends the curve;
    a floor against sideslip, a floor, and a cap; and a passive car beyond the largest lateral acceleration."""
    rng = np.random.default_rng(100)
    light, heavy = random_car(rng), random_car(np.random.default_rng([1, 14]))
    van = five_cars()["van, loaded"]
    rng = np.random.default_rng([1, 1])
    fast = using_grip(random_car(rng), rng)
    anywhere = random_cells(NonlinearTurns.from_config(light, light.cases[CASE]), light, rng, 1)
    active = []
    for config, case, (speed, front_angle) in (
        (light, CASE, anywhere),
        (heavy, CASE, (np.array([135.163 / 3.6]), np.radians([1.5787]))),
        (changed(van, limits={"yaw_gain_floor": 1.5}), "4ws-2", (np.array([18.0]), np.radians([5.0]))),
        (van, "4ws-2", (np.array([19.0]), np.radians([4.0]))),
        (van, "4ws-2", (np.array([25.0]), np.radians([6.0]))),
        (fast, CASE, (np.array([59.389 / 3.6]), np.radians([2.0527]))),
    ):
        turns = NonlinearTurns.from_config(config, config.cases[case])
        search = DenseSearch.of(config, config.cases[case], cap_of(turns))
        best, found = search.best(float(speed[0]), float(front_angle[0])), turns.at(speed, front_angle)
        assert best.feasible == found.feasible[0]
        assert not best.feasible or abs(best.yaw_rate - found.yaw_rate[0]) < SAME
        active.append(int(found.active[0]))
    assert best.feasible and active[1] == 0  # the stability margin, not a bound of the problem
    assert active[2:] == [Binding.SIDESLIP, Binding.FLOOR, *2 * [Binding.LATERAL_ACCELERATION]]


def test_against_ipopt() -> None:
    """Only a part of the grid is compared. IPOPT converges to 1e-12 of its scaled variables."""
    config = nonlinear(PAPER, "4ws-2")
    turns = NonlinearTurns.from_config(config, config.case("4ws-2"))
    speed, front_angle = (axis[20::40] for axis in breakpoints(config))
    ours = turns.solve(speed, front_angle)
    peer = ipopt.solve(config, turns, speed, front_angle, None, "magic-formula")
    np.testing.assert_array_equal(ours.feasible, peer.feasible)
    assert ours.feasible.sum() >= 2 and not ours.feasible.all()
    assert np.nanmax(np.abs(ours.yaw_rate - peer.yaw_rate)) < 1e-9


def built(reference_map: ReferenceMap, config: Config, **options: object) -> Folder:
    return build(reference_map, config, BuildOptions("test", **options), BuildInputs("test.npz", "0" * 64, "map"))  # type: ignore[arg-type]


COMMITTED = Path(__file__).resolve().parents[2] / "generated/4ws2.npz"


@functools.cache
def tracking_config() -> Config:
    """Return the tuned gains of the committed build, whose map has the nonlinear tyre."""
    config = load(COMMITTED).config
    assert config is not None
    return config


def tracking(trim_percent: float | None = None) -> Config:
    """Return the recommended controller on the paper's car with its tuned gains; by default with its own trim."""
    config = tracking_config()
    if trim_percent is None:
        return config
    trimmed = {**config.controller.tracking.model_dump(mode="json"), "trim_max_percent": trim_percent}
    return changed(config, controller={"tracking": trimmed})


def with_car(reference_map: ReferenceMap, config: Config) -> ReferenceMap:
    """Return the same map with another controller in its configuration."""
    return replace(reference_map, config=config, meta={**reference_map.meta, "configuration": config.model_dump(mode="json")})


def test_on_linear_tyres_the_default_trim_is_enough() -> None:
    """The reference model exceeds the map only near the kink in the last cell."""
    config, linear = tracking_config(), paper_map()
    total = extend(linear, config, config.steering.front_angle_stop)
    assert model_excess(linear, total, config).percent <= preset("recommended").controller.tracking.trim_max_percent == 1.0


@pytest.mark.parametrize("number", range(3))
def test_the_reference_model_has_the_steady_yaw_rate_of_the_plant(number: int) -> None:
    """Up to the cap of the lateral acceleration three cars differ by up to 0.25 %, and beyond it by up to 1.6 % at 10 deg of
    front angle; without load transfer it would be 9 %."""
    config = random_cars(DEVELOPMENT_SEED, number + 1)[number].with_tyre_model("magic-formula")
    turns = NonlinearTurns.from_config(config, config.cases["4ws-2"])
    speed = np.repeat([15.0, 24.0, 33.0], 4)
    front_angle = np.tile([0.1, 0.3, 0.7, 0.99], 3) * np.minimum(turns.edge(speed, 0.2).front_angle, math.radians(10.0))
    found, friction = turns.at(speed, front_angle), config.road.friction
    model = single_track(config, "load-transfer").derivative
    is_capped = (found.active & Binding.LATERAL_ACCELERATION) != 0
    assert is_capped.sum() >= 4 and (~is_capped).sum() >= 4
    for k in range(speed.size):
        u = [speed[k], front_angle[k], found.rear_angle[k], friction]
        state = fsolve(lambda x, u=u: np.array(model(x, u)).ravel(), [found.sideslip[k], found.yaw_rate[k]], xtol=1e-12)
        assert state[1] == pytest.approx(found.yaw_rate[k], rel=2e-2 if is_capped[k] else 3e-3)


@pytest.mark.parametrize(
    ("percent", "trim", "options", "note"),
    [
        (4.6, 20.0, {}, "5 % are enough on these breakpoints: controller.tracking.trim_max_percent = 5 has less overshoot"),
        (-2.0, 2.0, {}, ""),
        (4.6, 1.0, {"max_error_rad_s": 0.01}, "controller.tracking.trim_max_percent = 5 keeps them, with more overshoot"),
        (20.5, 20.0, {"max_error_rad_s": None}, "no trim takes back so much, and a finer [grid], or a build with `max_error=`"),
        (20.5, 20.0, {"max_error_rad_s": None, "max_flash_bytes": 900}, "and a larger `max_flash=` brings"),
    ],
)
def test_the_note_on_the_trim(percent: float, trim: float, options: dict[str, object], note: str) -> None:
    place = {"at_km_h": 120.0, "at_front_angle_deg": 4.3, "at_friction": 0.9}
    excess = {"percent": percent, **place, "trim_max_percent": trim, "enough": percent <= trim}
    found = excess_warning({"reference_model_excess": excess, "options": options})
    assert note in found and bool(note) == bool(found)


CONFIG = changed(PAPER, grid={"speed_points": 11, "front_angle_min_deg": 0.5, "front_angle_points": 10})


@functools.cache
def solved(tyre: str) -> ReferenceMap:
    """Return the 4WS-2 map with one of the two tyre models."""
    if tyre == "linear":
        return solve_case(CONFIG, "4ws-2")
    return shared.once("slip use", lambda: solve_case(nonlinear(CONFIG, "4ws-2"), "4ws-2"))


def plant_percent(found: ReferenceMap, i: int, j: int) -> np.ndarray:
    """Return front and rear slip of a cell in percent, at the lateral speed and rear angle of the plant's steady turn."""
    model, tyres, speed = two_track(CONFIG), AxleTyres.from_config(CONFIG), found.speed[i]
    inputs = {"speed": speed, "friction": CONFIG.road.friction}
    u = [inputs.get(name, 0.0) for name in PLANT_INPUTS]
    turn = {"yaw_rate": found.yaw_rate[i, j], "steering_wheel_angle": found.front_angle[j] * CONFIG.steering.ratio}

    def state(unknown: np.ndarray) -> list[float]:
        moving = {**turn, "lateral_speed": speed * unknown[0], "rear_angle": unknown[1]}
        return [moving.get(name, 0.0) for name in PLANT_STATES]

    def rates(unknown: np.ndarray) -> np.ndarray:
        return np.asarray(model.derivative(state(unknown), u)).ravel()[:2]

    start = np.array([math.tan(found.sideslip[i, j]), found.rear_angle[i, j]])  # avoids the sliding steady turn
    steady = fsolve(rates, start, xtol=1e-12)
    assert np.abs(rates(steady if found.tyre_model == "linear" else start)).max() < 1e-7  # m/s^2, rad/s^2
    outputs = dict(zip(PLANT_OUTPUTS, np.asarray(model.output(state(steady), u)).ravel(), strict=True))
    slips = np.abs([outputs["slip_front"], outputs["slip_rear"]])
    return np.asarray(100.0 * slips / [tyres.front_slip_bound, tyres.rear_slip_bound])


@pytest.mark.parametrize("tyre", ["linear", "nonlinear"])
def test_the_slip_is_that_of_the_plants_steady_turn(tyre: str) -> None:
    """The linear map exceeds its bounds; the nonlinear one meets them exactly where they bind."""
    found = solved(tyre)
    used = slip_use(found)
    assert not used.unreached.any()
    for i, j in np.argwhere(found.feasible)[::9]:
        percent = plant_percent(found, int(i), int(j))
        np.testing.assert_allclose([used.front[i, j], used.rear[i, j]], percent, rtol=0.0, atol=1e-5)
    for percent, flag in ((used.front, Binding.SLIP_FRONT), (used.rear, Binding.SLIP_REAR)):
        if tyre == "linear":
            assert 105.0 < np.nanmax(percent) < 125.0
            continue
        bound = (found.active & flag).astype(bool)
        assert bound.any() and not (percent > ABOVE).any()
        np.testing.assert_allclose(percent[bound], 100.0, atol=1e-4)


def test_a_yaw_rate_beyond_the_tyres_is_not_reached() -> None:
    found = solved("linear")
    i, j = (int(index) for index in np.argwhere(found.feasible)[-1])
    yaw_rate = found.yaw_rate.copy()
    yaw_rate[i, j] *= 3.0
    used = slip_use(replace(found, yaw_rate=yaw_rate))
    assert np.argwhere(used.unreached).tolist() == [[i, j]]
    for percent in (used.front, used.rear):
        np.testing.assert_array_equal(np.isfinite(percent), found.feasible & ~used.unreached)
