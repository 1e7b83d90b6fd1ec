"""Deviations of the identified values, grown by the error of the model that predicted drives show.

The covariance of `estimate` counts the errors of the drives as noise, of which a mean over thousands of samples is nearly free.
An error of the model is no noise: it moves with the car, as the outputs do when a value changes, so all samples together say
no more about it than one. Let the identified car predict an output of another drive with the model error e, a fraction of that
output (root mean square). A change of the values that moves the output by the same fraction is then within one standard
deviation. With S the curvature of the data by one output and P the sum of its squared measured values, both over the squared
noise, the sum of S / (e^2 P) over the outputs is the information of one such observation each. Its inverse is added.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from codegen.identify.estimate import information_of_outputs
from codegen.identify.model import OUTPUTS
from codegen.identify.run import Identification, correlation_of
from codegen.identify.validation import Validation, model_errors

ERROR_FACTOR = 1.25
"""Error of the model in all drives over that in those that are predicted, which need not show the largest one. With it, the
intervals of foreign cars contain the truth: `python -m benchmarks identify --plants foreign`."""

ERROR_MAX = 0.9
"""Largest error of the model that counts. With a larger one, nothing is predicted, and a doubt says so."""


def model_error(validations: Sequence[Validation]) -> tuple[float, float]:
    """Return the error of the model, relative to its outputs, and that of the lateral acceleration alone.

    The largest one of the outputs counts for all: an error that shows in one of them can hide in the noise of another.
    """
    errors = model_errors(validations)
    largest = float(np.nanmax(errors)) if np.isfinite(errors).any() else 0.0
    acceleration = float(errors[OUTPUTS.index("lateral_acceleration")])
    of_acceleration = acceleration if math.isfinite(acceleration) else largest
    return min(ERROR_FACTOR * largest, ERROR_MAX), min(of_acceleration, ERROR_MAX)


def with_model_error(found: Identification, error: float) -> Identification:
    """Return the identification with deviations and correlations that allow for an error of the model, see `model_error`."""
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
