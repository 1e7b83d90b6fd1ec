"""Chosen breakpoints: the bound holds at random points relative to the optimum solved there.

The evidence tier places more maps, with narrow bounds.
"""

import functools
import math
from dataclasses import astuple, replace

import numpy as np
import numpy.typing as npt
import pytest

from codegen import configuration
from codegen.ecu_map.extend import extend
from codegen.ecu_map.lookup import Lookup
from codegen.ecu_map.placement import Maker, Target
from codegen.ecu_map.placement_error import ErrorEstimator
from codegen.ecu_map.reference_surface import Gap, ReferenceSurface, reference_surface_of
from codegen.ecu_map.total import Rule
from codegen.map_file.map import ReferenceMap, from_arrays
from codegen.optimum.solve import solve_case
from tests.ecu_map.placements import (
    ROUNDING,
    errors_against_optimum,
    largest_error,
    placed,
    truth_of,
    with_coarse_grid,
)
from tests.optimum.cars import PAPER, changed, paper_map, paper_total

BARE_BOUND = math.radians(4.0)


@functools.cache
def surface() -> ReferenceSurface:
    """Return the surface of the paper's 4WS-2."""
    return reference_surface_of(paper_map(), PAPER)


@functools.cache
def bare() -> ReferenceMap:
    """Return a user's table: every tenth speed and every fourteenth angle of the paper's map."""
    solved, cells = paper_map(), (slice(None, None, 10), slice(None, None, 14))
    arrays: dict[str, npt.NDArray[np.generic]] = {"vx": solved.speed[cells[0]], "delta_f": solved.front_angle[cells[1]]}
    return from_arrays({**arrays, "yaw_rate": solved.yaw_rate[cells], "feasible": solved.feasible[cells]}, "bare")


@pytest.mark.parametrize("fault", ["none", "a number", "a speed moved"])
def test_the_measured_error_is_that_at_random_points(fault: str) -> None:
    """The table has a tenth of the paper's breakpoints and thus an error, with and without a planted fault."""
    total, kept = paper_total(), np.r_[0, 1:102:10]
    speed, front_angle = total.speed[kept], total.front_angle[kept]
    table = {name: getattr(total, name)[np.ix_(kept, kept)] for name in ("yaw_rate", "rear_angle", "rule")}
    if fault == "a number":
        table["yaw_rate"] = table["yaw_rate"] + 0.2 * (np.arange(front_angle.size) == 3)
    elif fault == "a speed moved":
        speed[3] = 0.5 * (speed[2] + speed[3])
    found = replace(total, speed=speed, front_angle=front_angle, **table)
    measured = ErrorEstimator(surface(), (speed, front_angle), np.float32).error(found)
    unsure = replace(surface(), layers=(replace(surface().layers[0], gap=Gap(0.1, 0.2, 0.3)),))
    wider = ErrorEstimator(unsure, (speed, front_angle), np.float32).error(found)
    assert np.subtract(astuple(wider), astuple(measured)) == pytest.approx([0.1, 0.1, 0.2, 0.2, 0.3])
    seen = largest_error(found, truth_of(PAPER, "4ws-2"), 3)
    assert (measured.yaw_rate_whole > math.radians(4.6)) == (fault != "none")
    assert 0.9 * measured.yaw_rate_whole < seen < measured.yaw_rate_whole + ROUNDING


def test_a_bare_table_is_compared_with_its_own_interpolation() -> None:
    total = extend(bare(), PAPER, PAPER.steering.front_angle_stop)
    own = Lookup.from_map(total, np.float64)
    uneven = Maker(reference_surface_of(bare(), PAPER), Target(1, np.float32, "float")).for_error(BARE_BOUND, ("uneven",))
    assert uneven is not None and (uneven.origin, uneven.gap) == ("table", 0.0)
    assert largest_error(uneven.total, lambda v, a: own(v[:, np.newaxis], a), 6) <= BARE_BOUND + ROUNDING
    assert uneven.flash_bytes < 4 * total.yaw_rate.size
    assert Rule.CONTINUED.value not in uneven.total.rule


def test_an_edited_map_counts_as_a_table() -> None:
    solved = paper_map()
    yaw_rate, feasible = solved.yaw_rate.copy(), solved.feasible.copy()
    yaw_rate[50, 20] *= 0.9
    feasible[50, 20:] = False
    fewer = replace(solved, feasible=feasible, yaw_rate=np.where(feasible, solved.yaw_rate, np.nan))
    assert surface().origin == "optimum"
    assert [reference_surface_of(each, PAPER).origin for each in (replace(solved, yaw_rate=yaw_rate), fewer)] == [
        "table",
        "table",
    ]
    safe = changed(PAPER, cases={"safe": {**PAPER.cases["4ws-2"].model_dump(mode="json"), "passive_safe": True}})
    of_safe = reference_surface_of(solve_case(safe, "safe"), safe)
    speed, angle = np.linspace(0.0, 33.0, 40), np.linspace(0.0, 0.6, 50)
    found, expected = of_safe.layers[-1].truth(speed, angle)[0], truth_of(safe, "safe")(speed, angle)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)  # the edge is moved inside by 1e-12 of its value


def test_a_map_that_bends_towards_its_cap_has_no_table_of_grip() -> None:
    """The error is that against the optimum, solved anew; the yaw rate never falls up to the stop, and stays below the cap."""
    config = with_coarse_grid(configuration.preset("recommended"))
    solved, bound = solve_case(config, "4ws-2"), math.radians(0.5)
    found = placed(solved, config, bound)
    assert (found.origin, found.total.grip) == ("surfaces", None)
    assert 0.0 < found.gap < found.bounded_error <= bound
    assert errors_against_optimum(config, "4ws-2", found.total)[0] <= bound
    for total in (found.total, extend(solved, config, config.steering.front_angle_stop)):
        rules, within = set(np.unique(total.rule)), total.front_angle <= solved.front_angle[-1]
        assert Rule.HOLD.value not in rules and not within.all()
        lookup, cap = Lookup.from_map(total, np.float64), total.lateral_acceleration_cap
        speed, front_angle = np.linspace(5.0, 33.0, 60), np.linspace(0.0, total.front_angle[-1], 700)
        yaw_rate = lookup(speed[:, np.newaxis], front_angle)
        assert np.diff(yaw_rate, axis=1).min() >= -1e-12
        assert (yaw_rate * speed[:, np.newaxis]).max() <= cap * (1.0 + 1e-12)
