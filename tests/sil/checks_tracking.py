"""Checks of the control law "tracking" at exact thresholds that drives seldom reach.

`suite` compares each sample of drives with the second implementation. Each check takes a build of that kind and raises
AssertionError if the build fails it. Errors are reference minus measured yaw rate, rad/s. Limits that a check does not test are
open.
"""

import itertools
import math
from typing import Any

from codegen.configuration.controller import INTEGRAL_GAIN_MIN
from codegen.sil.software import Controller, Measurement, Status
from codegen.vehicle.tyre import AxleTyres
from tests.builds import TRACKING_CONFIG, Built
from tests.sil.checks_kinds import OPEN, config_of, open_limiter, parameters_of

PERIOD = TRACKING_CONFIG.controller.sampling_time_s
SPEED = 20.0
"""m/s: inside the map, in the middle of the gain schedule."""
BOTH = (1.0, -1.0)
CONTINUES = 1
"""`<prefix>_LAW_CONTINUES`."""
MODEL_CHANGES: dict[str, dict[str, Any]] = {
    "as built": {},
    "no rate limit": {"rear_rate_max": 1000.0, "limiter": {"rear_rate_max": 1000.0}},
    "slow actuator": {"rear_rate_max": 0.05, "rear_angle_error_max": 0.005},
    "high gains": {"proportional_gain": [0.4] * 6, "integral_gain": [20.0] * 6},
    "no authority": {"yaw_increasing_max": 0.0, "yaw_increasing_wide": 0.0, "lead_smoothing": 1.0, "inputs": OPEN},
    "sensitive to sideslip": {"sideslip_max": 0.005, "turn_margin_rate": 0.0, "turn_margin": 0.0, "inputs": OPEN},
    "sensitive to grip": {"grip_shortfall": 0.2, "grip_loss_rate": 50.0, "trim_share": 0.1, "trim_rate": 20.0},
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
    """Check the initial state: straight ahead, whatever the given angle, with the map's grip."""
    state = built.software.controller(0.02).state
    for name in ("trim", "integral", "front_angle", "front_rate", "missed_samples", "yaw_rate", "previous_model_yaw_rate"):
        assert getattr(state.law, name) == 0.0, name
    model = state.law.model
    assert (model.sideslip_angle, model.yaw_rate, model.rear_angle, model.lateral_acceleration) == (0.0, 0.0, 0.0, 0.0)
    assert state.grip.reached == 0.0
    assert abs(state.grip.available - built.total.lateral_acceleration_cap) <= 2.0 * built.eps * state.grip.available


def check_tracking_memory_of_the_road(built: Built) -> None:
    """Check that the grip estimate survives the fail-safe and a restart of control, and recovers at standstill."""
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
    assert controller.step(Measurement(0.0, 0.0, 0.0)).status is Status.TRACKING
    # Both are rounded twice, near 2.
    assert abs(grip.available - (2.0 + p.grip_recovery_idle * period)) <= 2.0 * built.eps * 2.0
    assert abs(grip.reached - 2.0 * (1.0 - p.grip_forgetting * period)) <= 2.0 * built.eps * 2.0
    controller.run([Measurement(0.0, 0.0, 0.0)] * round(20.0 / float(p.grip_recovery_idle) / period))
    assert abs(grip.available - built.total.lateral_acceleration_cap) <= 2.0 * built.eps * grip.available


GRIP_CASES: dict[str, tuple[float, float, float | str]] = {
    "half of the tolerance": (2.0, 1.625, "grip_recovery"),
    "the tolerance": (2.0, 1.25, "grip_recovery"),
    "more": (2.0, 1.0, -0.25),
    "below half of the grip": (1.9999, 1.25, "grip_recovery_idle"),
    "all of the grip, the tolerance": (4.0, 3.5, "grip_recovery"),
    "all of the grip": (4.0, 3.0, -0.5),
    "more than the grip": (6.0, 3.5, -2.0),
    "nothing reached": (4.0, 0.0, "grip_recovery"),
    "to the other side": (4.0, -1.0, "grip_recovery"),
}
"""Lateral acceleration of the model and of the car, and the loss of a grip of 4 m/s^2, or the rate of its recovery.

A shortfall of 0.5 m/s^2 is tolerated, and a quarter of the model's acceleration times the share of the grip that is not used.
"""


def check_tracking_shortfall_of_grip(built: Built) -> None:
    """Check the tolerated shortfall, the loss beyond it, the recovery, and that the grip is at least what the car reached."""
    software, period = built.software, config_of(built).controller.sampling_time_s
    parameters = software.parameters(grip_shortfall=0.5, grip_shortfall_share=0.25, grip_loss_rate=10.0)
    update, grip = software.function("grip_update"), software.new("grip")
    for (case, (model, car, change)), side in itertools.product(GRIP_CASES.items(), BOTH):
        grip.available, grip.reached = 4.0, 0.0
        update(grip, parameters, side * model, side * car)
        rate = float(getattr(parameters, change)) if isinstance(change, str) else 10.0 * change
        assert abs(grip.available - (4.0 + rate * period)) <= 2.0 * built.eps * 4.0, case
        assert grip.reached == float(built.real(abs(car))), case
        grip.available = grip.reached = 4.0
        update(grip, parameters, side * model, side * car)
        forgotten = 4.0 * (1.0 - float(parameters.grip_forgetting) * period)
        assert abs(grip.reached - forgotten) <= 2.0 * built.eps * 4.0, case
        assert grip.available >= grip.reached, case
    grip.available = 4.0
    update(grip, parameters, 2.0, built.next(1.25, 0.0))
    assert grip.available <= 4.0, "no recovery one unit in the last place beyond the tolerance"


class LawUnit:
    """The law alone at 16 m/s, straight ahead for the map, with the gains and limits that a check sets."""

    def __init__(self, built: Built, **changes: Any) -> None:
        self.built, software = built, built.software
        count = len(list(software.parameters().schedule_speed))
        still = {name: [0.0] * count for name in ("lead_time", "response_gain")}
        still |= {"proportional_gain": [0.4] * count, "integral_gain": [INTEGRAL_GAIN_MIN] * count, "trim_share": 0.0}
        wide = {"rear_rate_max": 1000.0, "rear_angle_error_max": 1.0, "limiter": open_limiter(built)}
        margins = {"turn_margin_rate": 0.01, "turn_margin": 0.1, "sideslip_max": 0.0625}
        self.parameters = parameters_of(built, {**still, **wide, **margins, **changes})
        self.state, self._sample = software.new("law"), software.new("measurement")

    def step(
        self,
        turn: float,
        lateral: float,
        sideslip: float,
        friction: float | None = None,
        earlier: float | None = None,
        **model: float,
    ) -> Any:
        """Return the output of a sample with a sideslip that the model has too.

        Args:
            turn: yaw rate, rad/s.
            lateral: lateral acceleration, m/s^2.
            sideslip: observed so far, rad.
            friction: of the road; that of the map if it is None.
            earlier: yaw rate of the sample before, rad/s; the same if it is None.
            model: other fields of the reference model.
        """
        software, law = self.built.software, self.state
        software.function("law_init")(law, 0.0)
        law.sideslip = law.model.sideslip_angle = sideslip
        law.yaw_rate = turn if earlier is None else earlier
        for name, value in model.items():
            setattr(law.model, name, value)
        road = self.built.total.friction if friction is None else friction
        sample = Measurement(16.0, 0.0, turn, 0.0, lateral_acceleration=lateral, inhibit=True)
        software.fill(self._sample, sample)
        return software.function("law_step")(law, self.parameters, self._sample, CONTINUES, road, 0.0, 0.0)


def check_tracking_sideslip(built: Built) -> None:
    """Check that the sideslip follows the measured motion, returns to that of the model at 0.4/s, and is bounded by 20 deg."""
    unit, period = LawUnit(built), config_of(built).controller.sampling_time_s
    for side in BOTH:
        unit.step(side * 0.1, side * 2.4, side * 0.01)
        assert abs(unit.state.sideslip - side * (0.01 + period * 0.05)) <= 2.0 * built.eps * 0.1
        unit.step(side * 0.1, side * 1.6, side * 0.01, sideslip_angle=side * 0.03)
        assert abs(unit.state.sideslip - side * (0.01 + period * 0.4 * 0.02)) <= 2.0 * built.eps * 0.1
        unit.step(0.0, side * 50.0, side * 0.349)
        assert abs(unit.state.sideslip - side * math.radians(20.0)) <= built.eps


def check_tracking_sideslip_without_yaw_rate(built: Built) -> None:
    """Check that the sideslip is that of the model while the yaw rate is replaced, from the first sample to the last."""
    period = config_of(built).controller.sampling_time_s
    for side in BOTH:
        controller = _running(built)
        inputs, law = controller.parameters.inputs, controller.state.law
        lost = [Measurement(SPEED, 0.0, math.nan)] * (inputs.missing_samples_max + 3)
        samples = [*lost, *[Measurement(SPEED, 0.0, 0.0)] * inputs.recovery_samples]
        for number, sample in enumerate(samples):
            law.sideslip, law.model.sideslip_angle = side * 0.1, side * 0.02
            controller.step(sample)
            is_replaced = inputs.missing_samples_max <= number < len(samples) - 1
            expected = 0.02 if is_replaced else 0.1 - period * 0.4 * 0.08
            assert abs(law.sideslip - side * expected) <= 2.0 * built.eps * 0.1, number


REFERENCE_CASES: dict[str, tuple[dict[str, float], float, float, float]] = {
    "the model": ({}, 8.0, 0.0, 0.4),
    "turn, lead and margin": ({}, 4.0, 0.0, (4.0 + 0.4 + 0.16) / 16.0),
    "least margin": ({"turn_margin": 0.5}, 4.0, 0.0, (4.0 + 0.4 + 0.5) / 16.0),
    "half of the lead": ({}, 4.0, -0.0625 / 6.0, (4.0 + 0.2 + 0.16) / 16.0),
    "no lead": ({}, 4.0, -0.0625 / 2.0, (4.0 + 0.16) / 16.0),
    "sideslip_max": ({}, 4.0, -0.0625, (4.0 + 0.16) / 16.0),
    "beyond sideslip_max": ({}, 4.0, -0.09375, (4.0 + 0.16) / 16.0 - 2.0 * 0.03125),
    "far beyond": ({}, 4.0, -0.3, 0.0),
    "into the turn": ({}, 4.0, 0.3, (4.0 + 0.4 + 0.16) / 16.0),
}
"""Parameters, lateral acceleration, sideslip and reference of a model that turns by 0.4 rad/s and reaches 6 m/s^2."""


def check_tracking_limit_of_the_reference(built: Built) -> None:
    """Check that the reference exceeds the turn of the car by the model's lead and a margin, and less with sideslip."""
    for (case, (changes, lateral, sideslip, wanted)), side in itertools.product(REFERENCE_CASES.items(), BOTH):
        unit = LawUnit(built, **changes)
        motion = (side * lateral / 16.0, side * lateral, side * sideslip)
        output = unit.step(*motion, yaw_rate=side * 0.4, lateral_acceleration=side * 6.0)
        assert abs(output.yaw_rate_reference - side * wanted) <= 8.0 * built.eps * 0.4, (case, output.yaw_rate_reference)
    for friction in (0.3, built.total.friction):
        output = LawUnit(built).step(1.0, 16.0, 0.0, friction, yaw_rate=1.0)
        wanted = 1.15 * float(built.lookup.lateral_acceleration(friction)) / 16.0
        assert abs(output.yaw_rate_reference - wanted) <= 4.0 * built.eps, friction


def check_tracking_authority(built: Built) -> None:
    """Check how far feedback may increase the yaw rate, and against the turn the slip of the rear tyres' peak force."""
    for side in BOTH:
        unit = LawUnit(built, yaw_increasing_max=0.01, yaw_increasing_wide=0.03, turn_margin=10.0)
        for outward, most in ((-1.0, 0.03), (0.0, 0.03), (0.5, 0.02), (1.0, 0.01), (2.0, 0.01)):
            output = unit.step(side * 0.1, side * 1.6, side * -outward * 0.0625, yaw_rate=side * 0.25)
            assert abs(output.yaw_rate_reference - side * 0.25) <= built.eps, "more yaw rate than the car has"
            assert abs(output.rear_angle + side * most) <= 4.0 * built.eps * 0.03, outward
        config = config_of(built)
        peak, arm = AxleTyres.from_config(config).rear.peak_slip, config.vehicle.cg_to_rear_axle_m
        for share in (1.0, 0.5):
            slip_max = peak * (0.5 + 0.5 * share)
            # A sideslip at which the rear angle of that slip is 0.02 rad: the wheels move out of the turn, and so does the car.
            slip = 0.02 - slip_max + arm * 0.25 / 16.0
            output = unit.step(side * 0.25, side * 4.0, side * slip, share * built.total.friction, yaw_rate=side * 0.001)
            assert abs(output.rear_angle - side * 0.02) <= 4.0 * built.eps, share
        for earlier, is_bounded in ((side * 0.1, True), (-side * 0.1, False)):
            output = unit.step(-side * 0.1, -side * 1.6, 0.0, earlier=earlier, yaw_rate=side * 0.4)
            assert (abs(output.rear_angle) <= 0.0301) == is_bounded, "a side is free after two samples of the other turn"


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
