"""Library of manoeuvres for a measurement programme, scaled so that the configured car keeps a lateral acceleration."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.identify.drive import Drive
from codegen.identify.model import OUTPUTS
from codegen.identify.parameters import configured
from codegen.identify.shooting import DriveSamples, Problem, Segments, actuator_problem, lagged, vehicle_problem
from codegen.units import DEGREE, KM_H
from codegen.vehicle.single_track import SingleTrack

Shape = Callable[[FloatArray, float], FloatArray]
"""Steering input of amplitude one at times (n,) since the start of the drive, for its duration; both in s."""

SWEEP_HZ = 0.2, 3.0
"""First and last frequency of a sine sweep: below and above the lateral modes of a car."""
FADE_S = 1.0
STEP_S = 1.5
"""Time from one step to the next: several settling times of a car."""
STEP_SEQUENCE = (0.0, 1.0, -1.0, 0.5, -0.5, 1.0, -1.0, 0.0)
"""Levels of a sequence of steps: it reaches both sides, and passes the whole range at once."""
RISE_S = 0.25
"""Time in which the front wheels follow a step: a fast driver, or a steering robot."""


def _fade(time: FloatArray, duration: float) -> FloatArray:
    result: FloatArray = np.clip(np.minimum(time, duration - time) / FADE_S, 0.0, 1.0)
    return result


def _slow(time: FloatArray, duration: float) -> FloatArray:
    """Return one slow turn to the left and one to the right."""
    result: FloatArray = np.sin(2.0 * math.pi * time / duration)
    return result


def _sweep(time: FloatArray, duration: float) -> FloatArray:
    """Return a sine sweep with equal time for each octave."""
    first, last = SWEEP_HZ
    octaves = math.log(last / first)
    phase = 2.0 * math.pi * first * duration / octaves * np.expm1(octaves * time / duration)
    result: FloatArray = np.sin(phase) * _fade(time, duration)
    return result


def _steps(time: FloatArray, duration: float) -> FloatArray:
    """Return steps from side to side."""
    del duration
    result: FloatArray = np.array(STEP_SEQUENCE)[(time / STEP_S + 1e-9).astype(int) % len(STEP_SEQUENCE)]
    return result


def _ramps(time: FloatArray, duration: float) -> FloatArray:
    """Return the same steps with the rise time of a driver."""
    late = _steps(np.maximum(time - RISE_S, 0.0), duration)
    passed = np.clip((time % STEP_S) / RISE_S, 0.0, 1.0)
    result: FloatArray = late + (_steps(time, duration) - late) * passed
    return result


@dataclass(frozen=True)
class Manoeuvre:
    """An entry of the library.

    Attributes:
        name: for file names. title: for tables. what: description for a driver.
        duration: s.
        front, rear: steering inputs of the front and of the rear wheels; None where they stay straight.
        rear_share: amplitude of the rear wheels over that of the front ones, where both steer.
        speed_end_factor: speed at the end over that at the beginning.
    """

    name: str
    title: str
    what: str
    duration: float
    front: Shape | None = None
    rear: Shape | None = None
    rear_share: float = 1.0
    speed_end_factor: float = 1.0


MANOEUVRES = (
    Manoeuvre("straight", "straight", "accelerate evenly, steering straight", 8.0, speed_end_factor=1.5),
    Manoeuvre("slow-turns", "slow turns", "one slow turn to the left and one to the right", 20.0, _slow),
    Manoeuvre(
        "steps", "steps of the steering wheel", "turn the steering wheel quickly from side to side and hold", 12.0, _ramps
    ),
    Manoeuvre("sweep", "sine sweep of the steering wheel", "sine of 0.2 to 3 Hz at the steering wheel", 20.0, _sweep),
    Manoeuvre("rear-steps", "steps of the rear angle", "steps of the rear angle command from side to side", 12.0, None, _steps),
    Manoeuvre(
        "rear-sweep", "sine sweep of the rear angle", "sine of 0.2 to 3 Hz of the rear angle command", 20.0, None, _sweep
    ),
    Manoeuvre(
        "crossed-turns",
        "slow turns, rear wheels against",
        "slow turns with the rear wheels turned against the front ones",
        20.0,
        _slow,
        lambda time, duration: -_slow(time, duration),
        0.4,
    ),
    Manoeuvre(
        "turns-rear-sweep",
        "slow turns, sine sweep of the rear angle",
        "slow turns with a sine of 0.2 to 3 Hz of the rear angle command",
        20.0,
        _slow,
        _sweep,
        0.2,
    ),
)
"""The library. Manoeuvres with `rear` need a rear angle command."""

AMPLITUDE_LEVELS = (1.0, 0.5)
"""Amplitudes, as fractions of the largest one within the limits."""
SPEED_COUNT, SPEED_FIRST_KM_H, SPEED_ROUND_KM_H = 4, 30.0, 5.0
"""Number of speeds, evenly spaced up to the largest of the grid; least of them where the grid reaches it; and their rounding.
Slower turns need large angles for little force."""
SIDESLIP_MAX = 8.0 * DEGREE
"""Largest sideslip: beyond it a driver may lose the car."""
TARGET_FRACTION = 0.98
"""Fraction of a limit that the amplitudes aim at: the bench integrates in finer steps."""
LINEAR_FACTOR = 2.5
"""Largest front angle over that at which the linear car reaches the limit, or the grip. Beyond it the tyres only slide."""
RATE_FRACTION = 0.9
"""Fraction of the largest rate of the steering wheel that is used."""
SCALINGS = 8
"""Simulations in which the amplitudes settle. The lateral acceleration grows less than the angle, so they grow towards it."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A drive that may be a part of the programme.

    Attributes:
        manoeuvre: entry of the library.
        level: fraction of the largest amplitude.
        front_amplitude, rear_amplitude: rad at the road wheels; zero where they stay straight.
        drive: noise-free signals of the configured car, with `steering_wheel_angle` and `delta_r_command` as its inputs.
    """

    manoeuvre: Manoeuvre
    level: float
    front_amplitude: float
    rear_amplitude: float
    drive: Drive

    @property
    def speed(self) -> float:
        """Speed at the start in m/s."""
        return float(self.drive.signals["vx"][0])

    @property
    def duration(self) -> float:
        """Duration in s."""
        return self.manoeuvre.duration

    @property
    def largest_acceleration(self) -> float:
        """Largest lateral acceleration in m/s^2."""
        return float(np.abs(self.drive.signals["lateral_acceleration"]).max())


def speeds_km_h(config: Config) -> tuple[float, ...]:
    """Return the speeds of the library in km/h, within the grid of the map."""
    grid = config.grid
    first = grid.speed_breakpoints_km_h[0] if grid.speed_breakpoints_km_h else grid.speed_min_km_h
    last = grid.last_speed_km_h
    first = min(max(first, SPEED_FIRST_KM_H), last)
    even = np.linspace(first, last, SPEED_COUNT)
    return tuple(sorted({min(max(SPEED_ROUND_KM_H * round(each / SPEED_ROUND_KM_H), first), last) for each in even.tolist()}))


@dataclass(frozen=True, eq=False)
class _Draft:
    """A candidate before its amplitude is known: unit shapes (n,) of both angles, and the angles in rad at scale one."""

    manoeuvre: Manoeuvre
    speed: FloatArray
    front: FloatArray
    rear: FloatArray
    scale_max: float


def _draft(config: Config, manoeuvre: Manoeuvre, speed: float, lateral_acceleration: float) -> _Draft:
    """Return a drive whose front angle, at scale one, gives the linear car the lateral acceleration (m/s^2)."""
    period = config.controller.sampling_time_s
    time = np.arange(round(manoeuvre.duration / period), dtype=np.float64) * period
    car = SingleTrack.from_config(config)
    largest, zero = config.rear_actuator.angle_max, np.zeros(time.size)
    unit = (car.wheelbase / speed**2 + max(car.understeer_coefficient, 0.0)) * lateral_acceleration
    front = zero if manoeuvre.front is None else unit * manoeuvre.front(time, manoeuvre.duration)
    rear_unit = largest if manoeuvre.front is None else manoeuvre.rear_share * unit
    rear = zero if manoeuvre.rear is None else rear_unit * manoeuvre.rear(time, manoeuvre.duration)
    scale = math.inf
    if manoeuvre.front is not None:
        rate = float(np.abs(np.diff(front)).max()) / period
        rate_max = RATE_FRACTION * config.steering.wheel_rate_max_deg_s * DEGREE / config.steering.ratio
        scale = min(LINEAR_FACTOR, rate_max / rate, 0.9 * config.steering.front_angle_stop / float(np.abs(front).max()))
    if manoeuvre.rear is not None:
        scale = min(scale, largest / float(np.abs(rear).max()))
    end = manoeuvre.speed_end_factor * speed
    even = np.linspace(speed, min(end, max(config.grid.last_speed_km_h * KM_H, speed)), time.size)
    return _Draft(manoeuvre, even, front, rear, 1.0 if math.isinf(scale) else scale)


def _simulated(config: Config, drafts: Sequence[_Draft], scales: FloatArray) -> list[Drive]:
    """Return noise-free drives of the configured car, which start straight ahead."""
    period, lag = config.controller.sampling_time_s, config.steering.lag_s
    drives = []
    for draft, scale in zip(drafts, scales.tolist(), strict=True):
        front = scale * draft.front
        zero = np.zeros(front.size)
        signals = {"vx": draft.speed, "steering_wheel_angle": config.steering.ratio * front, "yaw_rate": zero, "delta_r": zero}
        signals |= {"delta_f": lagged(front, period, lag), "delta_r_command": scale * draft.rear}
        drives.append(Drive(draft.manoeuvre.name, np.arange(front.size) * period, signals))
    samples = DriveSamples.of(drives)
    values = {**configured(config), "steering_ratio": 1.0}  # the angle is that of the road wheels
    actuator = actuator_problem(samples, config, values)
    assert actuator is not None  # every drive has a command and an angle
    rear = _whole(actuator, samples, values).ravel()
    vehicle = vehicle_problem(samples, config, values, values, rear, math.inf)
    outputs = _whole(replace(vehicle, constants=_undelayed(vehicle, values)), samples, values)
    found = {"delta_r": rear, **dict(zip(OUTPUTS, outputs.T, strict=True))}
    split = {name: np.split(signal, samples.begin[1:-1]) for name, signal in found.items()}
    return [
        replace(drive, signals={**drive.signals, **{name: parts[k] for name, parts in split.items()}})
        for k, drive in enumerate(drives)
    ]


def _undelayed(problem: Problem, values: dict[str, float]) -> FloatArray:
    """Return the constants with which the outputs are those of the car, without the delays of its sensors."""
    constants = problem.constants.copy()
    constants[-len(OUTPUTS) :] = [values[f"{output}_delay"] for output in OUTPUTS]
    return constants


def _whole(problem: Problem, samples: DriveSamples, values: dict[str, float]) -> FloatArray:
    """Return the outputs (n, outputs) of the whole drives, from all states zero."""
    segments = Segments(samples.begin[:-1], np.diff(samples.begin))
    vector = np.array([values[name] for name in problem.prior.names])
    starts = np.zeros((len(segments.first), len(problem.model.starts)))
    return replace(problem, segments=segments).simulation(vector, starts).output()


def library(
    config: Config, lateral_acceleration_max: float, *, has_rear_command: bool, levels: Sequence[float] = AMPLITUDE_LEVELS
) -> list[Candidate]:
    """Return the drives of the library that keep the limits.

    Args:
        config: configured car.
        lateral_acceleration_max: m/s^2.
        has_rear_command: whether the rear wheels can be commanded.
        levels: amplitudes of each drive, as fractions of its largest one.

    Raises:
        BuildError: there is no C compiler.
    """
    grip = config.road.friction * config.road.gravity_m_s2
    target = min(lateral_acceleration_max, grip)
    drafts = [
        _draft(config, manoeuvre, speed * KM_H, target)
        for manoeuvre in MANOEUVRES
        if manoeuvre.rear is None or has_rear_command
        for speed in speeds_km_h(config)
    ]
    largest = _largest_scales(config, drafts, lateral_acceleration_max)
    usable = [k for k in range(len(drafts)) if largest[k] > 0.0]
    steered = [k for k in usable if drafts[k].front.any() or drafts[k].rear.any()]
    chosen = [(k, level) for level in levels for k in (usable if level == levels[0] else steered)]
    amplitudes = np.array([level * largest[k] for k, level in chosen])
    drives = _simulated(config, [drafts[k] for k, _ in chosen], amplitudes)
    return [
        Candidate(
            drafts[k].manoeuvre,
            level,
            float(scale * np.abs(drafts[k].front).max()),
            float(scale * np.abs(drafts[k].rear).max()),
            drive,
        )
        for (k, level), scale, drive in zip(chosen, amplitudes.tolist(), drives, strict=True)
    ]


def _largest_scales(config: Config, drafts: Sequence[_Draft], lateral_acceleration_max: float) -> FloatArray:
    """Return the largest scale (drafts,) of the amplitudes that keeps the limits, after SCALINGS simulations; zero if none."""
    largest = np.array([draft.scale_max for draft in drafts])
    scales, best = 0.5 * np.minimum(largest, 1.0), np.zeros(len(drafts))
    for _ in range(SCALINGS):
        shares = np.array([_share(drive, lateral_acceleration_max) for drive in _simulated(config, drafts, scales)])
        is_known = np.isfinite(shares)
        best = np.where(is_known & (shares <= 1.0), np.maximum(best, scales), best)
        factors = np.where(is_known, TARGET_FRACTION / np.maximum(shares, 1e-3), 0.5)
        scales = np.minimum(scales * np.clip(factors, 0.5, 2.0), largest)
    return best


def _share(drive: Drive, lateral_acceleration_max: float) -> float:
    """Return the largest fraction of a limit that a drive reaches; NaN if the simulation diverges."""
    return max(
        float(np.abs(drive.signals["lateral_acceleration"]).max()) / lateral_acceleration_max,
        float(np.abs(drive.signals["sideslip"]).max()) / SIDESLIP_MAX,
    )
