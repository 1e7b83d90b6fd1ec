"""Parameter sets that the C accepts, drawn at random."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import reduce
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.emit.controller_view import parameters_by_path
from codegen.emit.parameters import RATE_OFF, Parameter
from codegen.sil.software import Software

CHANGED = 0.7
"""Probability that a parameter of a drawn set is varied; the C rejects some values."""
TRIES = 3
"""Attempts to find an accepted value."""
DECADES = 0.7
"""Largest variation in decades, a factor of five."""
NOTHING = 0.01
"""Value drawn for a parameter that is zero, as a fraction of its maximum."""
RATES = (0.01, 2.0)
"""Range of drawn rates in rad/s, even if the configured rate is off."""
COUNT_MAX = 12
"""Maximum of drawn sample counts, short compared with a drive."""

Number = float | list[float]


def fields(config: Config, parameters: Any) -> Iterator[tuple[Any, Parameter, str]]:
    """Yield the struct of each parameter, the parameter, and its qualified name."""
    for path, parameter in parameters_by_path(config).items():
        yield reduce(getattr, path.split(".")[:-1], parameters), parameter, path


def drawn(software: Software, generator: np.random.Generator) -> Any:
    """Return a parameter struct with many fields varied one by one, as far as `<prefix>_parameters_valid` accepts them."""
    parameters = software.parameters()
    is_valid = software.function("parameters_valid")
    if generator.random() < CHANGED:
        _narrow(parameters, generator)
        parameters = parameters if is_valid(parameters) else software.parameters()
    for holder, parameter, _ in fields(software.config, parameters):
        if generator.random() < CHANGED:
            before = value_of(holder, parameter.name)
            for _ in range(TRIES):
                setattr(holder, parameter.name, _other(parameter, before, generator))
                if is_valid(parameters):
                    break
                setattr(holder, parameter.name, before)
    return parameters


def unchanged(software: Software, sets: Iterable[Any]) -> list[str]:
    """Return the qualified names of parameters that have their default in every set."""
    rows = zip(*(fields(software.config, each) for each in (software.parameters(), *sets)), strict=True)
    return [
        name
        for (default, parameter, name), *others in rows
        if all(value_of(holder, parameter.name) == value_of(default, parameter.name) for holder, _, _ in others)
    ]


def _narrow(parameters: Any, generator: np.random.Generator) -> None:
    """Reduce the rear angle ranges of controller and limiter, and the opposite-phase range at some speeds."""
    limiter = parameters.limiter
    parameters.rear_angle_max *= 10.0 ** generator.uniform(-DECADES, 0.0)
    limiter.rear_angle_max = parameters.rear_angle_max * generator.uniform(0.5, 1.0)
    shares = np.maximum(generator.uniform(-0.5, 1.0, len(limiter.opposite_phase_max)), 0.0)  # a third of them zero
    limiter.opposite_phase_max = [limiter.rear_angle_max * share for share in shares]


def _other(parameter: Parameter, value: Number, generator: np.random.Generator) -> Number:
    if isinstance(parameter.value, int):
        return int(generator.integers(0, COUNT_MAX + 1))
    low, high = parameter.low, parameter.high
    if parameter.high == RATE_OFF:
        return float(np.exp(generator.uniform(*np.log(RATES))))
    if isinstance(value, list):
        # One factor for all if they must increase.
        factors = 10.0 ** generator.uniform(-DECADES, DECADES, 1 if parameter.increasing else len(value))
        return [min(max(float(number), low), high) for number in np.where(value, value, NOTHING * high) * factors]
    return float(min(max((value or NOTHING * high) * 10.0 ** generator.uniform(-DECADES, DECADES), low), high))


def value_of(holder: Any, name: str) -> Number:
    """Return the value of a parameter in its struct."""
    value = getattr(holder, name)
    return value if isinstance(value, float | int) else list(value)
