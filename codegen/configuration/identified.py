"""`[identified]` of `ars.toml`: how well `codegen identify` knows the keys that it wrote."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from codegen.configuration.section import Meaning, Range, Section

IDENTIFIED_MAX = 100
"""Largest number of identified keys."""
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
    rear_grip_reached: Annotated[float, Range(0.05, 1.0), Meaning("the same of the rear axle")] = Field(
        default=1.0, exclude_if=lambda share: share == 1.0
    )

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
