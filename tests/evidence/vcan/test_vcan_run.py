"""`vcan_run` on this machine: guests behave like the command in them and leave nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from tests.evidence.vcan import uml, vcan_run
from tests.evidence.vcan.vcan_run import CANNOT_RUN, DIED, TIMEOUT, UNAVAILABLE

ROOT = Path(__file__).resolve().parents[3]
LONG = "300"
"""s: a guest's command waits so long at most for the test."""


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    """A cache of the test's own, where the guest's files can be seen."""
    try:
        uml.find_kernel()
    except uml.Unavailable as error:
        pytest.skip(str(error))
    return tmp_path


def start(cache: Path, *command: str, options: Sequence[str] = ("--timeout", LONG)) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tests.evidence.vcan.vcan_run", "--backend", "uml", *options, "--", *command],
        cwd=ROOT,
        env=os.environ | {"ARS_CACHE": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str], cache: Path) -> tuple[int, str, str]:
    """Return exit code, output and errors, after a check that no folder or process of the guest is left."""
    output, errors = process.communicate()
    if process.returncode == UNAVAILABLE:
        pytest.skip(errors.strip())
    assert left_behind(cache) == []
    # The kernel warns where /dev/shm cannot hold the guest's memory.
    lines = [line for line in errors.splitlines(keepends=True) if not line.startswith("Warning: tempdir")]
    return process.returncode, output, "".join(lines)


def left_behind(cache: Path) -> list[str]:
    """Return the folders of guests with this cache, and the command lines of their processes."""
    found = [str(path) for path in cache.glob("guest-*")]
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = process.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:  # it has just ended
            continue
        if f"{cache}/guest-" in line:
            found.append(line)
    return found


def test_output_arguments_files_and_exit_code(cache: Path) -> None:
    writable = cache / "writable"
    writable.mkdir()
    script = f'printf "%s|" "$@"; echo; touch {writable}/there; touch {cache}/forbidden 2>/dev/null; echo "errors" >&2; exit 7'
    arguments = ("two words", "'quoted'", "$HOME", "a\nb", "")
    guest = start(cache, "sh", "-c", script, "sh", *arguments, options=["--writable", str(writable)])
    assert finish(guest, cache) == (7, "two words|'quoted'|$HOME|a\nb||\n", "errors\n")
    assert (writable / "there").exists() and not (cache / "forbidden").exists()


@pytest.mark.long
def test_a_timeout_ends_the_guest(cache: Path) -> None:
    # The seconds include the boot, which may take a busy host longer than a short timeout.
    for seconds in ("4", "16", "64"):
        guest = start(cache, "sh", "-c", "echo begun; sleep 600", options=["--timeout", seconds])
        code, output, errors = finish(guest, cache)
        assert (code, errors) == (TIMEOUT, f"vcan_run: timeout after {seconds} s\n")
        if output:
            break
    assert output == "begun\n"


@pytest.mark.long
def test_an_interrupt_ends_the_guest(cache: Path) -> None:
    process = start(cache, "sh", "-c", f"echo begun; sleep {LONG}")
    assert process.stdout is not None
    if process.stdout.readline() == "begun\n":
        assert len(left_behind(cache)) > 1  # the folder and its processes: the check can see them
        process.send_signal(signal.SIGINT)
    assert finish(process, cache) == (128 + signal.SIGINT, "", "")


@pytest.mark.long
def test_a_dead_guest_and_a_missing_command_differ(cache: Path) -> None:
    missing = "vcan_run: [Errno 2] No such file or directory: 'no-such-command'\n"
    assert finish(start(cache, "no-such-command"), cache) == (CANNOT_RUN, "", missing)
    code, _, errors = finish(start(cache, "sh", "-c", f"echo o > /proc/sysrq-trigger; sleep {LONG}"), cache)  # o: off
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
PAUSE = 0.5
"""s."""


@pytest.mark.long
@pytest.mark.parametrize("steady", [True, False])
def test_a_steady_clock_does_not_count_pauses(cache: Path, steady: bool) -> None:
    """The guest is stopped twice in its two seconds."""
    process = start(cache, sys.executable, "-c", CYCLES, options=["--steady"] if steady else [])
    assert process.stdout is not None
    if process.stdout.readline() == "begun\n":
        (kernel,) = map(int, Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split())
        for _ in range(2):
            os.kill(kernel, signal.SIGSTOP)
            time.sleep(PAUSE)
            os.kill(kernel, signal.SIGCONT)
            time.sleep(0.1)
    code, output, errors = finish(process, cache)
    assert (code, errors) == (0, "")
    assert float(output) < 0.01 if steady else float(output) > 0.9 * PAUSE  # no cycle lost


@pytest.mark.parametrize(
    ("socketcan", "own_network", "interface_up", "way"),
    [
        (True, True, True, "own network"),
        (True, False, True, "the existing interface"),
        (True, False, False, "guest"),
        (False, True, False, "guest"),
    ],
)
def test_the_choice_of_the_backend(
    monkeypatch: pytest.MonkeyPatch, socketcan: bool, own_network: bool, interface_up: bool, way: str
) -> None:
    chosen: list[str] = []

    def start(command: Sequence[str], environment: dict[str, str], prepare: Callable[[], None] | None = None) -> None:
        assert environment["VCAN_RUN"] == "native"
        if prepare and not own_network:
            raise subprocess.SubprocessError
        chosen.append("own network" if prepare else "the existing interface")

    monkeypatch.setattr(vcan_run, "has_socketcan", lambda: socketcan)
    monkeypatch.setattr(vcan_run, "is_up", lambda name: interface_up)
    monkeypatch.setattr(vcan_run, "_start", start)
    monkeypatch.setattr(vcan_run, "_finish", lambda process, timeout: 5)
    monkeypatch.setattr(vcan_run, "_run_in_guest", lambda *arguments: chosen.append("guest") or 5)
    assert vcan_run.run(["true"], None, None, []) == 5
    assert chosen == [way]
    if way == "guest":
        with pytest.raises(uml.Unavailable, match=r"no SocketCAN$|no right to a network of one's own"):
            vcan_run.run(["true"], "native", None, [])
