"""`codegen suite cars`: random cars, each with its own map, controller and build, in step steers.

The cars are plausible ones, from a small car to a van with any sensible tyres, with the recommended controller. The draw of
`tests/optimum/cars.py` is wider on purpose, to test the solvers with implausible cars. Each car is solved, tuned and built by
the functions behind `codegen solve`, `tune` and `build`, in a process of its own, and all its cells are simulated at once in C:
on the configured plant and on the third plant, to which the limits apply, and on the ideal one, which is reported beside them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from codegen import configuration
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.optimum.solve import solve_case
from codegen.vehicle.single_track import SingleTrack
from hil_sim.suite.background import Background
from hil_sim.suite.cells import IDEAL, NOMINAL, Condition, cells, last_cell_km_h, up_to
from hil_sim.suite.controller_properties import FamilyMargins, margins_of
from hil_sim.suite.requirements import ROLL_PLANT, Limits, Requirement, all_passed, car_requirements
from hil_sim.suite.runs import Summary, run_table, summarise
from hil_sim.suite.subjects import RECOMMENDED_CASE, Steps, of_config, tuned
from hil_sim.third_plant import rolling

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
    return base.replace(
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


TYRE_MODEL = "magic-formula"
"""Tyre model of the maps: only the nonlinear one keeps the slip bounds of the plant."""

CARS_SPEEDS_KM_H = (60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0)
"""Speeds at the breakpoints of the gain schedule and between them."""
CARS_ANGLE_SHARES = (0.5, 0.75, 1.0)


ROLL_CONDITION = Condition(
    ROLL_PLANT, "roll plant", "plant", rolling, what="the third plant, without the errors of its sensors"
)
PLANTS = (NOMINAL, ROLL_CONDITION, IDEAL)


@dataclass(frozen=True)
class CarResult:
    """Result of one car.

    Attributes:
        number: number in the draw, from 1.
        mass_kg, wheelbase_m, understeer_deg_per_g, rear_angle_max_deg, actuator_lag_s: its properties.
        tuned: what `codegen tune` chose, keys of [controller.tracking].
        summaries: name of each of PLANTS to the figures over its cells; empty if the design failed.
        margins: margins over its family.
        requirements: required and measured figures. limits: required values.
        error: reason why it could not be solved, tuned or built.
    """

    number: int
    mass_kg: float
    wheelbase_m: float
    understeer_deg_per_g: float
    rear_angle_max_deg: float
    actuator_lag_s: float
    tuned: dict[str, Any]
    summaries: Mapping[str, Summary]
    margins: FamilyMargins | None
    requirements: tuple[Requirement, ...]
    error: str = ""
    limits: Limits = field(default_factory=Limits)

    @property
    def passed(self) -> bool:
        """Whether it meets all limits."""
        return not self.error and all_passed(self.requirements)

    @property
    def title(self) -> str:
        """Number and main properties as text."""
        return (
            f"car {self.number}: {self.mass_kg:,.0f} kg, {self.wheelbase_m:.2f} m, {self.understeer_deg_per_g:.2f} deg/g, "
            f"{self.rear_angle_max_deg:.1f} deg, {1e3 * self.actuator_lag_s:.0f} ms"
        )

    def passed_on(self, plant: Condition) -> bool:
        """Return whether it meets all limits of cells on one of PLANTS, and those of margins."""
        if plant.name not in self.summaries:
            return False
        limits_of = ROLL_CONDITION if plant == ROLL_CONDITION else NOMINAL
        return all_passed(car_requirements("", {limits_of.name: self.summaries[plant.name]}, self.margins, self.limits))

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        left_out = ("margins", "requirements", "limits")
        facts = {key: value for key, value in asdict(self).items() if key not in left_out}
        margins = None if self.margins is None else self.margins.to_dict()
        rows = [row.to_dict() for row in self.requirements]
        return {**facts, "passed": self.passed, "margins": margins, "requirements": rows}


@dataclass(frozen=True)
class CarsResult:
    """All cars of a draw."""

    seed: int
    cars: tuple[CarResult, ...]
    limits: Limits = field(default_factory=Limits)

    @property
    def passed(self) -> int:
        """Number of cars that meet all limits."""
        return sum(car.passed for car in self.cars)

    def passed_on(self, plant: Condition) -> int:
        """Return the number of cars that meet the limits on one of PLANTS."""
        return sum(car.passed_on(plant) for car in self.cars)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        facts = {
            "seed": self.seed,
            "passed": self.passed,
            "speeds_km_h": list(CARS_SPEEDS_KM_H),
            "shares": list(CARS_ANGLE_SHARES),
        }
        facts["passed_on"] = {plant.name: self.passed_on(plant) for plant in PLANTS}
        return {**facts, "cars": [car.to_dict() for car in self.cars]}


def run_cars(seed: int, count: int, steps: Steps | None = None, limits: Limits | None = None) -> CarsResult:
    """Draw cars and test them on all processors.

    Args:
        steps: called with (done, in all).
        limits: limits for each car; None uses the defaults.

    Raises:
        CodegenError: there is no C compiler. Errors of a single car are in its result.
    """
    asked = limits or Limits()
    with Background() as background:
        drawn = enumerate(random_cars(seed, count), start=1)
        waiting = [background.call(examine, k, config, asked) for k, config in drawn]
        found = []
        for done, job in enumerate(waiting, start=1):
            found.append(job.get())
            if steps is not None:
                steps(done, count)
    return CarsResult(seed, tuple(found), asked)


def examine(number: int, config: Config, limits: Limits) -> CarResult:
    """Solve, tune, build and simulate one car."""
    car = SingleTrack.from_config(config)
    gradient = math.degrees(car.understeer_coefficient) * config.road.gravity_m_s2
    actuator = config.rear_actuator
    facts = (number, config.vehicle.mass_kg, car.wheelbase, gradient, actuator.angle_max_deg, actuator.lag_s)
    config = config.with_tyre_model(TYRE_MODEL)
    try:
        reference_map = solve_case(config, RECOMMENDED_CASE)
        config = tuned(reference_map, config)
        points = cells(
            config, config.case(RECOMMENDED_CASE), up_to(last_cell_km_h(config), CARS_SPEEDS_KM_H), CARS_ANGLE_SHARES
        )
        results = run_table(of_config("tracking", reference_map, config), PLANTS, points)
        margins = margins_of(config)
    except CodegenError as error:
        return CarResult(*facts, {}, {}, None, (), str(error))
    summaries = {plant: summarise("tracking", plant, found) for plant, found in results.items()}
    chosen = config.controller.tracking.model_dump(mode="json", exclude={"schedule"})
    rows = car_requirements(f"car {number}", summaries, margins, limits)
    return CarResult(*facts, chosen, summaries, margins, rows, limits=limits)
