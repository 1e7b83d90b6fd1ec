"""Part "uncertain": maps of `codegen solve --uncertain`, followed by cars that were drawn afresh.

The tyres are known with standard deviations of 1 to 2 %. Each car follows the yaw rate of the map in every feasible cell. It
keeps its limits if sideslip, both slip angles and rear angle do so in all of these cells.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scipy.stats import binom, binomtest

from codegen.optimum.uncertain import CONFIDENCE_LEVEL, SEED, keeps, solve_uncertain, uses_of
from codegen.vehicle.population import draw
from codegen.verify.outcomes import Effort, Outcome, Verdict
from tests.evidence.progress import Progress
from tests.optimum.cars import PAPER, changed
from tests.optimum.populations import uncertain

SHOWS = "10,000 cars drawn afresh keep the limits with a map for 99 % of the cars, in at least this share"
SHARE, CARS = 0.99, 10_000
QUICK_SHARE, QUICK_CARS = 0.9, 1_000
QUICK_GRID = {"speed_points": 15, "front_angle_points": 15}
TYRE_MODELS = ("linear", "magic-formula")
FRESH_SEED = SEED + 1_000
CASE = "4ws-2"


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part. A quick run has a coarse grid, a smaller share and fewer cars."""
    del folders  # maps are solved, not built
    figures = {
        model: progress.once(f"{model} {effort.quick}", lambda model=model: _kept(model, effort)) for model in TYRE_MODELS
    }
    share = QUICK_SHARE if effort.quick else SHARE
    # By chance, a quick run with a small sample behind its map has fewer with p < 0.001.
    least = {
        model: float(binom.ppf(0.001, one["cars"], share)) if effort.quick else share * one["cars"]
        for model, one in figures.items()
    }
    findings = [
        f"{model}: {map_name} keeps {one[map_name]} of {one['cars']} cars, where {wanted} is needed"
        for model, one in figures.items()
        for map_name, wanted, is_right in (
            ("map", f"{share:g}", one["map"] >= least[model]),
            ("nominal", f"less than {share:g}", one["nominal"] < share * one["cars"]),  # else the cars would show nothing
        )
        if not is_right
    ]
    figure = "; ".join(
        f"{model}: {one['map']:,} of {one['cars']:,} cars keep the limits ({one['share']}), "
        f"with the nominal map {one['nominal']:,}"
        for model, one in figures.items()
    )
    return Outcome(SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), figures)


def _kept(model: str, effort: Effort) -> dict[str, Any]:
    """Return how many fresh cars keep the limits with both maps, and the interval of the share for the tightened one."""
    config = uncertain(changed(PAPER, grid=QUICK_GRID) if effort.quick else PAPER).with_tyre_model(model)
    found = solve_uncertain(config, CASE, QUICK_SHARE if effort.quick else SHARE)
    cars = draw(config, QUICK_CARS if effort.quick else CARS, FRESH_SEED)
    kept = int(keeps(uses_of(found.map, cars)).sum())
    by_nominal = int(keeps(uses_of(found.nominal, cars)).sum())
    interval = binomtest(kept, len(cars)).proportion_ci(CONFIDENCE_LEVEL, "exact")
    return {
        "map": kept,
        "nominal": by_nominal,
        "cars": len(cars),
        "share": f"{100.0 * interval.low:.2f} to {100.0 * interval.high:.2f} %",
        "tightening": found.tightening.model_dump(),
    }
