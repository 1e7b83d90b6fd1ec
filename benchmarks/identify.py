"""Identification of random cars whose true values are known: errors, coverage of the intervals, time; and of foreign plants.

The drives are simulated by the two-track plant with sensor noise, bias, resolution and jitter (`tests.identify.drives`). The
identification starts from the preset, with the mass and the geometry of the car.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks import identify_foreign
from benchmarks.tables import CountReport, Row
from codegen.identify.drive import Drive
from codegen.identify.parameters import BY_NAME
from codegen.identify.run import identify
from codegen.identify.summary import CONFIDENCE_FACTOR
from codegen.identify.validation import validate
from codegen.units import DEGREE
from hil_sim.suite.background import Background
from tests.identify.drives import SENSOR, Course, configured_car, drive, true_car, truth
from tests.identify.foreign import CARS as FOREIGN
from tests.identify.foreign import drives as foreign_drives

CARS, QUICK_CARS = 40, 4
FIRST_SEED = 100
ERROR_MAX: Mapping[str, tuple[float, bool]] = {
    "front_stiffness": (0.03, True),
    "rear_stiffness": (0.03, True),
    "yaw_inertia": (0.05, True),
    "actuator_lag": (0.005, False),
}
"""Largest error that is accepted: a fraction, or in SI."""
COVERAGE = (0.90, 0.99)
"""Range of the fraction of 95 % intervals that contain the true value."""
TEN_MINUTES_S, SECONDS_MAX = 600.0, 20.0
SIGNALS = (*SENSOR, "delta_r_command")


@dataclass(frozen=True)
class CarResult:
    """Name of each determined quantity -> value, standard deviation and true value in SI; seconds of the identification."""

    found: dict[str, tuple[float, float, float]]
    seconds: float


def examine(seed: int) -> CarResult:
    """Drive and identify one car."""
    config, errors = true_car(seed)
    parts = Course(config).everything()
    drives = [drive(config, part, 10 * seed + k, errors, name=f"drive {k}", signals=SIGNALS) for k, part in enumerate(parts)]
    true = truth(config, errors)
    begin = time.perf_counter()
    found = identify(configured_car(config), drives)
    seconds = time.perf_counter() - begin
    determined = {name: each for name, each in found.quantities.items() if each.is_identified}
    return CarResult({name: (each.value, each.standard_deviation, true[name]) for name, each in determined.items()}, seconds)


def quantity_rows(results: list[CarResult]) -> list[Row]:
    """Return a row for each quantity, and one for all."""
    rows = []
    every: list[float] = []
    for name, parameter in BY_NAME.items():
        values = np.array([one.found[name] for one in results if name in one.found])
        if not values.size:
            continue
        error, deviations = values[:, 0] - values[:, 2], np.abs(values[:, 0] - values[:, 2]) / values[:, 1]
        every += deviations.tolist()
        limit, is_relative = ERROR_MAX.get(name, (np.inf, parameter.is_relative))
        worst = float(np.abs(error / values[:, 2] if is_relative else error).max())
        shown = f"{100.0 * worst:.2f} %" if is_relative else f"{worst / parameter.size:.2g} {parameter.unit}".strip()
        asked = (
            "" if np.isinf(limit) else f"{100.0 * limit:g} %" if is_relative else f"{limit / parameter.size:g} {parameter.unit}"
        )
        is_met = worst <= limit and (np.isinf(limit) or len(values) == len(results))
        covered = f"{100.0 * float((deviations <= CONFIDENCE_FACTOR).mean()):.0f} %"
        rows.append(Row((parameter.title, f"{len(values)} of {len(results)}", shown, asked, covered), is_met))
    share = float((np.array(every) <= CONFIDENCE_FACTOR).mean())
    low, high = COVERAGE
    asked = f"{100.0 * low:g} to {100.0 * high:g} % covered"
    rows.append(Row(("all", str(len(every)), "", asked, f"{100.0 * share:.1f} %"), low <= share <= high))
    return rows


def ten_minutes() -> float:
    """Return the seconds for identifying a car from ten minutes at 100 Hz."""
    config, errors = true_car(FIRST_SEED)
    programme = Course(config).everything()
    drives: list[Drive] = []
    while sum(one.time.size for one in drives) * 0.01 < TEN_MINUTES_S:
        number = len(drives)
        parts = programme[number % len(programme)]
        drives.append(drive(config, parts, number, errors, name=f"drive {number}", signals=SIGNALS))
    begin = time.perf_counter()
    identify(configured_car(config), drives)
    return time.perf_counter() - begin


def foreign_row(name: str, sideslip: bool) -> Row:
    """Return the errors of a held-out drive of a car that the model does not describe."""
    car = FOREIGN[name]()
    *fitted, held_out = foreign_drives(car, sideslip=sideslip)
    found = validate(identify(configured_car(car.config), fitted), held_out)
    figures = [
        f"{each / DEGREE:.3f}"
        for run in (found.identified, found.configured)
        for each in (run.yaw_rate_error, run.one_step_error)
    ]
    is_better = found.identified.yaw_rate_error < found.configured.yaw_rate_error
    title = f"{car.title}, {'with' if sideslip else 'without'} sideslip"
    return Row((title, *figures, f"{found.identified.yaw_rate_size / DEGREE:.2f}"), is_better)


def run(quick: bool, say: Callable[[str], None], plants: str | None = None) -> CountReport:
    """Identify forty cars; `quick` takes four, and only the first of the foreign cars. `plants`: see `identify_foreign`."""
    if plants is not None:
        return identify_foreign.run(quick, say)
    count = QUICK_CARS if quick else CARS
    names = list(FOREIGN)[: 1 if quick else None]
    with Background() as background:
        waiting = [background.call(examine, FIRST_SEED + k) for k in range(count)]
        foreign = [background.call(foreign_row, name, sideslip) for name in names for sideslip in (True, False)]
        results = []
        for number, job in enumerate(waiting, start=1):
            results.append(job.get())
            say(f"car {number}")
        others = [job.get() for job in foreign]
    seconds = ten_minutes()
    tables = (
        (
            "Identified against true values",
            ("quantity", "determined", "largest error", "required", "intervals right"),
            quantity_rows(results),
        ),
        (
            "Yaw rate of a held-out drive, root mean square in deg/s",
            ("plant", "free run", "one step", "free run before", "one step before", "of"),
            others,
        ),
        (
            "Time",
            ("drives", "time", "required"),
            [Row(("ten minutes at 100 Hz", f"{seconds:.1f} s", f"{SECONDS_MAX:g} s"), seconds <= SECONDS_MAX)],
        ),
    )
    notes = (
        f"Random cars of the seeds from {FIRST_SEED} on, three minutes each, from the preset with the car's mass and geometry.",
        "A quantity counts as determined if its standard deviation is below 30 % of its spread before the drives, or if it "
        "belongs to a tyre curve that is.",
    )
    return CountReport(tuple((title, header, tuple(rows)) for title, header, rows in tables), notes)
