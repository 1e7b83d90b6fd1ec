"""An identification with what its drives show about it: ranges, forces, predictions, grown deviations and doubts.

Doubts are written into `[identified]`. Commands that use the deviations reject the file until a key accepts the doubts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from codegen.configuration import Config
from codegen.identify.drive import Drive
from codegen.identify.estimate import information_of_outputs
from codegen.identify.model import AXLES, OUTPUTS
from codegen.identify.parameters import BY_NAME, CURVE_PARAMETERS
from codegen.identify.reached import (
    PEAK_REACHED,
    AxleForce,
    Reached,
    axle_forces,
    exceeds_reached,
    linear_end,
    reached,
    slip_limit,
    tyres_of,
)
from codegen.identify.run import Identification, correlation_of, identify
from codegen.identify.validation import Validation, model_errors, validate, validate_fitted
from codegen.units import DEGREE

ERROR_FACTOR = 1.25
"""Error of the model in all drives over that in those that are predicted, which need not show the largest one. With it, the
intervals of foreign cars contain the truth: `python -m benchmarks identify --plants foreign`."""

_ERROR_MAX = 0.9
"""Largest error of the model that counts. With a larger one, nothing is predicted, and a doubt says so."""

_SLIP_FACTOR_MAX = 1.01
"""Largest slip that a map uses over the slip that was driven: both are rounded, and simulated with noise."""
_FREE_RUN_FACTOR_MAX = 1.0
"""Largest ratio of the free run's error to the one-step error. For a correct model it is 0.71: both are noise. At one, the
error of the model is as large as the noise."""
_TINY = float(np.finfo(np.float64).tiny)
_TURNING, _FREE_RUN_SHARE_MAX = 1.0 * DEGREE, 0.15
"""Yaw rate (rms, rad/s) from which a drive shows whether it is predicted, and the fraction of it that is too large an error:
4 % for a multi-body car that rolls."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of an identification.

    Attributes:
        found: with deviations that allow for the model errors of `validations`.
        reached: ranges of the drives. forces: of front and rear axle.
        validations: predictions of the drives that were held out, or else of the identified ones. is_held_out: which of them.
        model_error: relative to the outputs, see `model_error`. doubts: a line for each.
    """

    found: Identification
    reached: Reached
    forces: tuple[AxleForce, AxleForce]
    validations: tuple[Validation, ...]
    is_held_out: bool
    model_error: float
    doubts: tuple[str, ...]


def identify_and_predict(config: Config, drives: Sequence[Drive], held_out: Sequence[Drive]) -> Outcome:
    """Identify a car from drives and predict those that are held out, or else the same. Raises CodegenError, see `identify`."""
    first = identify(config, drives)
    validations = tuple(validate(first, drive) for drive in held_out) or tuple(validate_fitted(first, drives))
    error, of_acceleration = model_error(validations)
    found = with_model_error(first, error)
    limits = reached(found.vehicle, config)
    forces = axle_forces(first.vehicle, found.vehicle.covariance, config, of_acceleration)
    return Outcome(found, limits, forces, validations, bool(held_out), error, tuple(doubts(found, limits, validations)))


def doubts(found: Identification, limits: Reached, validations: Sequence[Validation]) -> list[str]:
    """Return a line for each doubt.

    Args:
        limits: what the drives reached.
        validations: of drives that were held out, or else of the identified ones.
    """
    return [*_ends(found), *_beyond_the_drives(found, limits), *_predictions(validations)]


def _ends(found: Identification) -> Iterator[str]:
    """Yield each value at an end of its range."""
    for each in found.quantities.values():
        parameter = each.parameter
        if each.is_identified and (end := parameter.end_at(each.value)) is not None:
            shown = f"{end / parameter.size:.4g} {parameter.unit}".strip()
            yield f"{parameter.title} is at the end of its range, {shown}"


def _beyond_the_drives(found: Identification, limits: Reached) -> Iterator[str]:
    """Yield what of the tyres lies beyond the drives."""
    config = found.config
    tyres = tyres_of(config, found.values())
    for axle, curve, tyre, slip, friction, share in zip(
        AXLES, CURVE_PARAMETERS, tyres, limits.slip, limits.friction, limits.share, strict=True
    ):
        driven = f"the {slip / DEGREE:.1f} deg of slip that were driven"
        peak = found.quantities[curve[0]]
        if peak.is_identified and exceeds_reached(config.road.friction * peak.value, friction):
            yield f"{BY_NAME[curve[0]].title} is {peak.value:.3g}, where the drives reached a friction of {friction:.2f}"
        if peak.is_identified and share < PEAK_REACHED:
            where = f"at {tyre.peak_slip / DEGREE:.1f} deg" if np.isfinite(tyre.peak_slip) else "at no slip"
            yield f"the peak of the {axle} tyres, {where}, lies beyond {driven}"
        end = slip_limit(tyre, share, config) if config.limits.grip_use_max is not None else linear_end(tyre, config)
        if found.quantities[f"{axle}_stiffness"].is_identified and end > _SLIP_FACTOR_MAX * slip:
            yield f"the slip bound of the {axle} axle, {end / DEGREE:.1f} deg, lies beyond {driven}, where its map ends"


def _predictions(validations: Sequence[Validation]) -> Iterator[str]:
    """Yield a line for each kind of output that the identified car predicts worse than the noise allows, with its worst
    drive."""
    lost: list[tuple[float, str]] = []
    wrong: list[tuple[float, str]] = []
    coloured: list[tuple[float, str]] = []
    for each in validations:
        run = each.identified
        error, size = run.yaw_rate_error, run.yaw_rate_size
        ratio = error / max(run.one_step_error, _TINY)
        if error > _FREE_RUN_SHARE_MAX * max(size, _TURNING):
            text = (
                f"{each.name}: the free run of the identified car has an error of {error / DEGREE:.3g} deg/s, where "
                f"{size / DEGREE:.3g} deg/s were measured; check signs and units of all signals"
            )
            lost.append((error, text))
            continue
        if ratio > _FREE_RUN_FACTOR_MAX:
            text = f"{each.name}: the free run has {ratio:.2g} times the error of one step, where 0.71 times is noise"
            wrong.append((ratio, f"{text}: the model is wrong by more than that"))
        if names := [name.replace("_", " ") for name, test in each.whiteness.items() if not test.is_white]:
            coloured.append(
                (ratio, f"{each.name}: the errors of {', '.join(names)} are no white noise: they are errors of the model")
            )
    for found in (lost, wrong, coloured):
        if found:
            more = f" (and {len(found) - 1} more drives)" if len(found) > 1 else ""
            yield f"{max(found)[1]}{more}"


def model_error(validations: Sequence[Validation]) -> tuple[float, float]:
    """Return the error of the model, relative to its outputs, and that of the lateral acceleration alone.

    The largest one of the outputs counts for all: an error that shows in one of them can hide in the noise of another.
    """
    errors = model_errors(validations)
    largest = float(np.nanmax(errors)) if np.isfinite(errors).any() else 0.0
    acceleration = float(errors[OUTPUTS.index("lateral_acceleration")])
    of_acceleration = acceleration if math.isfinite(acceleration) else largest
    return min(ERROR_FACTOR * largest, _ERROR_MAX), min(of_acceleration, _ERROR_MAX)


def with_model_error(found: Identification, error: float) -> Identification:
    """Return the identification with deviations and correlations that allow for an error of the model, see `model_error`.

    The covariance of `estimate` counts the errors of the drives as noise, whose mean over thousands of samples is nearly zero.
    An error of the model moves with the car, as the outputs do when a value changes, so all samples together hold no more
    information about it than one. Let the identified car predict an output of another drive with the model error e, a fraction
    of that output (root mean square). A change of the values that moves the output by the same fraction is then within one
    standard deviation. With S the curvature of the data by one output and P the sum of its squared measured values, both over
    the squared noise, the sum of S / (e^2 P) over the outputs is the information of one such observation each. Its inverse is
    added.
    """
    if error == 0.0:
        return found
    fitted = found.vehicle
    information, size = information_of_outputs(fitted)
    chosen = np.ix_(fitted.free, fitted.free)
    total = np.eye(int(fitted.free.sum()))
    for of_output, power in zip(information, size.tolist(), strict=True):
        if power > 0.0:
            total += of_output / (error**2 * power)
    added = np.linalg.inv(total)
    covariance = fitted.covariance.copy()
    covariance[chosen] += 0.5 * (added + added.T)
    grown = replace(fitted, covariance=covariance)
    deviations = dict(zip(fitted.problem.prior.names, grown.standard_deviations.tolist(), strict=True))
    quantities = {
        name: replace(each, standard_deviation=deviations[name]) if each.is_uncertain and name in deviations else each
        for name, each in found.quantities.items()
    }
    names, correlation = correlation_of(quantities, (grown, *(() if found.actuator is None else (found.actuator,))))
    return replace(found, quantities=quantities, names=names, correlation=correlation, vehicle=grown)
