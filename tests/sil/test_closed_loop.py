"""The closed loop: in C and from Python the same bits; delay, passive car, threads, both modes of loading, both precisions."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.compile import compile_library
from codegen.sil.software import RECORD_COLUMNS, Measurement, Software, Status, bench_sources
from tests import builds
from tests.builds import Built

FloatArray = npt.NDArray[np.float64]
STEPS = 10  # plant steps in a sample
KM_H = 1.0 / 3.6


def inputs(samples: int, **columns: Any) -> FloatArray:
    """A scenario; what is not given is a straight dry road at 42.5 km/h."""
    values = {"speed": 42.5 * KM_H, "friction": 0.9, "friction_estimate": math.nan, **columns}
    return np.stack(
        [np.broadcast_to(np.asarray(values.get(name, 0.0), dtype=float), samples * STEPS) for name in INPUT_COLUMNS], axis=1
    )


def step_steer(samples: int = 300, speed: float = 42.5, angle: float = 90.0) -> FloatArray:
    """The steering wheel (deg) turned after half a second."""
    time = np.arange(samples * STEPS) * 1e-3
    return inputs(samples, speed=speed * KM_H, steering_wheel_command=np.where(time < 0.5, 0.0, math.radians(angle)))


def everything_at_once(samples: int = 300) -> FloatArray:
    """Inputs that change within a sample too: sine steer, braking through standby into reverse and back, a slippery patch with
    its estimate, a gust, ESC, a moment without speed."""
    time = np.arange(samples * STEPS) * 1e-3
    speed = 20.0 * np.cos(2.0 * np.pi * time / 2.5)
    speed[(time > 0.6) & (time < 0.72)] = 250.0  # beyond the input range: a gap and the fail-safe, above every bound of a car
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


@pytest.mark.parametrize(("name", "delay", "controlled"), [("everything at once", 3, True), ("step steer", 0, True),
                                                           ("to the right, fast", 100, False)])  # fmt: skip
def test_in_c_and_stepped_from_python_the_same_bits(either: Built, name: str, delay: int, controlled: bool) -> None:
    options = LoopOptions(controlled=controlled, delay_samples=delay)
    in_c, stepped = (ClosedLoop(either.software, options) for _ in range(2))
    assert in_c.run(SCENARIOS[name]).tobytes() == stepped.run_stepped(SCENARIOS[name]).tobytes()


def test_the_scenarios_reach_every_status(either: Built) -> None:
    seen = {status for scenario in SCENARIOS.values() for status in column(run(either, scenario), "status")}
    assert seen == {float(status) for status in Status}


def test_a_run_in_pieces_is_the_run_in_one(either: Built) -> None:
    """State and waiting commands carry over, between both ways of running as well; only the time starts again."""
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


def actuator(command: FloatArray, delay: int) -> FloatArray:
    """Rear angle at each sample for commands that act `delay` samples late: lag and rate limit, Runge-Kutta at 1 ms."""
    config = builds.CONFIG.rear_actuator
    rate = math.radians(config.rate_max_deg_s)
    angle, angles, h = 0.0, [], 1e-3
    for sample in range(command.size):
        angles.append(angle)
        acting = command[sample - delay] if sample >= delay else 0.0
        demand = min(max(acting, -config.angle_max), config.angle_max)

        def slope(at: float, demand: float = demand) -> float:
            return min(max((demand - at) / config.lag_s, -rate), rate)

        for _ in range(STEPS):
            k1 = slope(angle)
            k2 = slope(angle + 0.5 * h * k1)
            k3 = slope(angle + 0.5 * h * k2)
            k4 = slope(angle + h * k3)
            angle += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return np.array(angles)


@pytest.mark.parametrize("delay", [0, 3])
def test_a_command_acts_so_many_whole_samples_late(either: Built, delay: int) -> None:
    """Without delay it acts from the sample that it was computed from: the rear angle is that of a model of the actuator fed
    with the recorded commands, shifted."""
    record = run(either, step_steer(), delay_samples=delay)
    command, angle = column(record, "rear_angle_command_rad"), column(record, "rear_angle_rad")
    assert np.flatnonzero(angle)[0] == np.flatnonzero(command)[0] + delay + 1
    # The same equations in another order of operations, over 3000 steps that forget within 50.
    assert np.abs(angle - actuator(command, delay)).max() < 1e-15
    assert np.abs(angle - actuator(command, delay + 1)).max() > 1e-4, "a sample more or less is seen"


def test_the_delay_is_the_configuration_s_where_none_is_given(paper: Built) -> None:
    config = builds.CONFIG.model_copy(update={"plant": builds.CONFIG.plant.model_copy(update={"command_delay_samples": 2})})
    software = paper.software
    configured = Software(software.compiled, software.prefix, software.precision, config)
    assert ClosedLoop(configured).run(step_steer()).tobytes() == run(paper, step_steer(), delay_samples=2).tobytes()


@pytest.mark.parametrize("delay", [-1, 101])
def test_an_impossible_delay_is_refused(paper: Built, delay: int) -> None:
    with pytest.raises(ValueError, match="outside 0 to 100"):
        ClosedLoop(paper.software, LoopOptions(delay_samples=delay))


@pytest.mark.parametrize("shape", [(10, 5), (15, 6), (60,), (10, 6, 1)])
def test_inputs_of_another_shape_are_refused(paper: Built, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="needed"):
        ClosedLoop(paper.software).run(np.zeros(shape))


def test_two_loops_in_threads_give_the_bits_of_each_alone(either: Built) -> None:
    jobs = [(scenario, delay) for scenario in SCENARIOS.values() for delay in (0, 3)] * 4
    alone = [run(either, scenario, delay_samples=delay).tobytes() for scenario, delay in jobs]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda job: run(either, job[0], delay_samples=job[1]).tobytes(), jobs))
    assert together == alone


def test_a_plain_shared_library_gives_the_bits_of_the_extension(either: Built) -> None:
    """ABI mode, for machines without Python's headers."""
    software = either.software
    sources = {path: text for path, text in either.folder.files.items() if path.startswith(("include/", "src/"))}
    sources |= bench_sources(builds.CONFIG, software.prefix, software.precision)
    headers = [f"include/ars_{name}.h" for name in ("map", "controller", "dynamics")] + ["bench/plant.h", "bench/loop.h"]
    library = compile_library("ars_sil", sources, headers, include_folders=("include", "bench"), mode="abi")
    plain = Built(either.folder, either.total, Software(library, "ars", software.precision, builds.CONFIG))
    assert plain.software.selftest()
    for scenario in SCENARIOS.values():
        assert run(plain, scenario).tobytes() == run(either, scenario).tobytes()
    controllers = [built.software.controller(0.02) for built in (plain, either)]
    drive = [either.turn(error) for error in np.linspace(-0.2, 0.2, 50)]
    assert controllers[0].run(drive) == [controllers[1].step(sample) for sample in drive]


def test_single_and_double_precision_are_close(paper: Built) -> None:
    """The loop is stable: what the controller rounds at each sample does not build up over the run."""
    single, double = (run(built, step_steer()) for built in (paper, builds.paper("double")))
    bounds = {
        # About four times what was found, which is some units in the last place of single precision (6e-8 at 1).
        "yaw_rate_reference_rad_s": 1e-6,
        "rear_angle_command_rad": 3e-7,
        "rear_angle_rad": 3e-7,
        "yaw_rate_rad_s": 1e-6,
        "sideslip_rad": 3e-7,
    }
    worst = {name: np.abs(column(single, name) - column(double, name)).max() for name in bounds}
    assert all(0.0 < worst[name] < bound for name, bound in bounds.items()), worst


FAST = 100.0 / 3.6


def drive_with_a_fault(built: Built, front_angle: float, fault_yaw_rate: float | None) -> tuple[float, list[Status]]:
    """Largest |sideslip| (rad) from 4 s on, and the statuses, of a drive at 100 km/h in which the yaw-rate sensor fails at 4 s.

    The sensor then sticks at `fault_yaw_rate` (rad/s), or is lost (NaN).
    """
    software = built.software
    lib, ffi = software.compiled.lib, software.ffi
    controller = software.controller()
    plant, output = ffi.new("plant_state_t *"), ffi.new("plant_output_t *")
    wheel = front_angle * software.config.steering.ratio
    largest, statuses = 0.0, []
    for sample in range(1000):
        source = ffi.new("plant_input_t *", (FAST, wheel, 0.0, 0.9, 0.0))
        lib.plant_output(plant, source, output)
        yaw_rate = plant.yaw_rate
        if sample >= 400:
            yaw_rate = math.nan if fault_yaw_rate is None else fault_yaw_rate
            largest = max(largest, abs(output.sideslip_angle))
        command = controller.step(Measurement(FAST, output.front_angle, yaw_rate, plant.rear_angle))
        statuses.append(command.status)
        source.rear_angle_command = command.rear_angle
        for _ in range(10):
            lib.plant_step(plant, source, 0.001)
    return largest, statuses[400:]


@pytest.mark.parametrize("yaw_rate", [math.radians(100.0), -math.radians(100.0)])
def test_a_mad_yaw_rate_sensor_does_not_steer_the_car(paper: Built, yaw_rate: float) -> None:
    """Straight ahead the car stays straight: not one sample of a yaw rate that cannot be is controlled upon."""
    largest, statuses = drive_with_a_fault(paper, 0.0, yaw_rate)
    assert largest == 0.0
    held = round(paper.software.config.controller.inputs.implausible_time_s / 0.01)
    assert statuses == [Status.DEGRADED] * held + [Status.FAIL_SAFE] * (len(statuses) - held)


@pytest.mark.parametrize("yaw_rate", [None, math.radians(100.0)])
def test_losing_the_sensor_in_a_corner_keeps_the_car_as_it_is(paper: Built, yaw_rate: float | None) -> None:
    """3 deg at 100 km/h, steered with the rear wheels: held, the sideslip stays what it was, 0.54 deg."""
    largest, statuses = drive_with_a_fault(paper, math.radians(3.0), yaw_rate)
    assert statuses[-1] is Status.FAIL_SAFE
    assert math.degrees(largest) < 0.6
