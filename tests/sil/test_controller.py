"""The generated control law: sign, gains, limits, anti-windup, bumpless starts; and the whole against an independent model."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.config import Config, Controller
from codegen.emit.text import literal
from codegen.sil.software import Measurement, Status
from tests import builds
from tests.builds import Built
from tests.sil import checks_control
from tests.sil.checks_control import RATE_LIMIT, ideal, run, unmeasured

BOTH_SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0])
CHANGES = {
    "as built": {},
    "rate limit": {"rear_rate_max": RATE_LIMIT},
    "slow actuator": {"rear_rate_max": math.radians(4.0), "rear_angle_error_max": 0.005},
    "strict supervision": {"degraded_samples_max": 0, "recovery_samples": 1, "implausible_samples_max": 0},
    "high gains": {"proportional_gain": 0.2, "integral_gain": 8.0},
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_every_sample_is_that_of_the_independent_model(either: Built, changes: dict[str, float]) -> None:
    checks_control.check_same_as_model(either, changes)


def test_too_little_yaw_rate_steers_the_rear_against_the_front(either: Built) -> None:
    checks_control.check_sign(either)


def test_gains_are_those_of_the_configuration(either: Built) -> None:
    checks_control.check_gains(either)


def test_a_lasting_error_ends_exactly_at_the_limit(either: Built) -> None:
    checks_control.check_saturation(either)


def test_the_command_is_within_its_limit_in_every_status(either: Built) -> None:
    checks_control.check_command_within_limit(either)


def test_every_set_of_valid_parameters_keeps_the_command_within_its_limit(either: Built) -> None:
    """A limiter that allows more than the controller, and a state beyond both: the promise is the controller's."""
    software = either.software
    parameters = software.parameters(rear_angle_max=0.02)
    if software.function("parameters_valid")(parameters):
        for first in (Measurement(math.nan, 0.0, 0.0), Measurement(15.0, 0.0, 0.0)):
            parameters.limiter.rear_rate_max = 0.1
            controller = software.controller(1.0, parameters)
            assert abs(controller.step(first).rear_angle) <= parameters.rear_angle_max


@BOTH_SIGNS
@pytest.mark.parametrize("actuator", [unmeasured, ideal])
@pytest.mark.parametrize("rate", [None, RATE_LIMIT], ids=["no rate limit", "rate limit"])
def test_the_command_leaves_its_limit_in_one_sample(
    either: Built, sign: float, actuator: checks_control.Actuator, rate: float | None
) -> None:
    checks_control.check_anti_windup(either, sign, actuator, rate)


def test_a_stuck_actuator_does_not_wind_the_integral_up(either: Built) -> None:
    checks_control.check_windup_by_a_stuck_actuator(either)


@BOTH_SIGNS
def test_the_rate_limit_does_not_wind_the_integral_up(either: Built, sign: float) -> None:
    checks_control.check_windup_by_the_rate_limit(either, sign)


def test_the_command_never_moves_faster_than_its_rate_limit(either: Built) -> None:
    checks_control.check_rate_limit(either)


def test_the_default_rate_limit_is_25_deg_s_and_the_paper_has_none() -> None:
    def rates(config: Config) -> list[str]:
        text = builds.render(builds.paper_map(), config).files["src/ars_calibration.c"].decode("ascii")
        return re.findall(r"\.rear_rate_max = ([^,]*),", text)

    assert rates(Config(controller=Controller(kind="pi"))) == [literal(math.radians(rate), "single") for rate in (25.0, 30.0)]
    assert rates(builds.CONFIG) == ["1000.0f", "1000.0f"], "of the controller, and of the limiter behind it"


def test_without_a_rate_limit_the_command_crosses_in_one_sample(either: Built) -> None:
    controller = either.software.controller(0.0, either.software.parameters(integral_gain=100.0))
    run(either, controller, [0.5] * 5)
    limit = controller.parameters.rear_angle_max
    assert checks_control.angles(run(either, controller, [-0.5]))[-1] == limit


@given(start=st.floats(-0.061, 0.061), error=st.floats(-0.5, 0.5))
def test_a_start_from_any_angle_is_bumpless(start: float, error: float) -> None:
    checks_control.check_bumpless(builds.paper(), start, error)
    checks_control.check_bumpless(builds.paper("double"), start, error)


@pytest.mark.parametrize(("start", "held"), [(math.nan, 0.0), (1.0, 1.0), (-1.0, -1.0), (math.inf, 1.0), (-math.inf, -1.0)])
def test_a_start_from_an_impossible_angle_is_from_the_limit(either: Built, start: float, held: float) -> None:
    """NaN counts as zero, beyond the actuator's limit as the limit."""
    limit = float(either.software.real(builds.CONFIG.rear_actuator.angle_max))
    assert float(either.software.controller(start).state.rear_angle) == held * limit


def test_control_after_standby_starts_from_where_the_ramp_was(either: Built) -> None:
    controller = either.software.controller(0.05)
    for _ in range(20):
        standby = controller.step(either.turn(speed=4.0, front_angle=0.0))
    assert standby.status is Status.STANDBY
    assert 0.0 < standby.rear_angle < 0.05
    first = controller.step(either.turn(0.1))
    # One step of the integral, Ki T e = 0.001 rad.
    assert first.rear_angle == pytest.approx(standby.rear_angle - 0.001, abs=either.eps)


def test_inhibit_holds_the_integral(either: Built) -> None:
    checks_control.check_inhibit(either)


def test_an_estimate_of_friction_scales_the_reference(either: Built) -> None:
    checks_control.check_friction(either)


def test_two_instances_do_not_know_of_each_other(either: Built) -> None:
    checks_control.check_instances(either)
