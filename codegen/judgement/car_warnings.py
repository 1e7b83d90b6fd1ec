"""Handling of the car, and warnings about its data and about keys that contradict each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from codegen.configuration import Config
from codegen.configuration.controller import Tracking
from codegen.text import distinct
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack

DYNAMIC_INDEX = (0.6, 1.5)
"""Plausible range of k^2/(lf lr). Measured cars lie between 0.8 and 1.2 (G. J. Heydinger et al., Measured Vehicle Inertial
Parameters, SAE 1999-01-1336)."""
CORNERING_COMPLIANCE_DEG_PER_G = (1.75, 12.0)
"""Plausible range of an axle's slip angle in deg/g (R. T. Bundorf, R. L. Leffert, SAE 760713). Below half of
its lower end, the stiffness of a tyre is probably that of the whole axle."""
COMPLIANCE_RATIO = (0.9, 2.7)
"""Range of the front axle's compliance over that of the rear axle. One axle with twice its stiffness leaves it."""
OF_AN_AXLE = "is it the stiffness of the whole axle? Then halve it"
OF_HALF_A_TYRE = "is it in N/deg, or half of a tyre's?"
EXCHANGED = (
    "are vehicle.cg_to_front_axle_m and cg_to_rear_axle_m exchanged? With the one for the other, both axles are plausible"
)
NEUTRAL_DEG_PER_G = 0.05
"""Largest magnitude of the understeer gradient of a neutral car. Its characteristic or critical speed is above 600 km/h."""
TUNED_LAG_FACTOR = 1.5
"""Factor by which the actuator's lag may lie outside the family for which the gains were designed."""
LEAD_PER_LAG = (0.7, 1.4)
"""Range of a fixed lead of the front angle over the actuator's lag. The leads that `codegen tune` chooses average 0.8 to 1.2
times the lag over the speeds of a car."""


@dataclass(frozen=True)
class Handling:
    """Steady-state handling of the passive linear car. One of the two speeds is None; both are None for a neutral car."""

    understeer_gradient_deg_per_g: float
    characteristic_speed_km_h: float | None
    critical_speed_km_h: float | None

    @classmethod
    def from_config(cls, config: Config) -> Handling:
        """Return the handling of a configured car."""
        car = SingleTrack.from_config(config)
        coefficient = car.understeer_coefficient
        gradient = math.degrees(coefficient) * config.road.gravity_m_s2
        if abs(gradient) < NEUTRAL_DEG_PER_G:
            return cls(gradient, None, None)
        speed = math.sqrt(car.wheelbase / abs(coefficient)) / KM_H
        return cls(gradient, speed, None) if gradient > 0.0 else cls(gradient, None, speed)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        gradient = f"understeer gradient {round(self.understeer_gradient_deg_per_g, 2) + 0.0:.2f} deg/g"
        if self.critical_speed_km_h is not None:
            return f"{gradient}, critical speed {self.critical_speed_km_h:.0f} km/h"
        if self.characteristic_speed_km_h is not None:
            return f"{gradient}, characteristic speed {self.characteristic_speed_km_h:.0f} km/h"
        return f"{gradient}, neutral"


def _beyond(value: float, limits: tuple[float, float]) -> str:
    """Return the text of a value outside limits."""
    return distinct(value, limits[0] if value < limits[0] else limits[1])


def car_warnings(config: Config) -> tuple[str, ...]:
    """Return a warning for each implausible value and for each pair of keys that contradict each other."""
    of_the_car = (*_identified(config), *_vehicle(config), *_tyres(config), *_actuator(config), *_plant(config))
    of_the_bus = (config.can.shared_text(*shared) for shared in config.can.shared_data_ids())
    return (*of_the_car, *_other_kinds(config), *_controller(config), *of_the_bus)


def _identified(config: Config) -> Iterator[str]:
    """Yield each doubt about the identification that nobody accepted."""
    if config.identified.is_doubtful:
        for doubt in config.identified.doubts:
            yield f"[identified] is in doubt: {doubt}; its deviations count only with identified.doubts_accepted = true"


def _vehicle(config: Config) -> Iterator[str]:
    vehicle = config.vehicle
    arms = vehicle.cg_to_front_axle_m * vehicle.cg_to_rear_axle_m
    usual = vehicle.mass_kg * arms
    index, (low, high) = vehicle.yaw_inertia_kg_m2 / usual, DYNAMIC_INDEX
    if not low <= index <= high:
        yield (
            f"vehicle.yaw_inertia_kg_m2 = {vehicle.yaw_inertia_kg_m2:g} is {_beyond(index, DYNAMIC_INDEX)} times mass lf lr = "
            f"{usual:.0f} kg m^2; cars have {low:g} to {high:g} times; check its unit and its axis (the vertical one), or take "
            f"{usual:.0f} where it is not known"
        )
    if 0.5 * vehicle.track_m < config.road.friction * vehicle.cg_height_m:
        yield (
            f"vehicle.cg_height_m = {vehicle.cg_height_m:g} and track_m = {vehicle.track_m:g}: the car rolls over before its "
            f"tyres slide on friction {config.road.friction:g}; check both"
        )


def _tyres(config: Config) -> Iterator[str]:
    """Yield a warning for each axle with an implausible stiffness or, if there is none, for an implausible ratio of the two."""
    car = SingleTrack.from_config(config)
    degrees_per_g = math.degrees(config.road.gravity_m_s2)
    compliances = {
        "front": (degrees_per_g * car.front_slip_per_lateral_acceleration, car.front_stiffness),
        "rear": (degrees_per_g * car.rear_slip_per_lateral_acceleration, car.rear_stiffness),
    }
    low, high = CORNERING_COMPLIANCE_DEG_PER_G
    arms = config.vehicle.cg_to_front_axle_m / config.vehicle.cg_to_rear_axle_m
    front, rear = (compliance for compliance, _ in compliances.values())
    is_exchanged = _are_plausible(front * arms, rear / arms)
    plausible = True
    for axle, (compliance, stiffness) in compliances.items():
        if low <= compliance <= high:
            continue
        plausible = False
        cause = _cause(OF_AN_AXLE if compliance < low else OF_HALF_A_TYRE, is_exchanged)
        yield (
            f"tyre.{axle}: {0.5 * stiffness:.0f} N/rad for one tyre gives {_beyond(compliance, (low, high))} deg of slip for "
            f"each g; cars have {low:g} to {high:g}: {cause}"
        )
    ratio, (low, high) = front / rear, COMPLIANCE_RATIO
    if plausible and not low <= ratio <= high:
        yield (
            f"tyre.{'front' if ratio < low else 'rear'}: the slip for each g at the front axle is "
            f"{_beyond(ratio, (low, high))} times that at the rear axle ({front:.1f} and {rear:.1f} deg); "
            f"cars have {low:g} to {high:g} times: {_cause(OF_AN_AXLE, is_exchanged)}"
        )


def _are_plausible(front: float, rear: float) -> bool:
    """Return whether the compliances of both axles in deg/g, and their ratio, are plausible."""
    low, high = CORNERING_COMPLIANCE_DEG_PER_G
    return all(low <= each <= high for each in (front, rear)) and COMPLIANCE_RATIO[0] <= front / rear <= COMPLIANCE_RATIO[1]


def _cause(own: str, is_exchanged: bool) -> str:
    """Return the probable causes of an implausible stiffness: its `own` one, and exchanged distances if they explain it too."""
    return f"{own}; or {EXCHANGED}" if is_exchanged else own


def is_limit_beyond_actuator(config: Config) -> bool:
    """Return whether the rear angle limit exceeds the actuator's range. One warning then covers all maps."""
    return config.limits.rear_angle_max_deg > config.rear_actuator.angle_max_deg


def _actuator(config: Config) -> Iterator[str]:
    limit, actuator, controller = config.limits.rear_angle_max_deg, config.rear_actuator, config.controller
    if is_limit_beyond_actuator(config):
        yield (
            f"limits.rear_angle_max_deg = {limit:g} is above rear_actuator.angle_max_deg = {actuator.angle_max_deg:g}: "
            "the map uses angles that the actuator cannot reach; lower the limit"
        )
    for key, rate in (
        ("controller.rear_rate_max_deg_s", controller.rear_rate_max_deg_s),
        ("limiter.rear_rate_max_deg_s", config.limiter.rear_rate_max_deg_s),
    ):
        if not isinstance(rate, str) and rate > actuator.rate_max_deg_s:
            yield (
                f"{key} = {rate:g} is above rear_actuator.rate_max_deg_s = {actuator.rate_max_deg_s:g}: "
                "the controller commands a rate that the actuator cannot follow"
            )


def _plant(config: Config) -> Iterator[str]:
    plant, tuning = config.plant, config.tuning
    if plant.rear_relaxation_factor != 1.0 and plant.relaxation_length_m == 0.0:
        yield (
            f"plant.rear_relaxation_factor = {plant.rear_relaxation_factor:g} has no effect: it multiplies "
            "plant.relaxation_length_m, which is 0; set the length, or remove the factor"
        )
    if "delay_samples" in tuning.model_fields_set and tuning.delay_samples < plant.command_delay_samples:
        yield (
            f"tuning.delay_samples = {tuning.delay_samples} has no effect: it is below plant.command_delay_samples = "
            f"{plant.command_delay_samples}, which counts; remove it"
        )


def _other_kinds(config: Config) -> Iterator[str]:
    """Yield the keys of the lowest speeds that belong to another kind."""
    controller = config.controller
    of_kind = ("enable_speed_km_h", "disable_speed_km_h", "standby_rate_deg_s"), ("slow_speed_km_h", "fade_distance_m")
    given = [key for key in of_kind[controller.waits_for_speed] if key in controller.model_fields_set]
    changed = [key for key in given if getattr(controller, key) != type(controller).model_fields[key].default]
    if changed:
        names = ", ".join(f"controller.{key}" for key in changed)
        replaced = "enable_speed_km_h" if controller.waits_for_speed else "slow_speed_km_h and fade_distance_m"
        yield f'{names}: no effect with kind = "{controller.kind}", which has {replaced} instead; remove it'


def _controller(config: Config) -> Iterator[str]:
    controller, lag = config.controller, config.rear_actuator.lag_s
    critical = SingleTrack.from_config(config).critical_speed / KM_H
    top = config.vehicle.top_speed_km_h or controller.inputs.speed_max_km_h  # the map can end far below what the car reaches
    if controller.kind != "tracking":
        return
    if critical <= top:
        yield (
            f"the car is unstable from {critical:.0f} km/h without rear steering, and so is the controller's reference model: "
            f"margins do not count there; set vehicle.top_speed_km_h to what the car reaches, if below ({top:g} is assumed)"
        )
    family = config.actuator_lags_s
    if family and not min(family) / TUNED_LAG_FACTOR <= lag <= max(family) * TUNED_LAG_FACTOR:
        key, remedy = "tuning.actuator_lag_factor", "include 1 there"
        if config.tuning.actuator_lag_factor is None:
            key, remedy = "tuning.actuator_lag_s", "replace that key by tuning.actuator_lag_factor"
        yield (
            f"rear_actuator.lag_s = {lag:g} is outside the lags for which gains are designed, {min(family):g} to "
            f"{max(family):g} s ({key}); {remedy} and run `codegen tune`"
        )
    schedule, lead = controller.tracking.schedule, controller.tracking.lead_s
    # The default stands for a lead that nobody chose.
    is_fixed = lead != Tracking.model_fields["lead_s"].default and (schedule is None or schedule.lead_s is None)
    low, high = LEAD_PER_LAG
    if is_fixed and not low * lag <= lead <= high * lag:
        factor = _beyond(lead / lag, LEAD_PER_LAG)
        yield (
            f"controller.tracking.lead_s = {lead:g} is {factor} times rear_actuator.lag_s = {lag:g}; "
            f"a lead of {low:g} to {high:g} times the lag suits most cars; `codegen tune` chooses it"
        )
