"""Report of `codegen identify`: bands of the tyre curves."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from codegen import configuration
from codegen.report.html.identify import BAND_CARS, _curves
from tests.report.figures import unpacked

DEVIATION = 0.02


def curves(config: configuration.Config) -> Any:
    reached: Any = SimpleNamespace(slip=(0.05, 0.05))
    return [chart.figure["data"] for chart in _curves(cast(Any, SimpleNamespace(config=config)), config, reached)]


def test_the_band_of_a_tyre_is_that_of_its_stiffness_where_the_curve_is_straight() -> None:
    data = configuration.preset().model_dump(mode="json", exclude_none=True)
    key, stiffness = "cornering_stiffness_n_per_rad", data["tyre"]["front"]["cornering_stiffness_n_per_rad"]
    data["identified"] = {
        "keys": [f"tyre.front.{key}"],
        "standard_deviations": [DEVIATION * stiffness],
        "correlations": [[1.0]],
    }
    front, rear = curves(configuration.parse(data, "test"))
    band, identified = front[0], front[1]
    assert band["name"] == "95 % band"
    low, high = np.split(unpacked(band["y"]), 2)
    width = (high[::-1] - low)[1] / unpacked(identified["y"])[1]
    # The quantiles of n draws have a standard error of sqrt(p (1 - p) / n) over the density; four of both.
    error = 2**0.5 * (0.025 * 0.975 / BAND_CARS) ** 0.5 / 0.0584
    assert width == pytest.approx(2.0 * 1.96 * DEVIATION, abs=4.0 * error * DEVIATION)
    low, high = np.split(unpacked(rear[0]["y"]), 2)
    assert (low == high[::-1]).all()


def test_there_is_no_band_without_measured_uncertainty() -> None:
    front, rear = curves(configuration.preset())
    assert [one["name"] for one in front] == [one["name"] for one in rear] == ["identified", "configured"]
