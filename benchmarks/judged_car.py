"""Figures of one car with the recommended controller against the same car with straight rear wheels: map, and drives."""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.judged_cars import PAPER
from benchmarks.lane_change import Drive, LaneChange, largest_entry_speed, least_sideslip
from benchmarks.steady_passive import PassiveTurns
from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.ecu_map.extend import extend
from codegen.errors import CodegenError
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.metrics import Runs, SineWithDwell, StepResponse
from codegen.metrics.runs import COLUMNS
from codegen.metrics.sine_with_dwell import displacement_min
from codegen.optimum.solve import solve_case
from codegen.plausibility.check import check_path
from codegen.sil.batch import Lanes
from codegen.units import KM_H
from codegen.vehicle.plant_car import varied_cars
from hil_sim import third_plant
from hil_sim.manoeuvres import Hands
from hil_sim.scenarios import SCENARIOS, Scenario
from hil_sim.suite.cells import STEER_TIME, c1
from hil_sim.suite.subjects import (
    DELAY_SAMPLES,
    RECOMMENDED_CASE,
    Subject,
    around_folder,
    baseline_configs,
    of_config,
    of_folder,
    passive_of,
    tuned,
)

GENERATED = Path(__file__).resolve().parents[1] / "generated"
BUILD, MAP = GENERATED / "4ws2", GENERATED / "4ws2.npz"
"""The committed build, and its map."""
FRONT_STEERED_CASE = "fws"
"""Case of the map that C2 follows."""

TWO_TRACK, ROLL = "two-track", "roll"
PLANTS = (TWO_TRACK, ROLL)
"""The plant of the configuration; the third plant, with roll, other tyres, relaxation and sensor errors."""

LOW_KM_H, HIGH_KM_H = (20.0, 60.0), (80.0, 120.0)
"""Ranges of the two comparisons of yaw rate."""
HIGH_LATERAL_ACCELERATION_G = 0.4
CHARACTERISTIC_SPEED = 100.0 * KM_H
"""m/s, of the understeering car that is the measure at high speed where the passive car turns more."""
FALL_RAD_S = 1e-9
"""Smallest fall of the yaw rate between two cells that is not rounding, in rad/s."""

SWEEP_AMPLITUDES = (5.0, 5.5, 6.0, 6.5, 7.0)
"""Multiples of the steering angle for 0.3 g, from the first that the displacement is required of (49 CFR 571.126, S5.2.3)."""
SWEEP_FRICTIONS = (0.7, 0.8, 0.9)
SWEEP_MASSES = (0.9, 1.0, 1.1, 1.2)
"""Factors; the yaw inertia goes with the mass."""
NOMINAL_AMPLITUDE = SWEEP_AMPLITUDES[0]

CONTROLLED, FEEDFORWARD, PASSIVE = "tracking", "feedforward", "passive"


@dataclass(frozen=True)
class SteadyFigures:
    """Figures of a map against the passive car's steady turns, in shares and g.

    Attributes:
        largest_g, passive_g, limit_g: largest lateral acceleration of the map, of the passive car at the speeds and angles of
            the map, and the configured limit.
        falling: share of the steps between neighbouring front angles in which the yaw rate falls.
        low: smallest yaw rate over the passive car's, LOW_KM_H, up to the configured limit.
        high: the same over the smaller of the passive car's and that of a car with CHARACTERISTIC_SPEED, HIGH_KM_H, up to a
            lateral acceleration of 0.4 g of the passive car.
        falling_on_ecu: share of falling steps of the table of the ECU, from the first speed of the map up to the steering stop.
    """

    largest_g: float
    passive_g: float
    limit_g: float
    falling: float
    low: float
    high: float
    falling_on_ecu: float

    @property
    def grip(self) -> float:
        """Largest lateral acceleration over what the car could reach."""
        return self.largest_g / min(self.passive_g, self.limit_g)


def falling_share(yaw_rate: FloatArray) -> float:
    """Return the share of the steps along the rows of (n, m) yaw rates in which they fall; a step has no NaN."""
    steps = np.diff(yaw_rate, axis=1)
    return float((steps < -FALL_RAD_S).sum() / max(int(np.isfinite(steps).sum()), 1))


def least_ratio(values: FloatArray, measure: FloatArray, where: BoolArray) -> float:
    """Return the smallest ratio of values over a measure where a condition holds and both are known; NaN without any."""
    ratio = (values / measure)[where & np.isfinite(values) & np.isfinite(measure)]
    return float(ratio.min()) if ratio.size else math.nan


def steady_figures(reference_map: ReferenceMap, config: Config) -> SteadyFigures:
    """Return the figures of a map. The yaw rates are those that the ECU looks up, beyond the feasible cells too."""
    speed, angle = reference_map.speed, reference_map.front_angle
    gravity, column = config.road.gravity_m_s2, speed[:, np.newaxis]
    passive = PassiveTurns.of(config, speed).yaw_rate(angle)
    total = extend(reference_map, config)
    rows = np.isin(total.speed, speed)
    table = np.minimum(total.yaw_rate[rows], total.lateral_acceleration_cap / total.speed[rows, np.newaxis])
    reference = table[:, np.isin(total.front_angle, angle)]
    limit = config.limits.lateral_acceleration_max_g
    cap = min(limit, total.lateral_acceleration_cap / gravity)
    passive_g = column * passive / gravity
    understeering = column * angle / (config.vehicle.wheelbase * (1.0 + (column / CHARACTERISTIC_SPEED) ** 2))

    def between(ends: tuple[float, float]) -> BoolArray:
        return np.asarray((column >= ends[0] * KM_H * (1.0 - 1e-9)) & (column <= ends[1] * KM_H * (1.0 + 1e-9)))

    return SteadyFigures(
        largest_g=float(np.nanmax(column * reference_map.yaw_rate)) / gravity,
        passive_g=float(np.nanmax(passive_g)),
        limit_g=limit,
        falling=falling_share(reference_map.yaw_rate),
        low=least_ratio(reference, passive, between(LOW_KM_H) & (passive_g <= cap)),
        high=least_ratio(
            reference, np.fmin(passive, understeering), between(HIGH_KM_H) & (passive_g <= HIGH_LATERAL_ACCELERATION_G)
        ),
        falling_on_ecu=falling_share(table),
    )


@dataclass(frozen=True)
class Dwell:
    """Sine with dwell on one plant: displacement in m with a controller, and of the passive car."""

    plant: str
    controller: str
    displacement: float
    passive: float


@dataclass(frozen=True)
class Sweep:
    """Counts of a sweep of sines with dwell.

    Attributes:
        runs: all runs.
        passive: runs in which the passive car reaches the displacement.
        short: of these, runs in which the controlled car does not.
        failed: runs in which the passive car meets all criteria and the controlled one does not.
    """

    runs: int
    passive: int
    short: int
    failed: int


@dataclass(frozen=True)
class LaneChanges:
    """Largest entry speeds in km/h on one plant, and the least peak sideslip in deg at the smaller one."""

    plant: str
    speed: float
    passive_speed: float
    sideslip: float
    passive_sideslip: float


@dataclass(frozen=True)
class CarFigures:
    """All figures of a car; only `name` and `error` where it could not be solved, tuned or built.

    Attributes:
        sweep: runs of the sweep of sines with dwell.
        warnings: of `codegen check` on the tuned map.
    """

    name: str
    error: str = ""
    steady: SteadyFigures | None = None
    dwells: tuple[Dwell, ...] = ()
    sweep: Sweep | None = None
    lane_changes: tuple[LaneChanges, ...] = ()
    warnings: tuple[str, ...] = ()


def judge(name: str, config: Config, plants: Sequence[str], drivers: Sequence[Hands], with_feedforward: bool) -> CarFigures:
    """Solve, tune, build and drive one car. The paper's car is driven with the committed build."""
    try:
        reference_map, tested = prepared(name, config)
        controllers = {CONTROLLED: tested}
        if with_feedforward:
            controllers[FEEDFORWARD] = feedforward_of(reference_map, tested)
        return CarFigures(
            name,
            steady=steady_figures(reference_map, tested.config),
            dwells=tuple(_dwells(controllers, plants)),
            sweep=_sweep(tested),
            lane_changes=tuple(_lane_changes(tested, plant, drivers) for plant in plants),
            warnings=_warnings(reference_map, tested.config),
        )
    except CodegenError as error:
        return CarFigures(name, str(error))


def prepared(name: str, config: Config) -> tuple[ReferenceMap, Subject]:
    """Return the map of a car, and its tuned controller. Raises CodegenError as `solve_case` and `tuned` do."""
    if name == PAPER:
        return npz.load(MAP), Subject(CONTROLLED, of_folder(BUILD).config, around_folder(BUILD))
    reference_map = solve_case(config, RECOMMENDED_CASE)
    return reference_map, of_config(CONTROLLED, reference_map, tuned(reference_map, config))


def feedforward_of(reference_map: ReferenceMap, tested: Subject) -> Subject:
    """Return the feedforward alone on a map."""
    return of_config(FEEDFORWARD, reference_map, baseline_configs(tested.config)[FEEDFORWARD])


def drive(subject: Subject, plant: str, scenario: Scenario) -> FloatArray:
    """Return the recording (samples, columns), RECORD_COLUMNS, of a scenario. Raises BuildError."""
    config = subject.config
    software = subject.around(config)
    if plant == ROLL:
        return third_plant.run(software if subject.controlled else None, config, scenario, delay_samples=DELAY_SAMPLES)
    loop, driver = subject.loop(software), scenario.driver(config)
    inputs = scenario.inputs(config)
    return loop.run(inputs) if driver is None else loop.run_stepped(inputs, driver.steer)


@dataclass(frozen=True)
class PaperStep:
    """The paper's step with one controller on one plant: steady yaw rates in deg/s and sideslip angles in deg."""

    plant: str
    controller: str
    yaw_rate: float
    front_steered: float
    passive: float
    sideslip: float
    passive_sideslip: float


def paper_steps(config: Config, plants: Sequence[str]) -> tuple[PaperStep, ...]:
    """Drive C1, C2 and the passive car: one tuned controller with the 4WS-2 map and with the FWS map. Raises CodegenError."""
    reference_map, tested = prepared(PAPER, config)
    front_steered = solve_case(tested.config, FRONT_STEERED_CASE)
    of_c2 = of_config("C2", front_steered, tested.config)
    pairs = {
        CONTROLLED: (tested, of_c2),
        FEEDFORWARD: (feedforward_of(reference_map, tested), feedforward_of(front_steered, of_c2)),
    }
    found = []
    for plant in plants:
        passive = _steady(passive_of(tested), plant)
        for controller, subjects in pairs.items():
            first, second = (_steady(subject, plant) for subject in subjects)
            found.append(PaperStep(plant, controller, first[0], second[0], passive[0], first[1], passive[1]))
    return tuple(found)


def _steady(subject: Subject, plant: str) -> tuple[float, float]:
    """Return the steady yaw rate in deg/s and |sideslip| in deg after the paper's step."""
    cell = c1(subject.config)
    step = StepResponse(Runs.of_record(drive(subject, plant, cell.scenario(subject.config)), STEER_TIME))
    return float(step.yaw_rate_steady_deg_s[0]), abs(float(step.sideslip_steady_deg[0]))


def _dwells(controllers: dict[str, Subject], plants: Sequence[str]) -> list[Dwell]:
    found = []
    for plant in plants:
        passive = _displacement(passive_of(controllers[CONTROLLED]), plant)
        found += [Dwell(plant, name, _displacement(subject, plant), passive) for name, subject in controllers.items()]
    return found


def _displacement(subject: Subject, plant: str) -> float:
    scenario = SCENARIOS["sine-with-dwell"]
    record = drive(subject, plant, scenario)
    runs = Runs.of_record(record, scenario.steer_time, steering_ratio=subject.config.steering.ratio)
    return float(SineWithDwell(runs).displacement[0])


def _sweep(tested: Subject) -> Sweep:
    """Drive the sweep with the controller, without an estimate of the friction, and with straight rear wheels."""
    config, scenario = tested.config, SCENARIOS["sine-with-dwell"]
    drawn = np.array(list(itertools.product(SWEEP_AMPLITUDES, SWEEP_FRICTIONS, SWEEP_MASSES))).T
    amplitude, friction, mass = np.tile(drawn, 2)
    count = drawn.shape[1]
    lanes = Lanes(
        varied_cars(config, mass=mass),
        wheel_factor=amplitude / NOMINAL_AMPLITUDE,
        friction=friction,
        delay_samples=DELAY_SAMPLES,
        controlled=np.arange(2 * count) < count,
    )
    software = tested.around.batch(config)
    record = software.run(scenario.inputs(config), lanes, software.parameters(**tested.parameters), COLUMNS)
    runs = Runs(
        np.arange(record.shape[1], dtype=np.float64) * config.controller.sampling_time_s,
        dict(zip(COLUMNS, record, strict=True)),
        scenario.steer_time,
        steering_ratio=config.steering.ratio,
        mass=mass * config.vehicle.mass_kg,
    )
    dwell = SineWithDwell(runs)
    far, far_passive = (dwell.displacement >= displacement_min(runs.mass)).reshape(2, count)
    all_met, all_met_passive = (dwell.outcome == 1.0).reshape(2, count)
    return Sweep(count, int(far_passive.sum()), int((far_passive & ~far).sum()), int((all_met_passive & ~all_met).sum()))


def _lane_changes(tested: Subject, plant: str, drivers: Sequence[Hands]) -> LaneChanges:
    config, subjects = tested.config, (tested, passive_of(tested))

    def driven(subject: Subject) -> Drive:
        def record(scenario: LaneChange) -> FloatArray:
            return drive(subject, plant, scenario)

        return record

    drives = [driven(subject) for subject in subjects]
    speed, passive_speed = (largest_entry_speed(each, config, drivers) for each in drives)
    common = min(speed, passive_speed)
    sideslips = [least_sideslip(each, config, common, drivers) if common else math.nan for each in drives]
    return LaneChanges(plant, speed, passive_speed, *sideslips)


def _warnings(reference_map: ReferenceMap, config: Config) -> tuple[str, ...]:
    """Return the warnings of `codegen check` on a map with the tuned configuration."""
    with tempfile.TemporaryDirectory(prefix="ars-better-") as folder:
        path = Path(folder, "map.npz")
        npz.save(reference_map.with_config(config), path)
        return check_path(path).warnings
