"""Drives of single units: with drawn parameters, across thresholds, from an end stop, and with frames of a faulty bus."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from codegen.sil.software import Measurement, Software
from codegen.verify import parameter_sets, traffic
from codegen.verify.drive_cycle import LIFE, cycles_of, drive
from codegen.verify.drives import GAPS, Thresholds, drawn, drives_of, measurements_of, recorded
from codegen.verify.outcomes import Subject

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
        self.sets = [parameter_sets.drawn(software, np.random.default_rng((5, number))) for number in range(size.sets)]

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
