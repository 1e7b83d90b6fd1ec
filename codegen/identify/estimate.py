"""Gauss-Newton over all segments with a robust loss, and the covariance of the estimate.

The cost is sum rho((y - measured) / noise) + |z|^2 / 2 with Huber's rho and z the scaled parameters (`parameters.Prior`). The
free initial states of each segment are eliminated from the normal equations (Schur complement). The noise of each output is
estimated from the residuals of each segment: a manoeuvre that the model cannot follow, such as a fast sweep of a car that
rolls, then counts less than one that it can.

The covariance is the sandwich H^-1 (M + I) H^-1. H is the curvature of the cost: residuals that count linearly have none. M is
the long-run covariance of the gradient over samples (W. K. Newey, K. D. West, A simple, positive semi-definite,
heteroskedasticity and autocorrelation consistent covariance matrix, 1987), because residuals are coloured and larger where the
car moves fast. The gradient of each second is divided by one minus its leverage, because a manoeuvre that dominates a parameter
hides its own error (HC3 of J. G. MacKinnon, H. White, Some heteroskedasticity-consistent covariance matrix estimators with
improved finite sample properties, 1985).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IntArray
from codegen.errors import CodegenError
from codegen.identify.shooting import Problem

HUBER = 2.5
"""Residuals beyond this multiple of the noise count linearly. Close to least squares for normal noise; outliers are bounded."""
ITERATIONS_MAX = 20
DAMPING, REJECTIONS_MAX = 1e-3, 8
"""First damping, and number of steps of growing damping that may fail: the cost has kinks, from limits of loads and angles, at
which it cannot fall."""
DECREMENT_MIN = 5e-3
"""Stop when a step would lower the cost by less: it moves no parameter by more than a tenth of its standard deviation."""
LEVERAGE_MAX = 0.9
"""Largest leverage with which the gradient is enlarged: tenfold."""
WINDOW_S = 1.0
"""Lags of the residuals' correlation that the covariance takes in, s: above all time constants of a car."""
DECREMENT_ROUND = 0.1
"""The same while the noise is not known."""
NOISE_QUANTILE, NOISE_QUANTILE_SIZE = 0.8, 1.2816
"""Fraction of the errors from which the noise follows: a fifth may be outliers; and its quantile for normal noise of one."""
FLOOR_QUANTILE, NOISE_RATIO_MAX = 0.25, 20.0
"""Least noise of a segment, as a quantile over all of them; and the largest, as a multiple of it."""
NOISE_ROUNDS_MAX = 5
NOISE_CHANGE, NOISE_CHANGE_FIRST = 0.03, 0.2
"""Mean relative change of the noise at which these rounds end; and for a first estimate."""


@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate.

    Attributes:
        problem: problem of the fit.
        values: (k,) SI, in the order of the prior. starts: (m, starts).
        free: (k,) whether a parameter was estimated.
        noise: (m, outputs) robust standard deviation of the residuals of each segment; 1 where nothing is compared.
        residuals: (rows, outputs) measured minus simulated, NaN where not compared.
        information: (k, k) of the data alone, in units of the prior: its curvature after elimination of the initial states.
        covariance: (k, k) of z, prior included; zero for parameters that count as exact.
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

    def cost(self, noise: FloatArray) -> float:
        """Return the robust cost of the residuals for a noise (m, outputs), without the prior."""
        size = np.abs(self.problem.averaged(self.residuals) / self.problem.of_blocks(noise))
        return float(np.nansum(np.where(size <= HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER))))

    def named(self) -> dict[str, float]:
        """Return the values by name."""
        return dict(zip(self.problem.prior.names, self.values.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class _Point:
    """Cost and normal equations, prior included, at z (f,) and starts (m, s).

    Attributes:
        outer: (m, f, f), of z without the prior, the share of each segment. cross: (m, s, f). inner: (m, s, s).
        gradient: (f,). pull: (m, s), gradient by the initial states.
    """

    z: FloatArray
    starts: FloatArray
    cost: float
    outer: FloatArray
    cross: FloatArray
    inner: FloatArray
    gradient: FloatArray
    pull: FloatArray

    def gains(self, damping: float = 0.0) -> FloatArray:
        """Return the change of the initial states (m, s, f) for each change of z."""
        return np.asarray(-np.linalg.solve(_damped(self.inner, damping), self.cross), dtype=np.float64)

    def step(self, damping: float, movable: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the damped Gauss-Newton step of z, zero where not movable, and of the initial states for a given one."""
        gains = self.gains(damping)
        hessian = _damped(self.outer.sum(axis=0) + np.eye(len(self.z)), damping) + np.einsum("msf,msg->fg", self.cross, gains)
        gradient = self.gradient + np.einsum("msf,ms->f", gains, self.pull)
        move = np.zeros(len(self.z))
        chosen = np.flatnonzero(movable)
        move[chosen] = -np.linalg.solve(hessian[np.ix_(chosen, chosen)], gradient[chosen])
        return move, gains

    def starts_step(self, damping: float, gains: FloatArray, move: FloatArray) -> FloatArray:
        """Return the step of the initial states (m, s) that goes with a step of z."""
        alone = np.linalg.solve(_damped(self.inner, damping), self.pull[:, :, None])[:, :, 0]
        result: FloatArray = gains @ move - alone
        return result

    def expected(self, move: FloatArray, by_starts: FloatArray) -> float:
        """Return the decrease of the cost that the normal equations predict for a step."""
        slope = float(self.gradient @ move) + float((self.pull * by_starts).sum())
        bend = float(move @ (self.outer.sum(axis=0) + np.eye(len(move))) @ move)
        bend += 2.0 * float(np.einsum("ms,msf,f->", by_starts, self.cross, move))
        bend += float(np.einsum("ms,mst,mt->", by_starts, self.inner, by_starts))
        return -slope - 0.5 * bend


def _damped(matrix: FloatArray, damping: float) -> FloatArray:
    """Return square matrices (..., k, k) with their diagonals enlarged (D. W. Marquardt, 1963)."""
    return np.asarray(matrix * (1.0 + damping * np.eye(matrix.shape[-1])), dtype=np.float64)


def diverged() -> CodegenError:
    """Return the error for drives that the model cannot follow at all."""
    remedy = "check units and signs of the signals, and the configured car"
    return CodegenError("the simulation of the drives diverges", where="identify", remedy=remedy)


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
        found = problem.simulation(values, starts).normal(
            problem.measured, 1.0 / noise, problem.prior.slope(values), HUBER, problem.average
        )
        moved = (starts - problem.starts) / problem.start_spread
        cost = float(found.cost.sum()) + 0.5 * float((moved**2).sum()) + 0.5 * float((self.all_z(z) ** 2).sum())
        count = len(self.free)
        chosen = np.flatnonzero(self.free)
        if not (math.isfinite(cost) and np.isfinite(found.hessian).all()):
            empty = np.zeros(0)
            return _Point(z, starts, math.inf, empty, empty, empty, empty, empty)
        return _Point(
            z,
            starts,
            cost,
            found.hessian[:, chosen[:, None], chosen],
            found.hessian[:, count:, chosen],
            found.hessian[:, count:, count:] + np.diag(1.0 / problem.start_spread**2),
            found.gradient.sum(axis=0)[chosen] + z,
            found.gradient[:, count:] + moved / problem.start_spread,
        )

    def rows(self, here: _Point, noise: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return weighted mean errors (blocks, outputs), their derivatives (blocks, outputs, f), and the curvature (f, f).

        The initial states are eliminated. The sum of the squared errors is the cost to first order; the product of errors and
        derivatives is the gradient of each block.
        """
        problem, values, count = self.problem, self.values(here.z), len(self.free)
        noise = problem.of_blocks(noise)
        output, slope = problem.simulation(values, here.starts).slopes()
        scaled = np.nan_to_num(problem.averaged(output - problem.measured) / noise)
        robust = np.sqrt(HUBER / np.maximum(np.abs(scaled), HUBER))
        by_z: FloatArray = slope[:, :, np.flatnonzero(self.free)] * problem.prior.slope(values)[self.free]
        for gain, (low, high) in zip(here.gains(), pairwise(problem.segments.offsets), strict=True):
            by_z[low:high] += slope[low:high, :, count:] @ gain
        by_z[~self.known] = 0.0
        first, _ = problem.blocks
        number = np.maximum(np.add.reduceat(self.known, first, axis=0, dtype=np.int64), 1)
        summed: FloatArray = np.add.reduceat(by_z, first, axis=0)
        summed *= (robust / (noise * np.sqrt(number)))[:, :, None]
        inliers = summed[np.abs(scaled * robust) <= HUBER]
        return np.asarray(scaled * robust, dtype=np.float64), summed, inliers.T @ inliers

    def minimise(self, z: FloatArray, starts: FloatArray, noise: FloatArray, decrement: float) -> _Point:
        """Return the minimum for a given noise (Levenberg-Marquardt with bounds). Raises CodegenError if the start diverges."""
        here = self.point(z, starts, noise)
        if not math.isfinite(here.cost):
            raise diverged()
        damping = DAMPING
        for _ in range(ITERATIONS_MAX):
            # A parameter stays at its bound where the cost falls beyond it.
            movable = ~(((here.z <= self.low) & (here.gradient > 0.0)) | ((here.z >= self.high) & (here.gradient < 0.0)))
            free_move, gains = here.step(0.0, movable)
            if here.expected(free_move, here.starts_step(0.0, gains, free_move)) < decrement:
                return here
            for _ in range(REJECTIONS_MAX):
                move, by_starts = self._moved(here, damping, movable)
                expected = here.expected(move, by_starts)
                there = self.point(here.z + move, here.starts + by_starts, noise)
                if there.cost < here.cost:
                    break
                damping = max(10.0 * damping, DAMPING)
            else:
                return here
            # Less damping only where the prediction holds (J. Nocedal, S. Wright, Numerical Optimization, algorithm 4.1).
            fell, here = here.cost - there.cost, there
            if fell < decrement:
                return here
            damping = damping * (0.1 if fell > 0.75 * expected else 4.0 if fell < 0.25 * expected else 1.0)
        return here

    def _moved(self, here: _Point, damping: float, movable: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the step of z, within its bounds, and of the initial states."""
        move, gains = here.step(damping, movable)
        move = np.clip(here.z + move, self.low, self.high) - here.z
        return move, here.starts_step(damping, gains, move)


def noise_of(problem: Problem, errors: FloatArray) -> FloatArray:
    """Return the robust standard deviation (m, outputs) of the averaged errors of each segment; 1 where there are none.

    It follows from the quantile NOISE_QUANTILE of their size. The noise of a segment is at least the quantile FLOOR_QUANTILE
    over all segments, weighted by the variance of their measured outputs. Otherwise long straight driving would make every
    error of a manoeuvre an outlier. None has more than NOISE_RATIO_MAX of it.

    Args:
        errors: (rows, outputs) simulated minus measured, NaN where not compared.
    """
    _, offsets = problem.blocks
    averaged = np.abs(problem.averaged(errors))
    result = np.ones((len(offsets) - 1, errors.shape[1]))
    for k in range(errors.shape[1]):
        known = np.add.reduceat(np.isfinite(averaged[:, k]), offsets[:-1], dtype=np.int64) > 0
        if not known.any():
            continue
        parts = np.split(problem.measured[:, k], problem.segments.offsets[1:-1])
        moved = np.array([float(np.nanvar(part)) if is_known else 0.0 for part, is_known in zip(parts, known, strict=True)])
        blocks = np.split(averaged[:, k], offsets[1:-1])
        sizes = [
            float(np.nanquantile(block, NOISE_QUANTILE)) for block, is_known in zip(blocks, known, strict=True) if is_known
        ]
        noise, weights = np.array(sizes) / NOISE_QUANTILE_SIZE, (moved + 1e-9 * moved.max() + 1e-30)[known]
        order = np.argsort(noise)
        place = np.searchsorted(np.cumsum(weights[order]), FLOOR_QUANTILE * weights.sum())
        floor = max(float(noise[order[min(place, noise.size - 1)]]), 1e-12)
        result[known, k] = np.clip(noise, floor, NOISE_RATIO_MAX * floor)
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
        noise: (m, outputs) of an earlier fit of nearly the same problem; None for a first fit.
    """
    solver = _Solver(problem, free, values)
    z = np.clip(problem.prior.scaled(values)[free], solver.low, solver.high)
    starts = problem.starts if starts is None else starts
    if noise is None:
        every = len(starts) // PART_SEGMENTS
        part = _Solver(problem.part(every), free, values) if every > 1 else solver
        z, part_starts, noise = _first(part, z)
        if part is solver:
            starts = part_starts
        else:
            noise = np.repeat(np.median(noise, axis=0)[None], len(starts), axis=0)
    z, starts, noise = _settled(solver, z, starts, noise, NOISE_CHANGE)
    here = solver.minimise(z, starts, noise, DECREMENT_MIN)
    z, starts = here.z, here.starts
    identity = np.eye(len(z))
    window = max(round(WINDOW_S / (problem.samples.step * problem.average)), 1)
    _, offsets = problem.blocks
    error, by_z, hessian = solver.rows(here, noise)
    inverse = np.asarray(np.linalg.inv(hessian + identity), dtype=np.float64)
    scores = _scores(error, by_z, offsets, window, inverse)
    meat = _long_run(scores, offsets, window) + identity
    covariance, information = np.zeros((len(free), len(free))), np.zeros((len(free), len(free)))
    chosen = np.ix_(free, free)
    sandwich = inverse @ meat @ inverse
    # Rounding errors of the product are not symmetric. They are large where the drives hardly tell two parameters apart.
    size, vectors = np.linalg.eigh(0.5 * (sandwich + sandwich.T))
    bounded = (vectors * np.minimum(size, 1.0)) @ vectors.T  # no direction is known less than before the drives
    covariance[chosen], information[chosen] = 0.5 * (bounded + bounded.T), hessian
    return Fit(
        problem,
        solver.values(z),
        starts,
        free,
        noise,
        -solver.errors(z, starts),
        information,
        covariance,
    )


def curvature(fitted: Fit, chosen: BoolArray) -> FloatArray:
    """Return the curvature (c, c) of the data's cost at a fit, in z of chosen parameters (k,), which may have been held."""
    solver = _Solver(fitted.problem, chosen, fitted.values)
    z = fitted.problem.prior.scaled(fitted.values)[chosen]
    *_, result = solver.rows(solver.point(z, fitted.starts, fitted.noise), fitted.noise)
    return result


def information_of_outputs(fitted: Fit) -> tuple[FloatArray, FloatArray]:
    """Return the curvature (outputs, f, f) of the data's cost by each output, in z of the free parameters, and the sum
    (outputs,) of the squared measured outputs, without their means, over the squared noise."""
    problem = fitted.problem
    solver = _Solver(problem, fitted.free, fitted.values)
    z = problem.prior.scaled(fitted.values)[fitted.free]
    _, by_z, _ = solver.rows(solver.point(z, fitted.starts, fitted.noise), fitted.noise)
    known = solver.known
    noise = np.repeat(fitted.noise, np.diff(problem.segments.offsets), axis=0)
    mean = np.where(known, problem.measured, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    size = np.where(known, (problem.measured - mean) / noise, 0.0)
    return np.einsum("bof,bog->ofg", by_z, by_z), np.asarray((size**2).sum(axis=0), dtype=np.float64)


def _first(solver: _Solver, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return z, initial states and noise from a bad start.

    The first noise is the size of the residuals themselves, so that the robust loss does not ignore the start's.
    """
    starts = solver.problem.starts
    error = solver.problem.averaged(solver.errors(z, starts))
    noise = np.ones((len(starts), error.shape[1]))
    for k in np.flatnonzero(solver.known.any(axis=0)):
        noise[:, k] = max(float(np.sqrt(np.nanmean(error[:, k] ** 2))), 1e-12)
    return _settled(solver, z, starts, noise, NOISE_CHANGE_FIRST)


def _settled(
    solver: _Solver, z: FloatArray, starts: FloatArray, noise: FloatArray, change: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return z, initial states and noise after rounds of minimising and estimating the noise."""
    for _ in range(NOISE_ROUNDS_MAX):
        here = solver.minimise(z, starts, noise, DECREMENT_ROUND)
        z, starts = here.z, here.starts
        before, noise = noise, noise_of(solver.problem, solver.errors(z, starts))
        if bool((np.abs(np.log(noise / before)).mean(axis=0) < change).all()):
            break
    return z, starts, noise


def _scores(error: FloatArray, by_z: FloatArray, offsets: IntArray, window: int, inverse: FloatArray) -> FloatArray:
    """Return the gradient (blocks, f) of each block, enlarged to compensate for the part of the error that the fit to the
    block's own window removes.

    Args:
        error, by_z: see `_Solver.rows`. offsets: first block of each segment. inverse: (f, f) inverse Hessian.
    """
    result: FloatArray = np.einsum("ro,rof->rf", error, by_z)
    root = np.linalg.cholesky(inverse)
    for low, high in pairwise(offsets):
        for begin in range(low, high, window):
            block = slice(begin, min(begin + window, high))
            slopes = by_z[block].reshape(-1, len(inverse)) @ root
            leverage, vectors = np.linalg.eigh(slopes.T @ slopes)
            factors = 1.0 / (1.0 - np.minimum(leverage, LEVERAGE_MAX))
            in_root = result[block] @ root @ vectors
            result[block] += np.linalg.solve(root.T, ((in_root * (factors - 1.0)) @ vectors.T).T).T
    return result


def _long_run(scores: FloatArray, offsets: IntArray, window: int) -> FloatArray:
    """Return the long-run covariance of the sum of scores (blocks, f), lags within a segment, Bartlett weights.

    The sum over all windows of `window` samples, moved sample by sample over the segment and beyond its ends, of the outer
    product of the scores in the window equals the weighted sum of all lagged products.
    """
    keep = scores.shape[1]
    total = np.zeros((keep, keep))
    for low, high in pairwise(offsets):
        summed = np.concatenate([np.zeros((1, keep)), np.cumsum(scores[low:high], axis=0)])
        at = np.arange(1 - window, int(high - low))
        block = summed[np.clip(at + window, 0, int(high - low))] - summed[np.clip(at, 0, int(high - low))]
        total += block.T @ block / window
    return total
