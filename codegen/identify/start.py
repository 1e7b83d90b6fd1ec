"""Starting point: understeer gradient from steady turns by linear least squares, and a scan of the rear axle's compliance."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.identify.shooting import DriveSamples, Problem, filled, steady_starts
from codegen.vehicle.tyre import static_wheel_loads

LATERAL_ACCELERATION_MAX = 4.0
"""Largest lateral acceleration of a linear car, m/s^2."""
STEADY_YAW_ACCELERATION = 0.05
"""Largest yaw acceleration of a steady turn, rad/s^2."""
SMOOTHING_S = 0.4
SAMPLES_MIN = 100
COMPLIANCES_DEG_PER_G = np.geomspace(0.8, 9.0, 12)
"""Slip angle of the rear axle per g that are tried: more than the range of road cars."""


def smoothed(samples: DriveSamples, signal: FloatArray, length: float) -> FloatArray:
    """Return the moving mean of a signal over `length` s, within each drive; NaN near gaps."""
    count = max(round(length / samples.step), 1) | 1
    result = np.full(signal.size, math.nan)
    for low, high in pairwise(samples.begin):
        if high - low > count:
            result[low:high] = np.convolve(signal[low:high], np.full(count, 1.0 / count), mode="same")
            result[low : low + count // 2] = result[high - count // 2 : high] = math.nan
    return result


def understeer_coefficient(samples: DriveSamples, config: Config, front: FloatArray, rear: FloatArray) -> float | None:
    """Return K in rad s^2/m from delta_f - delta_r = L r/vx + K vx r + constant in steady turns; None without any."""
    speed, yaw_rate, difference = (
        smoothed(samples, filled(signal), SMOOTHING_S)
        for signal in (samples.signal("vx"), samples.signal("yaw_rate"), front - rear)
    )
    change = smoothed(samples, np.gradient(yaw_rate, samples.step), SMOOTHING_S)
    acceleration = speed * yaw_rate
    with np.errstate(invalid="ignore"):
        steady = (
            (np.abs(change) < STEADY_YAW_ACCELERATION)
            & (speed > 5.0)
            & (np.abs(acceleration) < LATERAL_ACCELERATION_MAX)
            & np.isfinite(difference)
        )
    if steady.sum() < SAMPLES_MIN or float(np.ptp(acceleration[steady])) < 1.0:
        return None
    length = config.vehicle.wheelbase / speed[steady]
    columns = np.stack([acceleration[steady], np.ones(int(steady.sum())), length], axis=1)
    found, *_ = np.linalg.lstsq(columns, difference[steady] - length * yaw_rate[steady], rcond=1e-6)
    return float(found[0])


def starting_values(
    problem: Problem, config: Config, values: dict[str, float], front: FloatArray, rear: FloatArray
) -> dict[str, float]:
    """Return values with stiffnesses and yaw inertia from which the fit converges.

    Args:
        values: other quantities. front, rear: (n,) rad at the road wheels.
    """
    vehicle = config.vehicle
    gravity, mass = config.road.gravity_m_s2, vehicle.mass_kg
    inertia = mass * vehicle.cg_to_front_axle_m * vehicle.cg_to_rear_axle_m
    found = understeer_coefficient(problem.samples, config, front, rear)
    loads = static_wheel_loads(config)
    if found is None:
        front_compliance, rear_compliance = (
            load / gravity / values[f"{axle}_stiffness"] for load, axle in zip(loads, ("front", "rear"), strict=True)
        )
        found = front_compliance - rear_compliance
    known = np.isfinite(problem.measured)
    signals = problem.samples.signal("vx"), problem.samples.signal("yaw_rate"), rear
    best: tuple[float, dict[str, float]] | None = None
    for compliance in np.radians(COMPLIANCES_DEG_PER_G) / gravity:
        front_compliance = max(compliance + found, math.radians(0.5) / gravity)
        tried = {
            **values,
            "front_stiffness": loads[0] / gravity / front_compliance,
            "rear_stiffness": loads[1] / gravity / compliance,
            "yaw_inertia": inertia,
        }
        starts = steady_starts(config, tried, *signals)[problem.segments.first]
        vector = np.array([tried[name] for name in problem.prior.names])
        output = problem.simulation(vector, starts).output()
        error = np.where(known, output - problem.measured, 0.0)
        if not np.isfinite(error).all():
            continue
        cost = sum(
            math.log(1e-12 + float(np.mean(np.abs(error[known[:, k], k])))) for k in range(error.shape[1]) if known[:, k].any()
        )
        if best is None or cost < best[0]:
            best = cost, tried
    return values if best is None else best[1]


RATE_SHARE = 0.98


def actuator_start(problem: Problem, values: dict[str, float]) -> dict[str, float]:
    """Return values with the largest rate at which the angle was seen to move, if it is below the configured limit."""
    samples = problem.samples
    angle = smoothed(samples, filled(samples.signal("delta_r")), 3 * samples.step)
    window = max(round(0.05 / samples.step), 1)
    rates = np.abs(angle[window:] - angle[:-window]) / (window * samples.step)
    for edge in samples.begin[1:-1]:
        rates[max(edge - window, 0) : edge] = math.nan
    fastest = float(np.nanmax(rates)) if np.isfinite(rates).any() else 0.0
    if fastest <= 0.0:
        return values
    return {**values, "actuator_rate": min(values["actuator_rate"], RATE_SHARE * fastest)}
