"""What must hold of the reference that the control law "tracking" follows: trim, road, grip, estimates of the friction.

Each check takes a build of that kind and raises AssertionError where it does not hold.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.emit.controller_view import REFERENCE_OVERSHOOT
from codegen.sil.software import Command, Controller, Measurement
from tests.builds import Built
from tests.sil.checks_tracking import BOTH, FRONT, PERIOD, SPEED, TRACKING, controller_of, feedforward, map_yaw_rate, no_gains


def check_trim(built: Built) -> None:
    """The reference is the model's yaw rate, drawn towards the map's by a trim that is bounded and slow."""
    for side in BOTH:
        controller = controller_of(built)
        target = map_yaw_rate(built, FRONT)
        bound = TRACKING.trim_max_percent / 100.0 * target
        share = PERIOD / TRACKING.trim_time_s
        for count in range(1, 300):
            before = float(controller.state.model.yaw_rate) if count > 1 else side * 0.5 * target
            command = controller.step(Measurement(SPEED, side * FRONT, side * 0.5 * target))
            trim = float(controller.state.trim)
            assert abs(command.yaw_rate_reference - (before + trim)) <= 0.5 * built.eps
            assert abs(trim) <= bound * (1.0 + 4.0 * built.eps)
            if count <= 5:  # the model is still far below: the bounded trim goes its way as a first-order lag
                assert abs(side * trim - bound * (1.0 - (1.0 - share) ** count)) < 10.0 * built.eps * bound
        for share, left in ((0.01, 0.0), (1e-5, None)):
            controller = controller_of(built, trim_share=share, trim_rate=20.0)
            controller.run([Measurement(SPEED, side * FRONT, side * target)] * 400)
            model_off = target - side * float(controller.state.model.yaw_rate)
            command = controller.step(Measurement(SPEED, side * FRONT, side * target))
            wanted = model_off - math.copysign(share * target, model_off) if left is None else left
            assert 1e-5 * target < abs(model_off) < 0.01 * target
            assert abs(target - side * command.yaw_rate_reference - wanted) < 2.0 * built.eps


def check_road_limit(built: Built) -> None:
    """However fast the model turns, the reference is at most a little more than what the road is taken to allow."""
    for side in BOTH:
        for friction in (0.2, 0.5):
            command = controller_of(built).step(Measurement(30.0, side * FRONT, side * 0.6, friction=friction))
            cap = built.total.lateral_acceleration_cap * friction / built.total.friction
            wanted = REFERENCE_OVERSHOOT * cap / 30.0
            # The cap is lowered by four units in the last place (8 u); four roundings.
            assert abs(side * command.yaw_rate_reference - wanted) < 16.0 * built.eps * wanted


def _grips(controller: Controller, measurements: list[Measurement]) -> tuple[npt.NDArray[Any], list[Command]]:
    """The grip before the first and after each sample."""
    grips, commands = [float(controller.state.grip)], []
    for measurement in measurements:
        commands.append(controller.step(measurement))
        grips.append(float(controller.state.grip))
    return np.array(grips), commands


def check_grip(built: Built) -> None:
    """Where much lateral acceleration is missing in the turn that is asked for, the grip goes down by what exceeds it, to what
    was reached lately and to the smallest friction that is believed; else it recovers, sooner where little is asked for, up
    to the map's. ESC or ABS hold it. The map is asked for no more than that."""
    cap = built.total.lateral_acceleration_cap
    for side in BOTH:
        controller = controller_of(built, grip_shortfall=0.5, **no_gains(built))
        p = controller.parameters
        controller.step(Measurement(SPEED, 0.0, 0.0))
        assert abs(controller.state.grip - cap) < 2.0 * built.eps * cap
        turn = Measurement(SPEED, side * FRONT, side * 0.8 * map_yaw_rate(built, FRONT))
        grips, commands = _grips(controller, [turn] * 150)
        references = np.array([command.yaw_rate_reference for command in commands])
        shortfall = side * (references - turn.yaw_rate) * SPEED
        lost = (
            np.where(shortfall > p.grip_shortfall, p.grip_loss_rate * (shortfall - p.grip_shortfall), -p.grip_recovery) * PERIOD
        )
        reached = side * turn.yaw_rate * SPEED
        wanted = np.clip(np.maximum(grips[:-1] - lost, reached), p.friction_min * cap / built.total.friction, cap)
        assert np.abs(grips[1:] - wanted).max() < 8.0 * built.eps * cap
        assert (shortfall > p.grip_shortfall).sum() > 20
        assert grips.min() < 0.9 * cap
        held = float(controller.state.grip)
        controller.run([Measurement(SPEED, side * FRONT, side * 0.05, inhibit=True)] * 20)
        assert controller.state.grip == held
        least = p.friction_min * cap / built.total.friction
        controller.state.grip = 0.5 * cap
        other_way = Measurement(SPEED, side * FRONT, -side * 0.01)
        before = float(controller.state.grip)
        controller.state.reached = 0.0
        controller.step(other_way)
        assert controller.state.grip > before, "a car that comes from another turn does not slip"
        controller.state.grip = least
        more = Measurement(SPEED, side * FRONT, side * (map_yaw_rate(built, FRONT) + 0.2))
        controller.step(more)
        assert controller.state.grip == p_grip_max(built), "what is reached was there"
        controller.state.grip, controller.state.reached = 0.5 * cap, 0.0
        before = float(controller.state.grip)
        controller.run([Measurement(SPEED, 0.0, 0.0)] * 40)  # the reference model comes to rest
        between = float(controller.state.grip)
        controller.step(Measurement(SPEED, 0.0, 0.0))
        rise = (float(controller.state.grip) - between) / PERIOD
        assert between > before
        assert abs(rise - p.grip_recovery_idle) < 2.0 * built.eps * cap / PERIOD, "straight ahead it is forgotten sooner"
        controller.state.reached = 0.0
        slippery = Measurement(30.0, side * 0.06, side * 0.001)
        command = controller.run([slippery] * 400)[-1]
        least = float(controller.state.grip)
        assert abs(least - p.friction_min * cap / built.total.friction) < 8.0 * built.eps * cap
        assert side * command.yaw_rate_reference <= REFERENCE_OVERSHOOT * least / 30.0 * (1.0 + 8.0 * built.eps)
        assert abs(side * command.rear_angle - feedforward_on(built, 30.0, 0.06, p.friction_min)) < 20.0 * built.eps
        assert abs(feedforward_on(built, 30.0, 0.06, p.friction_min) - feedforward(built, 0.06, 30.0)) > 0.01


def p_grip_max(built: Built) -> float:
    """m/s^2, as the C holds it."""
    return float(built.software.real(built.total.lateral_acceleration_cap))


def feedforward_on(built: Built, speed: float, front: float, friction: float) -> float:
    """rad, of the map on a road."""
    return float(built.lookup.reference(speed, front, friction)[1])


def check_estimate(built: Built) -> None:
    """An estimate of the friction below what has been seen is what the map is asked for, and friction_min is its least."""
    speed, front = 30.0, 0.06
    controller = controller_of(built, **no_gains(built))
    controller.step(Measurement(speed, 0.0, 0.0))
    for friction, counts in ((0.5, 0.5), (0.3, 0.3), (0.02, 0.1), (0.0, 0.1), (0.9, 0.9), (1.4, 0.9), (math.nan, math.nan)):
        command = controller.run([Measurement(speed, front, 0.0, friction=friction)] * 3)[-1]
        assert command.rear_angle == feedforward_on(built, speed, front, float(built.software.real(counts))), friction
