"""Resource usage of a build on a Cortex-M4F."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from codegen.verify.budgets.program import Depth
from codegen.verify.budgets.sizes import Sizes
from codegen.verify.budgets.worst import Spread

CYCLE = "cycle"
"""Name of a whole control period: both frames received, and the task's function."""

NOT_COUNTED = -1


@dataclass(frozen=True)
class Count:
    """Instruction counts of one function.

    Attributes:
        instructions: per call, callees included; a step counts without the limiter.
        cycles: estimated cycles of the whole call.
        calls: number of calls.
        worst_input: inputs of the longest call, as text.
        with_limiter: instructions of a step including the limiter.
        bound: longest cycle without packing plus longest packing. Packing takes longest if both values lie exactly between
            two codes, which no search reaches within a cycle.
    """

    instructions: Spread
    cycles: Spread
    calls: int
    worst_input: str = ""
    with_limiter: Spread | None = None
    bound: int | None = None

    @property
    def compared(self) -> int:
        """Instructions that are compared with the budget."""
        return self.instructions.largest if self.bound is None else self.bound

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        found: dict[str, Any] = {
            "instructions": self.instructions.to_dict(),
            "estimated_cycles": self.cycles.to_dict(),
            "calls": self.calls,
            "worst_input": self.worst_input,
        }
        if self.with_limiter is not None:
            found["instructions_with_limiter"] = self.with_limiter.to_dict()
        return found if self.bound is None else {**found, "instructions_bound": self.bound}


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
        bound = self.bound or Depth(NOT_COUNTED, ())
        return {"watermark": self.watermark, "bound": bound.bytes, "deepest": list(bound.chain)}


@dataclass(frozen=True)
class ResourceUsage:
    """Resource usage of a build.

    Attributes:
        counts: by function without prefix, and CYCLE.
        stacks: likewise.
        sizes: by source file.
        structs: bytes, by name without prefix and suffix.
        blocks: number of basic blocks of the counted functions.
        missed: file and line of the blocks that no call entered, by function.
        in_closed_loop: whether means are over scenarios. They are over drawn inputs if this machine cannot compile the C.
    """

    counts: Mapping[str, Count]
    stacks: Mapping[str, Stack]
    sizes: Mapping[str, Sizes]
    structs: Mapping[str, int]
    blocks: int
    missed: Mapping[str, tuple[str, ...]]
    in_closed_loop: bool


@dataclass(frozen=True)
class LongestStep:
    """Longest step of the controller, limiter included.

    Attributes:
        worst: instructions of the longest step.
        limiter: share of the limiter in them.
        mean: instructions of a usual step.
        calls: number of counted steps.
        worst_input: inputs of the longest step, as text.
    """

    worst: int
    limiter: int
    mean: float
    calls: int
    worst_input: str
