"""The generated supervision: which inputs are taken, standby, short gaps, the fail-safe and the way out of it; parameters."""

from __future__ import annotations

import math
from typing import Any

import pytest

from codegen.config import Kind
from codegen.emit.controller_view import controller_view
from codegen.emit.text import Precision
from codegen.sil.software import Measurement, Status
from tests import builds
from tests.builds import Built
from tests.sil import checks_supervision
from tests.sil.checks_supervision import FAIL_SAFE, LOST, lost_at


def test_every_input_is_taken_to_its_limit_and_refused_beyond(either: Built) -> None:
    checks_supervision.check_inputs(either)


def test_a_signalling_nan_is_refused_like_any_other(paper: Built) -> None:
    software = paper.software
    for field in ("speed", "front_angle", "yaw_rate"):
        controller = software.controller()
        sample = software.new("measurement")
        sample[0] = (15.0, 0.0, 0.0, math.nan, math.nan, False)
        offset = software.ffi.offsetof(software.ffi.typeof(sample).item, field)
        software.ffi.memmove(software.ffi.cast("char *", sample) + offset, (0x7F800001).to_bytes(4, "little"), 4)
        command = software.function("controller_step")(controller.state, controller.parameters, sample)
        assert command.status == Status.DEGRADED, field


def test_a_yaw_rate_is_plausible_between_none_and_the_kinematic_turn(either: Built) -> None:
    checks_supervision.check_plausibility_limit(either)


def test_the_fail_safe_holds_from_its_speed_on(either: Built) -> None:
    checks_supervision.check_fail_safe_at_the_hold_speed(either)


def test_a_start_at_no_angle(either: Built) -> None:
    checks_supervision.check_start_at_no_angle(either)


def test_a_limit_in_a_gap_does_not_hide_the_gap(either: Built) -> None:
    checks_supervision.check_limiter_in_a_gap(either)


def test_an_implausible_yaw_rate_is_held_for_the_set_time_and_no_longer(either: Built) -> None:
    checks_supervision.check_plausibility_time(either)


@pytest.mark.parametrize("speed", [15.0, 30.0])
def test_a_short_gap_holds_the_command_and_a_longer_one_is_the_fail_safe(either: Built, speed: float) -> None:
    checks_supervision.check_gap(either, speed)


def test_a_gap_from_the_very_first_sample_ends_in_the_fail_safe(either: Built) -> None:
    """With no speed ever seen the car may be fast, as after a reset in a corner: the fail-safe holds the angle."""
    controller = either.software.controller(0.05)
    commands = controller.run([LOST] * 20)
    gap = FAIL_SAFE.degraded_samples_max
    assert [command.status for command in commands] == [Status.DEGRADED] * gap + [Status.FAIL_SAFE] * (20 - gap)
    assert {command.rear_angle for command in commands} == {float(either.software.real(0.05))}


def test_every_set_of_valid_parameters_ends_a_lasting_gap_in_the_fail_safe(paper: Built) -> None:
    """The count of lost samples must be able to pass its limit, however large the limit is."""
    software = paper.software
    for most in (1000, 2**16 - 2, 2**16 - 1):
        parameters = software.parameters(degraded_samples_max=most)
        if software.function("parameters_valid")(parameters):
            controller = software.controller(0.0, parameters)
            assert controller.run([LOST] * (2**16 + 10))[-1].status is Status.FAIL_SAFE, most


def test_the_fail_safe_holds_the_angle_at_speed(either: Built) -> None:
    checks_supervision.check_fail_safe_hold(either)


def test_the_fail_safe_ramps_to_zero_below_the_slower_the_faster_the_car(either: Built) -> None:
    checks_supervision.check_fail_safe_ramp(either)


def test_the_fail_safe_goes_by_the_last_good_speed(either: Built) -> None:
    checks_supervision.check_last_speed(either)


def test_the_fail_safe_ends_after_enough_good_samples_in_a_row_without_a_jump(either: Built) -> None:
    checks_supervision.check_recovery(either)


def test_standby_follows_the_signed_speed_with_hysteresis(either: Built) -> None:
    checks_supervision.check_standby(either)


def test_a_gap_in_standby_holds_too_and_standby_goes_on(either: Built) -> None:
    controller = either.software.controller(0.05)
    standing = Measurement(0.0, 0.0, 0.0)
    before = controller.run([standing] * 3)[-1]
    held = controller.run([lost_at(0.0)] * 2)
    after = controller.step(standing)
    assert [command.rear_angle for command in held] == [before.rear_angle] * 2
    assert after.status is Status.STANDBY
    assert 0.0 < after.rear_angle < before.rear_angle


@pytest.mark.parametrize("seed", [0, 1])
def test_nothing_that_arrives_leads_out_of_bounds(either: Built, seed: int) -> None:
    checks_supervision.check_always_bounded(either, 50_000, seed)


COMPANIONS = {"rear_angle_max": {"rear_angle_input_max": 1.5}, "rear_angle_input_max": {"rear_angle_max": 1e-4}}
"""What a parameter at the end of its range needs of another."""

NO_ROOM = {("enable_speed", "low"), ("disable_speed", "high")}
"""The disabling speed must be below the enabling one, and at these ends it cannot."""


class TestParameters:
    """`parameters_valid`."""

    @staticmethod
    def valid(built: Built, **changes: Any) -> bool:
        """The limiter's angle goes down with the controller's, which it may not exceed."""
        software = built.software
        parameters = software.parameters(**changes)
        limiter = parameters.limiter
        if parameters.rear_angle_max < limiter.rear_angle_max:
            limiter.rear_angle_max = parameters.rear_angle_max
            for k in range(len(limiter.opposite_phase_max)):
                limiter.opposite_phase_max[k] = parameters.rear_angle_max
        return bool(software.function("parameters_valid")(parameters))

    @staticmethod
    def ranges(built: Built) -> dict[str, tuple[float, float]]:
        real = built.software.real
        precision = built.software.precision
        view = controller_view(builds.CONFIG, built.total, "ars", precision, "float")
        return {p.name: (float(real(p.low.rstrip("f"))), float(real(p.high.rstrip("f")))) for p in view.ranged}

    def test_the_defaults_are_valid(self, either: Built) -> None:
        assert self.valid(either)

    def test_every_number_has_a_range(self, either: Built) -> None:
        ffi = either.software.ffi
        fields = dict(ffi.typeof("ars_parameters_t").fields)
        numbers = {name for name, field in fields.items() if field.type.cname in ("float", "double")}
        assert numbers == set(self.ranges(either))
        assert fields.keys() - numbers == {*("implausible_samples_max", "degraded_samples_max", "recovery_samples", "limiter")}

    def test_each_is_taken_to_the_ends_of_its_range_and_refused_beyond(self, either: Built) -> None:
        for name, (low, high) in self.ranges(either).items():
            others = COMPANIONS.get(name, {})
            for end, value, beyond in (("low", low, -math.inf), ("high", high, math.inf)):
                assert self.valid(either, **{name: value}, **others) == ((name, end) not in NO_ROOM), name
                assert not self.valid(either, **{name: either.next(value, beyond)}, **others), name
            for nonsense in (math.nan, math.inf, -math.inf):
                assert not self.valid(either, **{name: nonsense}, **others), name

    def test_what_must_fit_together_does(self, either: Built) -> None:
        angle = float(either.software.parameters().rear_angle_max)
        assert self.valid(either, rear_angle_input_max=angle)
        assert not self.valid(either, rear_angle_input_max=either.next(angle, 0.0))
        assert not self.valid(either, rear_angle_max=either.next(angle, 1.0)), "more than the actuator can"
        assert self.valid(either, enable_speed=5.0, disable_speed=either.next(5.0, 0.0))
        assert not self.valid(either, enable_speed=5.0, disable_speed=5.0)
        assert self.valid(either, implausible_samples_max=2**16 - 2)
        assert not self.valid(either, implausible_samples_max=2**16 - 1), "its count could not pass it"
        assert self.valid(either, recovery_samples=1)
        assert not self.valid(either, recovery_samples=0), "a fail-safe that ends at once"

    def test_the_limiter_does_not_reach_beyond_the_controller(self, either: Built) -> None:
        software = either.software
        parameters = software.parameters()
        limiter = parameters.limiter
        limiter.rear_angle_max = either.next(parameters.rear_angle_max, 1.0)
        assert not software.function("parameters_valid")(parameters)
        limiter.rear_angle_max = parameters.rear_angle_max
        assert software.function("parameters_valid")(parameters)

    def test_the_limiter_s_are_judged_with_them(self, either: Built) -> None:
        software = either.software
        parameters = software.parameters()
        for name in dir(parameters.limiter):
            parameters = software.parameters()
            good = getattr(parameters.limiter, name)
            bad = math.nan if isinstance(good, float) else [math.nan] * len(list(good))
            setattr(parameters.limiter, name, bad)
            assert not software.function("parameters_valid")(parameters), name

    @pytest.mark.parametrize("name", ["schedule_speed", "proportional_gain", "integral_gain"])
    @pytest.mark.parametrize("precision", builds.PRECISIONS)
    def test_every_element_of_an_array_is_judged(self, name: str, precision: Precision) -> None:
        built = builds.of_kind("tracking", precision)
        good = list(getattr(built.software.parameters(), name))
        top = {"schedule_speed": 200.0, "proportional_gain": 10.0, "integral_gain": 100.0}[name]
        assert self.valid(built)
        for k in range(len(good)):
            for bad in (math.nan, math.inf, -math.inf, built.next(0.0, -1.0), built.next(top, math.inf)):
                assert not self.valid(built, **{name: [*good[:k], bad, *good[k + 1 :]]}), (k, bad)
            if name != "schedule_speed":
                for end in (0.0, top):
                    assert self.valid(built, **{name: [*good[:k], end, *good[k + 1 :]]}), (k, end)

    def test_the_schedule_rises(self) -> None:
        built = builds.of_kind("tracking")
        speeds = list(built.software.parameters().schedule_speed)
        assert self.valid(built, schedule_speed=[0.0, *speeds[1:-1], 200.0])
        for k in range(1, len(speeds)):
            assert not self.valid(built, schedule_speed=[*speeds[:k], speeds[k - 1], *speeds[k + 1 :]]), "two in one place"
            swapped = [*speeds[: k - 1], speeds[k], speeds[k - 1], *speeds[k + 1 :]]
            assert not self.valid(built, schedule_speed=swapped), k
            apart = built.next(speeds[k - 1], 1000.0)
            assert self.valid(built, schedule_speed=[*speeds[:k], apart, *speeds[k + 1 :]])

    @pytest.mark.parametrize("kind", ["tracking", "feedforward", "proportional"])
    def test_each_number_of_every_kind_has_its_range(self, kind: Kind) -> None:
        built = builds.of_kind(kind)
        view = controller_view(builds.CONFIGS[kind], built.total, "ars", "single", "float")
        real = built.software.real
        for parameter in view.ranged:
            low, high = (float(real(text.rstrip("f"))) for text in (parameter.low, parameter.high))
            for beyond in (built.next(low, -math.inf), built.next(high, math.inf), math.nan, math.inf):
                assert not self.valid(built, **{parameter.name: beyond}), parameter.name
