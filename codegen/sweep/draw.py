"""Draw the samples (cars and roads) of a campaign.

A sample depends only on the spec and its number, so each can be drawn alone. It is the same for all controllers and scenarios.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from codegen.arrays import FloatArray
from codegen.sweep.spec import FACTORS, Spec, Values

BLOCK = 1024
"""Samples that share a random stream of a factor. Creating one stream for each sample would take longer than drawing."""
_NOISE_STREAM = 1_000_000
"""First stream number for noise; the stream number of a factor is its index in FACTORS."""


def draw(spec: Spec, samples: range) -> dict[str, FloatArray]:
    """Return factor -> values (len(samples),) for sample numbers, in the unit of the factor's name.

    Every factor has its own random stream, so adding a factor to the spec does not change the values of others.
    """
    if spec.design == "factorial":
        return _factorial(spec.factors, samples)
    return {
        key: _of_blocks(values, spec, place, samples)
        for place, key in enumerate(FACTORS)
        if (values := spec.factors.get(key)) is not None
    }


def noise(spec: Spec, samples: range, scenario: int, steps: int) -> FloatArray:
    """Return standard normal numbers (steps, 3, len(samples)) for a scenario, given by its index in the spec.

    All controllers get the same numbers. Every sample has its own stream, because a block of samples in a long scenario would
    not fit into memory.
    """
    found = np.empty((len(samples), steps, 3))
    for row, sample in zip(found, samples, strict=True):
        _stream(spec, sample, _NOISE_STREAM + scenario).standard_normal(out=row)
    return np.ascontiguousarray(np.moveaxis(found, 0, -1))


def _stream(spec: Spec, block: int, number: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(spec.seed, spawn_key=(block, number)))


def _of_blocks(values: Values, spec: Spec, place: int, samples: range) -> FloatArray:
    """Draw whole blocks, so that the values do not depend on where a chunk begins."""
    first, last = samples.start // BLOCK, (samples.stop - 1) // BLOCK
    drawn = np.concatenate([_random(values, _stream(spec, block, place), BLOCK) for block in range(first, last + 1)])
    return drawn[samples.start - first * BLOCK :][: len(samples)]


def _factorial(factors: Mapping[str, Values], samples: range) -> dict[str, FloatArray]:
    """Return all combinations of levels; the last factor of the spec changes fastest."""
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
    # Inverse of the truncated distribution: exact, and equally fast for a narrow window.
    from scipy.special import ndtr, ndtri

    first, last = ndtr((np.array([low, high]) - mean) / deviation)
    share = stream.uniform(first, last, size=count)
    drawn: FloatArray = np.clip(mean + deviation * ndtri(share), low, high)
    return drawn
