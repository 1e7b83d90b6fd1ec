"""Where the third party's model comes from: an optional dependency, imported when it is first needed."""

from __future__ import annotations

import importlib
from typing import Any

from codegen.errors import CodegenError

PUBLISHED = {1: "Ford Escort", 2: "BMW 320i", 3: "VW Vanagon"}
"""The cars of the package that have the data of the multi-body model."""

DEFAULT_CAR = 2


def module(name: str) -> Any:
    """The module `vehiclemodels.<name>`.

    Raises:
        CodegenError: the package is not installed, or is one that has no such module.
    """
    try:
        return importlib.import_module(f"vehiclemodels.{name}")
    except ImportError as error:
        raise CodegenError(
            f"the multi-body car cannot be imported ({error})",
            where="commonroad-vehicle-models",
            remedy='pip install "ars-codegen[crosscheck]"',
        ) from None


def published(number: int = DEFAULT_CAR) -> Any:
    """A fresh parameter set of one of the PUBLISHED cars, SI units, by the package's own names.

    Raises:
        CodegenError: no such car, or see `module`.
    """
    if number not in PUBLISHED:
        known = ", ".join(f"{key} ({name})" for key, name in PUBLISHED.items())
        raise CodegenError(f"there is no multi-body car {number}", where="commonroad-vehicle-models", remedy=f"known: {known}")
    return module("vehicle_parameters").setup_vehicle_parameters(vehicle_id=number)
