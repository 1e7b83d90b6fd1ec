"""The reference model's view: the table of a tyre's curve and its stated error, the slowest speed, what is printed."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from codegen.config import Config
from codegen.emit.reference_model_view import (
    ARGUMENT_MAX,
    Curve,
    reference_model_view,
    speed_min,
    tabulate,
)
from codegen.errors import BuildError
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre
from tests import builds
from tests.sil.checks_reference_model import magic_formula

CONFIG = builds.TRACKING_CONFIG
SHAPES = [(c, e) for c in (0.5, 1.3, 2.5) for e in (-20.0, -0.5, 0.5, 0.99, 1.0)]
"""Shape and curvature factors over the whole range of a configuration."""


def tyre(shape_factor: float = 1.3, curvature_factor: float = -0.5) -> MagicFormulaTyre:
    """The paper's front tyre with another curve."""
    front = AxleTyres.from_config(CONFIG).front
    return dataclasses.replace(front, shape_factor=shape_factor, curvature_factor=curvature_factor)


def interpolated(curve: Curve, x: Any) -> Any:
    """The table's curve at x, zero or above."""
    places = np.linspace(0.0, curve.last_share, curve.values.size)
    return np.interp(x / (x + curve.compression), places, curve.values)


def largest_error(curve: Curve, of: MagicFormulaTyre) -> float:
    """Found on points that lie elsewhere than those of the search: even ones, and geometric ones out to the end."""
    x = np.concatenate([np.linspace(0.0, 40.0, 60_007), np.geomspace(1e-5, ARGUMENT_MAX, 40_003)])
    return float(np.abs(interpolated(curve, x) - magic_formula(of, x)).max())


def changed(**tables: dict[str, Any]) -> Config:
    """The configuration with some keys of its tables changed."""
    data = CONFIG.model_dump()
    for name, values in tables.items():
        data[name].update(values)
    for message in ("vehicle_motion", "vehicle_conditions", "rear_steer_command"):
        data["can"][message]["cycle_time_ms"] = 1e3 * data["controller"]["sampling_time_s"]
    return Config.model_validate(data)


@pytest.mark.parametrize(("c", "e"), SHAPES)
def test_the_stated_error_holds_and_is_not_far_above(c: float, e: float) -> None:
    curve = tabulate(tyre(c, e))
    error = largest_error(curve, tyre(c, e))
    assert error <= curve.error <= 1.05 * error
    places = np.linspace(0.0, curve.last_share, curve.values.size)
    x = curve.compression * places / (1.0 - places)
    assert x[-1] == pytest.approx(ARGUMENT_MAX, rel=1e-12)
    assert np.abs(curve.values - magic_formula(tyre(c, e), x)).max() < 1e-12
    assert curve.values[0] == 0.0


def test_a_curve_that_no_table_keeps_is_refused() -> None:
    """A curve steeper than any tyre of a configuration is not built."""
    with pytest.raises(BuildError, match=r"tyre\.front: no table of 512 cells follows the tyre's curve within 0\.001"):
        tabulate(tyre(1.3, -1e6), "tyre.front")


@pytest.mark.parametrize("period", [0.002, 0.01, 0.02])
def test_the_slowest_speed_keeps_a_step_within_the_fastest_pole(period: float) -> None:
    """Poles of the linear car, found as eigenvalues: at that speed the fastest decays in about one step, where Heun's method,
    stable up to two, has room for both poles together."""
    config = changed(controller={"sampling_time_s": period, "enable_speed_km_h": 60.0})
    vehicle, tyres = config.vehicle, AxleTyres.from_config(config)
    front, rear = 2.0 * tyres.front.cornering_stiffness, 2.0 * tyres.rear.cornering_stiffness
    lf, lr, v = vehicle.cg_to_front_axle_m, vehicle.cg_to_rear_axle_m, speed_min(config)
    m, inertia, moment = vehicle.mass_kg, vehicle.yaw_inertia_kg_m2, lr * rear - lf * front
    matrix = [[-(front + rear) / (m * v), moment / (m * v * v) - 1.0]]
    matrix += [[moment / inertia, -(lf**2 * front + lr**2 * rear) / (inertia * v)]]
    assert 0.8 < np.abs(np.linalg.eigvals(matrix)).max() * period < 1.3


def test_a_sampling_time_that_is_too_long_is_refused_with_the_remedy() -> None:
    config = changed(controller={"sampling_time_s": 0.05})
    with pytest.raises(BuildError) as caught:
        reference_model_view(config, "single")
    error = caught.value
    assert error.where == "controller.sampling_time_s"
    assert "enable_speed" in str(error.remedy)
    assert f"{speed_min(config) * 3.6:.1f} km/h" in error.what
    enough = changed(controller={"sampling_time_s": 0.05, "enable_speed_km_h": speed_min(config) * 3.6 + 0.1})
    reference_model_view(enough, "single")
