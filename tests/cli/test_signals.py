"""The command and what ends it early: Ctrl-C at any moment, readers that go away, and what is left then.

A signal is sent from inside, at a point of the program: nothing waits for a time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import everything_in

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "generated" / "4ws2"
QUIET = "interrupted; nothing is left half-written\n"

START = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in whatever a shell runs in the background
sys.argv[0] = "codegen"
"""


def started(script: str, *arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    """`codegen ARGUMENTS` after a script that arranges for something; its temporary files in `folder`/tmp."""
    (folder / "tmp").mkdir(exist_ok=True)
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "TMPDIR": str(folder / "tmp"),
        "ARS_CACHE": str(folder / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    return subprocess.run(
        [sys.executable, "-c", START + script, *map(str, arguments)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        start_new_session=True,
    )


AT_IMPORT = """
import importlib.abc
class AtImport(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == NAME:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, AtImport())
from codegen.cli import main
main()
"""


@pytest.mark.parametrize("module", ["codegen.cli.entry", "click", "codegen.cli.map_commands", "numpy", "codegen.refmap.map"])
def test_ctrl_c_while_modules_are_imported(tmp_path: Path, module: str) -> None:
    ended = started(f"NAME = {module!r}\n{AT_IMPORT}", "show", BUILD.with_suffix(".npz"), folder=tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) in ((130, "", QUIET), (-signal.SIGINT, "", QUIET))


def test_what_must_be_there_before_ctrl_c_is_quiet_is_next_to_nothing() -> None:
    script = "import sys; before = set(sys.modules); import codegen.cli; print(*sorted(set(sys.modules) - before))"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    loaded = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert loaded.stdout.split() == ["__future__", "codegen", "codegen.cli"]


IN_COMPILER = """
import subprocess
real = subprocess.Popen.communicate
def communicate(process, *arguments, **options):
    if "-c" in process.args or "-o" in process.args:
        os.killpg(0, NUMBER)  # as a terminal does: the compiler gets it too
    return real(process, *arguments, **options)
subprocess.Popen.communicate = communicate
from codegen.cli import main
main()
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ("sil", "--build", BUILD, "--csv", "run.csv"),
        ("fmu", "--build", BUILD, "--what", "controller", "-o", "controller.fmu"),
        ("firmware", "--build", BUILD, "-o", "fw"),
    ],
    ids=lambda arguments: arguments[0],
)
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_the_compiler_runs(tmp_path: Path, arguments: tuple[object, ...], number: int, code: int) -> None:
    ended = started(f"NUMBER = {int(number)}\n{IN_COMPILER}", *arguments, folder=tmp_path)
    assert ended.returncode == code, ended
    assert ended.stderr == (QUIET if number == signal.SIGINT else "")
    assert everything_in(tmp_path) == {"tmp": "folder", "cache": "folder"}


IN_CAMPAIGN = """
from codegen.sweep import store
real = store.save_part
saved = []
def save_part(*arguments):
    if len(saved) == KEPT:
        os.kill(os.getpid(), signal.SIGINT)
    real(*arguments)
    saved.append(1)
store.save_part = save_part
from codegen.cli import main
main()
"""


@pytest.mark.parametrize(
    ("kept", "told"),
    [
        (0, "no chunk of 3 was finished; the same command begins again"),
        (1, "1 of 3 chunks is kept; the same command goes on"),
        (2, "2 of 3 chunks are kept; the same command goes on"),
    ],
)
def test_ctrl_c_of_a_campaign_tells_what_is_kept(tmp_path: Path, kept: int, told: str) -> None:
    controllers = f'[controllers]\npi = "{BUILD}"\npassive = ""\n'
    (tmp_path / "s.toml").write_text(f"samples = 600\nlead_s = 0.1\nlength_s = 2.0\n{controllers}")
    command = ("sweep", "--spec", "s.toml", "-o", "out", "--workers", 1)
    ended = started(f"KEPT = {kept}\n{IN_CAMPAIGN}", *command, folder=tmp_path)
    assert ended.returncode == 130, ended
    assert ended.stderr.splitlines()[-1] == f"{QUIET.strip()}; {told}"
    assert len(list((tmp_path / "out/parts").iterdir())) == kept


IN_CHECK = """
import tempfile
from codegen.verify import runner
def interrupted(*arguments):
    os.killpg(0, signal.SIGINT)
    raise RuntimeError("the signal was lost")
def waiting(running):
    scratch = os.path.join(tempfile.gettempdir(), os.listdir(tempfile.gettempdir())[0])
    for _ in range(2_000_000):  # until a check has begun to write
        if os.listdir(scratch):
            break
        os.sched_yield()
    else:
        raise RuntimeError("no check writes into the common folder")
    interrupted()
runner.as_completed = waiting
from codegen.cli import main
main()
"""


def test_ctrl_c_while_checks_run_in_processes_of_their_own(tmp_path: Path) -> None:
    # spawn starts the program again in each process, and this one is no file: the command itself, then.
    script = tmp_path / "program.py"
    script.write_text(f"{START}\nif __name__ == '__main__':\n" + "".join(f"    {line}\n" for line in IN_CHECK.splitlines()))
    copy = tmp_path / "build"
    copy.mkdir()
    for path, _ in everything_in(BUILD).items():
        (copy / path).mkdir() if (BUILD / path).is_dir() else (copy / path).write_bytes((BUILD / path).read_bytes())
    before = everything_in(copy)
    ended = started(f"import runpy; runpy.run_path({str(script)!r}, run_name='__main__')", "verify", copy, folder=tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", QUIET)
    assert everything_in(tmp_path / "tmp") == {}
    assert everything_in(copy) == before


NO_READER = """
read, write = os.pipe()
os.close(read)
os.dup2(write, 1)
from codegen.cli import main
main()
"""


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("--help",), 0),
        (("--version",), 0),
        (("scenarios",), 0),
        (("scenarios", "--json"), 0),
        (("show", BUILD.with_suffix(".npz")), 0),
        (("build", "--map", BUILD.with_suffix(".npz"), "--check", "-o", "nowhere"), 1),  # a pipe does not hide a failed check
    ],
    ids=lambda value: " ".join(map(str, value[:2])) if isinstance(value, tuple) else "",
)
def test_a_reader_that_went_away_before_the_first_word(tmp_path: Path, arguments: tuple[object, ...], code: int) -> None:
    ended = started(NO_READER, *arguments, folder=tmp_path)
    assert ended.returncode == code
    assert "Traceback" not in ended.stderr
    assert "Broken" not in ended.stderr
    assert (ended.stderr == "") is (code == 0)


def test_a_reader_of_both_streams_that_went_away(tmp_path: Path) -> None:
    ended = started(
        NO_READER.replace("os.dup2(write, 1)", "os.dup2(write, 1); os.dup2(write, 2)"), "show", "no", folder=tmp_path
    )
    assert ended.returncode == 2


def test_a_broken_pipe_of_something_else_is_an_error(tmp_path: Path) -> None:
    script = (
        "from codegen.cli import map_commands, main\n"
        "def broken(*arguments): raise BrokenPipeError(32, 'Broken pipe')\n"
        "import codegen.refmap.map; codegen.refmap.map.load = broken\n"
        "main()\n"
    )
    ended = started(script, "show", BUILD.with_suffix(".npz"), folder=tmp_path)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: ")
