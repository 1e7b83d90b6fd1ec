"""Loss of rear steering: operating points that depend on it, and the motion compared with the compiled plant."""

import json
import math
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.design import loss
from codegen.design.loss import MODES, LossOfFunction, loss_of_function
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.sil.plant import Plant, PlantInput
from codegen.units import KM_H
from tests.optimum.cars import PAPER, changed, paper_map

HOLD, RAMP, ZERO = range(3)
HUNDREDTH = math.radians(0.01)


def bare(reference_map: ReferenceMap, **replaced: Any) -> ReferenceMap:
    """Return a map with only the arrays of a user's table."""
    arrays = {"vx": reference_map.speed, "delta_f": reference_map.front_angle, "yaw_rate": reference_map.yaw_rate}
    return npz.from_arrays({**arrays, "feasible": reference_map.feasible, **replaced}, "test")


def small(config: Config, case: str = "4ws-2") -> ReferenceMap:
    """Return a map with two speeds, for a short simulation."""
    grid = {"speed_breakpoints_km_h": [40.0, 94.0], "front_angle_breakpoints_deg": [1.0, 2.0, 3.0, 4.0]}
    return solve_case(changed(config, grid=grid), case)


@pytest.fixture(scope="module")
def lost() -> LossOfFunction:
    """Return the result for the paper's 4WS-2."""
    return loss_of_function(paper_map(), PAPER)


def test_what_is_feasible_only_with_rear_steering(lost: LossOfFunction) -> None:
    """These are the cells of 4WS-2 that FWS lacks."""
    steered, passive = paper_map(), paper_map("fws")
    np.testing.assert_array_equal(lost.only_with_rear_steer, steered.feasible & ~passive.feasible)
    assert lost.share_of_grid == pytest.approx((steered.feasible & ~passive.feasible).mean(), rel=1e-12)
    assert lost.share_of_feasible == pytest.approx(1.0 - passive.feasible.sum() / steered.feasible.sum(), rel=1e-12)
    for speed, angle, feasible in zip(lost.speed, lost.front_angle, lost.passively_feasible, strict=True):
        row = int(np.flatnonzero(passive.speed == speed)[0])
        last = passive.front_angle[np.flatnonzero(passive.feasible[row])[-1]]
        if abs(angle - last) > np.diff(passive.front_angle).max():  # the edge lies between two cells
            assert feasible == (angle < last)
    assert set(lost.passively_feasible.tolist()) == {True, False}


def test_speeds_in_standby_or_without_a_feasible_cell_are_omitted() -> None:
    reference_map, feasible = small(PAPER, "fws"), small(PAPER, "fws").feasible.copy()
    fast, faster = (
        changed(PAPER, controller={"disable_speed_km_h": speed, "enable_speed_km_h": speed + 2.0}) for speed in (90.0, 97.0)
    )
    np.testing.assert_array_equal(loss_of_function(reference_map, fast).speed, np.full(3, reference_map.speed[1]))
    assert loss_of_function(reference_map, faster).to_dict()["operating_points"]["speed_km_h"] == []
    feasible[1] = False
    found = loss_of_function(bare(reference_map, feasible=feasible), PAPER)
    np.testing.assert_array_equal(found.speed, np.full(3, reference_map.speed[0]))


def test_a_bare_map_uses_the_rear_angle_of_the_linear_car() -> None:
    """It equals that of the solved map; quantities of the case are unknown; the actuator limits it."""
    solved, table = (loss_of_function(which, PAPER) for which in (small(PAPER), bare(small(PAPER))))
    unknown = (table.only_with_rear_steer, table.share_of_feasible, table.share_of_grid, table.passively_feasible)
    assert unknown == (None, None, None, None) and table.to_dict()["only_with_rear_steer"] is None
    np.testing.assert_allclose(table.rear_angle, solved.rear_angle, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(table.sideslip_max, solved.sideslip_max, rtol=0.0, atol=1e-10)
    limited = loss_of_function(bare(small(PAPER), yaw_rate=0.3 * small(PAPER).yaw_rate), PAPER)
    assert limited.rear_angle.max() == pytest.approx(PAPER.rear_actuator.angle_max, rel=1e-15)


@pytest.mark.parametrize("point", [2, 20])  # 20 km/h; 106 km/h at the edge, which ends in a spin
def test_against_the_compiled_plant(lost: LossOfFunction, point: int) -> None:
    """Tolerance 0.01 deg, the effect of command steps of 5 ms and sampled maxima; ten times finer than reported.

    The plant has steps of 1 ms and starts straight ahead, unlike the code under test; `tests/vehicle` tests it.
    """
    speed, rear, rate = (float(values[point]) for values in (lost.speed, lost.rear_angle, lost.ramp_rate))
    wheel = float(lost.front_angle[point]) * PAPER.steering.ratio
    commands = (lambda time: rear, lambda time: math.copysign(max(abs(rear) - rate * time, 0.0), rear), lambda time: 0.0)
    for mode, command in enumerate(commands):
        plant, seen = Plant(PAPER), []
        plant.advance([PlantInput(speed, wheel, rear, PAPER.road.friction)] * 30_000)
        for time in np.arange(0.0, lost.horizon[mode], 0.001):
            acting = PlantInput(speed, wheel, command(float(time)), PAPER.road.friction)
            seen.append(plant.sample(acting))
            plant.advance([acting])
        sideslip, rear_slip = (np.array([getattr(one, name) for one in seen]) for name in ("sideslip_angle", "slip_rear"))
        assert lost.sideslip_max[mode, point] == pytest.approx(np.abs(sideslip).max(), abs=HUNDREDTH)
        assert lost.spins[mode, point] == np.any(
            (np.abs(sideslip) > math.radians(10.0)) & (np.abs(rear_slip) > math.radians(5.0))
        )
        assert lost.sideslip[point] == pytest.approx(sideslip[0], abs=HUNDREDTH)


def test_zero_is_not_by_itself_a_safe_state(lost: LossOfFunction) -> None:
    """A front angle of 4 deg at 100 km/h or more ends in a spin if the rear angle drops to zero at once."""
    fast_and_tight = (lost.speed > 100.0 * KM_H) & (lost.front_angle > math.radians(4.0))
    assert fast_and_tight.sum() >= 2 and lost.spins[ZERO, fast_and_tight].all()
    assert lost.settles.all() and not lost.spins[HOLD].any() and not lost.spins[RAMP].any()
    # The simulation includes the end of the ramp: the slowest of these points needs 3.5 deg at 3 deg/s.
    slowest = np.max(np.abs(lost.rear_angle) / lost.ramp_rate)
    assert lost.horizon == pytest.approx((4.0, 4.0 + slowest, 4.0), rel=1e-12)
    assert slowest == pytest.approx(3.5 / 3.0, abs=0.02)


def test_the_rate_is_that_of_the_fail_safe() -> None:
    grid = {"speed_breakpoints_km_h": [15.0, 100.0], "front_angle_breakpoints_deg": [0.5, 1.0]}
    controller = {"fail_safe": PAPER.controller.fail_safe.model_dump() | {"rate_deg_s": 2.0}}
    config = changed(PAPER, grid=grid, controller=controller)
    found = loss_of_function(solve_case(config, "4ws-2"), config)
    assert np.degrees(found.ramp_rate) == pytest.approx(2.0, rel=1e-12) and found.ramp_rate.size == found.speed.size


def test_the_map_decides_what_is_feasible_and_the_configuration_which_car_drives() -> None:
    """A build may name another car: on a slippery road the same operating points end worse, but stay feasible."""
    dry, slippery = (loss_of_function(small(PAPER), config) for config in (PAPER, changed(PAPER, road={"friction": 0.4})))
    np.testing.assert_array_equal(slippery.only_with_rear_steer, dry.only_with_rear_steer)
    assert slippery.sideslip_max[ZERO].max() > dry.sideslip_max[ZERO].max() + math.radians(3.0)


def test_where_the_car_does_not_settle_nothing_is_reported() -> None:
    """The rear wheels are turned hard in opposite phase at 105 km/h: the car spins before the loss."""
    arrays = {"vx": np.array([10.0, 105.0 * KM_H]), "delta_f": np.radians([1.0, 4.0]), "yaw_rate": [[0.05, 0.2], [0.3, 1.0]]}
    table = npz.from_arrays({**arrays, "delta_r": np.radians([[0.0, 0.0], [-3.5, -3.5]])}, "test")
    found = loss_of_function(table, PAPER)
    assert found.settles[:3].all() and not found.settles[-1]
    written = found.to_dict()
    json.dumps(written, allow_nan=False)
    assert written["operating_points"]["sideslip_deg"][-1] is None
    for mode in MODES:
        entry = written["rear_angle_after_loss"][mode]
        assert entry["sideslip_max_deg"][-1] is entry["spins"][-1] is None
        assert entry["sideslip_max_deg"][0] is not None and entry["spins"][0] is False


def test_the_step_is_short_enough_for_a_stiff_car(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reference has steps of 1 ms. At 5 ms the method would be unstable. Points that spin differ most."""
    config = changed(PAPER, plant={"relaxation_length_m": 0.05}, rear_actuator={"lag_s": 0.002})
    usual = loss_of_function(small(config), config)
    assert usual.settles.all()
    monkeypatch.setattr(loss, "STEP_MAX", 0.001)
    # Another name for the same case, because results are cached.
    renamed = changed(config, cases={"other": config.cases["4ws-2"].model_dump()})
    fine = loss_of_function(small(renamed, "other"), renamed)
    assert fine.sideslip_max is not usual.sideslip_max
    np.testing.assert_allclose(usual.sideslip_max, fine.sideslip_max, rtol=0.0, atol=0.1 * HUNDREDTH)
    np.testing.assert_array_equal(usual.spins, fine.spins)
