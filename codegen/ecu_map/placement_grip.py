"""Split of the optimum with the nonlinear tyre into two smooth surfaces: the demand, and the limit of grip.

With linear tyres the grip bounds are ay_cap / speed, one number for all speeds and front angles, and the optimum can be solved
without them. With the nonlinear tyre the lateral acceleration at a slip bound depends on both, and beyond the tyre's peak
there is no turn without grip bounds. So the optimum is solved once on a fine grid, and split:

- the limit: where a slip bound, the bound on lateral acceleration or the stability limit ends the turns. Beyond an edge it is
  constant; where another bound ends the turns first, it is the nearest known limit at that speed;
- the demand: the optimum where no grip bound is active, continued with its slope. Beyond the last front angle, and beyond an
  edge that sideslip or the rear angle sets, it continues with the passive car's gain, as in `extend`. Up to the last front
  angle, it is cut to at most ABOVE over the limit.

A map that bends towards its cap (`optimum.demand`) meets no limit of grip. Its limit is constant, its demand is the map itself.

The optimum is the smaller of demand and limit. Both are smooth where they meet, so separate tables preserve the kink. The
rear angle of the demand is chosen so that the lookup, which adds the linear car's rear angle for the difference
(`lookup.capped_rear_angle`), returns that of the optimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.optimum.nonlinear import NonlinearTurns
from codegen.optimum.problem import SteadyTurnProblem

Solve = Callable[[FloatArray, FloatArray], FloatArray]
"""Speeds (p,) and front angles (p,) -> CHANNELS rows (3, p), NaN where there is none."""

CELLS, HALVINGS = 100, 3
"""Grid: initial cells of each axis, and number of halvings."""

SMOOTH = 1e-5
"""rad/s: a point is solved where the second differences of its neighbours leave a larger uncertainty."""

HELD = 1e-9
"""rad/s: distance within which a grip bound counts as active."""

ABOVE = 0.05
"""rad/s: more than any bound on an error between breakpoints."""

STENCIL = 8
"""Grid cells over which a slope is computed."""

YAW_RATE, REAR_ANGLE, GRIP = range(3)
"""Channels: the optimum in rad/s, its rear angle in rad, and the yaw rate at which grip ends the turns, rad/s."""


@dataclass(frozen=True)
class GripSurfaces:
    """Demand and limit on axes from zero: `speed` (n,) in m/s and `front_angle` (m,) in rad; linear in between.

    Attributes:
        yaw_rate, rear_angle: (n, m) rad/s and rad, the demand.
        lateral_acceleration: (n, m) m/s^2, the limit of grip.
        rear_slip: rad s^2/m, rear slip for each m/s^2 with which no grip-limited optimum exceeds the sideslip bound.
    """

    speed: FloatArray
    front_angle: FloatArray
    yaw_rate: FloatArray
    rear_angle: FloatArray
    lateral_acceleration: FloatArray
    rear_slip: float


def grip_surfaces(
    turns: NonlinearTurns,
    speed: tuple[float, float],
    front_angle: tuple[float, float],
    front_angle_top: float,
    cap: float,
    *,
    passive_safe: bool,
) -> GripSurfaces:
    """Split the optimum of a map over first and last speed (m/s) and front angle (rad), up to `front_angle_top`.

    Args:
        cap: m/s^2, the limit where grip ends no turn of the map.

    Raises:
        MapError: a steady turn is not found.
    """
    points = CELLS * 2**HALVINGS + 1
    speeds, angles = np.linspace(*speed, points), np.linspace(*front_angle, points)
    optimum = _on_grid(_solver(turns, passive_safe=passive_safe), speeds, angles)
    angles = np.concatenate([[0.0], angles, [front_angle_top] if front_angle_top > angles[-1] else []])
    gain = turns.problem.car.yaw_gain(speeds)[:, np.newaxis]
    rows = [_row(angles, float(gain[i, 0]), optimum[:, i]) for i in range(points)]
    asked, line, rear_angle, left, least = (np.array(table) for table in zip(*rows, strict=True))
    # An optimum that another bound limits must stay below the grip limit interpolated from the neighbouring points.
    known = _between_rows(speeds, left * speeds[:, np.newaxis])
    acceleration = np.fmax(np.where(np.isnan(known), cap, known), least * speeds[:, np.newaxis])
    if turns.problem.is_bent:
        acceleration = np.full(acceleration.shape, acceleration.max())
    asked, line, rear_angle = (_between_rows(speeds, table) for table in (asked, line, rear_angle))
    left = acceleration / speeds[:, np.newaxis]
    # Beyond the map's last angle both go on straight.
    asked = np.where(angles <= front_angle[1], np.minimum(asked, left + ABOVE), line)
    if turns.problem.is_bent:  # it never falls; rounding at an edge must not either
        asked = np.maximum.accumulate(asked, axis=1)
    excess = np.maximum(asked - left, 0.0) - np.maximum(line - left, 0.0)
    rear_angle = rear_angle - np.maximum(excess, 0.0) / gain
    return GripSurfaces(
        speed=np.concatenate([[0.0], speeds]),
        front_angle=angles,
        yaw_rate=np.pad(asked, ((1, 0), (0, 0))),
        rear_angle=np.pad(rear_angle, ((1, 0), (0, 0)), mode="edge"),
        lateral_acceleration=np.pad(acceleration, ((1, 0), (0, 0)), mode="edge"),
        rear_slip=_rear_slip(turns.problem, speeds[:, np.newaxis], optimum),
    )


def _rear_slip(problem: SteadyTurnProblem, speed: FloatArray, optimum: FloatArray) -> float:
    """Return `GripSurfaces.rear_slip` for the `optimum` of `_on_grid`; zero where no optimum is grip-limited."""
    yaw_rate, rear_angle, grip = optimum
    held = np.abs(grip - yaw_rate) <= HELD  # false for NaN
    with np.errstate(invalid="ignore"):
        slip = rear_angle + yaw_rate * problem.car.rear_arm / speed - problem.sideslip_max
        needed = np.where(held, slip / (yaw_rate * speed), 0.0)
    return float(needed.max())


def _solver(turns: NonlinearTurns, *, passive_safe: bool) -> Solve:
    straight = turns.without_rear_steering() if passive_safe and turns.problem.rear_angle_max > 0.0 else None

    def solve(speed: FloatArray, front_angle: FloatArray) -> FloatArray:
        found, grip = turns.at_with_grip(speed, front_angle)
        channels = np.array([found.yaw_rate, found.rear_angle, grip])
        if straight is not None:
            channels[:GRIP, ~straight.at(speed, front_angle).feasible] = np.nan
        return channels

    return solve


# --- the grid -------------------------------------------------------------------------------------------------------------


def _on_grid(solve: Solve, speed: FloatArray, front_angle: FloatArray) -> FloatArray:
    """Return the channels (3, n, n) on a grid of CELLS 2^HALVINGS cells of each axis.

    A coarse grid is solved first. Points between are solved where interpolation is uncertain."""
    every = 2**HALVINGS
    pairs = np.meshgrid(speed[::every], front_angle[::every], indexing="ij")
    channels = solve(*(values.ravel() for values in pairs)).reshape(-1, CELLS + 1, CELLS + 1)
    while every > 1:
        every //= 2
        unsure = _halved(_unsure(channels).astype(np.float64)) > 0.0
        unsure[::2, ::2] = False  # known already
        channels = _halved(channels)
        i, j = np.nonzero(unsure)
        channels[:, i, j] = solve(speed[every * i], front_angle[every * j])
    return channels


def _halved(values: FloatArray) -> FloatArray:
    """Return (..., 2 n - 1, 2 m - 1) from (..., n, m), with means in between."""
    for axis in (-2, -1):
        lines = np.moveaxis(values, axis, 0)
        finer = np.empty((2 * len(lines) - 1, *lines.shape[1:]))
        finer[::2], finer[1::2] = lines, 0.5 * (lines[:-1] + lines[1:])
        values = np.moveaxis(finer, 0, axis)
    return values


def _unsure(channels: FloatArray) -> BoolArray:
    """Return (n, m) where the second differences of a channel are large, or it ends."""
    unsure = np.zeros(channels.shape[1:], dtype=np.bool_)
    for channel in channels:
        there = np.isfinite(channel)
        for axis in (0, 1):
            marks = np.moveaxis(unsure, axis, 0)  # a view: what is marked there is marked
            marks[1:-1] |= np.moveaxis(np.abs(np.diff(channel, 2, axis=axis)) > 8.0 * SMOOTH, axis, 0)
            ends = np.moveaxis(np.diff(there, axis=axis), axis, 0)
            marks[1:] |= ends
            marks[:-1] |= ends
    return unsure


# --- split ----------------------------------------------------------------------------------------------------------------


def _row(front_angle: FloatArray, gain: float, optimum: FloatArray) -> tuple[FloatArray, ...]:
    """Split the optimum at one speed, over `front_angle` (m,) in rad from zero, perhaps beyond the last angle of the map.

    Args:
        gain: passive yaw gain, 1/s. optimum: (3, k) channels at the angles of the map.

    Returns:
        (m,) each, NaN where unknown: the yaw rate demand; the optimum, continued with the passive gain; the rear angle of the
        optimum or of its edge; the yaw rate limit of grip; its lower bound.
    """
    yaw_rate, rear_angle, grip = np.pad(optimum, ((0, 0), (1, 0)))
    grip[0] = np.nan
    feasible = np.isfinite(yaw_rate)
    end = int(np.flatnonzero(feasible)[-1])
    if end == 0:
        return (np.full(front_angle.shape, np.nan),) * 5
    own, upto = front_angle[: yaw_rate.size], slice(end + 1)
    line, rear_angle = (np.interp(front_angle, own[feasible], values[feasible]) for values in (yaw_rate, rear_angle))
    # The edge lies between this angle and the next one: up to that it goes on with its slope.
    beyond = min(end + 1, own.size - 1)
    line[beyond:] += _slope(own, line, end) * (own[beyond] - own[end]) + gain * (front_angle[beyond:] - own[beyond])
    held = np.abs(grip - yaw_rate) <= HELD  # false for NaN
    if held[end]:
        rear_angle[beyond:] += _slope(own, rear_angle, end) * (own[beyond] - own[end])
    asked = line.copy()
    if held.any():
        last = max(int(held.argmax()) - 1, 1)
        going_on = line[last] + _slope(own, line, last) * (front_angle[last + 1 :] - own[last])
        asked[last + 1 :] = np.maximum(going_on, np.where(front_angle[last + 1 :] <= own[end], line[last + 1 :], 0.0))
    known = np.isfinite(grip[upto])
    left = np.interp(front_angle, own[upto][known], grip[upto][known]) if known.any() else np.full(front_angle.shape, np.nan)
    least = np.zeros(front_angle.shape)
    least[upto] = np.where(held[upto], 0.0, line[upto])
    return asked, line, rear_angle, left, least


def _slope(front_angle: FloatArray, values: FloatArray, at: int) -> float:
    """Return the slope before a point of the grid; from zero where that is the first one."""
    first = max(at - STENCIL, 1) if at > 1 else 0
    return float((values[at] - values[first]) / (front_angle[at] - front_angle[first]))


def _between_rows(speed: FloatArray, table: FloatArray) -> FloatArray:
    """Fill unknown rows of a table (n, m) from the rows around them."""
    known = np.isfinite(table[:, 0])
    if known.all() or not known.any():
        return table
    return np.array([np.interp(speed, speed[known], column[known]) for column in table.T]).T
