"""The map on the plant's own steady turns: all cells at once, against IPOPT point by point and against a dense search."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.dense_search import DenseSearch
from benchmarks.paper_build import CONFIG
from benchmarks.solving import CASES, CLOCK, NARROW
from benchmarks.timing import Comparison, Report, Times, interleaved, once
from codegen import config as configuration
from codegen.config import Config
from codegen.refmap import ipopt
from codegen.refmap.exact import Solution
from codegen.refmap.nonlinear import NonlinearTurns
from codegen.refmap.problem import FloatArray, breakpoints
from tests.refmap.cars import CASE, random_config

REQUIRED = 30.0
REPEATS, QUICK_REPEATS = 10, 3
STRIDE, QUICK_STRIDE = 1, 10
CARS, CELLS, QUICK_CARS, QUICK_CELLS = 20, 100, 3, 10
SAME = 1e-4
"""rad/s."""


def nonlinear(config: Config, case: str) -> Config:
    """The configuration with the nonlinear tyre in a case."""
    data = config.model_dump(mode="json")
    data["cases"][case]["tyre_model"] = "magic-formula"
    return configuration.parse(data, "benchmark")


def random_car(rng: np.random.Generator) -> Config:
    """A car with its own load transfer and load sensitivity, beside what `random_config` varies."""
    data = random_config(rng).model_dump(mode="json")
    drawn = {"cg_height_m": (0.3, 0.9), "track_m": (1.3, 1.9), "front_roll_share": (0.3, 0.7)}
    data["vehicle"] |= {key: float(rng.uniform(*ends)) for key, ends in drawn.items()}
    for axle in ("front", "rear"):
        data["tyre"][axle]["peak_load_sensitivity_p2"] = float(rng.uniform(-0.4, 0.1))
    return configuration.parse(data, "random car")


def random_cells(turns: NonlinearTurns, config: Config, rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Speeds (m/s) and front angles (rad), (count,) each, from straight ahead to a third beyond where the map ends."""
    grid = config.grid
    speed = rng.uniform(grid.speed_min_km_h, grid.speed_max_km_h, count) / 3.6
    edge = turns.edge(speed).front_angle
    last = np.minimum(np.where(np.isfinite(edge), 1.3 * edge, np.inf), math.radians(grid.front_angle_max_deg))
    return speed, rng.uniform(0.0, 1.0, count) * last


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Measure the cases of the paper, and search by brute force; `quick` gives both peers a part."""
    stride = QUICK_STRIDE if quick else STRIDE
    comparisons, notes = [], []
    for case in CASES:
        say(f"solving {case} with the nonlinear tyre")
        comparison, note = _case(case, stride, QUICK_REPEATS if quick else REPEATS)
        comparisons.append(comparison)
        notes.append(note)
    if quick:
        notes.append(f"--quick: IPOPT solved every {stride}th speed and angle only; its time is extrapolated to all cells.")
    say("searching by brute force")
    notes.append(_searched(*((QUICK_CARS, QUICK_CELLS) if quick else (CARS, CELLS))))
    speed, front_angle = breakpoints(CONFIG)
    title = f"Solving the map with the nonlinear tyre, {speed.size} x {front_angle.size} operating points; processor time"
    return Report(title, tuple(comparisons), tuple(notes))


def _case(name: str, stride: int, repeats: int) -> tuple[Comparison, str]:
    config = nonlinear(CONFIG, name)
    case = config.case(name)
    speed, front_angle = breakpoints(config)
    turns = NonlinearTurns.from_config(config, case)
    ours = interleaved({"all at once": lambda: turns.solve(speed, front_angle)}, repeats, CLOCK)["all at once"]
    solution = turns.solve(speed, front_angle)
    results: list[Solution] = []

    def by_ipopt(step: int) -> Callable[[], None]:
        def solve() -> None:
            results.append(ipopt.solve(config, turns.problem, speed[::step], front_angle[::step], None, "magic-formula"))

        return solve

    first_cell = interleaved({"first cell": by_ipopt(speed.size)}, 3, CLOCK)["first cell"].median
    seconds = once(by_ipopt(stride), CLOCK)
    cells = results[-1].feasible.size
    extrapolated = first_cell + (seconds - first_cell) * (solution.feasible.size - 1) / (cells - 1)
    comparison = Comparison(name, Times("IPOPT", (extrapolated,)), ours, REQUIRED, paired=False)
    return comparison, f"{name}: {_agreement(solution, results[-1], stride)}"


def _agreement(ours: Solution, peer: Solution, stride: int) -> str:
    cells = (slice(None, None, stride), slice(None, None, stride))
    clear = ~(np.abs(ours.margin[cells]) < NARROW)
    feasible = ours.feasible[cells]
    both = clear & feasible & peer.feasible
    largest = float(np.max(np.abs(ours.yaw_rate[cells] - peer.yaw_rate)[both]))
    otherwise = int(np.sum(clear & (feasible != peer.feasible)))
    return (
        f"yaw rates differ by at most {largest:.1e} rad/s in {both.sum()} feasible cells, "
        f"feasibility in {otherwise} of {clear.size}, {int(np.sum(~clear))} too narrow to compare"
    )


def _searched(cars: int, cells: int, seed: int = 1) -> str:
    rng = np.random.default_rng(seed)
    largest, feasible, otherwise, apart = 0.0, 0, 0, 0
    for _ in range(cars):
        config = random_car(rng)
        case = config.cases[CASE]
        turns = NonlinearTurns.from_config(config, case)
        search = DenseSearch.of(config, case)
        speed, front_angle = random_cells(turns, config, rng, cells)
        found = turns.at(speed, front_angle)
        for index in range(cells):
            best = search.best(float(speed[index]), float(front_angle[index]))
            if best.feasible != found.feasible[index]:
                otherwise += 1
            elif best.feasible:
                feasible += 1
                difference = abs(best.yaw_rate - float(found.yaw_rate[index]))
                apart += difference > SAME
                largest = max(largest, difference)
    return (
        f"brute force, {cars * cells:,} random cells over {cars} random cars: {feasible} feasible in both, yaw rates differ by "
        f"at most {largest:.1e} rad/s ({apart} by more than {SAME:g}), feasibility in {otherwise}"
    )
