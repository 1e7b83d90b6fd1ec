"""Measure instructions, stack, flash and RAM of a build on a Cortex-M4F."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from codegen.arrays import IntArray
from codegen.emit.can_view import task_view
from codegen.errors import BuildError
from codegen.sil.software import compile_build
from codegen.verify.budgets import workloads
from codegen.verify.budgets.counting import START, TASK, Counter
from codegen.verify.budgets.program import Depth, NoBound
from codegen.verify.budgets.sizes import Sizes, sizes_of
from codegen.verify.check import Effort, Subject
from codegen.verify.drives import Samples, Thresholds, recorded
from codegen.verify.traffic import Cycle, disturbed, restarts_of

CYCLE = "cycle"
"""Name of a whole control period: both frames received, and the task's function."""

USUAL_SAMPLES = 300
"""Samples of each built-in scenario over which the mean is taken."""

SAMPLES, QUICK_SAMPLES = 2_000, 500
"""Samples of each drawn drive."""

FLOOD = 2**8 + 2
"""Frames of each message in a cycle, more than the task's counter holds."""

NOT_SINGLE = "a build in double precision is not for a Cortex-M4F, whose FPU has single precision"


@dataclass(frozen=True)
class Spread:
    """Smallest, mean and largest value of a figure."""

    min: int
    mean: float
    max: int


@dataclass(frozen=True)
class Count:
    """Instruction counts of one function.

    Attributes:
        instructions: per call, callees included; a step counts without the limiter.
        calls: number of calls.
        worst_input: inputs of the longest call, as text.
        instructions_with_limiter: instructions of a step including the limiter.
        instructions_bound: longest cycle without packing plus longest packing. Packing takes longest if both values lie exactly
            between two codes, which no drive combines with the longest cycle.
    """

    instructions: Spread
    calls: int
    worst_input: str = ""
    instructions_with_limiter: Spread | None = None
    instructions_bound: int | None = None

    @property
    def compared(self) -> int:
        """Instructions that are compared with the budget."""
        return self.instructions.max if self.instructions_bound is None else self.instructions_bound

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class Stack:
    """Stack of a function and of the function that initialises its state.

    Attributes:
        watermark: deepest observed, in bytes.
        bound: largest possible depth; None if there is no bound.
        why: reason for a missing bound.
    """

    watermark: int
    bound: Depth | None
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        bound = self.bound or Depth(-1, ())
        return {"watermark": self.watermark, "bound": bound.bytes, "deepest": list(bound.chain)}


@dataclass(frozen=True)
class ResourceUsage:
    """Resource usage of a build.

    Attributes:
        counts: by function without prefix, and CYCLE.
        stacks: likewise.
        sizes: by source file.
        structs: bytes, by name without prefix and suffix.
        in_closed_loop: whether means are over scenarios. They are over drawn inputs if this machine cannot compile the C.
    """

    counts: Mapping[str, Count]
    stacks: Mapping[str, Stack]
    sizes: Mapping[str, Sizes]
    structs: Mapping[str, int]
    in_closed_loop: bool


def measure(subject: Subject, effort: Effort) -> ResourceUsage:
    """Measure all functions of a build.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: a build in double precision, C that does not compile, or does not return.
    """
    return _Measuring(subject, effort).usage()


def measure_step(subject: Subject, effort: Effort) -> Count:
    """Measure only the controller's step, as `measure` does. Raises as `measure`."""
    return _Measuring(subject, effort).step()


def _scenarios(subject: Subject) -> tuple[Samples, ...]:
    """Return the measurements of the built-in scenarios; empty if the compiler is missing or rejects the C."""
    try:
        return tuple(drive[:USUAL_SAMPLES] for drive in recorded(compile_build(subject.files, subject.manifest)))
    except BuildError:
        return ()


class _Measuring:
    """Measurement of one build, function by function."""

    def __init__(self, subject: Subject, effort: Effort) -> None:
        if not subject.is_single:
            raise BuildError(NOT_SINGLE, where="options.precision", remedy="build with --precision single")
        self._config = subject.config
        self._counter = Counter(subject.sources(), subject.prefix, task_view(self._config))
        self._generator = np.random.default_rng(0)
        scenarios, samples = _scenarios(subject), QUICK_SAMPLES if effort.quick else SAMPLES
        self._in_closed_loop = bool(scenarios)
        self._steps = workloads.steps_of(scenarios, Thresholds.of(subject.manifest), samples, self._generator)

    def usage(self) -> ResourceUsage:
        counter = self._counter
        places = workloads.places_of(self._steps, self._generator)
        counts = {name: self._count(name, name, places, workloads.PLACE_COLUMNS) for name in counter.lookups}
        demands = workloads.demands_of(self._steps, self._config, self._generator)
        counts["limiter_step"] = self._count("limiter", "limiter_step", demands, workloads.DEMAND_COLUMNS)
        counts["controller_step"] = self.step()
        counts |= self._task()
        sizes = {path: sizes_of(content) for path, content in counter.objects.items()}
        return ResourceUsage(counts, self._stacks(), sizes, counter.structs, self._in_closed_loop)

    def step(self) -> Count:
        return self._count("step", "controller_step", self._steps.rows, workloads.STEP_COLUMNS)

    def _count(self, frame: str, name: str, rows: workloads.Rows, columns: Sequence[str]) -> Count:
        """Count the calls for all rows, and those for the rows that are not usual ones again with tight limits."""
        counter, usual, start = self._counter, self._steps.usual, self._counter.routine(name).start
        found = [counter.count(frame, rows)]
        if frame in ("limiter", "step"):
            with counter.tight():
                found.append(counter.count(frame, rows[usual:]))
        parts = [calls.where(calls.function == start) for calls in found]  # without the initialisation
        whole = np.concatenate([calls.instructions for calls in parts])
        own = whole - np.concatenate([calls.limiter for calls in parts]) if frame == "step" else whole
        row = np.concatenate([rows, rows[usual:]])[own.argmax()]
        text = ", ".join(f"{column} {float(value):.6g}" for column, value in zip(columns, row, strict=True))
        return Count(_spread(own, usual), len(own), text, _spread(whole, usual) if frame == "step" else None)

    def _task(self) -> dict[str, Count]:
        config, counter, steps = self._config, self._counter, self._steps
        packing = counter.count("send", workloads.results_of(config, SAMPLES, self._generator)).instructions.max()
        cycles = workloads.cycles_of(config, steps.rows)
        faulty = disturbed(config, cycles, len(cycles) // 2)
        restarts = [*np.flatnonzero(steps.rows[:, -1]), *(len(cycles) + each for each in restarts_of(len(faulty)))]
        cycles += [*faulty, FLOOD * cycles[0]]
        given = workloads.events_of(config, cycles, restarts)
        kind, identifier = given.events["kind"], given.events["id"]
        calls = counter.count("task", given.events)
        with counter.tight():
            tight = counter.count("task", given.events)
        instructions, packed = (np.stack([getattr(each, name) for each in (calls, tight)]) for name in ("instructions", "packing"))
        usual = given.cycle < steps.usual
        received = {"motion": config.can.vehicle_motion.id, "conditions": config.can.vehicle_conditions.id}
        chosen = {f"on_can_frame, {name}": identifier == each for name, each in received.items()}
        chosen[counter.task_name] = kind == TASK
        found = {}
        for name, which in chosen.items():
            each = instructions[:, which]
            found[name] = Count(_spread(each.ravel(), int(usual[which].sum())), each.size)

        def summed(values: IntArray) -> IntArray:
            totals = [np.bincount(given.cycle, weights=np.where(kind == START, 0, row)) for row in values]
            return np.stack(totals).astype(np.int64)[:, given.regular]

        whole, bare = summed(instructions), summed(instructions - packed)
        worst = np.flatnonzero(given.regular)[whole.max(axis=0).argmax()]
        bound = int(bare.max() + packing)
        spread = _spread(whole.ravel(), steps.usual)
        found[CYCLE] = Count(spread, whole.size, _frames(cycles[worst]), instructions_bound=bound)
        return found

    def _stacks(self) -> dict[str, Stack]:
        counter, found = self._counter, {}
        called = {name: (name, name) for name in counter.lookups} | {
            "limiter_step": ("limiter", "limiter_step", "limiter_init"),
            "controller_step": ("step", "controller_step", "controller_init"),
            CYCLE: ("task", "task_on_can_frame", counter.task_name, "task_init"),
        }
        for name, (frame, *functions) in called.items():
            watermark = counter.stack[frame]
            try:
                depths = [counter.program.depth(counter.routine(function).name) for function in functions]
                found[name] = Stack(watermark, max(depths, key=lambda depth: depth.bytes))
            except NoBound as error:
                found[name] = Stack(watermark, None, str(error))
        return found


def _spread(values: IntArray, usual: int) -> Spread:
    """Return the spread of all values, with the mean of the usual ones at the start."""
    return Spread(int(values.min()), round(float(values[:usual].mean()), 1), int(values.max()))


def _frames(cycle: Cycle) -> str:
    """Return the frames of a cycle as candump writes them."""
    return " ".join(f"{frame.id:03X}#{frame.data.hex().upper()}" for frame in cycle)
