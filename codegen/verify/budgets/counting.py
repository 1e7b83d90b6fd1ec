"""Count the instructions and the stack of single calls on an emulated Cortex-M4F.

A call is counted from its first instruction to its return, including all functions that it calls. The objects are those whose
sizes are reported: each unit is compiled by itself, without inlining across units.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import IntArray
from codegen.emit.can_view import TaskView
from codegen.emit.render import render
from codegen.verify.budgets.program import STACK_FLAG, Program, Routine
from codegen.verify.budgets.sizes import compile_objects
from codegen.verify.target.cross import compile_image
from codegen.verify.target.emulator import DATA, DATA_BYTES, STACK_BYTES, STACK_TOP, Blocks, CortexM4

FLAGS = ("-O2", STACK_FLAG)
FRAME, FRAME_PREFIX = "frame/budget.c", "verify_"
FRAME_FUNCTIONS = ("parameters", "step", "limiter", "send", "task", "sizes")

PARTS = {"limiter": "limiter_step", "packing": "can_pack_rear_steer_command"}
"""Parts of a call that are counted separately."""

UNTOUCHED = 0xA5
"""Byte that fills the stack before a call."""

ROWS_MAX = 10_000
"""Calls that are traced at once: each block of them is a number in a list."""

EVENT = np.dtype([("kind", "<u4"), ("id", "<u4"), ("length", "<u4"), ("data", "S8")])
START, TASK, RECEIVED = range(3)
"""Kinds of events, as in the frame."""

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
        names = {"prefix": prefix, "PREFIX": prefix.upper()}
        frame = render("verify/budget.c.j2", {"build": names, "task": task, "has_reference": has_reference})
        others = {f"src/{prefix}_{unit}.c" for unit in OTHER_UNITS}
        linked = {f"{path}.o": content for path, content in self.objects.items() if path not in others}
        headers = {path: content for path, content in sources.items() if path.endswith(".h")}
        entries = [FRAME_PREFIX + name for name in (*FRAME_FUNCTIONS, *self.lookups)]
        image = compile_image({**headers, **linked, FRAME: frame}, entries, FLAGS)
        self.program, self._core = Program(image), CortexM4(image)
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
