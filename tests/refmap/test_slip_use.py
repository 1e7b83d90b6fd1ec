"""Slip that a map takes on the plant: against the plant's own equations, solved anew, and against its bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

from benchmarks.nonlinear_map import nonlinear
from codegen import config as configuration
from codegen.config import Config
from codegen.errors import ConfigError
from codegen.refmap.map import Binding, ReferenceMap
from codegen.refmap.slip_use import ABOVE, slip_use
from codegen.refmap.solve import solve_case
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, two_track
from codegen.vehicle.tyre import AxleTyres

CONFIG = configuration.parse(
    {"grid": {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20}, "controller": {"kind": "pi"}},
    "configuration of the test",
)


def made(*, with_nonlinear_tyre: bool, case: str = "4ws-2") -> ReferenceMap:
    return solve_case(nonlinear(CONFIG, case) if with_nonlinear_tyre else CONFIG, case)


def plant_percent(config: Config, speed: float, front_angle: float, yaw_rate: float) -> np.ndarray:
    """Front and rear slip in percent: lateral speed and rear angle for which the plant's own derivatives vanish."""
    model, tyres = two_track(config), AxleTyres.from_config(config)
    assert model.output is not None
    u = np.zeros(len(PLANT_INPUTS))
    u[PLANT_INPUTS.index("speed")], u[PLANT_INPUTS.index("friction")] = speed, config.road.friction

    def state(unknown: np.ndarray) -> np.ndarray:
        x = np.zeros(len(PLANT_STATES))
        x[PLANT_STATES.index("lateral_speed")], x[PLANT_STATES.index("rear_angle")] = speed * unknown[0], unknown[1]
        x[PLANT_STATES.index("yaw_rate")] = yaw_rate
        x[PLANT_STATES.index("steering_wheel_angle")] = front_angle * config.steering.ratio
        return x

    found = fsolve(lambda z: np.asarray(model.derivative(state(z), u)).ravel()[:2], np.zeros(2), xtol=1e-12)
    assert np.abs(np.asarray(model.derivative(state(found), u)).ravel()[:2]).max() < 1e-7
    slips = np.abs(np.asarray(model.output(state(found), u)).ravel()[-2:])
    return np.asarray(100.0 * slips / [tyres.front_slip_bound, tyres.rear_slip_bound])


@pytest.mark.parametrize("with_nonlinear_tyre", [False, True])
def test_as_the_plant_itself_turns_steadily(with_nonlinear_tyre: bool) -> None:
    found = made(with_nonlinear_tyre=with_nonlinear_tyre)
    used = slip_use(found)
    assert used is not None
    assert not used.unreached.any()
    for i, j in np.argwhere(found.feasible)[::11]:
        percent = plant_percent(CONFIG, found.speed[i], found.front_angle[j], found.yaw_rate[i, j])
        np.testing.assert_allclose([used.front[i, j], used.rear[i, j]], percent, rtol=0.0, atol=1e-5)


def test_the_linear_map_exceeds_its_bounds_and_the_nonlinear_one_meets_them() -> None:
    linear, ours = (slip_use(made(with_nonlinear_tyre=tyre)) for tyre in (False, True))
    assert linear is not None and ours is not None
    assert 110.0 < np.nanmax(linear.front) < 125.0
    assert 110.0 < np.nanmax(linear.rear) < 125.0
    found = made(with_nonlinear_tyre=True)
    assert found.active is not None
    for percent, flag in ((ours.front, Binding.SLIP_FRONT), (ours.rear, Binding.SLIP_REAR)):
        assert not (percent > ABOVE).any()
        bound = (found.active & flag).astype(bool)
        assert bound.any()
        np.testing.assert_allclose(percent[bound], 100.0, atol=1e-4)


def test_a_yaw_rate_beyond_the_tyres_is_not_reached() -> None:
    found = made(with_nonlinear_tyre=False)
    i, j = (int(index) for index in np.argwhere(found.feasible)[-1])
    yaw_rate = found.yaw_rate.copy()
    yaw_rate[i, j] *= 3.0
    used = slip_use(replace(found, yaw_rate=yaw_rate))
    assert used is not None
    assert np.argwhere(used.unreached).tolist() == [[i, j]]
    for percent in (used.front, used.rear):
        np.testing.assert_array_equal(np.isfinite(percent), found.feasible & ~used.unreached)


def test_at_standstill_there_is_no_slip_to_tell() -> None:
    found = made(with_nonlinear_tyre=False)
    speed = np.concatenate([[0.0], found.speed])
    yaw_rate = np.pad(found.yaw_rate, ((1, 0), (0, 0)))
    one = ReferenceMap(speed, found.front_angle, yaw_rate, np.isfinite(yaw_rate), config=found.config, case=found.case)
    used = slip_use(one)
    assert used is not None
    assert not np.isfinite(used.front[0]).any() and not used.unreached[0].any()
    assert np.isfinite(used.front[1:]).sum() == found.feasible.sum()


def test_without_a_car_or_an_end_of_the_linear_range_nothing_is_known() -> None:
    found = made(with_nonlinear_tyre=False)
    assert slip_use(replace(found, config=None, case=None, meta={})) is None
    data = CONFIG.model_dump(mode="json")
    data["tyre"]["front"] |= {"shape_factor_c": 1.0, "curvature_factor_e": 0.0, "cornering_stiffness_n_per_rad": 6000.0}
    data["limits"]["slip_departure_percent"] = 50.0
    endless = configuration.parse(data, "test")
    with pytest.raises(ConfigError, match="never departs"):
        AxleTyres.from_config(endless)
    assert slip_use(replace(found, config=endless)) is None
