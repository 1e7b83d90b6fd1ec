"""Speeds, accelerations, slip angles and forces that the drives of a fit reached, and the slip at which a map then ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.identify.estimate import Fit
from codegen.identify.model import AXLES, OUTPUTS
from codegen.identify.parameters import BY_NAME, CURVE_PARAMETERS
from codegen.vehicle.tyre import SLIP_SEARCH_MAX, MagicFormulaTyre, known_slip, static_wheel_loads

PEAK_QUANTILE = 0.999
"""Fraction of the samples that lie below a largest value."""
HELD_S = 0.5
"""Time in s for which slips and forces are held, as a mean. In a fast sweep the body rolls, which the model takes for force of
the tyres: 20 % of it at 3 Hz."""
PEAK_REACHED = 0.99
"""Share of an axle's largest lateral force from which that force counts as reached."""
GRIP_REACHED_MIN = 0.05
"""Smallest share that counts."""
SLOPE_STEP = 0.01
"""Step of derivatives, in spreads of the quantities before the drives."""

FRICTION_FACTOR_MAX = 1.15
"""Largest D over the friction that the drives reached: a load sensitivity of -0.3 with 70 % of a wheel's load transferred."""


@dataclass(frozen=True)
class Reached:
    """Ranges that the drives reached.

    Attributes:
        speed: smallest and largest speed, m/s. lateral_acceleration: largest, m/s^2.
        slip: largest slip angle of front and rear axle, rad, held for HELD_S.
        friction: largest side force over load of both axles, held for HELD_S.
        share: largest side force over the peak of the identified tyres of both axles.
    """

    speed: tuple[float, float]
    lateral_acceleration: float
    slip: tuple[float, float]
    friction: tuple[float, float]
    share: tuple[float, float]


@dataclass(frozen=True)
class AxleForce:
    """Figures that a map takes from the identified tyres of an axle, each with its standard deviation.

    Attributes:
        force: largest side force of the axle in the drives, N.
        slip_limit: slip angle in rad at which the map ends: where the force is `limits.grip_use_max` of the largest known one,
            or at the end of the linear range without that key, or where the drives ended; NaN if there is no end.
    """

    force: float
    force_deviation: float
    slip_limit: float
    slip_limit_deviation: float


def reached(fitted: Fit, config: Config) -> Reached:
    """Return what the drives of a fit of the car reached, as simulated. Peaks are those of PEAK_QUANTILE of the samples."""
    problem, vehicle = fitted.problem, config.vehicle
    named = fitted.named()
    values = {**named, **{f"{output}_{kind}": 0.0 for output in OUTPUTS for kind in ("offset", "delay")}}
    values["lateral_acceleration_factor"] = 1.0
    count = problem.model.constants.index("friction") + 1
    constants = problem.constants.copy()
    constants[count:] = 0.0
    simulation = problem.simulation(np.array([values[name] for name in problem.prior.names]), fitted.starts)
    output = replace(simulation, constants=constants).output()
    rows = problem.segments.rows
    samples = problem.samples
    speed = (samples.signal("vx")[rows] - values["speed_offset"]) / values["speed_factor"]
    inputs = problem.inputs(0.0).reshape(len(samples), problem.substeps * 3, -1)[rows, 0]
    front = inputs[:, 1] / values["steering_ratio"] - values["front_offset"]
    lateral = speed * np.tan(output[:, 2])
    arms = vehicle.cg_to_front_axle_m, vehicle.cg_to_rear_axle_m
    slips = (
        np.arctan((lateral + arms[0] * output[:, 0]) / speed) - front,
        np.arctan((lateral - arms[1] * output[:, 0]) / speed) - inputs[:, 2],
    )
    yaw_acceleration = np.concatenate(
        [np.gradient(output[low:high, 0], samples.step) for low, high in pairwise(problem.segments.offsets)]
    )
    turning = values["yaw_inertia"] * yaw_acceleration
    forces = (
        (vehicle.mass_kg * output[:, 1] * arms[1] + turning) / vehicle.wheelbase,
        (vehicle.mass_kg * output[:, 1] * arms[0] - turning) / vehicle.wheelbase,
    )

    compared = np.isfinite(problem.measured[:, 0])  # without the first samples of a segment, whose initial state is free

    parts = [slice(low + int(np.argmax(compared[low:high])), high) for low, high in pairwise(problem.segments.offsets)]
    length = max(round(HELD_S / samples.step), 1)

    def peak(signal: FloatArray) -> float:
        means = [held_means(signal[part], length) for part in parts]
        return float(np.quantile(np.abs(np.concatenate(means)), PEAK_QUANTILE))

    loads = static_wheel_loads(config)
    slip = peak(slips[0]), peak(slips[1])
    tyres = tyres_of(config, named)
    return Reached(
        (float(speed.min()), float(speed.max())),
        float(np.quantile(np.abs(output[compared, 1]), PEAK_QUANTILE)),
        slip,
        (peak(forces[0]) / (2.0 * loads[0]), peak(forces[1]) / (2.0 * loads[1])),
        (tyres[0].use_at_slip(slip[0]), tyres[1].use_at_slip(slip[1])),
    )


def held_means(signal: FloatArray, length: int) -> FloatArray:
    """Return the means of a signal (n,) over each window of `length` samples; one over all of a shorter signal."""
    length = min(length, signal.size)
    summed = np.concatenate([[0.0], np.cumsum(signal)])
    return np.asarray((summed[length:] - summed[:-length]) / length, dtype=np.float64)


def tyres_of(config: Config, values: dict[str, float]) -> tuple[MagicFormulaTyre, MagicFormulaTyre]:
    """Return the tyres of front and rear axle with values (name -> SI) of the identified quantities."""
    found = []
    for axle, curve, load in zip(AXLES, CURVE_PARAMETERS, static_wheel_loads(config), strict=True):
        keys = {BY_NAME[name].key.rpartition(".")[2]: values[name] for name in (f"{axle}_stiffness", *curve)}
        tyre = getattr(config.tyre, axle).model_copy(update={**keys, "stiffness_factor_b_per_rad": None})
        found.append(MagicFormulaTyre.from_config(tyre, load, config.road.friction))
    return found[0], found[1]


def exceeds_reached(largest: float, friction: float) -> bool:
    """Return whether the largest friction of a curve is far above the one that the drives reached."""
    return largest > FRICTION_FACTOR_MAX * friction


def known_share(share: float) -> float:
    """Return the share of its largest force that an axle is known to carry, from the share that the drives reached."""
    return max(share, GRIP_REACHED_MIN) if share < PEAK_REACHED else 1.0


def axle_forces(fitted: Fit, grown: FloatArray, config: Config, error: float) -> tuple[AxleForce, AxleForce]:
    """Return forces and slip limits of front and rear axle with standard deviations.

    The force follows from the measured accelerations, and the slip limit from the tyre curve that carries it. Both have the
    error of the model itself too. Where the curve is flat, a small error of the force is a large one of the slip.

    Args:
        fitted: its covariance gives the errors of the sensors' factors.
        grown: (k, k) covariance with the error of the model, see `model_error`; it gives the errors of the tyre curves.
        error: of the model in the lateral acceleration, relative; see `model_error`.
    """
    prior, driven = fitted.problem.prior, reached(fitted, config)
    names, z, (low, high) = prior.names, prior.scaled(fitted.values), prior.bounds()
    scale = [names.index(name) for name in ("speed_factor", "lateral_acceleration_factor")]
    of_sensors = float(np.sqrt(np.diag(fitted.covariance)[scale]) @ prior.slope(fitted.values)[scale])
    tyres, axles = tyres_of(config, fitted.named()), []
    for axle, (tyre, load) in enumerate(zip(tyres, static_wheel_loads(config), strict=True)):
        share, carried = driven.share[axle], driven.share[axle] * _largest(tyre)
        slopes = np.zeros(z.size)
        for index in [names.index(name) for name in (f"{AXLES[axle]}_stiffness", *CURVE_PARAMETERS[axle])]:
            ends = [float(np.clip(z[index] + step, low[index], high[index])) for step in (-SLOPE_STEP, SLOPE_STEP)]
            limits = []
            for end in ends:
                values = prior.values(np.where(np.arange(z.size) == index, end, z))
                other = tyres_of(config, dict(zip(names, values.tolist(), strict=True)))[axle]
                limits.append(slip_limit(other, min(carried / _largest(other), 1.0) if share < PEAK_REACHED else 1.0, config))
            slopes[index] = (limits[1] - limits[0]) / (ends[1] - ends[0])
        force, limit = 2.0 * load * driven.friction[axle], slip_limit(tyre, share, config)
        ends = [slip_limit(tyre, share, config, 1.0 + side * error) for side in (-1.0, 1.0)]
        ends[1] = np.fmin(ends[1], max(driven.slip[axle], limit))  # the force at the largest slip was driven
        of_limit = math.sqrt(max(float(slopes @ grown @ slopes), 0.0))
        axles.append(
            AxleForce(force, force * math.hypot(of_sensors, error), limit, math.hypot(of_limit, 0.5 * (ends[1] - ends[0])))
        )
    return axles[0], axles[1]


def _largest(tyre: MagicFormulaTyre) -> float:
    """Return the largest force of a tyre in N at its static load, without shifts."""
    slip = min(tyre.peak_slip, SLIP_SEARCH_MAX)
    return float(tyre.force(slip + tyre.horizontal_shift)) - tyre.vertical_shift


def slip_limit(tyre: MagicFormulaTyre, share: float, config: Config, factor: float = 1.0) -> float:
    """Return the slip angle in rad at which a map ends, see `AxleForce`, if the drives reached a share of the tyre's peak.

    Args:
        factor: on the force at the limit, and on the departure from the linear range.
    """
    use, known = config.limits.grip_use_max, known_share(share)
    if use is not None:
        return tyre.slip_at_use(min(factor * use * known, 1.0))
    end, known = linear_end(tyre, config, factor), min(factor * known, 1.0)
    return end if known == 1.0 else float(np.fmin(end, known_slip(tyre, known)))


def linear_end(tyre: MagicFormulaTyre, config: Config, factor: float = 1.0) -> float:
    """Return the slip angle in rad at the end of the linear range, wherever the drives ended; NaN if there is no end.

    Args:
        factor: on the departure from the linear range.
    """
    try:
        return tyre.slip_bound(factor * config.limits.slip_departure_percent / 100.0)
    except ConfigError:
        return math.nan
