"""View model of the controller: parameters with values, ranges and meaning, state, and known values for the self-test."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from codegen.configuration import Config
from codegen.configuration.controller import REAR_RATE_MIN_DEG_S
from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import Lookup
from codegen.emit.dynamics_view import model_state
from codegen.emit.inputs_view import inputs_parameters
from codegen.emit.laws import REAR_ANGLE_MAX_RAD, YAW_RATE_ERROR_MAX_RAD_S, law_of
from codegen.emit.limiter_view import limiter_parameters
from codegen.emit.parameters import (
    RATE_OFF,
    Field,
    Parameter,
    ParameterView,
    configured,
    parameter_views,
    rate_key,
    search_strides,
)
from codegen.emit.text import Precision, literal
from codegen.units import DEGREE, KM_H

INITIALISED = 0x41525331
"""Mark of an initialised state: not zero, and unlikely in memory that was not initialised."""

SQUARES_MAX = 1e12
"""Largest sum of squares of a valid state, in SI units. Each number of a valid state is far below the root of this value."""

INPUT_NUMBERS = (
    "speed.value",
    "front_angle.value",
    "yaw_rate.value",
    "expected_yaw_rate",
    "least",
    "least_of_front",
    "yaw_rate_offset",
    "lateral_acceleration_offset",
    "lateral_acceleration",
    "least_of_lateral",
    "beyond_linear",
    "friction",
    "longitudinal_acceleration",
)
"""Real numbers in the state of the monitoring of the inputs; the last one only where the signal exists."""

REWRITTEN = ("yaw_rate_reference",)
"""Real numbers in the state of the controller that a step writes before it reads them."""

TASK_SAMPLES_MAX = 60_000
"""Largest value of `actuator_samples_max` and `inhibit_samples_max`. The counters reach one more and must not overflow."""

REST_MIN = 0.01
"""Smallest denominator of the law "proportional", in m. That of a stable car exceeds the distance of its front axle."""

STANDING_SPEED = 0.1
"""m/s. Sensors of the speed have a resolution and noise below; a car that is slower counts as standing."""
SLOW_RATE = math.radians(1.9)
"""rad/s of the rear wheels of a slow car. A car that starts with turned wheels then changes its curvature in a second by less
than a fifth with 10 deg at the front, and by less than a tenth with 25 deg."""

SIDESLIP_RETURN, LEAD_LOSS, SIDESLIP_GAIN = 0.4, 3.0, 2.0
"""Of kind "tracking", in 1/s, - and 1/s. An offset of the acceleration of 0.1 m/s^2 at 100 km/h makes the observed sideslip
0.5 deg wrong. Healthy cars lead their lateral acceleration with little sideslip out of the turn."""

ESTIMATE_FACTOR = 1.25
"""Factor of kind "tracking" on a friction estimate from outside: 0.4 demands the turn of 0.5. The demand falls in proportion to
the friction, and the map leaves a part of the grip unused. Without it an exact estimate would turn the car less than none."""

REFERENCE_OVERSHOOT = 1.15
"""Largest yaw rate of the reference model, as a multiple of the yaw rate that the assumed friction allows."""

SELFTEST_TOLERANCE = 1e-5
"""Tolerance in rad/s. A fused multiply-add changes the lookup by a few units in the last place, a wrong cell by far more."""


@dataclass(frozen=True)
class ControllerView:
    """Everything that the controller's templates print."""

    parameters: tuple[ParameterView, ...]
    ranged: tuple[ParameterView, ...]
    ranged_arrays: tuple[ParameterView, ...]
    counts: tuple[ParameterView, ...]
    points: tuple[tuple[str, int], ...]
    search_strides: tuple[int, ...]
    state: tuple[Field, ...]
    law_state: tuple[Field, ...]
    grip_state: tuple[Field, ...]
    sample_ranges: Mapping[str, tuple[str, str]]
    command_max: str
    error_max: str
    numbers: tuple[str, ...]
    initialised: int
    squares_max: str
    sampling_time: str
    period_text: str
    actuator_angle_max: str
    rest_min: str
    standing_speed: str
    slow_rate: str
    reference_overshoot: float
    estimate_factor: float
    sideslip_return: str
    lead_loss: str
    sideslip_gain: str
    known: tuple[str, ...]
    selftest_tolerance: str


def controller_parameters(config: Config) -> tuple[Parameter, ...]:
    """Return the fields of `<prefix>_parameters_t` in order, without inputs and limiter. Raises BuildError: see `law_of`."""
    return (*law_of(config).parameters(config), *_common_parameters(config))


def parameters_by_path(config: Config) -> dict[str, Parameter]:
    """Return every number of `<prefix>_parameters_t` by its path in the struct, in order. Raises BuildError: see `law_of`."""
    structs = {"": controller_parameters(config), "inputs.": inputs_parameters(config), "limiter.": limiter_parameters(config)}
    return {f"{struct}{each.name}": each for struct, parameters in structs.items() for each in parameters}


def _common_parameters(config: Config) -> tuple[Parameter, ...]:
    controller = config.controller
    rate = controller.rear_rate_max_deg_s
    return (
        Parameter(
            "rear_angle_max",
            config.rear_actuator.angle_max,
            "rad, bound of the command, at most the actuator's largest angle",
            1e-4,
            config.rear_actuator.angle_max,
        ),
        Parameter(
            "rear_rate_max",
            RATE_OFF if rate == "off" else math.radians(rate),
            "rad/s, bound on the command's rate" + (" (off)" if rate == "off" else ""),
            math.radians(REAR_RATE_MIN_DEG_S),
            RATE_OFF,
            key="controller.rear_rate_max_deg_s",
            to_key=rate_key,
        ),
        configured(controller, "friction_min", "friction_min", "a lower estimate counts as this"),
        *_speed_parameters(config),
        configured(controller.fail_safe, "fail_safe_rate", "rate_deg_s", "rad/s, return to zero in fail-safe", DEGREE),
        *_actuator_parameters(config),
        Parameter(
            "inhibit_samples_max",
            max(round(controller.inhibit_time_s / controller.sampling_time_s), 1),
            "consecutive samples with Inhibit, then it is set for good",
            1,
            TASK_SAMPLES_MAX,
            key="controller.inhibit_time_s",
            to_key=lambda samples: samples * controller.sampling_time_s,
        ),
    )


def _speed_parameters(config: Config) -> Iterator[Parameter]:
    """Yield the parameters of the lowest speeds: thresholds of a law that waits for them, else the fade to standstill."""
    controller, angle_max = config.controller, config.rear_actuator.angle_max
    if controller.waits_for_speed:
        yield configured(controller, "enable_speed", "enable_speed_km_h", "m/s, control starts from here", KM_H)
        yield configured(controller, "disable_speed", "disable_speed_km_h", "m/s, standby below", KM_H)
        yield configured(controller, "standby_rate", "standby_rate_deg_s", "rad/s, return to zero in standby", DEGREE)
        return
    yield configured(
        controller, "slow_speed", "slow_speed_km_h", "m/s, no feedback below and in reverse, whole from twice it on", KM_H
    )
    yield Parameter(
        "fade_rate",
        angle_max / controller.fade_distance_m,
        "rad/m, largest change of the command for each metre below slow_speed",
        1e-5,
        3.0,
        key="controller.fade_distance_m",
        to_key=lambda rate: angle_max / rate,
    )


def _actuator_parameters(config: Config) -> Iterator[Parameter]:
    """Yield the parameters of the check that the actuator follows its command; see `RearActuator`."""
    actuator, period = config.rear_actuator, config.controller.sampling_time_s
    time: float | str = actuator.stuck_time_s
    if isinstance(time, str):
        time = 2.0 * actuator.angle_max_deg / actuator.rate_max_deg_s + 10.0 * actuator.lag_s
    share = 1.0 - math.exp(-period / actuator.lag_s)
    yield Parameter("actuator_share", share, "of the way to the command that the actuator goes in a sample", 1e-4, 1.0)
    yield Parameter(
        "actuator_error_max",
        math.radians(actuator.tolerated_error_deg),
        "rad, tolerated error, in addition to twice the remaining way",
        1e-4,
        1.5,
        key="rear_actuator.stuck_error_deg",
        to_key=math.degrees,
    )
    samples = max(round(time / period), 1)
    yield Parameter(
        "actuator_samples_max",
        samples,
        "samples off, less others, then it is stuck",
        1,
        TASK_SAMPLES_MAX,
        key="rear_actuator.stuck_time_s",
        to_key=lambda value: value * period,
    )


_LAW_STATE = (Field("bool", "is_limited", "a limit acted in the last sample"),)
"""State fields that every law has besides its own."""

_GRIP_STATE = (
    Field("real", "reached", "m/s^2 of lateral acceleration, lately"),
    Field("real", "available", "m/s^2 of lateral acceleration that the road has not yet refused"),
)

_STATE = (
    Field("real", "rear_angle", "rad, last command"),
    Field("real", "yaw_rate_reference", "rad/s, last reference"),
    Field("real", "yaw_rate_error", "rad/s, last reference minus measured yaw rate; 0 while control is off"),
    Field("bool", "enabled", "the law runs"),
    Field("uint32_t", "initialised", "mark of an initialised state"),
)


def controller_view(
    config: Config, total: TotalMap, lookup: Lookup, prefix: str, precision: Precision, real: str
) -> ControllerView:
    """Return the view of the configured controller around a total map and its lookup. Raises BuildError: see `law_of`."""
    law = law_of(config)
    parameters = parameter_views(controller_parameters(config), prefix, precision, real)
    law_fields = (*law.state, *_LAW_STATE)
    law_state = list(law_fields)
    state = [Field(f"{prefix}_law_t", "law", "the control law"), *_STATE]
    numbers = [f"law.{field.name}" for field in law_fields if field.kind == "real"]
    numbers += [field.name for field in _STATE if field.kind == "real" and field.name not in REWRITTEN]
    if law.uses_reference_model:
        law_state.insert(0, Field(f"{prefix}_reference_model_t", "model", "of the car"))
        state.insert(1, Field(f"{prefix}_grip_t", "grip", "of the road"))
        numbers += [f"law.model.{name}" for name in model_state(config)]
        numbers += [f"grip.{field.name}" for field in _GRIP_STATE]
    signals = {signal.role for signal in config.can.measured if signal.is_extra}
    numbers += [f"inputs.{name}" for name in INPUT_NUMBERS if name != "longitudinal_acceleration" or name in signals]
    numbers.append("limiter.rear_angle")  # a step rewrites the others before it reads them
    state.append(Field(f"{prefix}_measurement_t", "sample", "last sample after monitoring"))
    state.append(Field(f"{prefix}_inputs_t", "inputs", "first in the chain"))
    state.append(Field(f"{prefix}_limiter_t", "limiter", "last in the chain"))
    state.append(Field(f"{prefix}_quality_t", "quality", "of the last sample"))
    state.append(Field(f"{prefix}_status_t", "status", "of the last step"))
    period, points = config.controller.sampling_time_s, law.points(config, prefix)
    return ControllerView(
        parameters=parameters,
        ranged=tuple(view for view in parameters if not view.is_count and not view.points),
        counts=tuple(view for view in parameters if view.is_count),
        ranged_arrays=tuple(view for view in parameters if view.points),
        points=points,
        search_strides=search_strides(max((size for _, size in points), default=0)),
        state=tuple(state),
        law_state=tuple(law_state),
        grip_state=_GRIP_STATE,
        sample_ranges={name: (f"{low:g}", f"{high:g}") for name, (low, high) in law.sample_ranges.items()},
        command_max=f"{REAR_ANGLE_MAX_RAD:g}",
        error_max=f"{YAW_RATE_ERROR_MAX_RAD_S:g}",
        numbers=tuple(numbers),
        initialised=INITIALISED,
        squares_max=literal(SQUARES_MAX, precision),
        sampling_time=literal(period, precision),
        period_text=f"{period * 1e3:g} ms",
        actuator_angle_max=literal(config.rear_actuator.angle_max, precision),
        rest_min=literal(REST_MIN, precision),
        standing_speed=literal(STANDING_SPEED, precision),
        slow_rate=literal(SLOW_RATE, precision),
        reference_overshoot=REFERENCE_OVERSHOOT,
        estimate_factor=ESTIMATE_FACTOR,
        sideslip_return=literal(SIDESLIP_RETURN, precision),
        lead_loss=literal(LEAD_LOSS, precision),
        sideslip_gain=literal(SIDESLIP_GAIN, precision),
        known=_known_values(total, lookup, precision),
        selftest_tolerance=literal(SELFTEST_TOLERANCE, precision),
    )


def _known_values(total: TotalMap, lookup: Lookup, precision: Precision) -> tuple[str, ...]:
    """Return rows of speed, front angle, friction, with a stack over it acceleration, and yaw rate: corners, inner points,
    points beyond the edges, both signs, slippery roads, and each layer.

    Each constant of the lookup affects at least one row. At small angles and low speeds the cap does not act.
    """
    top_speed, top_angle, friction = float(total.speed[-1]), float(total.front_angle[-1]), total.friction
    points: list[tuple[float, ...]] = [
        (0.0, 0.0, friction),
        (0.0, top_angle, friction),
        (top_speed, 0.0, friction),
        (top_speed, top_angle, friction),
        (top_speed, -top_angle, friction),
        (0.4 * top_speed, 0.1 * top_angle, friction),
        (0.4 * top_speed, -0.1 * top_angle, friction),
        (0.05 * top_speed, 0.5 * top_angle, friction),
        (1.2 * top_speed, 0.01 * top_angle, friction),
        (0.03 * top_speed, 1.5 * top_angle, friction),
        (1.5 * top_speed, 2.0 * top_angle, friction),
        (top_speed, top_angle, 0.98 * friction),
        (1.5 * top_speed, top_angle, 1.02 * friction),
        (top_speed, top_angle, 0.4 * friction),
    ]
    if lookup.is_moving:
        layers = lookup.accelerations.tolist()
        corners = [(*corner, friction, layer) for layer in layers for corner in (points[5][:2], points[3][:2])]
        points = [*((*point, 0.5 * layers[0]) for point in points), *corners]
    known = {}
    for road in dict.fromkeys(tuple(point[2:]) for point in points):
        speeds, angles = np.array([point[:2] for point in points if point[2:] == road]).T
        known[road] = iter(lookup(speeds, angles, *road))
    rows = []
    for point in points:
        numbers = (*point, next(known[tuple(point[2:])]).item())
        rows.append(", ".join(literal(number, precision) for number in numbers))
    return tuple(rows)
