"""Cars that the measured drives leave possible: draws of the identified keys from their joint normal distribution.

C, D and E of a tyre that did not reach its peak compensate for each other: the drives determine the force up to the slip that
was reached far better than D. Their covariance describes this to first order, but the force is far from linear in them.
Therefore the slip bound of an axle is drawn instead of D if it is known better, and D follows from it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.vehicle.tyre import MagicFormulaTyre, static_wheel_loads

TRIES_MAX = 1000
"""Draws for each car until one has values that an `ars.toml` may have: one car in 20,000 misses a window that 1 % of the draws
meet."""
BAND_SHARE = 0.95
"""Share of the drawn cars inside a band."""
BAND = (0.5 * (1.0 - BAND_SHARE), 0.5 * (1.0 + BAND_SHARE))
"""Quantiles at the ends of a band."""
INTERVAL_DEVIATIONS = 1.96
"""Half of the width of a 95 % interval in standard deviations."""
SLOPE_STEP = 1e-3
"""Step, in standard deviations, of the derivatives of a slip bound."""
SHRINKAGE_STEPS = 20
"""Steps in which a point of the ellipsoid is moved to the mean until an `ars.toml` may have its values."""


@dataclass(frozen=True, eq=False)
class Population:
    """Joint normal distribution of identified keys.

    Attributes:
        config: the identified car; keys that are not identified keep its values.
        keys: dotted names, k of them.
        mean: (k,) values of the car.
        root: (k, k), matrix whose product with its transpose is the covariance of what is drawn; its columns are principal axes
            of the correlations.
        bounded: place of D in `keys` -> axle of which the slip bound is drawn instead: its logarithm, times the mean of D.
    """

    config: Config
    keys: tuple[str, ...]
    mean: FloatArray
    root: FloatArray
    bounded: dict[int, str]

    @classmethod
    def of(cls, config: Config, keys: Sequence[str] | None = None) -> Population:
        """Return the distribution of the keys of `[identified]` that can vary, or of some of them.

        Raises:
            ConfigError: the correlations contradict each other.
        """
        identified = config.identified
        chosen = varying_keys(config) if keys is None else tuple(keys)
        places = [identified.keys.index(key) for key in chosen]
        correlations = np.array(identified.correlations).reshape(len(identified.keys), -1)[np.ix_(places, places)]
        values, vectors = np.linalg.eigh(correlations)
        if values.min(initial=0.0) < -1e-4:  # correlations are written with seven digits
            raise ConfigError(
                "no distribution has these correlations",
                where="identified.correlations",
                remedy="take the table as `codegen identify` wrote it",
            )
        mean = np.array([config.value(key) for key in chosen])
        floor = identified.interval_floor_percent / 100.0 / INTERVAL_DEVIATIONS
        deviations = np.maximum(np.array(identified.standard_deviations)[places], floor * np.abs(mean))
        root = deviations[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        bounded = {}
        for place, axle in _drawable_bounds(config, chosen):
            slopes = np.zeros(len(chosen))
            for k in np.flatnonzero([key.startswith(f"tyre.{axle}.") for key in chosen]):
                step = np.zeros(len(chosen))
                step[k] = SLOPE_STEP * deviations[k]
                low, high = (math.log(_slip_bound(config, axle, chosen, mean + each)) for each in (-step, step))
                slopes[k] = (high - low) / (2.0 * step[k]) if step[k] else 0.0
            of_bound = mean[place] * slopes @ root
            if np.linalg.norm(of_bound) < np.linalg.norm(root[place]):
                root[place] = of_bound
                bounded[place] = axle
        return cls(config, chosen, mean, root, bounded)

    def car(self, generator: np.random.Generator) -> Config:
        """Return one draw. Raises ConfigError if an `ars.toml` may not have its values."""
        return self._moved(self.root @ generator.standard_normal(len(self.mean)))

    def _moved(self, move: FloatArray) -> Config:
        """Return the car that differs from the mean by `move` (k,). Raises ConfigError if an `ars.toml` may not have it."""
        values = self.mean + move
        for place, axle in self.bounded.items():
            values[place] = self.mean[place]
            wanted = _slip_bound(self.config, axle, self.keys, self.mean) * math.exp(move[place] / self.mean[place])
            # At a given cornering stiffness, the slip bound is proportional to D.
            values[place] *= wanted / _slip_bound(self.config, axle, self.keys, values)
        return with_values(self.config, self.keys, values)

    def possible_car(self, generator: np.random.Generator) -> Config:
        """Return the first draw that an `ars.toml` may have. Raises ConfigError if there is hardly any."""
        for _ in range(TRIES_MAX):
            try:
                return self.car(generator)
            except ConfigError as error:
                fault = error
        assert fault is not None
        raise ConfigError(
            f"hardly any car within these standard deviations is possible: {fault.where} {fault.what}",
            where="identified.standard_deviations",
            remedy="measure with more excitation",
        )

    def values(self, car: Config) -> FloatArray:
        """Return the values (k,) of a car."""
        return np.array([car.value(key) for key in self.keys])

    def axes(self, share: float) -> list[Config]:
        """Return the cars at both ends of each principal axis of the ellipsoid that contains a share of all cars."""
        identity = np.eye(len(self.keys))
        return [self._on_ellipsoid(share, direction) for axis in identity for direction in (-axis, axis)]

    def corners(self, share: float) -> list[Config]:
        """Return the cars on the same ellipsoid half way between the axes: none for a single key."""
        count = len(self.keys)
        if count < 2:
            return []
        signs = itertools.product((-1.0, 1.0), repeat=count)
        return [self._on_ellipsoid(share, np.array(each) / np.sqrt(count)) for each in signs]

    def _on_ellipsoid(self, share: float, direction: FloatArray) -> Config:
        """Return the car in a direction (k,) of length one, moved to the mean until an `ars.toml` may have its values."""
        from scipy.special import gammaincinv

        radius = float(np.sqrt(2.0 * gammaincinv(0.5 * len(self.keys), share)))  # chi-square distribution with k degrees
        for step in range(SHRINKAGE_STEPS):
            moved = radius * (1.0 - step / SHRINKAGE_STEPS) * self.root @ direction
            try:
                return self._moved(moved)
            except ConfigError:
                continue
        return self.config


def draw(config: Config, count: int, seed: int) -> list[Config]:
    """Return cars drawn from the values, standard deviations and correlations of `[identified]`; the other keys stay.

    A whole-numbered key is rounded. A car with a value that an `ars.toml` may not have is drawn again.

    Raises:
        ConfigError: there is no identified key, the correlations contradict each other, or hardly any draw is a possible car.
    """
    require_identified(config)
    population = Population.of(config)
    generator = np.random.default_rng(seed)
    return [population.possible_car(generator) for _ in range(count)]


def _drawable_bounds(config: Config, keys: Sequence[str]) -> list[tuple[int, str]]:
    """Return the place of D among keys, and the axle, for each tyre of which D and another factor of its shape vary."""
    found = []
    for axle in ("front", "rear"):
        table = f"tyre.{axle}."
        others = (f"{table}shape_factor_c", f"{table}curvature_factor_e")
        vary = f"{table}peak_factor_p1" in keys and any(key in keys for key in others)
        if vary and getattr(config.tyre, axle).cornering_stiffness_n_per_rad is not None:
            found.append((list(keys).index(f"{table}peak_factor_p1"), axle))
    return found


def _slip_bound(config: Config, axle: str, keys: Sequence[str], values: FloatArray) -> float:
    """Return the slip bound in rad of an axle with values (k,) of dotted keys. Raises ConfigError if it has none."""
    table = f"tyre.{axle}."
    changed = {
        key.removeprefix(table): value for key, value in zip(keys, values.tolist(), strict=True) if key.startswith(table)
    }
    load = static_wheel_loads(config)[axle == "rear"]
    tyre = MagicFormulaTyre.from_config(getattr(config.tyre, axle).model_copy(update=changed), load, config.road.friction)
    return tyre.slip_bound(config.limits.slip_departure_percent / 100.0, f"tyre.{axle}")


def require_identified(config: Config) -> None:
    """Raise ConfigError if no key is identified."""
    if not config.identified.keys:
        raise ConfigError(
            "there are no identified keys",
            where="identified.keys",
            remedy="take the file that `codegen identify` wrote from drives that determine some of them",
        )


def require_accepted(config: Config) -> None:
    """Raise ConfigError if the deviations of `[identified]` are doubtful, and its key does not accept that."""
    if not config.identified.is_doubtful:
        return
    doubts = config.identified.doubts
    raise ConfigError(
        f"the identification is in doubt: {'; '.join(doubts)}",
        where="identified.doubts",
        remedy="drive what is missing and identify again, or set identified.doubts_accepted = true to use its deviations",
    )


STEPS = (1.0, -1.0, 1e-3, -1e-3)
"""Trial changes of a key, in standard deviations. A key can vary if at least one of them gives a valid `ars.toml`."""


def varying_keys(config: Config) -> tuple[str, ...]:
    """Return the identified keys that can differ from car to car.

    A relaxation length of zero, which means none, cannot: only lengths far above its uncertainty are allowed beside it.
    """
    return tuple(key for key in config.identified.keys if changed_car(config, key) is not None)


def changed_car(config: Config, key: str) -> Config | None:
    """Return the car with another value of an identified key, within its uncertainty; None if no other value is possible."""
    deviation = config.identified.standard_deviations[config.identified.keys.index(key)]
    for step in STEPS:
        try:
            return with_values(config, [key], np.array([config.value(key) + step * deviation]))
        except ConfigError:
            continue
    return None


def with_values(config: Config, keys: Sequence[str], values: FloatArray) -> Config:
    """Return the car with values (k,) of dotted keys; those of whole-numbered keys are rounded.

    Raises:
        ConfigError: an `ars.toml` may not have them.
    """
    whole = {key for key in keys if isinstance(config.value(key), int)}
    values_by_key = dict(zip(keys, values.tolist(), strict=True))
    return config.replace({key: round(value) if key in whole else value for key, value in values_by_key.items()})
