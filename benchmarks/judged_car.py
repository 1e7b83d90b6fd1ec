"""Figures of one car with the recommended controller against the same car with straight rear wheels: map, and drives."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.judged_cars import PAPER
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.judgement.bench import Bench
from codegen.judgement.drives import SweepFigures, drive_sweep
from codegen.judgement.facts import check_path
from codegen.judgement.judge import judge
from codegen.judgement.lane_change import (
    LaneChange,
    lane_change_figures,
    largest_entry_speed,
    sideslips_if_passed,
)
from codegen.judgement.steady import SteadyFigures, steady_figures
from codegen.map_file import map as npz
from codegen.map_file.judged import with_judgement
from codegen.map_file.map import ReferenceMap
from codegen.metrics import Runs, SineWithDwell, StepResponse
from codegen.optimum.solve import solve_case
from hil_sim import third_plant
from hil_sim.manoeuvres import Hands
from hil_sim.scenarios import DEPARTURE_TIME_S, SCENARIOS, Scenario
from hil_sim.suite.cells import CELL_STEER_TIME, c1
from hil_sim.suite.subjects import (
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

CONTROLLED, FEEDFORWARD, PASSIVE = "tracking", "feedforward", "passive"


@dataclass(frozen=True)
class Dwell:
    """Sine with dwell on one plant: displacement in m with a controller, and of the passive car."""

    plant: str
    controller: str
    displacement: float
    passive: float


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
        named: keys of the figures of which `codegen check` warns on the tuned map.
    """

    name: str
    error: str = ""
    steady: SteadyFigures | None = None
    dwells: tuple[Dwell, ...] = ()
    sweep: SweepFigures | None = None
    lane_changes: tuple[LaneChanges, ...] = ()
    named: frozenset[str] = frozenset()


def judge_car(name: str, config: Config, plants: Sequence[str], drivers: Sequence[Hands], with_feedforward: bool) -> CarFigures:
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
            sweep=drive_sweep(_bench(tested)),
            lane_changes=tuple(_lane_changes(tested, plant, drivers) for plant in plants),
            named=_named(reference_map, tested.config),
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
        return third_plant.run(software if subject.controlled else None, config, scenario)
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
    step = StepResponse(Runs.of_record(drive(subject, plant, cell.scenario(subject.config)), CELL_STEER_TIME))
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


def _lane_changes(tested: Subject, plant: str, drivers: Sequence[Hands]) -> LaneChanges:
    if plant == TWO_TRACK:
        found = lane_change_figures(_bench(tested), drivers)
        return LaneChanges(plant, found.speed_km_h, found.passive_speed_km_h, found.sideslip_deg, found.passive_sideslip_deg)
    cars = [SingleDrives(subject, plant, drivers) for subject in (tested, passive_of(tested))]
    speed, passive_speed = (largest_entry_speed(car.passes) for car in cars)
    common = min(speed, passive_speed)
    sideslips = [car.least_sideslip(common) if common else math.nan for car in cars]
    return LaneChanges(plant, speed, passive_speed, *sideslips)


class SingleDrives:
    """Lane changes of a subject on a plant that is no batch, one driver after the other."""

    def __init__(self, subject: Subject, plant: str, drivers: Sequence[Hands]) -> None:
        self._subject, self._plant, self._drivers = subject, plant, list(drivers)

    def passes(self, speed_km_h: float) -> bool:
        """Return whether a driver passes. The one who passed last comes first at the next speed."""
        found = next((hands for hands in self._drivers if not math.isnan(self.sideslip(speed_km_h, hands))), None)
        if found is not None:
            self._drivers.remove(found)
            self._drivers.insert(0, found)
        return found is not None

    def sideslip(self, speed_km_h: float, hands: Hands) -> float:
        """Return the largest sideslip angle of a driver in deg; NaN for one who does not pass."""
        scenario = LaneChange.at(speed_km_h, hands)
        runs = Runs.of_record(drive(self._subject, self._plant, scenario), DEPARTURE_TIME_S)
        return float(sideslips_if_passed(runs, scenario, self._subject.config)[0])

    def least_sideslip(self, speed_km_h: float) -> float:
        """Return the largest sideslip angle in deg of the driver who passes with the least; infinite where nobody passes."""
        found = (self.sideslip(speed_km_h, hands) for hands in self._drivers)
        return min((each for each in found if not math.isnan(each)), default=math.inf)


def _bench(tested: Subject) -> Bench:
    software = tested.around.batch(tested.config)
    return Bench(software, tested.config, software.parameters(**tested.parameters))


def _named(reference_map: ReferenceMap, config: Config) -> frozenset[str]:
    """Return the keys of the figures of which `codegen check` warns on a map that is judged as by `codegen tune`."""
    with tempfile.TemporaryDirectory(prefix="ars-better-") as folder:
        path = Path(folder, "map.npz")
        judgement = judge(reference_map, config)
        npz.save(with_judgement(reference_map.with_config(config), judgement.to_dict()), path)
        assert set(judgement.warnings) <= set(check_path(path).warnings)
    return frozenset(row.key for row in judgement.faults)
