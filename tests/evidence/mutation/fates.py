"""What becomes of a mutant: compiled into a case, and asked by the judges of its unit in a process of its own."""

from __future__ import annotations

import faulthandler
import os
import resource
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from codegen.errors import BuildError
from tests.evidence.mutation.mutants import Mutant
from tests.evidence.mutation.source import Unit
from tests.sil.case import Case
from tests.sil.suite import Judge

SECONDS_MORE, TIMES_LONGER = 1.0, 10.0
"""Of processor time that a judge of a mutant may take, beyond and over what it takes for the unaltered C: a loop that no longer
ends is a loop that is seen. Processor time, so that a busy machine kills nothing."""


class Fate(StrEnum):
    """What became of a mutant."""

    KILLED = "killed"
    SURVIVED = "survived"
    STILLBORN = "does not compile"


@dataclass(frozen=True)
class Judged:
    """A mutant with its fate.

    Attributes:
        by: the judge that saw it, or what ended the process.
    """

    build: str
    mutant: Mutant
    fate: Fate
    by: str = ""


@dataclass(frozen=True, eq=False)
class Bench:
    """A case whose unaltered C is compiled, with its units, judges and their time.

    Attributes:
        judges: by path of the unit. seconds: of processor time, by name of the judge.
        faults: judges that the unaltered C does not pass, with what they say.
    """

    case: Case
    units: Mapping[str, Unit]
    judges: Mapping[str, Sequence[Judge]]
    seconds: Mapping[str, float] = field(default_factory=dict)
    faults: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, case: Case, judges_of: Callable[[Case, str], Sequence[Judge]], paths: Sequence[str]) -> Bench:
        """Compile, and ask every judge twice: the first time works out what is kept."""
        case.compiler.compile_all(case.tree)
        case.open(case.tree.root / "unaltered.so")
        judges = {path: list(judges_of(case, path)) for path in paths}
        seconds: dict[str, float] = {}
        faults: dict[str, str] = {}
        for judge in {judge.name: judge for those in judges.values() for judge in those}.values():
            for _ in range(2):
                begun = time.process_time()
                try:
                    judge.run(case)
                except Exception as error:
                    faults[judge.name] = f"{type(error).__name__} {error}".strip().partition("\n")[0]
                seconds[judge.name] = time.process_time() - begun
        units = {path: Unit.read(path, case.built.folder.files) for path in case.tree.units}
        return cls(case, units, judges, seconds, faults)


def fate_of(bench: Bench, mutant: Mutant) -> Judged:
    """Compile a mutant, link it with the rest, and ask."""
    case, path = bench.case, mutant.key.path
    name = f"mutant-{os.getpid()}"
    source, target = Path(f"{name}.c"), case.tree.root / f"{name}.o"
    (case.tree.root / source).write_text(mutant.source(bench.units[path]), encoding="ascii")
    try:
        case.compiler.compile(case.tree.root, str(source), target, case.compiler.measuring)
    except BuildError as error:
        return Judged(case.name, mutant, Fate.STILLBORN, str(error))
    seen = _in_a_process(lambda: _first_to_see(bench, path, target))
    return Judged(case.name, mutant, Fate.KILLED if seen else Fate.SURVIVED, seen)


def _first_to_see(bench: Bench, path: str, target: Path) -> str:
    """Name of the first judge that does not pass; empty where all do. Called in a process that ends after it."""
    case = bench.case
    case.instead[path] = target
    case.open(target.with_suffix(".so"))
    signal.signal(signal.SIGVTALRM, signal.SIG_DFL)
    for judge in bench.judges[path]:
        signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS_MORE + TIMES_LONGER * bench.seconds[judge.name])
        try:
            judge.run(case)
        except OSError:
            raise  # of this machine, not of the mutant
        except Exception:
            return judge.name
    return ""


def _in_a_process(ask: Callable[[], str]) -> str:
    """What a function gives in a copy of this process; or what ended that.

    Raises:
        RuntimeError: it did not come to an answer for a reason that is not the mutant's.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            faulthandler.disable()
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what a crash has to say is of no interest
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            os.write(writing, ask().encode())
            os._exit(0)
        except BaseException as error:
            os.write(writing, repr(error).encode())
        finally:
            os._exit(3)
    os.close(writing)
    with open(reading, "rb") as pipe:  # noqa: PTH123 - a descriptor
        said = pipe.read().decode(errors="replace")
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return "a loop that does not end" if number == signal.SIGVTALRM else signal.Signals(number).name
    if os.WEXITSTATUS(status) != 0:
        raise RuntimeError(f"a mutant could not be judged: {said}")
    return said
