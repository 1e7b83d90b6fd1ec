"""The explorer's copy of the C against a build of the same setting, and what it must not get wrong."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.errors import BuildError
from codegen.explore.explorer import Explorer
from codegen.explore.recalibrated import _with_variables
from codegen.refmap.solve import solve_case
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import compile_build
from hil_sim.scenarios import SCENARIOS

MOVED = {
    "limits": {
        "lambda": 200.0,
        "limits.rear_angle_max_deg": 2.0,
        "limits.lateral_acceleration_max_g": 0.5,
        "limits.slip_departure_percent": 8.0,
    },
    "friction": {"road.friction": 0.5, "limits.sideslip_max_deg": 1.5},
    "gains": {"pi": {"controller.integral_gain": 0.3}, "tracking": {"integral_percent": 40.0, "proportional_percent": 150.0}},
}


@pytest.mark.parametrize("name", MOVED)
@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_a_moved_setting_runs_as_a_fresh_build_of_it_does_bit_for_bit(
    kind: str, name: str, request: pytest.FixtureRequest
) -> None:
    explorer: Explorer = request.getfixturevalue(kind)
    moved = MOVED[name]
    config = explorer.configured(moved.get(kind, moved))
    calibration = explorer.calibration(config)
    folder = build(solve_case(config, explorer.case), config, BuildOptions("fresh"), BuildInputs("map.npz", "0" * 64, "map"))
    fresh = ClosedLoop(compile_build(folder.files, folder.manifest))
    # The step is within the map; the second scenario slides beyond it, on a road with less friction than the map's.
    for scenario in (SCENARIOS["step-steer"], SCENARIOS["low-friction"]):
        inputs = scenario.inputs(config)
        fresh.reset()
        expected = fresh.run(inputs)
        assert np.ptp(expected[:, 3]) > 0.1  # rad/s: the car does turn
        np.testing.assert_array_equal(explorer.run(calibration, inputs), expected)


ALONE = (
    {},
    {"lambda": 100.0},
    {"limits.rear_angle_max_deg": 1.0},
    {"limits.lateral_acceleration_max_g": 0.3},
    {"limits.slip_departure_percent": 3.0},
    {"limits.sideslip_max_deg": 0.5},
    {"road.friction": 0.6},
    {"integral_percent": 40.0},
    {"proportional_percent": 200.0},
    {"controller.tracking.lead_s": 0.0},
    {"controller.tracking.yaw_increasing_max_deg": 0.05},
    {"controller.tracking.trim_max_percent": 0.0},
)


def test_every_setting_alone_makes_another_run(tracking: Explorer) -> None:
    records = []
    for moved in ALONE:
        calibration = tracking.calibration(tracking.configured(moved))
        inputs = (SCENARIOS[name].inputs(tracking.start) for name in ("step-steer", "low-friction"))
        records.append(np.concatenate([tracking.run(calibration, each) for each in inputs]))
    for first in range(len(records)):
        for second in range(first):
            assert not np.array_equal(records[first], records[second]), (ALONE[first], ALONE[second])


def test_one_setting_leaves_nothing_behind_for_the_next(pi: Explorer) -> None:
    inputs = SCENARIOS["step-steer"].inputs(pi.start)
    begun, other = (pi.calibration(pi.configured(moved)) for moved in ({}, MOVED["friction"]))
    first = pi.run(begun, inputs)
    assert not np.array_equal(pi.run(other, inputs), first)
    np.testing.assert_array_equal(pi.run(begun, inputs), first)


def test_threads_do_not_run_with_each_other_s_numbers(pi: Explorer) -> None:
    inputs = SCENARIOS["step-steer"].inputs(pi.start)
    calibrations = [pi.calibration(pi.configured(moved)) for moved in ({}, MOVED["friction"])]
    expected = [pi.run(calibration, inputs) for calibration in calibrations]
    wrong: list[int] = []

    def work(which: int) -> None:
        for _ in range(20):
            if not np.array_equal(pi.run(calibrations[which], inputs), expected[which]):
                wrong.append(which)

    threads = [threading.Thread(target=work, args=(which,)) for which in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_the_c_s_own_look_up_is_what_the_cut_shows(tracking: Explorer) -> None:
    calibration = tracking.calibration(tracking.configured(MOVED["friction"]))
    shown = tracking.picture(MOVED["friction"] | {"step.speed_km_h": 90.0})["cut"]
    angles = np.radians(np.array(shown["now"]["front_angle_deg"]))
    looked_up = tracking._software.look_up(calibration, 25.0, angles)
    # Four digits after the point are sent, in deg/s, and the angles are rounded likewise.
    np.testing.assert_allclose(np.degrees(looked_up), shown["now"]["yaw_rate_deg_s"], atol=2e-3)


def test_a_constant_that_is_not_there_is_an_error_and_no_silent_default() -> None:
    source = {"src/a.c": b"ARS_SECTION_CONST static const float limit = 1.0f;\nfloat f(void) { return limit; }\n"}
    made = _with_variables(source, ("limit",))
    assert b"return explore.limit;" in made["src/a.c"]
    with pytest.raises(BuildError, match="other"):
        _with_variables(source, ("limit", "other"))
    with pytest.raises(BuildError, match="limit"):
        _with_variables(source | {"src/b.c": source["src/a.c"]}, ("limit",))
