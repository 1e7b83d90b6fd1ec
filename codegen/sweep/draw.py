"""The cars and roads of a campaign, by number: any of them can be drawn again alone, with the rest of its chunk."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from codegen.sweep.spec import FACTORS, Spec, Values

FloatArray = npt.NDArray[np.float64]

_NOISE_STREAM = 1_000_000
"""Numbers of the random streams of noise begin here; those of factors are their places in FACTORS."""


def draw(spec: Spec, chunk: int, samples: range) -> dict[str, FloatArray]:
    """Factor to its values (len(samples),) for the samples of a chunk, in the units of their names.

    Every factor has a random stream of its own in each chunk: another factor in the spec leaves its values as they are.
    """
    if spec.design == "factorial":
        return _factorial(spec.factors, samples)
    return {
        key: _random(values, np.random.default_rng(_stream(spec, chunk, place)), len(samples))
        for place, key in enumerate(FACTORS)
        if (values := spec.factors.get(key)) is not None
    }


def noise(spec: Spec, chunk: int, scenario: int, samples: int, count: int) -> FloatArray:
    """Standard normal numbers (samples, 3, count) of a scenario: the same for all controllers, so that they meet the same."""
    stream = np.random.default_rng(_stream(spec, chunk, _NOISE_STREAM + scenario))
    return stream.standard_normal((samples, 3, count))


def _stream(spec: Spec, chunk: int, number: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(spec.seed, spawn_key=(chunk, number))


def _factorial(factors: Mapping[str, Values], samples: range) -> dict[str, FloatArray]:
    """All combinations; the last factor of the spec changes fastest."""
    number = np.arange(samples.start, samples.stop)
    found: dict[str, FloatArray] = {}
    for key, values in reversed(list(factors.items())):
        levels = np.array(values.levels, dtype=np.float64)
        found[key] = levels[number % levels.size]
        number = number // levels.size
    return found


def _random(values: Values, stream: np.random.Generator, count: int) -> FloatArray:
    if values.values is not None:
        return np.array(values.values, dtype=np.float64)[stream.integers(len(values.values), size=count)]
    if values.uniform is not None:
        low, high = values.uniform
        return stream.uniform(low, high, size=count)
    assert values.normal is not None  # checked by the spec, as the next
    assert values.within is not None
    (mean, deviation), (low, high) = values.normal, values.within
    # By the inverse of the distribution, cut to the window: exact, and as quick for a narrow one.
    shape = NormalDist(mean, deviation)
    first, last = shape.cdf(low), shape.cdf(high)
    share = np.clip(stream.uniform(first, last, size=count), np.nextafter(0.0, 1.0), np.nextafter(1.0, 0.0))
    return np.clip([shape.inv_cdf(float(value)) for value in share], low, high)
