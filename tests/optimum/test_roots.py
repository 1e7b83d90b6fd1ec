"""Shrinking of brackets around roots, on functions whose roots are known."""

import numpy as np

from codegen.optimum.nonlinear_car import shrink

TOLERANCE = 1e-12


def test_each_bracket_shrinks_around_its_own_root() -> None:
    """Smooth, kinked, steep and nearly flat functions, falling and rising, with a root at either end or inside."""
    functions = [
        lambda x: x - 0.3,
        lambda x: 1.0 - 4.0 * x**3,
        lambda x: np.minimum(0.2 - x, 30.0 * (0.2 - x)),
        lambda x: (x - 0.7) ** 9,
        lambda x: np.tanh(500.0 * (x - 0.123)),
        lambda x: -x,
        lambda x: 1.0 - x,
    ]
    roots = np.array([0.3, 0.25 ** (1.0 / 3.0), 0.2, 0.7, 0.123, 0.0, 1.0])
    calls = []

    def function(some: np.ndarray, x: np.ndarray) -> np.ndarray:
        calls.append(some.size)
        return np.array([functions[which](value) for which, value in zip(some, x, strict=True)])

    first, second = np.zeros(roots.size), np.ones(roots.size)
    ends = [np.array([each(np.float64(at)) for each in functions]) for at in (0.0, 1.0)]
    end, root = shrink(function, first, second, *ends, TOLERANCE)
    # The ninth power is zero to rounding within 1e-36 of its root; the bracket itself is what counts.
    assert np.abs(end - roots).max() <= TOLERANCE
    assert np.abs(root - roots).max() <= TOLERANCE
    at_end = np.array([each(value) for each, value in zip(functions, end, strict=True)])
    assert (np.sign(at_end) * np.sign(ends[0]) >= 0.0).all()
    assert len(calls) < 60 and sum(calls) < 7 * 25  # bisection alone would take 40 for each


def test_an_empty_bracket_stays() -> None:
    end, root = shrink(lambda some, x: x, *np.full((4, 2), 0.5), TOLERANCE)
    assert end.tolist() == root.tolist() == [0.5, 0.5]
