"""Limits of the suites, their reasons, and how to read them from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from codegen.configuration import parse_toml
from codegen.configuration.faults import first_fault
from codegen.configuration.section import Range, Section
from codegen.errors import CodegenError
from codegen.files import read_text

LIMITS_BYTES_MAX = 2**16

Percent = Annotated[float, Range(0.0, 1_000.0, "%")]
Seconds = Annotated[float, Range(0.0, 60.0, "s")]
Degrees = Annotated[float, Range(0.0, 90.0, "deg")]


class Limits(Section):
    """Limits of `codegen sil --suite`, keys of the file of `--limits`. Each description gives the reason."""

    c1_overshoot_percent: Percent = Field(default=2.0, description="the paper's step C1: a driver hardly notices 2 %")
    c1_settling_s: Seconds = Field(default=0.5, description="of an ideal actuator; twice the actuator's lag is added")
    c1_rise_s: Seconds = Field(default=0.28, description="of an ideal actuator; twice the actuator's lag is added")
    overshoot_percent: Percent = Field(default=3.0, description="over all cells of the configured car and of its mass range")
    settling_s: Seconds = Field(default=1.0, description="over all cells; twice the actuator's lag is added")
    sideslip_excess_deg: Degrees = Field(
        default=0.2, description="beyond the map's bound, which a lighter car exceeds at the map's yaw rate"
    )
    map_error_percent: Percent = Field(default=1.0, description="of the steady yaw rate; a goal: linear maps demand too much")
    slip_percent: Percent = Field(default=101.0, description="of the slip bound in steady state; 1 % for the table")
    other_lag_overshoot_percent: Percent = Field(default=5.0, description="with an actuator of 0.4 and 2 times the lag")
    feedforward_factor: Annotated[float, Range(0.0, 10.0)] = Field(
        default=0.75, description="of the feedforward's overshoot in the same cell, where that is more than the limit"
    )
    gain_margin_db: Annotated[float, Range(0.0, 40.0, "dB")] = Field(
        default=8.0, description="worst car of the family: [tuning] demands it"
    )
    phase_margin_deg: Degrees = Field(default=45.0, description="worst car of the family: [tuning] demands it")
    sensitivity: Annotated[float, Range(1.0, 20.0)] = Field(
        default=1.8, description="peak, worst car of the family: [tuning] demands it"
    )
    third_party_overshoot_percent: Percent = Field(default=3.0, description="on a third party's multi-body car, as on our own")
    wet_sideslip_deg: Degrees = Field(default=3.5, description="on friction 0.6; the map's bound is 3 deg")
    snow_sideslip_deg: Degrees = Field(default=5.5, description="on friction 0.4 with an estimate")
    snow_spins_without_estimate: Annotated[int, Field(ge=0, le=100)] = Field(
        default=1, description="on friction 0.4 without an estimate"
    )
    instructions: Annotated[int, Field(ge=1, le=100_000)] = Field(default=1_320, description="worst step with the limiter")
    timing_factor: Annotated[float, Range(1.0, 10.0)] = Field(
        default=1.05, description="of the error with frames in step, and one code"
    )
    car_overshoot_percent: Percent = Field(default=5.0, description="every random car")
    car_settling_s: Seconds = Field(default=1.1, description="every random car")

    def why(self, key: str) -> str:
        """Return the description of a limit."""
        return type(self).model_fields[key].description or ""


def load(path: Path) -> Limits:
    """Read limits from a TOML file; keys that it leaves out keep their defaults. Raises CodegenError."""
    text = read_text(path, LIMITS_BYTES_MAX, "name a TOML file of limits, such as overshoot_percent = 5.0")
    try:
        return Limits.model_validate(parse_toml(text, path, CodegenError))
    except ValidationError as error:
        raise first_fault(error, path, Limits, CodegenError) from None
