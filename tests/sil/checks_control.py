"""Checks of the paper's control law. Each takes a build and raises AssertionError if the build fails it.

Errors are reference minus measured yaw rate, rad/s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from codegen.sil.software import Command, Controller, Measurement, Status
from codegen.verify.law.course import drive
from tests.builds import CONFIG, SPEED, Built

PERIOD = CONFIG.controller.sampling_time_s
RATE_LIMIT = math.radians(25.0)
RUNNING = (Status.TRACKING, Status.LIMITED)
Actuator = Callable[[float], float]
"""Last command -> the rear angle that is measured, both in rad."""


def unmeasured(_: float) -> float:
    """No sensor."""
    return math.nan


def ideal(command: float) -> float:
    """An actuator that is where it was told to be."""
    return command


def stuck_at(angle: float) -> Actuator:
    """An actuator that does not move."""
    return lambda _: angle


def run(built: Built, controller: Controller, errors: Iterable[float], actuator: Actuator = unmeasured) -> list[Command]:
    """A sample in the same turn for each error; the actuator is measured before each."""
    commands = []
    for error in errors:
        angle = actuator(float(controller.state.rear_angle))
        commands.append(controller.step(built.turn(error, rear_angle=angle)))
    return commands


def angles(commands: Iterable[Command]) -> list[float]:
    """The rear angles that were asked for."""
    return [command.rear_angle for command in commands]


def check_sign(built: Built) -> None:
    """Too little yaw rate to the left steers the rear wheels to the right, against the front ones; and the mirror image."""
    for error in (0.02, -0.02):
        commands = angles(run(built, built.software.controller(), [error] * 20))
        assert all(angle * error < 0.0 for angle in commands)
        assert (np.diff(np.abs(commands)) > 0.0).all(), "the integral goes on adding in the same direction"


def check_gains(built: Built) -> None:
    """rear_angle = -(Kp e + Ki integral of e) for errors that stay clear of every limit."""
    errors = 0.03 * np.sin(0.3 * np.arange(80))
    commands = angles(run(built, built.software.controller(), errors))
    controller = CONFIG.controller
    # The measured yaw rate is rounded to the build's numbers, and the integral rounds at each of 80 samples.
    wanted = -(controller.proportional_gain_s * errors + controller.integral_gain * PERIOD * np.cumsum(errors))
    wanted += controller.proportional_gain_s * errors[0]  # bumpless: the first proportional part is in the integral
    assert np.abs(np.array(commands) - wanted).max() < 40.0 * built.eps * np.abs(errors).max()


def check_saturation(built: Built) -> None:
    """A lasting error takes the command to the limit, exactly, and not beyond; the status says so."""
    for sign in (1.0, -1.0):
        for actuator in (unmeasured, ideal):
            controller = built.software.controller()
            commands = run(built, controller, [0.2 * sign] * 300, actuator)
            limit = controller.parameters.rear_angle_max
            assert max(map(abs, angles(commands))) <= limit
            assert all(command.rear_angle == -sign * limit and command.status is Status.LIMITED for command in commands[-200:])
            assert commands[0].status is Status.TRACKING


def check_anti_windup(built: Built) -> None:
    """Error +0.2 rad/s for 10 s, then -0.05 (times the sign): the command leaves its limit in one sample."""
    for sign, actuator, rate in (
        (1.0, unmeasured, None),
        (-1.0, ideal, None),
        (1.0, ideal, RATE_LIMIT),
        (-1.0, unmeasured, RATE_LIMIT),
    ):
        _check_anti_windup(built, sign, actuator, rate)


def _check_anti_windup(built: Built, sign: float, actuator: Actuator, rate: float | None) -> None:
    software = built.software
    parameters = software.parameters() if rate is None else software.parameters(rear_rate_max=rate)
    controller = software.controller(0.0, parameters)
    before = run(built, controller, [0.2 * sign] * round(10.0 / PERIOD), actuator)
    assert before[-1].rear_angle == -sign * parameters.rear_angle_max
    (after,) = run(built, controller, [-0.05 * sign], actuator)
    gains = CONFIG.controller
    # Back by one step of the law: the change of the proportional part and one step of the integral.
    expected = gains.proportional_gain_s * 0.25 + gains.integral_gain * PERIOD * 0.05
    moved = sign * (after.rear_angle - before[-1].rear_angle)
    assert abs(moved - expected) < 10.0 * built.eps
    assert after.status is Status.TRACKING


def check_windup_by_a_stuck_actuator(built: Built) -> None:
    """An actuator stuck at one degree: the command runs ahead of it by so much, no more, and turns back in one sample."""
    for sign in (1.0, -1.0):
        stuck = -sign * math.radians(1.0)
        controller = built.software.controller(stuck)
        commands = run(built, controller, [0.2 * sign] * 1000, stuck_at(stuck))
        ahead = controller.parameters.rear_angle_error_max
        assert max(abs(angle - stuck) for angle in angles(commands)) <= ahead + 0.1 * built.eps
        assert abs(commands[-1].rear_angle - (stuck - sign * ahead)) <= 0.1 * built.eps  # one sum, below 0.06 rad
        assert commands[-1].status is Status.LIMITED
        (after,) = run(built, controller, [-0.05 * sign], stuck_at(stuck))
        assert sign * (after.rear_angle - commands[-1].rear_angle) > 0.002, "a step of the law is 0.003 rad"
        freed = run(built, controller, [0.0] * 5, ideal)
        assert max(np.abs(np.diff([after.rear_angle, *angles(freed)]))) < 0.001, "once it is free nothing jumps"


def check_rate_limit(built: Built) -> None:
    """The command moves by no more than rate times period in a sample, in either direction and from any angle."""
    for rate in (RATE_LIMIT, math.radians(3.0)):
        parameters = built.software.parameters(rear_rate_max=rate)
        controller = built.software.controller(0.02, parameters)
        errors = [1.0] * 40 + [-1.0] * 80 + [1.0] * 20
        commands = run(built, controller, errors)
        steps = np.abs(np.diff([0.02, *angles(commands)]))
        # The step is a difference of two numbers, each rounded.
        assert steps.max() <= rate * PERIOD + 0.1 * built.eps
        assert (steps > 0.999 * rate * PERIOD).sum() > 15, "the limit is used in full"
        assert all(c.status is Status.LIMITED for c, step in zip(commands, steps, strict=True) if step > 0.999 * rate * PERIOD)


def check_windup_by_the_rate_limit(built: Built) -> None:
    """While the rate limit acts, the integral does not run ahead of the command: it turns back in one sample."""
    for sign in (1.0, -1.0):
        controller = built.software.controller(0.0, built.software.parameters(rear_rate_max=math.radians(1.0)))
        before = run(built, controller, [0.2 * sign] * 100)
        limit = controller.parameters.rear_angle_max
        assert 0.01 < -sign * before[-1].rear_angle < 0.5 * limit, "still on its way, at the rate limit"
        (after,) = run(built, controller, [-0.05 * sign])
        assert sign * (after.rear_angle - before[-1].rear_angle) > 0.0


def check_bumpless(built: Built, start: float = 0.03, error: float = 0.1) -> None:
    """The first command after a start is the angle held, but for one step of the integral."""
    controller = built.software.controller(start)
    held = float(controller.state.rear_angle)
    assert held == float(built.software.real(start))
    (command,) = run(built, controller, [error])
    limit = controller.parameters.rear_angle_max
    expected = held - CONFIG.controller.integral_gain * PERIOD * error
    assert command.status in RUNNING
    # The sums round at the size of the angle and of the proportional part; the error, times Ki T = 0.01, at that of the yaw
    # rate.
    assert abs(command.rear_angle - max(min(expected, limit), -limit)) <= built.eps * (abs(start) + abs(error) + 0.01)


def check_inhibit(built: Built) -> None:
    """While ESC or ABS acts the integral stays, at a limit too; the proportional part goes on."""
    # Errors of 1.5 rad/s are not plausible; here they shall get through.
    controller = built.software.controller(0.01, built.software.parameters(yaw_rate_tolerance=20.0))
    run(built, controller, [0.03] * 10)
    integral = float(controller.state.integral)
    for error in (0.2, -0.3, 0.0, 1.5, -1.5):
        command = controller.step(built.turn(error, inhibit=True))
        limit = controller.parameters.rear_angle_max
        assert float(controller.state.integral) == integral
        expected = integral - CONFIG.controller.proportional_gain_s * error
        assert abs(command.rear_angle - max(min(expected, limit), -limit)) < built.eps
    saturating = controller.step(built.turn(0.3, inhibit=True, rear_angle=0.06))
    assert saturating.status is Status.LIMITED, "two degrees behind the actuator is as far as it goes"
    assert float(controller.state.integral) == integral
    run(built, controller, [0.03])
    assert float(controller.state.integral) < integral


def check_friction(built: Built) -> None:
    """An estimate scales the largest lateral acceleration; below friction_min it counts as that, above the map's own as its
    own, and none is the map's own."""
    software, own = built.software, CONFIG.road.friction
    speed, front = 30.0, 0.06  # deep in the capped part of the map

    def reference(friction: float) -> float:
        measurement = Measurement(speed, front, 0.1, friction=friction)
        return software.controller().step(measurement).yaw_rate_reference

    full = built.total.lateral_acceleration_cap / speed
    for friction in (0.1, 0.2, 0.5, 0.89):
        # The cap is lowered by four units in the last place (8 u); three roundings.
        assert abs(reference(friction) - full * friction / own) < 12.0 * built.eps * full
    assert reference(0.0) == reference(-0.0) == reference(0.05) == reference(0.1) > 0.0
    assert reference(0.9) == reference(1.5) == reference(math.nan) == float(software.map_yaw_rate(speed, front))
    small = Measurement(SPEED, 0.01, 0.0, friction=0.5)  # far below the cap the road plays no part
    assert software.controller().step(small).yaw_rate_reference == built.reference(SPEED, 0.01)


def check_command_within_limit(built: Built) -> None:
    """Whatever angle the state holds, the command is within the parameters' limit in every status, from the first sample."""
    parameters = built.software.parameters(rear_angle_max=0.02, rear_rate_max=0.1, degraded_samples_max=2)
    limit = float(parameters.rear_angle_max)
    parameters.limiter.rear_angle_max = limit
    parameters.limiter.opposite_phase_max = [limit, limit]
    lost = Measurement(math.nan, 0.0, 0.0)
    slow, fast, mute = Measurement(0.0, 0.0, 0.0), built.turn(0.0), Measurement(30.0, 0.0, math.nan)
    for start in (1.0, -1.0, math.inf, -math.inf):
        for first in (slow, fast, mute, Measurement(-5.0, 0.0, 0.0), lost):
            controller = built.software.controller(start, parameters)
            commands = controller.run([first] * 3)
            assert all(abs(command.rear_angle) <= limit for command in commands), (start, first)
            assert controller.run([lost] * 4)[-1].status is Status.FAIL_SAFE
            assert abs(controller.step(lost).rear_angle) <= limit
    # A limiter that allows more than the controller: the promise is the controller's.
    parameters = built.software.parameters(rear_angle_max=0.02)
    if built.software.function("parameters_valid")(parameters):
        parameters.limiter.rear_rate_max = 0.1
        for first in (lost, fast):
            assert abs(built.software.controller(1.0, parameters).step(first).rear_angle) <= parameters.rear_angle_max


def check_starts(built: Built) -> None:
    """A start from any angle is bumpless; an impossible angle counts as the nearest limit, NaN as zero."""
    for start in (-0.061, -0.03, 0.0, 0.02, 0.061):
        for error in (-0.5, -0.05, 0.0, 0.1, 0.5):
            check_bumpless(built, start, error)
    limit = float(built.real(CONFIG.rear_actuator.angle_max))
    for start, held in ((math.nan, 0.0), (1.0, 1.0), (-1.0, -1.0), (math.inf, 1.0), (-math.inf, -1.0)):
        assert float(built.software.controller(start).state.rear_angle) == held * limit


def check_start_after_standby(built: Built) -> None:
    """Control after standby starts from where the ramp was."""
    controller = built.software.controller(0.05)
    for _ in range(20):
        standby = controller.step(built.turn(speed=4.0, front_angle=0.0))
    assert standby.status is Status.STANDBY
    assert 0.0 < standby.rear_angle < 0.05
    # One step of the integral, Ki T e = 0.001 rad.
    assert abs(controller.step(built.turn(0.1)).rear_angle - (standby.rear_angle - 0.001)) <= built.eps


def check_no_rate_limit(built: Built) -> None:
    """Without a rate limit the command crosses from limit to limit in one sample."""
    controller = built.software.controller(0.0, built.software.parameters(integral_gain=100.0))
    run(built, controller, [0.5] * 5)
    assert angles(run(built, controller, [-0.5]))[-1] == controller.parameters.rear_angle_max


def check_instances(built: Built) -> None:
    """Two instances, called in turn, give what each gives alone."""
    rng = np.random.default_rng(5)
    drives = [drive(rng, 400, built.lookup, CONFIG.vehicle.wheelbase) for _ in range(2)]
    starts = (0.02, -0.03)
    alone = [built.software.controller(start).run(samples) for start, samples in zip(starts, drives, strict=True)]
    one, other = (built.software.controller(start) for start in starts)
    together = [(one.step(first), other.step(second)) for first, second in zip(*drives, strict=True)]
    assert together == list(zip(*alone, strict=True))
