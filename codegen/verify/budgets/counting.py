"""Count instructions, estimated cycles, stack and entered blocks of single calls on an emulated Cortex-M4F.

A call is counted from its first instruction to its return, including all functions it calls. The objects are those whose sizes
are reported: each unit is compiled by itself, without inlining across units.

A call is counted from its first instruction to its return, with all that it calls. What runs are the objects whose sizes are
told: each unit compiled by itself, nothing inlined across units.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import IntArray
from codegen.emit.can_view import TaskView
from codegen.emit.render import render
from codegen.verify.budgets.cycles import REFILL
from codegen.verify.budgets.program import STACK_FLAG, Program, Routine
from codegen.verify.budgets.sizes import compile_objects, defines
from codegen.verify.target.cross import compile_image
from codegen.verify.target.emulator import DATA, DATA_BYTES, STACK_BYTES, STACK_TOP, Blocks, CortexM4

Rows = npt.NDArray[np.float32]
"""Inputs of calls one after the other, (calls, fields)."""

FLAGS = ("-O2", STACK_FLAG)
FRAME, FRAME_UNIT = "frame/budget.c", "budget.c"
MEMORY = "memory.c"
"""The unit of what every toolchain brings."""

FRAME_FUNCTIONS = ("parameters", "yaw_rate", "yaw_rate_on_road", "step", "limiter", "send", "pack", "task", "sizes")

PARTS = {"limiter": "limiter_step", "packing": "can_pack_rear_steer_command"}
"""Parts of a call that are counted separately."""

UNTOUCHED = 0xA5
"""Word that fills the stack before a call."""

COUNT_BITS = 16
"""Bits of a block's key for its instruction count; the others hold its address."""

ROWS_MAX = 10_000
"""Calls that are traced at once: each block of them is a number in a list."""

EVENT = np.dtype([("kind", "<u4"), ("length", "<u4"), ("data", "u1", 8)])
START, TASK, MOTION, CONDITIONS, FOREIGN = range(5)
"""Kinds of events, as in the frame."""

FRAMES = np.dtype([("motion", "u1", 8), ("conditions", "u1", 8)])
STRUCTS = ("controller", "limiter", "task", "parameters")

OTHER_UNITS = ("dynamics", "selftest")
"""Units that need a C library, or more time than a step, and that nothing here calls."""


@dataclass(frozen=True)
class Calls:
    """Calls one after the other, arrays of one length.

    Attributes:
        function: address of what was called.
        instructions: of each call.
        cycles: the same, estimated; see `codegen.verify.budgets.cycles`.
        limiter: instructions of them that are the limiter's.
        packing: instructions of them that pack the frame of the command.
    """

    function: IntArray
    instructions: IntArray
    cycles: IntArray
    limiter: IntArray
    packing: IntArray

    def where(self, chosen: npt.NDArray[np.bool_]) -> Calls:
        """Return the selected calls."""
        return Calls(*(getattr(self, each.name)[chosen] for each in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence[Calls]) -> Calls:
        """Concatenate calls."""
        return cls(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)))


class Counter:
    """A build on one core.

    Attributes:
        objects: compiled, by path of the source.
        program: what the image holds.
        entered: address and end of every block that ran in a call that was counted.
        stack: the most bytes of the stack that any call took, by the function of the frame that made it.
        structs: bytes of the structs, by their names without prefix and suffix.
        lookups: names of the map's functions, without the prefix.
        task_name: the name of the task's function, without the prefix.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: C that does not compile.
    """

    def __init__(self, sources: Mapping[str, bytes], prefix: str, task: TaskView) -> None:
        self.prefix, self.task_name = prefix, task.function
        self.objects = compile_objects(sources, FLAGS)
        has_reference = defines(self.objects[f"src/{prefix}_map.c"], f"{prefix}_map_reference")
        names = {"prefix": prefix, "PREFIX": prefix.upper()}
        frame = render("verify/budget.c.j2", {"build": names, "task": task, "has_reference": has_reference})
        others = {f"src/{prefix}_{unit}.c" for unit in OTHER_UNITS}
        linked = {f"{path}.o": content for path, content in self.objects.items() if path not in others}
        headers = {path: content for path, content in sources.items() if path.endswith(".h")}
        entries = [f"verify_{name}" for name in (*FRAME_FUNCTIONS, *(["reference"] if has_reference else []))]
        image = compile_image({**headers, **linked, FRAME: frame}, entries, FLAGS)
        self.lookups = ("map_yaw_rate", "map_yaw_rate_on_road", *(["map_reference"] if has_reference else []))
        self.program, self._core = Program(image), CortexM4(image)
        self.entered: set[tuple[int, int]] = set()
        self.stack: dict[str, int] = {}
        self._costs = _Costs(self.program)
        self._in_frame = [(each.start, each.end) for each in self.program.routines if each.unit == FRAME_UNIT]
        self._parts = {part: self._own(name) for part, name in PARTS.items()}
        self._core.call("verify_parameters", 0)
        self._core.call("verify_sizes", DATA)
        sizes = np.frombuffer(self._core.read(DATA, 4 * len(STRUCTS)), dtype="<u4")
        self.structs = dict(zip(STRUCTS, sizes.tolist(), strict=True))

    def counted(self) -> tuple[Routine, ...]:
        """Return the counted functions and all functions that they call."""
        names = (*self.lookups, "limiter_step", "controller_step", "task_on_can_frame", self.task_name)
        return self.program.reached(*(self.routine(name).name for name in names))

    def _own(self, name: str) -> list[tuple[int, int]]:
        """Return the addresses of a function and of those functions that only it calls."""
        everything = self.counted()
        inside = {each.start for each in self.program.reached(self.routine(name).name)}
        shared = {called for each in everything if each.start not in inside for called in each.calls}
        kept = inside - shared | {self.routine(name).start}
        return [(each.start, each.end) for each in everything if each.start in kept]

    def routine(self, name: str) -> Routine:
        """Return a generated function by its name without the prefix."""
        return self.program.named(f"{self.prefix}_{name}")

    def count(self, frame: str, rows: npt.NDArray[Any]) -> Calls:
        """Make one call for each row, and count. `frame` is a function of the frame, without "verify_"."""
        found = []
        for part in _parts(rows):
            blocks = self._core.traced(lambda part=part: self._run(frame, part))  # type: ignore[misc]
            found.append(self._calls(blocks))
        return Calls.joined(found)

    def run(self, frame: str, rows: npt.NDArray[Any]) -> None:
        """Make the calls and count nothing, in a fraction of the time."""
        for part in _parts(rows):
            self._run(frame, part)

    @contextlib.contextmanager
    def tight(self) -> Iterator[None]:
        """Use limiter and rate limits so tight that all of them act, instead of the default parameters."""
        self._core.call("verify_parameters", 1)
        try:
            yield
        finally:
            self._core.call("verify_parameters", 0)

    def packed(self, rows: Rows) -> npt.NDArray[Any]:
        """Return protected frames of measurements and counters, (n,) of FRAMES."""
        found = []
        for part in _parts(rows, FRAMES.itemsize):
            self._core.write(DATA, part.tobytes())
            frames = DATA + part.nbytes
            self._core.call("verify_pack", DATA, len(part), frames)
            found.append(np.frombuffer(self._core.read(frames, FRAMES.itemsize * len(part)), dtype=FRAMES))
        return np.concatenate(found)

    def _run(self, frame: str, part: npt.NDArray[Any]) -> None:
        core, bottom = self._core, STACK_TOP - STACK_BYTES
        core.write(DATA, part.tobytes())
        core.write(bottom, bytes([UNTOUCHED]) * STACK_BYTES)
        pointer = core.call(f"verify_{frame}", DATA, len(part))
        painted = np.flatnonzero(np.frombuffer(core.read(bottom, STACK_BYTES), dtype=np.uint8) != UNTOUCHED)
        lowest = bottom + int(painted[0]) // 4 * 4 if painted.size else STACK_TOP
        self.stack[frame] = max(self.stack.get(frame, 0), pointer - lowest)

    def _calls(self, blocks: Blocks) -> Calls:
        address = blocks.address
        instructions, cycles, end = self._costs.of(blocks)
        taken = np.append(address[1:] != end[:-1], True)
        cycles = cycles + REFILL * taken
        outside = _inside(address, self._in_frame)
        began = ~outside & np.append(True, outside[:-1])
        call = np.cumsum(began)[~outside] - 1
        ran = np.unique(address[~outside] << COUNT_BITS | (end - address)[~outside])
        self.entered |= {(each >> COUNT_BITS, (each >> COUNT_BITS) + (each & ((1 << COUNT_BITS) - 1))) for each in ran.tolist()}
        parts = {part: _inside(address, ranges)[~outside] for part, ranges in self._parts.items()}

        def summed(weights: IntArray) -> IntArray:
            return np.bincount(call, weights=weights, minlength=int(began.sum())).astype(np.int64)

        counted = instructions[~outside]
        shares = {part: summed(counted * inside) for part, inside in parts.items()}
        return Calls(address[began], summed(counted), summed(cycles[~outside]), **shares)


class _Costs:
    """Instructions and cycles of blocks, each looked at once."""

    def __init__(self, program: Program) -> None:
        self._instructions = program.instructions
        self._index = {each.address: index for index, each in enumerate(program.instructions)}

    def of(self, blocks: Blocks) -> tuple[IntArray, IntArray, IntArray]:
        """Return instructions, cycles without jumps, and end address of each block."""
        different, inverse = np.unique(blocks.address << COUNT_BITS | blocks.instructions, return_inverse=True)
        costs = np.array([self._cost(int(each)) for each in different], dtype=np.int64).reshape(-1, 2)
        return blocks.instructions, costs[inverse, 0], costs[inverse, 1]

    def _cost(self, block: int) -> tuple[int, int]:
        first = self._index[block >> COUNT_BITS]
        found = self._instructions[first : first + (block & ((1 << COUNT_BITS) - 1))]
        return sum(each.cycles for each in found), found[-1].end


def _inside(address: IntArray, ranges: Sequence[tuple[int, int]]) -> npt.NDArray[np.bool_]:
    found = np.zeros(address.shape, dtype=bool)
    for start, end in ranges:
        found |= (address >= start) & (address < end)
    return found


def _parts(rows: npt.NDArray[Any], beside: int = 0) -> Iterator[npt.NDArray[Any]]:
    """Yield pieces of the rows that fit into the target's memory, with the given bytes of results for each row."""
    size = min(DATA_BYTES // (rows[:1].nbytes + beside), ROWS_MAX)
    for start in range(0, len(rows), size):
        yield rows[start : start + size]
