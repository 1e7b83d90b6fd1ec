"""The exact solution over the whole default grid, against IPOPT point by point."""

from __future__ import annotations

import time
from collections.abc import Callable

from benchmarks.paper_build import CONFIG
from benchmarks.same import Sameness
from benchmarks.timing import Comparison, Report, Times, interleaved, once
from codegen.arrays import FloatArray
from codegen.optimum import exact, ipopt
from codegen.optimum.exact import Solution
from codegen.optimum.problem import SteadyTurnProblem, breakpoints
from codegen.optimum.turns import LinearTurns

CASES = ("fws", "4ws-1", "4ws-2")
REQUIRED = 1000.0
REPEATS = 30
CLOCK = time.process_time
"""Both keep one thread busy: what else runs on the machine shall not lengthen the one run that IPOPT has."""
QUICK_STRIDE = 10
SAME = 1e-6
"""rad/s: how far apart the yaw rates of both may be."""


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Measure all cases of the paper; `quick` gives IPOPT every tenth speed and angle, and extrapolates to all cells."""
    speed, front_angle = breakpoints(CONFIG)
    stride = QUICK_STRIDE if quick else 1
    comparisons, notes = [], []
    for case in CASES:
        say(f"solving {case}")
        comparison, note = _case(case, speed, front_angle, stride)
        comparisons.append(comparison)
        notes.append(note)
    work = {"describing the problem": lambda: SteadyTurnProblem.from_config(CONFIG, CONFIG.case(CASES[-1]))}
    (description,) = interleaved(work, REPEATS, CLOCK).values()
    notes.append(f"exact: the whole grid, repeated; {description} comes before it and is not counted for either.")
    notes.append("IPOPT: one run, warm-started along the grid, building its solver included, loading the library not.")
    if quick:
        notes.append(f"--quick: IPOPT solved every {stride}th speed and angle only; its time is extrapolated to all cells.")
    return Report(
        f"Solving the map, {speed.size} x {front_angle.size} operating points; processor time", tuple(comparisons), tuple(notes)
    )


def _case(case: str, speed: FloatArray, front_angle: FloatArray, stride: int) -> tuple[Comparison, str]:
    problem = SteadyTurnProblem.from_config(CONFIG, CONFIG.case(case))
    ours = interleaved({"exact": lambda: exact.solve(problem, speed, front_angle)}, REPEATS, CLOCK)["exact"]
    solution = exact.solve(problem, speed, front_angle)
    results: list[Solution] = []

    def by_ipopt(step: int) -> Callable[[], None]:
        return lambda: results.append(ipopt.solve(CONFIG, LinearTurns(problem), speed[::step], front_angle[::step]))

    # Mostly the building of the solver; the call before it loads IPOPT.
    first_cell = interleaved({"first cell": by_ipopt(speed.size)}, 3, CLOCK)["first cell"].median
    seconds = once(by_ipopt(stride), CLOCK)
    cells = results[-1].feasible.size
    extrapolated = first_cell + (seconds - first_cell) * (solution.feasible.size - 1) / (cells - 1)
    sameness = Sameness.of(solution, results[-1], stride)
    peer = Times("IPOPT", (extrapolated,))
    return Comparison(case, peer, ours, REQUIRED, paired=False, same=sameness.within(SAME)), f"{case}: {sameness}"
