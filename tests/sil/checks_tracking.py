"""What must hold of the control law "tracking": feedforward, feedback, starts. For its reference see `checks_reference`.

Each check takes a build of that kind and raises AssertionError where it does not hold.

Errors are reference minus measured yaw rate, rad/s. The checks read what the law asks for with the limits open that they are
not about.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from codegen.sil.software import Controller, Measurement, Status
from tests.builds import TRACKING_CONFIG, Built
from tests.sil.checks_control import RUNNING, angles
from tests.sil.checks_kinds import open_limiter, parameters_of

PERIOD = TRACKING_CONFIG.controller.sampling_time_s
TRACKING = TRACKING_CONFIG.controller.tracking
SPEED = 20.0
"""m/s: inside the map, in the middle of the schedule."""
FRONT = 0.03
BOTH = (1.0, -1.0)
MODEL_CHANGES: dict[str, dict[str, Any]] = {
    "as built": {},
    "no rate limit": {"rear_rate_max": 1000.0, "limiter": {"rear_rate_max": 1000.0}},
    "slow actuator": {"rear_rate_max": 0.05, "rear_angle_error_max": 0.005},
    "high gains": {"proportional_gain": [0.4] * 6, "integral_gain": [20.0] * 6},
    "no authority": {"yaw_increasing_max": 0.0, "lead_time": 0.2},
    "sensitive to grip": {"grip_shortfall": 0.1, "grip_loss_rate": 50.0, "trim_share": 0.2, "trim_rate": 20.0},
    "small angle": {"rear_angle_max": 0.02, "limiter": {"rear_angle_max": 0.02, "opposite_phase_max": [0.02, 0.01]}},
}
HAPPENS = {
    *("start", "free", "lead at its bound", "estimate below what was seen", "the rate limit holds the integral"),
    *("limited while inhibited", "reference at the road's limit", "trim bounded", "below the schedule", "beyond the schedule"),
    *("authority to the left", "authority to the right", "grip lost", "grip held by what was reached", "idle", "grip recovers"),
}


def controller_of(built: Built, start: float = 0.0, **changes: Any) -> Controller:
    """With every limit open but the angle's own, no loss of grip, and some parameters changed."""
    wide = {"rear_rate_max": 1000.0, "grip_shortfall": 20.0, "limiter": open_limiter(built)}
    return built.software.controller(start, parameters_of(built, {**wide, **changes}))


def no_gains(built: Built) -> dict[str, Any]:
    """Feedforward alone, its lead not smoothed."""
    points = len(list(built.software.parameters().schedule_speed))
    return {"proportional_gain": [0.0] * points, "integral_gain": [0.0] * points, "lead_smoothing": 1.0}


def feedforward(built: Built, front: float, speed: float = SPEED) -> float:
    """rad, of the map."""
    return float(built.lookup.reference(speed, front)[1])


def map_yaw_rate(built: Built, front: float, speed: float = SPEED) -> float:
    """rad/s, of the map."""
    return float(built.lookup(speed, front))


def gains_at(speed: float) -> tuple[float, float]:
    """Kp and Ki of the configured schedule."""
    schedule = TRACKING.schedule
    assert schedule is not None
    at = speed * 3.6
    kp, ki = (np.interp(at, schedule.speed_km_h, values) for values in (schedule.proportional_gain_s, schedule.integral_gain))
    return float(kp), float(ki)


def check_feedforward(built: Built) -> None:
    """Without gains, and from straight ahead, the command is the map's own rear angle, to the bit."""
    for side in BOTH:
        for speed in (7.0, SPEED, 33.0):
            controller = controller_of(built, **no_gains(built))
            controller.step(Measurement(speed, 0.0, 0.0))
            commands = controller.run([Measurement(speed, side * FRONT, 0.0)] * 3)
            assert commands[-1].rear_angle == side * feedforward(built, FRONT, speed)
            assert commands[-1].status is Status.TRACKING


def check_lead(built: Built) -> None:
    """The map is looked up where the front wheels will be after the lead time at their present rate, up to a bound."""
    for side in BOTH:
        for rate in (0.1, 0.5, 2.0):
            controller = controller_of(built, **no_gains(built))
            fronts = side * rate * PERIOD * np.arange(7)
            commands = controller.run([Measurement(SPEED, front, 0.0) for front in fronts])
            ahead = min(TRACKING.lead_s * rate, math.radians(TRACKING.lead_max_deg))
            # The rate is a difference of rounded angles over the period: 0.1 eps of angle become 0.4 eps after the lead time.
            wanted = [side * feedforward(built, abs(front) + ahead) for front in fronts[1:]]
            assert np.abs(np.array(angles(commands[1:])) - wanted).max() < 8.0 * built.eps


def check_gain_schedule(built: Built) -> None:
    """-(Kp e + Ki integral of e) with gains that are interpolated over the speed and held beyond both ends of the schedule."""
    error = 0.02
    for side in BOTH:
        for speed in (5.0, 25.0 / 3.6, 9.0, 60.0 / 3.6, 18.1, 27.5, 120.0 / 3.6, 45.0):
            proportional, integral = gains_at(speed)
            controller = controller_of(built)
            controller.step(Measurement(speed, 0.0, 0.0))
            commands = controller.run([Measurement(speed, 0.0, -side * error)] * 4)
            wanted = [-side * (proportional + integral * PERIOD * count) * error for count in (1, 2, 3, 4)]
            assert np.abs(np.array(angles(commands)) - wanted).max() < 10.0 * built.eps * error
            assert {command.status for command in commands} == {Status.TRACKING}


def check_authority(built: Built) -> None:
    """Where it makes the car turn more, feedback adds so much to the map and no more; against the turn all of it is free."""
    more = math.radians(TRACKING.yaw_increasing_max_deg)
    for side in BOTH:
        ahead = side * feedforward(built, FRONT)
        for share in (0.3, 0.7):
            controller = controller_of(built)
            commands = controller.run([Measurement(SPEED, side * FRONT, side * share * map_yaw_rate(built, FRONT))] * 300)
            beyond = -side * (np.array(angles(commands)) - ahead)
            assert beyond.max() <= more + 0.5 * built.eps
            assert abs(beyond[-1] - more) <= 0.5 * built.eps, "all of it is used"
            assert commands[-1].status is Status.LIMITED
        controller = controller_of(built)
        most = controller.parameters.rear_angle_max
        commands = controller.run([Measurement(SPEED, side * FRONT, side * (map_yaw_rate(built, FRONT) + 0.3))] * 300)
        assert commands[-1].rear_angle == side * most, "free against the turn"


def check_tracking_anti_windup(built: Built) -> None:
    """After ten seconds at the authority's limit the command leaves it in one sample, by one step of the law."""
    proportional, integral = gains_at(SPEED)
    for side in BOTH:
        controller = controller_of(built, trim_share=0.0)
        target = map_yaw_rate(built, FRONT)
        turn = Measurement(SPEED, side * FRONT, side * 0.5 * target)
        before = controller.run([turn] * 1000)[-1]
        steady = float(side * before.yaw_rate_reference)
        error_before, error_after = steady - 0.5 * target, -0.02
        (after,) = controller.run([Measurement(SPEED, side * FRONT, side * (steady - error_after))])
        most = proportional * (error_before - error_after) - integral * PERIOD * error_after
        moved = side * (after.rear_angle - before.rear_angle)
        # The integral stopped somewhere between the limit itself and what the proportional part left of it. The measured yaw
        # rate is rounded, and so are the sums at the size of the proportional part.
        least = -(proportional + integral * PERIOD) * error_after
        assert least - 4.0 * built.eps < moved < most + 4.0 * built.eps
        assert after.status is Status.TRACKING


def check_tracking_stuck_actuator(built: Built) -> None:
    """An actuator stuck at one degree: the command runs ahead of it by so much and turns back in one sample."""
    for side in BOTH:
        stuck = side * math.radians(1.0)
        controller = controller_of(built, stuck)
        commands = controller.run([Measurement(SPEED, 0.0, side * 0.3, rear_angle=stuck)] * 500)
        ahead = controller.parameters.rear_angle_error_max
        assert max(abs(angle - stuck) for angle in angles(commands)) <= ahead + 0.1 * built.eps
        assert abs(commands[-1].rear_angle - (stuck + side * ahead)) <= 0.2 * built.eps
        (after,) = controller.run([Measurement(SPEED, 0.0, -side * 0.05, rear_angle=stuck)])
        assert side * (commands[-1].rear_angle - after.rear_angle) > 0.01, "Kp times the change of the error is 0.024 rad"


def check_tracking_rate_limit(built: Built) -> None:
    """The command moves by no more than rate times period; meanwhile the integral does not run ahead: it turns back at once."""
    rate = math.radians(1.0)
    for side in BOTH:
        controller = controller_of(built, rear_rate_max=rate)
        commands = controller.run([Measurement(SPEED, 0.0, 0.0), *([Measurement(SPEED, 0.0, side * 0.1)] * 100)])
        steps = np.diff(angles(commands))
        assert np.abs(steps).max() <= rate * PERIOD + 0.1 * built.eps
        assert (side * steps > 0.999 * rate * PERIOD).sum() > 80, "the limit is used in full"
        assert commands[-1].status is Status.LIMITED
        (after,) = controller.run([Measurement(SPEED, 0.0, side * 0.02)])
        assert side * (after.rear_angle - commands[-1].rear_angle) < 0.0


def check_tracking_inhibit(built: Built) -> None:
    """While ESC or ABS acts the integral stays, at a limit too; the proportional part goes on."""
    proportional, _ = gains_at(SPEED)
    controller = controller_of(built)
    controller.run([Measurement(SPEED, 0.0, 0.0), *([Measurement(SPEED, 0.0, 0.03)] * 10)])
    integral = float(controller.state.integral)
    assert integral > 0.0
    for yaw_rate in (0.1, 0.02, 0.5, 0.3):
        command = controller.step(Measurement(SPEED, 0.0, yaw_rate, inhibit=True))
        assert float(controller.state.integral) == integral
        assert abs(command.rear_angle - (integral + proportional * yaw_rate)) < built.eps
    saturating = controller.step(Measurement(SPEED, 0.0, 0.1, rear_angle=-0.06, inhibit=True))
    assert saturating.status is Status.LIMITED, "two degrees beyond the actuator is as far as it goes"
    assert float(controller.state.integral) == integral
    controller.step(Measurement(SPEED, 0.0, 0.03))
    assert float(controller.state.integral) != integral


def check_tracking_bumpless(built: Built) -> None:
    """The first command after a start is the angle that was held, whatever the front wheels do; so are the next, but for what
    the law adds for the difference between map and model."""
    proportional, integral = gains_at(SPEED)
    for start in (-0.05, -0.01, 0.0, 0.02, 0.06):
        for front in (0.0, FRONT, -0.1):
            controller = controller_of(built, start)
            commands = controller.run([Measurement(SPEED, front, 0.0)])
            # The only error is the trim's first step.
            error = PERIOD / TRACKING.trim_time_s * TRACKING.trim_max_percent / 100.0 * abs(map_yaw_rate(built, front))
            assert commands[0].status in RUNNING
            assert abs(commands[0].rear_angle - start) <= (proportional + integral * PERIOD) * error + 0.5 * built.eps


def check_restart(built: Built) -> None:
    """A gap holds the command, and after it the law begins afresh: from the angle held, the measured yaw rate, without lead."""
    for side in BOTH:
        controller = controller_of(built)
        turn = Measurement(SPEED, side * FRONT, side * map_yaw_rate(built, FRONT))
        held = controller.run([turn] * 50)[-1].rear_angle
        assert controller.state.trim != 0.0
        lost = controller.run([Measurement(SPEED, side * FRONT, math.nan)] * 3)
        assert {(command.status, command.rear_angle) for command in lost} == {(Status.DEGRADED, held)}
        elsewhere = Measurement(SPEED, side * 1.3 * FRONT, side * 0.9 * map_yaw_rate(built, FRONT))
        commands = controller.run([elsewhere] * 4)
        jumps = np.abs(np.diff([held, *angles(commands)]))
        # As bumpless as at first; then the model runs away from the measured yaw rate, by less than 0.05 rad/s in a sample.
        assert jumps[0] < 1e-4
        assert jumps.max() < 0.1 * 0.05 * 2.0
        assert abs(float(commands[0].yaw_rate_reference) - elsewhere.yaw_rate) < 1e-4 + 0.0002 * abs(elsewhere.yaw_rate)
        controller.run([Measurement(math.nan, 0.0, 0.0)] * 4)
        assert controller.step(elsewhere).status is Status.FAIL_SAFE


def check_limiter_is_told(built: Built) -> None:
    """What the limiter takes away from a law that is inside its own limits shows in the status, and in the command."""
    for side in BOTH:
        limiter = {"rear_rate_max": 1000.0, "opposite_phase_max": [0.004, 0.004]}
        controller = controller_of(built, limiter=limiter, **no_gains(built))
        controller.step(Measurement(10.0, 0.0, 0.0))
        commands = controller.run([Measurement(10.0, side * FRONT, 0.0)] * 3)
        assert feedforward(built, FRONT, 10.0) < -0.01
        assert abs(commands[-1].rear_angle + side * 0.004) < built.eps
        assert commands[-1].status is Status.LIMITED
        assert float(controller.state.rear_angle) == commands[-1].rear_angle, "the next step goes on from there"
