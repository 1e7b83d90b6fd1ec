"""`vcan_run` on this machine: guests behave like the command in them and leave nothing behind."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.evidence.vcan import uml
from tests.evidence.vcan.vcan_run import CANNOT_RUN, DIED, TIMEOUT, UNAVAILABLE

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
    vcan_run = [sys.executable, "-m", "tests.evidence.vcan.vcan_run", "--backend", "uml", *options, "--", *command]
    environment, pipe = os.environ | {"ARS_CACHE": str(cache)}, subprocess.PIPE
    return subprocess.Popen(vcan_run, cwd=uml.ROOT, env=environment, stdout=pipe, stderr=pipe, text=True)


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
    lines = subprocess.run(["ps", "axww", "-o", "args="], capture_output=True, text=True, check=True).stdout.splitlines()
    return [*map(str, cache.glob("guest-*")), *(line for line in lines if f"{cache}/guest-" in line)]


def test_output_arguments_files_and_exit_code(cache: Path) -> None:
    writable = cache / "writable"
    writable.mkdir()
    script = f'printf "%s|" "$@"; echo; touch {writable}/there; touch {cache}/forbidden 2>/dev/null; echo "errors" >&2; exit 7'
    arguments = ("two words", "'quoted'", "$HOME", "a\nb", "")
    guest = start(cache, "sh", "-c", script, "sh", *arguments, options=["--writable", str(writable)])
    assert finish(guest, cache) == (7, "two words|'quoted'|$HOME|a\nb||\n", "errors\n")
    assert (writable / "there").exists() and not (cache / "forbidden").exists()


@pytest.mark.long
def test_a_timeout_and_an_interrupt_end_the_guest(cache: Path) -> None:
    # The seconds include the boot, which may take a busy host longer than a short timeout.
    for seconds in ("4", "16", "64"):
        code, output, errors = finish(start(cache, "sh", "-c", "echo begun; sleep 600", options=["--timeout", seconds]), cache)
        assert (code, errors) == (TIMEOUT, f"vcan_run: timeout after {seconds} s\n")
        if output:
            break
    assert output == "begun\n"
    process = start(cache, "sh", "-c", f"echo begun; sleep {LONG}")
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
