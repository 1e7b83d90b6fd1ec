"""Fisher information of drives: the information of their measurements about the quantities, computed before they are driven.

The information of a drive is J' W J in units of the prior, with J the derivatives of the simulated outputs by the quantities
and W the inverse variance of their noise. The model, the segments with free initial states, and the averaging of the errors are
those of the identification (`shooting`, `estimate`). The information of several drives is the sum of their information.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.identify.drive import Drive
from codegen.identify.estimate import HUBER
from codegen.identify.model import OUTPUTS
from codegen.identify.parameters import BY_NAME, Parameter, configured
from codegen.identify.run import RELAXATION_START_M, rear_angle
from codegen.identify.shooting import DriveSamples, Problem, actuator_problem, front_signal, vehicle_problem
from codegen.units import DEGREE

SENSORS = {
    "vx": "speed",
    "delta_f": "front_angle",
    "yaw_rate": "yaw_rate",
    "delta_r": "rear_angle",
    "lateral_acceleration": "lateral_acceleration",
}
"""Quantity of a drive -> key of `[sensors]`."""
OTHER_NOISE = {"steering_wheel_angle": 0.1 * DEGREE, "sideslip": 0.1 * DEGREE}
"""Standard deviation in rad of the quantities that `[sensors]` does not have: common sensors."""
NOISE_SEED = 1
"""Seed of the noise at the inputs of the model."""


@dataclass(frozen=True, eq=False)
class Information:
    """Information of some drives.

    Attributes:
        parameters: (k,) quantities that the signals may determine.
        each: (drives, k, k) in units of the prior.
    """

    parameters: tuple[Parameter, ...]
    each: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(parameter.name for parameter in self.parameters)


def noise_of_sensors(config: Config, signals: Sequence[str]) -> dict[str, float]:
    """Return the standard deviation of one sample of each quantity in SI: noise and resolution of `[sensors]`.

    Args:
        signals: quantities that are measured.

    Raises:
        CodegenError: the sensor of one of them has neither.
    """
    result = dict(OTHER_NOISE)
    for quantity, key in SENSORS.items():
        sensor = getattr(config.sensors, key)
        noise = float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12.0)))
        result[quantity] = noise or 1.0
        if noise == 0.0 and quantity in signals:
            raise CodegenError(
                "it has neither noise nor resolution, so that any drive would determine everything",
                where=f"sensors.{key}",
                remedy="give the values of its data sheet",
            )
    return result


def information_of(drives: Sequence[Drive], config: Config, signals: Sequence[str]) -> Information:
    """Return the information of noise-free drives of the configured car.

    Args:
        drives: with the quantities of `candidates.Candidate`.
        signals: quantities that are measured.

    Raises:
        CodegenError: the signals lack speed, yaw rate or a front angle; a sensor has no noise; or there is no C compiler.
    """
    noise = noise_of_sensors(config, signals)
    centre = configured(config)
    samples = DriveSamples.of([_measured(drive, signals) for drive in drives])
    blocks = [_vehicle(samples, drives, config, centre, noise)]
    actuator = actuator_problem(samples, config, centre)
    if actuator is not None:
        blocks.append(_actuator(actuator, samples, centre, noise["delta_r"]))
    if samples.has("delta_f") and samples.has("steering_wheel_angle"):
        blocks.append(_ratio(samples, centre["steering_ratio"], noise))
    names = tuple(name for block_names, _ in blocks for name in block_names)
    each = np.zeros((len(drives), len(names), len(names)))
    at = 0
    for block_names, block in blocks:
        to = at + len(block_names)
        each[:, at:to, at:to] = block
        at = to
    return Information(tuple(BY_NAME[name] for name in names), each)


def _measured(drive: Drive, signals: Sequence[str]) -> Drive:
    """Return a drive with the quantities that are measured."""
    return replace(drive, signals={name: drive.signals[name] for name in signals})


_Block = tuple[tuple[str, ...], FloatArray]
"""Names of quantities (k,), and their information (drives, k, k)."""


def _vehicle(
    samples: DriveSamples, drives: Sequence[Drive], config: Config, centre: dict[str, float], noise: dict[str, float]
) -> _Block:
    _, is_wheel = front_signal(samples, config)
    centre = centre if is_wheel else {**centre, "steering_ratio": 1.0}
    values = {**centre, "relaxation_length": centre["relaxation_length"] or RELAXATION_START_M}
    rear = rear_angle(samples, config, values)

    def problem_of(samples: DriveSamples, rear: FloatArray) -> Problem:
        return vehicle_problem(samples, config, centre, values, rear)

    problem = problem_of(samples, rear)
    vector = np.array([values[name] for name in problem.prior.names])
    lateral_speed = np.concatenate([drive.signals["vx"] * np.tan(drive.signals["sideslip"]) for drive in drives])
    states = np.stack([lateral_speed, np.concatenate([drive.signals["yaw_rate"] for drive in drives])], axis=1)
    starts = states[problem.segments.first]
    free = np.array([_is_free(name, samples, is_wheel) for name in problem.prior.names])
    weight = 1.0 / _noise_of_errors(problem, vector, starts, rear, problem_of, noise)
    return _block(problem, vector, starts, weight, free)


def _is_free(name: str, samples: DriveSamples, is_wheel: bool) -> bool:
    if name == "steering_ratio":
        return is_wheel
    output = next((each for each in OUTPUTS if name.startswith(f"{each}_")), None)
    return output is None or samples.has(output)


def _block(problem: Problem, values: FloatArray, starts: FloatArray, weight: FloatArray, free: BoolArray) -> _Block:
    """Return the information of each drive about the free parameters, the initial states eliminated.

    Args:
        values: (k,) SI. starts: (m, starts) true initial states. weight: (outputs,) 1 / noise.
    """
    simulation = problem.simulation(values, starts)
    measured = np.where(np.isfinite(problem.measured), simulation.output(), np.nan)
    normal = simulation.normal(measured, weight, problem.prior.slope(values), HUBER, problem.average)
    count, chosen = len(free), np.flatnonzero(free)
    outer = normal.hessian[:, chosen[:, None], chosen]
    cross = normal.hessian[:, count:, chosen]
    inner = normal.hessian[:, count:, count:] + np.diag(1.0 / problem.start_spread**2)
    segments = outer - np.einsum("msf,msg->mfg", cross, np.linalg.solve(inner, cross))
    drive = np.searchsorted(problem.samples.begin, problem.segments.first, side="right") - 1
    each = np.zeros((len(problem.samples.names), len(chosen), len(chosen)))
    np.add.at(each, drive, segments)
    return tuple(problem.prior.names[k] for k in chosen), each


def _noise_of_errors(
    problem: Problem,
    values: FloatArray,
    starts: FloatArray,
    rear: FloatArray,
    changed: Callable[[DriveSamples, FloatArray], Problem],
    noise: dict[str, float],
) -> FloatArray:
    """Return the standard deviation (outputs,) of averaged errors: the noise of the outputs, and the contribution of the noise
    of speed and angles. The contribution is simulated once over all drives.

    Args:
        rear: (n,) rad. changed: function that returns the problem for other samples and rear angles.
    """
    samples, rng = problem.samples, np.random.default_rng(NOISE_SEED)

    def noisy(name: str, signal: FloatArray) -> FloatArray:
        result: FloatArray = signal + noise[name] * rng.standard_normal(signal.size)
        return result

    inputs = {
        name: noisy(name, samples.signal(name)) for name in ("vx", "delta_f", "steering_wheel_angle") if samples.has(name)
    }
    rear = noisy("delta_r", rear) if samples.has("delta_r") else rear
    disturbed = changed(replace(samples, signals={**samples.signals, **inputs}), rear)
    errors = disturbed.simulation(values, starts).output() - problem.simulation(values, starts).output()
    added = np.nanvar(problem.averaged(errors), axis=0)
    result: FloatArray = np.sqrt(np.array([noise[output] for output in OUTPUTS]) ** 2 + added)
    return result


def _actuator(problem: Problem, samples: DriveSamples, centre: dict[str, float], noise: float) -> _Block:
    values = np.array([centre[name] for name in problem.prior.names])
    starts = samples.signal("delta_r")[problem.segments.first][:, None]
    return _block(problem, values, starts, np.array([1.0 / noise]), np.ones(len(values), dtype=bool))


def _ratio(samples: DriveSamples, ratio: float, noise: dict[str, float]) -> _Block:
    """Return the information of the regression of the steering wheel's angle on that of the front wheels."""
    parameter = BY_NAME["steering_ratio"]
    variance = noise["steering_wheel_angle"] ** 2 + (ratio * noise["delta_f"]) ** 2
    parts = np.split(ratio * samples.signal("delta_f"), samples.begin[1:-1])
    each = np.array([parameter.spread**2 * float(((part - part.mean()) ** 2).sum()) / variance for part in parts])
    return ("steering_ratio",), each[:, None, None]
