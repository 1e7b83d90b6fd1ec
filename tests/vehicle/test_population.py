"""Cars drawn from measured uncertainty."""

from typing import Any

import numpy as np
import pytest

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.map_file.map import choose_config
from codegen.vehicle.population import INTERVAL_DEVIATIONS, draw, with_values
from codegen.vehicle.tyre import AxleTyres

COUNT = 1_000
STIFFNESS, INERTIA, DELAY = (
    "tyre.front.cornering_stiffness_n_per_rad",
    "vehicle.yaw_inertia_kg_m2",
    "plant.command_delay_samples",
)


def identified(
    keys: list[str], standard_deviations: list[float], correlations: list[list[float]], floor: float = 0.0
) -> Config:
    data = configuration.preset().model_dump(mode="json", exclude_none=True)
    table = {"keys": keys, "standard_deviations": standard_deviations, "correlations": correlations}
    table["interval_floor_percent"] = floor
    return configuration.parse(data | {"identified": table}, "test")


def test_cars_have_the_deviations_and_the_correlation_and_differ_in_nothing_else() -> None:
    config = identified([STIFFNESS, INERTIA, DELAY], [2_000.0, 90.0, 0.4], [[1.0, 0.8, 0.0], [0.8, 1.0, 0.0], [0.0, 0.0, 1.0]])
    cars = draw(config, COUNT, 1)
    drawn = np.array([[car.tyre.front.cornering_stiffness_n_per_rad, car.vehicle.yaw_inertia_kg_m2] for car in cars])
    given = np.array([config.tyre.front.cornering_stiffness_n_per_rad, config.vehicle.yaw_inertia_kg_m2])
    # Four standard errors: s / sqrt(n) of a mean, 1 / sqrt(2 n) of a deviation, (1 - r^2) / sqrt(n) of a correlation.
    assert drawn.mean(axis=0) == pytest.approx(given, abs=4.0 * 2_000.0 / COUNT**0.5)
    assert drawn[:, 1].mean() == pytest.approx(given[1], abs=4.0 * 90.0 / COUNT**0.5)
    assert drawn.std(axis=0) == pytest.approx([2_000.0, 90.0], rel=4.0 / (2.0 * COUNT) ** 0.5)
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.8, abs=4.0 * 0.36 / COUNT**0.5)
    assert {type(car.plant.command_delay_samples) for car in cars} == {int}
    assert len({car.plant.command_delay_samples for car in cars}) > 1
    for table in set(Config.model_fields) - {"tyre", "vehicle", "plant"}:
        assert getattr(cars[0], table) == getattr(config, table)
    assert cars[0].tyre.rear == config.tyre.rear
    assert draw(config, 3, 1)[2] == cars[2]
    assert draw(config, 3, 2)[2] != cars[2]


PEAK, SHAPE = "tyre.rear.peak_factor_p1", "tyre.rear.shape_factor_c"
WEAK = 0.08


def slip_bounds(cars: list[Config]) -> FloatArray:
    return np.array([AxleTyres.from_config(car).rear_slip_bound for car in cars])


def test_the_slip_bound_is_drawn_instead_of_d_where_it_is_known_better() -> None:
    """In the covariance, C moves D so that the slip bound stays."""
    keys, shape = [PEAK, SHAPE], configuration.preset().tyre.rear.shape_factor_c
    near = [np.log(AxleTyres.from_config(with_values(configuration.preset(), [SHAPE], np.array([c]))).rear_slip_bound)
            for c in (shape - 1e-3, shape + 1e-3)]  # fmt: skip
    peak = configuration.preset().tyre.rear.peak_factor_p1
    gain = -peak * (near[1] - near[0]) / 2e-3  # change of D for a change of C at which the slip bound stays
    own = 0.005 * peak
    deviation = float(np.hypot(gain * WEAK, own))
    cars = draw(identified(keys, [deviation, WEAK], [[1.0, gain * WEAK / deviation], [gain * WEAK / deviation, 1.0]]), COUNT, 1)
    spread = np.log(slip_bounds(cars) / slip_bounds([configuration.preset()]))
    # Four standard errors. Drawn in D, the slip bound would be lower by more than that on average, as it bends over C.
    assert spread.std() == pytest.approx(0.005, rel=4.0 / (2.0 * COUNT) ** 0.5)
    assert abs(spread.mean()) < 4.0 * 0.005 / COUNT**0.5
    assert np.std([car.tyre.rear.shape_factor_c for car in cars]) == pytest.approx(WEAK, rel=4.0 / (2.0 * COUNT) ** 0.5)


def test_d_is_drawn_where_it_is_known_better() -> None:
    peak = configuration.preset().tyre.rear.peak_factor_p1
    cars = draw(identified([PEAK, SHAPE], [0.001, WEAK], [[1.0, 0.0], [0.0, 1.0]]), COUNT, 1)
    drawn = np.array([car.tyre.rear.peak_factor_p1 for car in cars])
    assert drawn.std() == pytest.approx(0.001, rel=4.0 / (2.0 * COUNT) ** 0.5)
    assert drawn.mean() == pytest.approx(peak, abs=4.0 * 0.001 / COUNT**0.5)
    assert slip_bounds(cars).std() > 0.01 * slip_bounds(cars).mean()


@pytest.mark.parametrize(("floor", "percent"), [(0.0, 1.0), (5.0, 5.0), (20.0, 20.0)])
def test_cars_never_differ_less_than_the_floor(floor: float, percent: float) -> None:
    """The interval of the stiffness has a half-width of 1 %."""
    car = configuration.preset()
    config = identified([STIFFNESS], [0.01 / INTERVAL_DEVIATIONS * car.value(STIFFNESS)], [[1.0]], floor)
    drawn = np.array([each.value(STIFFNESS) / config.value(STIFFNESS) for each in draw(config, COUNT, 1)])
    # Four standard errors of a deviation.
    assert 100.0 * INTERVAL_DEVIATIONS * drawn.std() == pytest.approx(percent, rel=4.0 / (2.0 * COUNT) ** 0.5)


def test_a_file_has_a_floor_of_five_percent() -> None:
    assert configuration.preset().identified.interval_floor_percent == 5.0


@pytest.mark.parametrize(("floor", "is_noted"), [(0.0, True), (4.9, True), (5.0, False), (8.0, False)])
def test_a_lower_floor_has_a_note(floor: float, is_noted: bool) -> None:
    config = identified([DELAY], [1e-3], [[1.0]])
    config = config.replace({"identified": {"interval_floor_percent": floor}})
    notes = [note for note in choose_config(None, config).notes if note.startswith("identified.interval_floor_percent")]
    assert len(notes) == is_noted
    assert not configuration.preset().replace({"identified": {"interval_floor_percent": floor}}).identified.floor_note


def test_a_car_that_no_file_may_have_is_drawn_again() -> None:
    config = identified([DELAY], [1.0], [[1.0]])
    low = min(car.plant.command_delay_samples for car in draw(config, 100, 1))
    assert low == 0  # a fifth of the draws is below


def test_a_value_with_no_possible_neighbour_stays() -> None:
    """The preset's tyres have no relaxation length, and a short one is refused."""
    config = identified([INERTIA, "plant.relaxation_length_m"], [90.0, 0.009], [[1.0, 0.5], [0.5, 1.0]])
    cars = draw(config, 20, 1)
    assert {car.plant.relaxation_length_m for car in cars} == {0.0}
    assert len({car.vehicle.yaw_inertia_kg_m2 for car in cars}) == 20


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            ([], [], []),
            "identified.keys: there are no identified keys; take the file that `codegen identify` wrote from drives that",
        ),
        (
            ([STIFFNESS, INERTIA, DELAY], [1.0] * 3, [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]),
            "no distribution has these",
        ),
        (([STIFFNESS], [1e9], [[1.0]]), "hardly any car within these standard deviations is possible"),
    ],
)
def test_refused(table: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("(", r"\(")):
        draw(identified(*table), 20, 1)
