"""What must hold of every kind of controller. Each check takes a build and raises AssertionError where it does not."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from codegen.config import Config
from codegen.sil.software import Status
from codegen.verify.law.controller import SecondController
from codegen.verify.law.kinds import second_controller
from tests.builds import Built
from tests.sil.checks_supervision import random_measurements


def config_of(built: Built) -> Config:
    """What the build was made for."""
    return built.software.config


def parameters_of(built: Built, changes: Mapping[str, Any] | None = None) -> Any:
    """The default parameters with some changed; those of the limiter as a mapping under `limiter`. All of them valid."""
    plain = dict(changes or {})
    limiter = plain.pop("limiter", {})
    parameters = built.software.parameters(**plain)
    for name, value in limiter.items():
        setattr(parameters.limiter, name, value)
    assert built.software.function("parameters_valid")(parameters), changes
    return parameters


def open_limiter(built: Built) -> dict[str, Any]:
    """A limiter that only bounds the angle."""
    parameters = built.software.parameters()  # owns the limiter's
    limiter = parameters.limiter
    bounds = [limiter.rear_angle_max] * len(list(limiter.opposite_phase_max))
    return {"rear_rate_max": 1000.0, "opposite_phase_max": bounds, **WIDE}


def model_of(built: Built, parameters: Any, start: float) -> SecondController:
    """The second implementation of the build's kind."""
    return second_controller(config_of(built), parameters, built.lookup, built.total, start)


WIDE = {"speed_max": 200.0, "front_angle_max": 1.5}
"""Ranges of a limiter that takes every input that a controller may."""
EXTREMES: dict[str, Mapping[str, Any]] = {
    "as built": {},
    "fast": {"rear_rate_max": 1000.0, "limiter": {"rear_rate_max": 1000.0}},
    "slow": {"rear_rate_max": 0.01, "rear_angle_error_max": 1e-4},
    "forgiving": {"grip_shortfall": 20.0, "grip_recovery": 100.0, "trim_share": 0.2, "trim_rate": 20.0},
    "wide inputs": {
        "yaw_rate_tolerance": 20.0,
        "front_angle_max": 1.5,
        "speed_max": 200.0,
        "yaw_rate_max": 20.0,
        "limiter": WIDE,
    },
}


def check_kind_always_bounded(built: Built, count: int = 20_000, seed: int = 0) -> None:
    """Whatever arrives, the command is finite and within its limit, and so is everything that the state keeps."""
    software, ffi = built.software, built.software.ffi
    rng = np.random.default_rng(seed)
    names = {*dir(software.parameters())}
    seen: set[int] = set()
    for changes in EXTREMES.values():
        parameters = parameters_of(built, {name: value for name, value in changes.items() if name in names})
        controller = software.controller(0.02, parameters)
        samples = random_measurements(built, rng, count)
        commands = ffi.new("ars_command_t[]", 50)
        for first in range(0, count, 50):
            software.compiled.lib.loop_controller(controller.state, parameters, samples + first, commands, 50)
            for command in commands:
                assert -parameters.rear_angle_max <= command.rear_angle <= parameters.rear_angle_max
                assert abs(command.yaw_rate_reference) < 1e3
                seen.add(command.status)
            _check_state(built, controller.state, parameters)
    assert seen == {status.value for status in Status}


def _check_state(built: Built, state: Any, parameters: Any) -> None:
    """What is kept between steps is finite and bounded."""
    assert abs(state.rear_angle) <= parameters.rear_angle_max
    assert state.limiter.rear_angle == state.rear_angle
    assert 0.0 <= state.limiter.speed <= parameters.limiter.speed_max
    assert abs(state.limiter.front_angle) <= parameters.limiter.front_angle_max
    kind = config_of(built).controller.kind
    if kind == "pi":
        largest = float(built.total.yaw_rate.max()) + parameters.yaw_rate_max
        assert abs(state.integral) <= 1.000001 * (parameters.rear_angle_max + parameters.proportional_gain * largest)
    if kind == "tracking":
        largest = parameters.yaw_rate_max + 20.0 + max(abs(state.yaw_rate_reference), float(built.total.yaw_rate.max()))
        assert abs(state.trim) <= 1.001 * parameters.trim_share * float(built.total.yaw_rate.max())
        most = 2.0 * parameters.rear_angle_max + max(parameters.proportional_gain) * largest
        assert abs(state.integral) <= 1.01 * most
        assert 0.0 < state.grip <= built.total.lateral_acceleration_cap * (1.0 + built.eps)
