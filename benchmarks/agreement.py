"""Compare the map with the nonlinear tyre with a brute-force search, on random operating points of random cars, on all cores.

It measures no time, but the largest difference, and lists each operating point with a difference.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context

import numpy as np

from benchmarks.dense_search import DenseSearch
from benchmarks.random_cars import random_car, random_cells, using_grip
from benchmarks.tables import CountReport, Row
from codegen.optimum.nonlinear import NonlinearTurns
from tests.optimum.cars import CASE

CARS, CELLS, QUICK_CARS, QUICK_CELLS = 20, 100, 3, 10
SAME = 1e-4
"""rad/s."""


@dataclass
class Agreement:
    """Result of one or several cars: cells, cells feasible in both and compared, the largest difference in rad/s, and the
    cells that differ as text."""

    cells: int = 0
    feasible: int = 0
    largest: float = 0.0
    apart: list[str] = field(default_factory=list)

    def add(self, other: Agreement) -> None:
        """Take another car's in."""
        self.cells += other.cells
        self.feasible += other.feasible
        self.largest = max(self.largest, other.largest)
        self.apart += other.apart


def cap_of(turns: NonlinearTurns) -> Callable[[float], float]:
    """Return the cap of the lateral acceleration in m/s^2 over the speed in m/s."""
    return lambda speed: float(turns.cap(np.array([speed]))[0])


def of_car(number: int, cells: int) -> Agreement:
    """Compare a random car, by its number, on random cells. Every other car uses its grip."""
    rng = np.random.default_rng([1, number])
    config = random_car(rng)
    config = using_grip(config, rng) if number % 2 else config
    case = config.cases[CASE]
    turns = NonlinearTurns.from_config(config, case)
    search = DenseSearch.of(config, case, cap_of(turns))
    speed, front_angle = random_cells(turns, config, rng, cells)
    found = turns.at(speed, front_angle)
    result = Agreement(cells)
    for index in range(cells):
        best = search.best(float(speed[index]), float(front_angle[index]))
        where = f"car {number}, {3.6 * speed[index]:.3f} km/h, {np.degrees(front_angle[index]):.4f} deg"
        if best.feasible != found.feasible[index]:
            result.apart.append(
                f"{where}: feasible by {'brute force' if best.feasible else 'the solver'} only, "
                f"violation {best.violation:.1e} of a bound there, margin {found.margin[index]:.1e} here"
            )
        elif best.feasible and not np.isnan(best.yaw_rate):
            difference = abs(best.yaw_rate - float(found.yaw_rate[index]))
            result.feasible += 1
            result.largest = max(result.largest, difference)
            if difference > SAME:
                result.apart.append(f"{where}: {difference:.1e} rad/s apart, brute force {best.yaw_rate:.6f} rad/s")
    return result


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Run the comparison; `quick` uses fewer cars and cells."""
    cars, cells = (QUICK_CARS, QUICK_CELLS) if quick else (CARS, CELLS)
    total = Agreement()
    with ProcessPoolExecutor(
        os.process_cpu_count() if hasattr(os, "process_cpu_count") else os.cpu_count(), get_context("spawn")
    ) as pool:
        for number, found in enumerate(pool.map(of_car, range(cars), [cells] * cars)):
            total.add(found)
            say(f"brute force: car {number + 1} of {cars}, {len(total.apart)} cells apart so far")
    header = ("random points", "cars", "feasible in both", "yaw rates apart [rad/s]", "points apart", "required")
    required = f"none apart in feasibility or by more than {SAME:g} rad/s"
    counts = (f"{total.cells:,}", f"{cars}", f"{total.feasible:,}", f"{total.largest:.1e}", f"{len(total.apart)}")
    row = Row((*counts, f"{required}: {'MISSED' if total.apart else 'met'}"), not total.apart)
    return CountReport((("The map with the nonlinear tyre, against brute force", header, (row,)),), tuple(total.apart))
