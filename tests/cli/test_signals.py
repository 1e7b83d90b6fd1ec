"""Commands that end early: Ctrl-C, other signals and closed pipes, and the remaining files.

A signal is sent from within at a point of the program, so no test waits for a time. tests/emit/test_write.py covers builds that
are killed or run out of disk space.
"""

import shutil
import signal
import textwrap
from pathlib import Path

import can
import pytest

from .conftest import BUILD, MAIN, MAP, everything_in, python

QUIET = "interrupted; nothing is left half-written\n"

AT_IMPORT = """
import importlib.abc
class AtImport(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == NAME:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, AtImport())
"""


def test_ctrl_c_while_modules_are_imported() -> None:
    ended = python(f"NAME = 'numpy'\n{AT_IMPORT}{MAIN}", "show", MAP)
    assert (ended.returncode, ended.stdout, ended.stderr) in ((130, "", QUIET), (-signal.SIGINT, "", QUIET))


IN_COMPILER = """
import subprocess
real = subprocess.Popen.communicate
def communicate(process, *arguments, **options):
    if "-c" in process.args or "-o" in process.args:
        os.killpg(0, NUMBER)  # as a terminal does: the compiler gets it too
    return real(process, *arguments, **options)
subprocess.Popen.communicate = communicate
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_the_compiler_runs(tmp_path: Path, number: signal.Signals, code: int) -> None:
    temporary = {"TMPDIR": str(tmp_path / "tmp"), "ARS_CACHE": str(tmp_path / "cache")}
    (tmp_path / "tmp").mkdir()
    command = ("fmu", "--build", BUILD, "--what", "controller", "-o", "controller.fmu")
    ended = python(f"NUMBER = {int(number)}\n{IN_COMPILER}{MAIN}", *command, folder=tmp_path, **temporary)
    assert ended.returncode == code, ended
    assert ended.stderr == (QUIET if number == signal.SIGINT else "")
    assert everything_in(tmp_path).keys() == {"tmp", "cache"}


IN_CHECK = """
import tempfile
from codegen.verify import runner
def waiting(running):
    scratch = os.path.join(tempfile.gettempdir(), os.listdir(tempfile.gettempdir())[0])
    while all(name.endswith(".json") for name in os.listdir(scratch)):  # until a check has begun to write
        os.sched_yield()
    os.killpg(0, signal.SIGINT)
    raise RuntimeError("the signal was lost")
runner.as_completed = waiting
"""


def test_ctrl_c_while_checks_run_in_processes(here: Path) -> None:
    # `spawn` restarts the program in each process, so it must be a file.
    script = here / "program.py"
    script.write_text("if __name__ == '__main__':\n" + textwrap.indent(f"import os, signal, sys\n{IN_CHECK}{MAIN}", "    "))
    shutil.copytree(BUILD, "build")
    Path("tmp").mkdir()
    before = everything_in(here / "build")
    start = f"import runpy; runpy.run_path({str(script)!r}, run_name='__main__')"
    ended = python(start, "verify", "build", folder=here, TMPDIR=str(here / "tmp"), ARS_CACHE=str(here / "cache"))
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", QUIET)
    assert everything_in(here / "tmp") == {}
    assert everything_in(here / "build") == before


IN_RUN = """
from hil_sim import bench
close = bench._Recorder.close_cycle
def ending(recorder, cycle, *more):
    close(recorder, cycle, *more)
    if cycle == 50: os.kill(os.getpid(), signal.SIGHUP)
bench._Recorder.close_cycle = ending
"""


def test_a_terminated_run_keeps_its_log(here: Path) -> None:
    arguments = ("hil", "--build", BUILD, "--bus", "virtual:x", "--ecu", "cffi", "--lock-step", "--log", "run.asc")
    reset = "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"  # nohup ignores it
    ended = python(reset + IN_RUN + MAIN, *arguments, folder=here)
    assert ended.returncode == 128 + signal.SIGHUP, ended
    with can.LogReader("run.asc") as log:
        assert sum(1 for _ in log) >= 3 * 51
    assert [path.name for path in here.iterdir()] == ["run.asc"]


NO_READER = """
read, write = os.pipe()
os.close(read)
os.dup2(write, 1)
"""


def test_a_pipe_closed_before_any_output(tmp_path: Path) -> None:
    ended = python(NO_READER + MAIN, "--help", folder=tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    # A closed pipe does not hide a failed check.
    ended = python(NO_READER + MAIN, "build", "--map", MAP, "--check", "-o", "nowhere", folder=tmp_path)
    assert ended.returncode == 1
    assert ended.stderr and "Traceback" not in ended.stderr and "Broken" not in ended.stderr
