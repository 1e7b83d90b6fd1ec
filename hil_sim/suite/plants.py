"""Changes of the simulated car: functions from a configuration to another.

Only the plant is made from the result; controller and map are those of the original. Properties that a change does not name are
kept. Changes of mass and peak keep the slope of the tyres at zero slip, their cornering stiffness. Otherwise the factor B would
be kept, the slope would follow load or peak, and a change of the mass would not affect the car's linear motion at all. On a
road of another friction it is B that is kept, as intended; the scenario sets that friction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from codegen import configuration
from codegen.configuration import Config
from codegen.vehicle.tyre import MagicFormulaTyre, static_wheel_loads

Change = Callable[[Config], Config]
AXLES = ("front", "rear")


def unchanged(config: Config) -> Config:
    """Return the car as configured."""
    return config


def changed(config: Config, tables: Mapping[str, Any]) -> Config:
    """Return a configuration with some keys replaced, tables merged, and validated as a whole. Raises ConfigError."""
    return configuration.parse(_merged(config.model_dump(), tables), "varied plant")


def _merged(base: dict[str, Any], tables: Mapping[str, Any]) -> dict[str, Any]:
    return {
        **base,
        **{
            key: _merged(base[key], value) if isinstance(value, Mapping) and isinstance(base.get(key), dict) else value
            for key, value in tables.items()
        },
    }


def _tyres(config: Config, factors: tuple[float, float] = (1.0, 1.0), **keys: float) -> dict[str, Any]:
    """Return tables of both tyres with slopes scaled by a factor each, and further keys for both."""
    tables = {}
    loads = static_wheel_loads(config)
    for axle, load, factor in zip(AXLES, loads, factors, strict=True):
        slope = MagicFormulaTyre.from_config(getattr(config.tyre, axle), load, config.road.friction).cornering_stiffness
        tables[axle] = {"cornering_stiffness_n_per_rad": factor * slope, "stiffness_factor_b_per_rad": None, **keys}
    return tables


def mass(percent: float) -> Change:
    """Return a change of the mass (in %), with the yaw inertia and the same centre of gravity."""
    factor = 1.0 + percent / 100.0

    def change(config: Config) -> Config:
        vehicle = config.vehicle
        heavier = {"mass_kg": factor * vehicle.mass_kg, "yaw_inertia_kg_m2": factor * vehicle.yaw_inertia_kg_m2}
        return changed(config, {"vehicle": heavier, "tyre": _tyres(config)})

    return change


def actuator_lag(seconds: float) -> Change:
    """Return a change of the rear actuator's lag."""
    return lambda config: changed(config, {"rear_actuator": {"lag_s": seconds}})


def stiffness(front_percent: float, rear_percent: float) -> Change:
    """Return a change of the tyres' slope (in %) at the same peak."""
    factors = (1.0 + front_percent / 100.0, 1.0 + rear_percent / 100.0)
    return lambda config: changed(config, {"tyre": _tyres(config, factors)})


def peak(percent: float) -> Change:
    """Return a change of the peak force (p1, in %) at the same slope."""

    def change(config: Config) -> Config:
        tables = _tyres(config)
        for axle in AXLES:
            tables[axle]["peak_factor_p1"] = (1.0 + percent / 100.0) * getattr(config.tyre, axle).peak_factor_p1
        return changed(config, {"tyre": tables})

    return change


def load_sensitivity(p2: float) -> Change:
    """Return a change that lowers peak friction (p2 below zero) with wheel load above the static load."""
    return lambda config: changed(config, {"tyre": _tyres(config, peak_load_sensitivity_p2=p2)})


def relaxation(length: float) -> Change:
    """Return a change that adds a relaxation length (m) to the tyres."""
    return lambda config: changed(config, {"plant": {"relaxation_length_m": length}})


def together(*changes: Change) -> Change:
    """Return several changes as one."""

    def change(config: Config) -> Config:
        for each in changes:
            config = each(config)
        return config

    return change
