"""Comparison of two implementations on inputs that repeat for hours, without hours of the slow one.

Both implementations are run side by side until the state of the second one, in Python, recurs. From there on its outputs
repeat with the inputs, so that only the C has to be run, and each of its outputs is compared with the one in the cycle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

STATEFUL = ("codegen.verify.law.", "hil_sim.e2e", "codegen.configuration.signals")
"""Modules of the classes whose attributes are the state. Other objects, such as parameters and the map, do not change."""
SETTLING_MAX = 8_000
"""Largest number of inputs after which the state must recur."""


class Pair(ABC):
    """One unit in C and its second implementation, both in the same state."""

    @abstractmethod
    def second(self, sample: Any) -> Any:
        """Advance the second implementation and return its output."""

    @abstractmethod
    def compiled(self, sample: Any) -> Any:
        """Advance the C and return its output, comparable with that of `second`."""

    @abstractmethod
    def state(self) -> Any:
        """Return the objects that hold the state of the second implementation."""

    def first_difference(self, samples: Sequence[Any], wanted: Sequence[Any], rounds: int) -> tuple[int, Any] | None:
        """Run the C on the samples a number of times. Return index and output of the first difference."""
        compiled, number = self.compiled, 0
        for _ in range(rounds):
            for sample, output in zip(samples, wanted, strict=True):
                got = compiled(sample)
                if got != output:
                    return number, got
                number += 1
        return None

    def text(self, output: Any) -> str:
        """Format an output."""
        return str(output)


@dataclass(frozen=True)
class Stretch:
    """Inputs that are repeated a number of times."""

    samples: Sequence[Any]
    rounds: int = 1


@dataclass
class Result:
    """Result of a comparison.

    Attributes:
        difference: index of the first output that differs, the output of the C and that of the second implementation.
        compared: number of outputs computed by both.
        repeated: number of outputs of the C compared with those of the cycle.
        unsettled: number of stretches that were cut because the state did not recur.
    """

    difference: tuple[int, Any, Any, Any] | None = None
    compared: int = 0
    repeated: int = 0
    unsettled: int = 0


def compare(pair: Pair, stretches: Iterable[Stretch]) -> Result:
    """Run both implementations on stretches in order, until an output differs."""
    result = Result()
    for stretch in stretches:
        _compare_stretch(pair, stretch, result)
        if result.difference is not None:
            break
    return result


def _compare_stretch(pair: Pair, stretch: Stretch, result: Result) -> None:
    samples, left = stretch.samples, stretch.rounds
    outputs: list[Any] = []
    seen: dict[Hashable, int] = {}
    has_recurred = stretch.rounds == 1

    def run_compiled(wanted: Sequence[Any], rounds: int) -> bool:
        """Return whether the C gives the wanted outputs."""
        period = [*samples] * (len(wanted) // len(samples))
        found = pair.first_difference(period, wanted, rounds)
        if found is not None:
            index, got = found
            at = index % len(wanted)
            result.difference = (result.compared + result.repeated + index, period[at], got, wanted[at])
        return found is None

    while left:
        wanted = [pair.second(sample) for sample in samples]
        if not run_compiled(wanted, 1):
            return
        left -= 1
        result.compared += len(samples)
        if has_recurred:
            continue
        outputs += wanted
        state = state_of(pair.state())
        if state in seen:
            cycle = outputs[seen[state] :]
            rounds = left // (len(cycle) // len(samples))
            if not run_compiled(cycle, rounds):
                return
            result.repeated += rounds * len(cycle)
            left -= rounds * (len(cycle) // len(samples))
            has_recurred = True
        elif len(outputs) >= SETTLING_MAX:
            result.unsettled += 1
            return
        seen[state] = len(outputs)


def state_of(value: Any) -> Hashable:
    """Return a value that is equal for equal states only: numbers by their bits, unchanging objects by their identity."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tobytes()
    if isinstance(value, float):
        return value.hex()
    if value is None or isinstance(value, int | str | bytes | Enum):
        return value
    if isinstance(value, list | tuple | deque):
        return tuple(map(state_of, value))
    if isinstance(value, set):
        return frozenset(map(state_of, value))
    if isinstance(value, dict):
        return tuple((key, state_of(each)) for key, each in value.items())
    if type(value).__module__.startswith(STATEFUL) and not getattr(value, "is_constant", False):
        return tuple(state_of(each) for name, each in vars(value).items())
    return id(value)
