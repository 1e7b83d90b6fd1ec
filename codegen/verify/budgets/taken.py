"""What a build takes on a Cortex-M4F, in figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from codegen.verify.budgets.program import Depth
from codegen.verify.budgets.sizes import Sizes
from codegen.verify.budgets.worst import Spread

CYCLE = "cycle"
"""Name of what a period takes: both frames received, and the task's function."""

NOT_COUNTED = -1


@dataclass(frozen=True)
class Count:
    """Of one function.

    Attributes:
        instructions: of its calls, all that it calls included; of a step without the limiter.
        cycles: estimated, of the whole call.
        calls: how many were made.
        worst_input: of the longest call, in words.
        with_limiter: of a step: instructions with the limiter's.
        bound: of a cycle: the longest one if the packing of its frame had taken the longest too, for which both values have to
            lie exactly between two codes; no search finds such a cycle.
    """

    instructions: Spread
    cycles: Spread
    calls: int
    worst_input: str = ""
    with_limiter: Spread | None = None
    bound: int | None = None

    @property
    def judged(self) -> int:
        """What is compared with a budget."""
        return self.instructions.largest if self.bound is None else self.bound

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
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
    """Of one function, and of what starts its state: the deepest that was seen, and the most that they can take; None where
    that has no bound, and why."""

    watermark: int
    bound: Depth | None
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        bound = self.bound or Depth(NOT_COUNTED, ())
        return {"watermark": self.watermark, "bound": bound.bytes, "deepest": list(bound.chain)}


@dataclass(frozen=True)
class Taken:
    """What a build takes.

    Attributes:
        counts: by function, without the prefix; CYCLE among them.
        stacks: the same way.
        sizes: by source file.
        structs: bytes, by name without prefix and suffix.
        blocks: basic blocks of the counted functions.
        missed: those that no call entered: file and line, by function.
        in_closed_loop: whether the means are over scenarios; else, where this machine cannot compile the C, over drawn inputs.
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
    """A step of the controller with its limiter: what a caller of it waits for.

    Attributes:
        worst: instructions of the longest step.
        limiter: those of them that are the limiter's.
        mean: instructions of a usual step.
        calls: how many steps were counted.
        worst_input: of the longest one, in words.
    """

    worst: int
    limiter: int
    mean: float
    calls: int
    worst_input: str
