"""Compare times measured in turns, reported as medians with ranges."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from benchmarks.tables import markdown_table, text_table

Clock = Callable[[], float]
HEADER = ("what", "peer", "ours", "times faster", "required")
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"))


@dataclass(frozen=True)
class Times:
    """Name of a measured call, and the duration of each repetition, in s."""

    name: str
    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """s."""
        return statistics.median(self.seconds)

    def each(self, count: int) -> Times:
        """Return the time of one of `count` equal parts."""
        return Times(self.name, tuple(value / count for value in self.seconds))

    def __str__(self) -> str:
        """Format name, median and, for several times, the range: "IPOPT 1.23 ms (1.2–1.4)"."""
        scale, unit = next((entry for entry in UNITS if self.median >= entry[0]), UNITS[-1])
        shown = f"{self.name} {number(self.median / scale)} {unit}"
        if len(self.seconds) > 1:
            shown += f" ({number(min(self.seconds) / scale)}–{number(max(self.seconds) / scale)})"
        return shown


def once(work: Callable[[], object], clock: Clock = time.perf_counter) -> float:
    """Return the time of one call in s, without the garbage collector."""
    gc.collect()
    gc.disable()
    try:
        start = clock()
        work()
        return clock() - start
    finally:
        gc.enable()


def interleaved(works: Mapping[str, Callable[[], object]], repeats: int, clock: Clock = time.perf_counter) -> dict[str, Times]:
    """Time the works in turns, so that a slow period of the machine affects all; every other round is reversed.

    A first round, which fills caches and loads modules, is not counted. Durations of one round have the same index.
    """
    seconds: dict[str, list[float]] = {name: [] for name in works}
    for work in works.values():
        work()
    for round_number in range(repeats):
        order = list(works)
        for name in order if round_number % 2 == 0 else reversed(order):
            seconds[name].append(once(works[name], clock))
    return {name: Times(name, tuple(values)) for name, values in seconds.items()}


@dataclass(frozen=True)
class Comparison:
    """One line of a table: what was done, the peer's times and ours.

    Attributes:
        required: how many times faster than the peer ours has to be.
        paired: whether times of the same index were taken side by side.
        same: whether both gave the same answer, where answers were compared.
    """

    what: str
    peer: Times
    ours: Times
    required: float | None = None
    paired: bool = True
    same: bool = True

    @property
    def ratios(self) -> tuple[float, ...]:
        """Return our speed-up for each pair; of the medians if there are no pairs."""
        if not self.paired:
            return (self.peer.median / self.ours.median,)
        return tuple(theirs / own for theirs, own in zip(self.peer.seconds, self.ours.seconds, strict=True))

    @property
    def ratio(self) -> float:
        """The median of `ratios`."""
        return statistics.median(self.ratios)

    @property
    def met(self) -> bool:
        """Whether ours gave the same answer, as much faster as it has to."""
        return self.same and (self.required is None or self.ratio >= self.required)

    @property
    def cells(self) -> tuple[str, ...]:
        """Format for a terminal."""
        ratio = number(self.ratio)
        if len(self.ratios) > 1:
            ratio += f" ({number(min(self.ratios))}–{number(max(self.ratios))})"
        required = "-" if self.required is None else f">= {number(self.required)}: {'met' if self.met else 'MISSED'}"
        if not self.same:
            required += ", NOT THE SAME ANSWER"
        return self.what, str(self.peer), str(self.ours), ratio, required


@dataclass(frozen=True)
class Report:
    """Result of a benchmark: a table and notes."""

    title: str
    comparisons: tuple[Comparison, ...]
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        table = text_table(self.title, HEADER, [line.cells for line in self.comparisons]) if self.comparisons else [self.title]
        return "\n".join([*table, *(f"  {note}" for note in self.notes)])

    def markdown(self) -> str:
        """Format as Markdown."""
        table = [markdown_table(HEADER, [line.cells for line in self.comparisons]), ""] if self.comparisons else []
        return "\n".join([f"## {self.title}", "", *table, *(f"- {note}" for note in self.notes)]).rstrip()


def number(value: float) -> str:
    """Format with three digits, more only before the point."""
    return f"{value:,.0f}" if abs(value) >= 99.95 else f"{value:.3g}"
