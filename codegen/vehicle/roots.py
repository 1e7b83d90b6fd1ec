"""The root of a function of one number."""

from __future__ import annotations

from collections.abc import Callable

STEPS_MAX = 200


def bracketed_root(
    function: Callable[[float], float], low: float, high: float, atol: float = 1e-15, rtol: float = 1e-14
) -> float:
    """Return the root between `low` and `high`, where the function has opposite signs.

    R. P. Brent, Algorithms for Minimization without Derivatives, chapter 4: secant or inverse quadratic steps as long as they
    shrink fast enough, else bisection. It ends with the root within atol + rtol |x|.
    """
    # The iterate before, the best one, and the end on the other side of the root; each with its value.
    before, best = (low, function(low)), (high, function(high))
    other = before
    last = step = high - low
    for _ in range(STEPS_MAX):
        if (before[1] < 0.0) != (best[1] < 0.0):
            other = before
            last = step = best[0] - before[0]
        if abs(other[1]) < abs(best[1]):
            before, best, other = best, other, best
        near = 0.5 * (atol + rtol * abs(best[0]))
        half = 0.5 * (other[0] - best[0])
        if best[1] == 0.0 or abs(half) < near:
            break
        tried = half
        if abs(last) > near and abs(best[1]) < abs(before[1]):
            tried = _extrapolated(before, best, other)
        shrinks = 2.0 * abs(tried) < min(abs(last), 3.0 * abs(half) - near)
        last, step = (step, tried) if shrinks else (half, half)
        before = best
        moved = step if abs(step) > near else (near if half > 0.0 else -near)
        best = (best[0] + moved, function(best[0] + moved))
    return best[0]


def _extrapolated(before: tuple[float, float], best: tuple[float, float], other: tuple[float, float]) -> float:
    """Step from the best point to the root of the line through two points, or of the inverse parabola through three."""
    if before[0] == other[0]:
        return -best[1] * (best[0] - before[0]) / (best[1] - before[1])
    slope = (before[1] - best[1]) / (before[0] - best[0])
    slope_other = (other[1] - best[1]) / (other[0] - best[0])
    # Zero differences only where the values repeat, far below what the tolerance resolves: any step is then refused.
    below = slope_other * slope * (other[1] - before[1])
    return -best[1] * (other[1] * slope_other - before[1] * slope) / below if below != 0.0 else float("inf")
