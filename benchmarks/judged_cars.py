"""Cars of the benchmark `better`: five that differ in what limits them, and random ones."""

from __future__ import annotations

from typing import Any

from codegen import configuration
from codegen.configuration import Config
from hil_sim.suite.cars import COMMAND_RATE_SHARE, random_cars

PAPER = "paper's"
"""Name of the car of the committed build."""

SEED = 5
"""Seed of the random cars by default. The controller was designed and tested with cars of the seeds 1 to 4."""


def _car(vehicle: dict[str, float], stiffness: tuple[float, float], p2: float, actuator: tuple[float, float, float]) -> Config:
    """Return a car with the recommended controller.

    Args:
        vehicle: keys of `[vehicle]`.
        stiffness: of one front and one rear tyre, N/rad.
        p2: load sensitivity of all tyres.
        actuator: largest rear angle in deg, its largest rate in deg/s, and its lag in s.
    """
    angle, rate, lag = actuator
    axles = zip(("front", "rear"), stiffness, strict=True)
    tyres: dict[str, Any] = {
        axle: {"cornering_stiffness_n_per_rad": slope, "peak_load_sensitivity_p2": p2} for axle, slope in axles
    }
    changes = {
        "vehicle": vehicle,
        "tyre": tyres,
        "limits.rear_angle_max_deg": angle,
        "rear_actuator": {"angle_max_deg": angle, "rate_max_deg_s": rate, "lag_s": lag},
        "controller.rear_rate_max_deg_s": COMMAND_RATE_SHARE * rate,
        "limiter.rear_rate_max_deg_s": rate,
    }
    return configuration.preset("recommended").replace(changes, "car of the benchmark")


def five_cars() -> dict[str, Config]:
    """Return name -> configuration, not tuned.

    A load of 600 kg, 1.4 m ahead of the rear axle, is the difference between the vans. The stiffness of their tyres goes with
    the load to the power of 0.7.
    """
    return {
        PAPER: configuration.preset("recommended"),
        "light, rear-heavy": _car(
            {
                "mass_kg": 1150.0,
                "yaw_inertia_kg_m2": 1500.0,
                "cg_height_m": 0.45,
                "track_m": 1.55,
                "cg_to_front_axle_m": 1.42,
                "cg_to_rear_axle_m": 1.02,
            },
            (58_000.0, 88_000.0),
            -0.05,
            (3.5, 40.0, 0.04),
        ),
        "heavy, 10 deg, 90 ms": _car(
            {
                "mass_kg": 3200.0,
                "yaw_inertia_kg_m2": 6900.0,
                "cg_height_m": 0.75,
                "track_m": 1.68,
                "cg_to_front_axle_m": 1.55,
                "cg_to_rear_axle_m": 1.55,
            },
            (115_000.0, 122_000.0),
            -0.1,
            (10.0, 30.0, 0.09),
        ),
        "van, loaded": _car(
            {
                "mass_kg": 2600.0,
                "yaw_inertia_kg_m2": 6200.0,
                "cg_height_m": 0.8,
                "track_m": 1.7,
                "cg_to_front_axle_m": 1.45,
                "cg_to_rear_axle_m": 2.05,
            },
            (85_000.0, 95_000.0),
            -0.1,
            (5.0, 30.0, 0.06),
        ),
        "van, empty": _car(
            {
                "mass_kg": 2000.0,
                "yaw_inertia_kg_m2": 5000.0,
                "cg_height_m": 0.7,
                "track_m": 1.7,
                "cg_to_front_axle_m": 1.255,
                "cg_to_rear_axle_m": 2.245,
            },
            (75_400.0, 71_500.0),
            -0.1,
            (5.0, 30.0, 0.06),
        ),
    }


__all__ = ["PAPER", "SEED", "five_cars", "random_cars"]
