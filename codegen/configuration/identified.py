"""`[identified]` of `ars.toml`: how well `codegen identify` knows the keys that it wrote."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from codegen.configuration.section import Meaning, Range, Section

IDENTIFIED_MAX = 100
"""Largest number of identified keys, and of doubts."""
INTERVAL_FLOOR_PERCENT = 5.0
"""Default of the least half-width of a 95 % interval. Cars of one series differ by as much, and so do tyres with their age."""
SYMMETRY = 1e-9
"""Largest difference between both halves of the correlation matrix, and of its diagonal from one."""


class Identified(Section):
    """Uncertainty of the keys that were identified from measured drives. `codegen identify` writes this table.

    The lists have one entry for each of `keys`. Where `keys` is empty, nothing is known about the uncertainty of this file.
    """

    keys: Annotated[list[str], Meaning("dotted names of the identified keys, such as `vehicle.yaw_inertia_kg_m2`")] = Field(
        default_factory=list, max_length=IDENTIFIED_MAX
    )
    standard_deviations: Annotated[
        list[Annotated[float, Range(0.0, 1e9)]], Meaning("standard deviation of each, in the unit of its key")
    ] = Field(default_factory=list, max_length=IDENTIFIED_MAX)
    correlations: Annotated[
        list[list[Annotated[float, Range(-1.0, 1.0)]]], Meaning("correlation matrix of the identified values")
    ] = Field(default_factory=list, max_length=IDENTIFIED_MAX)

    front_grip_reached: Annotated[
        float,
        Range(0.05, 1.0),
        Meaning("largest lateral force of the front axle in the drives, over the peak of its tyres"),
    ] = Field(default=1.0, exclude_if=lambda share: share == 1.0)
    rear_grip_reached: Annotated[
        float, Range(0.05, 1.0), Meaning("largest lateral force of the rear axle in the drives, over the peak of its tyres")
    ] = Field(default=1.0, exclude_if=lambda share: share == 1.0)

    interval_floor_percent: Annotated[
        float,
        Range(0.0, 100.0, "%"),
        Meaning("least half-width of a key's 95 % interval, of its value, in families of cars that come from this table"),
    ] = Field(default=INTERVAL_FLOOR_PERCENT, exclude_if=lambda floor: floor == INTERVAL_FLOOR_PERCENT)
    doubts: Annotated[
        list[str], Meaning("reasons for which these values and deviations may be wrong, as `codegen identify` found them")
    ] = Field(default_factory=list, max_length=IDENTIFIED_MAX, exclude_if=lambda doubts: not doubts)
    doubts_accepted: Annotated[
        bool,
        Meaning(
            "use the deviations in spite of `doubts`; without it, `codegen tune`, `solve --uncertain` and `sweep --from` refuse"
        ),
    ] = Field(default=False, exclude_if=lambda accepted: not accepted)

    @property
    def floor_note(self) -> str:
        """A note if the cars of a family may differ less than those of one series; "" for nothing."""
        if not self.keys or self.interval_floor_percent >= INTERVAL_FLOOR_PERCENT:
            return ""
        return (
            f"identified.interval_floor_percent = {self.interval_floor_percent:g} lets a family of cars vary less than "
            f"±{INTERVAL_FLOOR_PERCENT:g} %, as cars of one series do; leave it out unless it is about one car"
        )

    @property
    def is_doubtful(self) -> bool:
        """Whether there are doubts that nobody accepted."""
        return bool(self.doubts) and not self.doubts_accepted

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        count = len(self.keys)
        if len(set(self.keys)) != count:
            raise ValueError("keys names a key twice; remove one")
        if len(self.standard_deviations) != count:
            raise ValueError(
                f"standard_deviations has {len(self.standard_deviations)} values for {count} keys; give one for each key"
            )
        if [len(row) for row in self.correlations] != [count] * count:
            raise ValueError(f"correlations is not a matrix of {count} rows and columns; give one of each for each key")
        for i, row in enumerate(self.correlations):
            for j, value in enumerate(row[: i + 1]):
                expected = 1.0 if i == j else self.correlations[j][i]
                if not math.isclose(value, expected, abs_tol=SYMMETRY):
                    raise ValueError(f"correlations is not symmetric with ones on its diagonal, see row {i + 1}; correct it")
        return self
