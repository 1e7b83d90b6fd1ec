"""Plausible random cars with the recommended controller, from a small car to a van with any sensible tyres.

The draw of `tests/optimum/cars.py` is wider on purpose, to test the solvers with implausible cars.
"""

from __future__ import annotations

import math

import numpy as np

from codegen import configuration
from codegen.configuration import Config
from hil_sim.suite.plants import changed

DEVELOPMENT_SEED, TEST_SEED = 1, 4
"""Seeds for design and for testing. No design may use the cars of the test seed. Earlier designs used seeds 2 and 3."""

MASS_KG = (1_300.0, 3_500.0)
UNDERSTEER_DEG_PER_G = (-0.1, 3.0)
REAR_ANGLE_MAX_DEG = (3.0, 10.0)
ACTUATOR_LAG_S = (0.02, 0.12)
"""Drawn evenly in its logarithm: fast actuators differ as much from each other as slow ones."""

REAR_COMPLIANCE_DEG_PER_G = (1.8, 4.0)
"""Slip angle of the rear axle for each g; that of the front axle is larger by the understeer gradient (R. T. Bundorf,
R. L. Leffert, The Cornering Compliance Concept for Description of Vehicle Directional Control Properties, SAE 760713)."""

COMMAND_RATE_SHARE = 5.0 / 6.0
"""Limit of the command's rate over that of the actuator, as in the recommended preset."""


def random_car(rng: np.random.Generator) -> Config:
    """Draw one car. Each figure is even over its range, unless stated otherwise; size goes with the mass."""

    def draw(ends: tuple[float, float]) -> float:
        return float(rng.uniform(*ends))

    base = configuration.preset("recommended")
    mass = draw(MASS_KG)
    size = (mass - MASS_KG[0]) / (MASS_KG[1] - MASS_KG[0])
    wheelbase = 2.45 + 0.95 * size + draw((-0.15, 0.15))
    front_share = draw((0.46, 0.60))
    arms = wheelbase * (1.0 - front_share), wheelbase * front_share
    rear_compliance = draw(REAR_COMPLIANCE_DEG_PER_G)
    compliances = rear_compliance + draw(UNDERSTEER_DEG_PER_G), rear_compliance
    weight = mass * base.road.gravity_m_s2
    shape, curvature = draw((1.2, 1.5)), draw((-1.0, 0.2))
    sensitivity, peak = draw((-0.12, 0.0)), draw((0.95, 1.1))
    tyres = {
        axle: {
            "cornering_stiffness_n_per_rad": 0.5 * share * weight / math.radians(compliance),
            "stiffness_factor_b_per_rad": None,
            "shape_factor_c": shape,
            "curvature_factor_e": curvature,
            "peak_factor_p1": peak,
            "peak_load_sensitivity_p2": sensitivity,
        }
        for axle, share, compliance in zip(("front", "rear"), (front_share, 1.0 - front_share), compliances, strict=True)
    }
    rear_angle, rear_rate = draw(REAR_ANGLE_MAX_DEG), draw((25.0, 50.0))
    lag = float(np.exp(rng.uniform(*np.log(ACTUATOR_LAG_S))))
    return changed(
        base,
        {
            "vehicle": {
                "mass_kg": mass,
                "yaw_inertia_kg_m2": mass * arms[0] * arms[1] * draw((0.9, 1.1)),
                "cg_height_m": 0.48 + 0.2 * size + draw((-0.05, 0.05)),
                "track_m": 1.5 + 0.2 * size + draw((-0.05, 0.05)),
                "cg_to_front_axle_m": arms[0],
                "cg_to_rear_axle_m": arms[1],
                "front_roll_share": draw((0.5, 0.65)),
            },
            "tyre": tyres,
            "limits": {"rear_angle_max_deg": rear_angle},
            "steering": {"ratio": draw((12.0, 18.0))},
            "rear_actuator": {"angle_max_deg": rear_angle, "rate_max_deg_s": rear_rate, "lag_s": lag},
            "controller": {"rear_rate_max_deg_s": COMMAND_RATE_SHARE * rear_rate},
            "limiter": {"rear_rate_max_deg_s": rear_rate},
        },
    )


def random_cars(seed: int, count: int) -> tuple[Config, ...]:
    """Draw `count` cars; the first ones of a seed do not depend on how many are drawn."""
    rng = np.random.default_rng(seed)
    return tuple(random_car(rng) for _ in range(count))
