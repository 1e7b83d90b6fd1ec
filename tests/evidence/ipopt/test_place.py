"""Chosen breakpoints over many maps with narrow bounds, and the design of the recommended preset."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.config import KM_H, Config, preset
from codegen.design.tune import design
from codegen.errors import BuildError
from codegen.refmap.extend import extend
from codegen.refmap.lookup import Lookup
from codegen.refmap.map import load
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import layer_configs, solve_stack
from codegen.refmap.turns import turns_of
from tests.refmap.cars import CASE, PAPER, changed, nonlinear, paper_map, random_config
from tests.refmap.placing import (
    COARSE,
    FINE,
    ROUNDING,
    coarsely,
    errors_against_optimum,
    largest_error,
    placed,
    random_points,
    rear_angle_error,
    truth_of,
)

HALF_DEGREE = math.radians(0.5)
LONG = pytest.mark.long


def with_safe_case(config: Config) -> Config:
    """The configuration with a passively safe 4WS-2 under the name "safe"."""
    safe = {**config.cases["4ws-2"].model_dump(mode="json"), "passive_safe": True}
    return changed(config, cases={"safe": safe})


@pytest.mark.parametrize(
    "case", ["fws", pytest.param("4ws-1", marks=LONG), pytest.param("4ws-2", marks=LONG), pytest.param("safe", marks=LONG)]
)
def test_the_bound_holds_at_random_points_against_the_optimum_solved_there(case: str) -> None:
    config = with_safe_case(PAPER)
    found = placed(solve_case(config, case), config, COARSE)
    assert found.origin == "optimum"
    error = largest_error(found.total, truth_of(config, case), 1)
    assert error <= found.error.yaw_rate_whole + ROUNDING
    assert found.error.yaw_rate <= found.error.yaw_rate_whole <= COARSE
    if case == "fws":  # even axes where they take no more bytes
        assert placed(paper_map("fws"), PAPER, FINE).spacing == "even"


@LONG
@pytest.mark.parametrize("storage", ["float", "int16"])
@pytest.mark.parametrize("tables", [1, 2])
def test_a_twentieth_of_a_degree_takes_a_tenth_of_the_even_grid(storage: str, tables: int) -> None:
    """8.2 % and 4.7 % are found for one table, 10.6 % and 5.6 % for two."""
    found = placed(paper_map(), PAPER, FINE, tables, storage=storage)
    assert 0.4 * FINE < largest_error(found.total, truth_of(PAPER, "4ws-2"), 2) <= FINE
    grid = extend(paper_map(), PAPER).yaw_rate.size * 4 * tables
    assert found.flash_bytes < (0.12 if storage == "float" else 0.07) * grid


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=LONG) for seed in range(1, 6))])
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


@LONG
@pytest.mark.parametrize("storage", ["float", "int16"])
@pytest.mark.parametrize("passive_safe", [False, True])
def test_with_the_nonlinear_tyre_the_bound_holds_against_the_optimum(passive_safe: bool, storage: str) -> None:
    case = "safe" if passive_safe else "4ws-2"
    config = coarsely(nonlinear(with_safe_case(PAPER), case))
    found = placed(solve_case(config, case), config, COARSE, 2, storage=storage)
    assert found.origin == "surfaces" and 0.0 < found.gap < 0.15 * COARSE
    yaw_rate, rear_angle = errors_against_optimum(config, case, found.total)
    assert 0.4 * COARSE < yaw_rate <= found.error.yaw_rate_whole <= found.bounded_error <= COARSE
    assert rear_angle <= found.error.rear_angle
    # One cap for all speeds and front angles is not enough: slip depends on both.
    without = replace(found.total, grip=None)
    assert passive_safe or errors_against_optimum(config, case, without)[0] > 1.2 * COARSE


@LONG
@pytest.mark.parametrize("seed", [101, 105])
def test_with_the_nonlinear_tyre_the_bound_holds_for_any_car(seed: int) -> None:
    config = nonlinear(random_config(np.random.default_rng(seed)), CASE)
    found = placed(solve_case(config, CASE), config, COARSE, 2)
    yaw_rate, rear_angle = errors_against_optimum(config, CASE, found.total)
    assert yaw_rate <= found.error.yaw_rate_whole <= found.bounded_error <= COARSE
    assert rear_angle <= found.error.rear_angle


@LONG
def test_with_the_nonlinear_tyre_a_map_without_rear_steering_ends_with_the_yaw_rate_of_its_edge() -> None:
    """The cap beyond an edge is that at the edge, but for the bound at either place."""
    config = coarsely(nonlinear(PAPER, "fws"))
    found = placed(solve_case(config, "fws"), config, COARSE)
    speed = np.linspace(50.0, 110.0, 7) * KM_H
    edge = turns_of(config, config.case("fws")).edge(speed, math.radians(10.0))
    assert edge.grip_limited.all()
    beyond = np.array([1.01, 1.3, 2.0])[:, np.newaxis] * edge.front_angle
    yaw_rate = Lookup.from_map(found.total, np.float64)(speed, beyond)
    np.testing.assert_allclose(yaw_rate, np.broadcast_to(edge.yaw_rate, beyond.shape), rtol=0.0, atol=COARSE)


@LONG
@pytest.mark.parametrize(
    ("max_error", "max_flash", "storage", "remedy"),
    [(1e-12, None, "float", "can be reached"), (1e-5, None, "int16", "can be reached"), (1e-12, 100, "float", "in 100 bytes")],
)
def test_an_error_that_no_table_can_have_is_refused(max_error: float, max_flash: int | None, storage: str, remedy: str) -> None:
    with pytest.raises(BuildError) as caught:
        placed(paper_map(), PAPER, max_error, max_flash=max_flash, storage=storage)
    assert caught.value.where == "--max-error" and remedy in caught.value.remedy
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


def test_the_committed_schedule_is_the_design_of_the_recommended_preset() -> None:
    """A gain has four digits, and another machine's linear algebra may change the last one."""
    config = load(Path(__file__).resolve().parents[3] / "generated/4ws2-tracking.npz").config
    assert config is not None and config.controller.tracking.schedule is not None
    made = design(preset("recommended"))
    committed, fresh = config.controller.tracking.schedule.model_dump(), made.schedule.model_dump()
    for key in ("speed_km_h", "proportional_gain_s", "integral_gain"):
        np.testing.assert_allclose(committed[key], fresh[key], rtol=2e-3)
    assert made.family_size == 243 and made.counted[:8] == (243,) * 8
    assert min(made.counted) > 100
