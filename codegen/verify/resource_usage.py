"""Measure instructions, stack, flash and RAM of a build on an emulated Cortex-M4F.

A call is counted from its first instruction to its return, including all functions that it calls. The objects are those whose
sizes are reported: each unit is compiled by itself, without inlining across units.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import IntArray
from codegen.emit.can_view import TaskView, task_view
from codegen.emit.render import render
from codegen.errors import BuildError
from codegen.verify import workloads
from codegen.verify.drives import Samples, Thresholds, recorded
from codegen.verify.machine_code import STACK_FLAG, Depth, Program, Routine, Sizes, compile_objects, sizes_of
from codegen.verify.on_host import software_of
from codegen.verify.outcomes import Effort, Subject
from codegen.verify.target import DATA, DATA_BYTES, STACK_BYTES, STACK_TOP, Blocks, Processor, compile_image
from codegen.verify.traffic import disturbed, restarts_of
from codegen.verify.workloads import START, TASK

FLAGS = ("-O2", STACK_FLAG)
FRAME, FRAME_PREFIX = "frame/budget.c", "verify_"
FRAME_FUNCTIONS = ("parameters", "step", "limiter", "send", "task", "sizes")

PARTS = {"limiter": "limiter_step", "packing": "can_pack_rear_steer_command"}
"""Parts of a call that are counted separately."""

UNTOUCHED = 0xA5
"""Byte that fills the stack before a call."""

ROWS_MAX = 10_000
"""Calls that are traced at once: each block of them is a number in a list."""

STRUCTS = ("controller", "limiter", "task", "parameters")

OTHER_UNITS = ("dynamics", "selftest")
"""Units that need a C library, or more time than a step, and that nothing here calls."""


CALL = np.dtype([("function", "i8"), ("instructions", "i8"), *((part, "i8") for part in PARTS)])
"""A call: address of the function, its instructions, and the parts of them."""
Calls = npt.NDArray[np.void]


class Counter:
    """A build on one core.

    Attributes:
        objects: compiled, by path of the source.
        program: functions of the image.
        stack: largest stack of a call in bytes, by the function of the frame that made it.
        structs: bytes of the structs, by name without prefix and suffix.
        lookups: names of the map's functions, without the prefix.
        task_name: name of the task's function, without the prefix.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: C that does not compile.
    """

    def __init__(self, sources: Mapping[str, bytes], prefix: str, task: TaskView) -> None:
        self.prefix, self.task_name = prefix, task.function
        self.objects = compile_objects(sources, FLAGS)
        has_reference = f"{prefix}_map_reference(".encode() in sources[f"include/{prefix}_map.h"]
        self.lookups = ("map_yaw_rate", "map_yaw_rate_on_road", *(["map_reference"] if has_reference else []))
        takes = b" longitudinal_acceleration);" in sources[f"include/{prefix}_map.h"]
        names = {"prefix": prefix, "PREFIX": prefix.upper()}
        frame = render(
            "verify/budget.c.j2", {"build": names, "task": task, "has_reference": has_reference, "takes_acceleration": takes}
        )
        others = {f"src/{prefix}_{unit}.c" for unit in OTHER_UNITS}
        linked = {f"{path}.o": content for path, content in self.objects.items() if path not in others}
        headers = {path: content for path, content in sources.items() if path.endswith(".h")}
        entries = [FRAME_PREFIX + name for name in (*FRAME_FUNCTIONS, *self.lookups)]
        image = compile_image({**headers, **linked, FRAME: frame}, entries, FLAGS)
        self.program, self._core = Program(image), Processor(image)
        self.stack: dict[str, int] = {}
        routines = self.program.routines.values()
        self._frame = [each for each in routines if each.name.startswith(FRAME_PREFIX)]
        self._parts = {part: self._own(self.routine(name)) for part, name in PARTS.items()}
        self._core.call("verify_parameters", 0)
        self._core.call("verify_sizes", DATA)
        sizes = np.frombuffer(self._core.read(DATA, 4 * len(STRUCTS)), dtype="<u4")
        self.structs = dict(zip(STRUCTS, sizes.tolist(), strict=True))

    def _own(self, part: Routine) -> list[Routine]:
        """Return a function and those functions that only it calls."""
        inside = self.program.reached(part.name)
        callers = [each for each in self.program.routines.values() if each not in inside and each not in self._frame]
        shared = {called for each in callers for called in each.calls}
        return [each for each in inside if each is part or each.start not in shared]

    def routine(self, name: str) -> Routine:
        """Return a generated function by its name without the prefix."""
        return self.program.named(f"{self.prefix}_{name}")

    def count(self, frame: str, rows: npt.NDArray[Any]) -> Calls:
        """Make one call for each row and return an array of CALL. `frame` is a function of the frame, without "verify_"."""
        size, found = min(DATA_BYTES // rows[:1].nbytes, ROWS_MAX), []
        for start in range(0, len(rows), size):
            part = rows[start : start + size]
            found.append(self._calls(self._core.traced(lambda part=part: self._run(frame, part))))  # type: ignore[misc]
        return np.concatenate(found)

    @contextlib.contextmanager
    def tight(self) -> Iterator[None]:
        """Use limiter and rate limits so tight that all of them act, instead of the default parameters."""
        self._core.call("verify_parameters", 1)
        try:
            yield
        finally:
            self._core.call("verify_parameters", 0)

    def _run(self, frame: str, part: npt.NDArray[Any]) -> None:
        core, bottom, name = self._core, STACK_TOP - STACK_BYTES, FRAME_PREFIX + frame
        core.write(DATA, part.tobytes())
        core.write(bottom, bytes([UNTOUCHED]) * STACK_BYTES)
        core.call(name, DATA, len(part))
        painted = np.flatnonzero(np.frombuffer(core.read(bottom, STACK_BYTES), dtype=np.uint8) != UNTOUCHED)
        used = STACK_BYTES - int(painted[0]) // 4 * 4 if painted.size else 0
        self.stack[frame] = max(self.stack.get(frame, 0), used - (self.program.named(name).stack or 0))

    def _calls(self, blocks: Blocks) -> Calls:
        outside = _inside(blocks.address, self._frame)
        began = ~outside & np.append(True, outside[:-1])
        address, instructions, call = blocks.address[~outside], blocks.instructions[~outside], np.cumsum(began)[~outside] - 1
        found = np.zeros(int(began.sum()), dtype=CALL)
        found["function"] = blocks.address[began]
        found["instructions"] = np.bincount(call, weights=instructions, minlength=len(found))
        for part, routines in self._parts.items():
            found[part] = np.bincount(call, weights=instructions * _inside(address, routines), minlength=len(found))
        return found


def _inside(address: IntArray, routines: Iterable[Routine]) -> npt.NDArray[np.bool_]:
    found = np.zeros(address.shape, dtype=bool)
    for each in routines:
        found |= (address >= each.start) & (address < each.end)
    return found


CYCLE = "cycle"
"""Name of a whole control period: both frames received, and the task's function."""

USUAL_SAMPLES = 300
"""Samples of each built-in scenario over which the mean is taken."""

SAMPLES, QUICK_SAMPLES = 2_000, 400
"""Samples of each drawn drive."""

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
        return self.instructions_bound or self.instructions.max

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class ResourceUsage:
    """Resource usage of a build.

    Attributes:
        counts: by function without prefix, and CYCLE.
        stacks: deepest stack seen in bytes, and bound; likewise, with the initialisation of the state.
        sizes: by source file.
        structs: bytes, by name without prefix and suffix.
        in_closed_loop: whether means are over scenarios. They are over drawn inputs if this machine cannot compile the C.
    """

    counts: Mapping[str, Count]
    stacks: Mapping[str, tuple[int, Depth]]
    sizes: Mapping[str, Sizes]
    structs: Mapping[str, int]
    in_closed_loop: bool


def measure(subject: Subject, effort: Effort) -> ResourceUsage:
    """Measure all functions of a build.

    Raises:
        MissingTool, BuildError: as `Counter`; also a build in double precision, and a stack without a bound.
    """
    return _Measuring(subject, effort).usage()


def measure_step(subject: Subject, effort: Effort) -> Count:
    """Measure only the controller's step. Raises as `measure`."""
    return _Measuring(subject, effort).step()


def _scenarios(subject: Subject) -> tuple[Samples, ...]:
    """Return the measurements of the built-in scenarios; empty if the compiler is missing or rejects the C."""
    try:
        return tuple(drive[:USUAL_SAMPLES] for drive in recorded(software_of(subject)))
    except BuildError:
        return ()


class _Measuring:
    """Measurement of one build, function by function."""

    def __init__(self, subject: Subject, effort: Effort) -> None:
        if not subject.is_single:
            raise BuildError(NOT_SINGLE, where="options.precision", remedy="build with `precision='single'`")
        self._config = subject.config
        self._counter = Counter(subject.sources(), subject.prefix, task_view(self._config))
        self._generator = np.random.default_rng(0)
        scenarios, samples = _scenarios(subject), QUICK_SAMPLES if effort.quick else SAMPLES
        self._in_closed_loop, thresholds = bool(scenarios), Thresholds.of(subject.manifest)
        self._steps, self._usual = workloads.steps_of(scenarios, thresholds, samples)

    def usage(self) -> ResourceUsage:
        counter, given = self._counter, (self._steps, self._usual)
        places = workloads.places_of(*given, self._generator)
        counts = {name: self._count(name, name, places, workloads.PLACE_COLUMNS) for name in counter.lookups}
        demands = workloads.demands_of(*given, self._config, self._generator)
        counts["limiter_step"] = self._count("limiter", "limiter_step", demands, workloads.DEMAND_COLUMNS)
        counts["controller_step"] = self.step()
        counts |= self._task()
        sizes = {path: sizes_of(content) for path, content in counter.objects.items()}
        return ResourceUsage(counts, self._stacks(), sizes, counter.structs, self._in_closed_loop)

    def step(self) -> Count:
        return self._count("step", "controller_step", self._steps, workloads.STEP_COLUMNS)

    def _count(self, frame: str, name: str, rows: workloads.Rows, columns: Sequence[str]) -> Count:
        """Count the calls for all rows, and those for the rows that are not usual again with tight limits."""
        counter, usual = self._counter, self._usual
        found = counter.count(frame, rows)
        with counter.tight():
            found = np.concatenate([found, counter.count(frame, rows[usual:])])
        found = found[found["function"] == counter.routine(name).start]  # without the initialisation
        is_step, whole = frame == "step", found["instructions"]
        own = whole - found["limiter"] if is_step else whole
        row = np.concatenate([rows, rows[usual:]])[own.argmax()]
        text = ", ".join(f"{column} {float(value):.6g}" for column, value in zip(columns, row, strict=True))
        return Count(_spread(own, usual), len(own), text, _spread(whole, usual) if is_step else None)

    def _task(self) -> dict[str, Count]:
        config, counter = self._config, self._counter
        packing = counter.count("send", workloads.results_of(config, SAMPLES, self._generator))["instructions"].max()
        cycles = workloads.cycles_of(config, self._steps)
        faulty = disturbed(config, cycles, len(cycles) // 4)
        restarts = [*np.flatnonzero(self._steps[:, -1]), *(len(cycles) + each for each in restarts_of(len(faulty)))]
        cycles += faulty
        events, place = workloads.events_of(cycles, restarts, config.can.frame_bytes)
        calls, is_usual, found = counter.count("task", events), place < self._usual, {}
        received = {"motion": config.can.vehicle_motion.id, "conditions": config.can.vehicle_conditions.id}
        kinds = {f"on_can_frame, {name}": events["id"] == identifier for name, identifier in received.items()}
        for name, chosen in {**kinds, counter.task_name: events["kind"] == TASK}.items():
            found[name] = Count(_spread(calls["instructions"][chosen], int(is_usual[chosen].sum())), int(chosen.sum()))
        regular = [len(frames) == len({frame.id for frame in frames} & {*received.values()}) for frames in cycles]

        def summed(values: IntArray) -> IntArray:
            """Return the sum of each regular cycle, to which each message brings one frame at most."""
            return np.bincount(place, weights=np.where(events["kind"] == START, 0, values)).astype(np.int64)[regular]

        whole, bound = summed(calls["instructions"]), summed(calls["instructions"] - calls["packing"]).max() + packing
        longest = cycles[np.flatnonzero(regular)[whole.argmax()]]
        text = " ".join(f"{frame.id:03X}#{frame.data.hex().upper()}" for frame in longest)  # as candump writes it
        found[CYCLE] = Count(_spread(whole, self._usual), len(whole), f"frames {text}", instructions_bound=int(bound))
        return found

    def _stacks(self) -> dict[str, tuple[int, Depth]]:
        counter, found = self._counter, {}
        called = {name: (name, name) for name in counter.lookups} | {
            "limiter_step": ("limiter", "limiter_step", "limiter_init"),
            "controller_step": ("step", "controller_step", "controller_init"),
            CYCLE: ("task", "task_on_can_frame", counter.task_name, "task_init"),
        }
        for name, (frame, *functions) in called.items():
            depths = [counter.program.depth(counter.routine(function).name) for function in functions]
            found[name] = counter.stack[frame], max(depths, key=lambda depth: depth.bytes)
        return found


def _spread(values: IntArray, usual: int) -> Spread:
    """Return the spread of all values, with the mean of the usual ones at the start."""
    return Spread(int(values.min()), round(float(values[:usual].mean()), 1), int(values.max()))
