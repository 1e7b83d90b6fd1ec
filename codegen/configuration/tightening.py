"""`[tightening]` of `ars.toml`: parts of the limits that a map leaves to cars that differ from the configured one."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from codegen.configuration.section import Meaning, Range, Section

CARS_SHARE_MIN, CARS_SHARE_MAX = 0.5, 0.999
"""Range of the share of the cars for which a map can be solved; more needs tens of thousands of cars."""

FRACTION_MIN = 0.02
Fraction = Annotated[float, Range(FRACTION_MIN, 1.0)]


class Tightening(Section):
    """Fractions of the limits that the map uses. `codegen solve --uncertain` writes this table into the map.

    The rest of each limit is left to cars that differ from the configured one. `[limits]` itself stays as it is: controller and
    checks use it.
    """

    sideslip_max: Annotated[Fraction, Meaning("fraction of the bound on |β|")] = 1.0
    front_slip_max: Annotated[Fraction, Meaning("fraction of the bound on the front slip angle")] = 1.0
    rear_slip_max: Annotated[Fraction, Meaning("fraction of the bound on the rear slip angle")] = 1.0
    rear_angle_max: Annotated[Fraction, Meaning("fraction of the bound on |δr|")] = 1.0
    envelope_lateral_acceleration_max: Annotated[
        Fraction, Meaning("for a case with `envelope`: fraction of its bound on the lateral acceleration")
    ] = 1.0
    envelope_rear_slip_max: Annotated[
        Fraction, Meaning("for a case with `envelope`: fraction of its bound on the slip with straight rear wheels")
    ] = 1.0
    share: Annotated[Annotated[float, Range(CARS_SHARE_MIN, CARS_SHARE_MAX)] | None, Meaning("requested share of the cars")] = (
        Field(default=None)
    )
    cars: Annotated[int, Range(0, 1_000_000), Meaning("number of cars that were drawn from `[identified]`")] = 0
    lost: Annotated[int, Range(0, 1_000_000), Meaning("number of them that exceed a limit")] = 0
    seed: Annotated[int, Range(0, 2**31), Meaning("seed of the draws")] = 0
