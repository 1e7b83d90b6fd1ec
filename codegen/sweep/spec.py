"""`sweep.toml`: controllers, scenarios and varied factors of a campaign.

    design = "monte-carlo"              # or "factorial"
    samples = 1000                      # monte-carlo: cars and roads; a factorial design has as many as its values combine to
    seed = 1
    scenarios = ["step-steer", "sine-with-dwell"]

    [controllers]                       # name = folder made by codegen build, from where this file is; "passive" = "" has none
    pi = "generated/4ws2-paper"

    [factors]
    mass_percent = { uniform = [-20, 20] }  # of a factorial design: and points = 5
    friction = [0.4, 0.6, 0.9]
    yaw_rate_noise_deg_s = { normal = [0.1, 0.02], within = [0, 0.2] }
    delay_samples = 1

Each sample is simulated with every controller in every scenario, so that controllers are compared on the same cars.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, model_validator

from codegen.configuration import parse_toml
from codegen.configuration.section import Range, Section, check_name, check_number, first_fault, shown
from codegen.errors import ConfigError, suggestion
from codegen.files import read_text

SPEC_BYTES_MAX = 2**20
MAX_SAMPLES = 100_000_000
MAX_POINTS = 10_000
MAX_CONTROLLERS = 20
PASSIVE = "passive"
"""Name of the passive car, which needs no build: its rear wheels stay straight."""


@dataclass(frozen=True)
class Factor:
    """A quantity that may vary; its key names the unit.

    Attributes:
        low, high: range of cars, roads or drivers.
        default: value if a spec does not name it; None: that of the car, the scenario or the road.
        what: description for tables.
        whole: whether only whole numbers make sense.
        keys: keys of `ars.toml` that it changes. If they vary as in `[identified]`, a campaign cannot have the factor too.
    """

    low: float
    high: float
    default: float | None
    what: str
    whole: bool = False
    keys: tuple[str, ...] = ()


def _of_tyres(name: str, *axles: str) -> tuple[str, ...]:
    return tuple(f"tyre.{axle}.{name}" for axle in axles)


FACTORS: Mapping[str, Factor] = {
    "mass_percent": Factor(-60.0, 150.0, 0.0, "mass, the yaw inertia with it", keys=("vehicle.mass_kg",)),
    "yaw_inertia_percent": Factor(
        -60.0, 150.0, 0.0, "yaw inertia, on top of what the mass brings", keys=("vehicle.yaw_inertia_kg_m2",)
    ),
    "cg_shift_m": Factor(
        -2.0, 2.0, 0.0, "centre of gravity, forward", keys=("vehicle.cg_to_front_axle_m", "vehicle.cg_to_rear_axle_m")
    ),
    "front_stiffness_percent": Factor(
        -80.0, 300.0, 0.0, "cornering stiffness of the front tyres", keys=_of_tyres("cornering_stiffness_n_per_rad", "front")
    ),
    "rear_stiffness_percent": Factor(
        -80.0, 300.0, 0.0, "cornering stiffness of the rear tyres", keys=_of_tyres("cornering_stiffness_n_per_rad", "rear")
    ),
    "tyre_peak_percent": Factor(
        -60.0,
        100.0,
        0.0,
        "peak force of all tyres, at the same stiffness",
        keys=_of_tyres("peak_factor_p1", "front", "rear"),
    ),
    "friction": Factor(0.05, 1.5, None, "peak friction of the road"),
    "friction_estimate_error": Factor(-1.0, 1.0, None, "friction estimate minus friction; without it, as in the scenario"),
    "speed_km_h": Factor(5.0, 400.0, None, "speed"),
    "steering_wheel_angle_deg": Factor(0.5, 1_500.0, None, "amplitude at the steering wheel"),
    "steering_percent": Factor(1.0, 500.0, 100.0, "of the scenario's own amplitude at that speed"),
    "rear_lag_s": Factor(0.002, 1.0, None, "lag of the rear actuator", keys=("rear_actuator.lag_s",)),
    "delay_samples": Factor(
        0.0, 20.0, None, "samples from computing a command to its acting", whole=True, keys=("plant.command_delay_samples",)
    ),
    "speed_noise_m_s": Factor(0.0, 10.0, 0.0, "standard deviation of the measured speed"),
    "front_angle_noise_deg": Factor(0.0, 5.0, 0.0, "standard deviation of the measured front angle"),
    "yaw_rate_noise_deg_s": Factor(0.0, 20.0, 0.0, "standard deviation of the measured yaw rate"),
}
NOISE = ("speed_noise_m_s", "front_angle_noise_deg", "yaw_rate_noise_deg_s")
"""Noise factors, in the order of the first rows of `codegen.sil.batch.NOISES`."""


def _check_whole(low: int, high: int) -> BeforeValidator:
    """Return a validator of whole numbers from `low` to `high`."""

    def check(value: object) -> object:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError(
                f"{shown(value)} is no whole number from {low} to {high}; give one, without a point or an exponent"
            )
        return value

    return BeforeValidator(check)


_Number = Annotated[float, BeforeValidator(check_number)]
_Pair = Annotated[list[_Number], Field(min_length=2, max_length=2)]


class Values(Section):
    """Distribution of one factor: uniform between two ends, truncated normal, or given values.

    In a factorial design `uniform` needs `points`, and there is no `normal`.
    """

    uniform: _Pair | None = None
    normal: _Pair | None = None
    within: _Pair | None = None
    values: Annotated[list[_Number], Field(min_length=1, max_length=MAX_POINTS)] | None = None
    points: Annotated[int, _check_whole(2, MAX_POINTS)] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if sum(kind is not None for kind in (self.uniform, self.normal, self.values)) != 1:
            raise ValueError("give exactly one of uniform, normal and values")
        given = [*(self.uniform or ()), *(self.normal or ()), *(self.within or ()), *(self.values or ())]
        if not all(math.isfinite(number) for number in given):
            raise ValueError("nan and inf are no values; give finite numbers")
        if self.uniform is not None and self.uniform[0] >= self.uniform[1]:
            raise ValueError("uniform needs the lower end first; swap them, or give values")
        if (self.normal is None) != (self.within is None):
            raise ValueError("normal = [mean, deviation] goes with within = [low, high]; give both or neither")
        if self.normal is not None and self.within is not None:
            _check_normal(self.normal, self.within)
        if self.points is not None and self.uniform is None:
            raise ValueError("points goes with uniform; remove it")
        return self

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest possible value."""
        ends = self.values or self.uniform or self.within
        assert ends is not None  # exactly one is given
        return min(ends), max(ends)

    @property
    def levels(self) -> list[float] | None:
        """Return the values of a factorial design; None if there are none."""
        if self.values is not None:
            return self.values
        if self.uniform is not None and self.points is not None:
            low, high = self.uniform
            return [low + (high - low) * k / (self.points - 1) for k in range(self.points)]
        return None


def _check_normal(normal: list[float], within: list[float]) -> None:
    mean, deviation = normal
    if deviation <= 0.0:
        raise ValueError("normal needs a deviation above zero; for one value give that alone")
    if within[0] >= within[1]:
        raise ValueError("within needs the lower end first; swap them")
    # A window this far from the mean indicates a wrong unit.
    if not (within[0] < mean + 4.0 * deviation and within[1] > mean - 4.0 * deviation):
        raise ValueError("within lies more than 4 deviations from the mean; check the unit")


def _as_values(value: object) -> object:
    if isinstance(value, list):
        return {"values": value}
    if isinstance(value, dict):
        return value
    return {"values": [check_number(value)]}


def _checked_factors(factors: dict[str, Values]) -> dict[str, Values]:
    for key, values in factors.items():
        if key not in FACTORS:
            raise ValueError(f"there is no factor {key!r}; {suggestion(key, FACTORS)[2:] or 'known: ' + ', '.join(FACTORS)}")
        factor, (low, high) = FACTORS[key], values.extremes
        if not (factor.low <= low and high <= factor.high):
            what = f"reaches from {low:g} to {high:g}" if low < high else f"is {low:g}"
            raise ValueError(f"{key} {what}, outside {factor.low:g} to {factor.high:g}; check the unit")
        if factor.whole and (values.values is None or any(value != round(value) for value in values.values)):
            raise ValueError(f"{key} takes whole numbers; list them as values")
    if "steering_wheel_angle_deg" in factors and "steering_percent" in factors:
        raise ValueError("steering_wheel_angle_deg and steering_percent both set the amplitude; remove one of them")
    return factors


class Spec(Section):
    """Content of `sweep.toml`."""

    schema_version: Literal[1] = 1
    design: Literal["monte-carlo", "factorial"] = "monte-carlo"
    samples: Annotated[int, _check_whole(1, MAX_SAMPLES)] | None = None
    seed: Annotated[int, _check_whole(0, 2**63 - 1)] = 0
    scenarios: Annotated[list[str], Field(max_length=20)] = Field(default_factory=lambda: ["step-steer"])
    lead_s: Annotated[float, Range(0.1, 60.0, "s")] = 1.0
    length_s: Annotated[float, Range(1.0, 600.0, "s")] | None = None
    controllers: Annotated[
        dict[Annotated[str, AfterValidator(check_name)], str], Field(min_length=1, max_length=MAX_CONTROLLERS)
    ]
    factors: Annotated[dict[str, Annotated[Values, BeforeValidator(_as_values)]], AfterValidator(_checked_factors)] = Field(
        default_factory=dict
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.scenarios:
            raise ValueError("scenarios names none; list one at least, such as step-steer")
        if len(set(self.scenarios)) != len(self.scenarios):
            raise ValueError("scenarios names one twice; remove it")
        if self.controllers.get(PASSIVE):
            raise ValueError(f'controllers.{PASSIVE} is the car with its rear wheels straight; write {PASSIVE} = ""')
        if not any(self.controllers.values()):
            raise ValueError("controllers names no build; add one, for the car is that of the first")
        if any(not folder for name, folder in self.controllers.items() if name != PASSIVE):
            raise ValueError("controllers has a name without a folder; name one made by codegen build")
        if self.design == "monte-carlo":
            if self.samples is None:
                raise ValueError("samples is missing; a monte-carlo design needs it")
            for key, values in self.factors.items():
                if values.points is not None:
                    raise ValueError(f"factors.{key}.points is for a factorial design; remove it")
        else:
            if self.samples is not None:
                raise ValueError("samples does not go with a factorial design, whose values make it; remove it")
            for key, values in self.factors.items():
                if values.levels is None:
                    raise ValueError(f"factors.{key} has no levels for a factorial design; give values, or uniform with points")
            if self.sample_count > MAX_SAMPLES:
                raise ValueError(f"the values combine to {self.sample_count} samples; at most {MAX_SAMPLES} are taken")
        return self

    @property
    def sample_count(self) -> int:
        """Number of samples (cars and roads)."""
        if self.samples is not None:
            return self.samples
        return math.prod(len(values.levels or []) for values in self.factors.values())

    @property
    def run_count(self) -> int:
        """Number of runs: samples times scenarios times controllers."""
        return self.sample_count * len(self.scenarios) * len(self.controllers)

    def digest(self) -> str:
        """SHA-256 of the parsed content, in hexadecimal digits; independent of comments and key order."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def read_tables(path: Path) -> dict[str, Any]:
    """Return the tables of a `sweep.toml`, for `parse`. Raises ConfigError."""
    return parse_toml(read_text(path, SPEC_BYTES_MAX, "name a sweep.toml", ConfigError), path, ConfigError)


def load(path: Path) -> Spec:
    """Read and check a `sweep.toml`. Raises ConfigError with the file and the key."""
    return parse(read_tables(path), path)


def parse(data: Mapping[str, Any], where: object) -> Spec:
    """Check a mapping as read from TOML; messages name `where` as the place. Raises ConfigError."""
    try:
        return Spec.model_validate(dict(data))
    except ValidationError as error:
        raise first_fault(error, where, Spec, ConfigError) from None
