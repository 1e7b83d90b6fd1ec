"""Sets of parameters: the default one against the configuration, and others that the C accepts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.emit.controller_view import controller_parameters
from codegen.emit.inputs_view import inputs_parameters
from codegen.emit.limiter_view import limiter_parameters
from codegen.emit.parameters import RATE_OFF, Parameter
from codegen.sil.software import Software

CHANGED = 0.7
"""Probability that another value of a parameter is tried in a set that is drawn; some are refused."""
TRIES = 3
"""Until a value is accepted."""
DECADES = 0.7
"""How far it goes, up or down: by a factor of five."""
NOTHING = 0.01
"""Of the largest value: what a parameter that is zero is drawn from."""
RATES = (0.01, 2.0)
"""rad/s, of rates that are drawn: those that act on a rear axle, be the configured one off or not."""
COUNT_MAX = 12
"""Of samples, where a count is drawn: short against a drive, so that all of it is seen."""

Number = float | list[float]


def _fields(config: Config, parameters: Any) -> Iterator[tuple[Any, Parameter, str]]:
    """The struct that holds a parameter, the parameter, and its name with its struct's."""
    for parameter in controller_parameters(config):
        yield parameters, parameter, parameter.name
    for parameter in inputs_parameters(config):
        yield parameters.inputs, parameter, f"inputs.{parameter.name}"
    for parameter in limiter_parameters(config):
        yield parameters.limiter, parameter, f"limiter.{parameter.name}"


def differences(software: Software) -> Iterator[str]:
    """Where the default parameters of the C are not those of the configuration, a line each."""
    parameters = software.parameters()
    if not software.function("parameters_valid")(parameters):
        yield "the C refuses its own default parameters"
    for holder, parameter, name in _fields(software.config, parameters):
        have, want = _value(holder, parameter.name), _rounded(parameter, software)
        if have != want:
            yield f"{name} is {_text(have)}, not the configuration's {_text(want)}"


def drawn(software: Software, generator: np.random.Generator) -> Any:
    """A parameter struct with many fields changed, one after the other, as far as `<prefix>_parameters_valid` accepts it."""
    parameters = software.parameters()
    is_valid = software.function("parameters_valid")
    if generator.random() < CHANGED:
        _narrow(parameters, generator)
        parameters = parameters if is_valid(parameters) else software.parameters()
    for holder, parameter, _ in _fields(software.config, parameters):
        if generator.random() < CHANGED:
            before = _value(holder, parameter.name)
            for _ in range(TRIES):
                setattr(holder, parameter.name, _other(parameter, before, generator))
                if is_valid(parameters):
                    break
                setattr(holder, parameter.name, before)
    return parameters


def changed(software: Software, parameters: Any) -> set[str]:
    """Names of those that are not the default's, with their struct's."""
    fields = zip(_fields(software.config, parameters), _fields(software.config, software.parameters()), strict=True)
    return {
        name
        for (holder, parameter, name), (default, _, _) in fields
        if _value(holder, parameter.name) != _value(default, parameter.name)
    }


def names(software: Software) -> set[str]:
    """Of all parameters, with their struct's."""
    return {name for _, _, name in _fields(software.config, software.parameters())}


def _narrow(parameters: Any, generator: np.random.Generator) -> None:
    """Less rear angle: of the controller, no more of the limiter, and nowhere more against the front wheels."""
    limiter = parameters.limiter
    parameters.rear_angle_max *= 10.0 ** generator.uniform(-DECADES, 0.0)
    limiter.rear_angle_max = parameters.rear_angle_max * generator.uniform(0.5, 1.0)
    shares = np.maximum(generator.uniform(-0.5, 1.0, len(limiter.opposite_phase_max)), 0.0)  # a third of them nothing
    limiter.opposite_phase_max = [limiter.rear_angle_max * share for share in shares]


def _other(parameter: Parameter, value: Number, generator: np.random.Generator) -> Number:
    if isinstance(parameter.value, int):
        return int(generator.integers(0, COUNT_MAX + 1))
    low, high = parameter.low, parameter.high
    if parameter.high == RATE_OFF:
        return float(np.exp(generator.uniform(*np.log(RATES))))
    if isinstance(value, list):
        # All together where they have to go on rising.
        factors = 10.0 ** generator.uniform(-DECADES, DECADES, 1 if parameter.increasing else len(value))
        return [min(max(float(number), low), high) for number in np.where(value, value, NOTHING * high) * factors]
    return float(min(max((value or NOTHING * high) * 10.0 ** generator.uniform(-DECADES, DECADES), low), high))


def _value(holder: Any, name: str) -> Number:
    value = getattr(holder, name)
    return value if isinstance(value, float | int) else list(value)


def _rounded(parameter: Parameter, software: Software) -> Number:
    if isinstance(parameter.value, int):
        return parameter.value
    if isinstance(parameter.value, tuple):
        return [float(software.real(value)) for value in parameter.value]
    return float(software.real(parameter.value))


def _text(value: Number) -> str:
    return "{" + ", ".join(f"{number:.9g}" for number in value) + "}" if isinstance(value, list) else f"{value:.9g}"
