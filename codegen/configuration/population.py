"""Cars that the measured drives leave possible: draws of the identified keys from their joint normal distribution."""

from __future__ import annotations

from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config, parse
from codegen.errors import ConfigError

TRIES_MAX = 50
"""Draws for each car until one has values that an `ars.toml` may have."""


def draw(config: Config, count: int, seed: int) -> list[Config]:
    """Return cars drawn from the values, standard deviations and correlations of `[identified]`; the other keys stay.

    A whole-numbered key is rounded. A car with a value that an `ars.toml` may not have is drawn again.

    Raises:
        ConfigError: there is no identified key, the correlations contradict each other, or hardly any draw is a possible car.
    """
    identified = config.identified
    if not identified.keys:
        raise ConfigError(
            "there are no identified keys", where="identified.keys", remedy="take the file that `codegen identify` wrote"
        )
    mean = np.array([_value(config, key) for key in identified.keys])
    values, vectors = np.linalg.eigh(np.array(identified.correlations))
    if values[0] < -1e-4:  # correlations are written with seven digits
        raise ConfigError(
            "no distribution has these correlations",
            where="identified.correlations",
            remedy="take the table as `codegen identify` wrote it",
        )
    root = np.array(identified.standard_deviations)[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    generator = np.random.default_rng(seed)
    cars: list[Config] = []
    fault = None
    for _ in range(TRIES_MAX * count):
        if len(cars) == count:
            break
        try:
            cars.append(_with(config, identified.keys, mean + root @ generator.standard_normal(len(mean))))
        except ConfigError as error:
            fault = error
    if len(cars) < count:
        assert fault is not None
        raise ConfigError(
            f"hardly any car within these standard deviations is possible: {fault.where} {fault.what}",
            where="identified.standard_deviations",
            remedy="measure with more excitation",
        )
    return cars


def _value(config: Config, key: str) -> float:
    value: Any = config
    for part in key.split("."):
        value = getattr(value, part)
    return float(value)


def _with(config: Config, keys: list[str], values: FloatArray) -> Config:
    data = config.model_dump(mode="json", exclude_none=True)
    for key, value in zip(keys, values.tolist(), strict=True):
        *tables, name = key.split(".")
        target = data
        for table in tables:
            target = target[table]
        target[name] = round(value) if isinstance(target[name], int) else value
    return parse(data, "drawn car")
