"""Judging of mutants: one library for each unit, one process for each mutant, the tests of the unit as judges."""

import faulthandler
import os
import resource
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.evidence.mutation.mutants import Mutant
from tests.evidence.mutation.one_library import source_with
from tests.evidence.mutation.source import Unit
from tests.sil.case import Case
from tests.sil.suite import Judge

SECONDS_MORE, TIMES_LONGER = 0.5, 10.0
"""Processor time that a judge may take for a mutant, beyond and in multiples of its time for the unaltered C: a loop without
end is killed by it. Processor time, so that a busy machine kills nothing."""

SURVIVED = ""
"""The answer of `Bench.first_to_kill` where every judge passes."""


@dataclass(eq=False)
class Bench:
    """A build whose units can be exchanged for those with mutants.

    Judges are by path of the unit; their processor time in seconds for the unaltered C, and the messages of those that the
    unaltered C fails, by name. A campaign needs no such faults.
    """

    case: Case
    mutants: dict[str, list[Mutant]]
    units: dict[str, Unit]
    judges: dict[str, list[Judge]]
    seconds: dict[str, float] = field(default_factory=dict)
    faults: dict[str, str] = field(default_factory=dict)

    def prepare(self) -> None:
        """Run every judge twice, since the first run prepares what is kept; compile the library of each unit."""
        for judge in {judge.name: judge for judges in self.judges.values() for judge in judges}.values():
            for _ in range(2):
                begun = time.process_time()
                try:
                    judge.run(self.case)
                except Exception as error:
                    self.faults[judge.name] = f"{type(error).__name__} {error}".strip().partition("\n")[0]
                self.seconds[judge.name] = time.process_time() - begun
        for path, mutants in self.mutants.items():
            self.case.compile_instead(path, source_with(self.units[path], mutants))

    def first_to_kill(self, path: str, number: int, only: Judge | None = None) -> str:
        """Return the name of the first judge that a mutant fails, or what ended its process; `SURVIVED` otherwise.

        Mutants have numbers from 1; 0 is the unaltered unit in the library of its mutants. Raises RuntimeError: the machine,
        not the mutant, keeps the judges from an answer.
        """
        unit = self.units[path]
        source = self.mutants[path][number - 1].source(unit) if number else unit.text()
        return _in_a_process(lambda: self._judge(path, number, source, only))

    def _judge(self, path: str, number: int, source: str, only: Judge | None) -> str:
        self.case.select(path, number, source)
        signal.signal(signal.SIGVTALRM, signal.SIG_DFL)
        for judge in [only] if only else self.judges[path]:
            signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS_MORE + TIMES_LONGER * self.seconds[judge.name])
            try:
                judge.run(self.case)
            except OSError:
                raise  # the machine's fault, not the mutant's
            except Exception:
                return judge.name
        return SURVIVED


def _in_a_process(judge: Callable[[], str]) -> str:
    """Return what a function returns in a copy of this process, or what ended that process."""
    with tempfile.TemporaryFile() as answer:
        child = os.fork()
        if child == 0:
            try:
                faulthandler.disable()
                os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the report of a crash is of no interest
                resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
                os.write(answer.fileno(), judge().encode())
                os._exit(0)
            except BaseException as error:
                os.write(answer.fileno(), repr(error).encode())
            finally:
                os._exit(3)
        _, status = os.waitpid(child, 0)
        answer.seek(0)
        text = answer.read().decode(errors="replace")
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return "a loop without end" if number == signal.SIGVTALRM else signal.Signals(number).name
    if os.WEXITSTATUS(status) != 0:
        raise RuntimeError(f"a mutant could not be judged: {text}")
    return text
