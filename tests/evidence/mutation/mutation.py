"""Part "mutation": a test detects every small fault in the generated C, or the fault is shown to have no effect.

The checks of each unit (see `tests.sil.suite`), which `make test` runs too, judge each of its mutants (see `mutants`). A unit
that is identical in an earlier build is mutated only there. Each surviving mutant needs an argument in equivalent.toml. Every
judge must kill at least one mutant: a check that cannot fail proves nothing.
"""

import gc
import hashlib
import multiprocessing
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from codegen.configuration import Kind
from codegen.console import progress as show_progress
from codegen.sil.toolchain import compiler_command
from codegen.verify.outcomes import Effort, Outcome, Verdict
from tests.evidence.mutation.equivalents import Equivalent, read
from tests.evidence.mutation.judging import SURVIVED, Bench
from tests.evidence.mutation.mutants import Key, Mutant, definitions, mutants_of
from tests.evidence.mutation.planted import planted_in
from tests.evidence.mutation.source import Unit
from tests.evidence.progress import Progress
from tests.sil.case import COMMITTED, Case, named
from tests.sil.library import Compiler
from tests.sil.suite import Judge, judges_of

SHOWS = "the project's own tests detect every small fault in the generated C"
MUTANTS_MIN = 300
"""Smallest number of mutants of a campaign."""
EQUIVALENT_FRACTION_MAX = 0.05
QUICK_COUNT = 300
"""Mutants of a quick campaign: those with the lowest hashes of their names, so that they stay the same."""
PROCESS_COUNT = 2
PLANTED_ONLY = ("tracking rough stack",)
"""Builds with lookup C that the committed ones lack."""

JudgesOf = Callable[[Kind, str], Sequence[Judge]]
"""Function that returns the judges of a unit (path of its source) of a kind of controller."""


@dataclass(frozen=True)
class Judged:
    """A mutant of a build and the judge that killed it, or `SURVIVED`."""

    build: str
    mutant: Mutant
    by: str


@dataclass
class Tally:
    """Result of a campaign: all mutants with their builds, and the judged ones; failures of judges on the original C, which
    prevent any judging; judges that kill no mutant."""

    exist: list[tuple[str, Mutant]] = field(default_factory=list)
    judged: list[Judged] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    powerless: list[str] = field(default_factory=list)


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part. Raises BuildError without a compiler."""
    equivalents = read()
    names = [*(folder.name for folder in folders), *PLANTED_ONLY]
    return outcome_of(campaign(names, most=QUICK_COUNT if effort.quick else None, progress=progress), equivalents)


def campaign(
    names: Sequence[str],
    paths: Sequence[str] | None = None,
    judges_of: JudgesOf = judges_of,
    most: int | None = None,
    progress: Progress | None = None,
) -> Tally:
    """Make and judge the mutants of cases (see `tests.sil.case.named`); cases that are not committed get only planted faults.

    Without `paths` all units are mutated. Without `most` all mutants are run, and every judge is tested.
    """
    tally, progress = Tally(), progress or Progress()
    with ExitStack() as stack:
        cases: list[tuple[Case, dict[str, Unit], dict[str, list[Mutant]]]] = []
        known: set[tuple[str, ...]] = set()
        for name in names:
            scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ars-mutation-")))
            case = named(name, scratch, Compiler(compiler_command()))
            case.compile()
            files = case.built.folder.files
            units = {path: Unit.read(path, files) for path in case.tree.units if paths is None or path in paths}
            own = {path: [*(mutants_of(unit) if name in COMMITTED and definitions(unit) not in known else ()),
                          *planted_in(case, unit)] for path, unit in units.items()}  # fmt: skip
            known |= {definitions(unit) for unit in units.values()}
            cases.append((case, units, own))
            tally.exist += [(case.name, mutant) for mutants in own.values() for mutant in mutants]
        chosen, benches = _chosen(tally.exist, most), []
        for case, units, own in cases:
            some = {path: [one for one in mutants if (case.name, one.key) in chosen] for path, mutants in own.items()}
            some = {path: mutants for path, mutants in some.items() if mutants}
            benches.append(Bench(case, some, units, {path: _applicable(case, judges_of(case.kind, path)) for path in some}))
            benches[-1].prepare()
            tally.faults += [f"{case.name}: unaltered, it fails {name}: {text}" for name, text in benches[-1].faults.items()]
        todo = [(index, path, number) for index, bench in enumerate(benches) for path, mutants in bench.mutants.items()
                for number in range(1, len(mutants) + 1)]  # fmt: skip
        if not tally.faults:
            with _Judges(benches, progress) as judges:
                unaltered: list[Job] = [(index, path, 0, None) for index, bench in enumerate(benches) for path in bench.mutants]
                answers = judges.answers(unaltered, "libraries")
                tally.faults += [f"{benches[index].case.name}/{path}: with no mutant selected, it fails {answer}"
                                 for (index, path, _, _), answer in zip(unaltered, answers, strict=True)
                                 if answer != SURVIVED]  # fmt: skip
                answers = judges.answers([(*one, None) for one in todo], "mutants")
                tally.judged = [Judged(benches[index].case.name, benches[index].mutants[path][number - 1], answer)
                                for (index, path, number), answer in zip(todo, answers, strict=True)]  # fmt: skip
                if most is None:
                    tally.powerless = _ineffective(benches, judges, tally)
    return tally


def _applicable(case: Case, judges: Sequence[Judge]) -> list[Judge]:
    """Return the judges that apply to a case: some know the cap of a map for one friction only."""
    return [judge for judge in judges if not (judge.of_one_layer and case.built.total.layers)]


def _chosen(exist: Sequence[tuple[str, Mutant]], most: int | None) -> set[tuple[str, Key]]:
    """Return build and key of the mutants to run: all, or those with the lowest hashes."""
    keys = [(build, mutant.key) for build, mutant in exist]
    return set(sorted(keys, key=lambda one: hashlib.sha256(f"{one[0]} {one[1]}".encode()).hexdigest())[:most])


Job = tuple[int, str, int, str | None]
"""Bench, path of the unit, number of the mutant, and the only judge; None for all judges in order."""

_benches: Sequence[Bench] = ()
"""Benches, inherited by forked processes."""


class _Judges:
    """Processes that judge, with the results stored by an earlier run."""

    def __init__(self, benches: Sequence[Bench], progress: Progress) -> None:
        global _benches
        _benches = benches
        self._progress = progress

    def __enter__(self) -> Self:
        gc.collect()
        gc.freeze()  # garbage collection would copy the shared memory
        # A forked process that inherits the SIGTERM handler would survive SIGTERM, and the pool would wait for it.
        ending = (signal.SIGTERM, signal.SIG_DFL)
        self._pool = multiprocessing.get_context("fork").Pool(PROCESS_COUNT, signal.signal, ending)
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.terminate()
        gc.unfreeze()

    def answers(self, questions: Sequence[Job], what: str) -> list[str]:
        """Return what kills each mutant, in order."""
        new = [one for one in questions if self._progress.done.get(_named(one)) is None]
        with show_progress(what) as show:
            for done, (question, answer) in enumerate(zip(new, self._pool.imap(_answer, new, chunksize=4), strict=True), 1):
                self._progress.keep(_named(question), answer)
                show(done, len(new))
        return [self._progress.done.get(_named(one)) for one in questions]


def _named(question: Job) -> str:
    index, path, number, judge = question
    bench = _benches[index]
    what = bench.mutants[path][number - 1].key if number else f"{path} unaltered"
    return f"{bench.case.name}: {what}{'' if judge is None else f' alone {judge}'}"


def _answer(question: Job) -> str:
    index, path, number, name = question
    only = next(judge for judge in _benches[index].judges[path] if judge.name == name) if name else None
    return _benches[index].first_to_kill(path, number, only)


def _ineffective(benches: Sequence[Bench], judges: _Judges, tally: Tally) -> list[str]:
    """Return the judges that kill no mutant of any unit, even when they alone judge the mutants that others killed."""
    killed = {(one.build, one.mutant.key) for one in tally.judged if one.by != SURVIVED}
    tries: dict[str, list[Job]] = {}
    for index, bench in enumerate(benches):
        for path, mutants in bench.mutants.items():
            numbers = [k for k, mutant in enumerate(mutants, 1) if (bench.case.name, mutant.key) in killed]
            for judge in bench.judges[path]:
                tries.setdefault(judge.name, []).extend((index, path, number, judge.name) for number in numbers)
    idle = set(tries) - {one.by for one in tally.judged}
    step = 0
    while waiting := [name for name in sorted(idle) if step < len(tries[name])]:
        batch = [question for name in waiting for question in tries[name][step : step + 20]]
        answers = judges.answers(batch, "judges")
        idle -= {name for (_, _, _, name), answer in zip(batch, answers, strict=True) if answer != SURVIVED}
        step += 20
    return sorted(idle)


def outcome_of(tally: Tally, equivalents: Sequence[Equivalent], least: int = MUTANTS_MIN) -> Outcome:
    """Return the outcome: passed if only listed equivalents survive, they are few, and the list has no other entries."""
    argued = {(one.build, one.key) for one in equivalents}
    survived = [one for one in tally.judged if one.by == SURVIVED]
    known = [one for one in survived if (one.build, one.mutant.key) in argued]
    findings = [*tally.faults]
    findings += [_described(one, "no test sees it") for one in survived if (one.build, one.mutant.key) not in argued]
    findings += [_described(one, f"equivalent.toml argues that it is equivalent; {one.by} sees it") for one in tally.judged
                 if one.by != SURVIVED and (one.build, one.mutant.key) in argued]  # fmt: skip
    exist = {(build, mutant.key) for build, mutant in tally.exist}
    findings += [f"equivalent.toml: there is no such mutant: {one.build}: {one.key}" for one in equivalents
                 if (one.build, one.key) not in exist]  # fmt: skip
    findings += [f"{judge}: this judge kills no mutant" for judge in tally.powerless]
    count, killed = len(tally.judged), len(tally.judged) - len(survived)
    if len(known) > EQUIVALENT_FRACTION_MAX * count:
        findings.append(f"{len(known)} of {count} are argued to be equivalent: more than {EQUIVALENT_FRACTION_MAX:.0%}")
    if not tally.faults and count < least:
        findings.append(f"{count} mutants; at least {least} are required")
    figure = f"{killed:,} of {count:,} mutants killed, {len(known)} equivalent"
    figure += f" (a sample of {len(tally.exist):,})" if count < len(tally.exist) else ""
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    total, dead = (Counter(f"{one.build}: {one.mutant.key.path}" for one in these) for these in
                   (tally.judged, [one for one in tally.judged if one.by != SURVIVED]))  # fmt: skip
    figures = {
        **{"exist": len(tally.exist), "run": count, "killed": killed, "equivalent": len(known)},
        "killed_by_unit": {unit: f"{dead[unit]} of {total[unit]}" for unit in sorted(total)},
        "by_kind": dict(sorted(Counter(one.mutant.key.kind for one in tally.judged).items())),
        "planted": {one.mutant.key.text: one.by for one in tally.judged if one.mutant.key.kind == "planted"},
    }
    return Outcome(SHOWS, figure, verdict, tuple(findings), figures)


def _described(one: Judged, what: str) -> str:
    key = one.mutant.key
    nth = f" ({key.occurrence})" if key.occurrence > 1 else ""
    return f"{one.build}/{key.path}:{one.mutant.line}: {key.function}: {key.operator}: `{key.text}`{nth}: {what}"
