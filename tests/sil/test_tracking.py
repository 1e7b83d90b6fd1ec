"""The kind "tracking": against an independent model bit for bit, and what each of its parts does; the two baselines."""

from __future__ import annotations

import math

import numpy as np
import pytest

from codegen.config import Kind
from codegen.emit.text import Precision
from codegen.sil.software import Measurement, Status
from codegen.vehicle.single_track import SingleTrack
from tests import builds
from tests.builds import Built
from tests.sil import checks_kinds, checks_reference, checks_tracking, units

KINDS: tuple[Kind, ...] = ("tracking", "feedforward", "proportional")
LOW_ANGLE = {"rear_angle_max": 0.02, "limiter": {"rear_angle_max": 0.02, "opposite_phase_max": [0.02, 0.01]}}
CHANGES = {
    "as built": {},
    "no rate limit": {"rear_rate_max": 1000.0},
    "slow": {"rear_rate_max": 0.03, "limiter": {"rear_rate_max": 0.02}},
    "strict supervision": {"degraded_samples_max": 0, "recovery_samples": 1, "implausible_samples_max": 0},
}


@pytest.fixture(scope="module", params=builds.PRECISIONS)
def tracking(request: pytest.FixtureRequest) -> Built:
    """In single and in double precision."""
    return builds.of_kind("tracking", request.param)


@pytest.mark.parametrize("precision", builds.PRECISIONS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_every_sample_is_that_of_the_independent_model(kind: Kind, precision: Precision, changes: dict[str, float]) -> None:
    checks_kinds.check_kind_same_as_model(builds.of_kind(kind, precision), changes, 1500, 7)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["stack", "rough stack"])
def test_a_stack_of_maps_behind_every_kind(kind: Kind, name: str) -> None:
    """The estimate of the friction goes through the layers, in the model as in the C."""
    for precision in builds.PRECISIONS:
        built = builds.make(units.MAPS[name](), builds.CONFIGS[kind], precision)
        assert built.software.selftest()
        checks_kinds.check_kind_same_as_model(built, {}, 1500, 3)
        checks_kinds.check_kind_always_bounded(built, 5_000, 4)


@pytest.mark.parametrize("kind", ["feedforward", "proportional"])
def test_a_demand_beyond_the_angle_s_limit_shows_in_the_status(kind: Kind) -> None:
    checks_kinds.check_kind_same_as_model(builds.of_kind(kind), LOW_ANGLE)


def test_every_limit_acts_as_in_the_independent_model(tracking: Built) -> None:
    checks_tracking.check_tracking_same_as_model(tracking)


@pytest.mark.parametrize("kind", builds.CONFIGS)
def test_nothing_that_arrives_leads_out_of_bounds(kind: Kind) -> None:
    for precision in builds.PRECISIONS:
        checks_kinds.check_kind_always_bounded(builds.of_kind(kind, precision))


def test_without_gains_it_is_the_map_s_rear_angle(tracking: Built) -> None:
    checks_tracking.check_feedforward(tracking)


def test_the_map_is_looked_up_ahead_of_the_front_wheels(tracking: Built) -> None:
    checks_tracking.check_lead(tracking)


def test_the_gains_follow_the_schedule(tracking: Built) -> None:
    checks_tracking.check_gain_schedule(tracking)


def test_feedback_adds_little_where_it_turns_the_car_more(tracking: Built) -> None:
    checks_tracking.check_authority(tracking)


def test_the_command_leaves_its_limit_in_one_sample(tracking: Built) -> None:
    checks_tracking.check_tracking_anti_windup(tracking)


def test_a_stuck_actuator_does_not_wind_the_integral_up(tracking: Built) -> None:
    checks_tracking.check_tracking_stuck_actuator(tracking)


def test_the_rate_limit_does_not_wind_the_integral_up(tracking: Built) -> None:
    checks_tracking.check_tracking_rate_limit(tracking)


def test_the_reference_is_drawn_to_the_map_s(tracking: Built) -> None:
    checks_reference.check_trim(tracking)


def test_the_reference_is_bounded_by_the_road(tracking: Built) -> None:
    checks_reference.check_road_limit(tracking)


def test_the_grip_follows_what_the_car_reaches(tracking: Built) -> None:
    checks_reference.check_grip(tracking)


def test_an_estimate_of_friction_is_taken(tracking: Built) -> None:
    checks_reference.check_estimate(tracking)


def test_inhibit_holds_integral_and_grip(tracking: Built) -> None:
    checks_tracking.check_tracking_inhibit(tracking)


def test_a_start_is_bumpless(tracking: Built) -> None:
    checks_tracking.check_tracking_bumpless(tracking)


def test_after_a_gap_the_law_begins_afresh(tracking: Built) -> None:
    checks_tracking.check_restart(tracking)


def test_the_limiter_shows_in_the_status(tracking: Built) -> None:
    checks_tracking.check_limiter_is_told(tracking)


@pytest.mark.parametrize("speed", [0.0, -0.0, 1e-40, -1e-40, 1e-30, 0.01])
@pytest.mark.parametrize("kind", builds.CONFIGS)
def test_control_that_goes_down_to_standstill_stays_finite(kind: Kind, speed: float) -> None:
    """Parameters with a disabling speed of zero, as far as they are valid: zero has two signs."""
    built = builds.of_kind(kind)
    software = built.software
    parameters = software.parameters(disable_speed=0.0)
    if software.function("parameters_valid")(parameters):
        controller = software.controller(0.01, parameters)
        controller.step(Measurement(10.0, 0.0, 0.0))
        for _ in range(3):
            command = controller.step(Measurement(speed, 0.05, 0.1))
            assert math.isfinite(command.yaw_rate_reference)
            assert math.isfinite(command.rear_angle)
        assert math.isfinite(getattr(controller.state, "integral", 0.0))


class TestBaselines:
    """What feedback is measured against."""

    @staticmethod
    def settled(kind: Kind, speed: float, front: float) -> float:
        """rad, after the rate limits."""
        commands = builds.of_kind(kind).software.controller().run([Measurement(speed, front, 0.0)] * 40)
        assert commands[-1].status is Status.TRACKING
        return commands[-1].rear_angle

    @pytest.mark.parametrize("side", [1.0, -1.0])
    def test_feedforward_is_the_optimum_s_own_rear_angle(self, side: float) -> None:
        built = builds.of_kind("feedforward")
        for speed in (6.0, 10.0, 20.0, 33.0):
            for front in (0.005, 0.02):
                wanted = side * float(built.lookup.reference(speed, front)[1])
                assert self.settled("feedforward", speed, side * front) == wanted

    @pytest.mark.parametrize("side", [1.0, -1.0])
    def test_proportional_leaves_the_steady_linear_car_no_sideslip(self, side: float) -> None:
        car = SingleTrack.from_config(builds.CONFIGS["proportional"])
        for speed in (6.0, 10.0, 20.0, 33.0):
            rear = self.settled("proportional", speed, side * 0.02)
            yaw_rate = float(car.yaw_gain(speed)) * (side * 0.02 - rear)
            sideslip = rear + yaw_rate * float(car.sideslip_per_yaw_rate(speed))
            assert abs(sideslip) < 2e-8  # ten roundings at the size of the angles
            assert abs(yaw_rate) > 0.01

    @pytest.mark.parametrize("kind", ["feedforward", "proportional"])
    def test_the_rate_limit_acts(self, kind: Kind) -> None:
        software = builds.of_kind(kind).software
        commands = software.controller().run([Measurement(8.0, 0.05, 0.0)] * 5)
        steps = np.diff([0.0, *(command.rear_angle for command in commands)])
        travel = software.parameters().rear_rate_max * 0.01
        assert np.abs(np.abs(steps) - travel).max() < 1e-8
        assert {command.status for command in commands} == {Status.LIMITED}
