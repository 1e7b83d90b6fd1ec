"""View model of the controller: parameters with values, ranges and meaning, state, and known values for the self-test."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from codegen.configuration import Config
from codegen.configuration.controller import REAR_RATE_MIN_DEG_S
from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import Lookup
from codegen.emit.dynamics_view import model_state
from codegen.emit.inputs_view import inputs_parameters
from codegen.emit.laws import REAR_ANGLE_MAX_RAD, YAW_RATE_ERROR_MAX_RAD_S, Law, law_of
from codegen.emit.limiter_view import limiter_parameters
from codegen.emit.objects import MAP_SPEED, Condition
from codegen.emit.parameters import (
    RATE_OFF,
    Field,
    Parameter,
    configured,
    rate_key,
    search_strides,
)
from codegen.units import DEGREE, KM_H, M_S, M_S2, NONE, RAD, RAD_M, RAD_S

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
            RAD,
            "largest command, at most the actuator's largest angle",
            1e-4,
            config.rear_actuator.angle_max,
        ),
        Parameter(
            "rear_rate_max",
            RATE_OFF if rate == "off" else math.radians(rate),
            RAD_S,
            "largest rate of the command" + (" (off)" if rate == "off" else ""),
            math.radians(REAR_RATE_MIN_DEG_S),
            RATE_OFF,
            key="controller.rear_rate_max_deg_s",
            to_key=rate_key,
        ),
        configured(controller, "friction_min", "friction_min", NONE, "lower friction estimates are raised to this value"),
        *_speed_parameters(config),
        configured(
            controller.fail_safe, "fail_safe_rate", "rate_deg_s", RAD_S, "rate of the return to zero in fail-safe", DEGREE
        ),
        *_actuator_parameters(config),
        Parameter(
            "inhibit_samples_max",
            max(round(controller.inhibit_time_s / controller.sampling_time_s), 1),
            NONE,
            "consecutive samples with Inhibit until the controller enters standby",
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
        yield configured(controller, "enable_speed", "enable_speed_km_h", M_S, "control starts at this speed", KM_H)
        yield configured(controller, "disable_speed", "disable_speed_km_h", M_S, "control ends below this speed", KM_H)
        yield configured(
            controller, "standby_rate", "standby_rate_deg_s", RAD_S, "rate of the return to zero in standby", DEGREE
        )
        return
    yield configured(
        controller, "slow_speed", "slow_speed_km_h", M_S, "no feedback below it or in reverse; full from twice it", KM_H
    )
    yield Parameter(
        "fade_rate",
        angle_max / controller.fade_distance_m,
        RAD_M,
        "largest change of the command per metre below slow_speed",
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
    yield Parameter("actuator_share", share, NONE, "share of the remaining way that the actuator covers per sample", 1e-4, 1.0)
    yield Parameter(
        "actuator_error_max",
        math.radians(actuator.tolerated_error_deg),
        RAD,
        "tolerated position error, besides twice the remaining way",
        1e-4,
        1.5,
        key="rear_actuator.stuck_error_deg",
        to_key=math.degrees,
    )
    samples = max(round(time / period), 1)
    yield Parameter(
        "actuator_samples_max",
        samples,
        NONE,
        "deviating samples minus following ones until the actuator counts as stuck",
        1,
        TASK_SAMPLES_MAX,
        key="rear_actuator.stuck_time_s",
        to_key=lambda value: value * period,
    )


_LAW_STATE = (Field("bool", "is_limited", NONE, "a limit acted in the last sample"),)
"""State fields that every law has besides its own."""

_GRIP_STATE = (
    Field("real", "reached", M_S2, "largest recent lateral acceleration"),
    Field("real", "available", M_S2, "lateral acceleration that the road is assumed to carry"),
)

_STATE_OF_OTHERS = (
    Field("measurement_t", "sample", NONE, "last sample after the plausibility checks"),
    Field("inputs_t", "inputs", NONE, "state of the plausibility checks"),
    Field("limiter_t", "limiter", NONE, "state of the safety limiter"),
    Field("quality_t", "quality", NONE, "quality of the last sample"),
    Field("status_t", "status", NONE, "status of the last step"),
)

_STATE = (
    Field("real", "rear_angle", RAD, "last command"),
    Field("real", "yaw_rate_reference", RAD_S, "last reference"),
    Field("real", "yaw_rate_error", RAD_S, "last reference minus measured yaw rate; 0 while control is off"),
    Field("bool", "enabled", NONE, "the control law runs"),
    Field("uint32_t", "initialised", NONE, "mark of an initialised state"),
)


@dataclass(frozen=True)
class ControllerView:
    """Values that the templates of the controller print, in SI units.

    Attributes:
        known: numbers for the self-test, see `known_values`.
    """

    config: Config
    known: tuple[tuple[float, ...], ...]

    grip_state = _GRIP_STATE
    initialised = INITIALISED
    squares_max = SQUARES_MAX
    rest_min = REST_MIN
    standing_speed, slow_rate = STANDING_SPEED, SLOW_RATE
    reference_overshoot = REFERENCE_OVERSHOOT
    estimate_factor = ESTIMATE_FACTOR
    sideslip_return, lead_loss, sideslip_gain = SIDESLIP_RETURN, LEAD_LOSS, SIDESLIP_GAIN
    command_max, error_max = REAR_ANGLE_MAX_RAD, YAW_RATE_ERROR_MAX_RAD_S
    selftest_tolerance = SELFTEST_TOLERANCE

    @functools.cached_property
    def law(self) -> Law:
        """The control law."""
        return law_of(self.config)

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Fields of `<prefix>_parameters_t`, without inputs and limiter."""
        return controller_parameters(self.config)

    @property
    def arrays(self) -> tuple[Parameter, ...]:
        """The arrays among the parameters."""
        return tuple(each for each in self.parameters if each.points)

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """Conditions between the parameters."""
        slow = (Condition(left="slow_speed", operator="<=", right=MAP_SPEED, factor=0.25),)
        waiting = (
            Condition(left="disable_speed", operator="<", right="enable_speed"),
            Condition(left="enable_speed", operator="<=", right=MAP_SPEED, factor=0.5),
        )
        return (
            Condition(left="rear_angle_max", operator="<=", right="inputs.rear_angle_max"),
            *(waiting if self.law.waits_for_speed else slow),
            Condition(left="inputs.speed_max", operator=">=", right=MAP_SPEED),
            Condition(left="inputs.speed_max", operator="<=", right="limiter.speed_max"),
            Condition(left="inputs.front_angle_max", operator="<=", right="limiter.front_angle_max"),
            Condition(left="limiter.rear_angle_max", operator="<=", right="rear_angle_max"),
        )

    @property
    def points(self) -> dict[str, int]:
        """Names of the sizes of the arrays, without the prefix of the build, with the sizes."""
        return {each.points: len(each.values) for each in self.arrays}

    @property
    def search_strides(self) -> tuple[int, ...]:
        """Strides of the search among the breakpoints of the gains."""
        return search_strides(max(self.points.values(), default=0))

    @property
    def sampling_time(self) -> float:
        """Period of the steps."""
        return self.config.controller.sampling_time_s

    @property
    def actuator_angle_max(self) -> float:
        """Largest angle of the actuator."""
        return self.config.rear_actuator.angle_max

    @property
    def law_state(self) -> tuple[Field, ...]:
        """Fields of the state of the law."""
        model = (
            (Field("reference_model_t", "model", NONE, "reference model of the car"),) if self.law.uses_reference_model else ()
        )
        return (*model, *self.law.state, *_LAW_STATE)

    @property
    def state(self) -> tuple[Field, ...]:
        """Fields of the state of the controller."""
        grip = (Field("grip_t", "grip", NONE, "estimated grip of the road"),) if self.law.uses_reference_model else ()
        return (Field("law_t", "law", NONE, "state of the control law"), *grip, *_STATE, *_STATE_OF_OTHERS)

    @property
    def numbers(self) -> tuple[str, ...]:
        """Paths of the real numbers in the state that a step reads before it writes them."""
        numbers = [f"law.{field.name}" for field in self.law_state if field.kind == "real"]
        numbers += [field.name for field in _STATE if field.kind == "real" and field.name not in REWRITTEN]
        if self.law.uses_reference_model:
            numbers += [f"law.model.{name}" for name in model_state(self.config)]
            numbers += [f"grip.{field.name}" for field in _GRIP_STATE]
        signals = {signal.role for signal in self.config.can.measured if signal.is_extra}
        numbers += [f"inputs.{name}" for name in INPUT_NUMBERS if name != "longitudinal_acceleration" or name in signals]
        return (*numbers, "limiter.rear_angle")


def known_values(total: TotalMap, lookup: Lookup) -> tuple[tuple[float, ...], ...]:
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
    return tuple((*point, next(known[tuple(point[2:])]).item()) for point in points)
