"""What must hold at the edges of the control laws.

Each check takes a build and raises AssertionError where it does not hold; those named for tracking take one of that kind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.sil.software import Controller, Measurement, Status
from tests.builds import Built
from tests.sil.answers import Drive, answers_of
from tests.sil.checks_kinds import config_of, open_limiter, parameters_of

SPEED = 20.0
BOTH = (1.0, -1.0)


def rough(built: Built, seed: int, count: int = 3000) -> list[Measurement]:
    """Nothing is smooth: speeds at the breakpoints and beyond them, straight ahead to the bit, yaw rates of either sign and
    none, errors that turn from sample to sample, an actuator anywhere; all of it plausible."""
    rng, config = np.random.default_rng(seed), config_of(built)
    schedule = config.controller.tracking.schedule
    points = [speed / 3.6 for speed in (schedule.speed_km_h if schedule else (20.0, 60.0, 120.0))]
    speeds = np.array([*points, *points, 5.0, 9.0, 17.0, 28.0, 60.0, 95.0, 105.0, 111.0, 111.111115])

    def spells(values: Any, longest: int) -> Any:
        lengths = rng.integers(1, longest + 1, count)
        return np.repeat(values, lengths)[:count]

    speed = spells(rng.choice(speeds[speeds > 4.2], count), 25)
    # Turns of any size: up to a wheel angle that no fast car takes, and up to what the road bears.
    wide = rng.choice([0.0, 1.0, -1.0, 0.3, -0.1], count) * rng.uniform(0.0, 0.12, count)
    front = spells(np.where(rng.random(count) < 0.5, wide, wide * 40.0 / speed**2), 12)
    turn = built.lookup(speed.astype(built.real), front.astype(built.real), math.nan).astype(np.float64)
    share = spells(rng.choice([0.0, 1.0, 0.9, 0.5, -0.3, 1.3], count), 6)
    yaw_rate = turn * share + spells(rng.choice([0.0, 0.0, 0.05, -0.05, 0.3, -0.3], count), 4)
    rear = np.where(spells(rng.random(count) < 0.4, 20), spells(rng.uniform(-0.07, 0.07, count), 8), math.nan)
    friction = spells(rng.choice([math.nan] * 6 + [0.9, 0.5, 0.1, 0.05, 0.0], count), 40)
    inhibit = spells(rng.random(count) < 0.15, 5)
    columns = [np.asarray(column, dtype=np.float64).tolist() for column in (speed, front, yaw_rate, rear, friction)]
    samples = [Measurement(*row) for row in zip(*columns, strict=True)]
    return [replace(sample, inhibit=bool(held)) for sample, held in zip(samples, inhibit, strict=True)]


def rough_changes(built: Built) -> dict[str, dict[str, Any]]:
    """Parameters that leave the law to itself, and others that hem it in."""
    free = {"rear_rate_max": 1000.0, "limiter": open_limiter(built), "yaw_rate_tolerance": 20.0}
    if config_of(built).controller.kind != "tracking":
        return {
            "free": free,
            "strong": {**free, "proportional_gain": 0.3, "integral_gain": 20.0},
            "slow": {"rear_rate_max": 0.1, "rear_angle_error_max": 1.0},
            # The distance to the actuator and the rate now and then give back just what was wanted: limited all the same.
            "slow, and measured": {"rear_rate_max": 0.1, "rear_angle_error_max": 0.097},
        }
    points = len(list(built.software.parameters().schedule_speed))
    rng = np.random.default_rng(8)
    odd = {
        "proportional_gain": rng.uniform(0.0, 0.3, points).tolist(),
        "integral_gain": rng.uniform(0.0, 30.0, points).tolist(),
    }
    return {
        "free": free,
        "odd gains": {**free, **odd},
        "beyond the schedule": {**free, **odd, "speed_max": 200.0, "schedule_speed": [1.0 + 5.0 * k for k in range(points)]},
        "no authority": {**free, **odd, "yaw_increasing_max": 0.0},
        "wide authority": {**free, **odd, "yaw_increasing_max": 0.04, "rear_angle_error_max": 0.01},
        "sensitive": {
            **free,
            **odd,
            "grip_shortfall": 0.1,
            "grip_loss_rate": 50.0,
            "grip_forgetting": 20.0,
            "friction_min": 0.01,
        },
        "slow": {**odd, "rear_rate_max": 0.1, "limiter": {"rear_rate_max": 0.08}},
        "tight": {**free, **odd, "rear_angle_error_max": 0.002, "trim_share": 0.2, "trim_rate": 20.0},
    }


def answers_of_rough(built: Built, count: int = 3000) -> Iterator[Drive]:
    """The independent model's answers to rough drives, each when it is asked for: one takes seconds."""
    for seed, one in enumerate(rough_changes(built).values()):
        yield answers_of(built, one, rough(built, seed, count))


def _running(built: Built, **changes: Any) -> Controller:
    """A controller with its limits open, that has taken a sample straight ahead."""
    wide = {"rear_rate_max": 1000.0, "limiter": open_limiter(built)}
    controller = built.software.controller(0.0, parameters_of(built, {**wide, **changes}))
    controller.step(Measurement(SPEED, 0.0, 0.0))
    return controller


def check_tracking_state_after_init(built: Built) -> None:
    """At rest, at the given angle; nothing is known of the road but the map."""
    state = built.software.controller(0.02).state
    held = float(built.real(0.02))
    for name in ("trim", "integral", "front_angle", "front_rate", "yaw_rate", "reached"):
        assert getattr(state, name) == 0.0, name
    assert (state.model.yaw_rate, state.model.rear_angle) == (0.0, held)
    assert abs(state.model.sideslip_angle - held) <= built.eps * held, "the rear wheels' own direction"
    assert abs(state.grip - built.total.lateral_acceleration_cap) <= 2.0 * built.eps * state.grip


def check_tracking_start_forgets_what_was_reached(built: Built) -> None:
    """After a standby nothing of what was reached counts."""
    for before in (3.0, 0.0):
        controller = built.software.controller(0.0)
        controller.state.reached = before
        controller.step(Measurement(SPEED, 0.0, 0.0))
        assert controller.state.reached == 0.0


def check_tracking_reached(built: Built) -> None:
    """What is reached is the lateral acceleration of the turn, however small, to either side."""
    for side in BOTH:
        for reached in (0.3, 0.9, 3.0):
            controller = _running(built)
            controller.step(Measurement(SPEED, 0.0, side * reached / SPEED))
            assert abs(controller.state.reached - reached) < 4.0 * built.eps * reached


def _grip_after(built: Built, measurement: Measurement, grip: float, **changes: Any) -> tuple[float, float]:
    """The grip after one sample of a turn, from a given one, and the reference yaw rate of that sample."""
    controller = _running(built, **changes)
    controller.run([measurement] * 60)  # until the model of the car turns too
    controller.state.grip = grip
    reference = abs(float(controller.step(measurement).yaw_rate_reference))
    return float(controller.state.grip), reference


def check_tracking_grip_of_a_small_turn(built: Built) -> None:
    """A turn that asks for less than half of the grip is an idle one; one that asks for just half is not."""
    real, period = built.real, config_of(built).controller.sampling_time_s
    p = built.software.parameters()
    for side in BOTH:
        turn = Measurement(SPEED, side * 0.02, side * 0.2)
        half, found = 0.0, 2.0
        while half != found:  # what is asked for depends on the grip, a little
            half = found
            found = float(real(2.0) * (real(_grip_after(built, turn, half)[1]) * real(SPEED)))
        for grip, rate in ((half, p.grip_recovery), (built.next(half, 9.0), p.grip_recovery_idle)):
            rise = _grip_after(built, turn, grip)[0] - grip
            assert abs(rise - rate * period) < 4.0 * built.eps * grip, (side, grip)


def check_tracking_shortfall_that_is_allowed(built: Built) -> None:
    """A shortfall that is just allowed is no loss of grip, one unit in the last place more is."""
    real, grip, measured = built.real, 4.0, 0.1
    for side in BOTH:
        short = Measurement(SPEED, side * 0.05, side * measured)
        allowed, missing = 0.0, 1.0
        while allowed != missing:  # the allowance plays a part in what was asked for before
            allowed = missing
            reference = _grip_after(built, short, grip, grip_shortfall=allowed)[1]
            missing = float(real(reference) * real(SPEED) - real(measured) * real(SPEED))
        assert 0.1 < missing < 5.0
        assert _grip_after(built, short, grip, grip_shortfall=allowed)[0] > grip
        assert _grip_after(built, short, grip, grip_shortfall=built.next(allowed, 0.0))[0] <= grip


def check_tracking_at_the_end_of_its_range(built: Built) -> None:
    """A demand that is just at the end of its range is not limited, one unit in the last place beyond is."""
    rest = built.software.controller(0.0).state
    for side in BOTH:
        controller = _running(built)
        most = controller.parameters.rear_angle_max
        for integral, status in ((most, Status.TRACKING), (built.next(most, 1.0), Status.LIMITED)):
            controller.state.integral = side * integral
            controller.state.rear_angle = controller.state.limiter.rear_angle = side * most
            controller.state.model = rest.model
            command = controller.step(Measurement(SPEED, 0.0, 0.0, inhibit=True))
            assert (command.yaw_rate_reference, command.rear_angle) == (0.0, side * most)
            assert command.status is status, (side, integral)


OF_TRACKING = (
    check_tracking_state_after_init,
    check_tracking_start_forgets_what_was_reached,
    check_tracking_reached,
    check_tracking_grip_of_a_small_turn,
    check_tracking_shortfall_that_is_allowed,
    check_tracking_at_the_end_of_its_range,
)
