"""Chosen breakpoints: the bound holds at random points against the optimum solved there, in as few bytes as are told."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.nonlinear_map import nonlinear
from codegen.config import KM_H, Config
from codegen.errors import BuildError
from codegen.refmap import exact
from codegen.refmap.axis import Axis
from codegen.refmap.extend import extend
from codegen.refmap.lookup import Lookup
from codegen.refmap.map import ReferenceMap, from_arrays
from codegen.refmap.place import SPACINGS, Maker, Placed, Request, Target, choose
from codegen.refmap.place_error import Ruler
from codegen.refmap.place_ground import Ground, above_zero, capped, extended, ground_of
from codegen.refmap.place_sheet import gain_of, reference_sheet, yaw_rate_sheet
from codegen.refmap.problem import SteadyTurnProblem, breakpoints
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import layer_configs, solve_stack
from codegen.refmap.storage import RAW_MAX, Real
from codegen.refmap.total import Rule, TotalMap
from codegen.refmap.turns import passively_feasible, turns_of
from tests.refmap.cars import CASE, random_config

FloatArray = npt.NDArray[np.float64]
Truth = Callable[[FloatArray, FloatArray], FloatArray]

COARSE, FINE = math.radians(0.2), math.radians(0.05)
ROUNDING = 1e-6
"""rad/s: of the lookup in single precision, whose own bound (`lookup.error_bound`) is below this for these tables."""


def safe(config: Config, case: str) -> Config:
    data = config.model_dump()
    data["cases"]["safe"] = {**data["cases"][case], "passive_safe": True}
    return Config.model_validate(data)


def truth_of(config: Config, case: str) -> Truth:
    """The total map's rules, with the optimum solved at each point: by the bounded problem and its edges, one speed at a time.

    Shares with the code under test the exact solution alone; nothing here is without grip bounds, and nothing is a table.
    """
    problem = SteadyTurnProblem.from_config(config, config.case(case))
    passive = replace(problem, rear_angle_max=0.0)
    is_safe = config.case(case).passive_safe
    grid = solve_case(config, case)
    first_speed, first, last = grid.speed[0], grid.front_angle[0], grid.front_angle[-1]
    cap = problem.lateral_acceleration_cap

    def row(speed: float, angles: FloatArray) -> FloatArray:
        v = np.array([max(speed, first_speed)])
        gain = float(problem.car.yaw_gain(v)[0])
        edge = exact.edge(passive if is_safe else problem, v)
        end = float(edge.front_angle[0])
        grip = bool(edge.grip_limited[0]) and not is_safe
        inside = np.clip(angles, first, last)
        solved = exact.solve(problem, v, np.minimum(inside, end * (1.0 - 1e-12))).yaw_rate[0]
        at_edge = float(exact.solve(problem, v, np.array([end * (1.0 - 1e-12)])).yaw_rate[0, 0])
        beyond = np.full_like(angles, cap / v[0]) if grip else at_edge + gain * (np.maximum(angles, first) - end)
        value = np.where(inside > end, beyond, solved + gain * np.maximum(angles - last, 0.0))
        # Linear to zero below the first breakpoints, before the cap.
        value = value * min(speed / first_speed, 1.0) * np.minimum(angles / first, 1.0)
        result: FloatArray = np.minimum(value, cap / max(speed, 1e-9))
        return result

    return lambda speed, angle: np.stack([row(float(v), angle) for v in speed])


def random_points(total: TotalMap, seed: int, count: int = 160) -> tuple[FloatArray, FloatArray]:
    """Speeds and angles over the whole domain, half of them where the cells are."""
    rng = np.random.default_rng(seed)

    def points(axis: FloatArray) -> FloatArray:
        anywhere = rng.uniform(0.0, axis[-1], count)
        cell = rng.integers(0, axis.size - 1, count)
        return np.concatenate([anywhere, axis[cell] + rng.uniform(size=count) * np.diff(axis)[cell]])

    return points(total.speed), points(total.front_angle)


def largest_error(total: TotalMap, truth: Truth, seed: int) -> float:
    speed, angle = (axis.astype(np.float32).astype(np.float64) for axis in random_points(total, seed))
    found = Lookup.from_map(total)(speed[:, np.newaxis], angle)
    return float(np.abs(found - truth(speed, angle)).max())


def placed(reference_map: ReferenceMap, config: Config, bound: float, tables: int = 1, **changes: object) -> Placed:
    request = replace(Request(bound, None, "float", ""), **changes)  # type: ignore[arg-type]
    return choose(reference_map, config, request, tables, np.float32)


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2", "safe"])
def test_the_bound_holds_at_random_points_against_the_optimum_solved_there(paper: Config, case: str) -> None:
    config = safe(paper, "4ws-2")
    found = placed(solve_case(config, case), config, COARSE)
    assert found.origin == "optimum"
    error = largest_error(found.total, truth_of(config, case), 1)
    assert error <= COARSE
    assert error <= found.error.yaw_rate_whole + ROUNDING  # what is told is the largest there is
    assert found.error.yaw_rate <= found.error.yaw_rate_whole <= COARSE


@pytest.mark.parametrize("storage", ["float", "int16"])
@pytest.mark.parametrize("tables", [1, 2])
def test_a_twentieth_of_a_degree_takes_a_tenth_of_the_even_grid(
    paper: Config, maps: dict[str, ReferenceMap], storage: str, tables: int
) -> None:
    found = placed(maps["4ws-2"], paper, FINE, tables, storage=storage)
    assert 0.4 * FINE < largest_error(found.total, truth_of(paper, "4ws-2"), 2) <= FINE
    grid = extend(maps["4ws-2"], paper).yaw_rate.size * 4 * tables
    # 8.2 % and 4.7 % are found for one table, 10.6 % and 5.6 % for two.
    assert found.flash_bytes < (0.12 if storage == "float" else 0.07) * grid


def off_the_optimum(found: Placed, config: Config, case: str, storage: Real = np.float32) -> float:
    """Largest error of the rear angle as a yaw rate (rad/s), at random points where the optimum solved there is feasible."""
    rng = np.random.default_rng(5)
    speed, front_angle = (
        np.sort(rng.uniform(*ends, 300)).astype(storage).astype(np.float64) for ends in (found.own_speed, found.own_front_angle)
    )
    problem = SteadyTurnProblem.from_config(config, config.case(case))
    optimum = exact.solve(problem, speed, front_angle)
    _, rear_angle = Lookup.from_map(found.total, storage).reference(speed[:, np.newaxis], front_angle)
    largest = found.total.steering.rear_angle_max
    held = (np.clip(angle, -largest, largest) for angle in (rear_angle.astype(np.float64), optimum.rear_angle))
    error = np.abs(np.subtract(*held))
    inside = optimum.margin > 1e-9  # rad: at the edge itself rounding decides
    assert inside.mean() > 0.3
    return float((error * problem.car.yaw_gain(speed)[:, np.newaxis])[inside].max())


def test_the_bound_holds_for_the_rear_angle_too_where_that_is_looked_up(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    """As the yaw rate that it is worth; one table does not know of it."""
    one, both = (placed(maps["4ws-2"], paper, COARSE, tables) for tables in (1, 2))
    error = off_the_optimum(both, paper, "4ws-2")
    assert 0.4 * COARSE < error <= both.error.rear_yaw_rate_whole + ROUNDING
    assert both.error.rear_yaw_rate_whole <= both.bounded_error <= COARSE
    assert off_the_optimum(one, paper, "4ws-2") > 2.0 * COARSE
    assert one.bounded_error == one.error.yaw_rate_whole


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_on_the_rear_angle_holds_for_any_car(seed: int) -> None:
    config = random_config(np.random.default_rng(seed))
    found = placed(solve_case(config, CASE), config, math.radians(0.5), 2)
    assert off_the_optimum(found, config, CASE) <= found.error.rear_yaw_rate_whole + ROUNDING
    assert found.bounded_error <= math.radians(0.5)


@pytest.mark.parametrize("tyre", ["linear", "nonlinear"])
def test_what_a_sheet_makes_of_exact_numbers_is_the_truth(paper: Config, tyre: str) -> None:
    """And the lookup makes the same of others."""
    config = coarsely(paper if tyre == "linear" else nonlinear(paper, "4ws-2"))
    layer = ground_of(solve_case(config, "4ws-2"), config).layers[-1]
    speed, front_angle = np.linspace(0.0, 33.0, 120), np.linspace(0.0, 0.6, 110)
    for sheet in (yaw_rate_sheet(layer, None), reference_sheet(layer, None)):
        made = sheet.outcome(sheet.values(speed, front_angle), sheet.beside(speed, front_angle))
        np.testing.assert_allclose(made, sheet.truth(speed, front_angle), rtol=0.0, atol=1e-12)
    sheet, rng = reference_sheet(layer, None), np.random.default_rng(2)
    tables = layer.surface(speed, front_angle)
    other = [table + rng.normal(scale=size, size=table.shape) for table, size in zip(tables, (0.1, 0.02), strict=True)]
    made = sheet.outcome(np.stack(other), sheet.beside(speed, front_angle))
    wanted = capped(other[0], other[1], layer.allowed(speed, front_angle), speed, layer.total.steering)
    gain = gain_of(layer.total.steering, above_zero(speed))[:, np.newaxis]
    np.testing.assert_allclose(made, np.stack([wanted[0], wanted[1] * gain]), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_the_bound_holds_for_any_car(seed: int) -> None:
    config = random_config(np.random.default_rng(seed))
    found = placed(solve_case(config, CASE), config, math.radians(0.5))
    assert found.origin == "optimum"
    assert largest_error(found.total, truth_of(config, CASE), seed) <= math.radians(0.5) + ROUNDING


@pytest.mark.parametrize("plant", ["a number", "a breakpoint left out", "a speed moved"])
def test_what_is_planted_is_measured(paper: Config, maps: dict[str, ReferenceMap], plant: str) -> None:
    """By the ruler of the code, and by the random points of this test."""
    good = placed(maps["4ws-2"], paper, COARSE).total
    i, j = good.speed.size // 2, good.front_angle.size // 2
    if plant == "a number":
        spoiled = replace(good, yaw_rate=good.yaw_rate + 0.01 * (np.arange(good.front_angle.size) == j))
    elif plant == "a breakpoint left out":
        keep = np.arange(good.front_angle.size) != j
        spoiled = replace(good, front_angle=good.front_angle[keep], yaw_rate=good.yaw_rate[:, keep],
                          rear_angle=good.rear_angle[:, keep], rule=good.rule[:, keep])  # fmt: skip
    else:
        speed = good.speed.copy()
        speed[i] = 0.5 * (speed[i - 1] + speed[i])
        spoiled = replace(good, speed=speed)
    ground = ground_of(maps["4ws-2"], paper)
    measured = Ruler(ground, (spoiled.speed, spoiled.front_angle), np.float32).error(spoiled)
    assert measured.yaw_rate > COARSE
    assert largest_error(spoiled, truth_of(paper, "4ws-2"), 3) > COARSE


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_the_surface_under_the_cap_is_the_optimum_with_its_rear_angle(paper: Config, case: str) -> None:
    ground = ground_of(solve_case(paper, case), paper)
    problem = SteadyTurnProblem.from_config(paper, paper.case(case))
    speed, angle = np.linspace(*ground.own_speed, 83), np.linspace(*ground.own_front_angle, 97)
    optimum = exact.solve(problem, speed, angle)
    inside = optimum.margin > 1e-9  # rad: at the edge itself rounding decides
    yaw_rate, rear_angle = ground.layers[-1].truth(speed, angle)
    np.testing.assert_allclose(yaw_rate[inside], optimum.yaw_rate[inside], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(rear_angle[inside], optimum.rear_angle[inside], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2"])
def test_a_plainly_extended_optimum_is_the_total_map_on_its_grid(paper: Config, case: str) -> None:
    """`extended`, for optima that are not known without their grip bounds."""
    reference_map = solve_case(paper, case)
    total = extend(reference_map, paper)
    problem = SteadyTurnProblem.from_config(paper, paper.case(case))
    surface = extended(
        lambda v, a: exact.solve(problem, v, a),
        lambda v: exact.edge(problem, v),
        problem.car.yaw_gain,
        problem.lateral_acceleration_cap,
        reference_map.speed,
        reference_map.front_angle,
        total.steering,
    )
    yaw_rate, rear_angle = surface(total.speed, total.front_angle)
    np.testing.assert_allclose(yaw_rate, total.yaw_rate, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(rear_angle, total.rear_angle, rtol=0.0, atol=1e-12)


def test_even_axes_where_they_take_no_more_bytes(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    flat = placed(maps["fws"], paper, FINE)
    assert flat.spacing == "even"
    maker = Maker(ground_of(maps["4ws-2"], paper), Target(1, np.float32, "float"))
    even, uneven = (maker.for_error(2.0 * COARSE, (spacing,)) for spacing in SPACINGS)
    assert even is not None and uneven is not None
    assert all(Axis.from_breakpoints(axis).even for axis in (even.total.speed, even.total.front_angle))
    assert uneven.flash_bytes < even.flash_bytes
    assert max(even.error.yaw_rate_whole, uneven.error.yaw_rate_whole) <= 2.0 * COARSE
    assert largest_error(even.total, truth_of(paper, "4ws-2"), 4) <= 2.0 * COARSE


def test_raw_numbers_are_the_nearest_of_16_bits(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    found = placed(maps["4ws-2"], paper, COARSE, 2, storage="int16")
    scales = found.total.scales
    assert scales is not None
    surface = ground_of(maps["4ws-2"], paper).layers[-1].surface(found.total.speed, found.total.front_angle)
    for stored, exactly, scale, told in zip(
        (found.total.yaw_rate, found.total.rear_angle),
        surface,
        (scales.yaw_rate, scales.rear_angle),
        found.rounding,
        strict=True,
    ):
        raw = stored / scale
        assert np.array_equal(raw, np.rint(raw)) and np.abs(raw).max() == RAW_MAX
        assert float(np.float32(scale)) == scale
        off = np.abs(stored - np.minimum(exactly, stored.max())).max()
        assert off == pytest.approx(told, rel=1e-9) and off <= 0.5 * scale * (1.0 + 1e-6)


def test_no_more_bytes_than_allowed_and_less_error_for_more_bytes(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    smallest = [placed(maps["4ws-1"], paper, 0.0, max_error=None, max_flash=size).flash_bytes for size in (32, 40)]
    assert smallest == [32, 32]  # two by two; two by three take 44
    found = [placed(maps["4ws-1"], paper, 0.0, max_error=None, max_flash=size) for size in (150, 400)]
    assert [each.flash_bytes <= size for each, size in zip(found, (150, 400), strict=True)] == [True, True]
    assert found[1].error.yaw_rate_whole < 0.5 * found[0].error.yaw_rate_whole
    assert largest_error(found[1].total, truth_of(paper, "4ws-1"), 5) <= found[1].error.yaw_rate_whole + ROUNDING


@pytest.mark.parametrize("degrees", [0.25, 0.2, 0.175])
def test_so_many_bytes_give_no_larger_error_than_a_bound_that_takes_them(
    paper: Config, maps: dict[str, ReferenceMap], degrees: float
) -> None:
    """But for the step of the search (`TIGHTER`, 3 %)."""
    maker = Maker(ground_of(maps["4ws-2"], paper), Target(1, np.float32, "float"))
    bounded = maker.for_error(math.radians(degrees), ("uneven",))
    assert bounded is not None
    filled = maker.for_flash(bounded.flash_bytes, ("uneven",))
    assert filled is not None and filled.flash_bytes <= bounded.flash_bytes
    assert filled.error.yaw_rate_whole <= bounded.error.yaw_rate_whole / 0.97


def test_a_bare_table_is_measured_against_its_own_interpolation(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    solved = maps["4ws-2"]
    cells = (slice(None, None, 5), slice(None, None, 9))
    arrays: dict[str, npt.NDArray[Any]] = {"vx": solved.speed[cells[0]], "delta_f": solved.front_angle[cells[1]]}
    arrays |= {"yaw_rate": solved.yaw_rate[cells], "feasible": solved.feasible[cells]}
    bare = from_arrays(arrays, "bare")
    found = placed(bare, paper, COARSE)
    assert (found.origin, found.gap) == ("table", 0.0)
    total = extend(bare, paper, paper.steering.front_angle_stop)
    own = Lookup.from_map(total, np.float64)
    assert largest_error(found.total, lambda v, a: own(v[:, np.newaxis], a), 6) <= COARSE + ROUNDING
    assert found.flash_bytes < 4 * total.yaw_rate.size
    assert Rule.CONTINUED.value not in found.total.rule


def coarsely(config: Config) -> Config:
    """On a grid of a few points: the optimum of a case is solved anew, and that grid only says how far."""
    data = config.model_dump(mode="json")
    data["grid"] |= {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20}
    return Config.model_validate(data)


def against_optimum(config: Config, case: str, total: TotalMap) -> tuple[float, float]:
    """Largest error of the stored yaw rate (rad/s) and rear angle (rad) where the optimum solved there is feasible."""
    rng = np.random.default_rng(11)
    grid = breakpoints(config)
    speed, front_angle = (np.sort(rng.uniform(axis[0], axis[-1], 140)) for axis in grid)
    turns, chosen = turns_of(config, config.case(case)), config.case(case)
    optimum = turns.solve(speed, front_angle)
    feasible = optimum.feasible & (passively_feasible(turns, speed, front_angle) if chosen.passive_safe else True)
    assert 0.3 < np.mean(feasible) < 0.9
    stored = Lookup.from_map(total, np.float32).reference(speed[:, np.newaxis], front_angle, math.nan)
    largest = total.steering.rear_angle_max  # in which the laws hold it
    yaw_rate = np.abs(stored[0] - optimum.yaw_rate)
    rear_angle = np.abs(np.clip(stored[1], -largest, largest) - np.clip(optimum.rear_angle, -largest, largest))
    return float(yaw_rate[feasible].max()), float(rear_angle[feasible].max())


@pytest.mark.parametrize("storage", ["float", "int16"])
@pytest.mark.parametrize("passive_safe", [False, True])
def test_with_the_nonlinear_tyre_the_bound_holds_against_the_optimum(paper: Config, passive_safe: bool, storage: str) -> None:
    config = coarsely(nonlinear(safe(paper, "4ws-2") if passive_safe else paper, "4ws-2"))
    found = placed(solve_case(config, "4ws-2"), config, COARSE, 2, storage=storage)
    assert found.origin == "surfaces"
    assert 0.0 < found.gap < 0.15 * COARSE
    yaw_rate, rear_angle = against_optimum(config, "4ws-2", found.total)
    assert 0.4 * COARSE < yaw_rate <= found.error.yaw_rate_whole <= found.bounded_error <= COARSE
    assert rear_angle <= found.error.rear_angle
    assert Rule.CONTINUED.value in found.total.rule
    # One cap for all speeds and front angles could not: slip follows both.
    without = replace(found.total, grip=None)
    assert passive_safe or against_optimum(config, "4ws-2", without)[0] > 1.2 * COARSE


@pytest.mark.parametrize("seed", [101, 105])
def test_with_the_nonlinear_tyre_the_bound_holds_for_any_car(seed: int) -> None:
    config = nonlinear(random_config(np.random.default_rng(seed)), CASE)
    found = placed(solve_case(config, CASE), config, COARSE, 2)
    assert found.origin == "surfaces"
    yaw_rate, rear_angle = against_optimum(config, CASE, found.total)
    assert yaw_rate <= found.error.yaw_rate_whole <= found.bounded_error <= COARSE
    assert rear_angle <= found.error.rear_angle


def test_with_the_nonlinear_tyre_a_map_without_rear_steering_ends_with_the_yaw_rate_of_its_edge(paper: Config) -> None:
    """What grip leaves is held beyond an edge: no more there than at it, but for the bound at either place."""
    config = coarsely(nonlinear(paper, "fws"))
    found = placed(solve_case(config, "fws"), config, COARSE)
    speed = np.linspace(50.0, 110.0, 7) * KM_H
    edge = turns_of(config, config.case("fws")).edge(speed, math.radians(10.0))
    assert edge.grip_limited.all()
    beyond = np.array([1.01, 1.3, 2.0])[:, np.newaxis] * edge.front_angle
    yaw_rate = Lookup.from_map(found.total, np.float64)(speed, beyond)
    np.testing.assert_allclose(yaw_rate, np.broadcast_to(edge.yaw_rate, beyond.shape), rtol=0.0, atol=COARSE)


def test_what_the_fine_grid_is_off_is_counted(paper: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a coarse one it is more than any table could make good: told before a table is searched for."""
    monkeypatch.setattr("codegen.refmap.place_grip.HALVINGS", 0)
    config = coarsely(nonlinear(paper, "4ws-2"))
    ground = ground_of(solve_case(config, "4ws-2"), config)
    gap = ground.layers[-1].gap.yaw_rate
    assert gap > FINE
    maker = Maker(ground, Target(1, np.float32, "float"))
    assert maker.for_error(0.99 * gap) is None
    found = maker.for_error(2.0 * gap, ("uneven",))
    assert found is not None and gap < found.error.yaw_rate_whole <= 2.0 * gap


def test_a_solved_map_that_was_edited_is_a_table(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    solved = maps["4ws-2"]
    yaw_rate = solved.yaw_rate.copy()
    yaw_rate[50, 20] *= 0.9
    feasible = solved.feasible.copy()
    feasible[50, 20:] = False
    fewer = replace(solved, feasible=feasible, yaw_rate=np.where(feasible, solved.yaw_rate, np.nan))
    assert [ground_of(each, paper).origin for each in (solved, replace(solved, yaw_rate=yaw_rate), fewer)] == [
        "optimum",
        "table",
        "table",
    ]


def test_every_friction_of_a_stack_keeps_the_bound(paper: Config) -> None:
    stack = solve_stack(paper, "4ws-2", [0.3, 0.6, 0.9])
    found = placed(stack, paper, COARSE, storage="int16")
    configs = [*layer_configs(stack, paper), paper]
    for layer, config in zip(found.total.stack, configs, strict=True):
        lookup, truth = Lookup.from_map(found.total), truth_of(config, "4ws-2")
        speed, angle = (axis.astype(np.float32).astype(np.float64) for axis in random_points(found.total, 7, 60))
        error = np.abs(lookup(speed[:, np.newaxis], angle, layer.friction) - truth(speed, angle)).max()
        assert error <= COARSE
    assert len({layer.scales for layer in found.total.stack}) == 1


def test_the_same_request_gives_the_same_numbers(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    one, other = (placed(maps["4ws-2"], paper, COARSE) for _ in range(2))
    for name in ("speed", "front_angle", "yaw_rate", "rear_angle", "rule"):
        np.testing.assert_array_equal(getattr(one.total, name), getattr(other.total, name))


def test_what_a_maker_found_before_does_not_change_what_it_finds(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    """Searches for other bounds come by the same coarse ones, which are searched for once."""
    ground, target = ground_of(maps["4ws-2"], paper), Target(1, np.float32, "float")
    used = Maker(ground, target)
    assert used.for_error(2.0 * COARSE) is not None
    again, fresh = (maker.for_error(COARSE) for maker in (used, Maker(ground, target)))
    assert again is not None and fresh is not None
    for name in ("speed", "front_angle", "yaw_rate", "rear_angle", "rule"):
        np.testing.assert_array_equal(getattr(again.total, name), getattr(fresh.total, name))


def test_letters_tell_where_the_cells_come_from(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    total = placed(maps["4ws-2"], paper, COARSE).total
    problem = SteadyTurnProblem.from_config(paper, paper.case("4ws-2"))
    above = total.yaw_rate * total.speed[:, np.newaxis] > problem.lateral_acceleration_cap * (1.0 + 1e-6)
    assert ((total.rule == Rule.CONTINUED.value) == above).mean() > 0.99  # but where the table is held, far above the cap
    solved = total.rule == Rule.SOLVED.value
    optimum = exact.solve(problem, np.maximum(total.speed, 1.0), total.front_angle)
    assert solved.any() and optimum.feasible[solved].mean() > 0.9  # but where the letter is that of the next cell of the map
    assert set(total.rule[0]) == set(total.rule[:, 0]) == {Rule.ZERO.value}


@pytest.mark.parametrize(
    ("request_", "place", "told"),
    [
        (Request(1e-12, None, "float", ""), "--max-error", "can be reached"),
        (Request(1e-5, None, "int16", ""), "--max-error", "can be reached"),
        (Request(None, 12, "float", ""), "--max-flash", "the smallest one takes 32 bytes"),
        (Request(COARSE, 100, "float", ""), "--max-error, --max-flash", "in 100 bytes"),
        (Request(1e-12, 100, "float", ""), "--max-error", "in 100 bytes"),
    ],
)  # fmt: skip
def test_what_cannot_be_met_is_told_with_what_can(
    paper: Config, maps: dict[str, ReferenceMap], request_: Request, place: str, told: str
) -> None:
    with pytest.raises(BuildError) as caught:
        choose(maps["4ws-2"], paper, request_, 1, np.float32)
    assert caught.value.where == place and told in caught.value.remedy
    assert "\n" not in str(caught.value)


def test_the_cap_in_exact_arithmetic_is_the_lookups(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    total = extend(maps["4ws-2"], paper)
    found = Lookup.from_map(total, np.float64).reference(total.speed[:, np.newaxis], total.front_angle)
    wanted = capped(total.yaw_rate, total.rear_angle, total.lateral_acceleration_cap, total.speed, total.steering)
    for have, want in zip(found, wanted, strict=True):
        np.testing.assert_allclose(have, want, rtol=0.0, atol=1e-12)


def test_the_domain_reaches_to_the_stop(paper: Config, maps: dict[str, ReferenceMap]) -> None:
    ground: Ground = ground_of(maps["4ws-2"], paper)
    assert ground.front_angle_top == paper.steering.front_angle_stop
    total = placed(maps["4ws-2"], paper, COARSE).total
    assert (total.speed[0], total.front_angle[0]) == (0.0, 0.0)
    assert (total.speed[-1], total.front_angle[-1]) == (maps["4ws-2"].speed[-1], ground.front_angle_top)
