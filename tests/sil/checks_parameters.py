"""Checks of the generated parameters: their defaults and their ranges.

Each check takes a build of any kind and raises AssertionError if the build fails it.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from codegen.configuration import Config
from codegen.emit.controller_view import controller_parameters
from codegen.emit.inputs_view import inputs_parameters
from codegen.emit.limiter_view import opposite_phase_speeds_km_h
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from tests.builds import Built
from tests.sil.checks_kinds import config_of


def configured(built: Built) -> dict[str, Any]:
    """Return the parameter values that follow from the configuration according to their documentation; SI units."""
    config = config_of(built)
    controller, actuator = config.controller, config.rear_actuator
    rate, period, lag = controller.rear_rate_max_deg_s, controller.sampling_time_s, actuator.lag_s
    values: dict[str, Any] = {
        "rear_angle_max": math.radians(actuator.angle_max_deg),
        "rear_rate_max": 1000.0 if rate == "off" else math.radians(rate),
        "friction_min": controller.friction_min,
        "fail_safe_rate": math.radians(controller.fail_safe.rate_deg_s),
        # A first-order lag over a sample; a tenth of the angle; the time from stop to stop at the largest rate, and ten lags.
        "actuator_share": 1.0 - math.exp(-period / lag),
        "actuator_error_max": 0.1 * math.radians(actuator.angle_max_deg),
        "actuator_samples_max": round((2.0 * actuator.angle_max_deg / actuator.rate_max_deg_s + 10.0 * lag) / period),
    }
    values["inhibit_samples_max"] = round(controller.inhibit_time_s / period)
    if controller.kind == "pi":
        values |= {
            "enable_speed": controller.enable_speed_km_h / 3.6,
            "disable_speed": controller.disable_speed_km_h / 3.6,
            "standby_rate": math.radians(controller.standby_rate_deg_s),
        }
    else:
        values |= {
            "slow_speed": controller.slow_speed_km_h / 3.6,
            "fade_rate": math.radians(actuator.angle_max_deg) / controller.fade_distance_m,
        }
    if controller.kind in ("pi", "tracking"):
        values["rear_angle_error_max"] = math.radians(controller.rear_angle_error_max_deg)
    if controller.kind == "pi":
        values |= {"proportional_gain": controller.proportional_gain_s, "integral_gain": controller.integral_gain}
    if controller.kind == "tracking":
        values |= _configured_tracking(controller.tracking, period)
    return values


def _configured_tracking(tracking: Any, period: float) -> dict[str, Any]:
    return {
        "schedule_speed": [speed / 3.6 for speed in tracking.schedule.speed_km_h],
        "proportional_gain": list(tracking.schedule.proportional_gain_s),
        "integral_gain": list(tracking.schedule.integral_gain),
        "lead_time": list(tracking.schedule.lead_s or [tracking.lead_s] * len(tracking.schedule.speed_km_h)),
        "response_gain": list(tracking.schedule.response_gain_s or [0.0] * len(tracking.schedule.speed_km_h)),
        "lead_smoothing": 1.0 - math.exp(-period / tracking.lead_smoothing_s),
        "lead_angle_max": math.radians(tracking.lead_max_deg),
        "response_samples": tracking.response_ahead_s / period,
        "yaw_increasing_max": math.radians(tracking.yaw_increasing_max_deg),
        "yaw_increasing_wide": math.radians(tracking.yaw_increasing_wide_deg),
        "sideslip_max": math.radians(tracking.sideslip_max_deg),
        "turn_margin_rate": math.radians(tracking.turn_margin_deg_s),
        "turn_margin": tracking.turn_margin_m_s2,
        "trim_share": tracking.trim_max_percent / 100.0,
        "trim_rate": 1.0 / tracking.trim_time_s,
        "grip_shortfall": tracking.grip_shortfall_m_s2,
        "grip_shortfall_share": tracking.grip_shortfall_share,
        "grip_loss_rate": 1.0 / tracking.grip_loss_time_s,
        "grip_forgetting": 1.0 / tracking.grip_memory_s,
        "grip_recovery": tracking.grip_recovery_m_s3,
        "grip_recovery_idle": tracking.grip_recovery_idle_m_s3,
    }


def check_defaults(built: Built) -> None:
    """Check that the default parameters equal the configuration up to one rounding; two for inputs and limiter."""
    parameters = built.software.parameters()
    of_limiter, of_inputs = _configured_limiter(config_of(built)), _configured_inputs(config_of(built))
    assert of_limiter.keys() == set(dir(parameters.limiter))
    assert of_inputs.keys() == set(dir(parameters.inputs))
    structs = ((parameters, configured(built), 1.0), (parameters.limiter, of_limiter, 2.0), (parameters.inputs, of_inputs, 2.0))
    for struct, values, roundings in structs:
        for name, wanted in values.items():
            got = getattr(struct, name)
            pairs = zip(list(got), wanted, strict=True) if isinstance(wanted, list) else [(got, wanted)]
            assert all(abs(have - want) <= roundings * built.eps * abs(want) for have, want in pairs), name


def _configured_inputs(config: Config) -> dict[str, Any]:
    inputs, fail_safe, period = config.controller.inputs, config.controller.fail_safe, config.controller.sampling_time_s
    return {
        "speed_max": inputs.speed_max_km_h / 3.6,
        "front_angle_max": math.radians(inputs.front_angle_max_deg),
        "yaw_rate_max": math.radians(inputs.yaw_rate_max_deg_s),
        "rear_angle_max": math.radians(config.rear_angle_valid_max_deg),
        "friction_max": inputs.friction_max,
        "speed_step": inputs.acceleration_max_m_s2 * period,
        "front_angle_step": math.radians(inputs.front_angle_rate_max_deg_s) * period,
        "yaw_rate_step": math.radians(inputs.yaw_acceleration_max_deg_s2) * period,
        "wheelbase": config.vehicle.cg_to_front_axle_m + config.vehicle.cg_to_rear_axle_m,
        "understeer_coefficient": SingleTrack.from_config(config).understeer_coefficient,
        "expected_share": 1.0 - math.exp(-period / inputs.yaw_rate_lag_s),
        "yaw_rate_tolerance": math.radians(inputs.yaw_rate_tolerance_deg_s),
        "lateral_acceleration_max": inputs.lateral_acceleration_max_m_s2,
        "yaw_rate_frozen": math.radians(inputs.yaw_rate_frozen_deg_s),
        "speed_agreement": inputs.speed_agreement_km_h / 3.6,
        "yaw_rate_agreement": math.radians(inputs.yaw_rate_agreement_deg_s),
        "straight_yaw_rate": math.radians(inputs.straight_yaw_rate_deg_s),
        "yaw_rate_offset_max": math.radians(inputs.yaw_rate_offset_max_deg_s),
        "lateral_acceleration_offset_max": inputs.lateral_acceleration_offset_max_m_s2,
        "yaw_rate_correction_share": period / inputs.yaw_rate_correction_time_s,
        "speed_fall": inputs.speed_fall_m_s2 * period,
        "friction_recovery": inputs.friction_recovery_1_s * period,
        "missing_samples_max": fail_safe.degraded_samples_max,
        "recovery_samples": fail_safe.recovery_samples,
    }


def _configured_limiter(config: Config) -> dict[str, Any]:
    rate, most = config.limiter.rear_rate_max_deg_s, math.radians(config.rear_actuator.angle_max_deg)
    return {
        "rear_angle_max": most,
        "rear_rate_max": 1000.0 if rate == "off" else math.radians(rate),
        "in_phase_from_front_angle": math.radians(config.limiter.in_phase_from_front_angle_deg),
        "speed_max": config.controller.inputs.speed_max_km_h / 3.6,
        "front_angle_max": math.radians(config.controller.inputs.front_angle_max_deg),
        "opposite_phase_speed": [speed / 3.6 for speed in opposite_phase_speeds_km_h(config)],
        "opposite_phase_max": [min(angle, most) for angle in opposite_phase_bounds(config)],
    }


def opposite_phase_bounds(config: Config) -> list[float]:
    """Return the bound at each breakpoint, rad: as configured, or where a steady, never oversteering car reaches an
    acceleration."""
    angles, speeds = config.limiter.opposite_phase_max_deg, [speed / 3.6 for speed in opposite_phase_speeds_km_h(config)]
    if angles == "off":
        return [math.inf] * len(speeds)
    if angles == "from-car":
        car, reached = SingleTrack.from_config(config), config.limiter.opposite_phase_lateral_acceleration_m_s2
        return [reached * (car.wheelbase / speed**2 + max(car.understeer_coefficient, 0.0)) for speed in speeds]
    return [math.radians(angle) for angle in angles]


COMPANIONS: Mapping[str, Mapping[str, float]] = {
    "inputs.rear_angle_max": {"rear_angle_max": 1e-4},
}
"""Values of other parameters that a parameter at the end of its range requires."""
NO_ROOM = {
    *(("enable_speed", "low"), ("enable_speed", "high"), ("disable_speed", "high"), ("slow_speed", "high")),
    ("inputs.speed_max", "low"),
}
"""Ends of ranges that are invalid alone: the disabling speed must be below the enabling one, and both must leave the controller
part of the map's speeds."""


def is_valid(built: Built, **changes: Any) -> bool:
    """Return whether the defaults with some changes are valid.

    The limiter's angle is reduced with the controller's, which it may not exceed; its input ranges are the widest.
    """
    plain = {name: value for name, value in changes.items() if not name.startswith("inputs.")}
    parameters = built.software.parameters(**plain)
    for name in changes.keys() - plain.keys():
        setattr(parameters.inputs, name.removeprefix("inputs."), changes[name])
    limiter = parameters.limiter
    limiter.speed_max, limiter.front_angle_max = 200.0, 1.5
    if parameters.rear_angle_max < limiter.rear_angle_max:
        limiter.rear_angle_max = parameters.rear_angle_max
        for k in range(len(limiter.opposite_phase_max)):
            limiter.opposite_phase_max[k] = min(limiter.opposite_phase_max[k], parameters.rear_angle_max)
    return bool(built.software.function("parameters_valid")(parameters))


def check_ranges(built: Built) -> None:
    """Check that every parameter is accepted up to the ends of its range and rejected beyond, array elements one by one."""
    software, real = built.software, built.real
    tables = (controller_parameters(config_of(built)), inputs_parameters(config_of(built)))
    of_controller, of_inputs = ([each for each in table if not each.is_count] for table in tables)
    assert is_valid(built)
    for struct, listed in (("parameters", of_controller), ("inputs_parameters", of_inputs)):
        fields = dict(software.ffi.typeof(f"{software.prefix}_{struct}_t").fields)
        numbers = {name for name, field in fields.items() if field.type.cname.startswith(("float", "double"))}
        assert numbers == {parameter.name for parameter in listed}, "every number has a range"
    named = [replace(parameter, name=f"inputs.{parameter.name}") for parameter in of_inputs]
    for parameter in (*of_controller, *named):
        low, high = (float(real(bound)) for bound in (parameter.low, parameter.high))
        defaults = software.parameters()  # owns its arrays
        given = functools.reduce(getattr, parameter.name.split("."), defaults)
        good: Any = given if isinstance(given, float) else list(given)
        others = COMPANIONS.get(parameter.name, {})

        def valid(value: float, k: int, name: str = parameter.name, good: Any = good, others: Any = others) -> bool:
            changed = value if isinstance(good, float) else [*good[:k], value, *good[k + 1 :]]
            return is_valid(built, **{name: changed}, **others)

        last = 0 if isinstance(good, float) else len(good) - 1
        for k in range(last + 1):
            for end, value, beyond in (("low", low, -math.inf), ("high", high, math.inf)):
                has_room = not parameter.increasing or k == {"low": 0, "high": last}[end]
                assert valid(value, k) == (has_room and (parameter.name, end) not in NO_ROOM), (parameter.name, k)
                assert not valid(built.next(value, beyond), k), (parameter.name, k)
            assert not any(valid(nonsense, k) for nonsense in (math.nan, math.inf, -math.inf)), (parameter.name, k)
        if parameter.increasing:
            _check_increasing(built, parameter.name, good)
    _check_what_fits_together(built)


def _check_increasing(built: Built, name: str, good: list[float]) -> None:
    for k in range(1, len(good)):
        assert not is_valid(built, **{name: [*good[:k], good[k - 1], *good[k + 1 :]]}), "two in one place"
        assert is_valid(built, **{name: [*good[:k], built.next(good[k - 1], math.inf), *good[k + 1 :]]})


def _check_what_fits_together(built: Built) -> None:
    software, lowest = built.software, float(built.real(0.03))
    angle = float(software.parameters().rear_angle_max)
    assert is_valid(built, **{"inputs.rear_angle_max": angle})
    assert not is_valid(built, **{"inputs.rear_angle_max": built.next(angle, 0.0)})
    assert not is_valid(built, rear_angle_max=built.next(angle, 2.0)), "beyond the actuator's range"
    fastest = float(built.real(built.total.speed[-1]))
    if config_of(built).controller.waits_for_speed:
        assert not is_valid(built, enable_speed=5.0, disable_speed=5.0)
        slowest = float(built.real(0.5 * KM_H))
        assert not is_valid(built, enable_speed=built.next(slowest, 0.0), disable_speed=lowest)
        for enable, disable in ((slowest, lowest), (10.0, lowest), (5.0, built.next(5.0, 0.0))):
            assert is_valid(built, enable_speed=enable, disable_speed=disable)
        for enable, fits in ((0.5 * fastest, True), (built.next(0.5 * fastest, fastest), False)):
            assert is_valid(built, enable_speed=enable, disable_speed=1.0) == fits, "control would hardly ever be enabled"
    else:
        for slow, fits in ((0.25 * fastest, True), (built.next(0.25 * fastest, fastest), False)):
            assert is_valid(built, slow_speed=slow) == fits, "feedback would hardly ever be whole"
    period = config_of(built).controller.sampling_time_s
    ranges = {"inputs.missing_samples_max": (0, round(1.0 / period)), "inputs.recovery_samples": (1, 4_000)}
    ranges |= dict.fromkeys(("actuator_samples_max", "inhibit_samples_max"), (1, 60_000))
    for name, (least, most) in ranges.items():
        assert is_valid(built, **{name: least}) and is_valid(built, **{name: most})
        assert not is_valid(built, **{name: most + 1}), "a count that never acts or never ends"
        assert least == 0 or not is_valid(built, **{name: least - 1}), "a count that ends at once"
    for speed, fits in ((fastest, True), (built.next(fastest, 0.0), False)):
        assert is_valid(built, **{"inputs.speed_max": speed}) == fits, "the range of speeds must include the map"
    parameters = software.parameters()
    for angle, fits in ((float(parameters.rear_angle_max), True), (built.next(parameters.rear_angle_max, 1.0), False)):
        parameters.limiter.rear_angle_max = angle
        assert software.function("parameters_valid")(parameters) == fits
    for name in ("speed_max", "front_angle_max"):
        most = getattr(parameters.inputs, name)
        for beyond, fits in ((most, True), (built.next(most, 0.0), False)):
            parameters = software.parameters()
            setattr(parameters.limiter, name, beyond)
            assert software.function("parameters_valid")(parameters) == fits, "the limiter must accept the controller's inputs"
    assert not is_valid(built, **{"inputs.wheelbase": math.nan}), "the input parameters are checked too"
    parameters = software.parameters()
    parameters.limiter.rear_rate_max = math.nan
    assert not software.function("parameters_valid")(parameters), "the limiter's parameters are checked too"
