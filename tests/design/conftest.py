"""Cars to design for: the default family, whose design takes seconds and is made once, and a small one for everything else."""

from __future__ import annotations

from typing import Any

import pytest

from codegen.config import Config, parse
from codegen.design.tune import Design, design

SMALL_FAMILY = {
    "actuator_lag_s": [0.05],
    "mass_percent": [0.0],
    "stiffness_percent": [-20.0, 15.0],
    "relaxation_length_m": [0.0, 0.6],
    "speed_km_h": [15.0, 42.5, 80.0, 120.0],
}


def small_config(other: dict[str, Any] | None = None, /, **tuning: Any) -> Config:
    """The default car with a family of 9 (the configured car is not among the combinations), changed as told."""
    return parse({"tuning": {**SMALL_FAMILY, **tuning}, **(other or {})}, "small family")


@pytest.fixture(scope="session")
def default_design() -> Design:
    """The design for the default configuration."""
    return design(Config())


@pytest.fixture(scope="session")
def small_design() -> Design:
    """The design for the small family."""
    return design(small_config())
