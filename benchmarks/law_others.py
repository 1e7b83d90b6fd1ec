"""Rows of the benchmark `law` that need more than batches of the four cars: random cars."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from benchmarks.law_car import PLANTS
from benchmarks.law_figures import Figure
from codegen.configuration import Config
from codegen.errors import CodegenError
from hil_sim.suite import cars
from hil_sim.suite.cells import Condition
from hil_sim.suite.controller_properties import margins_of
from hil_sim.suite.requirements import Limits, all_passed, car_requirements
from hil_sim.suite.runs import run_table, summarise

PASSING_SHARE = 0.9
"""Share of the random cars that must keep all limits on all plants."""


@dataclass(frozen=True)
class RandomCar:
    """A random car: its title, what it misses by plant, and why it was not built."""

    title: str
    missed: dict[str, str] = field(default_factory=dict)
    error: str = ""

    def keeps(self, plants: Sequence[str]) -> bool:
        """Return whether it keeps all limits of the suite on all of these plants."""
        return not self.error and not any(self.missed[plant] for plant in plants)


def examine(number: int, config: Config, plants: Sequence[str]) -> RandomCar:
    """Solve, tune and build a random car, and drive its cells on each plant."""
    title = f"car {number}"
    try:
        tested, points = cars.prepared(config)
        margins = margins_of(tested.config)
        driven = run_table(tested, [Condition(plant, plant, "combined", plant=PLANTS[plant]) for plant in plants], points)
    except CodegenError as error:
        return RandomCar(title, error=str(error))
    missed = {}
    for plant in plants:
        rows = car_requirements(title, summarise(tested.name, plant, driven[plant]), margins, Limits())
        found = [
            f"{row.figure} {'none' if row.measured is None else f'{row.measured:.3g}'}" for row in rows if not all_passed([row])
        ]
        missed[plant] = ", ".join(found)
    return RandomCar(title, missed)


def random_figures(drawn: Sequence[RandomCar], plants: Sequence[str], seed: int) -> Iterator[Figure]:
    """Yield row 1."""
    needed = int(PASSING_SHARE * len(drawn))
    title = f"random cars of seed {seed} that keep all limits of the suite"
    for chosen in ([plant] for plant in plants):
        count = sum(car.keeps(chosen) for car in drawn)
        yield Figure(1, title, chosen[0], f"{needed} of {len(drawn)}", "", f"{count}", count >= needed)
    count = sum(car.keeps(plants) for car in drawn)
    yield Figure(1, title, "all of them", f"{needed} of {len(drawn)}", "", f"{count}", count >= needed)
    for car in drawn:
        for plant, missed in car.missed.items():
            if missed:
                yield Figure(1, f"{car.title}, misses", plant, "", "", missed)
        if car.error:
            yield Figure(1, f"{car.title}, not built", "-", "", "", car.error)
