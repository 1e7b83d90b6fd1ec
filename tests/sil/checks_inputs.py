"""Checks of the input monitoring: exact thresholds, and the substitute for a signal that is not trusted.

Each check takes a build of any kind and raises AssertionError if the build fails it.
"""

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace

from codegen.emit.laws import law_of
from codegen.sil.software import Controller, Measurement, Status
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from codegen.verify.unit_drives import feedback_speeds
from tests.builds import Built
from tests.sil.checks_kinds import OPEN, config_of, parameters_of

RUNNING = (Status.TRACKING, Status.LIMITED)
STRAIGHT = Measurement(16.0, 0.0, 0.0, 0.0)
SIGNALS = ("speed", "front_angle", "yaw_rate")
WRONG = 2
"""`<prefix>_SIGNAL_WRONG`."""


def _gain(built: Built, speed: float) -> float:
    """Return the linear car's yaw rate per rad between front and rear wheels, 1/s: v / (L + K v^2)."""
    car = SingleTrack.from_config(config_of(built))
    return speed / (car.wheelbase + car.understeer_coefficient * speed**2)


def _turning(built: Built, **inputs: float) -> tuple[Controller, Measurement]:
    """Return a controller after a long steady turn of the linear car, and a sample of that turn."""
    turn = Measurement(16.0, 0.03, 0.03 * _gain(built, 16.0), 0.0)
    controller = built.software.controller(0.0, parameters_of(built, {"inputs": {"yaw_rate_frozen": 20.0, **inputs}}))
    assert {command.status for command in controller.run([turn] * 300)} <= set(RUNNING)
    return controller, turn


EXACT = {**OPEN, "expected_share": 1.0, "understeer_coefficient": 0.0, "wheelbase": 2.0}
"""Linear car without understeer and without lag: exact yaw rates, v/2 per rad between front and rear wheels."""


class Unit:
    """The input monitoring alone, of the car EXACT. A reference model turns like that car unless it is given another motion.

    Without `judges_lateral`, the lateral acceleration is never found wrong.
    """

    def __init__(self, built: Built, judges_lateral: bool = False, **inputs: float) -> None:
        self.built, self.judges_lateral = built, judges_lateral
        self.parameters = parameters_of(built, {"inputs": EXACT | inputs})
        software = built.software
        self.state, self.checked, self._measured = (software.new(name) for name in ("inputs", "measurement", "measurement"))
        self.model = software.new("reference_model") if law_of(config_of(built)).uses_reference_model else None
        software.function("inputs_init")(self.state, True)

    def step(self, measurement: Measurement, yaw_rate: float | None = None, rear_angle: float = 0.0) -> None:
        """Check a sample; `yaw_rate` and `rear_angle` are the other motion of the reference model."""
        software, models = self.built.software, []
        if self.model:
            speed = self.state.speed.value if self.state.speed.source == WRONG else measurement.speed
            given = math.isfinite(measurement.front_angle)
            front_angle = measurement.front_angle if given else self.state.front_angle.value
            turn = 0.5 * speed * (front_angle - measurement.rear_angle)
            self.model.yaw_rate = turn if yaw_rate is None else yaw_rate
            self.model.rear_angle = measurement.rear_angle if yaw_rate is None else rear_angle
            models = [self.model]
        software.fill(self._measured, measurement)
        if not self.judges_lateral:
            state, lateral = self.state, measurement.lateral_acceleration
            state.lateral_acceleration = lateral if math.isfinite(lateral) else 0.0
            state.least_of_lateral, state.lateral_against = 1e3, 0
        parameters = software.ffi.addressof(self.parameters, "inputs")
        software.function("inputs_step")(self.state, parameters, self._measured, 0.0, *models, self.checked)

    def run(self, measurements: Iterable[Measurement]) -> None:
        """Check samples."""
        for measurement in measurements:
            self.step(measurement)


def check_step_of_each_signal(built: Built) -> None:
    """Check that a signal may change by exactly its step limit per sample, plus one step for each missing sample.

    A signal that jumps further is wrong at once and replaced by the others.
    """
    for field in SIGNALS:
        base = float(getattr(STRAIGHT, field))
        step = 0.5 if field == "speed" else float(getattr(built.software.parameters().inputs, f"{field}_step"))
        for missing, share, believed in ((0, 1.0, True), (1, 2.0, True), (0, 1.001, False), (1, 2.001, False)):
            for side in (1.0, -1.0):
                changes = {**OPEN, f"{field}_step": step, "missing_samples_max": 2}
                controller = built.software.controller(0.0, parameters_of(built, {"inputs": changes}))
                controller.run([STRAIGHT] + [replace(STRAIGHT, **{field: math.nan})] * missing)  # type: ignore[arg-type]
                controller.step(replace(STRAIGHT, **{field: base + side * share * step}))  # type: ignore[arg-type]
                source = getattr(controller.state.inputs, field).source
                assert source == (0 if believed else WRONG), (field, missing, share)
                assert (controller.state.status in RUNNING) == believed


def check_lost_yaw_rate(built: Built) -> None:
    """Check that the steady turn of the linear car, or of the reference model, replaces a lost yaw rate.

    Control continues, and the signal counts again after `recovery_samples`.
    """
    controller, turn = _turning(built)
    most, needed = controller.parameters.inputs.missing_samples_max, controller.parameters.inputs.recovery_samples
    lost = replace(turn, yaw_rate=math.nan, front_angle=0.02)
    assert {command.status for command in controller.run([lost] * 600)} == {Status.DEGRADED}
    # The lag has decayed by exp(-40). Rounding remains: half a unit for each of its steps, over 15 samples.
    linear = wanted = 0.02 * _gain(built, 16.0)
    if law_of(config_of(built)).uses_reference_model:  # the rear wheels are measured straight, not where the model has them
        model = controller.state.law.model
        wanted = model.yaw_rate + _gain(built, 16.0) * model.rear_angle
        assert abs(wanted - linear) <= 2e-3 * linear, "a small slip"
    assert abs(controller.state.sample.yaw_rate - wanted) <= 20.0 * built.eps * wanted
    assert controller.state.inputs.yaw_rate.missing == most + 1
    back = replace(turn, yaw_rate=wanted, front_angle=0.02)
    statuses = [command.status for command in controller.run([back] * needed)]
    assert set(statuses[:-1]) == {Status.DEGRADED} and statuses[-1] in RUNNING
    assert controller.state.inputs.yaw_rate.missing == 0
    controller.run([lost] * (most + 1) + [back] * (needed - 1) + [replace(back, speed=math.nan)])
    assert (controller.state.inputs.yaw_rate.source, controller.state.inputs.yaw_rate.missing) == (0, 0)


def check_lost_front_angle(built: Built) -> None:
    """Check that a lost front angle is replaced by the angle that explains the yaw rate, including the rear wheels."""
    controller, turn = _turning(built)
    lost = replace(turn, front_angle=math.nan, rear_angle=0.01)
    assert {command.status for command in controller.run([lost] * 30)} == {Status.DEGRADED}
    assert abs(controller.state.sample.front_angle - (0.01 + 0.03)) <= 8.0 * built.eps * 0.04  # five operations, each rounded


def check_lost_front_angle_of_a_slow_car(built: Built) -> None:
    """Check that the replacement starts at exactly 1 m/s; below, the yaw rate would give a poor estimate."""
    for speed, found in ((1.0, True), (built.next(1.0, 0.0), False)):
        controller = built.software.controller(0.0, parameters_of(built, {"inputs": {**OPEN, "missing_samples_max": 0}}))
        controller.run([Measurement(speed, 0.03, 0.02, 0.0), Measurement(speed, math.nan, 0.02, 0.0)])
        assert (controller.state.sample.front_angle != float(built.real(0.03))) == found


def check_wrong_speed(built: Built) -> None:
    """Check that a wrong speed counts again after `recovery_samples` in a row close to its substitute."""
    controller, turn = _turning(built, speed_fall=0.0)
    controller.run([replace(turn, speed=8.0)] * 30)
    assert (controller.state.inputs.speed.source, controller.state.sample.speed) == (WRONG, 16.0)
    statuses = [command.status for command in controller.run([turn] * controller.parameters.inputs.recovery_samples)]
    assert set(statuses[:-1]) == {Status.DEGRADED} and statuses[-1] in RUNNING
    for held, speed, is_right in (
        *((16.0, 21.0, True), (16.0, built.next(21.0, 99.0), False), (16.0, 11.0, True), (16.0, built.next(11.0, 0.0), False)),
        *((0.0, 30.0, True), (built.next(1.0, 0.0), 30.0, True), (1.0, 30.0, False), (-16.0, -21.0, True), (-1.0, 30.0, False)),
    ):
        controller = built.software.controller(
            0.0, parameters_of(built, {"inputs": {"speed_fall": 0.0, "speed_agreement": 1.0}})
        )
        controller.run([Measurement(held, 0.0, 0.0, 0.0), Measurement(99.0, 0.0, 0.0, 0.0)])
        controller.run([Measurement(speed, 0.0, 0.0, 0.0)] * controller.parameters.inputs.recovery_samples)
        assert (controller.state.inputs.speed.source == 0) == is_right, (held, speed)


def check_slow_speed_in_a_gap(built: Built) -> None:
    """Check that control ends exactly below the disabling speed, even in an incomplete sample; without one it does not."""
    waits, (ends, _) = config_of(built).controller.waits_for_speed, feedback_speeds(built.software.parameters())
    for speed, controlled in ((ends, True), (built.next(ends, 0.0), not waits), (0.0, not waits)):
        controller = built.software.controller(0.0, parameters_of(built, {"inputs": OPEN}))
        controller.run([Measurement(16.0, 0.03, 0.1, 0.0)] * 3)
        assert controller.step(Measurement(speed, 0.03, math.nan, 0.0)).status is Status.DEGRADED
        assert controller.state.enabled == controlled


def check_lost_speed(built: Built) -> None:
    """Check that a lost speed is held, then falls by `speed_fall` per sample until it returns, but not below zero."""
    controller, turn = _turning(built, speed_fall=0.5)
    lost, most = replace(turn, speed=math.nan), controller.parameters.inputs.missing_samples_max
    controller.run([lost] * (most + 3))
    assert controller.state.sample.speed == 16.0 - 3 * 0.5
    controller.run([lost] * 40)
    at_rest = Status.STANDBY if config_of(built).controller.waits_for_speed else Status.DEGRADED
    assert (controller.state.sample.speed, controller.state.status) == (0.0, at_rest)


def check_lost_friction_and_rear_angle(built: Built) -> None:
    """Check that a lost friction estimate rises to the default, and that the command replaces the rear angle."""
    controller = built.software.controller(0.01, parameters_of(built, {"inputs": {"friction_recovery": 0.125}}))
    controller.step(replace(STRAIGHT, friction=0.5, rear_angle=0.015))
    sample = controller.state.sample
    assert (sample.friction, sample.rear_angle) == (0.5, float(built.real(0.015)))
    before = controller.state.rear_angle
    controller.step(replace(STRAIGHT, rear_angle=math.nan))
    assert (sample.friction, sample.rear_angle) == (0.625, before)
    controller.run([STRAIGHT] * 30)
    assert sample.friction == 2.0


def check_frozen_yaw_rate(built: Built) -> None:
    """Check that a constant yaw rate becomes wrong once the linear car's yaw rate has moved by more than the limit.

    A yaw rate with the smallest change is not frozen.
    """
    for frozen in (True, False):
        controller, turn = _turning(built, yaw_rate_frozen=0.05)
        for sample in range(400):
            shaking = 0.0 if frozen or sample % 2 else 1e-6
            controller.step(replace(turn, front_angle=0.02, yaw_rate=turn.yaw_rate + shaking))
            moved = turn.yaw_rate - controller.state.inputs.expected_yaw_rate
            wrong = controller.state.inputs.yaw_rate.source == WRONG
            if abs(moved - 0.05) > 1e-5:  # beyond the amplitude of the shaking
                assert wrong == (frozen and moved > 0.05), sample


def check_turn_that_is_just_too_far_away(built: Built) -> None:
    """Check that a distance equal to the limit is no fault, and that the first sample has no distance."""
    unit = Unit(built, yaw_rate_frozen=0.25)
    turn = Measurement(16.0, 0.03125, 0.25, 0.0)
    unit.run([turn] * 3 + [replace(turn, front_angle=0.0)])
    assert unit.state.yaw_rate.source == 0
    unit.step(replace(turn, front_angle=-0.001))
    assert unit.state.yaw_rate.source == WRONG
    _turning(built, yaw_rate_frozen=0.02, yaw_rate_max=20.0)


def check_turn_beyond_its_range(built: Built) -> None:
    """Check that the substitute of the yaw rate stays within its range on both sides."""
    for side in (1.0, -1.0):
        unit = Unit(built, yaw_rate_max=0.5)
        unit.run([Measurement(16.0, side * 0.2, side * 0.1, 0.0)] * 2)
        assert unit.state.expected_yaw_rate == side * 0.5


def check_wrong_signal_proves_itself_in_a_turn(built: Built) -> None:
    """Check that a wrong signal must agree with the others for `recovery_samples` in a row, in a turn.

    Straight ahead, agreement of zero with zero proves nothing.
    """
    own = built.software.parameters().inputs
    limits = {name: float(getattr(own, name)) for name in ("front_angle_step", "yaw_rate_step", "yaw_rate_tolerance")}
    turn = Measurement(16.0, 0.03125, 0.125, 0.015625)
    for field in ("front_angle", "yaw_rate"):
        unit = Unit(built, **limits)
        unit.run([turn] * 3)
        needed = unit.parameters.inputs.recovery_samples
        unit.step(_reversed(turn, field))
        signal = getattr(unit.state, field)
        assert signal.source == WRONG
        unit.run([_reversed(turn, field)] * 50)
        assert signal.source == WRONG, "it stays wrong"
        unit.run([turn] * (needed - 1))
        assert signal.source == WRONG
        unit.step(turn)
        assert signal.source == 0, field
        unit.step(_reversed(turn, field))
        for share in (max(1.0 - 0.02 * sample, 0.0) for sample in range(150)):
            turned = (share * turn.front_angle, share * turn.yaw_rate, share * turn.rear_angle)
            unit.step(_reversed(replace(turn, front_angle=turned[0], yaw_rate=turned[1], rear_angle=turned[2]), field))
        assert signal.source == WRONG, "straight ahead"


def _reversed(sample: Measurement, field: str) -> Measurement:
    return replace(sample, **{field: -getattr(sample, field)})  # type: ignore[arg-type]


def check_both_wrong(built: Built) -> None:
    """Check that both signals count again after `recovery_samples`, even straight ahead, if neither can confirm the other."""
    controller, turn = _turning(built)
    wrong = replace(turn, front_angle=-0.03, yaw_rate=-turn.yaw_rate)
    assert controller.step(wrong).status is Status.FAIL_SAFE
    found = [command.status for command in controller.run([STRAIGHT] * controller.parameters.inputs.recovery_samples)]
    assert set(found[:-1]) == {Status.FAIL_SAFE} and found[-1] in RUNNING


def check_gap_of_the_speed_as_the_others_come_back(built: Built) -> None:
    """Check that the fail-safe begins whatever the speed does, and lasts until a complete sample arrives."""
    controller = built.software.controller(0.0)
    most, needed = controller.parameters.inputs.missing_samples_max, controller.parameters.inputs.recovery_samples
    lost = replace(STRAIGHT, front_angle=math.nan, yaw_rate=math.nan)
    controller.run([STRAIGHT] + [lost] * most)
    assert controller.step(replace(lost, speed=math.nan)).status is Status.FAIL_SAFE
    gap = [STRAIGHT] * (needed - 1) + [replace(STRAIGHT, speed=math.nan)]
    assert {command.status for command in controller.run(gap)} == {Status.FAIL_SAFE}
    assert controller.step(STRAIGHT).status in RUNNING


def check_ranges_of_the_unit_itself(built: Built) -> None:
    """Check ranges that the limiter or the map also limits, so that the controller's parameters cannot show them."""
    is_valid = built.software.function("inputs_parameters_valid")
    least = float(built.real(50.0 * KM_H))
    for name, end, beyond in (("speed_max", 200.0, 1e3), ("speed_max", least, 0.0), ("front_angle_max", 1.5, 1e3)):
        for value, fits in ((end, True), (built.next(end, beyond), False)):
            parameters = built.software.parameters()
            setattr(parameters.inputs, name, value)
            assert is_valid(built.software.ffi.addressof(parameters, "inputs")) == fits, name


def check_oversteering_car(built: Built) -> None:
    """Check that the linear car's yaw rate stays bounded beyond the critical speed of an oversteering car.

    The bound is the yaw rate of a car with a quarter of its wheelbase.
    """
    for speed, length in ((32.0, 1.0), (48.0, 0.5)):
        unit = Unit(built, understeer_coefficient=-1.0 / 1024.0, yaw_rate_max=20.0)
        unit.step(Measurement(speed, 0.0, 0.0, -0.03125), 0.0)
        assert abs(unit.state.expected_yaw_rate - speed * 0.03125 / length) <= 4.0 * built.eps


def _turning_with_lateral_acceleration(built: Built, **inputs: float) -> tuple[Controller, Measurement]:
    """Return a controller after a steady turn of the linear car with its lateral acceleration, and a sample of that turn."""
    controller, turn = _turning(built, **inputs)
    turn = replace(turn, lateral_acceleration=turn.yaw_rate * turn.speed)
    assert not controller.state.inputs.lateral_is_proven
    controller.state.inputs.lateral_acceleration = turn.lateral_acceleration  # as after a slow rise
    controller.run([turn] * 3)
    assert controller.state.inputs.lateral_is_proven
    return controller, turn


def check_lateral_acceleration_stands_for_the_yaw_rate(built: Built) -> None:
    """Check that the lateral acceleration replaces the yaw rate if it agreed before, is in its range and the car is not slow;
    otherwise the linear car replaces it."""
    most = float(built.software.parameters().inputs.lateral_acceleration_max)
    cases = [(16.0, 3.0, True), (16.0, -most, True), (16.0, built.next(most, 99.0), False), (16.0, math.nan, False)]
    turn = Measurement(16.0, 0.03125, 0.25, 0.0, lateral_acceleration=4.0)
    for speed, lateral, is_taken in [*cases, (5.0, 0.5, True), (built.next(5.0, 0.0), 0.5, False)]:
        for is_proven in (True, False):
            unit = Unit(built, yaw_rate_correction_share=0.125, lateral_acceleration_max=most)
            unit.run([turn] * 3)
            unit.state.lateral_is_proven = is_proven
            unit.run([replace(turn, speed=speed, yaw_rate=math.nan, lateral_acceleration=lateral)] * 600)
            wanted = lateral / speed if is_taken and is_proven else 0.03125 * 0.5 * speed
            # Only the rounding of the lag remains: half a unit for each step, over 8 samples.
            sample = unit.checked
            assert abs(sample.yaw_rate - wanted) <= 10.0 * built.eps * abs(wanted), (speed, lateral, is_proven)
            wanted = lateral if is_taken else speed * sample.yaw_rate
            assert abs(sample.lateral_acceleration - wanted) <= 4.0 * built.eps * abs(wanted)


def check_lateral_acceleration_is_refuted(built: Built) -> None:
    """Check that a yaw rate that agrees with the front angle in a turn refutes a lateral acceleration more than twice the
    agreement away.

    It is trusted again in a turn where it agrees.
    """
    controller, turn = _turning_with_lateral_acceleration(built, lateral_acceleration_offset_max=0.0)
    agreement = float(controller.parameters.inputs.yaw_rate_agreement)
    for apart, is_proven in ((1.5, True), (1.99, True), (2.01, False), (1.5, False), (0.99, True), (-2.01, False)):
        controller.step(replace(turn, lateral_acceleration=(turn.yaw_rate + apart * agreement) * turn.speed))
        assert controller.state.inputs.lateral_is_proven == is_proven, apart
    for share in (0.5, 0.1):
        controller.state.inputs.lateral_is_proven = False
        slow = replace(turn, front_angle=share * turn.front_angle, yaw_rate=share * turn.yaw_rate)
        controller.step(replace(slow, lateral_acceleration=share * turn.lateral_acceleration))
        assert controller.state.inputs.yaw_rate.source == 0
        assert controller.state.inputs.lateral_is_proven == (share == 0.5), "no proof nearly straight ahead"


FROZEN_CASES: dict[str, tuple[float, float, bool]] = {
    "straight": (0.0, 0.0, True),
    "to the other side": (-0.25, -4.0, True),
    "1 m/s^2": (1.0 / 16.0, 1.0, False),
    "less than 1 m/s^2": (math.nextafter(0.0625, 0.0), 1.0, True),
    "as far apart as allowed": (0.0, 0.25, True),
    "too far apart": (0.0, 0.2501, False),
    "lateral acceleration of the old turn": (0.0, 4.0, False),
    "no lateral acceleration": (0.0, math.nan, False),
}
"""Yaw rate, lateral acceleration, and whether a constant front angle that turns the car by 0.25 rad/s is frozen."""


def check_frozen_front_angle(built: Built) -> None:
    """Check that a constant front angle is wrong if the car turns with less than 1 m/s^2 to its side.

    Yaw rate and lateral acceleration must agree on that for three `recovery_samples`.

    Otherwise the driver holds the wheel, and the car slides.
    """
    settings = {"yaw_rate_frozen": 0.125, "yaw_rate_agreement": 1.0 / 64.0}
    for (case, (yaw_rate, lateral, is_frozen)), side in itertools.product(FROZEN_CASES.items(), (1.0, -1.0)):
        turn = Measurement(16.0, side * 0.03125, side * 0.25, 0.0, lateral_acceleration=side * 4.0)
        yaw_rate = built.next(0.0625, 0.0) if case.startswith("less") else yaw_rate
        held = replace(turn, yaw_rate=side * yaw_rate, lateral_acceleration=side * lateral)
        shaking = replace(held, front_angle=held.front_angle * (1.0 + 1e-6))
        unproven, gap = "unproven", replace(held, front_angle=math.nan)
        for variant in ("", "shaking", unproven, "close", "gap") if case == "straight" else ("",):
            unit = Unit(built, **settings | ({"yaw_rate_frozen": 0.25} if variant == "close" else {}))
            needed = 3 * unit.parameters.inputs.recovery_samples
            # The first sample is compared with the yaw rate of the turn before it.
            samples = [held] + [held, shaking if variant == "shaking" else held] * needed
            samples = [*samples[:needed], gap, *samples[: needed - 1]] if variant == "gap" else samples[:needed]
            unit.run([turn] * 3)
            for sample in samples:
                unit.state.lateral_is_proven = variant != unproven
                unit.step(sample)
            assert unit.state.front_angle.source == 0, (case, variant)
            unit.state.lateral_is_proven = variant != unproven
            unit.step(held)
            found = unit.state.front_angle.source == WRONG
            assert found == (is_frozen and variant in ("", "gap")), (case, variant)
            assert (unit.state.front_angle.good == 0) or not found
            assert (unit.state.yaw_rate.source, unit.state.speed.source) == (0, 0)
    unit = Unit(built, yaw_rate_frozen=0.05, yaw_rate_agreement=1.0 / 64.0)
    unit.run(Measurement(16.0, 0.0, 0.005 * k, 0.0, lateral_acceleration=0.08 * k) for k in range(60))
    inputs = unit.state
    assert (inputs.expected_yaw_rate, inputs.lateral_is_proven, inputs.front_angle.source) == (0.0, True, 0), "no turn to make"


def check_wrong_lateral_acceleration(built: Built) -> None:
    """Check what makes a lateral acceleration wrong, and that it is used again after as many samples without contradiction."""
    straight, rising = replace(STRAIGHT, lateral_acceleration=0.0), [0.05 * k for k in range(20)]
    agreement = 1.0 / 16.0
    cases = {
        "a jump": ([2.001], 0.0, True),
        "no jump": ([2.0], 0.0, False),
        "as far away as allowed": ([1.0] * 200, 0.0, False),
        "away for long": ([1.001] * 49, 0.0, False),
        "away for too long": ([1.001] * 50, 0.0, True),
        "not confirmed by the angles": ([1.9] * 200, -0.1, False),
    }
    for (case, (values, rear, is_wrong)), side in itertools.product(cases.items(), (1.0, -1.0)):
        unit = Unit(built, judges_lateral=True, rear_angle_max=0.2, yaw_rate_agreement=agreement, recovery_samples=10)
        held = replace(straight, rear_angle=side * rear)
        unit.step(held)
        unit.run(replace(held, lateral_acceleration=side * (value + 1e-5 * (k % 2))) for k, value in enumerate(values))
        assert unit.state.lateral_is_wrong == is_wrong, case
        if is_wrong:
            assert unit.checked.lateral_acceleration == 0.0, "speed times yaw rate instead"
            unit.run([replace(held, lateral_acceleration=side * 0.9)] * 49)
            assert unit.state.lateral_is_wrong, case
            unit.step(replace(held, lateral_acceleration=side * 0.9))
            assert not unit.state.lateral_is_wrong, case
    for value in (0.0, math.nan):  # constant to the bit while the yaw rate that the angles confirm moves away, or missing
        unit = Unit(built, judges_lateral=True, yaw_rate_agreement=agreement)
        for yaw_rate in rising:
            front = yaw_rate / 8.0
            unit.step(replace(straight, front_angle=front, yaw_rate=yaw_rate, lateral_acceleration=value))
            frozen = yaw_rate > agreement + 0.05 and value == 0.0
            assert unit.state.lateral_is_wrong or not frozen, yaw_rate
            assert not (unit.state.lateral_is_wrong and yaw_rate <= agreement), yaw_rate


def check_front_angle_while_the_yaw_rate_is_away(built: Built) -> None:
    """Check that agreement before a gap of the yaw rate does not count for the turn in which it returns."""
    controller, turn = _turning_with_lateral_acceleration(
        built, front_angle_step=3.0, yaw_rate_step=40.0, yaw_rate_max=20.0, yaw_rate_frozen=0.05
    )
    yaw_rate = 0.12 * _gain(built, 16.0)
    turn = replace(turn, front_angle=0.12, yaw_rate=yaw_rate, lateral_acceleration=16.0 * yaw_rate)
    controller.run([turn] * 300 + [replace(turn, yaw_rate=math.nan)] * 20)
    controller.run([replace(turn, yaw_rate=0.2 * yaw_rate, lateral_acceleration=3.2 * yaw_rate)] * 30)
    assert (controller.state.inputs.yaw_rate.source, controller.state.inputs.front_angle.source) == (0, 0)


HARDLY_TURNS = "to the other side, and the acceleration hardly turns"
"""A contradiction with a reference model alone."""
CONTRADICTIONS: dict[str, tuple[tuple[float, float, float], bool, bool]] = {
    "three quarters": ((0.375, 1 / 16, 8.0), False, False),
    "less": ((0.3749, 1 / 16, 8.0), True, False),
    "less than the front angle alone": ((0.3749, 1 / 16, 7.0), False, False),
    "less than the acceleration alone": ((0.3749, 7 / 128, 8.0), False, False),
    "to the other side": ((-0.25, 1 / 16, 8.0), True, True),
    "to the other side than the front angle alone": ((-0.25, 1 / 16, -4.0), False, False),
    "to the other side than the acceleration alone": ((-0.25, -1 / 32, 8.0), False, False),
    "to the other side than the front angle, less than the acceleration": ((0.25, -1 / 16, 8.0), True, False),
    "a small turn": ((-1 / 64, 1 / 512, 0.25), False, False),
    "a turn just large enough": ((-2.01 / 64, 1 / 256, 0.51), True, True),
    HARDLY_TURNS: ((-0.25, 1 / 16, 0.25), True, True),
    "no turn": ((-1 / 16, 0.0, 0.0), False, False),
    "no acceleration": ((-0.25, 1 / 16, math.nan), False, False),
}
"""Yaw rate, front angle and lateral acceleration at 16 m/s, and whether that yaw rate is wrong: if it has not agreed with the
acceleration in this turn, and if it has."""


def check_yaw_rate_that_contradicts_the_others(built: Built) -> None:
    """Check that a yaw rate is wrong if front angle and lateral acceleration contradict it for `recovery_samples`."""
    for (case, (signals, *wrong)), has_agreed, side in itertools.product(CONTRADICTIONS.items(), (False, True), (1.0, -1.0)):
        unit = Unit(built, yaw_rate_agreement=1.0 / 64.0, yaw_rate_frozen=20.0, recovery_samples=10)
        wrong = (
            wrong if unit.model else [wrong[True] and case != HARDLY_TURNS] * 2
        )  # without a model only the other side counts
        yaw_rate, front_angle, lateral = (side * value for value in signals)
        turn = Measurement(16.0, front_angle, yaw_rate, 0.0, lateral_acceleration=lateral)
        right = replace(turn, yaw_rate=8.0 * front_angle)
        for between in (replace(turn, yaw_rate=math.nan), right, None):  # a missing or right one restarts the count
            if unit.model:
                unit.state.turn_is_confirmed = has_agreed
            unit.run([turn] * 9)
            assert unit.state.yaw_rate.source == 0, case
            unit.step(between or turn)
        assert (unit.state.yaw_rate.source == WRONG) == wrong[has_agreed], (case, has_agreed)
        unit.step(right)
        assert (unit.state.yaw_rate.source == WRONG) == wrong[has_agreed], "one sample proves nothing"


def check_agreement_in_a_turn_is_forgotten_after_it(built: Built) -> None:
    """Check that a turn is confirmed by a yaw rate that agrees with the lateral acceleration, until that shows none."""
    unit = Unit(built, yaw_rate_agreement=1.0 / 64.0, yaw_rate_frozen=20.0)
    if not unit.model:
        return
    unit.step(STRAIGHT)
    steps = (
        (0.5, 0.5, True),
        (0.5, 1.1 / 64, True),
        (0.5, 1.0 / 64, False),
        (2.0 / 64, 2.0 / 64, False),
        (2.1 / 64, 3.2 / 64, False),
    )
    for yaw_rate, turn, is_confirmed in (*steps, (2.1 / 64, 2.1 / 64, True), (0.0, 0.0, False)):
        unit.step(Measurement(16.0, turn / 8.0, yaw_rate, 0.0, lateral_acceleration=16.0 * turn))
        assert unit.state.turn_is_confirmed == is_confirmed, (yaw_rate, turn)


def check_yaw_rate_of_a_car_whose_wheels_are_straight(built: Built) -> None:
    """Check that a front angle of zero contradicts no yaw rate."""
    unit = Unit(built)
    unit.run([replace(STRAIGHT, yaw_rate=-0.07, lateral_acceleration=2.0)] * 30)
    assert (unit.state.expected_yaw_rate, unit.state.yaw_rate.source) == (0.0, 0)


def check_count_against_the_yaw_rate_ends_with_a_jump(built: Built) -> None:
    """Check that a jump resets the count of samples that contradict the yaw rate."""
    controller, turn = _turning_with_lateral_acceleration(built, yaw_rate_step=0.5)
    needed = controller.parameters.inputs.recovery_samples
    controller.run([replace(turn, yaw_rate=-0.07)] * (needed - 2) + [replace(turn, yaw_rate=-1.0)])
    signal = controller.state.inputs.yaw_rate
    assert (signal.source, signal.good) == (WRONG, 0)


OFFSET_CASES: dict[str, tuple[Measurement, float, float]] = {
    "no lateral acceleration": (Measurement(16.0, 0.0, 0.125, 0.0), 1 / 1024, 0.0),
    "the largest offset": (Measurement(16.0, 0.0, 0.25, 0.0), 1 / 512, 0.0),
    "a disturbance": (Measurement(16.0, 0.0, 0.2501, 0.0), 0.0, 0.0),
    "5 m/s": (Measurement(5.0, 0.0, 0.125, 0.0), 1 / 1024, 0.0),
    "slower": (Measurement(4.99999, 0.0, 0.125, 0.0), 0.0, 0.0),
    "the rear wheels turn": (Measurement(16.0, 0.0, 0.25, -1 / 128), 0.1875 / 128, 0.0),
    "yaw rate alone": (Measurement(16.0, 0.0, 0.125, 0.0, lateral_acceleration=0.0), 1 / 64, 0.0),
    "lateral acceleration alone": (Measurement(16.0, 0.0, 0.0, 0.0, lateral_acceleration=1.0), 0.0, 3 / 8),
    "both alike": (Measurement(16.0, 0.0, 0.125, 0.0, lateral_acceleration=2.0), 1 / 1024, 1 / 64),
    "more yaw rate": (Measurement(16.0, 0.0, 0.125, 0.0, lateral_acceleration=1.0), 1 / 128 + 1 / 2048, 1 / 128),
    "more acceleration": (Measurement(16.0, 0.0, 0.125, 0.0, lateral_acceleration=3.0), 1 / 1024, 3 / 8 + 1 / 64),
    "to different sides": (Measurement(16.0, 0.0, 0.125, 0.0, lateral_acceleration=-1.0), 1 / 64, -3 / 8),
    "a turn": (Measurement(16.0, 1 / 32, 0.25, 0.0, lateral_acceleration=5.0), 0.0, 0.006),
    "a turn, a small difference": (Measurement(16.0, 1 / 32, 0.25, 0.0, lateral_acceleration=3.998), 0.0, -0.002),
    "a turn without lateral acceleration": (Measurement(16.0, 1 / 32, 0.375, 0.0), 0.0, 0.0),
    "just straight": (Measurement(16.0, 1 / 128, 0.1875, 0.0, lateral_acceleration=1.0), 1 / 64, 0.0),
    "no longer straight": (Measurement(16.0, 1.0001 / 128, 0.125, 0.0, lateral_acceleration=3.0), 0.0, 0.006),
    "lateral acceleration out of range": (Measurement(16.0, 0.0, 0.125, 0.0, lateral_acceleration=200.0), 1 / 1024, 0.0),
}
"""Sample, and the offsets of yaw rate and lateral acceleration that it teaches.

They are an eighth of what only the yaw rate shows, three eighths of what only the lateral acceleration shows, and a sixteenth
of an eighth of the rest; in turns, what only the lateral acceleration shows, up to 0.6 m/s^3.
"""


def check_offset_of_yaw_rate_and_lateral_acceleration(built: Built) -> None:
    """Check that the offsets are learned from each other, up to their bounds, and subtracted.

    What both show alike is learned slowly, and a difference above the largest offset not at all. Nor is one while a signal is
    missing or another system inhibits the law.
    """
    settings = {"yaw_rate_correction_share": 0.125, "straight_yaw_rate": 0.0625, "yaw_rate_max": 0.5}
    settings |= {"yaw_rate_offset_max": 0.25, "lateral_acceleration_offset_max": 4.0, "missing_samples_max": 2}
    for (case, (sample, yaw_rate, lateral)), side in itertools.product(OFFSET_CASES.items(), (1.0, -1.0)):
        unit = Unit(built, **settings)
        numbers = ("front_angle", "yaw_rate", "rear_angle", "lateral_acceleration")
        sample = replace(sample, **{name: side * getattr(sample, name) for name in numbers})
        unit.step(sample)
        found = (unit.state.yaw_rate_offset, unit.state.lateral_acceleration_offset)
        exact = (side * yaw_rate, side * lateral)
        assert all(abs(got - wanted) <= 4.0 * built.eps for got, wanted in zip(found, exact, strict=True)), (case, found)
        unit.run([replace(sample, speed=math.nan), replace(sample, inhibit=True)])
        assert (unit.state.yaw_rate_offset, unit.state.lateral_acceleration_offset) == found, case
        unit.step(sample)
        if not math.isnan(sample.lateral_acceleration) and abs(sample.lateral_acceleration) < 100.0:
            learned = found[1]  # before this sample
            assert abs(unit.checked.lateral_acceleration - (sample.lateral_acceleration - learned)) <= 32.0 * built.eps, case
        wanted = built.real(sample.yaw_rate) - built.real(unit.state.yaw_rate_offset)
        assert unit.checked.yaw_rate == float(wanted), case
    for lateral, yaw_rate_offset, lateral_offset in (
        *((math.nan, 0.125, 0.0), (0.0, 0.125, 0.0), (2.0, 0.125, 2.0), (6.0, 0.125, 4.0), (-6.0, 0.125, -4.0)),
    ):
        unit = Unit(built, **settings)
        unit.run([replace(STRAIGHT, yaw_rate=0.125, lateral_acceleration=lateral)] * 4_000)
        assert abs(unit.state.yaw_rate_offset - yaw_rate_offset) <= 128.0 * built.eps * 0.125  # half a unit over 128 samples
        assert abs(unit.state.lateral_acceleration_offset - lateral_offset) <= 256.0 * built.eps, lateral
        learned = (unit.state.yaw_rate_offset, unit.state.lateral_acceleration_offset)
        unit.step(replace(STRAIGHT, yaw_rate=0.0))
        is_known = not math.isnan(lateral)
        is_held = (unit.state.yaw_rate_offset, unit.state.lateral_acceleration_offset) == learned
        assert is_held == is_known, "a lateral acceleration that is known, but missing"
        unit.step(replace(STRAIGHT, yaw_rate=-0.45))
        assert unit.checked.yaw_rate == -0.5, "within its range"


def check_speed_against_the_lateral_acceleration(built: Built) -> None:
    """Check that in a turn a speed that contradicts lateral acceleration and front angle is wrong after 15 `recovery_samples`.

    Its substitute follows the turn. A value exactly at a limit is no fault.
    """
    exact = {"yaw_rate_agreement": 1.0 / 64.0, "speed_agreement": 1.0, "yaw_rate_correction_share": 0.125, "speed_fall": 0.0}
    cases: tuple[tuple[dict[str, float], dict[str, float], bool], ...] = (
        ({}, {"speed": 12.0}, True),
        ({}, {"speed": 12.0, "lateral_acceleration": math.nan}, False),
        ({}, {"lateral_acceleration": 6.0}, False),  # a tilted road
        ({}, {"speed": 12.0, "lateral_acceleration": 6.0}, False),
        ({"speed_agreement": 4.0}, {"speed": 12.0}, False),
        ({"speed_agreement": 3.99}, {"speed": 20.0}, True),
        ({"yaw_rate_agreement": 0.0625}, {"speed": 12.0}, False),
        ({"yaw_rate_agreement": 0.0624}, {"speed": 12.0}, True),
        ({"yaw_rate_agreement": 0.03125}, {"speed": 12.0, "yaw_rate": 0.0625, "lateral_acceleration": 1.0}, False),  # no turn
        ({"speed_max": 34.0}, {"speed": 30.0, "front_angle": 0.0125, "lateral_acceleration": 10.0}, True),
    )
    for settings, changes, is_wrong in cases:
        unit = Unit(built, **exact | settings)
        inputs, parameters = unit.state, unit.parameters
        count = 15 * parameters.inputs.recovery_samples
        turn = replace(Measurement(16.0, 0.03125, 0.25, 0.0, lateral_acceleration=4.0), **changes)  # type: ignore[arg-type]
        unit.step(turn)
        for samples in (count - 1, 1):
            assert inputs.speed.source == 0, (settings, changes)
            inputs.lateral_is_proven = True
            unit.run([turn] * samples)
        assert (inputs.speed.source == WRONG, inputs.speed.good) == (is_wrong, 0 if is_wrong or changes else count), changes
        if is_wrong:
            assert inputs.speed.value == min(turn.lateral_acceleration / turn.yaw_rate, parameters.inputs.speed_max)
        if is_wrong and "speed_max" not in settings:
            unit.step(replace(turn, front_angle=0.0625, lateral_acceleration=2.0))
            assert inputs.speed.value == 15.0
            unit.step(replace(turn, front_angle=0.03125, lateral_acceleration=8.0))
            assert inputs.lateral_is_proven and inputs.speed.value == 15.0
    wrong = Measurement(12.0, 0.03125, 0.25, 0.0, lateral_acceleration=4.0)
    for case in ("unproven", "agrees between", "lost"):
        unit = Unit(built, **exact | {"yaw_rate_agreement": 1.0 / 256.0})
        inputs, most = unit.state, unit.parameters.inputs.missing_samples_max
        unit.step(wrong)
        inputs.lateral_is_proven = case != "unproven"
        unit.run([wrong] * (5 if case == "lost" else count - 1))
        speeds = {"unproven": (12.0, 12.0), "agrees between": (15.5, 12.0)}.get(case, (math.nan,) * (most + 1))
        unit.run([replace(wrong, speed=speed) for speed in speeds])
        assert (inputs.speed.source, inputs.speed.good) == {"lost": (1, 0), "unproven": (0, 0)}.get(case, (0, 1)), case
    unit = Unit(built, **exact | {"recovery_samples": 4_000})
    unit.step(wrong)
    unit.state.lateral_is_proven = True
    unit.state.speed.good = 59_998
    for source in (0, WRONG):
        unit.step(wrong)
        assert unit.state.speed.source == source, "the largest count fits its type"
