"""Part `foreign`: cars that the model of the identification does not describe, identified from drives with sensor noise.

Each car is identified, the map of `4ws-2` is solved from the result, and its controller in generated C drives the car through
turns of `hil_sim.suite.cells`, slowly steered into. The slip angles of both axles and the sideslip are compared with the bounds
of the map in the steady turn at the end, because they are bounds of steady turns. The PI controller brings the car to the yaw
rate of the map itself, whatever the car's tyres are.

The limit applies where sideslip was measured. Without it, the level of the stiffnesses rests on the dynamics, of which the
model leaves out roll; those figures are reported too.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from codegen.configuration import Config, parse, preset
from codegen.identify.drive import Drive
from codegen.identify.result import identified_toml
from codegen.identify.run import identify
from codegen.identify.validation import validate
from codegen.importing.toml_edit import whole
from codegen.optimum.solve import solve_case
from codegen.sil.plant import PlantSample
from codegen.sil.software import Software
from codegen.units import DEGREE, KM_H
from codegen.vehicle.tyre import AxleTyres
from codegen.verify.outcomes import Effort, Outcome, Verdict
from hil_sim import manoeuvres
from hil_sim.metrics import column
from hil_sim.second_plant.run import drive, measured_of
from hil_sim.suite.cells import Cell, cells
from tests import builds
from tests.evidence.progress import Progress
from tests.identify.drives import configured_car
from tests.identify.foreign import CARS, ForeignCar, drives

SHOWS = "the map from an identified car keeps its slip and sideslip bounds on cars that the model does not describe"
CASE = "4ws-2"
EXCESS_MAX = 0.03
"""Largest excess of a bound, as a fraction of it."""
IN_LINEAR_RANGE = {"limits.grip_use_max": None, "limits.yaw_gain_floor": 0.0}
"""Limits of the map. Near the peak of a tyre, a slip angle says little: it grows without end for the same force."""
STEERING_S, DURATION_S, STEADY_S = (0.5, 6.5), 10.0, 1.0
"""Begin and end of steering in, duration, and the time at the end over which the steady turn is averaged. A step of the front
wheels alone would exceed the bounds before any rear actuator could move."""
REACHED = 0.01
"""Largest shortfall from the yaw rate of the map, as a fraction, with which it counts as reached. A larger yaw rate only makes
the slip angles larger."""
REACHED_SHARE_MIN = 0.9
"""Smallest fraction of the steps that reach it; a saturated rear axle keeps the others below it."""
QUICK = "brush"
"""Car of a quick run, with its sideslip measured. The multi-body car takes most of the time of a full run."""


@dataclass(frozen=True)
class Result:
    """Figures of one car.

    Attributes:
        title: of the car. free_run, one_step, size: root mean square in deg/s of the yaw rate's errors, and of the yaw rate, in
            the drive that was held out.
        slip, sideslip: largest slip angle and sideslip in a steady turn, as fractions of their bounds.
        slip_peak, sideslip_peak: the same over the whole steps.
        steps, reached: number of steps, and of those that reach the yaw rate of the map.
    """

    title: str
    free_run: float
    one_step: float
    size: float
    slip: float
    sideslip: float
    slip_peak: float
    sideslip_peak: float
    steps: int
    reached: int


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part; a quick run has one car."""
    del folders
    names = (QUICK,) if effort.quick else tuple(CARS)
    found = {name: progress.once(name, lambda name=name: [*map(asdict, examine(CARS[name](), effort))]) for name in names}
    results = [Result(**pair[0]) for pair in found.values()]
    findings = [text for result in results for text in faults(result)]
    figures = {
        f"{one.pop('title')}, {how} sideslip": one
        for pair in found.values()
        for one, how in zip(map(dict, pair), ("with", "without"), strict=False)
    }
    largest = max(max(result.slip, result.sideslip) for result in results)
    figure = f"{len(results)} {'car' if effort.quick else 'cars'}; at most {100.0 * largest:.1f} % of a bound"
    return Outcome(SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), figures)


def faults(result: Result) -> list[str]:
    """Return what a car exceeds, each as a sentence."""
    found = []
    for name, used in (("slip", result.slip), ("sideslip", result.sideslip)):
        if not used <= 1.0 + EXCESS_MAX:
            found.append(f"{result.title}: {name} of {100.0 * used:.1f} % of its bound")
    if result.reached < REACHED_SHARE_MIN * result.steps:
        found.append(f"{result.title}: only {result.reached} of {result.steps} steps reach the yaw rate of the map")
    return found


def examine(car: ForeignCar, effort: Effort) -> Iterator[Result]:
    """Drive a car, and measure the turns with what is identified from the drives with their sideslip, then without it."""
    measured = drives(car)
    yield result_of(car, measured)
    if not effort.quick:
        names = measured[0].signals.keys() - {"sideslip"}
        yield result_of(car, [replace(each, signals={name: each.signals[name] for name in names}) for each in measured])


def result_of(car: ForeignCar, measured: Sequence[Drive]) -> Result:
    """Identify a car from its drives but the last, build its controller, and measure the turns."""
    *fitted, held_out = measured
    known = configured_car(car.config)
    found = identify(known, fitted)
    predicted = validate(found, held_out).identified
    identified = parse(tomllib.loads(identified_toml(found, whole(known, "test"), "test")), "identified car")
    chosen = identified.model_copy(update={"controller": preset().controller}).replace(IN_LINEAR_RANGE)
    software = builds.make(solve_case(chosen, CASE), chosen).software
    uses = [use_of(car, chosen, software, cell) for cell in cells(chosen, chosen.case(CASE))]
    largest = np.nanmax(np.array([use[:4] for use in uses]), axis=0)
    errors = predicted.yaw_rate_error, predicted.one_step_error, predicted.yaw_rate_size
    return Result(
        car.title,
        *(round(each / DEGREE, 3) for each in errors),
        *(round(each, 4) for each in largest.tolist()),
        len(uses),
        sum(use[4] for use in uses),
    )


def use_of(car: ForeignCar, identified: Config, software: Software, cell: Cell) -> tuple[float, float, float, float, bool]:
    """Return slip and sideslip in the steady turn and their peaks, as fractions of the bounds, and whether the yaw rate of the
    map is reached. A car that leaves the road has no steady turn: inf."""
    plant = car.plant(cell.speed_km_h * KM_H)

    def measured(now: PlantSample) -> dict[str, float]:
        return {"speed": plant.speed, **measured_of(now)}

    slow = replace(cell.scenario(car.config), kind="ramp", drive=manoeuvres.ramp(*STEERING_S), duration=DURATION_S)
    record = drive(plant, software, car.config, slow, measured)
    end = slice(-round(STEADY_S / identified.controller.sampling_time_s), None)
    tyres, limits = AxleTyres.from_config(identified), identified.limits
    used = np.stack(
        [
            np.abs(column(record, "slip_front_rad")) / tyres.front_slip_bound,
            np.abs(column(record, "slip_rear_rad")) / tyres.rear_slip_bound,
            np.abs(column(record, "sideslip_rad")) / limits.sideslip_max,
        ]
    )
    if not np.isfinite(used).all():
        return math.inf, math.inf, math.inf, math.inf, False
    steady, peak = used[:, end].mean(axis=1), used.max(axis=1)
    yaw_rate, reference = (float(column(record, f"yaw_rate{name}_rad_s")[end].mean()) for name in ("", "_reference"))
    is_reached = yaw_rate >= (1.0 - REACHED) * reference
    return float(max(steady[:2])), float(steady[2]), float(max(peak[:2])), float(peak[2]), is_reached
