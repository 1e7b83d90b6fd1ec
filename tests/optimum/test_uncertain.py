"""A map whose limits a share of the cars keeps: the tightened problem, the sample, and cars that were not in it."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from benchmarks.judged_cars import five_cars
from codegen import configuration
from codegen.configuration import Tightening
from codegen.errors import CodegenError
from codegen.map_file import map as npz
from codegen.map_file.bounds import Binding
from codegen.map_file.map import choose_config
from codegen.optimum.nonlinear import slip_use
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.solve import solve_case
from codegen.optimum.uncertain import CONFIDENCE_LEVEL, SEED, car_count, keeps, lost_allowed, solve_uncertain, uses_of
from codegen.vehicle.population import draw
from codegen.vehicle.tyre import AxleTyres
from tests.optimum.cars import PAPER, SteadyModel, changed
from tests.optimum.populations import uncertain

GRID = {"speed_points": 6, "front_angle_points": 8}
CONFIG = uncertain(changed(PAPER, grid=GRID))
FRACTIONS = {"sideslip_max": 0.9, "front_slip_max": 0.85, "rear_slip_max": 0.8, "rear_angle_max": 0.7}
SHARE = 0.9
NONE = {"keys": [], "standard_deviations": [], "correlations": []}
STEEP = {"front_angle_min_deg": 6.0}
WIDE = {"standard_deviations": [20.0 * value for value in CONFIG.identified.standard_deviations]}


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_the_map_uses_its_fraction_of_each_limit(tyre_model: str) -> None:
    config = changed(CONFIG, tightening=FRACTIONS).with_tyre_model(tyre_model)
    found, whole = solve_case(config, "4ws-2"), solve_case(config.with_whole_limits, "4ws-2")
    limit = config.limits
    largest = {"sideslip_max": np.nanmax(np.abs(found.sideslip)), "rear_angle_max": np.nanmax(np.abs(found.rear_angle))}
    bounds = {"sideslip_max": limit.sideslip_max, "rear_angle_max": limit.rear_angle_max}
    for key, value in largest.items():
        assert value <= FRACTIONS[key] * bounds[key] * (1.0 + 1e-9)  # rounding
    # The tightest bounds are met, and the whole ones without the table.
    assert largest["rear_angle_max"] == pytest.approx(0.7 * limit.rear_angle_max, rel=1e-9)
    assert np.nanmax(np.abs(whole.rear_angle)) == pytest.approx(limit.rear_angle_max, rel=1e-9)
    if tyre_model == "linear":
        # The slip of the linear car is proportional to its lateral acceleration, and the rear axle has the lower bound.
        most = [np.nanmax(one.speed[:, np.newaxis] * one.yaw_rate) for one in (found, whole)]
        assert most[0] == pytest.approx(0.8 * most[1], rel=1e-9)
    else:
        used = slip_use(found)
        assert used is not None  # in percent of the whole bound
        assert np.nanmax(used.front) <= 85.0 * (1.0 + 1e-6) and np.nanmax(used.rear) == pytest.approx(80.0, rel=1e-6)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99, 0.999])
def test_lost_cars_show_the_share_by_the_exact_binomial_interval(share: float) -> None:
    count = car_count(share)
    allowed = lost_allowed(share, count)
    two_sided = 2.0 * CONFIDENCE_LEVEL - 1.0
    highest = [binomtest(lost, count).proportion_ci(two_sided, "exact").high for lost in (allowed, allowed + 1)]
    assert highest[0] <= 1.0 - share < highest[1]
    assert share != 0.99 or (count, allowed) == (2_000, 12)
    assert (
        lost_allowed(share, math.floor(math.log(1.0 - CONFIDENCE_LEVEL) / math.log(share))) == -1
    )  # too few even without a loss


def test_other_cars_keep_the_limits_in_the_wanted_share() -> None:
    config = changed(CONFIG, limits={"lateral_acceleration_max_g": 0.55})  # active in some cells, and the same for all cars
    done: list[tuple[int, int]] = []
    found = solve_uncertain(config, "4ws-2", SHARE, lambda *at: done.append(at))
    made = found.tightening
    assert found.nominal.active is not None and (found.nominal.active & Binding.LATERAL_ACCELERATION).any()
    allowed = lost_allowed(SHARE, made.cars)
    assert (made.share, made.cars, made.seed) == (SHARE, car_count(SHARE), SEED)
    assert made.lost <= allowed
    assert found.lost_by_nominal > 0.5
    assert (~keeps(uses_of(found.map, draw(config, made.cars, SEED)))).sum() == made.lost
    looser = {key: 1.0 - 0.85 * (1.0 - getattr(made, key)) for key in FRACTIONS}
    less_tight = solve_case(changed(config, tightening=looser), "4ws-2")
    assert (~keeps(uses_of(less_tight, draw(config, made.cars, SEED)))).sum() > allowed  # no tighter than needed
    assert done[-1][0] <= done[-1][1] and done == sorted(done)
    others = draw(config, 400, SEED + 7)
    used, by_nominal = uses_of(found.map, others), uses_of(found.nominal, others)
    # A share of 0.9 is missed by chance with p < 0.001 below 342 of 400.
    assert keeps(used).sum() >= 342
    assert keeps(by_nominal).sum() < 200
    assert np.array_equal(found.nominal.yaw_rate, solve_case(config, "4ws-2").yaw_rate, equal_nan=True)
    both = found.map.feasible & found.nominal.feasible
    assert (found.map.yaw_rate[both] <= found.nominal.yaw_rate[both] * (1.0 + 1e-9)).all()
    assert npz.from_bytes(npz.to_bytes(found.map), "test").config == found.map.config


def test_a_map_that_uses_grip_is_tightened_by_its_grip_slips() -> None:
    """Cap and floor follow the tighter bounds: the yaw rate still never falls, and the nominal map loses most cars."""
    config = uncertain(changed(five_cars()["van, loaded"], grid=GRID))
    share = 0.8
    found = solve_uncertain(config, "4ws-2", share)
    grip = AxleTyres.from_config(config).grip_slips
    assert grip is not None and found.map.config is not None
    problem = SteadyTurnProblem.from_config(found.map.config, found.map.config.case("4ws-2"))
    made = found.tightening
    limits = [made.front_slip_max * grip[0], made.rear_slip_max * grip[1]]
    assert [problem.front_slip_max, problem.rear_slip_max] == pytest.approx(limits, rel=1e-12)
    assert 0.6 < made.front_slip_max < 0.99 and made.lost <= lost_allowed(share, made.cars) < (1.0 - share) * made.cars
    assert found.lost_by_nominal > 0.5
    assert 0.9 < np.nanmin(found.map.yaw_rate / found.nominal.yaw_rate) < 1.0
    for each in (found.map, found.nominal):
        assert np.nanmin(np.diff(each.yaw_rate, axis=1) / each.yaw_rate[:, 1:]) >= -1e-14


def test_uses_are_those_of_the_independent_model() -> None:
    found = solve_case(CONFIG, "4ws-2")
    for car, used in zip(cars := draw(CONFIG, 3, 2), uses_of(found, cars), strict=True):
        model = SteadyModel.of(car, car.case("4ws-2"))
        largest = dict.fromkeys(model.turns(20.0, 0.0, np.zeros(1)).used, 0.0)
        for i, j in zip(*np.nonzero(found.feasible), strict=True):
            speed, angle, yaw_rate = found.speed[i], found.front_angle[j], found.yaw_rate[i, j]
            straight, turned = model.turns(speed, angle, np.array([0.0, 0.01])).yaw_rate
            rear = 0.01 * (yaw_rate - straight) / (turned - straight)  # the model is linear
            for flag, value in model.turns(speed, angle, np.array([rear])).used.items():
                largest[flag] = max(largest[flag], float(value[0]))
        assert used[: len(largest)] == pytest.approx([largest[flag] for flag in sorted(largest)], rel=1e-6)


def test_a_file_gets_the_tightening_of_the_map(tmp_path: Path) -> None:
    path = tmp_path / "ars.toml"
    path.write_text(configuration.preset_text(), encoding="utf-8")
    config = changed(CONFIG, tightening=FRACTIONS)
    tight, whole = solve_case(config, "4ws-2"), solve_case(CONFIG, "4ws-2")
    assert choose_config(tight, path).config.tightening == config.tightening
    assert choose_config(whole, path).config.tightening == Tightening()
    path.write_text(f"{configuration.preset_text()}\n[tightening]\nsideslip_max = 0.5\n", encoding="utf-8")
    assert choose_config(tight, path).config.tightening.sideslip_max == 0.5  # `codegen tune` rejects the difference


@pytest.mark.parametrize(
    ("case", "share", "changes", "message"),
    [
        ("4ws-2", 99.0, {}, "`share=`: 99 is not such a share of the cars; give a share from 0.5 to 0.999"),
        ("4ws-2", math.nan, {}, "`share=`: nan is not"),
        ("fws", 0.9, {}, r"`share=`: \[cases.fws\]: without rear steering"),
        ("4ws-2", 0.9, {"identified": NONE}, "identified.keys: there are no"),
        ("4ws-2", 0.9, {"identified": {"doubts": ["a doubt"]}}, "in doubt: a doubt; .* identified.doubts_accepted = true"),
        (
            "4ws-2",
            0.9,
            {"identified": WIDE, "grid": STEEP},
            "no map is so tight that 188 of 200 cars keep the limits; measure",
        ),
    ],
)
def test_refused(case: str, share: float, changes: dict[str, dict[str, object]], message: str) -> None:
    with pytest.raises(CodegenError, match=message):
        solve_uncertain(changed(CONFIG, **changes), case, share)


def test_a_bound_without_a_key_is_not_tightened() -> None:
    config = changed(CONFIG, tightening=dict.fromkeys(FRACTIONS, 0.5))
    tight, whole = (SteadyTurnProblem.from_config(one, one.case("4ws-2")) for one in (config, CONFIG))
    assert tight.lateral_acceleration_max == whole.lateral_acceleration_max
    assert tight.front_slip_max == 0.5 * whole.front_slip_max
