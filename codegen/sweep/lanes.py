"""Convert the factors of samples to the inputs of the batch.

Factors change only what they name. A change of the tyre peak keeps the slope at zero slip, as in `hil_sim.suite.conditions`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.sil.batch import Lanes
from codegen.sweep import draw
from codegen.sweep.profile import REFERENCE_ANGLE_DEG, Profile
from codegen.sweep.spec import FACTORS, NOISE, Spec
from codegen.units import KM_H
from codegen.vehicle.plant_car import PLANT_PARAMETERS, varied_cars

Factors = Mapping[str, FloatArray]

FRICTION_ESTIMATE_MIN = 0.02
"""Lower bound of the friction estimate after its error is added."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions of the samples in a scenario, (n,) each, in the units of `sweep.toml`, whether or not a factor varies them."""

    speed_km_h: FloatArray
    steering_wheel_angle_deg: FloatArray
    friction: FloatArray
    friction_estimate: FloatArray


def cars(config: Config, factors: Factors, count: int) -> FloatArray:
    """Return rows (count, k) of PLANT_PARAMETERS. Raises ConfigError if a centre of gravity comes too near an axle."""

    def factor(key: str) -> FloatArray:
        return 1.0 + _of(factors, key, count) / 100.0

    shift = _of(factors, "cg_shift_m", count)
    shift_max = 0.9 * min(config.vehicle.cg_to_front_axle_m, config.vehicle.cg_to_rear_axle_m)
    if np.any(np.abs(shift) >= shift_max):
        raise ConfigError(
            f"shifts of up to {np.abs(shift).max():g} m bring the centre of gravity to an axle",
            where="factors.cg_shift_m",
            remedy=f"stay below {shift_max:.2f} m",
        )
    table = varied_cars(
        config,
        mass=factor("mass_percent"),
        yaw_inertia=factor("yaw_inertia_percent"),
        cg_shift=shift,
        tyre_peak=factor("tyre_peak_percent"),
        front_stiffness=factor("front_stiffness_percent"),
        rear_stiffness=factor("rear_stiffness_percent"),
    )
    if "rear_lag_s" in factors:
        table[:, PLANT_PARAMETERS.index("rear_lag")] = factors["rear_lag_s"]
    return table


def conditions(config: Config, profile: Profile, factors: Factors, count: int) -> Conditions:
    """Return speed, amplitude and road of the samples in one scenario. Raises CodegenError if the car cannot do it."""
    speed = factors.get("speed_km_h", np.full(count, profile.speed / KM_H))
    angle = factors.get("steering_wheel_angle_deg")
    if angle is None:
        angle = np.degrees(profile.amplitudes(config, speed * KM_H)) * _of(factors, "steering_percent", count) / 100.0
    friction = factors.get("friction", np.full(count, profile.friction))
    estimate = np.full(count, profile.estimate)
    if "friction_estimate_error" in factors:
        estimate = np.maximum(friction + factors["friction_estimate_error"], FRICTION_ESTIMATE_MIN)
    return Conditions(speed, angle, friction, estimate)


def lanes(
    spec: Spec,
    samples: range,
    scenario: int,
    profile: Profile,
    config: Config,
    factors: Factors,
    driven: Conditions,
) -> Lanes:
    """Return batch inputs for sample numbers in one scenario (index in the spec), for any controller."""
    count = driven.speed_km_h.size
    period = round(config.controller.sampling_time_s / config.plant.sampling_time_s)
    return Lanes(
        cars=cars(config, factors, count),
        speed_factor=driven.speed_km_h * KM_H / profile.speed,
        wheel_factor=driven.steering_wheel_angle_deg / REFERENCE_ANGLE_DEG,
        friction=driven.friction,
        friction_estimate=driven.friction_estimate,
        delay_samples=np.round(_of(factors, "delay_samples", count)).astype(np.int64),
        noise=_noise(spec, samples, scenario, profile.inputs.shape[0] // period, factors),
    )


def only(every: Lanes, places: list[int]) -> Lanes:
    """Return the lanes at the given indices."""
    values = {field.name: getattr(every, field.name) for field in fields(every)}
    noise = values.pop("noise")
    return Lanes(
        **{name: value if np.ndim(value) == 0 else value[places] for name, value in values.items()},
        noise=None if noise is None else noise[:, :, places],
    )


def _of(factors: Factors, key: str, count: int) -> FloatArray:
    default = FACTORS[key].default
    return factors.get(key, np.full(count, np.nan if default is None else default))


def _noise(spec: Spec, samples: range, scenario: int, steps: int, factors: Factors) -> FloatArray | None:
    deviations = np.stack([_of(factors, key, len(samples)) for key in NOISE])
    if not deviations.any():
        return None
    in_si = deviations * np.array([[1.0], [np.pi / 180.0], [np.pi / 180.0]])
    noise: FloatArray = draw.noise(spec, samples, scenario, steps) * in_si
    return noise
