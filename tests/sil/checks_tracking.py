"""Checks of the control law "tracking" at exact thresholds that drives seldom reach.

`suite` compares each sample of drives with the second implementation. Each check takes a build of that kind and raises
AssertionError if the build fails it. Errors are reference minus measured yaw rate, rad/s. Limits that a check does not test are
open.
"""

import math
from typing import Any

from codegen.sil.software import Controller, Measurement, Status
from tests.builds import TRACKING_CONFIG, Built
from tests.sil.checks_kinds import OPEN, config_of, open_limiter, parameters_of

PERIOD = TRACKING_CONFIG.controller.sampling_time_s
SPEED = 20.0
"""m/s: inside the map, in the middle of the gain schedule."""
BOTH = (1.0, -1.0)
MODEL_CHANGES: dict[str, dict[str, Any]] = {
    "as built": {},
    "no rate limit": {"rear_rate_max": 1000.0, "limiter": {"rear_rate_max": 1000.0}},
    "slow actuator": {"rear_rate_max": 0.05, "rear_angle_error_max": 0.005},
    "high gains": {"proportional_gain": [0.4] * 6, "integral_gain": [20.0] * 6},
    "no authority": {"yaw_increasing_max": 0.0, "lead_smoothing": 1.0, "inputs": OPEN},
    "sensitive to grip": {"grip_shortfall": 0.1, "grip_loss_rate": 50.0, "trim_share": 0.2, "trim_rate": 20.0},
    "small angle": {
        **{"rear_angle_max": 0.02, "limiter": {"rear_angle_max": 0.02, "opposite_phase_max": [0.02, 0.01]}},
        "inputs": OPEN,
    },
}


def _running(built: Built, **changes: Any) -> Controller:
    """Return a controller limited only by the largest angle, after one sample straight ahead; grip may be lost."""
    wide = {"rear_rate_max": 1000.0, "limiter": open_limiter(built), "inputs": OPEN}
    controller = built.software.controller(0.0, parameters_of(built, {**wide, **changes}))
    controller.step(Measurement(SPEED, 0.0, 0.0))
    return controller


def check_tracking_state_after_init(built: Built) -> None:
    """Check the initial state: at rest, at the given angle, with the map's grip."""
    state = built.software.controller(0.02).state
    held = float(built.real(0.02))
    for name in ("trim", "integral", "front_angle", "front_rate", "missed_samples", "yaw_rate", "previous_model_yaw_rate"):
        assert getattr(state.law, name) == 0.0, name
    model = state.law.model
    assert (model.yaw_rate, model.rear_angle, model.lateral_acceleration) == (0.0, held, 0.0)
    assert state.grip.reached == 0.0
    assert abs(model.sideslip_angle - held) <= built.eps * held, "the direction of the rear wheels"
    assert abs(state.grip.available - built.total.lateral_acceleration_cap) <= 2.0 * built.eps * state.grip.available


def check_tracking_memory_of_the_road(built: Built) -> None:
    """Check that the grip estimate survives the fail-safe and a restart of control, and recovers in standby."""
    controller = built.software.controller(0.0, parameters_of(built, {"inputs": OPEN}))
    p, period = controller.parameters, config_of(built).controller.sampling_time_s
    good, lost = Measurement(SPEED, 0.0, 0.0), Measurement(math.nan, math.nan, math.nan)
    controller.step(good)
    grip = controller.state.grip
    grip.available = grip.reached = 2.0
    controller.run([lost] * (p.inputs.missing_samples_max + 3) + [good] * (p.inputs.recovery_samples - 1))
    assert (controller.state.status, grip.available, grip.reached) == (Status.FAIL_SAFE, 2.0, 2.0)
    assert controller.step(good).status in (Status.TRACKING, Status.LIMITED)
    assert grip.available < 2.1, "one sample of recovery"
    grip.available = grip.reached = 2.0
    assert controller.step(Measurement(0.0, 0.0, 0.0)).status is Status.STANDBY
    # Both are rounded twice, near 2.
    assert abs(grip.available - (2.0 + p.grip_recovery_idle * period)) <= 2.0 * built.eps * 2.0
    assert abs(grip.reached - 2.0 * (1.0 - p.grip_forgetting * period)) <= 2.0 * built.eps * 2.0
    controller.run([Measurement(0.0, 0.0, 0.0)] * round(20.0 / float(p.grip_recovery_idle) / period))
    assert abs(grip.available - built.total.lateral_acceleration_cap) <= 2.0 * built.eps * grip.available


def _grip_after(built: Built, measurement: Measurement, grip: float, **changes: Any) -> tuple[float, float]:
    """Return the grip after one sample of a turn that starts with `grip`, and the reference yaw rate of that sample."""
    controller = _running(built, **changes)
    controller.run([measurement] * 60)  # until the reference model turns too
    controller.state.grip.available = grip
    reference = abs(float(controller.step(measurement).yaw_rate_reference))
    return float(controller.state.grip.available), reference


def check_tracking_grip_of_a_small_turn(built: Built) -> None:
    """Check that a turn below half of the grip counts as idle, and one at exactly half does not."""
    real, period = built.real, config_of(built).controller.sampling_time_s
    p = built.software.parameters()
    for side in BOTH:
        turn = Measurement(SPEED, side * 0.02, side * 0.2)
        half, found = 0.0, 2.0
        while half != found:  # the demand depends slightly on the grip
            half = found
            found = float(real(2.0) * (real(_grip_after(built, turn, half)[1]) * real(SPEED)))
        for grip, rate in ((half, p.grip_recovery), (built.next(half, 9.0), p.grip_recovery_idle)):
            rise = _grip_after(built, turn, grip)[0] - grip
            assert abs(rise - rate * period) < 4.0 * built.eps * grip, (side, grip)


def check_tracking_shortfall_that_is_allowed(built: Built) -> None:
    """Check that a shortfall equal to the allowance is no loss of grip, and one unit in the last place more is."""
    real, grip, measured = built.real, 4.0, 0.1
    for side in BOTH:
        short = Measurement(SPEED, side * 0.05, side * measured)
        found = {allowed: _grip_after(built, short, grip, grip_shortfall=allowed) for allowed in (0.1, 5.0)}
        while True:  # the allowance influenced the demand of the earlier samples
            loses, keeps = max(a for a in found if found[a][0] <= grip), min(a for a in found if found[a][0] > grip)
            allowed = float(real(0.5 * (loses + keeps)))
            if allowed in found:
                break
            found[allowed] = _grip_after(built, short, grip, grip_shortfall=allowed)
        missing = {a: real(found[a][1]) * real(SPEED) - real(measured) * real(SPEED) for a in (loses, keeps)}
        assert missing[loses] > loses and missing[keeps] <= keeps == built.next(loses, 9.0)


def check_tracking_at_the_end_of_its_range(built: Built) -> None:
    """Check that a demand at the end of the range is not limited, and one unit in the last place beyond is."""
    rest = built.software.controller(0.0).state
    for side in BOTH:
        controller = _running(built)
        most = controller.parameters.rear_angle_max
        for integral, status in ((most, Status.TRACKING), (built.next(most, 1.0), Status.LIMITED)):
            controller.state.law.integral = side * integral
            controller.state.rear_angle = controller.state.limiter.rear_angle = side * most
            controller.state.law.model = rest.law.model
            command = controller.step(Measurement(SPEED, 0.0, 0.0, inhibit=True))
            assert (command.yaw_rate_reference, command.rear_angle) == (0.0, side * most)
            assert command.status is status, (side, integral)


def check_tracking_at_the_end_of_its_rate(built: Built) -> None:
    """Check that a demand at exactly the largest rate is not limited, and one unit in the last place beyond is."""
    for side in BOTH:
        controller = _running(built, rear_rate_max=0.5, rear_angle_error_max=1.0)
        step = float(built.real(0.5) * built.real(config_of(built).controller.sampling_time_s))
        for demand, status in ((step, Status.TRACKING), (built.next(step, 1.0), Status.LIMITED)):
            controller.init(0.0)
            controller.step(Measurement(SPEED, 0.0, 0.0))
            controller.state.law.integral = side * demand
            command = controller.step(Measurement(SPEED, 0.0, 0.0, inhibit=True))
            assert command.rear_angle == side * step
            assert command.status is status, (side, demand)


def check_tracking_reached_in_a_small_turn(built: Built) -> None:
    """Check that the reached grip is the lateral acceleration on both sides, however small."""
    for side in BOTH:
        controller = _running(built)
        assert controller.state.grip.reached == 0.0
        turn = Measurement(SPEED, side * 0.001, side * 0.01)
        controller.step(turn)
        assert controller.state.grip.reached == float(built.real(SPEED) * built.real(0.01))


def check_tracking_least_grip(built: Built) -> None:
    """Check that on a road without grip the estimate falls to that of the least friction and no further."""
    for side in BOTH:
        controller = _running(built, grip_shortfall=0.5)
        controller.run([Measurement(30.0, side * 0.06, side * 0.001)] * 400)
        cap = built.total.lateral_acceleration_cap
        least = controller.parameters.friction_min * cap / built.total.friction
        assert abs(controller.state.grip.available - least) < 8.0 * built.eps * cap
