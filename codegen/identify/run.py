"""The whole identification: actuator, steering, car; what is determined; the values that are kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.identify.drive import Drive
from codegen.identify.estimate import Fit, diverged, fit
from codegen.identify.identifiability import (
    WEAK_SHARE_MAX,
    Direction,
    Identifiability,
    analyse,
    undetermined_curves,
    with_held_spread,
)
from codegen.identify.model import OUTPUTS
from codegen.identify.parameters import BY_NAME, CURVE_PARAMETERS, HANDLING_PARAMETERS, PARAMETERS, Parameter, configured
from codegen.identify.shooting import DriveSamples, Problem, actuator_problem, filled, front_signal, vehicle_problem
from codegen.identify.start import actuator_start, starting_values

RELAXATION_START_M = 0.2
RATE_COST_MIN = 20.0
"""Smallest increase of the cost, when the rate limit is removed, that shows that the drives reached the limit: 6 standard
deviations. A limit that is not reached has no effect on the cost, so the curvature of the cost cannot show it."""
NO_SIDESLIP = (
    "no drive of `logs=` has sideslip: the common level of cornering stiffnesses and yaw inertia rests on the model, which "
    "leaves out roll; measure sideslip if a map is to keep its slip bounds exactly"
)
SPEED_FACTOR_CHANGE = 0.05
"""Deviation of the speed factor from 1 that no speed sensor has."""
ROUNDS_MAX = 3
"""Fits of the car with shifts and integration steps that follow from the last one."""


@dataclass(frozen=True)
class IdentifiedQuantity:
    """One quantity after the identification, SI units.

    Attributes:
        parameter: entry of the table.
        value: identified, or the configured value if it is not determined.
        standard_deviation: of the value; NaN if it counts as exact.
        configured: configured value.
        is_identified: whether the drives determine it. A value that they do not determine is the configured one.
        note: reason why not, with the manoeuvre that is missing; or a limit of the value.
    """

    parameter: Parameter
    value: float
    standard_deviation: float
    configured: float
    is_identified: bool
    note: str = ""

    @property
    def is_uncertain(self) -> bool:
        """Whether the value varies from car to car within its standard deviation."""
        return math.isfinite(self.standard_deviation)


@dataclass(frozen=True, eq=False)
class Identification:
    """Result.

    Attributes:
        config: given configuration.
        quantities: name -> quantity, all of `parameters.PARAMETERS`.
        names: names of the quantities in `correlation`.
        correlation: (k, k) of the uncertain quantities.
        directions: combinations that the drives do not determine.
        vehicle: fit of the car. actuator: fit of the actuator, None without its signals.
        notes: messages for the user.
    """

    config: Config
    quantities: dict[str, IdentifiedQuantity]
    names: tuple[str, ...]
    correlation: FloatArray
    directions: tuple[Direction, ...]
    vehicle: Fit
    actuator: Fit | None
    notes: tuple[str, ...]

    def values(self) -> dict[str, float]:
        """Return all values in SI."""
        return {name: quantity.value for name, quantity in self.quantities.items()}


def identify(config: Config, drives: Sequence[Drive]) -> Identification:
    """Identify a car from its drives.

    Args:
        config: known values, and what is assumed about the others.

    Raises:
        CodegenError: the drives cannot be used, or there is no C compiler.
    """
    samples = DriveSamples.of(drives)
    centre = configured(config)
    for name in ("vx", "yaw_rate"):
        if not samples.has(name):
            raise CodegenError(f"no drive has {name}", where="identify", remedy="name it in the signals")
    found: dict[str, IdentifiedQuantity] = {}
    notes: list[str] = []
    directions: list[Direction] = []

    actuator = _fit_actuator(samples, config, centre, found, directions)
    values = {**centre, **{name: quantity.value for name, quantity in found.items()}}
    rear = rear_angle(samples, config, values)
    if not samples.has("delta_r"):
        is_commanded = samples.has("delta_r_command")
        commanded = "it follows from the command and the configured actuator, which counts as exact"
        source = commanded if is_commanded else "the rear wheels count as straight"
        notes.append(f"no drive of `logs=` has delta_r: {source}")
    _fit_ratio(samples, centre, found)

    vehicle, judged = _fit_vehicle(samples, config, centre, rear, found)
    directions += judged.directions
    judge(vehicle, judged, centre, samples, found)
    for parameter in PARAMETERS:
        if parameter.name not in found:
            found[parameter.name] = _quantity(parameter, 0.0, math.nan, centre, False, _missing(parameter, samples))
    if not found["rear_offset"].is_identified and found["front_offset"].is_identified:
        front = found["front_offset"]
        deviation = math.hypot(front.standard_deviation, BY_NAME["rear_offset"].spread)
        note = "less that of the rear angle, which is not known: rear angle and its command were not measured together"
        found["front_offset"] = replace(front, standard_deviation=deviation, note=note)
    if not samples.has("sideslip"):
        notes.append(NO_SIDESLIP)
    factor = found["speed_factor"]
    if factor.is_identified and abs(factor.value - 1.0) > SPEED_FACTOR_CHANGE:
        notes.append(f"the speed factor is {factor.value:.2f}; check the configured wheelbase and mass, and the measured speed")
    used = vehicle.problem.segments.first
    for name, low, high in zip(samples.names, samples.begin[:-1], samples.begin[1:], strict=True):
        if not ((used >= low) & (used < high)).any():
            notes.append(f"{name} is not used for the car: it has no second with speed, yaw rate, front and rear angle")
    names, correlation = correlation_of(found, (vehicle, *(() if actuator is None else (actuator,))))
    ordered = {parameter.name: found[parameter.name] for parameter in PARAMETERS}
    identified = [{each.parameter.title} for each in found.values() if each.is_identified]
    left = {frozenset(each.components): each for each in reversed(directions) if each.components.keys() not in identified}
    return Identification(config, ordered, names, correlation, tuple(left.values())[::-1], vehicle, actuator, tuple(notes))


def judge(
    fitted: Fit, judged: Identifiability, centre: dict[str, float], samples: DriveSamples, found: dict[str, IdentifiedQuantity]
) -> None:
    """Add the quantities of a fit that are not found yet."""
    names, deviations = fitted.problem.prior.names, fitted.standard_deviations
    determined = {name for name, is_identified in zip(names, judged.is_identified, strict=True) if is_identified}
    shares = dict(zip(names, judged.shares.tolist(), strict=True))
    weak = {
        name
        for name in HANDLING_PARAMETERS
        if determined & set(HANDLING_PARAMETERS) and shares.get(name, 1.0) <= WEAK_SHARE_MAX
    } - determined
    # A parameter of a curve that is still free is identified with it. A held one keeps its assumed deviation.
    peaks = {name: curve[0] for curve in CURVE_PARAMETERS for name in curve}
    kept = {name for name, is_free in zip(names, fitted.free, strict=True) if is_free}
    for index, parameter in enumerate(fitted.problem.prior.parameters):
        name = parameter.name
        if name in found:
            continue
        note = "" if name in determined else _missing(parameter, samples)
        if name in peaks.keys() - kept and f"{name.partition('_')[0]}_stiffness" in kept & (determined | weak):
            note = f"as configured, with an assumed deviation; drive: {parameter.manoeuvre}"
            found[name] = IdentifiedQuantity(parameter, centre[name], float(deviations[index]), centre[name], False, note)
            continue
        if name in peaks.keys() & kept - determined:
            note = f"not determined alone, but as a part of its curve; alone: {parameter.manoeuvre}"
        if name in kept and (others := [other for other, peak in peaks.items() if peak == name and other not in kept]):
            titles = ", ".join(BY_NAME[other].title for other in others)
            note = f"with {titles} as configured; the deviation includes errors of these values"
        if name in weak:
            note = f"weakly determined; better with: {parameter.manoeuvre}"
        is_kept = name in kept & (determined | peaks.keys() | weak)
        found[name] = _quantity(parameter, fitted.values[index], deviations[index], centre, is_kept, note)


def _quantity(
    parameter: Parameter, value: float, deviation: float, centre: dict[str, float], is_identified: bool, note: str
) -> IdentifiedQuantity:
    before = centre[parameter.name]
    if not is_identified:
        return IdentifiedQuantity(parameter, before, math.nan, before, False, note)
    return IdentifiedQuantity(parameter, float(value), float(deviation), before, True, note)


def _missing(parameter: Parameter, samples: DriveSamples) -> str:
    for output in OUTPUTS:
        if parameter.name.startswith(output) and not samples.has(output):
            return f"{output} was not measured"
    if parameter.group == "actuator" and not np.isfinite(samples.signal("delta_r") + samples.signal("delta_r_command")).any():
        return "rear angle and its command were not measured together"
    if parameter.name == "steering_ratio" and not samples.has("steering_wheel_angle"):
        return "the angle of the steering wheel was not measured"
    return f"not determined by these drives; drive: {parameter.manoeuvre}"


def _fit_actuator(
    samples: DriveSamples,
    config: Config,
    centre: dict[str, float],
    found: dict[str, IdentifiedQuantity],
    directions: list[Direction],
) -> Fit | None:
    """Return the fit of the actuator; None without its signals."""
    problem = actuator_problem(samples, config, centre)
    if problem is None:
        return None
    start = actuator_start(problem, centre)
    names = problem.prior.names
    free = np.ones(len(names), dtype=bool)
    result = fit(problem, np.array([start[name] for name in names]), free)
    rate = names.index("actuator_rate")
    unlimited = result.values.copy()
    unlimited[rate] = problem.prior.parameters[rate].high
    without = fit(problem, unlimited, np.arange(len(names)) != rate, result.starts, result.noise)
    if without.cost(result.noise) - result.cost(result.noise) < RATE_COST_MIN:
        result, free = without, without.free
        directions.append(Direction(1.0, 0.0, {problem.prior.parameters[rate].title: 1.0}))
    judged = analyse(problem.prior.parameters, free, result.covariance, result.information)
    judge(result, judged, centre, samples, found)
    directions += judged.directions
    return result


def rear_angle(samples: DriveSamples, config: Config, values: dict[str, float]) -> FloatArray:
    """Return the rear angle (n,) in rad that drives the car: measured, or simulated from its command, or zero without both."""
    if samples.has("delta_r"):
        return samples.signal("delta_r") - values["rear_offset"]
    if not samples.has("delta_r_command"):
        return np.zeros(len(samples))
    command = samples.signal("delta_r_command")
    acting = samples.shifted("delta_r_command", -round(values["actuator_delay"] / samples.step))
    lag, limit = values["actuator_lag"], config.rear_actuator.angle_max
    step = values["actuator_rate"] * samples.step
    share = -math.expm1(-samples.step / lag)
    result = np.empty(len(samples))
    for low, high in pairwise(samples.begin):
        part = filled(acting[low:high])
        angle = part[0]
        for k, demand in enumerate(part.tolist()):
            result[low + k] = angle
            angle += min(max(share * (min(max(demand, -limit), limit) - angle), -step), step)
    return np.where(np.isfinite(command), result, math.nan)


def _fit_ratio(samples: DriveSamples, centre: dict[str, float], found: dict[str, IdentifiedQuantity]) -> None:
    """Fit the steering ratio where the angles of steering wheel and front wheels were measured together."""
    wheel, front = samples.signal("steering_wheel_angle"), samples.signal("delta_f")
    both = np.isfinite(wheel) & np.isfinite(front)
    parameter = BY_NAME["steering_ratio"]
    if not samples.has("delta_f"):
        return  # a parameter of the car's fit
    if not both.any():
        found["steering_ratio"] = _quantity(parameter, 0.0, math.nan, centre, False, _missing(parameter, samples))
        return
    columns = np.stack([front[both], np.ones(int(both.sum()))], axis=1)
    solution, *_ = np.linalg.lstsq(columns, wheel[both], rcond=None)
    residual = wheel[both] - columns @ solution
    # Residuals are coloured by the lag of the steering: sums over blocks of a second are independent.
    block = max(round(1.0 / samples.step), 1)
    scores = columns * residual[:, None]
    sums = np.add.reduceat(scores, np.arange(0, len(scores), block), axis=0)
    inverse = np.linalg.pinv(columns.T @ columns)
    deviation = math.sqrt(max((inverse @ (sums.T @ sums) @ inverse)[0, 0], 0.0))
    is_identified = solution[0] > 0.0 and deviation <= 0.1 * parameter.spread * solution[0]
    note = "" if is_identified else f"not determined by these drives; drive: {parameter.manoeuvre}"
    found["steering_ratio"] = _quantity(parameter, solution[0], deviation, centre, is_identified, note)


def _fit_vehicle(
    samples: DriveSamples, config: Config, centre: dict[str, float], rear: FloatArray, found: dict[str, IdentifiedQuantity]
) -> tuple[Fit, Identifiability]:
    """Return the fit, and what is determined.

    What a fit does not determine is held in the next one: quantities of the tyre curves, so that the stiffnesses belong to the
    curves that are written; and a relaxation length too short for the plant, which is added to `found` as zero. The covariance
    allows for the error of held curves. The directions are those of the first fit.
    """
    front, is_wheel = front_signal(samples, config)
    # The angle of the front wheels needs no ratio; that of the steering wheel does.
    centre = centre if is_wheel else {**centre, "steering_ratio": 1.0}
    values = {**centre, "relaxation_length": centre["relaxation_length"] or RELAXATION_START_M}
    problem = vehicle_problem(samples, config, centre, {**values, "relaxation_length": 0.0}, rear)
    values = starting_values(problem, config, values, front / centre["steering_ratio"], rear)
    free = _free(problem, samples, is_wheel)
    relaxation = BY_NAME["relaxation_length"]
    names = problem.prior.names
    index = names.index(relaxation.name)
    first: Identifiability | None = None
    while True:
        result = _converge(samples, config, centre, values, rear, free)
        judged = analyse(problem.prior.parameters, free, result.covariance, result.information)
        first = first or judged
        held = {name: centre[name] for name in undetermined_curves(result, judged, config)}
        if judged.is_identified[index] and result.values[index] <= relaxation.low * (1.0 + 1e-6):
            note, deviation = f"below {relaxation.low:g} m, which counts as none", float(result.standard_deviations[index])
            found[relaxation.name] = _quantity(relaxation, 0.0, deviation, centre, True, note)
            held[relaxation.name] = 0.0
        if not held:
            curves = np.array([any(name in curve for curve in CURVE_PARAMETERS) for name in names])
            return with_held_spread(result, curves & ~free), replace(judged, directions=first.directions)
        free = free & [name not in held for name in names]
        centre, values = {**centre, **held}, {**result.named(), **held}


def _free(problem: Problem, samples: DriveSamples, is_wheel: bool) -> BoolArray:
    free = np.ones(len(problem.prior.names), dtype=bool)
    for index, name in enumerate(problem.prior.names):
        for output in OUTPUTS:
            if name.startswith(f"{output}_"):
                free[index] = samples.has(output)
    free[problem.prior.names.index("steering_ratio")] = is_wheel
    return free


def _converge(
    samples: DriveSamples, config: Config, centre: dict[str, float], values: dict[str, float], rear: FloatArray, free: BoolArray
) -> Fit:
    """Fit until whole-sample shifts and integration steps no longer change."""
    result = None
    for _ in range(ROUNDS_MAX):
        problem = vehicle_problem(samples, config, centre, values, rear)
        if result is not None and _same(problem, result.problem):
            break
        before = (None, None) if result is None else (result.starts, result.noise)
        try:
            result = fit(problem, np.array([values[name] for name in problem.prior.names]), free, *before)
        except np.linalg.LinAlgError:  # derivatives beyond all numbers
            raise diverged() from None
        values = result.named()
    assert result is not None
    return result


def _same(first: Problem, second: Problem) -> bool:
    return first.substeps <= second.substeps and bool((first.constants == second.constants).all())


def correlation_of(found: dict[str, IdentifiedQuantity], fits: Sequence[Fit]) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and correlation of the uncertain quantities; zero between quantities of different fits."""
    names = tuple(parameter.name for parameter in PARAMETERS if found[parameter.name].is_uncertain)
    result = np.eye(len(names))
    for one in fits:
        deviation = np.sqrt(np.diag(one.covariance))
        at = {name: k for k, name in enumerate(one.problem.prior.names) if deviation[k]}
        for i, first in enumerate(names):
            for j, second in enumerate(names):
                if i != j and first in at and second in at:
                    a, b = at[first], at[second]
                    result[i, j] = one.covariance[a, b] / (deviation[a] * deviation[b])
    return names, result
