"""Checks of every kind of controller. Each takes a build and raises AssertionError if the build fails it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.sil.software import Measurement, Status
from tests.builds import Built
from tests.oracle.controller import SecondController
from tests.oracle.kinds import second_controller


def config_of(built: Built) -> Config:
    """Return the configuration of the build."""
    return built.software.config


def parameters_of(built: Built, changes: Mapping[str, Any] | None = None) -> Any:
    """Return the valid default parameters with some changed; changes of `inputs` and `limiter` are mappings."""
    plain = dict(changes or {})
    structs = {name: plain.pop(name, {}) for name in ("inputs", "limiter")}
    parameters = built.software.parameters(**plain)
    for struct, values in structs.items():
        for name, value in values.items():
            setattr(getattr(parameters, struct), name, value)
    assert built.software.function("parameters_valid")(parameters), changes
    return parameters


def open_limiter(built: Built) -> dict[str, Any]:
    """Return parameters of a limiter that only bounds the angle."""
    parameters = built.software.parameters()  # owns the limiter's
    limiter = parameters.limiter
    bounds = [limiter.rear_angle_max] * len(list(limiter.opposite_phase_max))
    return {"rear_rate_max": 1000.0, "opposite_phase_max": bounds, **WIDE}


def model_of(built: Built, parameters: Any, start: float) -> SecondController:
    """Return the second implementation of the build's kind."""
    return second_controller(config_of(built), parameters, built.lookup, built.total, start)


OPEN: dict[str, Any] = {
    **{"speed_step": 200.0, "front_angle_step": 3.0, "yaw_rate_step": 40.0},
    **{"yaw_rate_frozen": 20.0, "yaw_rate_tolerance": 20.0, "lateral_acceleration_max": 100.0},
    **{"yaw_rate_offset_max": 0.0, "lateral_acceleration_offset_max": 0.0},
}
"""Input parameters that accept every value in range unchanged, for checks of the parts after the input monitoring."""
STILL: dict[str, Any] = {
    "inputs": {"yaw_rate_frozen": 20.0, "yaw_rate_offset_max": 0.0, "lateral_acceleration_offset_max": 0.0}
}
"""Input parameters for which a repeated sample is neither a fault nor an offset."""
WIDE = {"speed_max": 200.0, "front_angle_max": 1.5}
"""Limiter ranges that accept every input of a controller."""
EXTREMES: dict[str, Mapping[str, Any]] = {
    "as built": {},
    "fast": {"rear_rate_max": 1000.0, "limiter": {"rear_rate_max": 1000.0}},
    "slow": {"rear_rate_max": 0.02, "rear_angle_error_max": 0.002},
    "forgiving": {"grip_shortfall": 20.0, "grip_recovery": 100.0, "trim_share": 0.2, "trim_rate": 20.0},
    "open inputs": {"inputs": OPEN},
    "wide inputs": {"inputs": {**OPEN, **WIDE, "yaw_rate_max": 20.0}, "limiter": WIDE},
}


def check_kind_always_bounded(built: Built, count: int = 20_000, seed: int = 0) -> None:
    """Check that the command and all stored numbers are finite and bounded for any input."""
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
    if not config_of(built).controller.waits_for_speed:
        assert software.controller(0.02).step(Measurement(math.nan, 0.0, 0.0)).status is Status.STANDBY
        seen.add(Status.STANDBY)
    assert seen == {status.value for status in Status}


def _check_state(built: Built, state: Any, parameters: Any) -> None:
    """Check that the state between steps is finite and bounded."""
    assert abs(state.rear_angle) <= parameters.rear_angle_max
    assert state.limiter.rear_angle == state.rear_angle
    assert 0.0 <= state.limiter.speed <= parameters.limiter.speed_max
    assert abs(state.limiter.front_angle) <= parameters.limiter.front_angle_max
    kind, inputs, sample = config_of(built).controller.kind, parameters.inputs, state.sample
    for field in ("speed", "front_angle", "yaw_rate", "rear_angle"):
        assert abs(getattr(sample, field)) <= max(getattr(inputs, f"{field}_max"), parameters.rear_angle_max), field
    assert 0.0 <= sample.friction <= 2.0
    if kind == "pi":
        largest = float(built.total.yaw_rate.max()) + inputs.yaw_rate_max
        assert abs(state.law.integral) <= 1.000001 * (parameters.rear_angle_max + parameters.proportional_gain * largest)
    if kind == "tracking":
        largest = inputs.yaw_rate_max + 20.0 + max(abs(state.yaw_rate_reference), float(built.total.yaw_rate.max()))
        assert abs(state.law.trim) <= 1.001 * parameters.trim_share * float(built.total.yaw_rate.max())
        most = 2.0 * parameters.rear_angle_max + max(parameters.proportional_gain) * largest
        assert abs(state.law.integral) <= 1.01 * most
        assert 0.0 < state.grip.available <= built.total.lateral_acceleration_cap * (1.0 + built.eps)


def random_measurements(built: Built, rng: np.random.Generator, count: int) -> Any:
    """Return a C array of measurements; each field is plausible, at a limit, special, or any bit pattern."""
    software = built.software
    samples = software.ffi.new(f"{software.prefix}_measurement_t[]", count)
    numbers = [signal.role for signal in software.measured if signal.is_real]
    real: Any = software.real
    size = np.dtype(real).itemsize
    stride = software.ffi.sizeof(samples) // count
    rest = stride - len(numbers) * size - 1
    layout = np.dtype([("bits", f"u{size}", len(numbers)), ("inhibit", np.uint8), ("rest", np.uint8, rest)])
    view: npt.NDArray[Any] = np.frombuffer(software.ffi.buffer(samples), dtype=layout)
    parameters = software.parameters()
    limits = np.array([getattr(parameters.inputs, f"{field}_max") for field in numbers])
    special = np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 1e-40, 1e30, -1e30])
    shape = (count, len(numbers))
    kinds = [
        rng.uniform(-0.5, 0.5, shape) * limits,
        np.abs(rng.normal(0.0, 0.15, shape)) * limits,
        rng.choice([-1.0, 1.0], shape) * limits,
        rng.choice(special, shape),
        np.frombuffer(rng.bytes(count * len(numbers) * size), dtype=real).reshape(shape),
    ]
    weights = np.repeat(rng.choice([0, 1, 2], count // 50 + 1, p=[0.3, 0.4, 0.3]), 50)[:count]  # calm, rough and wild spells
    chances = np.array([[0.0, 1.0, 0.0, 0.0, 0.0], [0.1, 0.88, 0.005, 0.01, 0.005], [0.2, 0.2, 0.2, 0.2, 0.2]])
    pick = (rng.random((*shape, 1)) > np.cumsum(chances, axis=1)[weights][:, np.newaxis, :]).sum(axis=2).clip(0, 4)
    view["bits"] = np.choose(pick, [kind.astype(real).view(f"u{size}") for kind in kinds])  # copying may quieten a NaN
    view["inhibit"] = rng.random(count) < 0.1
    return samples
