"""Computed against driven stability of random cars: cells where they differ, and what explains each.

Each car is solved, tuned and built as by `codegen suite cars`. Measures no time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.tables import CountReport, Row
from codegen.configuration import Config
from codegen.errors import BuildError
from codegen.optimum.solve import solve_case
from codegen.sweep.region import ALONE_UNSTABLE, MODEL_UNSTABLE, UNEXPLAINED, confirm, region
from codegen.vehicle.single_track import SingleTrack
from hil_sim.suite.background import Background
from hil_sim.suite.cars import TEST_SEED, TYRE_MODEL, random_cars
from hil_sim.suite.subjects import RECOMMENDED_CASE, around, tuned

CARS, QUICK_CARS = 10, 2
SEED = TEST_SEED
"""Nothing is tuned on these cars."""


@dataclass(frozen=True)
class Found:
    """Cells of one car: all, driven otherwise than computed, margins driven, and of these otherwise; by explanation."""

    cells: int
    otherwise: int
    margins: int
    margins_otherwise: int
    explanations: dict[str, int]
    first_km_h: float | None


def examine(config: Config) -> Found:
    """Solve, tune and build a car, and compare. Raises CodegenError."""
    config = config.with_tyre_model(TYRE_MODEL)
    reference_map = solve_case(config, RECOMMENDED_CASE)
    config = tuned(reference_map, config)
    linear = region(config)
    if linear is None:
        raise BuildError("the recommended kind has no feedback")
    generated = around(reference_map, config).generated
    driven = confirm(linear, generated.files, generated.manifest)
    return Found(
        driven.stable.size,
        int(driven.contradicted.sum()),
        int(driven.margin_sample.sum()),
        int(driven.margin_contradicted.sum()),
        driven.explanations,
        driven.disagreeing_from,
    )


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Compare ten cars; `quick` takes two."""
    cars = random_cars(SEED, QUICK_CARS if quick else CARS)
    rows = []
    with Background() as background:
        waiting = [background.call(examine, config) for config in cars]
        for number, (config, job) in enumerate(zip(cars, waiting, strict=True), start=1):
            found = job.get()
            say(f"car {number}")
            unexplained = found.explanations[UNEXPLAINED]
            gradient = math.degrees(SingleTrack.from_config(config).understeer_coefficient) * config.road.gravity_m_s2
            texts = (
                f"{number}: {config.vehicle.mass_kg:,.0f} kg, {gradient:.2f} deg/g, {1e3 * config.rear_actuator.lag_s:.0f} ms",
                f"{found.otherwise} of {found.cells}",
                f"{found.margins_otherwise} of {found.margins}",
                *(str(found.explanations[why]) for why in (ALONE_UNSTABLE, MODEL_UNSTABLE, UNEXPLAINED)),
                "-" if found.first_km_h is None else f"{found.first_km_h:g} km/h",
            )
            rows.append(Row((*texts, f"none unexplained: {'met' if unexplained == 0 else 'MISSED'}"), unexplained == 0))
    header = (
        "car",
        "driven otherwise",
        "gain margins otherwise",
        ALONE_UNSTABLE,
        MODEL_UNSTABLE,
        UNEXPLAINED,
        "from",
        "required",
    )
    notes = (
        f"The first cars of seed {SEED}. Cells: mass -20, 0 and 20 %, friction 0.2 to 1, 20 km/h to the largest speed that the "
        "controller accepts, straight ahead; the gain margins of a third of them.",
        "Cells in which the slowest pole moves by less than 2 % in a second are not judged: a drive of 10 s does not tell.",
    )
    return CountReport((('Computed against driven stability, kind "tracking"', header, tuple(rows)),), notes)
