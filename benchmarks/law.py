"""The control law on plants that are not its own: every requirement of it with what is asked and what is measured.

Measures no time. Four cars, solved, tuned and built in memory, are driven in batches; random ones keep the limits of the suite.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import law_grip, law_others, law_response, law_slow
from benchmarks.choices import WrongOption, chosen
from benchmarks.law_car import CARS, DWELLS, FLICKS, PLANTS, LawCar, configured, prepare
from benchmarks.law_figures import Figure, header, lines
from benchmarks.law_others import random_figures, third_party
from benchmarks.law_response import BEFORE_S, GUST_N, GUST_S, STRAIGHT_SPEEDS_KM_H
from benchmarks.law_slow import ACCELERATION, CIRCLE_KM_H, LAST_KM_H, OVERHANG_M, REVERSE_KM_H
from benchmarks.tables import CountReport
from codegen.errors import ConfigError
from codegen.files import reason_of
from hil_sim.suite.background import Background
from hil_sim.suite.cars import DEVELOPMENT_SEED, examine, random_cars
from hil_sim.suite.cells import CELL_STEER_TIME
from hil_sim.suite.requirements import Limits

SEED = 6
"""Seed of the random cars by default. The law was designed with cars of the seed DEVELOPMENT_SEED, and with those of CARS."""
COUNT, QUICK_COUNT = 40, 4
"""Random cars by default."""

CarRows = Callable[[LawCar, str], Any]
OF_CARS: Mapping[int, CarRows] = {**law_response.ROWS, **law_grip.ROWS, **law_others.ROWS, **law_slow.ROWS}
"""Number of a row -> function of a car and a plant that yields its figures."""
RANDOM, THIRD_PARTY = 1, 3
"""Numbers of the rows of the random cars and of the third party's car."""
KNOWN = sorted([RANDOM, *OF_CARS])


def run(
    quick: bool,
    say: Callable[[str], None],
    *,
    cars: int | None = None,
    seed: int = SEED,
    plant: str = ",".join(PLANTS),
    only: str = "",
    shown: str = "".join(CARS),
    maps: Path | None = None,
    changes: Sequence[str] = (),
    straight: float = 0.0,
) -> CountReport:
    """Measure the chosen rows.

    Args:
        quick: whether to draw fewer random cars by default.
        say: called with the progress.
        cars, seed: random cars, and the seed of their draw.
        plant: names of PLANTS, separated by commas.
        only: numbers of rows, separated by commas; "" for all.
        shown: letters of CARS.
        maps: folder that keeps the tuned maps from one call to the next.
        changes: KEY=VALUE for keys of `ars.toml`, JSON values.
        straight: s of driving straight ahead before the drives of row 7.

    Raises:
        WrongOption: an unknown plant, row, car or key, or no folder for the maps.
        CodegenError: a car cannot be solved or tuned, or there is no C compiler.
    """
    plants = chosen("--plant", plant.split(","), PLANTS)
    letters = chosen("--shown", list(shown), CARS)
    rows = [int(each) for each in chosen("--only", only.split(","), map(str, KNOWN))] if only else KNOWN
    values, count = _changes(changes, letters), (QUICK_COUNT if quick else COUNT) if cars is None else cars
    if rows == [RANDOM] and not count:
        raise WrongOption("no car is driven", where="--cars", remedy="choose more rows or cars")
    if maps is not None:
        _prepare_folder(maps)
    figures: list[Figure] = []
    with Background() as background:
        jobs = {}
        if any(row in OF_CARS for row in rows):
            jobs = {each: background.call(measure, each, values, maps, straight, rows, plants) for each in letters}
        if THIRD_PARTY in rows:
            jobs["third party's"] = background.call(third_party, values)
        drawn = random_cars(seed, count) if RANDOM in rows else ()
        examined = [background.call(examine, number, config, Limits()) for number, config in enumerate(drawn, start=1)]
        for name, job in jobs.items():
            figures += job.get()
            say(f"car {name}")
        found = []
        for waiting in examined:
            found.append(waiting.get())
            say(f"{found[-1].title} of {count}")
    figures += random_figures(found, seed) if found else ()
    return report(figures, letters, straight)


def _changes(given: Sequence[str], letters: Sequence[str]) -> dict[str, Any]:
    """Return key -> value. Raises WrongOption for one that a car cannot have."""
    values = dict(map(_change, given))
    try:
        for letter in letters:
            configured(letter, values)
    except ConfigError as error:
        raise WrongOption(str(error), where="--set") from None
    return values


def _prepare_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise WrongOption(f"{path} is no folder ({reason_of(error)})", where="--maps", remedy="name another one") from None


def _change(text: str) -> tuple[str, Any]:
    key, _, value = text.partition("=")
    try:
        return key, json.loads(value)
    except ValueError:
        raise WrongOption(f"{text!r} is no KEY=VALUE", where="--set", remedy="such as tuning.delay_samples=2") from None


def measure(
    letter: str,
    changes: Mapping[str, Any],
    maps: Path | None,
    straight: float,
    rows: Sequence[int],
    plants: Sequence[str],
) -> list[Figure]:
    """Return the figures of one car. Raises CodegenError."""
    return figures_of(prepare(letter, changes, maps, straight), rows, plants)


def figures_of(car: LawCar, rows: Sequence[int], plants: Sequence[str]) -> list[Figure]:
    """Return the figures of a car with any build. Raises BuildError."""
    return [each for row in rows if row in OF_CARS for plant in plants for each in OF_CARS[row](car, plant)]


def report(figures: Sequence[Figure], letters: Sequence[str], straight: float = 0.0) -> CountReport:
    """Return the table of the requirements, and the details."""
    judged, details = ([each for each in figures if bool(each.goal) == has_goal] for has_goal in (True, False))
    tables = [("The control law on plants that are not its own", header(letters), lines(judged, letters))]
    if details:
        tables.append(("Details", header(letters), lines(details, letters)))
    return CountReport(tuple(tables), _notes(straight))


def _notes(straight: float) -> tuple[str, ...]:
    cars = ", ".join(f"{letter}: {name}" for letter, name in CARS.items())
    return (
        f"Cars: {cars} (`benchmarks/judged_cars.py`); recommended preset, nonlinear tyre. They and the random cars of seed "
        f"{DEVELOPMENT_SEED} are the development set, the random cars of seed {SEED} the test set.",
        "Plants: ideal is the two-track car as the map has it; real is the configured one, with relaxation, roll, an actuator "
        "of second order and backlash; roll is the third plant, whose tyres are others as well. Commands act "
        "as late as configured, at least one sample. Noisy sensors have noise, resolution and bias of the configuration.",
        "Rows 5 to 9: the 24 steps of the suite, 25 to 120 km/h with 25 to 100 % of the largest front angle of the map. A "
        "car spins at more than 10 deg of sideslip with more than 5 deg of rear slip; other figures are of the other runs.",
        "Possible (row 6): largest steady yaw rate with any rear angle of the actuator, each axle within 90 % of the slip "
        "of its peak force, at most the map's. A cell is met at 99 % of it.",
        f"Row 7: steps, {FLICKS.speed.size} flicks and {DWELLS.speed.size} sines with dwell (60 to 100 km/h, 2 to 6 deg at the "
        "front wheels), each with a bias of the measured lateral acceleration of 0, +0.3 and -0.3 m/s^2 from the start, "
        f"{straight + CELL_STEER_TIME:g} s before a step. Details: spins with each bias; largest sideslip in deg with each.",
        "Row 9: a road carries a cell if the car can reach 99 % of the map's yaw rate on it.",
        f"Row 10: {GUST_N:g} N to the left at the front axle for {GUST_S:g} s, worst of 80 to 130 km/h; nobody steers. Linear: "
        "the sampled car of the design, with relaxation, lag and motor, and the gains over speed, without the rest "
        "of the law.",
        f"Row 11: nobody steers; worst of {STRAIGHT_SPEEDS_KM_H[0]:g} to {STRAIGHT_SPEEDS_KM_H[-1]:g} km/h and of both signs "
        f"of the bias of the acceleration. The biases are present for {BEFORE_S:g} s before.",
        "Row 12: requirements of `better`, the passive car on the same plant. Row 13: as `cortex-m`, for the first car.",
        "Row 14: the steps of row 5; 3 s after it the road banks within 1 s, which lowers the measured lateral acceleration. "
        "Largest change of the yaw rate against the level road, from then on.",
        f"Row 15: the wheel is held. The circle is driven at {CIRCLE_KM_H:g} km/h, its curvature compared with that of the "
        "passive car, times the ratio of both without slip. The car accelerates with "
        f"{ACCELERATION:g} m/s^2 from {REVERSE_KM_H:g} or 0 to {LAST_KM_H:g} km/h. The rear corner is {OVERHANG_M:g} m behind "
        "the axle, with the wheels at their stop; after a stop in the circle, the rear wheels are still turned.",
    )
