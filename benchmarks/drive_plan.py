"""Planned drives on the bench, with noise: errors of the identification against their prediction, and against other drives.

The log of the bus is read and identified as a user does it. The naive programme drives each manoeuvre of the library in turn,
at one speed and with the same limit, until the time is used.
"""

from __future__ import annotations

import math
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.tables import CountReport, Row
from codegen.configuration import Config, parse, preset
from codegen.identify.candidates import Candidate
from codegen.identify.drive_plan import BENCH_SIGNALS, candidates_of, plan_drives, shares_of
from codegen.identify.parameters import BY_NAME, configured
from codegen.identify.plan_output import scenario_csv
from codegen.identify.reading import read_drives
from codegen.identify.result import identified_toml
from codegen.identify.run import Identification, identify
from codegen.importing.toml_edit import whole
from codegen.sil.software import RECORD_COLUMNS, load
from codegen.units import KM_H
from hil_sim.bench import run_in_process
from hil_sim.logs import BusLog
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from hil_sim.suite.background import Background
from tests.identify.drives import configured_car, true_car

BUILD = Path(__file__).resolve().parents[1] / "generated" / "4ws2"
LIMIT, DURATION = 4.0, 180.0
RELAXATION_LENGTH_M = 0.3
RUNS, QUICK_RUNS = 10, 3
CARS, QUICK_CARS = 3, 1
FIRST_CAR = 200
NAIVE_KM_H = 60.0
COMPARED = (
    "front_stiffness",
    "rear_stiffness",
    "yaw_inertia",
    "relaxation_length",
    "actuator_lag",
    "actuator_rate",
    "actuator_delay",
)
"""Quantities of the car that both programmes determine."""
RATIO = (0.7, 1.4)
"""Range of the root mean square of scatter over prediction. Chance alone gives 0.8 to 1.2 for one quantity of 10 runs."""


@dataclass(frozen=True)
class Driven:
    """Values and standard deviations by name in SI, and the largest lateral acceleration in m/s^2."""

    found: dict[str, tuple[float, float]]
    largest: float


def subject() -> Config:
    """Return the recommended car, ideal but for a relaxation length. The identification models no roll and no backlash."""
    data = preset("recommended").with_ideal_plant().model_dump(mode="json")
    data["plant"]["relaxation_length_m"] = RELAXATION_LENGTH_M
    return parse(data, "benchmarks")


@lru_cache
def programme(kind: str) -> tuple[list[Candidate], dict[str, float]]:
    """Return the drives of the "planned" or "naive" programme of the subject, and the predicted standard deviations in SI."""
    return _programme(subject(), kind)


def _programme(config: Config, kind: str) -> tuple[list[Candidate], dict[str, float]]:
    if kind == "planned":
        plan = plan_drives(config, LIMIT, DURATION)
        return list(plan.drives), {each.parameter.name: each.standard_deviation for each in plan.quantities}
    candidates, information = candidates_of(config, LIMIT, BENCH_SIGNALS, levels=(1.0,))
    at_speed = [k for k, one in enumerate(candidates) if math.isclose(one.speed, NAIVE_KM_H * KM_H)]
    chosen: list[int] = []
    while True:
        k = at_speed[len(chosen) % len(at_speed)]
        if sum(candidates[each].duration for each in [*chosen, k]) > DURATION:
            break
        chosen.append(k)
    values = configured(config)
    shares = shares_of(information.each[chosen].sum(axis=0))
    sizes = {each.name: each.spread * (values[each.name] if each.is_relative else 1.0) for each in information.parameters}
    predicted = {name: float(share) * sizes[name] for name, share in zip(information.names, shares, strict=True)}
    return [candidates[k] for k in chosen], predicted


def drive(config: Config, known: Config, drives: Sequence[Candidate], seed: int) -> Driven:
    """Drive a programme on the bench, and identify its log.

    Args:
        config: true car. known: configured car, from which the identification starts.
    """
    found, largest = _identified(config, known, drives, seed)
    values = {name: (each.value, each.standard_deviation) for name, each in found.quantities.items() if each.is_identified}
    return Driven(values, largest)


def _identified(config: Config, known: Config, drives: Sequence[Candidate], seed: int) -> tuple[Identification, float]:
    software = load(BUILD)
    largest, logs = 0.0, []
    with tempfile.TemporaryDirectory() as name:
        for number, one in enumerate(drives):
            path = Path(name) / f"{number}.csv"
            path.write_bytes(scenario_csv(one, has_rear_command=True))
            logs.append(path.with_suffix(".blf"))
            scenario = find(str(path), config)
            node = PlantNode(config, scenario, precision=software.precision, sensors=True, seed=1000 * seed + number)
            with BusLog(logs[-1]) as log:
                record = run_in_process(node, software, log=log).record
            largest = max(largest, float(np.abs(record[:, RECORD_COLUMNS.index("lateral_acceleration_m_s2")]).max()))
        reading = read_drives(logs, [BUILD / "ars.dbc"], None)
    return identify(known, reading.drives), largest


def examine(kind: str, seed: int) -> Driven:
    """Drive a programme of the subject on that car."""
    config = subject()
    return drive(config, config, programme(kind)[0], seed)


def examine_car(seed: int) -> tuple[float, float, list[float]]:
    """Plan for a configured car whose values are wrong, drive, identify, and plan again for what was found.

    Returns the largest lateral acceleration of both programmes on the true car in m/s^2, and errors over standard deviations.
    """
    true, known = true_car(seed)[0], configured_car(true_car(seed)[0])
    first, largest = _identified(true, known, _programme(known, "planned")[0], seed)
    again = _with(known, first)
    second = drive(true, again, _programme(again, "planned")[0], seed + 1)
    values = configured(true)
    errors = [(second.found[name][0] - values[name]) / second.found[name][1] for name in COMPARED if name in second.found]
    return largest, second.largest, errors


def _with(config: Config, found: Identification) -> Config:
    """Return the configuration that the identification writes."""
    text = identified_toml(found, whole(config, "benchmarks"), "benchmarks")
    return parse(tomllib.loads(text), "benchmarks")


def quantity_rows(planned: Sequence[Driven], naive: Sequence[Driven]) -> list[Row]:
    """Return a row for each compared quantity, and one for all."""
    values = configured(subject())
    rows, ratios, gains = [], [], []
    for name in COMPARED:
        parameter = BY_NAME[name]
        shown: list[str] = []
        scatter: dict[str, float] = {}
        for kind, results in (("planned", planned), ("naive", naive)):
            found = np.array([one.found[name] for one in results if name in one.found])
            predicted = programme(kind)[1][name]
            scatter[kind] = float(found[:, 0].std(ddof=1))
            figures = [predicted, float(found[:, 1].mean()), scatter[kind], float(found[:, 0].mean()) - values[name]]
            shown += [f"{each / parameter.size:.2g}" for each in figures]
            ratios.append(scatter[kind] / predicted)
        gains.append(scatter["naive"] / scatter["planned"])
        rows.append(Row((parameter.title, parameter.unit, *shown, f"{ratios[-2]:.2f}, {ratios[-1]:.2f}", f"{gains[-1]:.1f}")))
    ratio, gain = float(np.sqrt(np.mean(np.square(ratios)))), float(np.exp(np.mean(np.log(gains))))
    is_met = RATIO[0] <= ratio <= RATIO[1] and gain > 1.0
    return [*rows, Row(("all", *[""] * 9, f"{ratio:.2f}", f"{gain:.1f}"), is_met)]


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Drive, identify and compare."""
    count, cars = (QUICK_RUNS, QUICK_CARS) if quick else (RUNS, CARS)
    with Background() as background:
        waiting = {kind: [background.call(examine, kind, seed) for seed in range(count)] for kind in ("planned", "naive")}
        others = [background.call(examine_car, FIRST_CAR + 2 * k) for k in range(cars)]
        results = {}
        for kind, jobs in waiting.items():
            results[kind] = [job.get() for job in jobs]
            say(kind)
        found = [job.get() for job in others]
    figures = ("predicted", "estimated", "scatter", "mean error")
    header = ("quantity", "unit", *figures, f"naive: {figures[0]}", *figures[1:], "scatter/predicted", "gain")
    largest = max(one.largest for one in results["planned"])
    car_rows = [
        Row((f"{first:.2f}", f"{second:.2f}", f"{float(np.sqrt(np.mean(np.square(errors)))):.2f}"))
        for first, second, errors in found
    ]
    tables = (
        (
            "Planned drives and naive ones of the same length",
            header,
            tuple(quantity_rows(results["planned"], results["naive"])),
        ),
        (
            "Largest lateral acceleration, m/s^2",
            ("of all runs", "limit"),
            (Row((f"{largest:.2f}", f"{LIMIT:g}"), largest <= LIMIT),),
        ),
        (
            "Other cars than the configured one: largest lateral acceleration in m/s^2, rms of error over standard deviation",
            ("planned for the configured car", "planned again for the identified car", "error"),
            tuple(car_rows),
        ),
    )
    notes = (
        f"The recommended car, ideal but for a relaxation length of {RELAXATION_LENGTH_M:g} m, {DURATION:g} s on the bench "
        f"with the noise and resolution of `[sensors]`, {count} runs of each programme; naive: each manoeuvre of the library "
        f"in turn at {NAIVE_KM_H:g} km/h.",
        "Predicted and estimated: standard deviations before and after the drives. Scatter: that of the results. The mean "
        "error is not a part of the prediction.",
        f'"all": root mean square of the ratios, required {RATIO[0]:g} to {RATIO[1]:g}, and geometric mean of the gains, the '
        "scatter of the naive programme over that of the planned one, required above 1.",
    )
    return CountReport(tables, notes)
