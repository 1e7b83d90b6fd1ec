"""Slip that a map uses on the plant: against the plant's own equations, solved anew, and against its bounds."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

from codegen.errors import ConfigError
from codegen.refmap.map import Binding, ReferenceMap
from codegen.refmap.slip_use import ABOVE, slip_use
from codegen.refmap.solve import solve_case
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, two_track
from codegen.vehicle.tyre import AxleTyres
from tests import shared
from tests.refmap.cars import PAPER, changed, nonlinear

CONFIG = changed(PAPER, grid={"speed_points": 11, "front_angle_min_deg": 0.5, "front_angle_points": 10})


@functools.cache
def solved(tyre: str) -> ReferenceMap:
    """The 4WS-2 map with one of the two tyre models."""
    if tyre == "linear":
        return solve_case(CONFIG, "4ws-2")
    return shared.once("slip use", lambda: solve_case(nonlinear(CONFIG, "4ws-2"), "4ws-2"))  # type: ignore[no-any-return]


def plant_percent(found: ReferenceMap, i: int, j: int) -> np.ndarray:
    """Front and rear slip of a cell in percent: lateral speed and rear angle for which the plant's own derivatives vanish."""
    config, speed = CONFIG, found.speed[i]
    model, tyres = two_track(config), AxleTyres.from_config(config)
    assert found.sideslip is not None and found.rear_angle is not None
    assert model.output is not None
    u = np.zeros(len(PLANT_INPUTS))
    u[PLANT_INPUTS.index("speed")], u[PLANT_INPUTS.index("friction")] = speed, config.road.friction

    def state(unknown: np.ndarray) -> np.ndarray:
        x = np.zeros(len(PLANT_STATES))
        x[PLANT_STATES.index("lateral_speed")], x[PLANT_STATES.index("rear_angle")] = speed * unknown[0], unknown[1]
        x[PLANT_STATES.index("yaw_rate")] = found.yaw_rate[i, j]
        x[PLANT_STATES.index("steering_wheel_angle")] = found.front_angle[j] * config.steering.ratio
        return x

    start = np.array([found.sideslip[i, j], found.rear_angle[i, j]])  # another steady turn slides
    steady = fsolve(lambda z: np.asarray(model.derivative(state(z), u)).ravel()[:2], start, xtol=1e-12)
    assert np.abs(np.asarray(model.derivative(state(steady), u)).ravel()[:2]).max() < 1e-7
    slips = np.abs(np.asarray(model.output(state(steady), u)).ravel()[-2:])
    return np.asarray(100.0 * slips / [tyres.front_slip_bound, tyres.rear_slip_bound])


@pytest.mark.parametrize("tyre", ["linear", "nonlinear"])
def test_the_slip_is_that_of_the_plants_steady_turn(tyre: str) -> None:
    """The linear map exceeds its bounds; the nonlinear one meets them, where they bind exactly."""
    found = solved(tyre)
    used = slip_use(found)
    assert used is not None and not used.unreached.any() and found.active is not None
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
    assert used is not None
    assert np.argwhere(used.unreached).tolist() == [[i, j]]
    for percent in (used.front, used.rear):
        np.testing.assert_array_equal(np.isfinite(percent), found.feasible & ~used.unreached)


def test_without_speed_car_or_end_of_the_linear_range_nothing_is_known() -> None:
    found = solved("linear")
    yaw_rate = np.pad(found.yaw_rate, ((1, 0), (0, 0)))
    speed = np.concatenate([[0.0], found.speed])
    used = slip_use(ReferenceMap(speed, found.front_angle, yaw_rate, np.isfinite(yaw_rate), config=CONFIG, case="4ws-2"))
    assert used is not None
    assert not np.isfinite(used.front[0]).any() and not used.unreached[0].any()
    assert np.isfinite(used.front[1:]).sum() == found.feasible.sum()
    assert slip_use(replace(found, config=None, case=None, meta={})) is None
    front = {"shape_factor_c": 1.0, "curvature_factor_e": 0.0, "cornering_stiffness_n_per_rad": 6000.0}
    tyre = {**CONFIG.tyre.model_dump(mode="json"), "front": {**CONFIG.tyre.front.model_dump(mode="json"), **front}}
    endless = changed(CONFIG, tyre=tyre, limits={"slip_departure_percent": 50.0})
    with pytest.raises(ConfigError, match="never departs"):
        AxleTyres.from_config(endless)
    assert slip_use(replace(found, config=endless)) is None
