"""Spread of the optimal map over drawn cars, and its place in the report."""

from typing import Any

import numpy as np
import pytest

from codegen.identify.map_spread import CARS, map_spread
from codegen.report.html.identify import _spread
from tests.optimum.cars import PAPER, changed, paper_map
from tests.optimum.populations import uncertain

NONE: dict[str, Any] = {"keys": [], "standard_deviations": [], "correlations": []}


def test_the_band_contains_the_identified_car_and_grows_with_its_uncertainty() -> None:
    config = uncertain(PAPER)
    found = map_spread(config)
    assert found is not None and (found.case, found.failed) == ("4ws-2", 0)
    known = np.isfinite(found.low)
    assert (found.low[known] <= found.high[known]).all() and known.any(axis=1).all()
    # The nominal optimum is the map's own, here where no limit spreads: at small angles.
    row = np.argmin(np.abs(paper_map().speed - found.speed[1]))
    at = np.interp(found.front_angle[:8], paper_map().front_angle, paper_map().yaw_rate[row])
    assert found.nominal[1, :8] == pytest.approx(at, rel=1e-2)  # the speeds differ by up to 0.5 km/h
    assert (found.low[:, :8] <= found.nominal[:, :8]).all() and (found.nominal[:, :8] <= found.high[:, :8]).all()
    deviations = [0.5 * value for value in config.identified.standard_deviations]
    smaller = map_spread(changed(config, identified={"standard_deviations": deviations}))
    assert smaller is not None
    assert np.nanmean(smaller.high - smaller.low) == pytest.approx(0.5 * np.nanmean(found.high - found.low), rel=0.2)


def test_a_quantity_without_effect_on_steady_turns_spreads_nothing() -> None:
    table = {"keys": ["vehicle.yaw_inertia_kg_m2"], "standard_deviations": [200.0], "correlations": [[1.0]]}
    found = map_spread(changed(PAPER, identified=table))
    assert found is not None and np.nanmax(found.high - found.low) < 1e-12  # rounding of the quantiles


def test_cars_without_a_map_and_missing_uncertainty_are_reported() -> None:
    assert map_spread(changed(PAPER, identified=NONE)) is None
    config = uncertain(PAPER)
    wide = changed(
        config, identified={"standard_deviations": [20.0 * value for value in config.identified.standard_deviations]}
    )
    found = map_spread(wide)
    assert found is not None and 0 < found.failed < CARS
    first, chart, table, _ = _spread(wide)
    assert first.text.startswith(f"{found.failed} of {CARS} drawn cars have no map")  # type: ignore[union-attr]
    assert len(table.rows) == found.speed.size and "case 4ws-2" in chart.caption  # type: ignore[union-attr]
