"""Rows of the benchmark `law` that other benchmarks and suites measure, and those of other cars than the four."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks.better import CRITERIA
from benchmarks.judged_car import CarFigures, Dwell, LaneChanges
from benchmarks.law_car import CARS, IDEAL, PLANTS, LawCar
from benchmarks.law_figures import Figure
from codegen import configuration
from codegen.judgement.bench import Bench
from codegen.judgement.drives import drive_dwells, drive_sweep
from codegen.judgement.lane_change import DRIVERS, lane_change_figures
from codegen.verify.outcomes import Effort, Subject
from codegen.verify.resource_usage import CYCLE, measure
from hil_sim.suite import cars
from hil_sim.suite.cells import NOMINAL
from hil_sim.suite.full_suite import Job
from hil_sim.suite.requirements import STEP_INSTRUCTIONS_MAX, all_passed
from hil_sim.suite.subjects import RECOMMENDED_CASE

PASSING_SHARE = 0.9
"""Share of the random cars that must keep all limits on all plants."""
THIRD_PARTY_OVERSHOOT_PERCENT = 5.0
DRIVEN = CRITERIA[-4:]
"""Criteria of the benchmark `better` for the sine with dwell and the lane change."""
TASK_INSTRUCTIONS_MAX = 2_183
"""Instructions of the longest control period."""


def random_figures(drawn: Sequence[cars.CarResult], seed: int) -> Iterator[Figure]:
    """Yield row 1."""
    needed, title = math.ceil(PASSING_SHARE * len(drawn)), f"random cars of seed {seed} that keep all limits of the suite"
    counts = {plant.title: sum(car.passed_on(plant) for car in drawn) for plant in cars.PLANTS}
    counts[f"{NOMINAL.title} and {cars.ROLL_CONDITION.title}"] = sum(car.passed for car in drawn)
    for plant, count in counts.items():
        yield Figure(1, title, plant, f"{needed} of {len(drawn)}", "", f"{count}", count >= needed)
    for car in drawn:
        missed = [row for row in car.requirements if not all_passed([row])]
        found = ", ".join(f"{row.figure} {'-' if row.measured is None else f'{row.measured:.3g}'}" for row in missed)
        if not car.passed:
            yield Figure(1, f"{car.title}, misses", "-", "", "", car.error or found)


def third_party(changes: Mapping[str, Any]) -> list[Figure]:
    """Return the figure of the third party's car (row 3), a car of its own. Raises CodegenError."""
    config = configuration.preset("recommended").replace(changes, "third party's car")
    results = Job(config, RECOMMENDED_CASE)()
    spins = sum(result.spun for result in results)
    worst = max((result.overshoot_percent or 0.0 for result in results), default=0.0)
    title, goal = "overshoot on the third party's car, %", f"{THIRD_PARTY_OVERSHOOT_PERCENT:g}"
    text = f"{spins} spins, {worst:.1f}" if spins else f"{worst:.1f}"
    return [Figure(3, title, "multi-body", goal, "", text, not spins and worst <= THIRD_PARTY_OVERSHOOT_PERCENT)]


def better(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 12: sine with dwell and lane change against the passive car."""
    config = PLANTS[plant](car.config)
    software = car.tested.around.batch(config)
    bench = Bench(software, config, software.parameters(**car.tested.parameters))
    own, passive = drive_dwells(bench).displacement_m[:, 0]
    lane = lane_change_figures(bench, DRIVERS)
    entry = LaneChanges(plant, lane.speed_km_h, lane.passive_speed_km_h, lane.sideslip_deg, lane.passive_sideslip_deg)
    dwells = (Dwell(plant, car.tested.name, float(own), float(passive)),)
    found = CarFigures(car.letter, dwells=dwells, sweep=drive_sweep(bench), lane_changes=(entry,))
    for criterion in DRIVEN:
        yield Figure(12, criterion.title, plant, criterion.goal, car.letter, criterion.shown(found), criterion.is_met(found))


def instructions(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 13: instructions of the first car on a Cortex-M4F. Raises MissingTool."""
    if car.letter != next(iter(CARS)) or plant != IDEAL:
        return
    generated = car.tested.around.generated
    counts = measure(Subject(car.letter, generated.files, generated.manifest), Effort(quick=False)).counts
    step, task = counts["controller_step"].instructions_with_limiter, counts[CYCLE].instructions
    assert step is not None  # every step has a limiter
    limits = (
        ("tracking step with limiter", step.max, STEP_INSTRUCTIONS_MAX),
        ("control period", task.max, TASK_INSTRUCTIONS_MAX),
    )
    for title, found, most in limits:
        yield Figure(13, f"{title}, instructions", "Cortex-M4F", f"{most:,}", car.letter, f"{found:,}", found <= most)


ROWS = {12: better, 13: instructions}
"""Number of a row -> its figures of a car on a plant."""
