"""The tables of `ars.toml`: their keys with units, ranges and defaults.

Degrees and km/h exist only here and are turned into SI by the properties beside them. A value that no car can have is refused
with the range and the unit, because a wrong unit is the usual cause. Layer 1.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema, core_schema

NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,62}\Z", re.ASCII)
KM_H = 1.0 / 3.6
"""m/s for one km/h."""

MAX_BREAKPOINTS = 2000
MAX_CELLS = 1_000_000
"""Far beyond any ECU's memory, and well inside the 64 MiB that a map file may unpack to."""


def check_name(name: str) -> str:
    """Return `name` if it may stand in file names and C comments, else raise ValueError.

    Such a name starts with an ASCII letter or digit and goes on with those, dot, hyphen or underscore; 63 characters at most.
    """
    if len(name) > 63:
        raise ValueError(
            f"the name {name[:20]!r}... has {len(name)} characters; use 1 to 63 ASCII letters, digits, '.', '_' or '-'"
        )
    if not NAME_PATTERN.match(name):
        raise ValueError(
            f"the name {name!r} has characters that cannot stand in C; use 1 to 63 ASCII letters, digits, '.', '_' or '-'"
        )
    return name


def check_number(value: object) -> object:
    """Return a number as it is; ValueError for anything else."""
    # A TOML boolean or text is not a number, although Python would turn both into one.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"a number is needed, not {value!r}")
    return value


@dataclass(frozen=True)
class Range:
    """Annotation of a number between `low` and `high` (inclusive), named with its unit in the error message."""

    low: float
    high: float
    unit: str = ""

    def check(self, value: float) -> float:
        """Return `value`, or raise ValueError where it is outside (NaN is)."""
        if not self.low <= value <= self.high:
            in_unit = f" {self.unit}" if self.unit else ""
            raise ValueError(f"{value:g} is outside {self.low:g} to {self.high:g}{in_unit}; check the value and its unit")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        number = core_schema.no_info_before_validator_function(check_number, handler(source))
        return core_schema.no_info_after_validator_function(self.check, number)


class RangeOrZero(Range):
    """The same, where zero stands for "none"."""

    def check(self, value: float) -> float:
        """Return `value`, or raise ValueError where it is outside."""
        return value if value == 0.0 else super().check(value)


@dataclass(frozen=True)
class Breakpoints:
    """Annotation of a list of breakpoints, strictly increasing and each within `low` to `high`; None for an even axis."""

    low: float
    high: float
    unit: str

    def check(self, values: list[float] | None) -> list[float] | None:
        """Return `values`, or raise ValueError with the first breakpoint at fault."""
        if values is None:
            return None
        if not 2 <= len(values) <= MAX_BREAKPOINTS:
            raise ValueError(f"{len(values)} breakpoints; 2 to {MAX_BREAKPOINTS} are needed")
        inside = Range(self.low, self.high, self.unit)
        for value in values:
            inside.check(value)
        for index, (left, right) in enumerate(pairwise(values), start=1):
            if right <= left:
                raise ValueError(f"breakpoint {index} ({right:g}) is not above the one before it ({left:g}); sort the list")
        return values

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))


class Section(BaseModel):
    """A table of `ars.toml`: immutable, and unknown keys are errors."""

    # defer_build: of the tables by themselves, most are never asked for; building them all takes longer than to solve a map.
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)


class Vehicle(Section):
    """Mass and geometry. Defaults: the paper's table of vehicle parameters."""

    mass_kg: Annotated[float, Range(200.0, 60_000.0, "kg")] = 2335.07
    yaw_inertia_kg_m2: Annotated[float, Range(50.0, 500_000.0, "kg m^2")] = 5376.432
    cg_height_m: Annotated[float, Range(0.05, 3.0, "m")] = 0.42
    track_m: Annotated[float, Range(0.5, 3.5, "m")] = 1.627
    cg_to_front_axle_m: Annotated[float, Range(0.2, 10.0, "m")] = 1.574
    cg_to_rear_axle_m: Annotated[float, Range(0.2, 10.0, "m")] = 1.566
    front_roll_share: Annotated[float, Range(0.0, 1.0)] = 0.6

    @property
    def wheelbase(self) -> float:
        """L in m."""
        return float(self.cg_to_front_axle_m + self.cg_to_rear_axle_m)


class Road(Section):
    """What the map assumes of the road."""

    friction: Annotated[float, Range(0.05, 1.5)] = 0.9
    gravity_m_s2: Annotated[float, Range(1.0, 30.0, "m/s^2")] = 9.81


class Tyre(Section):
    """One tyre of an axle by the Magic Formula (H. B. Pacejka, Tire and Vehicle Dynamics, section 4.3).

    The slope at zero slip is given either as `cornering_stiffness_n_per_rad` (of one tyre at its static load and the
    nominal friction) or by the factor B itself.
    """

    cornering_stiffness_n_per_rad: Annotated[float, Range(3_000.0, 2_000_000.0, "N/rad for one tyre")] | None = None
    stiffness_factor_b_per_rad: Annotated[float, Range(0.5, 100.0, "1/rad")] | None = None
    shape_factor_c: Annotated[float, Range(0.5, 2.5)] = 1.3
    curvature_factor_e: Annotated[float, Range(-20.0, 1.0)] = -0.5
    peak_factor_p1: Annotated[float, Range(0.2, 3.0)] = 1.0
    peak_load_sensitivity_p2: Annotated[float, Range(-1.0, 1.0)] = 0.0
    horizontal_shift_deg: Annotated[float, Range(-3.0, 3.0, "deg")] = 0.0
    vertical_shift_n: Annotated[float, Range(-5_000.0, 5_000.0, "N")] = 0.0

    @model_validator(mode="after")
    def _one_stiffness(self) -> Self:
        if (self.cornering_stiffness_n_per_rad is None) == (self.stiffness_factor_b_per_rad is None):
            raise ValueError("give exactly one of cornering_stiffness_n_per_rad and stiffness_factor_b_per_rad")
        return self


class Tyres(Section):
    """The tyres of both axles. Defaults: the paper's stiffnesses."""

    front: Tyre = Tyre(cornering_stiffness_n_per_rad=119_540.0)
    rear: Tyre = Tyre(cornering_stiffness_n_per_rad=119_830.0)


class Limits(Section):
    """Constraints of the optimisation (paper, equation of the optimisation problem)."""

    sideslip_max_deg: Annotated[float, Range(0.2, 20.0, "deg")] = 3.0
    lateral_acceleration_max_g: Annotated[float, Range(0.05, 2.0, "g")] = 0.8
    rear_angle_max_deg: Annotated[float, Range(0.1, 20.0, "deg")] = 3.5
    slip_departure_percent: Annotated[float, Range(0.5, 50.0, "%")] = 10.0

    @property
    def sideslip_max(self) -> float:
        """rad."""
        return math.radians(self.sideslip_max_deg)

    @property
    def rear_angle_max(self) -> float:
        """rad; the map's own bound, which may be tighter than the actuator's."""
        return math.radians(self.rear_angle_max_deg)


class Case(Section):
    """One run of the optimisation: may the rear wheels steer, and how dear is sideslip (lambda of the objective)?

    `passive_safe` leaves out what the car could not do without its rear steering. `tyre_model` is that of the steady turn: the
    linear single-track car, as in the paper, or the plant's four loaded wheels with the whole Magic Formula.
    """

    rear_steering: bool = True
    sideslip_weight_per_s2: Annotated[float, Range(0.0, 1e7, "1/s^2")] = 3000.0
    passive_safe: bool = False
    # Left out where it is linear: maps and builds from before it do not change with it.
    tyre_model: Literal["linear", "magic-formula"] = Field(default="linear", exclude_if=lambda model: model == "linear")


class Grid(Section):
    """Breakpoints of the map: evenly spaced by default, or listed."""

    speed_min_km_h: Annotated[float, Range(1.0, 400.0, "km/h")] = 20.0
    speed_max_km_h: Annotated[float, Range(1.0, 400.0, "km/h")] = 120.0
    speed_points: int = Field(default=101, ge=2, le=MAX_BREAKPOINTS)
    speed_breakpoints_km_h: Annotated[list[float] | None, Breakpoints(1.0, 400.0, "km/h")] = None
    front_angle_min_deg: Annotated[float, Range(0.01, 45.0, "deg")] = 0.1
    front_angle_max_deg: Annotated[float, Range(0.5, 45.0, "deg")] = 10.0
    front_angle_points: int = Field(default=100, ge=2, le=MAX_BREAKPOINTS)
    front_angle_breakpoints_deg: Annotated[list[float] | None, Breakpoints(0.01, 45.0, "deg")] = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.speed_min_km_h >= self.speed_max_km_h:
            raise ValueError("speed_min_km_h must be below speed_max_km_h")
        if self.front_angle_min_deg >= self.front_angle_max_deg:
            raise ValueError("front_angle_min_deg must be below front_angle_max_deg")
        speeds, angles = self.speed_breakpoints_km_h, self.front_angle_breakpoints_deg
        cells = (len(speeds) if speeds else self.speed_points) * (len(angles) if angles else self.front_angle_points)
        if cells > MAX_CELLS:
            raise ValueError(f"{cells} cells are too many for one map; take fewer breakpoints, at most {MAX_CELLS} cells")
        return self


class Steering(Section):
    """Front steering: from the driver's hands to the road wheels."""

    ratio: Annotated[float, Range(1.0, 40.0)] = 90.0 / 6.75
    wheel_rate_max_deg_s: Annotated[float, Range(10.0, 3_000.0, "deg/s")] = 300.0
    lag_s: Annotated[float, Range(0.002, 1.0, "s")] = 0.005
    front_angle_stop_deg: Annotated[float, Range(1.0, 60.0, "deg")] = 35.0

    @property
    def front_angle_stop(self) -> float:
        """rad at the road wheel: the mechanical stop."""
        return math.radians(self.front_angle_stop_deg)


class RearActuator(Section):
    """The rear-steering actuator: what it can do, how the plant models it (first-order lag, rate limit), and what it does
    on its own where no command comes: hold its last one, or return to zero.

    The task reports it as stuck where the measured angle is off by more than `stuck_error_deg` from what the lag makes of the
    commands, for `stuck_time_s`. "from-actuator" takes a tenth of the largest angle, and the time from one stop to the other at
    the largest rate and ten lags.
    """

    angle_max_deg: Annotated[float, Range(0.1, 20.0, "deg")] = 3.5
    rate_max_deg_s: Annotated[float, Range(1.0, 500.0, "deg/s")] = 30.0
    lag_s: Annotated[float, Range(0.002, 1.0, "s")] = 0.05
    on_command_loss: Literal["hold", "return"] = "hold"
    command_loss_samples_max: int = Field(default=3, ge=0, le=1_000)
    return_rate_deg_s: Annotated[float, Range(0.1, 500.0, "deg/s")] = 5.0
    stuck_error_deg: Annotated[float, Range(0.05, 20.0, "deg")] | Literal["from-actuator"] = "from-actuator"
    stuck_time_s: Annotated[float, Range(0.01, 10.0, "s")] | Literal["from-actuator"] = "from-actuator"

    @property
    def angle_max(self) -> float:
        """rad."""
        return math.radians(self.angle_max_deg)


class Plant(Section):
    """The simulated car."""

    sampling_time_s: Annotated[float, Range(1e-5, 0.01, "s")] = 0.001
    load_transfer: Literal["moment-balance", "paper"] = "moment-balance"
    relaxation_length_m: Annotated[float, RangeOrZero(0.05, 2.0, "m")] = 0.0
    command_delay_samples: int = Field(default=0, ge=0, le=100)
