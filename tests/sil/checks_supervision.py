"""Checks of inputs, standby and fail-safe. Each takes a build and raises AssertionError if the build fails it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.sil.software import Controller, Measurement, Status
from tests.builds import CONFIG, FRONT_ANGLE, SPEED, Built
from tests.sil.checks_control import PERIOD, RUNNING, angles

FAIL_SAFE = CONFIG.controller.fail_safe
HOLD_SPEED = FAIL_SAFE.hold_above_km_h / 3.6
ENABLE_SPEED, DISABLE_SPEED = CONFIG.controller.enable_speed_km_h / 3.6, CONFIG.controller.disable_speed_km_h / 3.6
LOST = Measurement(math.nan, math.nan, math.nan)
"""Nothing arrives, not even the speed."""

NEEDED = {"speed": "speed_max", "front_angle": "front_angle_max", "yaw_rate": "yaw_rate_max"}
OPTIONAL = {"rear_angle": "rear_angle_input_max", "friction": "friction_max"}


def lost_at(speed: float) -> Measurement:
    """The yaw rate is lost; the speed still arrives."""
    return Measurement(speed, 0.0, math.nan)


def in_fail_safe(built: Built, start: float, speed: float, parameters: Any | None = None) -> Controller:
    """A controller that has just entered the fail-safe at a speed (m/s), its command still near `start` (rad)."""
    controller = built.software.controller(start, parameters)
    gap = controller.parameters.degraded_samples_max
    assert controller.step(built.turn(0.0, speed=speed)).status in (*RUNNING, Status.STANDBY)
    assert all(command.status is Status.DEGRADED for command in controller.run([lost_at(speed)] * gap))
    return controller


def check_inputs(built: Built) -> None:
    """Each field is taken up to its limit and refused one unit in the last place beyond, on either side; NaN where a value is
    needed and infinity everywhere are refused; NaN where none is needed is not."""
    # Without a check of plausibility, which would see a yaw rate at its limit first.
    parameters = built.software.parameters(yaw_rate_tolerance=20.0)
    good = built.turn(0.01, rear_angle=0.01, friction=0.8)

    def taken(**change: Any) -> bool:
        controller = built.software.controller(0.02, parameters)
        controller.step(good)
        held = float(controller.state.rear_angle)
        command = controller.step(replace(good, **change))
        if command.status is Status.DEGRADED:
            assert command.rear_angle == held
            return False
        return True

    for field, limit_name in (NEEDED | OPTIONAL).items():
        limit = float(getattr(parameters, limit_name))
        low = 0.0 if field == "friction" else -limit
        assert taken(**{field: limit}), field
        assert taken(**{field: low}), field
        assert not taken(**{field: built.next(limit, math.inf)}), field
        assert not taken(**{field: built.next(low, -math.inf)}), field
        assert not taken(**{field: math.inf}), field
        assert not taken(**{field: -math.inf}), field
        assert taken(**{field: math.nan}) == (field in OPTIONAL), field


def check_plausibility_limit(built: Built) -> None:
    """A yaw rate is explained by speed and steering between none and the kinematic turn, give or take what the rear wheels
    can add and the tolerance; forward and in reverse, on both sides."""
    parameters = built.software.parameters(implausible_samples_max=1)
    wheelbase, tolerance = CONFIG.vehicle.wheelbase, math.radians(CONFIG.controller.inputs.yaw_rate_tolerance_deg_s)
    for speed in (SPEED, -SPEED, 1.0, 0.0):
        for front in (FRONT_ANGLE, -FRONT_ANGLE, 0.0):
            turn = speed * front / wheelbase
            margin = abs(speed) * CONFIG.rear_actuator.angle_max / wheelbase + tolerance
            for limit in (max(turn, 0.0) + margin, min(turn, 0.0) - margin):
                for share, believed in ((1.0 - 1e-5, True), (1.0 + 1e-5, False)):
                    command = built.software.controller(0.0, parameters).step(Measurement(speed, front, limit * share))
                    assert (command.status is not Status.DEGRADED) == believed, (speed, front, limit)


def check_plausibility_time(built: Built) -> None:
    """An implausible yaw rate is never controlled upon: the command is held for the set time, and then comes the fail-safe."""
    held = round(CONFIG.controller.inputs.implausible_time_s / PERIOD)
    strange, good = Measurement(SPEED, 0.0, 1.5), built.turn(0.0)
    controller = built.software.controller()
    for _ in range(3):
        last = controller.step(good)
        assert last.status in RUNNING
        assert controller.run([strange] * held) == [replace(last, status=Status.DEGRADED)] * held
    assert controller.step(good).status in RUNNING
    statuses = [command.status for command in controller.run([strange] * (held + 3))]
    assert statuses == [Status.DEGRADED] * held + [Status.FAIL_SAFE] * 3
    assert controller.step(strange).status is Status.FAIL_SAFE, "it does not recover by itself"
    # Samples that are lost in between do not start the time anew, and neither do implausible ones end a gap unseen.
    controller = built.software.controller()
    controller.run([good] * 3)
    mixed = [strange, strange, LOST] * held
    assert Status.FAIL_SAFE in [command.status for command in controller.run(mixed)]


def check_limiter_in_a_gap(built: Built) -> None:
    """What is held is limited by the speed that still arrives; it is a gap all the same, not a limit."""
    controller = built.software.controller(0.03)
    limiter = controller.parameters.limiter
    points = len(list(limiter.opposite_phase_max))
    limiter.rear_rate_max = 1000.0
    limiter.opposite_phase_max = [float(limiter.rear_angle_max)] + [0.01] * (points - 1)
    limiter.opposite_phase_speed = [SPEED + 5.0 * k for k in range(points)]
    assert built.software.function("parameters_valid")(controller.parameters)
    before = controller.step(built.turn(0.0, speed=SPEED))
    assert before.rear_angle > 0.011
    (held,) = controller.run([Measurement(SPEED + 5.0, -FRONT_ANGLE, math.nan)])
    assert held.status is Status.DEGRADED
    assert abs(held.rear_angle - 0.01) <= built.eps * 0.01, "in opposite phase to the front wheels, and limited"


def check_gap(built: Built, speed: float = SPEED) -> None:
    """A gap holds the last command and reference to the bit, for so many samples; one more is the fail-safe. Where the gap ends
    in time, control goes on from the angle held."""
    for gap in (0, 1, FAIL_SAFE.degraded_samples_max, 20):
        for lost in (LOST, lost_at(speed)):
            controller = built.software.controller(0.03, built.software.parameters(degraded_samples_max=gap))
            last = controller.run([built.turn(0.05, speed=speed)] * 5)[-1]
            held = controller.run([lost] * gap)
            assert held == [replace(last, status=Status.DEGRADED)] * gap
            on = built.software.controller(0.0, controller.parameters)
            built.software.ffi.memmove(on.state, controller.state, built.software.ffi.sizeof(on.state[0]))
            back = on.step(built.turn(0.1, speed=speed))
            assert back.status in RUNNING
            # One step of the integral, 0.001 rad; without a gap the change of the proportional part, 0.0005 rad, comes on top.
            assert abs(back.rear_angle - (last.rear_angle - 0.001)) < (built.eps if gap else 0.0005 + built.eps)
            assert controller.step(lost).status is Status.FAIL_SAFE


def check_signalling_nan(built: Built) -> None:
    """A signalling NaN is rejected like any other; a Python float cannot carry one."""
    software, bits = built.software, {4: 0x7F800001, 8: (0x7FF0 << 48) + 1}
    for field in NEEDED:
        controller, sample = software.controller(), software.new("measurement")
        sample[0] = (15.0, 0.0, 0.0, math.nan, math.nan, False)
        offset, size = software.ffi.offsetof(software.ffi.typeof(sample).item, field), np.dtype(software.real).itemsize
        software.ffi.memmove(software.ffi.cast("char *", sample) + offset, bits[size].to_bytes(size, "little"), size)
        command = software.function("controller_step")(controller.state, controller.parameters, sample)
        assert command.status == Status.DEGRADED, field


def check_gap_from_the_first_sample(built: Built) -> None:
    """With no speed ever seen the car may be fast, as after a reset in a corner: the fail-safe holds the angle."""
    commands = built.software.controller(0.05).run([LOST] * 20)
    gap = built.software.parameters().degraded_samples_max
    assert [command.status for command in commands] == [Status.DEGRADED] * gap + [Status.FAIL_SAFE] * (20 - gap)
    assert {command.rear_angle for command in commands} == {float(built.software.real(0.05))}


def check_gap_in_standby(built: Built) -> None:
    """A gap in standby holds the angle too, and standby goes on."""
    controller, standing = built.software.controller(0.05), Measurement(0.0, 0.0, 0.0)
    before = controller.run([standing] * 3)[-1]
    held = controller.run([lost_at(0.0)] * 2)
    after = controller.step(standing)
    assert [command.rear_angle for command in held] == [before.rear_angle] * 2
    assert after.status is Status.STANDBY
    assert 0.0 < after.rear_angle < before.rear_angle


def check_fail_safe_hold(built: Built) -> None:
    """At and above the hold speed the rear angle stays where it is, to the bit and for good."""
    at_limit = built.software.parameters().hold_speed
    for speed in (float(at_limit), 20.0, 33.0):
        for start in (0.03, -0.03):
            controller = in_fail_safe(built, start, speed)
            held = float(controller.state.rear_angle)
            assert abs(held - start) < 0.001
            for lost in (lost_at(speed), LOST):
                commands = controller.run([lost] * 500)
                assert {(command.rear_angle, command.status) for command in commands} == {(held, Status.FAIL_SAFE)}


def check_fail_safe_at_the_hold_speed(built: Built) -> None:
    """Held from that very speed on, whatever the kind; below it, ramped."""
    for below in (False, True):
        controller = built.software.controller(0.001)
        hold_speed = float(controller.parameters.hold_speed)
        speed = built.next(hold_speed, 0.0) if below else hold_speed
        controller.step(Measurement(speed, 0.0, 0.0))
        found = controller.run([lost_at(speed)] * (controller.parameters.degraded_samples_max + 4))[-4:]
        assert {command.status for command in found} == {Status.FAIL_SAFE}
        angles_found = [command.rear_angle for command in found]
        assert angles_found[0] != 0.0
        assert (angles_found[-1] != angles_found[0]) == below


def check_start_at_no_angle(built: Built) -> None:
    """An angle that is not a number counts as zero."""
    state = built.software.controller(math.nan).state
    assert state.rear_angle == 0.0
    assert state.limiter.rear_angle == 0.0


def check_fail_safe_ramp(built: Built) -> None:
    """Below the hold speed the angle goes to zero at a rate between the two set ones, by speed; never faster, never past zero.
    Where the speed is lost, too, the last one counts."""
    at_rest, at_hold = (math.radians(rate) for rate in (FAIL_SAFE.rate_at_standstill_deg_s, FAIL_SAFE.rate_at_hold_speed_deg_s))
    for speed in (0.999 * HOLD_SPEED, 12.0, 5.0, 1.0, 0.0, -3.0):
        for sign in (1.0, -1.0):
            rate = at_rest + abs(speed) / HOLD_SPEED * (at_hold - at_rest)
            for lost in (lost_at(speed), LOST):
                controller = in_fail_safe(built, 0.05 * sign, speed)
                held = float(controller.state.rear_angle)
                commands = controller.run([lost] * (round(0.06 / (rate * PERIOD)) + 5))
                path = sign * np.array([held, *angles(commands)])
                steps = -np.diff(path)
                assert (path >= 0.0).all()
                assert path[-1] == 0.0
                moving = steps[path[1:] > 0.0]
                assert moving.size > 50
                # Each command is rounded at 0.05 rad: an eighth of a unit in the last place at 1.
                assert np.abs(moving - rate * PERIOD).max() < 0.2 * built.eps, speed
                assert steps.max() < rate * PERIOD + 0.2 * built.eps
                assert {command.status for command in commands} == {Status.FAIL_SAFE}
                assert {command.yaw_rate_reference for command in commands} == {0.0}


def check_last_speed(built: Built) -> None:
    """The fail-safe goes by the last speed that was in range: it follows a speed that still arrives, and nothing else."""
    controller = in_fail_safe(built, 0.05, 30.0)
    controller.run([lost_at(30.0)] * 10)
    held = float(controller.state.rear_angle)
    for nonsense in (math.nan, math.inf, -math.inf, 500.0, -500.0):
        assert set(angles(controller.run([lost_at(nonsense)] * 20))) == {held}
    slowing = angles(controller.run([lost_at(speed) for speed in np.linspace(16.0, 0.0, 100)]))
    steps = -np.diff([held, *slowing])
    assert (steps > 0.0).all()
    assert (np.diff(steps) > -0.5 * built.eps).all(), "the slower the car the faster the ramp"
    controller = in_fail_safe(built, 0.05, 5.0)
    for nonsense in (math.nan, math.inf, -math.inf, 500.0, -500.0):
        ramp = -np.diff([float(controller.state.rear_angle), *angles(controller.run([lost_at(nonsense)] * 5))])
        assert (ramp > 0.0).all(), "at 5 m/s the ramp goes on"


def check_recovery(built: Built) -> None:
    """So many good samples in a row end the fail-safe, and control starts from the angle held."""
    needed = FAIL_SAFE.recovery_samples
    for speed in (SPEED, 25.0):
        controller = in_fail_safe(built, 0.03, speed)
        controller.run([lost_at(speed)] * 20)
        good = built.turn(0.1, speed=speed)
        assert {command.status for command in controller.run([good] * (needed - 1))} == {Status.FAIL_SAFE}
        assert controller.step(lost_at(speed)).status is Status.FAIL_SAFE
        waiting = controller.run([good] * (needed - 1))
        assert {command.status for command in waiting} == {Status.FAIL_SAFE}, "a bad sample starts the count again"
        first = controller.step(good)
        assert first.status in RUNNING
        assert first.yaw_rate_reference == built.reference(speed)
        # One step of the integral, Ki T e = 0.001 rad; sums round at 0.03 rad.
        assert abs(first.rear_angle - (waiting[-1].rear_angle - 0.001)) < 0.5 * built.eps
    slow = in_fail_safe(built, 0.05, 0.5 * (ENABLE_SPEED + DISABLE_SPEED))
    slow.run([LOST] * 5)
    good = built.turn(0.0, speed=0.5 * (ENABLE_SPEED + DISABLE_SPEED))
    assert slow.run([good] * (needed + 5))[-1].status is Status.STANDBY


def check_standby(built: Built) -> None:
    """Control starts at the enabling speed and ends below the disabling one; between, and only there, it stays what it was.
    Reverse is standby. In standby the angle goes to zero at its rate."""
    parameters = built.software.parameters()
    enable, disable = float(parameters.enable_speed), float(parameters.disable_speed)
    between = 0.5 * (enable + disable)
    drive = [
        *((0.0, False), (between, False), (built.next(enable, 0.0), False), (enable, True), (SPEED, True)),
        *((between, True), (disable, True), (built.next(disable, 0.0), False), (between, False), (enable, True)),
        *((0.0, False), (-0.0, False), (-1.0, False), (-SPEED, False), (-60.0, False), (between, False), (SPEED, True)),
    ]
    controller = built.software.controller()
    for speed, controlled in drive:
        command = controller.step(Measurement(speed, 0.0, 0.0))
        assert (command.status in RUNNING) == controlled, speed
        assert controlled or command.status is Status.STANDBY
    rate = math.radians(CONFIG.controller.standby_rate_deg_s)
    for speed in (disable - 0.1, 0.0, -SPEED):
        for sign in (1.0, -1.0):
            controller = built.software.controller(0.05 * sign)
            commands = controller.run([Measurement(speed, 0.1, 0.0)] * 80)
            path = np.array([0.05, *(sign * angle for angle in angles(commands))])
            steps = -np.diff(path)
            assert (path >= 0.0).all()
            assert path[-1] == 0.0
            # The start and each command are rounded at 0.05 rad: an eighth of a unit in the last place at 1.
            moving = steps[path[1:] > 0.0]
            assert moving.size > 50
            assert np.abs(moving - rate * PERIOD).max() < 0.3 * built.eps
            assert {(command.status, command.yaw_rate_reference) for command in commands} == {(Status.STANDBY, 0.0)}


def random_measurements(built: Built, rng: np.random.Generator, count: int) -> Any:
    """A C array of measurements, each field at random plausible, at a limit, special, or any bit pattern."""
    software = built.software
    samples = software.ffi.new(f"{software.prefix}_measurement_t[]", count)
    real: Any = software.real
    size = np.dtype(real).itemsize
    stride = software.ffi.sizeof(samples) // count
    layout = np.dtype(
        {
            "names": ["bits", "inhibit"],
            "formats": [(f"u{size}", 5), np.uint8],
            "offsets": [0, 5 * size],
            "itemsize": stride,
        }
    )
    view: npt.NDArray[Any] = np.frombuffer(software.ffi.buffer(samples), dtype=layout)
    parameters = software.parameters()
    limits = np.array([getattr(parameters, limit) for limit in (NEEDED | OPTIONAL).values()])
    special = np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 1e-40, 1e30, -1e30])
    kinds = [
        rng.uniform(-0.5, 0.5, (count, 5)) * limits,
        np.abs(rng.normal(0.0, 0.15, (count, 5))) * limits,
        rng.choice([-1.0, 1.0], (count, 5)) * limits,
        rng.choice(special, (count, 5)),
        np.frombuffer(rng.bytes(count * 5 * size), dtype=real).reshape(count, 5),
    ]
    weights = np.repeat(rng.choice([0, 1, 2], count // 50 + 1, p=[0.3, 0.4, 0.3]), 50)[:count]  # calm, rough and wild spells
    chances = np.array([[0.0, 1.0, 0.0, 0.0, 0.0], [0.1, 0.88, 0.005, 0.01, 0.005], [0.2, 0.2, 0.2, 0.2, 0.2]])
    pick = (rng.random((count, 5, 1)) > np.cumsum(chances, axis=1)[weights][:, np.newaxis, :]).sum(axis=2).clip(0, 4)
    view["bits"] = np.choose(pick, [kind.astype(real).view(f"u{size}") for kind in kinds])  # a copied NaN may turn quiet
    view["inhibit"] = rng.random(count) < 0.1
    return samples


def check_always_bounded(built: Built, count: int = 100_000, seed: int = 0) -> None:
    """Whatever arrives, the command is finite and within its limit, and so is everything that the state keeps."""
    software, ffi = built.software, built.software.ffi
    rng = np.random.default_rng(seed)
    largest_reference = float(built.total.yaw_rate.max()) * 1.000001
    seen: set[int] = set()
    block = 50
    for changes in ({}, {"rear_rate_max": 0.4, "rear_angle_error_max": 0.01, "proportional_gain": 1.0}):
        controller = software.controller(0.02, software.parameters(**changes))
        p, state = controller.parameters, controller.state
        error_max = largest_reference + p.yaw_rate_max
        integral_max = (p.rear_angle_max + p.proportional_gain * error_max) * 1.000001
        samples = random_measurements(built, rng, count // 2)
        commands = ffi.new(f"{software.prefix}_command_t[]", block)
        for first in range(0, count // 2, block):
            software.compiled.lib.loop_controller(state, p, samples + first, commands, block)
            for command in commands:
                assert -p.rear_angle_max <= command.rear_angle <= p.rear_angle_max
                assert abs(command.yaw_rate_reference) <= largest_reference
                seen.add(command.status)
            assert abs(state.integral) <= integral_max
            assert abs(state.speed) <= p.speed_max
            assert state.implausible_samples <= p.implausible_samples_max + 1
            assert state.good_samples < p.recovery_samples
            assert (state.rear_angle, state.yaw_rate_reference) == (command.rear_angle, command.yaw_rate_reference)
    assert seen == {status.value for status in Status}
