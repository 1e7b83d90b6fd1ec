"""Cars for the design: the committed schedule of the default family, whose design takes seconds, and a small family."""

from pathlib import Path
from typing import Any

import pytest

from codegen.configuration import Config, Schedule
from codegen.map_file.map import load
from tests.whole_car import car

SMALL_FAMILY = {"actuator_lag_s": [0.05], "mass_percent": [0.0], "stiffness_percent": [-20.0, 15.0]}
SMALL_FAMILY |= {"relaxation_length_m": [0.0, 0.6], "speed_km_h": [15.0, 42.5, 80.0, 120.0]}


def small_config(other: dict[str, Any] | None = None, /, **tuning: Any) -> Config:
    """Return the default car with a family of 9, which excludes the configured car, and with changes."""
    return car({"tuning": {**SMALL_FAMILY, **tuning}, **(other or {})})


@pytest.fixture(scope="session")
def committed() -> Schedule:
    """Return the schedule of the default configuration; the evidence tier repeats its design."""
    config = load(Path(__file__).resolve().parents[2] / "generated/4ws2.npz").config
    assert config is not None and config.controller.tracking.schedule is not None
    return config.controller.tracking.schedule
