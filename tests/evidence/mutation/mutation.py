"""Mutation of the generated C: is there a fault of one hand's slip that no test sees?

Every mutant (see `mutants`) of every unit is compiled and judged by the project's own tests (see `suite`). A unit that stands
word for word in a build before is mutated there only; else all of it is mutated again, since what a function does hangs on the
constants and functions beside it. Those that survive must be argued to be equivalent in equivalent.toml, one by one.
"""

from __future__ import annotations

import gc
import hashlib
import multiprocessing
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from codegen.console import progress
from codegen.sil.toolchain import compiler_command
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from tests.evidence.mutation.equivalents import Equivalent, read
from tests.evidence.mutation.fates import Bench, Fate, Judged, fate_of
from tests.evidence.mutation.mutants import Key, Mutant, definitions, mutants_of
from tests.evidence.mutation.source import Unit
from tests.sil.case import Case, case_of
from tests.sil.library import Compiler
from tests.sil.suite import Judge, judges_of

SHOWS = "the project's own tests see every small fault in the generated C"
LEAST = 300
"""Mutants, at least."""
EQUIVALENT_SHARE_MAX = 0.05
QUICK = 400
"""Mutants of a quick run: those whose names have the lowest hashes."""
PROCESSES = 2

JudgesOf = Callable[[Case, str], Sequence[Judge]]


@dataclass(frozen=True)
class Campaign:
    """What is mutated and how much of it.

    Attributes:
        folders: builds. paths: of the units, None for all. judges_of: who judges.
        most: mutants to run, None for all.
    """

    folders: Sequence[Path]
    paths: Sequence[str] | None = None
    judges_of: JudgesOf = judges_of
    most: int | None = None


@dataclass(frozen=True)
class Tally:
    """What came of it.

    Attributes:
        exist: mutants that there are. judged: those that were run.
        faults: what keeps the judges from judging: the unaltered C does not pass.
    """

    exist: list[tuple[str, Mutant]]
    judged: list[Judged]
    faults: list[str]

    def of(self, fate: Fate) -> list[Judged]:
        """Those of a fate."""
        return [one for one in self.judged if one.fate is fate]


def run(folders: Sequence[Path], effort: Effort) -> Outcome:
    """The part of the campaign. Raises BuildError where there is no compiler."""
    equivalents = read()
    tally = campaign(Campaign(folders, most=QUICK if effort.quick else None))
    return outcome_of(tally, equivalents)


def campaign(of: Campaign) -> Tally:
    """Make and judge the mutants."""
    with ExitStack() as stack:
        benches: list[Bench] = []
        todo: list[tuple[int, Mutant]] = []
        before: set[tuple[str, ...]] = set()
        for folder in of.folders:
            scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ars-mutation-")))
            case = case_of(folder, scratch, Compiler(compiler_command()))
            bench = Bench.of(case, of.judges_of, [path for path in case.tree.units if of.paths is None or path in of.paths])
            own = [path for path in bench.judges if definitions(bench.units[path]) not in before]
            todo += [(len(benches), one) for path in own for one in mutants_of(bench.units[path])]
            before |= {definitions(unit) for unit in bench.units.values()}
            benches.append(bench)
        names = [bench.case.name for bench in benches]
        exist = [(names[index], one) for index, one in todo]
        faults = [
            f"{bench.case.name}: unaltered, it fails {name}: {said}" for bench in benches for name, said in bench.faults.items()
        ]
        judged = [] if faults else _judge(benches, _chosen(todo, of.most))
    return Tally(exist, judged, faults)


def all_keys(folders: Sequence[Path]) -> set[tuple[str, Key]]:
    """Build and name of every mutant that there is, nothing compiled."""
    keys: set[tuple[str, Key]] = set()
    before: set[tuple[str, ...]] = set()
    for folder in folders:
        subject = Subject.read(folder)
        units = [Unit.read(path, subject.files) for path in sorted(subject.sources("src"))]
        own = [unit for unit in units if definitions(unit) not in before]
        keys |= {(subject.name, mutant.key) for unit in own for mutant in mutants_of(unit)}
        before |= set(map(definitions, units))
    return keys


def _chosen(todo: list[tuple[int, Mutant]], most: int | None) -> list[tuple[int, Mutant]]:
    """As many as are to be run, the same ones each time."""
    if most is None or most >= len(todo):
        return todo

    def rank(one: tuple[int, Mutant]) -> str:
        return hashlib.sha256(f"{one[0]} {one[1].key}".encode()).hexdigest()

    kept = sorted(map(rank, todo))[most - 1]
    return [one for one in todo if rank(one) <= kept]


_at_work: tuple[Any, ...] = ()
"""Benches and mutants, for processes that are copies of this one."""


def _judge(benches: list[Bench], todo: list[tuple[int, Mutant]]) -> list[Judged]:
    global _at_work
    _at_work = (benches, todo)
    gc.collect()
    gc.freeze()  # a collection would copy all that the processes share
    fates: list[tuple[Fate, str]] = []
    # A copy of a process that catches SIGTERM would not be ended by it, and the pool would wait for it for ever.
    ending = (signal.SIGTERM, signal.SIG_DFL)
    with multiprocessing.get_context("fork").Pool(PROCESSES, signal.signal, ending) as pool, progress("mutants") as tell:
        for fate in pool.imap(_judge_one, range(len(todo)), chunksize=8):
            fates.append(fate)
            tell(len(fates), len(todo))
    gc.unfreeze()
    _at_work = ()
    return [Judged(benches[index].case.name, mutant, *fate) for (index, mutant), fate in zip(todo, fates, strict=True)]


def _judge_one(number: int) -> tuple[Fate, str]:
    benches, todo = _at_work
    index, mutant = todo[number]
    judged = fate_of(benches[index], mutant)
    return judged.fate, judged.by


def outcome_of(tally: Tally, equivalents: Sequence[Equivalent], least: int = LEAST) -> Outcome:
    """Passed where all were killed but equivalents, these are few, and the list holds nothing else."""
    argued = {(one.build, one.key) for one in equivalents}
    survived = tally.of(Fate.SURVIVED)
    known = [one for one in survived if (one.build, one.mutant.key) in argued]
    findings = [*tally.faults]
    findings += [_told(one, "no test sees it") for one in survived if (one.build, one.mutant.key) not in argued]
    findings += [_told(one, f"does not compile: {one.by}") for one in tally.of(Fate.STILLBORN)]
    for one in tally.of(Fate.KILLED):
        if (one.build, one.mutant.key) in argued:
            findings.append(_told(one, f"is no equivalent, as equivalent.toml has it: {one.by} sees it"))
    exist = {(build, mutant.key) for build, mutant in tally.exist}
    findings += [f"equivalent.toml: there is no such mutant: {one.build}: {one.key}" for one in equivalents
                 if (one.build, one.key) not in exist]  # fmt: skip
    count = len(tally.judged)
    if len(known) > EQUIVALENT_SHARE_MAX * count:
        findings.append(f"{len(known)} of {count} are argued to be equivalent: more than {EQUIVALENT_SHARE_MAX:.0%}")
    if not tally.faults and count < least:
        findings.append(f"{count} mutants; at least {least} are asked for")
    killed = len(tally.of(Fate.KILLED))
    figure = f"{killed:,} of {count:,} mutants killed, {len(known)} equivalent"
    if count < len(tally.exist):
        figure += f" (of {len(tally.exist):,} that there are)"
    return Outcome(
        SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), figures_of(tally, len(known))
    )


def figures_of(tally: Tally, equivalent: int) -> dict[str, Any]:
    """Counts, in all and by unit and kind of mutant."""
    by_unit = Counter(f"{one.build}: {one.mutant.key.path}" for one in tally.judged)
    by_kind = Counter(one.mutant.key.kind for one in tally.judged)
    return {
        "exist": len(tally.exist),
        "run": len(tally.judged),
        "killed": len(tally.of(Fate.KILLED)),
        "equivalent": equivalent,
        "equivalent_percent": round(100.0 * equivalent / max(len(tally.judged), 1), 2),
        "by_unit": dict(sorted(by_unit.items())),
        "by_kind": dict(sorted(by_kind.items())),
    }


def _told(one: Judged, what: str) -> str:
    key = one.mutant.key
    nth = f" ({key.occurrence})" if key.occurrence > 1 else ""
    return f"{one.build}/{key.path}:{one.mutant.line}: {key.function}: {key.operator}: `{key.text}`{nth}: {what}"
