"""Errors of the identified car when it predicts a drive: free run, one step ahead, and whiteness of the residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError, within
from codegen.identify.drive import Drive
from codegen.identify.model import OUTPUTS
from codegen.identify.parameters import configured
from codegen.identify.run import Identification, rear_angle
from codegen.identify.shooting import DriveSamples, front_signal, vehicle_problem

BEGIN_S = 1.0
"""Time in s from the start of a run that is not compared: its initial lateral speed is a guess, which a car soon forgets."""
LAGS_S = 0.2
"""Lags of the whiteness test in s."""
MOVED_MIN = 3.0
"""Least size of an output in a drive, as a multiple of its noise, with which the drive shows an error of the model."""
WHITE_P_MIN = 0.01
"""Residuals count as white if white noise has a larger correlation with at least this probability."""


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box test of residuals (G. M. Ljung, G. E. P. Box, On a measure of lack of fit in time series models, 1978).

    Attributes:
        first: autocorrelation at a lag of one sample. statistic: Q. lags: number of lags.
        probability: that white residuals have a larger Q.
    """

    first: float
    statistic: float
    lags: int
    probability: float

    @property
    def is_white(self) -> bool:
        """Whether the residuals may be white noise."""
        return self.probability >= WHITE_P_MIN


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A drive simulated from measured speed and steering angles alone.

    Attributes:
        time: (n,) s. measured, simulated: (n, outputs of `model.OUTPUTS`), NaN where there is none.
        yaw_rate_error: root mean square of the free run's error, rad/s. one_step_error: root mean square of the error one
        sample ahead, from the measured yaw rate plus the simulated change, rad/s.
        yaw_rate_size: root mean square of the measured yaw rate without its mean, rad/s.
        largest: largest error of the yaw rate, rad/s.
        acceleration_error: root mean square of the error of the lateral acceleration, m/s^2; NaN if not measured.
    """

    time: FloatArray
    measured: FloatArray
    simulated: FloatArray
    yaw_rate_error: float
    one_step_error: float
    yaw_rate_size: float
    largest: float
    acceleration_error: float


@dataclass(frozen=True, eq=False)
class Validation:
    """Prediction of one drive by the identified and by the configured car; whiteness of the former's errors by output."""

    name: str
    identified: FreeRun
    configured: FreeRun
    whiteness: dict[str, Whiteness]


def validate(found: Identification, drive: Drive) -> Validation:
    """Return how well the identified car predicts a drive, best one that it was not identified from.

    Raises:
        CodegenError: the drive lacks a signal, or is too slow or short.
    """
    samples = DriveSamples.of([drive])
    with within(drive.name):
        identified = free_run(samples, found.config, found.values())
        before = free_run(samples, found.config, configured(found.config))
    errors = identified.measured - identified.simulated
    white = {name: whiteness(errors[:, k], samples.step) for k, name in enumerate(OUTPUTS) if np.isfinite(errors[:, k]).any()}
    return Validation(drive.name, identified, before, white)


def free_run(samples: DriveSamples, config: Config, values: dict[str, float]) -> FreeRun:
    """Simulate each uninterrupted part of a drive from its measured inputs. Raises CodegenError, see `validate`."""
    _, is_wheel = front_signal(samples, config)
    values = values if is_wheel else {**values, "steering_ratio": 1.0}
    rear = rear_angle(samples, config, values)
    problem = vehicle_problem(samples, config, values, values, rear, segment_s=math.inf)
    output = problem.simulation(np.array([values[name] for name in problem.prior.names]), problem.starts).output()
    measured, count = problem.measured.copy(), round(BEGIN_S / samples.step)
    one_step = np.full(len(output), math.nan)
    for low, high in pairwise(problem.segments.offsets):
        measured[low : low + count] = math.nan
        one_step[low + 1 : high] = np.diff((measured - output)[low:high, 0])
    error = measured - output
    if not np.isfinite(error[:, 0]).any():
        raise CodegenError(f"no part is longer than {BEGIN_S:g} s", remedy="name a longer drive")

    def rms(values: FloatArray) -> float:
        known = values[np.isfinite(values)]
        return float(np.sqrt(np.mean(known**2))) if known.size else math.nan

    return FreeRun(
        np.asarray(samples.step * problem.segments.rows, dtype=np.float64),
        measured,
        output,
        rms(error[:, 0]),
        rms(one_step),
        float(np.nanstd(measured[:, 0])),
        float(np.nanmax(np.abs(error[:, 0]))),
        rms(error[:, 1]),
    )


def whiteness(residuals: FloatArray, step: float) -> Whiteness:
    """Test residuals (n,), NaN where there is none, of a uniform grid of `step` s."""
    from scipy.stats import chi2

    known = np.isfinite(residuals)
    count = int(known.sum())
    centred = np.where(known, residuals - (np.nanmean(residuals) if count else 0.0), 0.0)
    lags = max(min(round(LAGS_S / step), count // 4), 1)
    power = float(centred @ centred)
    if power == 0.0:
        return Whiteness(0.0, 0.0, lags, 1.0)
    correlation = np.array([float(centred[k:] @ centred[:-k]) / power for k in range(1, lags + 1)])
    statistic = count * (count + 2.0) * float((correlation**2 / (count - np.arange(1, lags + 1))).sum())
    return Whiteness(float(correlation[0]), statistic, lags, float(chi2.sf(statistic, lags)))


def model_errors(validations: Sequence[Validation]) -> FloatArray:
    """Return the error of the model in each output (outputs,) of predicted drives, root mean square over that of the output.

    The error of the free run has the noise of the sensors, too. Its change from sample to sample, over the root of two, is that
    noise. Errors that are white are noise alone. NaN: not measured, or hardly moved.
    """
    excess, moved = np.zeros(len(OUTPUTS)), np.zeros(len(OUTPUTS))
    for each in validations:
        run = each.identified
        errors = run.measured - run.simulated
        for k, name in enumerate(OUTPUTS):
            if name not in each.whiteness:
                continue
            noise = 0.5 * float(np.nanmean(np.diff(errors[:, k]) ** 2))
            count, size = int(np.isfinite(errors[:, k]).sum()), float(np.nanvar(run.measured[:, k]))
            if size < MOVED_MIN**2 * noise:
                continue
            moved[k] += count * size
            if not each.whiteness[name].is_white:
                excess[k] += count * max(float(np.nanmean(errors[:, k] ** 2)) - noise, 0.0)
    known = moved > 0.0
    return np.where(known, np.sqrt(excess / np.where(known, moved, 1.0)), math.nan)


def validate_fitted(found: Identification, drives: Sequence[Drive]) -> list[Validation]:
    """Return how well the identified car predicts the drives that it was identified from, without those that were not used."""
    used = found.vehicle.problem
    rows = used.samples.begin
    counts = np.histogram(used.segments.first, rows)[0]
    return [validate(found, drive) for drive, count in zip(drives, counts, strict=True) if count]
