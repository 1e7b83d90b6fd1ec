"""The map on the plant's own steady turns: all cells at once, against IPOPT point by point."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.agreement import SAME
from benchmarks.paper_build import CONFIG
from benchmarks.same import Sameness
from benchmarks.solving import CASES, CLOCK
from benchmarks.timing import Comparison, Report, Times, interleaved, once
from codegen import configuration
from codegen.configuration import Config
from codegen.optimum import ipopt
from codegen.optimum.exact import Solution
from codegen.optimum.nonlinear import NonlinearTurns
from codegen.optimum.problem import breakpoints

REQUIRED = 30.0
REPEATS, QUICK_REPEATS = 10, 3
STRIDE, QUICK_STRIDE = 1, 10


def nonlinear(config: Config, case: str) -> Config:
    """Return the configuration with the nonlinear tyre in a case."""
    data = config.model_dump(mode="json")
    data["cases"][case]["tyre_model"] = "magic-formula"
    return configuration.parse(data, "benchmark")


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Measure the cases of the paper; `quick` gives IPOPT a part of the grid."""
    stride = QUICK_STRIDE if quick else STRIDE
    comparisons, notes = [], []
    for case in CASES:
        say(f"solving {case} with the nonlinear tyre")
        comparison, note = _case(case, stride, QUICK_REPEATS if quick else REPEATS)
        comparisons.append(comparison)
        notes.append(note)
    if quick:
        notes.append(f"--quick: IPOPT solved every {stride}th speed and angle only; its time is extrapolated to all cells.")
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
            results.append(ipopt.solve(config, turns, speed[::step], front_angle[::step], None, "magic-formula"))

        return solve

    first_cell = interleaved({"first cell": by_ipopt(speed.size)}, 3, CLOCK)["first cell"].median
    seconds = once(by_ipopt(stride), CLOCK)
    cells = results[-1].feasible.size
    extrapolated = first_cell + (seconds - first_cell) * (solution.feasible.size - 1) / (cells - 1)
    sameness = Sameness.of(solution, results[-1], stride)
    peer = Times("IPOPT", (extrapolated,))
    return Comparison(name, peer, ours, REQUIRED, paired=False, same=sameness.within(SAME)), f"{name}: {sameness}"
