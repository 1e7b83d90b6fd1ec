"""`codegen sil --suite cars`: random cars, each with a map, a controller and a build of its own, driven over step steers.

Each car is solved, tuned and built by the functions behind `codegen solve`, `tune` and `build`, in a process of its own, and
all its cells are driven at once in C. The limits hold for every car.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from codegen.config import KM_H, Config
from codegen.errors import CodegenError
from codegen.refmap.solve import solve_case
from codegen.sil.batch import BatchSoftware, Lanes, compile_batch
from codegen.tuning.transient import unit_step
from codegen.vehicle.plant_car import plant_parameters
from codegen.vehicle.single_track import SingleTrack
from hil_sim.metrics.step import slip_bounds, step_metrics
from hil_sim.suite.background import Background
from hil_sim.suite.candidate import RECOMMENDED_CASE, Steps
from hil_sim.suite.cells import DURATION, STEER_TIME, Cell, cells, front_angle
from hil_sim.suite.loop_margins import FamilyMargins, margins_of
from hil_sim.suite.random_cars import random_cars
from hil_sim.suite.requirements import Requirement, all_passed, car_requirements
from hil_sim.suite.runs import CellResult, judge
from hil_sim.suite.subjects import DELAY_SAMPLES, around, tuned
from hil_sim.suite.summary import Extreme, Summary, summarise

TYRE_MODEL = "magic-formula"
"""Of the maps: only such a map keeps the slip bounds of the plant."""

SPEEDS_KM_H = (60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0)
"""At the breakpoints of the gain schedule, and between them."""
SHARES = (0.5, 0.75, 1.0)


@dataclass(frozen=True)
class CarResult:
    """One car.

    Attributes:
        number: in the draw, from 1.
        mass_kg, wheelbase_m, understeer_deg_per_g, rear_angle_max_deg, actuator_lag_s: what it is.
        tuned: what `codegen tune` chose, keys of [controller.tracking].
        summary: of its cells; None where it could not be designed.
        slip_percent: largest steady slip of an axle over its bound.
        margins: over its family.
        requirements: figures asked beside figures measured.
        error: why it could not be solved, tuned or built.
    """

    number: int
    mass_kg: float
    wheelbase_m: float
    understeer_deg_per_g: float
    rear_angle_max_deg: float
    actuator_lag_s: float
    tuned: dict[str, Any]
    summary: Summary | None
    slip_percent: Extreme | None
    margins: FamilyMargins | None
    requirements: tuple[Requirement, ...]
    error: str = ""

    @property
    def passed(self) -> bool:
        """Whether it meets all limits."""
        return not self.error and all_passed(self.requirements)

    @property
    def title(self) -> str:
        """Its number and what it is."""
        return (
            f"car {self.number}: {self.mass_kg:,.0f} kg, {self.wheelbase_m:.2f} m, {self.understeer_deg_per_g:.2f} deg/g, "
            f"{self.rear_angle_max_deg:.1f} deg, {1e3 * self.actuator_lag_s:.0f} ms"
        )

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        facts = {key: value for key, value in asdict(self).items() if key not in ("margins", "requirements")}
        margins = None if self.margins is None else self.margins.to_dict()
        rows = [row.to_dict() for row in self.requirements]
        return {**facts, "passed": self.passed, "margins": margins, "requirements": rows}


@dataclass(frozen=True)
class CarsResult:
    """All cars of a draw."""

    seed: int
    cars: tuple[CarResult, ...]

    @property
    def passed(self) -> int:
        """How many cars meet all limits."""
        return sum(car.passed for car in self.cars)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        facts = {"seed": self.seed, "passed": self.passed, "speeds_km_h": list(SPEEDS_KM_H), "shares": list(SHARES)}
        return {**facts, "cars": [car.to_dict() for car in self.cars]}


def run_cars(seed: int, count: int, steps: Steps | None = None) -> CarsResult:
    """Draw cars, and examine them on all processors.

    Args:
        steps: called with (done, in all).

    Raises:
        CodegenError: there is no C compiler. What a single car causes is in its result.
    """
    with Background() as background:
        waiting = [background.call(examine, k, config) for k, config in enumerate(random_cars(seed, count), start=1)]
        found = []
        for done, job in enumerate(waiting, start=1):
            found.append(job.get())
            if steps is not None:
                steps(done, count)
    return CarsResult(seed, tuple(found))


def examine(number: int, config: Config) -> CarResult:
    """Solve, tune, build and drive one car."""
    car = SingleTrack.from_config(config)
    gradient = math.degrees(car.understeer_coefficient) * config.road.gravity_m_s2
    actuator = config.rear_actuator
    facts = (number, config.vehicle.mass_kg, car.wheelbase, gradient, actuator.angle_max_deg, actuator.lag_s)
    config = config.with_tyre_model(TYRE_MODEL)
    try:
        reference_map = solve_case(config, RECOMMENDED_CASE)
        config = tuned(reference_map, config)
        generated = around(reference_map, config).generated
        software = compile_batch(generated.files, generated.manifest)
        points = cells(config, config.case(RECOMMENDED_CASE), SPEEDS_KM_H, SHARES)
        results, slips = drive_cells(software, config, points)
        margins = margins_of(config)
    except CodegenError as error:
        return CarResult(*facts, {}, None, None, None, (), str(error))
    summary = summarise("tracking", "random car", results)
    slip = max(slips, key=lambda extreme: extreme.value, default=None)
    chosen = config.controller.tracking.model_dump(mode="json", exclude={"schedule"})
    rows = car_requirements(f"car {number}", summary, slip, margins)
    return CarResult(*facts, chosen, summary, slip, margins, rows)


def drive_cells(
    software: BatchSoftware, config: Config, points: tuple[Cell, ...]
) -> tuple[tuple[CellResult, ...], tuple[Extreme, ...]]:
    """Drive the configured car in all cells at once.

    Returns:
        The figures of each cell, and the steady slip of an axle over its bound, in percent, of each cell without a spin.
    """
    speeds, angles = (np.array(values) for values in zip(*((p.speed_km_h * KM_H, front_angle(p)) for p in points), strict=True))
    lanes = Lanes(
        np.repeat(plant_parameters(config)[np.newaxis], len(points), axis=0),
        speed_factor=speeds,
        wheel_factor=angles * config.steering.ratio,
        delay_samples=DELAY_SAMPLES,
    )
    records = np.moveaxis(software.run(unit_step(config, STEER_TIME, DURATION), lanes), 2, 0).transpose(0, 2, 1)
    look_up = software.software.function("map_yaw_rate")
    bounds = slip_bounds(config)
    results, slips = [], []
    for cell, record, speed, angle in zip(points, records, speeds, angles, strict=True):
        results.append(judge(record, cell, "random car", look_up(speed, angle)))
        if bounds is not None and not results[-1].spun:
            found = step_metrics(record, STEER_TIME)
            shares = (found.slip_front_steady_deg / bounds[0], found.slip_rear_steady_deg / bounds[1])
            slips.append(Extreme(100.0 * math.radians(max(map(abs, shares))), cell))
    return tuple(results), tuple(slips)
