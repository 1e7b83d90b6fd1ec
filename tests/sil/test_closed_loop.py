"""The closed loop: the same bits in C and from Python; delay, passive car, both precisions."""

import math
from typing import Any

import numpy as np
import pytest

from codegen.arrays import FloatArray
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Status
from tests import builds
from tests.builds import Built

STEPS = 10  # plant steps in a sample
KM_H = 1.0 / 3.6


def inputs(samples: int, **columns: Any) -> FloatArray:
    """Return a scenario; the default is a straight dry road at 42.5 km/h."""
    values = {"speed": 42.5 * KM_H, "friction": 0.9, "friction_estimate": math.nan, **columns}
    return np.stack(
        [np.broadcast_to(np.asarray(values.get(name, 0.0), dtype=float), samples * STEPS) for name in INPUT_COLUMNS], axis=1
    )


def step_steer(samples: int = 300, speed: float = 42.5, angle: float = 90.0) -> FloatArray:
    """Return a step of the steering wheel (deg) after half a second."""
    time = np.arange(samples * STEPS) * 1e-3
    return inputs(samples, speed=speed * KM_H, steering_wheel_command=np.where(time < 0.5, 0.0, math.radians(angle)))


def everything_at_once(samples: int = 300) -> FloatArray:
    """Return inputs that also change within a sample.

    Sine steer, braking through standby into reverse and back, a slippery patch with its estimate, a gust, ESC, a moment without
    speed. The controller tracks, stands by, and works without a signal.
    """
    time = np.arange(samples * STEPS) * 1e-3
    speed = 18.0 * np.cos(2.0 * np.pi * time / 2.5)
    speed[(time > 0.6) & (time < 0.72)] = 250.0  # beyond the input range: a gap, and a replaced signal
    return inputs(
        samples,
        speed=speed,
        steering_wheel_command=1.5 * np.sin(2.0 * np.pi * time),
        friction=np.where((time > 1.0) & (time < 1.5), 0.4, 0.9),
        friction_estimate=np.where((time > 1.1) & (time < 1.5), 0.45, np.nan),
        yaw_moment=np.where((time > 0.2) & (time < 0.4), 3000.0, 0.0),
        inhibit=(time > 0.25) & (time < 0.35),
    )


SCENARIOS = {
    "step steer": step_steer(),
    "to the right, fast": step_steer(speed=110.0, angle=-30.0),
    "everything at once": everything_at_once(),
}


def column(record: FloatArray, name: str) -> FloatArray:
    return record[:, RECORD_COLUMNS.index(name)]


def run(built: Built, scenario: FloatArray, **options: Any) -> FloatArray:
    return ClosedLoop(built.software, LoopOptions(**options)).run(scenario)


@pytest.fixture(scope="module", params=builds.PRECISIONS)
def either(request: pytest.FixtureRequest) -> Built:
    """The paper's build in single and in double precision."""
    return builds.paper(request.param)


@pytest.mark.parametrize(("name", "delay", "controlled"), [("everything at once", 3, True), ("step steer", 0, True),
                                                           ("to the right, fast", 100, False)])  # fmt: skip
def test_c_and_python_loops_give_the_same_bits(either: Built, name: str, delay: int, controlled: bool) -> None:
    options = LoopOptions(controlled=controlled, delay_samples=delay)
    in_c, stepped = (ClosedLoop(either.software, options) for _ in range(2))
    record = in_c.run(SCENARIOS[name])
    assert record.tobytes() == stepped.run_stepped(SCENARIOS[name]).tobytes()
    seen = {Status(int(status)) for status in column(record, "status")}
    assert name != "everything at once" or seen >= {Status.TRACKING, Status.STANDBY, Status.DEGRADED}


def test_a_run_in_pieces_equals_one_run(either: Built) -> None:
    """State and delayed commands carry over, also between both ways of running; only the time restarts."""
    scenario = SCENARIOS["everything at once"]
    whole = run(either, scenario, delay_samples=3)
    loop = ClosedLoop(either.software, LoopOptions(delay_samples=3))
    ends = [0, 1, 2, 50, 180, 300]
    runs = [loop.run, loop.run_stepped, loop.run, loop.run_stepped, loop.run]
    parts = [way(scenario[STEPS * a : STEPS * b]) for way, a, b in zip(runs, ends[:-1], ends[1:], strict=True)]
    assert np.concatenate(parts)[:, 1:].tobytes() == whole[:, 1:].tobytes()
    loop.reset()
    assert loop.run(scenario).tobytes() == whole.tobytes()


def test_the_passive_car_keeps_its_rear_wheels_straight(either: Built) -> None:
    for scenario in SCENARIOS.values():
        record = run(either, scenario, controlled=False)
        for name in ("rear_angle_rad", "rear_angle_command_rad", "yaw_rate_reference_rad_s"):
            assert not column(record, name).any()
        assert (column(record, "status") == Status.STANDBY).all()
        assert np.abs(column(record, "yaw_rate_rad_s")).max() > 0.1, "and yet it turns"


@pytest.mark.parametrize("delay", [0, 3])
def test_a_command_is_delayed_by_whole_samples(either: Built, delay: int) -> None:
    """Without delay it acts from the sample that it was computed from."""
    record = run(either, step_steer(), delay_samples=delay)
    command, angle = column(record, "rear_angle_command_rad"), column(record, "rear_angle_rad")
    assert np.flatnonzero(angle)[0] == np.flatnonzero(command)[0] + delay + 1


def test_an_impossible_delay_and_inputs_of_another_shape_are_refused() -> None:
    software = builds.paper().software
    for delay in (-1, 101):
        with pytest.raises(ValueError, match="outside 0 to 100"):
            ClosedLoop(software, LoopOptions(delay_samples=delay))
    for shape in ((10, 5), (15, 6), (60,), (10, 6, 1)):
        with pytest.raises(ValueError, match="needed"):
            ClosedLoop(software).run(np.zeros(shape))
