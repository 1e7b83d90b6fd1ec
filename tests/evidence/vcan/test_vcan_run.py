"""`vcan_run` on this machine: guests that behave like the command in them, and that leave nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from codegen.sil.cache import cache_folder
from tests.evidence.vcan import uml, vcan_run
from tests.evidence.vcan.uml import Unavailable, modules_in_load_order
from tests.evidence.vcan.vcan_run import CANNOT_RUN, DIED, TIMEOUT, UNAVAILABLE

ROOT = Path(__file__).resolve().parents[3]

# Where a command in a guest is told to wait for the test: long enough for a slow machine, and an end for a lost guest.
LONG = "300"


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    """A cache of the test's own, so that what a guest leaves can be seen; the kernel in it is the shared one."""
    try:
        uml.find_kernel()
    except Unavailable as error:
        pytest.skip(str(error))
    folder = tmp_path / "cache"
    folder.mkdir()
    if (cache_folder() / uml.PACKAGE).exists():
        (folder / uml.PACKAGE).symlink_to(cache_folder() / uml.PACKAGE)
    return folder


def start(
    cache: Path, *command: str, timeout: str = LONG, writable: Path | None = None, steady: bool = False
) -> subprocess.Popen[str]:
    """In a guest; the output can be read while it runs."""
    options = ["--backend", "uml", "--timeout", timeout, *(["--writable", str(writable)] if writable else [])]
    options += ["--steady"] if steady else []
    return subprocess.Popen(
        [sys.executable, "-m", "tests.evidence.vcan.vcan_run", *options, "--", *command],
        cwd=ROOT,
        env=os.environ | {"ARS_CACHE": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    output, errors = process.communicate()
    if process.returncode == UNAVAILABLE:
        pytest.skip(errors.strip())
    # Where /dev/shm cannot hold the guest's memory, its kernel says so.
    told = [line for line in errors.splitlines(keepends=True) if not line.startswith("Warning: tempdir")]
    return process.returncode, output, "".join(told)


def left_behind(cache: Path) -> list[str]:
    """Folders, and the command lines of processes, of guests that had this cache."""
    found = [str(path) for path in cache.glob("guest-*")]
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = process.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:  # it has just ended
            continue
        if f"{cache}/guest-" in line:
            found.append(line)
    return found


def test_output_arguments_and_exit_code_come_through(cache: Path) -> None:
    script = 'printf "%s|" "$@"; echo; echo "to stderr" >&2; exit 7'
    code, output, errors = finish(start(cache, "sh", "-c", script, "sh", "two words", "'quoted'", "$HOME", "a\nb", ""))
    assert (code, output, errors) == (7, "two words|'quoted'|$HOME|a\nb||\n", "to stderr\n")
    assert left_behind(cache) == []


def test_a_timeout_ends_the_guest(cache: Path) -> None:
    # The seconds count from before the guest boots, which takes a busy host longer than a short timeout.
    for seconds in ("4", "16", "64"):
        code, output, errors = finish(start(cache, "sh", "-c", "echo begun; sleep 600", timeout=seconds))
        assert (code, errors) == (TIMEOUT, f"vcan_run: timeout after {seconds} s\n")
        assert left_behind(cache) == []
        if output:
            break
    assert output == "begun\n"


def test_an_interrupt_ends_the_guest(cache: Path) -> None:
    process = start(cache, "sh", "-c", f"echo begun; sleep {LONG}")
    assert process.stdout is not None
    if process.stdout.readline() == "begun\n":
        assert len(left_behind(cache)) > 1  # the folder and its processes: it can be seen
        process.send_signal(signal.SIGINT)
    assert finish(process) == (128 + signal.SIGINT, "", "")
    assert left_behind(cache) == []


def test_a_guest_that_dies_and_a_command_that_is_not_there_are_told_apart(cache: Path) -> None:
    dying = start(cache, "sh", "-c", f"echo o > /proc/sysrq-trigger; sleep {LONG}")  # o: off
    missing = start(cache, "no-such-command")
    assert finish(missing) == (CANNOT_RUN, "", "vcan_run: [Errno 2] No such file or directory: 'no-such-command'\n")
    code, _, errors = finish(dying)
    assert code == DIED
    assert errors.endswith("vcan_run: the guest died (exit code 0)\n")


# Cycles of 10 ms by absolute deadlines; the largest lateness [s].
CYCLES = """
import time
print("begun", flush=True)
late, deadline = 0.0, time.monotonic()
for _ in range(200):
    deadline += 0.01
    time.sleep(max(0.0, deadline - time.monotonic()))
    late = max(late, time.monotonic() - deadline)
print(late)
"""
HELD_UP = 0.5
"""s."""


def largest_lateness(cache: Path, *, steady: bool) -> float:
    """Of a guest that is held up twice in its two seconds."""
    process = start(cache, sys.executable, "-c", CYCLES, steady=steady)
    assert process.stdout is not None
    if process.stdout.readline() == "begun\n":
        (kernel,) = map(int, Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split())
        for _ in range(2):
            os.kill(kernel, signal.SIGSTOP)
            time.sleep(HELD_UP)
            os.kill(kernel, signal.SIGCONT)
            time.sleep(0.1)
    code, output, errors = finish(process)
    assert (code, errors) == (0, "")
    return float(output)


def test_a_steady_clock_does_not_count_what_the_host_takes_away(cache: Path) -> None:
    assert largest_lateness(cache, steady=True) < 0.01  # no cycle lost
    assert largest_lateness(cache, steady=False) > 0.9 * HELD_UP


class Choice:
    """`vcan_run.run` on a machine that the test describes; which way it has gone is in `way`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, socketcan: bool, own_network: bool, interface_up: bool) -> None:
        self.own_network = own_network
        self.way = ""
        monkeypatch.setattr(vcan_run, "has_socketcan", lambda: socketcan)
        monkeypatch.setattr(vcan_run, "is_up", lambda name: interface_up)
        monkeypatch.setattr(vcan_run, "_start", self.start)
        monkeypatch.setattr(vcan_run, "_finish", lambda process, timeout: 5)
        monkeypatch.setattr(vcan_run, "_run_in_guest", self.run_in_guest)

    def start(self, command: Sequence[str], environment: dict[str, str], prepare: Callable[[], None] | None = None) -> None:
        assert environment["VCAN_RUN"] == "native"
        if prepare and not self.own_network:
            raise subprocess.SubprocessError
        self.way = "own network" if prepare else "the interface that is there"

    def run_in_guest(self, command: Sequence[str], timeout: float | None, writable: Sequence[Path], steady: bool) -> int:
        self.way = "guest"
        return 5


@pytest.mark.parametrize(
    ("socketcan", "own_network", "interface_up", "way"),
    [
        (True, True, False, "own network"),
        (True, True, True, "own network"),
        (True, False, True, "the interface that is there"),
        (True, False, False, "guest"),
        (False, True, False, "guest"),
    ],
)
def test_the_kernel_is_used_where_it_has_socketcan(
    monkeypatch: pytest.MonkeyPatch, socketcan: bool, own_network: bool, interface_up: bool, way: str
) -> None:
    choice = Choice(monkeypatch, socketcan, own_network, interface_up)
    assert vcan_run.run(["true"], None, None, []) == 5
    assert choice.way == way


def test_modules_come_after_what_they_need(tmp_path: Path) -> None:
    for name, needs in {"vcan": "can-dev", "can-dev": "can", "can": "", "can-raw": "can"}.items():
        (tmp_path / f"{name}.ko").write_bytes(b"license=GPL\0depends=" + needs.encode() + b"\0name=x\0")
    found = [Path(file).stem for file in modules_in_load_order(tmp_path, ["can_raw", "built_in", "vcan"])]
    assert found == ["can", "can-raw", "can-dev", "vcan"]
