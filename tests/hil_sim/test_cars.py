"""Random cars: the draw, and cells that are driven at once."""

from dataclasses import replace

import pytest

from codegen.sil.batch import compile_batch
from codegen.vehicle.single_track import SingleTrack
from hil_sim.suite.cars import SHARES, SPEEDS_KM_H, drive_cells, examine
from hil_sim.suite.cells import cells
from hil_sim.suite.conditions import NOMINAL
from hil_sim.suite.plants import changed
from hil_sim.suite.random_cars import DEVELOPMENT_SEED, MASS_KG, TEST_SEED, random_cars
from hil_sim.suite.runs import run_cell
from hil_sim.suite.subjects import of_config
from tests import builds


def test_a_car_is_its_seed_and_number_and_plausible() -> None:
    found = random_cars(DEVELOPMENT_SEED, 40)
    assert random_cars(DEVELOPMENT_SEED, 3) == found[:3] and random_cars(TEST_SEED, 1)[0] not in found
    assert len({config.vehicle.mass_kg for config in found}) == 40
    for config in found:
        assert MASS_KG[0] <= config.vehicle.mass_kg <= MASS_KG[1]
        assert SingleTrack.from_config(config).critical_speed * 3.6 > 1.2 * config.grid.speed_max_km_h
        # It slides before it tips over: half a track over the centre of gravity's height is more than the tyres' peak.
        assert 0.5 * config.vehicle.track_m / config.vehicle.cg_height_m > 1.1 * config.road.friction


def test_cells_driven_at_once_are_those_driven_alone() -> None:
    """To a millionth: what differs is the rounding of the batch, see `codegen.sil.batch.DIFFERENCE_MAX`."""
    subject = of_config("tracking", builds.paper_map(), builds.TRACKING_CONFIG)
    generated = subject.around.generated  # type: ignore[attr-defined]
    points = cells(subject.config, subject.config.case("4ws-2"), SPEEDS_KM_H[::3], SHARES[:2])
    together, slips = drive_cells(compile_batch(generated.files, generated.manifest), subject.config, points)
    for one in together:
        alone = run_cell(subject, NOMINAL, one.cell)
        names = ("overshoot_percent", "settling_time_s", "sideslip_max_deg", "map_error_percent")
        assert [getattr(one, name) for name in names] == pytest.approx([getattr(alone, name) for name in names], abs=1e-6)
    assert [slip.cell for slip in slips] == list(points) and all(20.0 < slip.value < 130.0 for slip in slips)


def test_a_car_that_cannot_be_tuned_is_told() -> None:
    config = random_cars(DEVELOPMENT_SEED, 1)[0]
    result = examine(7, changed(config, {"tuning": {"mass_percent": []}, "grid": {"speed_points": 5}}))
    assert not result.passed and "an empty list" in result.error and result.title.startswith("car 7: ")
    assert not replace(result, error="").requirements
