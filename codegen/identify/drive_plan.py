"""A measurement programme: the drives with the least uncertainty within limits, and what they determine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.identify.candidates import AMPLITUDE_LEVELS, Candidate, library
from codegen.identify.identifiability import DETERMINED_SHARE_MAX, Direction, analyse
from codegen.identify.information import Information, information_of
from codegen.identify.model import OUTPUTS
from codegen.identify.names import Names
from codegen.identify.parameters import CURVE_PARAMETERS, PARAMETERS, Parameter, Prior, configured
from codegen.units import KM_H

_EXCHANGES_MAX = 100
_GAIN_MIN = 1e-6
"""Least improvement of the criterion by an exchange."""
_TIME_TOLERANCE_S = 1e-9

BENCH_SIGNALS = ("vx", "yaw_rate", "lateral_acceleration", "delta_f", "delta_r", "delta_r_command")
"""Quantities on the bus of the bench."""
HIGHER_LIMITS = 4
"""Number of lateral accelerations, evenly spaced up to the grip, that are tried for what the programme does not determine."""

NEEDED_SHARE = 0.7 * DETERMINED_SHARE_MAX
"""Largest standard deviation, as a fraction of that before, with a drive that is named as needed: the identification estimates
it with some scatter."""


@dataclass(frozen=True)
class Predicted:
    """Prediction of a programme for one quantity.

    Attributes:
        parameter: entry of the table. value: configured value in SI.
        share: predicted standard deviation over that before the drives; 1 where the signals do not contain the quantity.
        standard_deviation: in SI.
        is_determined: whether the identification takes its value.
        need: what it needs, if it is not determined; else empty.
    """

    parameter: Parameter
    value: float
    share: float
    standard_deviation: float
    is_determined: bool
    need: str


@dataclass(frozen=True, eq=False)
class DrivePlan:
    """A programme.

    Attributes:
        config: configured car. signals: measured quantities.
        lateral_acceleration_max: m/s^2.
        drives: its drives, in order; a drive may occur several times.
        information: that of these drives.
        quantities: predictions, in the order of `parameters.PARAMETERS`.
    """

    config: Config
    signals: tuple[str, ...]
    lateral_acceleration_max: float
    drives: tuple[Candidate, ...]
    information: Information
    quantities: tuple[Predicted, ...]

    @property
    def duration(self) -> float:
        """Duration of all drives in s."""
        return sum(each.duration for each in self.drives)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each drive, for files: number, manoeuvre, speed in km/h."""
        return tuple(
            f"{number:02d}-{each.manoeuvre.name}-{each.speed / KM_H:.0f}" for number, each in enumerate(self.drives, start=1)
        )

    @cached_property
    def directions(self) -> tuple[Direction, ...]:
        """Combinations that the programme does not determine."""
        total = self.information.each.sum(axis=0)
        free = np.ones(len(total), dtype=bool)
        return analyse(self.information.parameters, free, covariance_of(total), total).directions


def covariance_of(information: FloatArray) -> FloatArray:
    """Return the covariance (..., k, k) in units of the prior, after drives of an information."""
    return np.asarray(np.linalg.inv(np.eye(information.shape[-1]) + information), dtype=np.float64)


def shares_of(information: FloatArray) -> FloatArray:
    """Return the standard deviations (..., k) over those before, after drives of an information."""
    return np.asarray(np.sqrt(np.diagonal(covariance_of(information), axis1=-2, axis2=-1)), dtype=np.float64)


def decisive(names: Sequence[str]) -> list[int]:
    """Return the place (k,) of the quantity that decides whether each is determined: D for a tyre curve, else itself."""
    leaders = {name: curve[0] for curve in CURVE_PARAMETERS for name in curve}
    return [names.index(leaders.get(name, name)) for name in names]


def signals_of(names: Names | None) -> tuple[str, ...]:
    """Return the quantities that will be measured: those that a names.toml names, else those on the bus of the bench.

    Raises:
        CodegenError: speed, yaw rate or the front angle is missing.
    """
    without = () if names is None else names.without
    given = tuple(names.choices) if names is not None and names.choices else BENCH_SIGNALS
    signals = tuple(name for name in given if name not in without)
    for needed in (("vx",), ("yaw_rate",), ("delta_f", "steering_wheel_angle")):
        if not set(needed) & set(signals):
            raise CodegenError(f"{' or '.join(needed)} is not measured", where="`signals=`", remedy="name its signal")
    return signals


def of_interest(parameters: Sequence[Parameter]) -> BoolArray:
    """Return whether each quantity is one of the car, which has a key in ars.toml, and not of the sensors."""
    return np.array([bool(parameter.key) for parameter in parameters], dtype=bool)


def candidates_of(
    config: Config, lateral_acceleration_max: float, signals: Sequence[str], levels: Sequence[float] = AMPLITUDE_LEVELS
) -> tuple[list[Candidate], Information]:
    """Return the drives from which a programme is chosen, and their information; see `plan_drives`."""
    has_rear_command = bool({"delta_r", "delta_r_command"} & set(signals))
    found = library(config, lateral_acceleration_max, has_rear_command=has_rear_command, levels=levels)
    if not found:
        what = f"no drive of the library keeps {lateral_acceleration_max:g} m/s^2"
        raise CodegenError(what, where="`lateral_acceleration_max=`", remedy="raise it, or check the configured car")
    return found, information_of([each.drive for each in found], config, signals)


def plan_drives(
    config: Config, lateral_acceleration_max: float, duration_max: float, signals: Sequence[str] = BENCH_SIGNALS
) -> DrivePlan:
    """Return the programme for a car.

    Args:
        config: configured car, around whose values the information holds.
        lateral_acceleration_max: m/s^2, of any drive.
        duration_max: s, of all drives.
        signals: quantities that are measured. Without a rear angle and its command the rear wheels stay straight.

    Raises:
        CodegenError: no drive keeps the limits, or fits into the duration; a sensor has no noise.
        BuildError: there is no C compiler.
    """
    candidates, information = candidates_of(config, lateral_acceleration_max, signals)
    durations = np.array([each.duration for each in candidates])
    if durations.min() > duration_max:
        what = f"{duration_max:g} s is less than the shortest drive, {durations.min():g} s"
        raise CodegenError(what, where="`duration=`", remedy="make it longer")
    chosen = select(information.each, durations, of_interest(information.parameters), duration_max)
    chosen = sorted(chosen, key=lambda k: (candidates[k].manoeuvre.front is not None, candidates[k].speed, k))
    total = information.each[chosen].sum(axis=0)
    needs = _needs(config, lateral_acceleration_max, signals, information, total)
    return DrivePlan(
        config,
        tuple(signals),
        lateral_acceleration_max,
        tuple(candidates[k] for k in chosen),
        Information(information.parameters, information.each[chosen]),
        _predicted(config, information.parameters, total, needs),
    )


def _predicted(
    config: Config, parameters: Sequence[Parameter], total: FloatArray, needs: dict[str, str]
) -> tuple[Predicted, ...]:
    names, values = [parameter.name for parameter in parameters], configured(config)
    shares = shares_of(total)
    slopes = Prior.of(tuple(names), values).slope(np.array([values[name] for name in names]))
    is_determined = shares[decisive(names)] <= DETERMINED_SHARE_MAX
    known = {
        name: (float(share), float(share * slope), bool(determined))
        for name, share, slope, determined in zip(names, shares, slopes, is_determined, strict=True)
    }
    unknown = 1.0, math.nan, False
    return tuple(
        Predicted(each, values[each.name], *known.get(each.name, unknown), needs.get(each.name) or _signal_needed(each, known))
        for each in PARAMETERS
    )


def _signal_needed(parameter: Parameter, known: dict[str, tuple[float, float, bool]]) -> str:
    """Return the signal that a quantity needs; empty if it has it."""
    if parameter.name in known:
        return ""
    output = next((each for each in OUTPUTS if parameter.name.startswith(each)), None)
    if output is not None:
        return f"{output} is not measured"
    if parameter.group == "actuator":
        return "rear angle and its command are not both measured"
    return "the angle of the steering wheel is not measured"


def _needs(
    config: Config, lateral_acceleration_max: float, signals: Sequence[str], information: Information, total: FloatArray
) -> dict[str, str]:
    """Return the remedy for each quantity that a programme with the information `total` (k, k) leaves undetermined: more time,
    or the additional drive that determines it at the lowest lateral acceleration."""
    names, deciding = information.names, decisive(information.names)
    missing = [k for k in range(len(names)) if shares_of(total)[deciding[k]] > DETERMINED_SHARE_MAX]
    found: dict[str, str] = {}
    with_all = shares_of(total + information.each.sum(axis=0))
    found |= {names[k]: "more time" for k in missing if with_all[deciding[k]] <= NEEDED_SHARE}
    grip = config.road.friction * config.road.gravity_m_s2
    for limit in np.linspace(lateral_acceleration_max, grip, HIGHER_LIMITS + 1)[1:].tolist():
        open_ = [k for k in missing if names[k] not in found]
        if not open_ or limit <= lateral_acceleration_max:
            break
        candidates, more = candidates_of(config, limit, signals, levels=AMPLITUDE_LEVELS[:1])
        shares = shares_of(total + more.each)
        for k in open_:
            best = int(np.argmin(shares[:, deciding[k]]))
            if shares[best, deciding[k]] <= NEEDED_SHARE:
                one = candidates[best]
                acceleration = f"{one.largest_acceleration:.1f} m/s^2"
                found[names[k]] = f"{one.manoeuvre.title} at {one.speed / KM_H:.0f} km/h up to {acceleration}"
    text = "no drive of the library within the grip; {}"
    return {**{names[k]: text.format(information.parameters[k].manoeuvre) for k in missing}, **found}


def criterion(information: FloatArray, of_interest: BoolArray) -> FloatArray:
    """Return the information gain of drives in nats: half the logarithm of the ratio of the determinants.

    It is Bayesian D_s-optimality (A. C. Atkinson, A. N. Donev, R. D. Tobias, Optimum Experimental Designs, with SAS, chapters
    10 and 18) for the car's own quantities; errors of the sensors count only where they increase the uncertainty of these.
    Unlike the trace of the covariance, the determinant does not depend on the scale of the quantities, and quantities that no
    drive within the limits determines do not dominate it.

    Args:
        information: (..., k, k) of drives, in units of the prior.
        of_interest: (k,) whether a quantity counts.
    """
    known = np.eye(len(of_interest)) + information
    others = np.flatnonzero(~of_interest)
    whole = np.linalg.slogdet(known)[1]
    result: FloatArray = 0.5 * (whole - np.linalg.slogdet(known[..., others[:, None], others])[1])
    return result


def select(each: FloatArray, durations: FloatArray, of_interest: BoolArray, duration_max: float) -> list[int]:
    """Return the drives of a programme, in increasing order; a drive may be repeated.

    The drive that gains most in its time is added until none fits. Then drives are exchanged while that helps
    (V. V. Fedorov, Theory of Optimal Experiments, 1972). Drives are added again in the time that an exchange leaves.

    Args:
        each: (drives, k, k) information in units of the prior. durations: (drives,) s.
        of_interest: (k,) whether a quantity counts.
        duration_max: s, of the programme.
    """
    chosen = _filled([], each, durations, of_interest, duration_max)
    for _ in range(_EXCHANGES_MAX):
        better = _exchanged(chosen, each, durations, of_interest, duration_max)
        if better is None:
            break
        chosen = _filled(better, each, durations, of_interest, duration_max)
    return sorted(chosen)


def _filled(
    chosen: list[int], each: FloatArray, durations: FloatArray, of_interest: BoolArray, duration_max: float
) -> list[int]:
    """Return the drives, with others in the time that is left."""
    chosen = list(chosen)
    while True:
        left = duration_max - durations[chosen].sum() + _TIME_TOLERANCE_S
        fitting = np.flatnonzero(durations <= left)
        if not fitting.size:
            return chosen
        total = each[chosen].sum(axis=0)
        gains = (criterion(total + each[fitting], of_interest) - criterion(total, of_interest)) / durations[fitting]
        chosen.append(int(fitting[np.argmax(gains)]))


def _exchanged(
    chosen: list[int], each: FloatArray, durations: FloatArray, of_interest: BoolArray, duration_max: float
) -> list[int] | None:
    """Return the drives after the best exchange of one of them; None if none improves the criterion."""
    total, time = each[chosen].sum(axis=0), durations[chosen].sum()
    best, result = float(criterion(total, of_interest)) + _GAIN_MIN, None
    for place in range(len(chosen)):
        out = chosen[place]
        if out in chosen[:place]:
            continue
        fitting = np.flatnonzero(durations <= duration_max - time + durations[out] + _TIME_TOLERANCE_S)
        reached = criterion(total - each[out] + each[fitting], of_interest)
        k = int(np.argmax(reached))
        if reached[k] > best:
            best, result = float(reached[k]), [*chosen[:place], int(fitting[k]), *chosen[place + 1 :]]
    return result
