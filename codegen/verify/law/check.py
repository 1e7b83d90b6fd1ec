"""Compare every sample of the C with a second implementation, bit for bit.

Inputs: drives over the whole input range, drive cycles through every regime with a plausible yaw rate, both sides of each
speed threshold, recorded closed loops, and valid parameter sets. The cyclic task receives the frames of a car and those of a
faulty bus; the frames it sends must be equal too. Long drives of every unit hold inputs for up to an hour and bring counters
to their limits.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from itertools import pairwise
from typing import Any

import numpy as np

from codegen.errors import BuildError
from codegen.sil.software import Measurement, Status
from codegen.sil.toolchain import compiler_command, compiler_identity
from codegen.verify import traffic
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.drives import GAPS, Thresholds, drawn, drives_of, measurements_of, recorded
from codegen.verify.law import parameters as sets
from codegen.verify.law import states
from codegen.verify.law.controller import Road, SecondController, feedback_speeds
from codegen.verify.law.drive_cycle import LIFE, cycles_of, drive
from codegen.verify.law.kinds import SECOND, second_controller
from codegen.verify.law.long_drives import LongDrives
from codegen.verify.law.pairs import ControllerPair, Pair, Stretch, TaskPair, compare, text_of
from codegen.verify.law.task import SecondTask
from codegen.verify.law.transitions import transition_findings
from codegen.verify.map_reference import lookup_of
from codegen.verify.on_host import MightNotReturn, compiled, require_compiler
from hil_sim.codec import Codec

SHOWS = (
    "Every command, reference yaw rate, status and frame equals that of a second implementation of the law, bit for bit; an "
    "unsound state restarts, an initialisation leaves nothing as it was, and the default parameters are "
    "those of the configuration"
)
LIMITS = (
    "The second implementation has the same authors and the same specification, so a common misreading is not detected. "
    "The reference of the look-up, the tables of the tyres' curves, the equations of the car and the values of the parameters "
    "are the generator's own.",
    "The numbers of the map (tables, scales, caps, and the car behind them) are read from the C. `codegen build --check` "
    "and the self-test check that they are those of the map.",
    "The comparison runs drives and is not a proof: a fault at a few values of a signal can lie between the samples. The "
    "state, and the sets that `parameters_valid` rejects, are not compared. The sign of a zero may differ.",
    "The long drives hold single inputs, or short sequences of them. A fault that needs other inputs for hours is not found.",
)
NO_SECOND = "there is no second implementation of the kind {kind}; add one to codegen/verify/law/kinds.py"
NOT_THIS_VERSION = "made by codegen {made}, and the second implementation is that of this version; build it again"
NEVER_OTHER = "In every accepted set these parameters have their default: {names}."

STARTS = (0.0, 0.02, -0.05, -1e30, math.nan, math.inf)
"""Initial rear angles in rad; some are impossible."""
AMPLITUDES, STEERING_SAMPLES = (16.0, 24.0), (330.0, 90.0)
"""Speed amplitudes in m/s and steering periods in samples of the drive cycles."""
STOPS = 40
"""Number of starts from an end stop of the actuator."""
FRONT_ANGLE = 0.03
"""Front angle in rad at the speed thresholds."""


@dataclass(frozen=True)
class Size:
    """Samples of each drive and drive cycle, number of parameter sets, and cycles of disturbed traffic; which long drives."""

    drive: int
    drive_cycle: int
    sets: int
    cycles: int
    all_long_drives: bool


SIZE, SIZE_QUICK = Size(1000, 1500, 12, 3000, True), Size(120, 600, 6, 400, False)


_Run = tuple[str, ControllerPair, Sequence[Measurement]]
"""Name of a run, the controller in C and the second one in their initial state, and the samples."""
_Traffic = tuple[str, Any, Sequence[traffic.Cycle], Sequence[int]]
"""Name of a run of the task, its parameter struct, the frames of each cycle, and the cycles before which the task restarts."""


def check(subject: Subject, effort: Effort) -> Outcome:
    """Compare the C of a build with the second implementation. Raises MissingTool: no compiler or package."""
    require_compiler()
    not_run = partial(Outcome, SHOWS, "", Verdict.NOT_RUN, limits=LIMITS)
    if not subject.is_of_this_version:
        return not_run((NOT_THIS_VERSION.format(made=subject.manifest["version"]),))
    if subject.kind not in SECOND:
        return not_run((NO_SECOND.format(kind=subject.kind),))
    size = SIZE_QUICK if effort.quick else SIZE
    try:
        return _Comparison(subject, size, with_recordings=not effort.quick).outcome()
    except MightNotReturn as error:
        return not_run((str(error),), tools=_tools())
    except BuildError as error:  # the C does not compile, or holds no map
        return Outcome(SHOWS, "the C does not run", Verdict.FAILED, (str(error),), limits=LIMITS, tools=_tools())


class _Comparison:
    """The C of a build and the second implementation."""

    def __init__(self, subject: Subject, size: Size, *, with_recordings: bool) -> None:
        self._subject, self._size, self._with_recordings = subject, size, with_recordings
        self._software = compiled(subject)
        self._lookup = lookup_of(subject, self._software)
        facts = subject.manifest["map"]
        self._road = Road(facts["friction"], facts["lateral_acceleration_cap_m_s2"])
        self._thresholds = Thresholds.of(subject.manifest)
        self._sets = [sets.drawn(self._software, np.random.default_rng((5, number))) for number in range(size.sets)]
        self._statuses: Counter[Status] = Counter()
        self._repeated = 0
        self._unsettled: list[str] = []

    def outcome(self) -> Outcome:
        """Run all comparisons."""
        where = f"src/{self._subject.prefix}_calibration.c"
        findings = [f"{where}: {line}" for line in sets.differences(self._software)]
        findings += [*states.initialisation_findings(self._software)]
        findings += [*states.uninitialised_findings(self._software), *transition_findings(self._software)]
        findings += [*states.soundness_findings(self._software, self._drive_cycle(0))]
        runs = samples = cycles = long_drives = 0
        for name, pair, measurements in self._runs():
            runs, samples = runs + 1, samples + len(measurements)
            findings += self._differences(name, pair, [Stretch(measurements)])
            self._statuses += pair.statuses
        for name, parameters, frames, starts in self._traffic():
            cycles += len(frames)
            findings += self._differences_of_task(name, parameters, frames, starts)
        for each in self._long_drives().drives():
            long_drives += 1
            findings += self._differences(each.name, each.pair, each.stretches)
        count = "1 finding" if len(findings) == 1 else f"{len(findings)} findings"
        return Outcome(
            SHOWS,
            f"{count} in {samples:,} samples of {runs} drives, {self._size.sets} of them with other parameters, "
            f"{cycles:,} cycles of the task, and {self._repeated:,} samples of {long_drives} long drives",
            Verdict.FAILED if findings else Verdict.PASSED,
            tuple(findings),
            {
                "drives": runs,
                "samples": samples,
                "parameter_sets": self._size.sets,
                "task_cycles": cycles,
                "long_drives": long_drives,
                "long_drive_samples": self._repeated,
                "statuses": {status.name: self._statuses[status] for status in Status},
            },
            (*LIMITS, *self._limits()),
            _tools(),
        )

    def _limits(self) -> Iterator[str]:
        for status in Status:
            if not self._statuses[status]:
                yield f"The samples do not reach the status {status.name}."
        if self._unsettled:
            yield f"These long drives were cut, because the law did not settle: {'; '.join(self._unsettled)}."
        if unchanged := sets.unchanged(self._software, self._sets):
            yield NEVER_OTHER.format(names=", ".join(sorted(unchanged)))

    def _runs(self) -> Iterator[_Run]:
        software, size = self._software, self._size
        defaults, starts = software.parameters(), itertools.cycle(STARTS)

        def run(name: str, samples: Sequence[Measurement], parameters: Any = defaults, start: float | None = None) -> _Run:
            begin = next(starts) if start is None else start
            return name, self._controller(parameters, begin), samples

        for number, samples in enumerate(drives_of(self._thresholds, size.drive)):
            yield run(f"drive {number}", measurements_of(samples))
        for seed in range(2):
            yield run(f"drive cycle {seed}", self._drive_cycle(seed))
        yield run("thresholds of the speed", self._at_speed_thresholds(defaults))
        # Without control error from an end stop, rounding decides whether a limit acts.
        generator = np.random.default_rng(6)
        for number in range(STOPS):
            speed, front_angle = generator.uniform(5.0, 40.0), generator.uniform(-0.1, 0.1)
            turn = Measurement(speed, front_angle, float(self._lookup(speed, front_angle)))
            start = float(defaults.rear_angle_max) * (1.0 if number % 2 else -1.0)
            yield run(f"stop {number}", [turn] * 2, start=start)
        if self._with_recordings:
            for number, samples in enumerate(recorded(software)):
                yield run(f"recording {number}", measurements_of(samples), start=0.0)
        for number, parameters in enumerate(self._sets):
            # The drive cycle exercises the law, the drawn drive the input monitoring.
            (anything,) = drawn(self._thresholds, size.drive, seed=number, gaps=GAPS[number % len(GAPS) :][:1])
            drives = (self._drive_cycle(number + 2), self._at_speed_thresholds(parameters), measurements_of(anything))
            yield run(f"parameter set {number}", [*itertools.chain(*drives)], parameters)

    def _drive_cycle(self, seed: int) -> list[Measurement]:
        wheelbase, kind = self._software.config.vehicle.wheelbase, seed % 2
        given = (np.random.default_rng(seed), self._size.drive_cycle, self._lookup, wheelbase)
        return drive(*given, speed_amplitude=AMPLITUDES[kind], steering_samples=STEERING_SAMPLES[kind])

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
                samples += [self._turn(start)] * patience + [self._turn(each) for each in np.linspace(start, speed, steps)]
                samples += [self._turn(float(speed))] * 3 + [Measurement(float(speed), FRONT_ANGLE, math.nan)] * silence
                samples += [Measurement(math.nan, math.nan, math.nan)] * silence
        return samples

    def _turn(self, speed: float) -> Measurement:
        """Return a turn with slightly less yaw rate than the map requires."""
        return Measurement(speed, FRONT_ANGLE, math.copysign(0.9, speed) * float(self._lookup(abs(speed), FRONT_ANGLE)))

    def _second(self, parameters: Any, start: float) -> SecondController:
        return second_controller(self._software.config, parameters, self._lookup, self._road, start)

    def _controller(self, parameters: Any, start: float = STARTS[1]) -> ControllerPair:
        return ControllerPair(self._software, self._second(parameters, start), parameters, start)

    def _traffic(self) -> Iterator[_Traffic]:
        software, cycles = self._software, self._size.cycles
        defaults, config = software.parameters(), software.config
        name, scenario = traffic.closed_loop(software)
        if scenario:
            yield f"frames of scenario {name}", defaults, scenario, [0]
        disturbed = traffic.disturbed(config, scenario, cycles)
        yield "disturbed frames", defaults, disturbed, traffic.restarts_of(cycles)
        if found := traffic.directed(config, scenario):
            yield "frames with gaps and Inhibit", defaults, found, [0]
        for number, parameters in enumerate((defaults, *self._sets[:2])):
            samples = self._drive_cycle(number)
            frames = cycles_of(config, self._software.precision, samples, seed=number)
            of = f" of parameter set {number - 1}" if number else ""
            yield f"frames of drive cycle {number}{of}", parameters, frames, range(0, len(samples), LIFE)

    def _differences_of_task(
        self, name: str, parameters: Any, cycles: Sequence[traffic.Cycle], starts: Sequence[int]
    ) -> list[str]:
        """Return the first frame that differs."""
        for start, end in pairwise([*starts, len(cycles)]):
            if found := [*self._differences(name, self._task(parameters), [Stretch(cycles[start:end])], start)]:
                return found
        return []

    def _task(self, parameters: Any) -> TaskPair:
        software = self._software
        codec = Codec(software.config.can, self._software.precision)
        second = SecondTask(software.config.can, parameters, codec, lambda rear_angle: self._second(parameters, rear_angle))
        return TaskPair(software, second, codec, parameters)

    def _long_drives(self) -> LongDrives:
        codec = Codec(self._software.config.can, self._software.precision)
        is_quick = not self._size.all_long_drives
        return LongDrives(self._software, codec, self._controller, self._task, self._turn, is_quick)

    def _differences(self, name: str, pair: Pair, stretches: Sequence[Stretch], first: int = 0) -> Iterator[str]:
        """Yield the first output that differs; the following ones depend on it. `first`: number of the first sample."""
        result = compare(pair, stretches)
        self._repeated += result.repeated
        self._unsettled += [name] if result.unsettled else []
        if result.difference is not None:
            index, sample, got, wanted = result.difference
            yield f"{name}, sample {first + index}: {pair.text(got)}; by the law {pair.text(wanted)}; after {text_of(sample)}"


def _tools() -> dict[str, str]:
    return {"C compiler of this machine": compiler_identity(compiler_command(), ())[0], "ziglang": metadata.version("ziglang")}
