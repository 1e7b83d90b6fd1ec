"""Stability margins of the yaw-rate loop for one car and for the family, and the speeds where they are smallest.

The loop is L(z) = -(Kp + Ki T z/(z-1)) P(z), where P is the sampled car of `sampled`. The controller adds Ki T e to its
integral before use, and a rear angle in phase turns the car less. Margins are read from L(e^(j w T)) on a frequency grid, with
interpolated crossings; the poles decide whether the closed loop is stable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, ComplexArray, FloatArray
from codegen.configuration import Config, Schedule
from codegen.design.family import Member, members, nominal
from codegen.design.sampled import SampledCar, frequency_grid, sample
from codegen.units import KM_H

WARN_GAIN_MARGIN_DB = 6.0
WARN_PHASE_MARGIN_DEG = 30.0

Gains = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Speeds (n,) in m/s -> Kp in s and Ki, (n,) each."""

WEAKEST_SPEEDS = 160
"""Number of speeds in `weakest`, evenly spaced in their logarithm: at most 2 % apart from 15 to 400 km/h."""


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of loops, arrays of one shape. A loop that is unstable has 0 dB, 0 deg and an infinite sensitivity.

    Attributes:
        gain_margin_db: largest change of the loop's gain, up or down, whichever is less; inf where no change destabilises.
        phase_margin_deg: at the crossing of unit gain where it is smallest; inf where there is no such crossing.
        sensitivity: the peak of |1/(1 + L)| over frequency.
        stable: whether all poles of the closed loop lie inside the unit circle.
    """

    gain_margin_db: FloatArray
    phase_margin_deg: FloatArray
    sensitivity: FloatArray
    stable: BoolArray

    def figures(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gain margin, phase margin, sensitivity."""
        return self.gain_margin_db, self.phase_margin_deg, self.sensitivity


@dataclass(frozen=True)
class WorstMembers:
    """Member of the family with the worst margin of each kind, one for each speed."""

    gain_margin: tuple[Member, ...]
    phase_margin: tuple[Member, ...]
    sensitivity: tuple[Member, ...]


@dataclass(frozen=True)
class Weakest:
    """Smallest margins of the configured car over speed, and their speeds (m/s).

    The speeds can differ: `speed` is that of the margin nearer to its warning limit, or farther below it.
    `warns_from` and `unstable_from` are the lowest speeds (m/s) at which a margin is below its warning limit, and at which the
    loop is unstable; None if there is no such speed.
    """

    gain_margin_db: float
    phase_margin_deg: float
    gain_margin_speed: float
    phase_margin_speed: float
    warns_from: float | None = None
    unstable_from: float | None = None

    @property
    def speed(self) -> float:
        """Speed in m/s of the margin that is worse against its warning limit."""
        gain, phase = self.gain_margin_db / WARN_GAIN_MARGIN_DB, self.phase_margin_deg / WARN_PHASE_MARGIN_DEG
        return self.gain_margin_speed if gain < phase else self.phase_margin_speed

    @property
    def enough(self) -> bool:
        """Whether no margin is below its warning limit."""
        return self.gain_margin_db >= WARN_GAIN_MARGIN_DB and self.phase_margin_deg >= WARN_PHASE_MARGIN_DEG


def loop_margins(
    car: SampledCar, kp: npt.ArrayLike, ki: npt.ArrayLike, frequency: FloatArray, response: ComplexArray | None = None
) -> Margins:
    """Return margins of sampled cars (...) with gains that broadcast against (...), from a grid of frequencies (f,) in rad/s.

    `response` is `car.response(frequency)`, if already computed.
    """
    response = car.response(frequency) if response is None else response
    kp, ki = np.asarray(kp, dtype=np.float64)[..., np.newaxis], np.asarray(ki, dtype=np.float64)[..., np.newaxis]
    integral = car.sampling_time / -np.expm1(-1j * frequency * car.sampling_time)  # T z/(z - 1)
    loop = -(kp + ki * integral) * response
    shape = loop.shape[:-1]
    stable = car.closed_loop_stable(kp[..., 0], ki[..., 0])
    flat = loop.reshape(-1, frequency.size)
    gain_margin, phase_margin = _gain_margin(flat).reshape(shape), _phase_margin(flat).reshape(shape)
    # Without integral part the loop is real at zero frequency too.
    steady = np.where(ki[..., 0] == 0.0, -kp[..., 0] * car.steady_gain(), 0.0)
    with np.errstate(divide="ignore"):
        at_rest = np.where(steady < 0.0, np.abs(20.0 * np.log10(np.abs(steady))), np.inf)
        sensitivity = 1.0 / np.abs(1.0 + loop).min(axis=-1)
    return Margins(
        np.where(stable, np.minimum(gain_margin, at_rest), 0.0),
        np.where(stable, phase_margin, 0.0),
        np.where(stable, sensitivity, np.inf),
        stable,
    )


def _gain_margin(loop: ComplexArray) -> FloatArray:
    """Return gain margins in dB of loops (k, f), from the nearest crossing of the negative real axis, or the end at pi/T."""
    margin = np.full(loop.shape[0], np.inf)
    turned = (loop.imag[:, 1:] > 0.0) != (loop.imag[:, :-1] > 0.0)
    left = np.minimum(loop.real[:, 1:], loop.real[:, :-1]) < 0.0
    rows, cells = np.nonzero(turned & left)
    before, after = loop[rows, cells], loop[rows, cells + 1]
    change = np.log(after / before)
    angle = np.angle(-before)  # from the negative real axis
    crossing = angle * (angle + change.imag) <= 0.0
    share = np.divide(-angle, change.imag, out=np.zeros_like(angle), where=change.imag != 0.0)
    level = np.log(np.abs(before)) + share * change.real
    np.minimum.at(margin, rows[crossing], np.abs(level[crossing]))
    last = loop.real[:, -1]
    at_end = np.full(margin.shape, np.inf)
    np.log(-last, out=at_end, where=last < 0.0)
    result: FloatArray = 20.0 / np.log(10.0) * np.minimum(margin, np.abs(at_end))
    return result


def _phase_margin(loop: ComplexArray) -> FloatArray:
    """Return phase margins in deg of loops (k, f): the smallest angle from the negative real axis where the gain is one."""
    margin = np.full(loop.shape[0], np.inf)
    above = loop.real**2 + loop.imag**2 > 1.0
    rows, cells = np.nonzero(above[:, 1:] != above[:, :-1])
    before, after = loop[rows, cells], loop[rows, cells + 1]
    change = np.log(after / before)
    angle = np.angle(-before) - np.log(np.abs(before)) / change.real * change.imag
    np.minimum.at(margin, rows, np.abs((angle + np.pi) % (2.0 * np.pi) - np.pi))
    result: FloatArray = np.degrees(margin)
    return result


def nominal_margins(config: Config, speed: npt.ArrayLike, kp: npt.ArrayLike, ki: npt.ArrayLike) -> Margins:
    """Return margins (n,) of the configured car at speeds (n,) in m/s with gains (n,): Kp in s, Ki.

    The delay is `config.designed_delay_samples`.
    """
    frequency = frequency_grid(config.controller.sampling_time_s)
    found = loop_margins(sample(config, (nominal(config),), speed), kp, ki, frequency)
    return Margins(found.gain_margin_db[0], found.phase_margin_deg[0], found.sensitivity[0], found.stable[0])


def family_margins(
    config: Config, speed: npt.ArrayLike, kp: npt.ArrayLike, ki: npt.ArrayLike, *, slow: bool = False
) -> tuple[Margins, WorstMembers]:
    """Return the worst margins (n,) of the family at speeds (n,) in m/s with gains (n,), and the members that have them.

    Slow members (`Member.is_slow`), which need less margin, are left out; with `slow` only they count.

    Raises:
        ConfigError: the family is empty or too large (see `family.members`).
    """
    family = [member for member in members(config) if member.is_slow == slow]
    frequency = frequency_grid(config.controller.sampling_time_s)
    vx, kp, ki = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in (speed, kp, ki)))
    # One speed at a time: the whole family over the whole grid of speeds would take hundreds of MB.
    found = [worst_of(loop_margins(sample(config, family, vx[k]), kp[k], ki[k], frequency)) for k in range(vx.size)]
    which = np.array([which for _, which in found]).T
    return concatenate([margins for margins, _ in found]), WorstMembers(*(tuple(family[k] for k in row) for row in which))


def worst_of(margins: Margins) -> tuple[Margins, tuple[int, int, int]]:
    """Return the worst values (1,) of margins of any shape, and the flat index of each."""
    gain, phase, peak = margins.figures()
    which = int(gain.argmin()), int(phase.argmin()), int(peak.argmax())
    gain, phase, peak = (x.reshape(-1)[[place]] for x, place in zip(margins.figures(), which, strict=True))
    return Margins(gain, phase, peak, np.array([margins.stable.all()])), which


def concatenate(parts: Sequence[Margins]) -> Margins:
    """Join margins of parts (n_i,) to (n,)."""
    gain, phase, peak = (np.concatenate(column) for column in zip(*(part.figures() for part in parts), strict=True))
    return Margins(gain, phase, peak, np.concatenate([part.stable for part in parts]))


def gains_of(schedule: Schedule) -> Gains:
    """Return the gains of a schedule over speed: linear between its breakpoints, constant beyond."""
    speed = np.array(schedule.speed_km_h) * KM_H
    kp, ki = np.array(schedule.proportional_gain_s), np.array(schedule.integral_gain)

    def gains(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.interp(at, speed, kp), np.interp(at, speed, ki)

    return gains


def margin_range_km_h(config: Config) -> tuple[float, float]:
    """Return the first and the last speed of all margins: from where control starts to the last designed speed.

    A schedule is designed up to the top speed. Fixed gains have no such end: without a top speed of the car, their margins are
    those at every speed that the controller accepts.
    """
    controller = config.controller
    is_designed = controller.kind == "tracking" or config.vehicle.top_speed_km_h is not None
    return _range(config, config.top_speed_km_h if is_designed else controller.inputs.speed_max_km_h)


def family_range_km_h(config: Config) -> tuple[float, float]:
    """Return the first and the last speed at which every car of the family must keep its margins."""
    return _range(config, min(config.grid.last_speed_km_h, config.top_speed_km_h))


def _range(config: Config, last: float) -> tuple[float, float]:
    _, first = config.controller.feedback_speeds_km_h
    return first, max(last, 1.2 * first)


def margin_speeds(config: Config) -> FloatArray:
    """Return the speeds (m/s) of the smallest margins, over `margin_range_km_h`."""
    first, last = margin_range_km_h(config)
    return np.geomspace(first * KM_H, last * KM_H, WEAKEST_SPEEDS)


def weakest(config: Config, gains: Gains) -> Weakest:
    """Return the smallest margins of the configured car over `margin_range_km_h`.

    The delay is `config.designed_delay_samples`. A build warns where they are below WARN_GAIN_MARGIN_DB or
    WARN_PHASE_MARGIN_DEG.

    Args:
        gains: speeds (n,) in m/s -> Kp, Ki (n,); `gains_of` returns it for a schedule.
    """
    speed = margin_speeds(config)
    margins = nominal_margins(config, speed, *gains(speed))
    gain, phase = int(margins.gain_margin_db.argmin()), int(margins.phase_margin_deg.argmin())
    little = (margins.gain_margin_db < WARN_GAIN_MARGIN_DB) | (margins.phase_margin_deg < WARN_PHASE_MARGIN_DEG)
    return Weakest(
        warns_from=_first(speed, little),
        unstable_from=_first(speed, ~margins.stable),
        gain_margin_db=float(margins.gain_margin_db[gain]),
        phase_margin_deg=float(margins.phase_margin_deg[phase]),
        gain_margin_speed=float(speed[gain]),
        phase_margin_speed=float(speed[phase]),
    )


def _first(speed: FloatArray, where: BoolArray) -> float | None:
    found = np.flatnonzero(where)
    return float(speed[found[0]]) if found.size else None
