"""Chosen breakpoints for many maps with narrow bounds, and the design of the recommended preset."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.configuration import Config, preset
from codegen.design.gains import design
from codegen.ecu_map.extend import extend
from codegen.ecu_map.lookup import Lookup
from codegen.ecu_map.model_excess import model_excess
from codegen.ecu_map.placement import Maker, Target
from codegen.ecu_map.reference_surface import reference_surface_of
from codegen.ecu_map.storage import Axis
from codegen.errors import BuildError
from codegen.map_file.map import load
from codegen.optimum.solve import layer_configs, solve_case, solve_stack
from tests.ecu_map.placements import (
    COARSE,
    FINE,
    ROUNDING,
    errors_against_optimum,
    largest_error,
    placed,
    random_points,
    rear_angle_error,
    truth_of,
    with_coarse_grid,
)
from tests.ecu_map.test_placement import BARE_BOUND, bare
from tests.optimum.cars import CASE, PAPER, changed, nonlinear, nonlinear_map, paper_map, random_config
from tests.optimum.test_nonlinear import tracking, with_car

HALF_DEGREE = math.radians(0.5)
LONG = pytest.mark.long


def with_safe_case(config: Config) -> Config:
    """Return the configuration with a passively safe 4WS-2 named "safe"."""
    return changed(config, cases={"safe": {**config.cases["4ws-2"].model_dump(mode="json"), "passive_safe": True}})


FLASH_FRACTION = {(1, "float"): 0.12, (1, "int16"): 0.07, (2, "float"): 0.12, (2, "int16"): 0.07}
"""Flash as a fraction of the even grid's for a bound of 0.05 deg/s. Measured: 8.2 % and 4.7 % for one table, 10.6 % and 5.6 %
for two."""
BOUNDS = [
    *(
        pytest.param(case, COARSE, 1, "float", marks=[LONG] if case != "fws" else [])
        for case in ("fws", "4ws-1", "4ws-2", "safe")
    ),
    *(pytest.param("4ws-2", FINE, *table, marks=LONG) for table in FLASH_FRACTION),
]


@pytest.mark.parametrize(("case", "bound", "tables", "storage"), BOUNDS)
def test_the_bound_holds_at_random_points_against_the_optimum_solved_there(
    case: str, bound: float, tables: int, storage: str
) -> None:
    config = with_safe_case(PAPER)
    found = placed(solve_case(config, case), config, bound, tables, storage=storage)
    assert found.origin == "optimum"
    error = largest_error(found.total, truth_of(config, case), 1)
    assert error <= found.error.yaw_rate_whole + ROUNDING
    assert found.error.yaw_rate <= found.error.yaw_rate_whole <= found.bounded_error <= bound
    if tables == 2:
        assert rear_angle_error(found, config, case) <= found.error.rear_yaw_rate_whole + ROUNDING <= bound + ROUNDING
    if bound == FINE:
        assert error > 0.4 * FINE
        assert found.flash_bytes < FLASH_FRACTION[tables, storage] * extend(paper_map(), PAPER).yaw_rate.size * 4 * tables
    if case == "fws":  # even axes if they need no more bytes
        assert placed(paper_map("fws"), PAPER, FINE).spacing == "even"


@LONG
@pytest.mark.parametrize("seed", range(6))
def test_the_bound_holds_for_any_car(seed: int) -> None:
    config = random_config(np.random.default_rng(seed))
    reference_map = solve_case(config, CASE)
    found = placed(reference_map, config, HALF_DEGREE)
    assert found.origin == "optimum"
    assert largest_error(found.total, truth_of(config, CASE), seed) <= HALF_DEGREE + ROUNDING
    if seed < 3:
        both = placed(reference_map, config, HALF_DEGREE, 2)
        assert rear_angle_error(both, config, CASE) <= both.error.rear_yaw_rate_whole + ROUNDING
        assert both.bounded_error <= HALF_DEGREE


NONLINEAR = {
    **{f"{case} {storage}": (with_coarse_grid(nonlinear(with_safe_case(PAPER), case)), case, storage)
       for case in ("4ws-2", "safe") for storage in ("float", "int16")},
    **{f"car {seed}": (nonlinear(random_config(np.random.default_rng(seed)), CASE), CASE, "float") for seed in (101, 105)},
}  # fmt: skip


@LONG
@pytest.mark.parametrize(("config", "case", "storage"), NONLINEAR.values(), ids=NONLINEAR)
def test_with_the_nonlinear_tyre_the_bound_holds_against_the_optimum(config: Config, case: str, storage: str) -> None:
    found = placed(solve_case(config, case), config, COARSE, 2, storage=storage)
    assert found.origin == "surfaces" and found.gap > 0.0
    yaw_rate, rear_angle = errors_against_optimum(config, case, found.total)
    assert yaw_rate <= found.error.yaw_rate_whole <= found.bounded_error <= COARSE
    assert rear_angle <= found.error.rear_angle
    if config.vehicle == PAPER.vehicle:
        assert found.gap < 0.15 * COARSE and yaw_rate > 0.4 * COARSE
        # Slip depends on speed and front angle, so one cap for all is not enough.
        without = replace(found.total, grip=None)
        assert case == "safe" or errors_against_optimum(config, case, without)[0] > 1.2 * COARSE


@LONG
@pytest.mark.parametrize(
    ("max_error", "max_flash", "storage", "place", "remedy"),
    [
        (1e-12, None, "float", "--max-error", "can be reached"),
        (1e-5, None, "int16", "--max-error", "can be reached"),
        (1e-12, 100, "float", "--max-error", "in 100 bytes"),
        (None, 12, "float", "--max-flash", "the smallest one takes 32 bytes"),
        (BARE_BOUND, 40, "float", "--max-error, --max-flash", "in 40 bytes"),
    ],
)
def test_an_impossible_request_is_refused(
    max_error: float | None, max_flash: int | None, storage: str, place: str, remedy: str
) -> None:
    reference_map = paper_map() if place == "--max-error" else bare()
    with pytest.raises(BuildError) as caught:
        placed(reference_map, PAPER, max_error, max_flash=max_flash, storage=storage)  # type: ignore[arg-type]
    assert caught.value.where == place and remedy in caught.value.remedy
    assert "\n" not in str(caught.value)


@LONG
def test_every_friction_of_a_stack_keeps_the_bound() -> None:
    stack = solve_stack(PAPER, "4ws-2", [0.3, 0.6, 0.9])
    found = placed(stack, PAPER, COARSE, storage="int16")
    for layer, config in zip(found.total.stack, [*layer_configs(stack, PAPER), PAPER], strict=True):
        lookup, truth = Lookup.from_map(found.total), truth_of(config, "4ws-2")
        speed, angle = random_points(found.total, 7, 60)
        assert np.abs(lookup(speed[:, np.newaxis], angle, layer.friction) - truth(speed, angle)).max() <= COARSE
    assert len({layer.scales for layer in found.total.stack}) == 1


@LONG
def test_a_search_for_bytes_is_as_good_as_a_search_for_a_bound() -> None:
    """The error is not larger than that of a search for a bound, except for its step (`TIGHTER`, 3 %)."""
    used = Maker(reference_surface_of(bare(), PAPER), Target(1, np.float32, "float"))
    first, even = (used.for_error(BARE_BOUND, (spacing,)) for spacing in ("uneven", "even"))
    assert first is not None and even is not None and even.bounded_error <= BARE_BOUND
    best = used.for_error(BARE_BOUND)  # the spacing with fewer bytes
    assert best is not None and best.flash_bytes <= min(even.flash_bytes, first.flash_bytes)
    assert all(Axis.from_breakpoints(axis).even for axis in (even.total.speed, even.total.front_angle))
    filled = used.for_flash(first.flash_bytes, ("uneven",))
    assert filled is not None and filled.flash_bytes <= first.flash_bytes
    assert filled.bounded_error <= first.bounded_error / 0.97


@LONG
def test_the_excess_of_the_reference_model_covers_every_friction_and_the_tables() -> None:
    """On a slippery road the same table error is a larger fraction of the map's yaw rate."""
    config = changed(tracking(), grid={"speed_points": 31, "front_angle_points": 30})
    stack = solve_stack(config, "4ws-2", [0.4, 0.9])
    total = extend(stack, config, config.steering.front_angle_stop)
    found = model_excess(stack, total, config)
    alone = model_excess(replace(stack, layers=()), replace(total, layers=()), config)
    assert (found.friction, alone.friction) == (0.4, 0.9) and alone.percent < found.percent
    config, solved = tracking(), with_car(nonlinear_map(), tracking())
    total = extend(solved, config, config.steering.front_angle_stop)
    turned = replace(total, rear_angle=total.rear_angle - math.radians(0.2))
    assert model_excess(solved, turned, config).percent > model_excess(solved, total, config).percent + 1.0


def test_the_committed_schedule_is_the_design_of_the_recommended_preset() -> None:
    """Gains have four digits; another machine's linear algebra may change the last one."""
    config = load(Path(__file__).resolve().parents[3] / "generated/4ws2.npz").config
    assert config is not None and config.controller.tracking.schedule is not None
    made = design(preset("recommended"))
    committed, fresh = config.controller.tracking.schedule.model_dump(), made.schedule.model_dump()
    for key in ("speed_km_h", "proportional_gain_s", "integral_gain"):
        np.testing.assert_allclose(committed[key], fresh[key], rtol=2e-3)
    assert made.family_size == 244 and made.counted[:8] == (244,) * 8
    assert min(made.counted) > 100
