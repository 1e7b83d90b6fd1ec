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

EXTRA_SECONDS, TIME_FACTOR = 0.5, 10.0
"""Time limit of a judge for a mutant, added to and in multiples of its time for the original C: it ends infinite loops.

It counts processor time, so that a busy machine kills nothing.
"""

SURVIVED = ""
"""Result of `Bench.first_to_kill` if every judge passes."""


@dataclass(eq=False)
class Bench:
    """A build whose units can be replaced by mutated ones.

    Holds by path of the unit: the judges, their processor time in seconds for the original C, and the messages of judges that
    the original C fails, by name. A campaign requires that there are none.
    """

    case: Case
    mutants: dict[str, list[Mutant]]
    units: dict[str, Unit]
    judges: dict[str, list[Judge]]
    seconds: dict[str, float] = field(default_factory=dict)
    faults: dict[str, str] = field(default_factory=dict)

    def prepare(self) -> None:
        """Run every judge twice, because the first run prepares cached results; compile the library of each unit."""
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

        Mutants have numbers from 1; 0 is the original unit in the library of its mutants. Raises RuntimeError if the machine,
        not the mutant, prevents a result.
        """
        unit = self.units[path]
        source = self.mutants[path][number - 1].source(unit) if number else unit.text()
        return _in_a_process(lambda: self._judge(path, number, source, only))

    def _judge(self, path: str, number: int, source: str, only: Judge | None) -> str:
        self.case.select(path, number, source)
        signal.signal(signal.SIGVTALRM, signal.SIG_DFL)
        for judge in [only] if only else self.judges[path]:
            signal.setitimer(signal.ITIMER_VIRTUAL, EXTRA_SECONDS + TIME_FACTOR * self.seconds[judge.name])
            try:
                judge.run(self.case)
            except OSError:
                raise  # caused by the machine, not by the mutant
            except Exception:
                return judge.name
        return SURVIVED


def _in_a_process(judge: Callable[[], str]) -> str:
    """Return a function's result from a forked process, or what ended that process."""
    with tempfile.TemporaryFile() as answer:
        child = os.fork()
        if child == 0:
            try:
                faulthandler.disable()
                os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # discard crash reports
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
        return "an endless loop" if number == signal.SIGVTALRM else signal.Signals(number).name
    if os.WEXITSTATUS(status) != 0:
        raise RuntimeError(f"a mutant could not be judged: {text}")
    return text
