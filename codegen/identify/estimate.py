"""Gauss-Newton over all segments with a robust loss, and the covariance of the estimate.

The cost is sum rho((y - measured) / noise) + |z|^2 / 2 with Huber's rho and z the scaled parameters (`parameters.Prior`). The
free initial states of each segment are eliminated from the normal equations (Schur complement). The noise of each output is
estimated from the residuals. The covariance is the sandwich H^-1 (M + I) H^-1: M is the long-run covariance of the gradient over
samples (W. K. Newey, K. D. West, A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance
matrix, 1987), because residuals are coloured and larger where the car moves fast. The gradient of a segment is that of the
estimate from all others, because a segment that dominates a parameter hides its own error (J. G. MacKinnon, H. White, Some
heteroskedasticity-consistent covariance matrix estimators with improved finite sample properties, 1985).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.identify.shooting import Problem

HUBER = 2.5
"""Residuals beyond this multiple of the noise count linearly. Close to least squares for normal noise; outliers are bounded."""
ITERATIONS_MAX = 30
DECREMENT_MIN = 1e-3
"""Stop when a step would lower the cost by less: it moves no parameter by more than a twentieth of its standard deviation."""
WINDOW_S = 1.0
"""Lags of the residuals' correlation that the covariance takes in, s: above all time constants of a car."""
NOISE_ROUNDS_MAX, NOISE_CHANGE = 6, 0.03
"""Rounds of estimating the noise, and the relative change at which they end."""
DECREMENT_FIRST, NOISE_CHANGE_FIRST = 0.1, 0.2
"""The same for the first estimate."""


@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate.

    Attributes:
        problem: problem of the fit.
        values: (k,) SI, in the order of the prior. starts: (m, starts).
        free: (k,) whether a parameter was estimated.
        noise: (outputs,) robust standard deviation of the residuals; NaN for an output without measurements.
        residuals: (rows, outputs) measured minus simulated, NaN where not compared.
        information: (k, k) of the data alone, in units of the prior: its curvature after elimination of the initial states.
        covariance: (k, k) of z, prior included; zero for parameters that are not free.
    """

    problem: Problem
    values: FloatArray
    starts: FloatArray
    free: BoolArray
    noise: FloatArray
    residuals: FloatArray
    information: FloatArray
    covariance: FloatArray

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviations (k,) of the values in SI, to first order."""
        result: FloatArray = np.sqrt(np.diag(self.covariance)) * self.problem.prior.slope(self.values)
        return result

    def named(self) -> dict[str, float]:
        """Return the values by name."""
        return dict(zip(self.problem.prior.names, self.values.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class _Point:
    """Cost and normal equations at z (f,) and starts, the initial states eliminated.

    Attributes:
        hessian, gradient: (f, f) and (f,), without the prior. parts: (m, f, f), the share of each segment in the former.
        gains, offsets: (m, starts, f) and (m, starts): change of the initial states is offsets + gains @ change of z.
    """

    z: FloatArray
    starts: FloatArray
    cost: float
    hessian: FloatArray
    parts: FloatArray
    gradient: FloatArray
    gains: FloatArray
    offsets: FloatArray


class _Solver:
    """The problem in z of its free parameters; `values` are those of the others."""

    def __init__(self, problem: Problem, free: BoolArray, values: FloatArray) -> None:
        self.problem, self.free = problem, free
        self.base = problem.prior.scaled(values)
        self.known = np.isfinite(problem.measured)
        low, high = problem.prior.bounds()
        self.low, self.high = low[free], high[free]

    def all_z(self, z: FloatArray) -> FloatArray:
        """Return the scaled form of all parameters."""
        full = self.base.copy()
        full[self.free] = z
        return full

    def values(self, z: FloatArray) -> FloatArray:
        """Return all parameters in SI."""
        return self.problem.prior.values(self.all_z(z))

    def errors(self, z: FloatArray, starts: FloatArray) -> FloatArray:
        """Return simulated minus measured outputs (rows, outputs), NaN where not compared."""
        return self.problem.simulation(self.values(z), starts).output() - self.problem.measured

    def point(self, z: FloatArray, starts: FloatArray, noise: FloatArray) -> _Point:
        """Return cost and normal equations."""
        problem, values = self.problem, self.values(z)
        found = problem.simulation(values, starts).normal(problem.measured, 1.0 / noise, problem.prior.slope(values), HUBER)
        moved = (starts - problem.starts) / problem.start_spread
        cost = float(found.cost.sum()) + 0.5 * float((moved**2).sum()) + 0.5 * float((self.all_z(z) ** 2).sum())
        count = len(self.free)
        chosen = np.flatnonzero(self.free)
        if not (math.isfinite(cost) and np.isfinite(found.hessian).all()):
            empty = np.zeros(0)
            return _Point(z, starts, math.inf, empty, empty, empty, empty, empty)
        inner = found.hessian[:, count:, count:] + np.diag(1.0 / problem.start_spread**2)
        cross = found.hessian[:, count:, chosen]
        pull = found.gradient[:, count:] + moved / problem.start_spread
        gains = -np.linalg.solve(inner, cross)
        offsets = -np.linalg.solve(inner, pull[:, :, None])[:, :, 0]
        parts = found.hessian[:, chosen[:, None], chosen] + np.swapaxes(cross, 1, 2) @ gains
        gradient = found.gradient.sum(axis=0)[chosen] + np.einsum("msf,ms->f", gains, pull)
        return _Point(z, starts, cost, parts.sum(axis=0), parts, gradient, gains, offsets)

    def scores(self, here: _Point, noise: FloatArray) -> FloatArray:
        """Return the gradient of each sample (rows, f), the initial states eliminated."""
        problem, values, count = self.problem, self.values(here.z), len(self.free)
        output, slope = problem.simulation(values, here.starts).slopes()
        scaled = np.where(self.known, (output - problem.measured) / noise, 0.0)
        pull = np.clip(scaled, -HUBER, HUBER) / noise
        result: FloatArray = np.einsum("ro,rof->rf", pull, slope[:, :, np.flatnonzero(self.free)])
        result *= problem.prior.slope(values)[self.free]
        by_start = np.einsum("ro,ros->rs", pull, slope[:, :, count:])
        for k, (low, high) in enumerate(pairwise(problem.segments.offsets)):
            result[low:high] += by_start[low:high] @ here.gains[k]
        return result

    def minimise(self, z: FloatArray, starts: FloatArray, noise: FloatArray, decrement: float) -> _Point:
        """Return the minimum for a given noise (Levenberg-Marquardt with bounds)."""
        here = self.point(z, starts, noise)
        damping = 1e-4
        for _ in range(ITERATIONS_MAX):
            hessian = here.hessian + np.eye(len(here.z))
            gradient = here.gradient + here.z
            while True:
                damped = hessian + damping * np.diag(np.diag(hessian))
                move = -np.linalg.solve(damped, gradient)
                target = np.clip(here.z + move, self.low, self.high)
                move = target - here.z
                expected = -float(gradient @ move) - 0.5 * float(move @ hessian @ move)
                starts = here.starts + here.offsets + here.gains @ move
                there = self.point(target, starts, noise)
                if there.cost < here.cost:
                    break
                if expected < decrement or damping > 1e8:
                    return here
                damping *= 10.0
            damping = max(damping * 0.1, 1e-9)
            fell, here = here.cost - there.cost, there
            if fell < decrement:
                break
        return here


def noise_of(error: FloatArray) -> FloatArray:
    """Return the robust standard deviation (outputs,) of errors with NaN, from the median of their size; 1 without any."""
    result = np.ones(error.shape[1])
    for k in range(error.shape[1]):
        values = error[np.isfinite(error[:, k]), k]
        if values.size:
            spread = 1.4826 * float(np.median(np.abs(values)))
            # A coarse sensor at rest has a median of zero.
            result[k] = max(spread, 0.1 * float(np.sqrt(np.mean(values**2))), 1e-12)
    return result


PART_SEGMENTS = 40
"""Segments from which the first estimate comes; the whole then needs few iterations."""


def fit(
    problem: Problem,
    values: FloatArray,
    free: BoolArray,
    starts: FloatArray | None = None,
    noise: FloatArray | None = None,
) -> Fit:
    """Estimate the free parameters.

    Args:
        values: (k,) SI: start of the free parameters, and values of the others.
        free: (k,) parameters to estimate.
        starts: first guess of the initial states; None takes the problem's.
        noise: (outputs,) of an earlier fit of nearly the same problem; None for a first fit.
    """
    solver = _Solver(problem, free, values)
    z = np.clip(problem.prior.scaled(values)[free], solver.low, solver.high)
    starts = problem.starts if starts is None else starts
    if noise is None:
        every = len(starts) // PART_SEGMENTS
        part = _Solver(problem.part(every), free, values) if every > 1 else solver
        z, part_starts, noise = _first(part, z)
        starts = part_starts if part is solver else starts
    known = solver.known.any(axis=0)
    noise = np.where(known, noise, 1.0)
    for _ in range(NOISE_ROUNDS_MAX):
        here = solver.minimise(z, starts, noise, DECREMENT_MIN)
        z, starts = here.z, here.starts
        before, noise = noise, noise_of(solver.errors(z, starts))
        if bool((np.abs(np.log(noise / before)) < NOISE_CHANGE).all()):
            break
    here = solver.point(z, starts, noise)
    identity = np.eye(len(z))
    window = max(round(WINDOW_S / problem.samples.step), 1)
    inverse = np.linalg.inv(here.hessian + identity)
    scores = solver.scores(here, noise)
    for part, (low, high) in zip(here.parts, pairwise(problem.segments.offsets), strict=True):
        scores[low:high] = np.linalg.solve(identity - part @ inverse, scores[low:high].T).T
    meat = _long_run(scores, problem.segments.offsets, window) + identity
    covariance, information = np.zeros((len(free), len(free))), np.zeros((len(free), len(free)))
    chosen = np.ix_(free, free)
    covariance[chosen], information[chosen] = inverse @ meat @ inverse, here.hessian
    return Fit(
        problem,
        solver.values(z),
        starts,
        free,
        np.where(known, noise, math.nan),
        -solver.errors(z, starts),
        information,
        covariance,
    )


def _first(solver: _Solver, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return z, initial states and noise from a bad start.

    The first noise is the size of the residuals themselves, so that the robust loss does not ignore the start's.
    """
    starts = solver.problem.starts
    error = solver.errors(z, starts)
    noise = np.ones(error.shape[1])
    for k in np.flatnonzero(solver.known.any(axis=0)):
        noise[k] = max(float(np.sqrt(np.nanmean(error[:, k] ** 2))), 1e-12)
    for _ in range(NOISE_ROUNDS_MAX):
        here = solver.minimise(z, starts, noise, DECREMENT_FIRST)
        z, starts = here.z, here.starts
        before, noise = noise, noise_of(solver.errors(z, starts))
        if bool((np.abs(np.log(noise / before)) < NOISE_CHANGE_FIRST).all()):
            break
    return z, starts, noise


def _long_run(scores: FloatArray, offsets: FloatArray, window: int) -> FloatArray:
    """Return the long-run covariance of the sum of scores (rows, f), lags within a segment, Bartlett weights.

    The sum over all windows of `window` samples, moved sample by sample over the segment and beyond its ends, of the outer
    product of the scores in the window equals the weighted sum of all lagged products.
    """
    keep = scores.shape[1]
    total = np.zeros((keep, keep))
    for low, high in zip(offsets[:-1], offsets[1:], strict=True):
        summed = np.concatenate([np.zeros((1, keep)), np.cumsum(scores[low:high], axis=0)])
        at = np.arange(1 - window, int(high - low))
        block = summed[np.clip(at + window, 0, int(high - low))] - summed[np.clip(at, 0, int(high - low))]
        total += block.T @ block / window
    return total
