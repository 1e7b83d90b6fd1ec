"""What a build takes on a Cortex-M4F: instructions, cycles and stack of its functions, flash and RAM of its objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from codegen.emit.can_view import task_view
from codegen.errors import BuildError
from codegen.sil.software import compile_build
from codegen.verify.budgets import workloads
from codegen.verify.budgets.counting import CONDITIONS, MEMORY, MOTION, TASK, Calls, Counter, Rows
from codegen.verify.budgets.program import NoBound
from codegen.verify.budgets.sizes import sizes_of
from codegen.verify.budgets.taken import CYCLE, NOT_COUNTED, Count, LongestStep, Stack, Taken
from codegen.verify.budgets.worst import Figures, Search, described, spread_of
from codegen.verify.check import Effort, Subject
from codegen.verify.drives import Drive, Ground, drawn, recorded
from codegen.verify.target.emulator import IntArray

USUAL_SAMPLES = 300
"""Of each of the built-in scenarios: where the mean is taken."""

SAMPLES, QUICK_SAMPLES = 1_500, 500
ROUNDS, QUICK_ROUNDS = 12, 5
"""Of the drawn drives, and of the search behind them. Four times as many of both found no longer cycle."""

NOT_SINGLE = "a build in double precision is not for a Cortex-M4F, whose FPU has single precision"


def measure(subject: Subject, effort: Effort) -> Taken:
    """Count everything.

    Raises:
        CodegenError: a package of the extra is missing.
        BuildError: a build in double precision, C that does not compile, or does not return.
    """
    return _Measuring(_counter(subject), subject, effort).taken()


def measure_step(subject: Subject, effort: Effort) -> LongestStep:
    """Count the controller's step alone, limiter included: the same steps as in `measure`. Raises as `measure`."""
    return _Measuring(_counter(subject), subject, effort).longest_step()


def _counter(subject: Subject) -> Counter:
    if not subject.is_single:
        raise BuildError(NOT_SINGLE, where="options.precision", remedy="build with --precision single")
    config = subject.config
    return Counter(subject.sources(), subject.prefix, task_view(config))


def _scenarios(subject: Subject) -> tuple[Drive, ...]:
    """What the controller measures in the built-in scenarios; none where the compiler here is missing, or refuses the C."""
    try:
        return recorded(compile_build(subject.files, subject.manifest))
    except BuildError:
        return ()


class _Measuring:
    """One build, one after the other of its functions."""

    def __init__(self, counter: Counter, subject: Subject, effort: Effort) -> None:
        self._counter, self._ground = counter, Ground.of(subject.manifest)
        self._rounds = QUICK_ROUNDS if effort.quick else ROUNDS
        self._generator = np.random.default_rng(0)
        samples = QUICK_SAMPLES if effort.quick else SAMPLES
        anywhere = drawn(self._ground, samples)
        scenarios = _scenarios(subject)
        self._usual = [drive[:USUAL_SAMPLES] for drive in scenarios or anywhere[:1]]
        self._in_closed_loop = bool(scenarios)
        extreme = workloads.with_extremes(anywhere, self._ground, self._generator)
        self._anywhere = [*extreme, workloads.calm(self._ground, 2 * samples, self._generator)]
        self._counts: dict[str, Count] = {}

    def taken(self) -> Taken:
        self._look_up()
        self._limit()
        longest = self._step().longest().reshape(-1, len(workloads.STEP_COLUMNS))
        packing = self._pack()
        self._run_task(longest, packing)
        blocks, missed = self._missed()
        counter = self._counter
        sizes = {path: sizes_of(content) for path, content in counter.objects.items()}
        return Taken(self._counts, self._stacks(), sizes, counter.structs, blocks, missed, self._in_closed_loop)

    def longest_step(self) -> LongestStep:
        search = self._step()
        row, figures = search.largest("instructions")
        mean, worst = search.spread("instructions", len(self._usual)).mean, figures["instructions"]
        return LongestStep(worst, worst - figures["own"], mean, search.calls, described(row, workloads.STEP_COLUMNS))

    def _search(self, frame: str, name: str, drives: Sequence[Rows], *judged: str) -> Search:
        start = self._counter.routine(name).start

        def count(rows: Rows) -> Figures:
            calls = self._counter.count(frame, rows)
            calls = calls.where(calls.function == start)  # without what starts it afresh
            own = calls.instructions - calls.limiter
            return {"instructions": calls.instructions, "cycles": calls.cycles, "own": own}

        search = Search(count, *judged)
        search.run(drives)
        search.improve(self._rounds, self._generator, self._moved if frame == "step" else None)
        return search

    def _moved(self, rows: Rows) -> Rows:
        return workloads.behind(workloads.histories(self._ground), rows)

    def _found(self, search: Search, judged: str, columns: Sequence[str]) -> Count:
        instructions, cycles = search.spread(judged, len(self._usual)), search.spread("cycles", len(self._usual))
        return Count(instructions, cycles, search.calls, described(search.worst_input(), columns))

    def _look_up(self) -> None:
        drives = [
            *workloads.places_of(self._usual, self._generator, strange=0.0),
            *workloads.places_of(self._anywhere, self._generator),
        ]
        for name in self._counter.lookups:
            search = self._search(name.removeprefix("map_"), name, drives, "instructions")
            self._counts[name] = self._found(search, "instructions", workloads.PLACE_COLUMNS)

    def _limit(self) -> None:
        drives = [
            *workloads.demands_of(self._usual, self._ground, self._generator, strange=0.0, restarts=0.0),
            *workloads.demands_of(self._anywhere, self._ground, self._generator),
        ]
        search = self._search("limiter", "limiter_step", drives, "instructions")
        with self._counter.tight():
            search.run(workloads.demands_of(self._anywhere, self._ground, self._generator))
        self._counts["limiter_step"] = self._found(search, "instructions", workloads.DEMAND_COLUMNS)

    def _step(self) -> Search:
        """Gives all steps."""
        # The same draws whatever was counted before.
        self._generator = np.random.default_rng(2)
        drives = [
            *workloads.steps_of(self._usual, self._generator, restarts=0.0),
            *workloads.steps_of(self._anywhere, self._generator),
        ]
        search = self._search("step", "controller_step", drives, "own", "instructions")
        for way in workloads.long_ways(self._ground):
            self._counter.run("step", way.before)
            search.run([way.then])
        with self._counter.tight():
            search.run(workloads.steps_of(self._anywhere, self._generator))
        found = self._found(search, "own", workloads.STEP_COLUMNS)
        whole = search.spread("instructions", len(self._usual))
        self._counts["controller_step"] = Count(found.instructions, found.cycles, found.calls, found.worst_input, whole)
        return search

    def _pack(self) -> int:
        """Gives the most instructions that the frame of the command takes to be packed."""
        rows = workloads.results_of(self._ground, SAMPLES, self._generator)
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
        for way in workloads.long_ways_of_task(self._ground):
            counter.run("task", workloads.events_of(way.before, counter).events)
            search.run([way.then])
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
        """How many blocks the counted functions have, and where those are that were never entered."""
        program, entered, total, missed = self._counter.program, self._counter.entered, 0, {}
        for routine in self._counter.counted():
            if routine.unit == MEMORY:
                continue
            blocks = routine.blocks(start for start, _ in entered)
            never = [block[0].address for block in blocks if not any(start <= block[0].address < end for start, end in entered)]
            total += len(blocks)
            if never:
                missed[routine.name] = tuple(program.line_of(address) for address in never)
        return total, missed
