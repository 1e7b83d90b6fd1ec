"""Checks of inputs, standby and fail-safe. Each takes a build of any kind and raises AssertionError if the build fails it."""

import math
from dataclasses import replace

import numpy as np

from codegen.sil.software import Command, Measurement, Status
from tests.builds import CONFIG, SPEED, Built
from tests.sil.checks_kinds import OPEN, STILL, config_of, parameters_of

PERIOD = CONFIG.controller.sampling_time_s
RUNNING = (Status.TRACKING, Status.LIMITED)
LOST = Measurement(math.nan, math.nan, math.nan)
"""Sample without any signal, not even the speed."""
NEEDED = {"speed": "speed_max", "front_angle": "front_angle_max", "yaw_rate": "yaw_rate_max"}
OPTIONAL = {"rear_angle": "rear_angle_max", "friction": "friction_max"}


def check_inputs(built: Built) -> None:
    """Check that each field is accepted up to its limit, and rejected one unit in the last place beyond, as NaN and infinity
    are.

    Without a required field the sample is missing; an optional field is replaced.
    """
    parameters = parameters_of(built, {"inputs": OPEN})
    good = built.turn(0.01, rear_angle=0.01, friction=0.8)

    def taken(field: str, value: float) -> bool:
        controller = built.software.controller(0.02, parameters)
        controller.step(good)
        status = controller.step(replace(good, **{field: value})).status  # type: ignore[arg-type]
        if field in NEEDED:
            return status is not Status.DEGRADED
        assert status is not Status.DEGRADED, field
        return bool(getattr(controller.state.sample, field) == float(built.real(value)))

    for field, limit_name in (NEEDED | OPTIONAL).items():
        limit = float(getattr(parameters.inputs, limit_name))
        low = 0.0 if field == "friction" else -limit
        assert taken(field, limit), field
        assert taken(field, low), field
        assert not any(taken(field, built.next(end, beyond)) for end, beyond in ((limit, math.inf), (low, -math.inf))), field
        assert not any(taken(field, nonsense) for nonsense in (math.inf, -math.inf, math.nan)), field


def check_plausibility_limit(built: Built) -> None:
    """Check the yaw rate limit: the largest lateral acceleration over the speed plus a tolerance, also in reverse."""
    parameters = parameters_of(built, {"inputs": {**OPEN, "lateral_acceleration_max": 12.0, "yaw_rate_tolerance": 0.5}})
    parameters.inputs.yaw_rate_max = 20.0
    for speed in (SPEED, -SPEED, 1.0):
        limit = 12.0 / abs(speed) + 0.5
        for yaw_rate in (limit, -limit):
            for share, believed in ((1.0 - 1e-5, True), (1.0 + 1e-5, False)):
                controller = built.software.controller(0.0, parameters)
                controller.step(Measurement(speed, 0.0, 0.0))
                command = controller.step(Measurement(speed, 0.0, yaw_rate * share))
                assert (command.status is not Status.DEGRADED) == believed, (speed, yaw_rate)


def check_signalling_nan(built: Built) -> None:
    """Check that a signalling NaN is rejected like any other. It is written as bytes: a Python float cannot carry one."""
    software, bits = built.software, {4: 0x7F800001, 8: (0x7FF0 << 48) + 1}
    for field in NEEDED:
        controller, sample = software.controller(), software.new("measurement")
        sample[0] = (15.0, 0.0, 0.0, math.nan, math.nan, False)
        software.function("controller_step")(controller.state, controller.parameters, sample)
        offset, size = software.ffi.offsetof(software.ffi.typeof(sample).item, field), np.dtype(software.real).itemsize
        software.ffi.memmove(software.ffi.cast("char *", sample) + offset, bits[size].to_bytes(size, "little"), size)
        command = software.function("controller_step")(controller.state, controller.parameters, sample)
        assert command.status == Status.DEGRADED, field


def check_stand_by(built: Built) -> None:
    """Check that without control the rear angle returns to zero at the lower rate of fail-safe and limiter, and ends there."""
    start, default = built.real(0.02), built.software.parameters()
    for rate_max in (float(default.limiter.rear_rate_max), 0.5 * float(default.fail_safe_rate)):
        parameters = parameters_of(built, {"limiter": {"rear_rate_max": rate_max}})
        step = built.real(min(parameters.fail_safe_rate, parameters.limiter.rear_rate_max)) * built.real(PERIOD)
        for angle, expected in ((start, start - step), (-start, step - start), (step / 2, 0.0), (-step / 2, 0.0)):
            controller = built.software.controller(float(angle), parameters)
            command = built.software.function("controller_stand_by")(controller.state, parameters)
            assert (command.rear_angle, command.yaw_rate_reference, command.status) == (expected, 0.0, Status.STANDBY)


def check_fail_safe(built: Built) -> None:
    """Check that without any input the rear angle returns to zero at its rate, at any speed."""
    step = math.radians(config_of(built).controller.fail_safe.rate_deg_s) * PERIOD
    for start in (0.02, -0.02):
        controller = built.software.controller(start)
        controller.step(built.turn(speed=30.0))
        while controller.step(LOST).status is not Status.FAIL_SAFE:
            pass
        before = controller.state.rear_angle
        path = np.array([before, *(command.rear_angle for command in controller.run([LOST] * 160))])
        # Start and command are rounded near 0.02 rad, so by less than a unit in the last place at 0.03.
        assert np.abs(np.abs(np.diff(path)[np.abs(path[1:]) > 0.0]) - step).max() < 0.1 * built.eps
        assert path[-1] == 0.0


def check_gaps(built: Built) -> None:
    """Check that a law without a sample continues as if the last one was repeated, except for the moving reference model.

    Losing every second sample is no fault; losing more than that ends in the fail-safe.
    """
    good = built.turn(0.01)
    gap = [LOST] * built.software.parameters().inputs.missing_samples_max
    for start in (0.03, -0.01):
        with_gap, without = (built.software.controller(start, parameters_of(built, STILL)) for _ in range(2))
        found, wanted = with_gap.run([good] * 3 + gap + [good]), without.run([good] * (4 + len(gap)))
        assert {command.status for command in found[3:-1]} == {Status.DEGRADED} and found[-1].status in RUNNING
        if built.software.config.controller.kind != "tracking":
            assert [command.rear_angle for command in found] == [command.rear_angle for command in wanted]
    every_second = built.software.controller(0.0, parameters_of(built, STILL)).run([good, LOST] * (3 * len(gap)))
    assert {command.status for command in every_second[1::2]} == {Status.DEGRADED}
    assert Status.FAIL_SAFE not in {command.status for command in every_second}
    mostly = built.software.controller(0.0, parameters_of(built, STILL)).run([good] + [good, LOST, LOST, LOST] * len(gap))
    first = [command.status for command in mostly].index(Status.FAIL_SAFE)
    assert first == 4 * (len(gap) - 1), "three of four samples add three, one subtracts two"
    in_turn = [replace(good, yaw_rate=math.nan), replace(good, front_angle=math.nan)] * (2 * len(gap) + 2)
    controller = built.software.controller(0.0, parameters_of(built, STILL))
    controller.run([good, *in_turn[: 2 * len(gap) + 1]])
    assert controller.state.inputs.yaw_rate.source == 1, "lost, although never in two consecutive samples"


def check_recovery(built: Built) -> None:
    """Check that the fail-safe ends when the good samples outnumber the missing ones by `recovery_samples`, and not before."""
    good, needed = built.turn(0.01), built.software.parameters().inputs.recovery_samples
    controller = built.software.controller(0.03, parameters_of(built, STILL))
    controller.run([good] * 5)
    while controller.step(LOST).status is not Status.FAIL_SAFE:
        pass
    samples = [*[good] * (needed - 1), *[LOST] * (needed + 3), *[good] * (needed - 1), LOST, good]  # the count stops at zero
    assert {command.status for command in controller.run(samples)} == {Status.FAIL_SAFE}
    assert controller.step(good).status in RUNNING
    controller.run([good] * (needed - 1))
    assert controller.state.inputs.yaw_rate.good == 0, "not counted while it is replaced"


def check_standby(built: Built) -> None:
    """Check that control starts at the enabling speed, ends below the disabling one, and keeps its state only between them.

    Reverse is standby. In standby the angle returns to zero at its rate. A law that waits for no speed is in standby until the
    first speed, and holds the angle.
    """
    parameters = parameters_of(built, {"inputs": OPEN})
    if not config_of(built).controller.waits_for_speed:
        lost = Measurement(math.nan, 0.0, 0.0)
        held = built.software.controller(0.02, parameters).run([lost] * 20)
        assert {*held} == {Command(float(built.real(0.02)), 0.0, Status.STANDBY)}
        for speed in (-SPEED, -0.0, 0.0, SPEED):
            assert built.software.controller(0.02, parameters).step(Measurement(speed, 0.0, 0.0)).status in RUNNING
        return
    enable, disable = float(parameters.enable_speed), float(parameters.disable_speed)
    between = 0.5 * (enable + disable)
    drive = [
        *((0.0, False), (between, False), (built.next(enable, 0.0), False), (enable, True), (SPEED, True)),
        *((between, True), (disable, True), (built.next(disable, 0.0), False), (between, False), (enable, True)),
        *((0.0, False), (-0.0, False), (-1.0, False), (-SPEED, False), (-60.0, False), (between, False), (SPEED, True)),
    ]
    controller = built.software.controller(0.0, parameters)
    for speed, controlled in drive:
        command = controller.step(Measurement(speed, 0.0, 0.0))
        assert (command.status in RUNNING) == controlled, speed
        assert controlled or command.status is Status.STANDBY
    controller, step = built.software.controller(0.05), math.radians(CONFIG.controller.standby_rate_deg_s) * PERIOD
    commands = controller.run([Measurement(disable - 0.1, 0.1, 0.0)] * 80)
    path = np.array([0.05, *(command.rear_angle for command in commands)])
    # Start and commands are rounded near 0.05 rad: an eighth of a unit in the last place at 1.
    assert np.abs(-np.diff(path)[path[1:] > 0.0] - step).max() < 0.3 * built.eps
    assert (path >= 0.0).all() and path[-1] == 0.0


def check_from_standstill(built: Built) -> None:
    """Check a law that waits for no speed: at standstill the angle is held; a slow car moves it with the distance driven, at no
    more than 1.9 deg/s, in reverse as forwards; the way to the whole rate limit is continuous."""
    config = config_of(built)
    if config.controller.waits_for_speed:
        return
    parameters, front = parameters_of(built, {"inputs": OPEN}), 0.1
    slow, each_metre = float(parameters.slow_speed), config.rear_actuator.angle_max / config.controller.fade_distance_m
    turned = {}
    for speed in (-0.9 * slow, -1.0, -0.05, 0.0, 0.05, 1.0, 0.9 * slow):
        controller = built.software.controller(0.0, parameters)
        sample = Measurement(speed, front, speed * front / config.vehicle.wheelbase)
        path = np.array([0.0, *(command.rear_angle for command in controller.run([sample] * 1500))])
        steps, turned[speed] = np.abs(np.diff(path)), path[-1]
        distance = abs(speed) * PERIOD if abs(speed) > 0.1 else 0.0
        # The steps are differences of angles that are rounded near 0.1 rad.
        assert steps.max() <= min(each_metre * distance, math.radians(1.9) * PERIOD) + 0.2 * built.eps, speed
        assert (steps.max() > 0.0) == (distance > 0.0), speed
        assert (controller.state.yaw_rate_reference * speed > 0.0) == (speed != 0.0), speed
    assert turned[-1.0] == turned[1.0] and turned[-0.9 * slow] == turned[0.9 * slow] < 0.0
    largest = []
    for speed in (slow, built.next(slow, 99.0), built.next(3.0 * slow, 0.0)):
        controller = built.software.controller(0.0, parameters)
        controller.step(Measurement(0.0, -0.3, 0.0))  # the law starts, and has no feedback yet
        controller.step(Measurement(speed, -0.3, 0.0))
        largest.append(abs(controller.state.rear_angle))
    rate = min(float(parameters.rear_rate_max), float(parameters.limiter.rear_rate_max))
    assert abs(largest[1] - largest[0]) <= 1e-6 * largest[0] and largest[2] >= 0.99 * rate * PERIOD
