"""Drives of single units: a cycle through every regime, as samples and as frames of a faulty bus, and drawn parameters.

Further drives go across thresholds and start from an end stop. Drawn parameter sets are those that the C accepts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Literal

import numpy as np

from codegen.configuration import Config
from codegen.emit.controller_view import parameters_by_path
from codegen.emit.parameters import RATE_OFF, Parameter
from codegen.emit.text import Precision
from codegen.sil.software import Measurement, Software
from codegen.verify import traffic
from codegen.verify.drives import GAPS, NUMBER_ROLES, Thresholds, drawn, drives_of, gaps_of, measurements_of, recorded
from codegen.verify.outcomes import Subject
from codegen.verify.traffic import Cycle, frames_of
from hil_sim.codec import Codec
from hil_sim.e2e import next_counter

Unit = Literal["controller", "inputs", "limiter", "receiver", "task"]

STARTS = (0.0, 0.02, -0.05, -1e30, math.nan, math.inf)
"""Initial rear angles in rad; some are impossible."""
AMPLITUDES, STEERING_SAMPLES = (16.0, 24.0), (330.0, 90.0)
"""Speed amplitudes in m/s and steering periods in samples of the drive cycles."""
STOPS = 40
"""Number of starts from an end stop of the actuator."""
FRONT_ANGLE = 0.03
"""Front angle in rad at the speed thresholds."""


@dataclass(frozen=True)
class Stretch:
    """Inputs that are repeated a number of times."""

    samples: Sequence[Any]
    rounds: int = 1


@dataclass(frozen=True)
class Drive:
    """A drive of one unit, from its initial state.

    Attributes:
        unit: its samples are measurements; speed, front angle and demand of the limiter; frames of a cycle of the task; and
            for the receiver the advance of the sender's counter since the last frame, and DAMAGED or SILENT of `long_drives`.
        parameters: parameter struct of the C.
        start: initial rear angle in rad of a controller or limiter.
        restarts: samples of a single stretch before which the task is initialised.
    """

    name: str
    unit: Unit
    parameters: Any
    stretches: Sequence[Stretch]
    start: float = STARTS[1]
    restarts: Sequence[int] = (0,)


@dataclass(frozen=True)
class Size:
    """Samples of each drive and drive cycle, number of parameter sets, and cycles of disturbed traffic."""

    drive: int
    drive_cycle: int
    sets: int
    cycles: int


SIZE, SIZE_QUICK = Size(1000, 1500, 12, 3000), Size(120, 600, 6, 400)


class UnitDrives:
    """Drives of the controller and the task of a build. `sets`: parameter structs that the C accepts, drawn at random."""

    def __init__(self, subject: Subject, software: Software, size: Size, *, with_recordings: bool) -> None:
        self._software, self._size, self._with_recordings = software, size, with_recordings
        self._accelerations = subject.manifest["map"].get("longitudinal_accelerations") or ()
        self._thresholds = Thresholds.of(subject.manifest)
        self.sets = [drawn_parameters(software, np.random.default_rng((5, number))) for number in range(size.sets)]

    def drives(self) -> Iterator[Drive]:
        """Yield all drives."""
        yield from self._controllers()
        yield from self._tasks()

    def drive_cycle(self, seed: int) -> list[Measurement]:
        """Return the samples of a drive cycle."""
        wheelbase, kind = self._software.config.vehicle.wheelbase, seed % 2
        given = (np.random.default_rng(seed), self._size.drive_cycle, self._software.map_yaw_rate, wheelbase)
        return drive(*given, self._accelerations, speed_amplitude=AMPLITUDES[kind], steering_samples=STEERING_SAMPLES[kind])

    def turn(self, speed: float) -> Measurement:
        """Return a turn at a speed in m/s, with slightly less yaw rate than the map requires."""
        yaw_rate = float(self._software.map_yaw_rate(abs(speed), FRONT_ANGLE))
        return Measurement(speed, FRONT_ANGLE, math.copysign(0.9, speed) * yaw_rate)

    def _controllers(self) -> Iterator[Drive]:
        software, size = self._software, self._size
        defaults, starts = software.parameters(), itertools.cycle(STARTS)

        def run(name: str, samples: Sequence[Measurement], parameters: Any = defaults, start: float | None = None) -> Drive:
            begin = next(starts) if start is None else start
            return Drive(name, "controller", parameters, [Stretch(samples)], begin)

        for number, samples in enumerate(drives_of(self._thresholds, size.drive)):
            yield run(f"drive {number}", measurements_of(samples))
        for seed in range(2):
            yield run(f"drive cycle {seed}", self.drive_cycle(seed))
        yield run("thresholds of the speed", self._at_speed_thresholds(defaults))
        # Without control error from an end stop, rounding decides whether a limit acts.
        generator = np.random.default_rng(6)
        for number in range(STOPS):
            speed, front_angle = generator.uniform(5.0, 40.0), generator.uniform(-0.1, 0.1)
            turn = Measurement(speed, front_angle, float(software.map_yaw_rate(speed, front_angle)))
            start = float(defaults.rear_angle_max) * (1.0 if number % 2 else -1.0)
            yield run(f"stop {number}", [turn] * 2, start=start)
        if self._with_recordings:
            for number, samples in enumerate(recorded(software)):
                yield run(f"recording {number}", measurements_of(samples), start=0.0)
        for number, parameters in enumerate(self.sets):
            # The drive cycle exercises the law, the drawn drive the input monitoring.
            (anything,) = drawn(self._thresholds, size.drive, seed=number, gaps=GAPS[number % len(GAPS) :][:1])
            drives = (self.drive_cycle(number + 2), self._at_speed_thresholds(parameters), measurements_of(anything))
            yield run(f"parameter set {number}", [*itertools.chain(*drives)], parameters)

    def _at_speed_thresholds(self, parameters: Any) -> list[Measurement]:
        """Return samples at each speed threshold and its neighbours, from both sides; then without the yaw rate, and
        without any signal."""
        real, samples = self._software.real, []
        disable, enable = (real(speed) for speed in feedback_speeds(parameters))
        thresholds = [enable, disable] if self._software.config.controller.waits_for_speed else [enable, disable, real(0.0)]
        silence, patience = parameters.inputs.missing_samples_max + 3, parameters.inputs.recovery_samples + 3
        for threshold, start in itertools.product(thresholds, (1.0 + 1.5 * float(enable), 0.5 * float(disable))):
            for speed in (np.nextafter(threshold, real(-np.inf)), threshold, np.nextafter(threshold, real(np.inf))):
                steps = math.ceil(abs(float(speed) - start) / (0.9 * parameters.inputs.speed_step))
                samples += [self.turn(start)] * patience + [self.turn(each) for each in np.linspace(start, speed, steps)]
                samples += [self.turn(float(speed))] * 3 + [Measurement(float(speed), FRONT_ANGLE, math.nan)] * silence
                samples += [Measurement(math.nan, math.nan, math.nan)] * silence
        return samples

    def _tasks(self) -> Iterator[Drive]:
        software, cycles = self._software, self._size.cycles
        defaults, config = software.parameters(), software.config

        def run(
            name: str, frames: Sequence[traffic.Cycle], restarts: Sequence[int] = (0,), parameters: Any = defaults
        ) -> Drive:
            return Drive(name, "task", parameters, [Stretch(frames)], restarts=restarts)

        name, scenario = traffic.closed_loop(software)
        if scenario:
            yield run(f"frames of scenario {name}", scenario)
        yield run("disturbed frames", traffic.disturbed(config, scenario, cycles), traffic.restarts_of(cycles))
        if found := traffic.directed(config, scenario):
            yield run("frames with gaps and Inhibit", found)
        for number, parameters in enumerate((defaults, *self.sets[:2])):
            samples = self.drive_cycle(number)
            frames = cycles_of(config, software.precision, samples, seed=number)
            of = f" of parameter set {number - 1}" if number else ""
            yield run(f"frames of drive cycle {number}{of}", frames, range(0, len(samples), LIFE), parameters)


def feedback_speeds(parameters: Any) -> tuple[float, float]:
    """Return the speeds in m/s at which feedback ends, and from which it is whole, of a parameter struct in C."""
    if hasattr(parameters, "enable_speed"):
        return parameters.disable_speed, parameters.enable_speed
    return parameters.slow_speed, 2.0 * parameters.slow_speed


def drive(
    rng: np.random.Generator,
    count: int,
    lookup: Callable[..., Any],
    wheelbase: float,
    accelerations: Sequence[float] = (),
    *,
    speed_amplitude: float = 16.0,
    steering_samples: float = 330.0,
) -> list[Measurement]:
    """Return `count` samples through every regime: fast, slow, reverse; faults, gaps and implausible periods of any length.

    The yaw rate mostly lies near the reference, so that the integrator is not always at a limit. The speed (m/s) swings by
    `speed_amplitude` around 14, the steering once in `steering_samples`.

    Args:
        lookup: yaw rate of the map in rad/s, from speeds in m/s and front angles in rad.
        accelerations: longitudinal accelerations of the map's layers, m/s^2.
    """

    def spells(probability: float, longest: int) -> Any:
        active = np.zeros(count, dtype=bool)
        for start in np.flatnonzero(rng.random(count) < probability):
            active[start : start + rng.integers(1, longest + 1)] = True
        return active

    t = np.arange(count)
    speed = 14.0 + speed_amplitude * np.sin(2.0 * np.pi * t / 900.0 + rng.uniform(0.0, 6.0)) + rng.normal(0.0, 0.05, count)
    steered = np.minimum(t, round(0.93 * count))  # the front angle freezes at the end
    front = 0.12 * np.sin(2.0 * np.pi * steered / steering_samples + rng.uniform(0.0, 6.0))
    slow_error = 0.12 * np.sin(2.0 * np.pi * t / 170.0)
    yaw = lookup(speed, front) + slow_error + rng.normal(0.0, 0.01, count)
    yaw = np.where(spells(0.004, 50), (speed * front) / wheelbase + 2.2, yaw)
    rear = np.where(spells(0.01, 100), 0.03 * np.sin(2.0 * np.pi * t / 240.0), math.nan)
    friction = np.where(spells(0.01, 60), rng.choice([0.0, 0.05, 0.3, 0.6, 0.9, 1.2], count), math.nan)
    lateral = np.where(spells(0.01, 300), speed * (yaw + rng.normal(0.0, 0.005, count)), math.nan)
    inhibit = spells(0.01, 20)
    moving = []
    if len(accelerations) > 1:
        swing = 0.7 * np.ptp(accelerations) * np.sin(2.0 * np.pi * t / 210.0)
        moving = [np.where(spells(0.005, 200), math.nan, swing)]
    fields = np.stack([speed, front, yaw, rear, friction, lateral, *moving])
    nonsense = np.array([math.nan, math.inf, -math.inf, 1e9, -1e9])
    for column in np.flatnonzero(spells(0.006, 6)):
        fields[rng.integers(len(fields)), column] = rng.choice(nonsense)
    fields[:3, spells(0.006, 20)] = math.nan
    rows = zip(fields.T.tolist(), inhibit.tolist(), strict=True)
    return [Measurement(**dict(zip(NUMBER_ROLES, row, strict=False)), inhibit=inhibited) for row, inhibited in rows]


LIFE = 150
"""Cycles between two starts of the task."""
GAP = (0.02, 0.05)
"""Probability that a gap of one message begins with a cycle, and that it ends with one: long enough for the fail-safe."""


def cycles_of(config: Config, precision: Precision, samples: Sequence[Measurement], seed: int) -> list[Cycle]:
    """Return the protected frames of each sample.

    After a restart the rear angle is valid at once, missing for longer than the task waits, or impossible. Then it moves
    slowly, and is missing where the sample has one.
    """
    can, codec = config.can, Codec(config.can, precision)
    generator = np.random.default_rng(seed)
    largest = config.rear_actuator.angle_max
    impossible = 1.1 * math.radians(config.rear_angle_valid_max_deg)
    waits = can.e2e.min_ok_state_init + config.controller.fail_safe.recovery_samples + 1
    gaps = [gaps_of(len(samples), GAP, generator) for _ in range(2)]
    found, counter = [], 0
    for number, sample in enumerate(samples):
        life, age = divmod(number, LIFE)
        angle = 0.5 * largest * math.cos(0.05 * number + life)
        if age <= waits:
            angle = (angle, math.nan, impossible)[life % 3]
        elif math.isfinite(sample.rear_angle):
            angle = math.nan
        frames = frames_of(can, codec, counter, replace(sample, rear_angle=angle))
        found.append(tuple(frame for frame, gap in zip(frames, gaps, strict=True) if not gap[number] or age <= waits))
        counter = next_counter(counter, can.e2e.definition)
    return found


CHANGED = 0.7
"""Probability that a parameter of a drawn set is varied; the C rejects some values."""
TRIES = 3
"""Attempts to find an accepted value."""
DECADES = 0.7
"""Largest variation in decades, a factor of five."""
NOTHING = 0.01
"""Value drawn for a parameter that is zero, as a fraction of its maximum."""
RATES = (0.01, 2.0)
"""Range of drawn rates in rad/s, even if the configured rate is off."""
COUNT_MAX = 12
"""Maximum of drawn sample counts, short compared with a drive."""

Number = float | list[float]


def fields(config: Config, parameters: Any) -> Iterator[tuple[Any, Parameter, str]]:
    """Yield the struct of each parameter, the parameter, and its qualified name."""
    for path, parameter in parameters_by_path(config).items():
        yield reduce(getattr, path.split(".")[:-1], parameters), parameter, path


def drawn_parameters(software: Software, generator: np.random.Generator) -> Any:
    """Return a parameter struct with many fields varied one by one, as far as `<prefix>_parameters_valid` accepts them."""
    parameters = software.parameters()
    is_valid = software.function("parameters_valid")
    if generator.random() < CHANGED:
        _narrow(parameters, generator)
        parameters = parameters if is_valid(parameters) else software.parameters()
    for holder, parameter, _ in fields(software.config, parameters):
        if generator.random() < CHANGED:
            before = value_of(holder, parameter.name)
            for _ in range(TRIES):
                setattr(holder, parameter.name, _other(parameter, before, generator))
                if is_valid(parameters):
                    break
                setattr(holder, parameter.name, before)
    return parameters


def unchanged(software: Software, sets: Iterable[Any]) -> list[str]:
    """Return the qualified names of parameters that have their default in every set."""
    rows = zip(*(fields(software.config, each) for each in (software.parameters(), *sets)), strict=True)
    return [
        name
        for (default, parameter, name), *others in rows
        if all(value_of(holder, parameter.name) == value_of(default, parameter.name) for holder, _, _ in others)
    ]


def _narrow(parameters: Any, generator: np.random.Generator) -> None:
    """Reduce the rear angle ranges of controller and limiter, and the opposite-phase range at some speeds."""
    limiter = parameters.limiter
    parameters.rear_angle_max *= 10.0 ** generator.uniform(-DECADES, 0.0)
    limiter.rear_angle_max = parameters.rear_angle_max * generator.uniform(0.5, 1.0)
    shares = np.maximum(generator.uniform(-0.5, 1.0, len(limiter.opposite_phase_max)), 0.0)  # a third of them zero
    limiter.opposite_phase_max = [limiter.rear_angle_max * share for share in shares]


def _other(parameter: Parameter, value: Number, generator: np.random.Generator) -> Number:
    if isinstance(parameter.value, int):
        return int(generator.integers(0, COUNT_MAX + 1))
    low, high = parameter.low, parameter.high
    if parameter.high == RATE_OFF:
        return float(np.exp(generator.uniform(*np.log(RATES))))
    if isinstance(value, list):
        # One factor for all if they must increase.
        factors = 10.0 ** generator.uniform(-DECADES, DECADES, 1 if parameter.increasing else len(value))
        return [min(max(float(number), low), high) for number in np.where(value, value, NOTHING * high) * factors]
    return float(min(max((value or NOTHING * high) * 10.0 ** generator.uniform(-DECADES, DECADES), low), high))


def value_of(holder: Any, name: str) -> Number:
    """Return the value of a parameter in its struct."""
    value = getattr(holder, name)
    return value if isinstance(value, float | int) else list(value)
