"""Identification of cars that the model does not describe: do the 95 % intervals contain the truth?

Brush and TMeasy tyres on cars of `benchmarks.foreign_cars`, and the third-party multi-body cars of `hil_sim.second_plant`.
Sideslip is measured. Half of the programmes reach the limit of grip; the others end below 4 m/s^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.foreign_cars import GRAVITY, LEFT, OUTPUTS, WHEELS, Cars, brush, is_driven, random_cars, simulate, tmeasy
from benchmarks.tables import CountReport, Row
from codegen.arrays import FloatArray
from codegen.configuration import Config, preset
from codegen.identify.drive import Drive
from codegen.identify.outcome import identify_and_predict
from codegen.identify.reached import HELD_S, PEAK_QUANTILE, held_means
from codegen.identify.summary import CONFIDENCE_FACTOR
from codegen.sil.plant import PlantInput, PlantSample
from codegen.units import DEGREE
from hil_sim.second_plant.plant import PUBLISHED, car_of, published
from hil_sim.suite.background import Background
from tests.identify.drives import STEP, Course, Errors, Part, configured_car, drive, measure, profile
from tests.identify.foreign import START, LeaningMultiBodyPlant

AXLES = ("front", "rear")
FIGURES = ("stiffness", "force", "slip")
TITLES = {"stiffness": "cornering stiffness", "force": "largest force reached", "slip": "slip at grip_use_max"}
KINDS = {"brush": brush, "TMeasy": tmeasy}
GROUPS = (("brush", 500, 9, True), ("brush", 600, 8, False), ("TMeasy", 700, 9, True), ("TMeasy", 800, 8, False))
"""Kind of tyre, first seed, number of cars, and whether they are driven to the limit. With the multi-body cars, 40."""
SPARE = 2
"""Cars that are drawn for each one that is identified: some of them spin at the limit."""
LIMIT_M_S2, MULTI_BODY_LIMIT_M_S2 = 14.0, 9.0
"""Lateral acceleration of the linear car to which a car is steered at the limit; more rolls a multi-body car over."""
COVERAGE_MIN = 0.90
"""Smallest fraction of the intervals that contain the truth."""
SIGNALS = ("vx", "delta_f", "yaw_rate", "delta_r", "lateral_acceleration", "delta_r_command", "sideslip")
ANGLE_MAX_DEG = 5.0
SLOW_DRIVES = (1, 5)
"""Drives of `programme` with slow turns."""
BIN, SLIP_SMALL = 0.05 * DEGREE, 0.5 * DEGREE
"""Width of the slips over which the force of a multi-body car is averaged, and the slip up to which it is linear. Roll cambers
its wheels, so that the stiffness of an axle is not that of upright tyres."""
FORCE_ITERATIONS = 60
"""Halvings of the error of a force that depends on its own load transfer."""
SLIPS = np.linspace(0.0, 20.0, 4001) * DEGREE


@dataclass(frozen=True, eq=False)
class Driven:
    """A car that was driven, and its truth.

    Attributes:
        known: what the identification starts from. drives: measured, the last one held out.
        truth: (axle, name of FIGURES) -> SI: stiffness of a tyre, largest force of an axle, and slip at its use of grip.
    """

    kind: str
    known: Config
    drives: tuple[Drive, ...]
    truth: dict[tuple[str, str], float]


def programme(course: Course, limit: float, *, to_the_limit: bool) -> tuple[tuple[Part, ...], ...]:
    """Return six drives and one that is held out. `limit`: m/s^2, see LIMIT_M_S2."""
    strong = (course.turns(60.0, 6.5), course.limit(60.0, limit)) if to_the_limit else (course.turns(60.0, 3.0),)
    return (
        (course.straight(),),
        (course.turns(40.0), course.turns(80.0)),
        (course.front_sweep(50.0), course.front_sweep(80.0)),
        (course.rear_sweep(60.0),),
        (course.rear_steps(),),
        strong,
        course.hold_out(),
    )


def static_force(cars: Cars, axle: int) -> FloatArray:
    """Return the force (slips, n) of an axle in steady turns at SLIPS, N, with the load transfer of that turn."""
    other = cars.rear_arm if axle == 0 else cars.front_arm
    roll_share = cars.front_roll_share if axle == 0 else 1.0 - cars.front_roll_share
    centre = cars.front_centre if axle == 0 else cars.rear_centre
    static = cars.static_loads
    body = cars.sprung_share * cars.mass * cars.roll_arm
    lean = body / (cars.roll_stiffness - body * GRAVITY)
    of_springs = roll_share * cars.roll_stiffness * lean + cars.mass * other / cars.wheelbase * centre
    slip = np.broadcast_to(np.tan(SLIPS)[:, None, None], (len(SLIPS), len(cars.mass), WHEELS))
    result = np.zeros((len(SLIPS), len(cars.mass)))
    for _ in range(FORCE_ITERATIONS):
        acceleration = result * cars.wheelbase / (cars.mass * other)
        transfer = acceleration / cars.track * of_springs
        load = np.maximum(static - LEFT * transfer[..., None], 0.0)
        each = -cars.forces(slip, load)[..., 2 * axle : 2 * axle + 2]
        result = 0.5 * (result + each.sum(axis=-1))
    return result


def configuration_of(cars: Cars, index: int) -> Config:
    """Return a configuration with the geometry and the cornering stiffnesses of one car; the other keys are the preset's."""
    base = preset("recommended").with_ideal_plant()
    body = cars.sprung_share * cars.mass * cars.roll_arm
    rolled = cars.roll_stiffness * body / (cars.roll_stiffness - body * GRAVITY)
    front = cars.front_roll_share * rolled + cars.mass * cars.rear_arm / cars.wheelbase * cars.front_centre
    rear = (1.0 - cars.front_roll_share) * rolled + cars.mass * cars.front_arm / cars.wheelbase * cars.rear_centre
    vehicle = {
        "mass_kg": cars.mass,
        "cg_height_m": cars.height,
        "track_m": cars.track,
        "cg_to_front_axle_m": cars.front_arm,
        "cg_to_rear_axle_m": cars.rear_arm,
        "front_roll_share": front / (front + rear),
        "yaw_inertia_kg_m2": cars.yaw_inertia,
    }
    tyres = {
        axle: {"cornering_stiffness_n_per_rad": float(values[index]), "stiffness_factor_b_per_rad": None}
        for axle, values in (("front", cars.front_stiffness), ("rear", cars.rear_stiffness))
    }
    return base.replace(
        {
            "vehicle": {key: float(values[index]) for key, values in vehicle.items()},
            "tyre": tyres,
            "rear_actuator": {"angle_max_deg": ANGLE_MAX_DEG},
        }
    )


def rolling_cars(kind: str, seed: int, count: int, to_the_limit: bool) -> list[Driven]:
    """Draw cars with brush or TMeasy tyres, drive them, and return the first ones that stayed on the road."""
    cars = random_cars(np.random.default_rng(seed), KINDS[kind], SPARE * count)
    configs = [configuration_of(cars, k) for k in range(SPARE * count)]
    errors = Errors()
    courses = [programme(Course(config), LIMIT_M_S2, to_the_limit=to_the_limit) for config in configs]
    actuators = [
        (each.rear_actuator.lag_s, each.rear_actuator.rate_max_deg_s * DEGREE, ANGLE_MAX_DEG * DEGREE) for each in configs
    ]
    given, outputs = [], []
    late = round(errors.command_delay / STEP)
    for number in range(len(courses[0])):
        rows = np.stack([profile(course[number]) for course in courses], axis=1)
        acting = rows.copy()
        acting[late:, :, 2] = rows[: len(rows) - late, :, 2]
        given.append(rows)
        outputs.append(simulate(cars, acting, STEP, actuators))
    forces = [static_force(cars, axle) for axle in (0, 1)]
    result: list[Driven] = []
    for k, config in enumerate(configs):
        if len(result) == count or not all(is_driven(one[:, k]) for one in outputs):
            continue
        truth = {}
        for axle, name in enumerate(AXLES):
            column = OUTPUTS.index(f"{name}_force")
            largest = largest_held([one[:, k, column] for one in outputs[:-1]])
            truth[name, "stiffness"] = float((cars.front_stiffness, cars.rear_stiffness)[axle][k])
            truth[name, "force"] = largest
            truth[name, "slip"] = first_slip(SLIPS, forces[axle][:, k], use_of(config) * largest)
        drives = tuple(
            measure(
                config, rows[:, k], one[:, k, :6], 100 * (seed + k) + number, errors, name=f"drive {number}", signals=SIGNALS
            )
            for number, (rows, one) in enumerate(zip(given, outputs, strict=True))
        )
        result.append(Driven(kind, configured_car(config), drives, truth))
    return result


def use_of(config: Config) -> float:
    """Return `limits.grip_use_max`."""
    use = config.limits.grip_use_max
    assert use is not None  # the preset has it
    return use


def largest_held(forces: list[FloatArray]) -> float:
    """Return the largest force of some drives as `identify.reached` has it."""
    means = [held_means(force, round(HELD_S / STEP)) for force in forces]
    return float(np.quantile(np.abs(np.concatenate(means)), PEAK_QUANTILE))


def first_slip(slips: Any, forces: Any, level: float) -> float:
    """Return the smallest slip (rad) at which a curve (n,) reaches a force (N); NaN if it does not."""
    beyond = np.flatnonzero(forces >= level)
    if not beyond.size:
        return math.nan
    last = int(beyond[0])
    return float(np.interp(level, forces[max(last - 1, 0) : last + 1], slips[max(last - 1, 0) : last + 1]))


class RecordedPlant(LeaningMultiBodyPlant):
    """The third-party car, which keeps what it did: lateral acceleration, yaw rate and slip of both axles, SI."""

    def __init__(self, config: Config, speed: float, parameters: object) -> None:
        super().__init__(config, speed, parameters)
        self.kept: list[tuple[float, float, float, float]] = []

    def sample(self, acting: PlantInput) -> PlantSample:
        """Return the current outputs."""
        found = super().sample(acting)
        self.kept.append((found.lateral_acceleration, found.yaw_rate, found.slip_front, found.slip_rear))
        return found


def multi_body_car(number: int, to_the_limit: bool) -> Driven:
    """Drive a third-party multi-body car."""
    base = preset("recommended").with_ideal_plant().replace({"rear_actuator": {"angle_max_deg": ANGLE_MAX_DEG}})
    config = car_of(published(number), base)
    drives, kept = [], []
    for place, parts in enumerate(programme(Course(config), MULTI_BODY_LIMIT_M_S2, to_the_limit=to_the_limit)):
        plant = RecordedPlant(config, START.speed, published(number))
        drives.append(
            drive(config, (START, *parts), 900 + 10 * number + place, name=f"drive {place}", signals=SIGNALS, plant=plant)
        )
        kept.append(np.array(plant.kept))
    vehicle, truth = config.vehicle, {}
    for axle, name in enumerate(AXLES):
        arm, side = (vehicle.cg_to_rear_axle_m, 1.0) if axle == 0 else (vehicle.cg_to_front_axle_m, -1.0)
        forces = [
            (vehicle.mass_kg * arm * one[:, 0] + side * vehicle.yaw_inertia_kg_m2 * np.gradient(one[:, 1], STEP))
            / vehicle.wheelbase
            for one in kept
        ]
        slips = np.concatenate([kept[place][:, 2 + axle] for place in SLOW_DRIVES])
        slow = -np.sign(slips) * np.concatenate([forces[place] for place in SLOW_DRIVES])  # a force is opposite to its slip
        slips = np.abs(slips)
        bins = (slips / BIN).astype(int)
        count = np.bincount(bins)
        mean = np.bincount(bins, slow)[count > 0] / count[count > 0]
        largest = largest_held(forces[:-1])
        small = slips < SLIP_SMALL
        truth[name, "stiffness"] = 0.5 * float(slips[small] @ slow[small] / (slips[small] @ slips[small]))
        truth[name, "force"] = largest
        truth[name, "slip"] = first_slip((np.flatnonzero(count) + 0.5) * BIN, mean, use_of(config) * largest)
    return Driven("multi-body", configured_car(config), tuple(drives), truth)


@dataclass(frozen=True)
class Found:
    """Figures of an identified car: (axle, name of FIGURES) -> value, standard deviation and truth, SI; number of doubts."""

    kind: str
    figures: dict[tuple[str, str], tuple[float, float, float]]
    doubts: int


def examine(driven: Driven) -> Found:
    """Identify a car."""
    *fitted, held_out = driven.drives
    outcome = identify_and_predict(driven.known, fitted, [held_out])
    figures = {}
    for axle, force in zip(AXLES, outcome.forces, strict=True):
        stiffness = outcome.found.quantities[f"{axle}_stiffness"]
        figures[axle, "stiffness"] = stiffness.value, stiffness.standard_deviation
        figures[axle, "force"] = force.force, force.force_deviation
        figures[axle, "slip"] = force.slip_limit, force.slip_limit_deviation
    return Found(driven.kind, {key: (*figures[key], driven.truth[key]) for key in figures}, len(outcome.doubts))


def rows_of(results: list[Found]) -> Iterator[Row]:
    """Yield a row for each kind of car and figure, and one for each figure of all cars."""
    for kind in (*dict.fromkeys(one.kind for one in results), "all"):
        chosen = [one for one in results if kind in (one.kind, "all")]
        for figure in FIGURES:
            values = np.array([one.figures[axle, figure] for one in chosen for axle in AXLES])
            values = values[np.isfinite(values).all(axis=1)]
            if not len(values):
                continue
            error, interval = np.abs(values[:, 0] - values[:, 2]), CONFIDENCE_FACTOR * values[:, 1]
            inside = int((error <= interval).sum())
            cells = (
                kind,
                TITLES[figure],
                f"{inside} of {len(values)}",
                f"at least {100.0 * COVERAGE_MIN:g} %" if kind == "all" else "",
                *(f"{100.0 * float(each):.1f} %" for each in np.quantile(error / values[:, 2], (0.5, 1.0))),
                f"{100.0 * float(np.median(interval / values[:, 0])):.1f} %",
            )
            yield Row(cells, kind != "all" or inside >= COVERAGE_MIN * len(values))


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Identify forty cars; `quick` takes one of the first and of the last group, and no multi-body car."""
    with Background() as background:
        groups = [
            background.call(rolling_cars, kind, seed, 1 if quick else count, limit)
            for kind, seed, count, limit in GROUPS[:: len(GROUPS) - 1 if quick else 1]
        ]
        bodies = (
            [] if quick else [background.call(multi_body_car, number, limit) for number in PUBLISHED for limit in (True, False)]
        )
        driven = [car for job in groups for car in job.get()] + [job.get() for job in bodies]
        say(f"{len(driven)} cars were driven")
        results = []
        for number, job in enumerate([background.call(examine, car) for car in driven], start=1):
            results.append(job.get())
            say(f"car {number}")
    header = ("plant", "figure", "intervals right", "required", "error, median", "error, largest", "95 % interval, median ±")
    doubted = sum(one.doubts > 0 for one in results)
    notes = (
        f"{len(results)} identifications from the preset with the car's mass and geometry, six drives each with noise and "
        "measured sideslip, and one held out; each figure for both axles.",
        f"{doubted} of them have doubts, and the family of cars is refused until they are accepted.",
    )
    return CountReport((("Cars that the model does not describe", header, tuple(rows_of(results))),), notes)
