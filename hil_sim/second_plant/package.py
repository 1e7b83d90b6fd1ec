"""Import the third-party model, an optional dependency, and derive the configuration of its cars."""

from __future__ import annotations

import importlib
from typing import Any

from codegen import configuration
from codegen.configuration import Config
from codegen.errors import CodegenError

PUBLISHED = {1: "Ford Escort", 2: "BMW 320i", 3: "VW Vanagon"}
"""The cars of the package that have the data of the multi-body model."""

DEFAULT_CAR = 2


def module(name: str) -> Any:
    """Import the module `vehiclemodels.<name>`.

    Raises:
        CodegenError: the package is not installed, or is one that has no such module.
    """
    try:
        return importlib.import_module(f"vehiclemodels.{name}")
    except ImportError as error:
        raise CodegenError(
            f"the multi-body car cannot be imported ({error})",
            where="commonroad-vehicle-models",
            remedy='pip install "ars-codegen[crosscheck]"',
        ) from None


def published(number: int = DEFAULT_CAR) -> Any:
    """Return a new parameter set of one of the PUBLISHED cars in SI units, with the package's names.

    Raises:
        CodegenError: no such car, or see `module`.
    """
    if number not in PUBLISHED:
        known = ", ".join(f"{key} ({name})" for key, name in PUBLISHED.items())
        raise CodegenError(f"there is no multi-body car {number}", where="commonroad-vehicle-models", remedy=f"known: {known}")
    return module("vehicle_parameters").setup_vehicle_parameters(vehicle_id=number)


GRAVITY = 9.81
"""m/s^2, as the multi-body model has it."""

SLIP_STEP = 1e-4
"""Half of the step in rad over which the tyre's slope at zero slip is taken. The relative error is (B step)^2 / 3."""


def static_loads(parameters: Any) -> tuple[float, float]:
    """Return the static load of one front and of one rear wheel in N: body and axle masses."""
    wheelbase = parameters.a + parameters.b
    body = parameters.m_s * GRAVITY / wheelbase
    return (
        0.5 * (body * parameters.b + parameters.m_uf * GRAVITY),
        0.5 * (body * parameters.a + parameters.m_ur * GRAVITY),
    )


def cornering_stiffness(parameters: Any, load: float) -> float:
    """Return the slope of the car's tyre function at zero slip and camber in N/rad, for one wheel at a load (N)."""
    lateral = module("utils.tire_model").formula_lateral
    left, right = (lateral(slip, 0.0, load, parameters.tire)[0] for slip in (-SLIP_STEP, SLIP_STEP))
    return float(left - right) / (2.0 * SLIP_STEP)


def front_roll_share(parameters: Any) -> float:
    """Return the share of the front axle in the roll stiffness: springs (K T^2 / 2 for an axle) and auxiliary stiffness."""
    front = 0.5 * parameters.K_sf * parameters.T_f**2 - parameters.K_tsf
    rear = 0.5 * parameters.K_sr * parameters.T_r**2 - parameters.K_tsr
    return float(front / (front + rear))


def car_of(parameters: Any, base: Config | None = None) -> Config:
    """Return the configuration of a multi-body car: vehicle, tyres and road; the rest as in `base` (default: `Config()`).

    Mass, inertia, heights and arms are the data's, the track is the mean of both axles. The tyre formula has the form of
    ours, so C, E and the peak friction are its own; the stiffness is its slope at the static load of each axle.

    Raises:
        CodegenError: the package is missing.
        ConfigError: the configuration does not support the data.
    """
    tyre = parameters.tire
    front, rear = (
        {
            "cornering_stiffness_n_per_rad": cornering_stiffness(parameters, load),
            "shape_factor_c": tyre.p_cy1,
            "curvature_factor_e": tyre.p_ey1,
        }
        for load in static_loads(parameters)
    )
    data = (Config() if base is None else base).model_dump(mode="json")
    data["vehicle"] = {
        "mass_kg": parameters.m,
        "yaw_inertia_kg_m2": parameters.I_z,
        "cg_height_m": parameters.h_cg,
        "track_m": 0.5 * (parameters.T_f + parameters.T_r),
        "cg_to_front_axle_m": parameters.a,
        "cg_to_rear_axle_m": parameters.b,
        "front_roll_share": front_roll_share(parameters),
    }
    data["tyre"] = {"front": front, "rear": rear}
    data["road"] = {"friction": tyre.p_dy1, "gravity_m_s2": GRAVITY}
    return configuration.parse(data, "commonroad-vehicle-models")
