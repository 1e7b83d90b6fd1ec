"""The nonlinear map in closed loop near its slip bounds."""

import math

import numpy as np

from codegen.configuration import Config
from codegen.judgement.build_warnings import excess_warning
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop
from codegen.sil.software import RECORD_COLUMNS, Software, compile_build
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres
from tests import builds
from tests.optimum.cars import PAPER, nonlinear, nonlinear_map
from tests.optimum.test_nonlinear import (
    built,
    tracking,
    with_car,
)

TYRES = AxleTyres.from_config(PAPER)
BOUNDS = np.array([TYRES.front_slip_bound, TYRES.rear_slip_bound])
SLIP_TOLERANCE = 0.01
"""Relative tolerance. The table is exact at breakpoints; single precision and the end of the transient remain."""


def steady_slips(software: Software, config: Config, speed: float, front_angle: float) -> np.ndarray:
    """Return the steady front and rear slip of a build on the plant as fractions of their bounds, after a slow turn-in."""
    time = np.arange(0.0, 30.0, config.plant.sampling_time_s)
    inputs = np.zeros((time.size, len(INPUT_COLUMNS)))
    inputs[:, INPUT_COLUMNS.index("speed")] = speed
    wheel = front_angle * config.steering.ratio * np.clip(time / 10.0, 0.0, 1.0)
    inputs[:, INPUT_COLUMNS.index("steering_wheel_command")] = wheel
    inputs[:, INPUT_COLUMNS.index("friction")] = config.road.friction
    inputs[:, INPUT_COLUMNS.index("friction_estimate")] = math.nan
    record = ClosedLoop(software).run(inputs)[-200:]
    assert np.ptp(record[:, RECORD_COLUMNS.index("yaw_rate_rad_s")]) < 1e-4  # rad/s: settled
    columns = [RECORD_COLUMNS.index(name) for name in ("slip_front_rad", "slip_rear_rad")]
    return np.asarray(np.abs(record[:, columns]).max(axis=0) / BOUNDS)


def test_closed_loop_keeps_the_slip_bounds_in_steady_state() -> None:
    """The points are breakpoints near the end of the map."""
    found, config = nonlinear_map(), nonlinear(PAPER, "4ws-2")
    folder = built(found, config)
    software = compile_build(folder.files, folder.manifest)
    for row, fraction in ((22, 0.99), (40, 0.95), (60, 0.95), (90, 0.9)):
        column = int(fraction * np.flatnonzero(found.feasible[row])[-1])
        slips = steady_slips(software, config, float(found.speed[row]), float(found.front_angle[column]))
        assert (slips <= 1.0 + SLIP_TOLERANCE).all(), (row, slips)
    linear = builds.paper_map()
    last = int(np.flatnonzero(linear.feasible[22])[-1])
    slips = steady_slips(builds.paper().software, PAPER, float(linear.speed[22]), float(linear.front_angle[last]))
    assert 1.10 < slips.max() < 1.25  # the linear map exceeds the bounds on the same plant


def test_kind_tracking_keeps_the_slip_bounds_at_the_edge_and_too_small_a_trim_is_named() -> None:
    """The point is the one where the reference model exceeds the map most."""
    schedule = tracking().controller.tracking.schedule
    assert schedule is not None
    # Not that of the committed map, whose response gain hardly acts at high speed.
    own = {**schedule.model_dump(mode="json"), "response_gain_s": [0.3] * len(schedule.speed_km_h)}
    in_linear_range = {"limits.grip_use_max": None, "limits.yaw_gain_floor": 0.0, "controller.tracking.schedule": own}
    small = tracking(0.1).replace(in_linear_range)
    lacking = built(with_car(nonlinear_map(), small), small)
    assert "controller.tracking.trim_max_percent = " in excess_warning(lacking.manifest)
    config = tracking().replace(in_linear_range)
    folder = built(with_car(nonlinear_map(), config), config)
    assert not excess_warning(folder.manifest)
    point = folder.manifest["reference_model_excess"]
    speed, front_angle = point["at_km_h"] * KM_H, math.radians(point["at_front_angle_deg"])
    slips = steady_slips(compile_build(folder.files, folder.manifest), config, speed, front_angle)
    assert (slips <= 1.0 + SLIP_TOLERANCE).all(), slips
