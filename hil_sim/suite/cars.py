"""`codegen sil --suite cars`: random cars, each with its own map, controller and build, in step steers.

Each car is solved, tuned and built by the functions behind `codegen solve`, `tune` and `build`, in a process of its own, and
all its cells are simulated at once in C. The limits apply to every car.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.optimum.solve import solve_case
from codegen.vehicle.single_track import SingleTrack
from hil_sim.suite.background import Background
from hil_sim.suite.candidate import RECOMMENDED_CASE, Steps
from hil_sim.suite.cells import cells
from hil_sim.suite.conditions import NOMINAL
from hil_sim.suite.limits import Limits
from hil_sim.suite.loop_margins import FamilyMargins, margins_of
from hil_sim.suite.random_cars import random_cars
from hil_sim.suite.requirements import Requirement, all_passed, car_requirements
from hil_sim.suite.runs import run_table
from hil_sim.suite.subjects import of_config, tuned
from hil_sim.suite.summary import Summary, summarise

TYRE_MODEL = "magic-formula"
"""Tyre model of the maps: only the nonlinear one keeps the slip bounds of the plant."""

SPEEDS_KM_H = (60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0)
"""Speeds at the breakpoints of the gain schedule and between them."""
SHARES = (0.5, 0.75, 1.0)


@dataclass(frozen=True)
class CarResult:
    """Result of one car.

    Attributes:
        number: number in the draw, from 1.
        mass_kg, wheelbase_m, understeer_deg_per_g, rear_angle_max_deg, actuator_lag_s: its properties.
        tuned: what `codegen tune` chose, keys of [controller.tracking].
        summary: figures over its cells; None if the design failed.
        margins: margins over its family.
        requirements: required and measured figures.
        error: reason why it could not be solved, tuned or built.
    """

    number: int
    mass_kg: float
    wheelbase_m: float
    understeer_deg_per_g: float
    rear_angle_max_deg: float
    actuator_lag_s: float
    tuned: dict[str, Any]
    summary: Summary | None
    margins: FamilyMargins | None
    requirements: tuple[Requirement, ...]
    error: str = ""

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

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        facts = {key: value for key, value in asdict(self).items() if key not in ("margins", "requirements")}
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

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        facts = {"seed": self.seed, "passed": self.passed, "speeds_km_h": list(SPEEDS_KM_H), "shares": list(SHARES)}
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
        points = cells(config, config.case(RECOMMENDED_CASE), SPEEDS_KM_H, SHARES)
        results = run_table(of_config("tracking", reference_map, config), [NOMINAL], points)[NOMINAL.name]
        margins = margins_of(config)
    except CodegenError as error:
        return CarResult(*facts, {}, None, None, (), str(error))
    summary = summarise("tracking", "random car", results)
    chosen = config.controller.tracking.model_dump(mode="json", exclude={"schedule"})
    rows = car_requirements(f"car {number}", summary, margins, limits)
    return CarResult(*facts, chosen, summary, margins, rows)
