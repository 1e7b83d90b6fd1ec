"""Measure instructions, cycles, stack, flash and RAM of a build on a Cortex-M4F."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from codegen.arrays import IntArray
from codegen.emit.can_view import task_view
from codegen.errors import BuildError
from codegen.sil.software import compile_build
from codegen.verify.budgets import workloads
from codegen.verify.budgets.counting import CONDITIONS, MEMORY, MOTION, TASK, Calls, Counter, Rows
from codegen.verify.budgets.program import NoBound
from codegen.verify.budgets.sizes import sizes_of
from codegen.verify.budgets.usage import CYCLE, NOT_COUNTED, Count, LongestStep, ResourceUsage, Stack
from codegen.verify.budgets.worst import Figures, Search, described, spread_of
from codegen.verify.check import Effort, Subject
from codegen.verify.drives import Samples, Thresholds, drawn, recorded

USUAL_SAMPLES = 300
"""Samples of each built-in scenario over which the mean is taken."""

SAMPLES, QUICK_SAMPLES = 1_500, 250
ROUNDS, QUICK_ROUNDS = 12, 3
"""Samples of the drawn drives, and rounds of the search after them. Four times as many of both found no longer cycle."""

NOT_SINGLE = "a build in double precision is not for a Cortex-M4F, whose FPU has single precision"


def measure(subject: Subject, effort: Effort) -> ResourceUsage:
    """Measure all functions of a build.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: a build in double precision, C that does not compile, or does not return.
    """
    return _Measuring(_counter(subject), subject, effort).usage()


def measure_step(subject: Subject, effort: Effort) -> LongestStep:
    """Measure only the controller's step, limiter included, with the same steps as `measure`. Raises as `measure`."""
    return _Measuring(_counter(subject), subject, effort).longest_step()


def _counter(subject: Subject) -> Counter:
    if not subject.is_single:
        raise BuildError(NOT_SINGLE, where="options.precision", remedy="build with --precision single")
    config = subject.config
    return Counter(subject.sources(), subject.prefix, task_view(config))


def _scenarios(subject: Subject) -> tuple[Samples, ...]:
    """Return the measurements of the built-in scenarios; empty if the compiler is missing or rejects the C."""
    try:
        return recorded(compile_build(subject.files, subject.manifest))
    except BuildError:
        return ()


class _Measuring:
    """Measurement of one build, function by function."""

    def __init__(self, counter: Counter, subject: Subject, effort: Effort) -> None:
        self._counter, self._thresholds = counter, Thresholds.of(subject.manifest)
        self._rounds = QUICK_ROUNDS if effort.quick else ROUNDS
        self._generator = np.random.default_rng(0)
        samples = QUICK_SAMPLES if effort.quick else SAMPLES
        anywhere = drawn(self._thresholds, samples)
        scenarios = _scenarios(subject)
        self._usual = [drive[:USUAL_SAMPLES] for drive in scenarios or anywhere[:1]]
        self._in_closed_loop = bool(scenarios)
        extreme = workloads.with_extremes(anywhere, self._thresholds, self._generator)
        self._anywhere = [*extreme, workloads.calm(self._thresholds, 2 * samples, self._generator)]
        self._counts: dict[str, Count] = {}

    def usage(self) -> ResourceUsage:
        self._look_up()
        self._limit()
        longest = self._step().longest().reshape(-1, len(workloads.STEP_COLUMNS))
        packing = self._pack()
        self._run_task(longest, packing)
        blocks, missed = self._missed()
        counter = self._counter
        sizes = {path: sizes_of(content) for path, content in counter.objects.items()}
        return ResourceUsage(self._counts, self._stacks(), sizes, counter.structs, blocks, missed, self._in_closed_loop)

    def longest_step(self) -> LongestStep:
        search = self._step()
        row, figures = search.largest("instructions")
        mean, worst = search.spread("instructions", len(self._usual)).mean, figures["instructions"]
        return LongestStep(worst, worst - figures["own"], mean, search.calls, described(row, workloads.STEP_COLUMNS))

    def _search(self, frame: str, name: str, drives: Sequence[Rows], *judged: str) -> Search:
        start = self._counter.routine(name).start

        def count(rows: Rows) -> Figures:
            calls = self._counter.count(frame, rows)
            calls = calls.where(calls.function == start)  # without the initialisation
            own = calls.instructions - calls.limiter
            return {"instructions": calls.instructions, "cycles": calls.cycles, "own": own}

        search = Search(count, *judged)
        search.run(drives)
        search.improve(self._rounds, self._generator, self._moved if frame == "step" else None)
        return search

    def _moved(self, rows: Rows) -> Rows:
        return workloads.append_to_histories(workloads.histories(self._thresholds), rows)

    def _found(self, search: Search, judged: str, columns: Sequence[str]) -> Count:
        instructions, cycles = search.spread(judged, len(self._usual)), search.spread("cycles", len(self._usual))
        return Count(instructions, cycles, search.calls, described(search.worst_input(), columns))

    def _look_up(self) -> None:
        drives = [
            *workloads.places_of(self._usual, self._generator, special_fraction=0.0),
            *workloads.places_of(self._anywhere, self._generator),
        ]
        for name in self._counter.lookups:
            search = self._search(name.removeprefix("map_"), name, drives, "instructions")
            self._counts[name] = self._found(search, "instructions", workloads.PLACE_COLUMNS)

    def _limit(self) -> None:
        drives = [
            *workloads.demands_of(self._usual, self._thresholds, self._generator, special_fraction=0.0, restarts=0.0),
            *workloads.demands_of(self._anywhere, self._thresholds, self._generator),
        ]
        search = self._search("limiter", "limiter_step", drives, "instructions")
        with self._counter.tight():
            search.run(workloads.demands_of(self._anywhere, self._thresholds, self._generator))
        self._counts["limiter_step"] = self._found(search, "instructions", workloads.DEMAND_COLUMNS)

    def _step(self) -> Search:
        """Measure the controller's step and return the search over all steps."""
        # The same draws, independent of earlier measurements.
        self._generator = np.random.default_rng(2)
        drives = [
            *workloads.steps_of(self._usual, self._generator, restarts=0.0),
            *workloads.steps_of(self._anywhere, self._generator),
        ]
        search = self._search("step", "controller_step", drives, "own", "instructions")
        for history in workloads.long_histories(self._thresholds):
            self._counter.run("step", history.before)
            search.run([history.then])
        with self._counter.tight():
            search.run(workloads.steps_of(self._anywhere, self._generator))
        found = self._found(search, "own", workloads.STEP_COLUMNS)
        whole = search.spread("instructions", len(self._usual))
        self._counts["controller_step"] = Count(found.instructions, found.cycles, found.calls, found.worst_input, whole)
        return search

    def _pack(self) -> int:
        """Return the largest number of instructions for packing the command frame."""
        rows = workloads.results_of(self._thresholds, SAMPLES, self._generator)
        return int(self._counter.count("send", rows).instructions.max())

    def _run_task(self, longest: Rows, packing: int) -> None:
        generator, counter = self._generator, self._counter
        usual = workloads.steps_of(self._usual, generator, restarts=0.0)
        anything = workloads.steps_of(self._anywhere, generator)
        parts: dict[int, list[Calls]] = {MOTION: [], CONDITIONS: [], TASK: []}

        def count(rows: Rows) -> Figures:
            events = workloads.events_of(rows, counter)
            calls, kinds = counter.count("task", events.events), events.events["kind"]
            for kind, found in parts.items():
                found.append(calls.where(kinds == kind))
            inside = np.isin(kinds, list(parts))

            def summed(values: IntArray) -> IntArray:
                totals = np.bincount(events.row[inside], weights=values[inside], minlength=len(rows)).astype(np.int64)
                return np.where(events.regular, totals, NOT_COUNTED)

            return {
                "instructions": summed(calls.instructions),
                "cycles": summed(calls.cycles),
                "without_packing": summed(calls.instructions - calls.packing),
            }

        search = Search(count, "instructions")
        drives = workloads.cycles_of(usual, generator, [0.0] * len(usual))
        drives += [*workloads.cycles_of([longest], generator, [0.0]), *workloads.cycles_of(anything, generator)]
        search.run(drives)
        search.improve(self._rounds, generator, self._moved)
        for history in workloads.long_task_histories(self._thresholds):
            counter.run("task", workloads.events_of(history.before, counter).events)
            search.run([history.then])
        with counter.tight():
            search.run(workloads.cycles_of(workloads.steps_of(self._anywhere, generator), generator))
        counter.count("task", workloads.flooded())
        names = {MOTION: "on_can_frame, motion", CONDITIONS: "on_can_frame, conditions", TASK: counter.task_name}
        for kind, name in names.items():
            calls, typical = Calls.joined(parts[kind]), Calls.joined(parts[kind][: len(usual)])
            instructions, cycles = spread_of(calls.instructions, typical.instructions), spread_of(calls.cycles, typical.cycles)
            self._counts[name] = Count(instructions, cycles, len(calls.instructions))
        found = self._found(search, "instructions", workloads.CYCLE_COLUMNS)
        bound = search.spread("without_packing", len(usual)).largest + packing
        self._counts[CYCLE] = Count(found.instructions, found.cycles, found.calls, found.worst_input, bound=bound)

    def _stacks(self) -> dict[str, Stack]:
        counter, found = self._counter, {}
        called = {name: (name.removeprefix("map_"), name) for name in counter.lookups} | {
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

    def _missed(self) -> tuple[int, dict[str, tuple[str, ...]]]:
        """Return the number of blocks of the counted functions, and file and line of those never entered, by function."""
        program, entered, total, missed = self._counter.program, self._counter.entered, 0, {}
        for routine in self._counter.counted():
            if routine.unit == MEMORY:
                continue
            blocks = routine.blocks(start for start, _ in entered)
            not_entered = [
                block[0].address for block in blocks if not any(start <= block[0].address < end for start, end in entered)
            ]
            total += len(blocks)
            if not_entered:
                missed[routine.name] = tuple(program.line_of(address) for address in not_entered)
        return total, missed
