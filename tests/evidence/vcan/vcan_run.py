"""Run a command with SocketCAN and its own `vcan0`: the same output, the same exit code.

    python -m tests.evidence.vcan.vcan_run [--writable FOLDER]... [--steady] -- COMMAND...

native: this kernel has SocketCAN. The command gets its own network namespace with lo and vcan0, or the existing vcan0 if that
is not permitted.

uml: a User Mode Linux guest runs the command. Its root is the host's, read-only except for the current folder and those of
--writable.

--steady: in a guest, the clock ignores pauses by a busy host; for tests, never for measurements.

Standard input is closed. Exit codes: 125 the guest died, 69 this machine supports neither way.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from codegen.cache import cache_folder
from codegen.errors import CodegenError
from tests.evidence.vcan import uml
from tests.evidence.vcan.interfaces import INTERFACE, add_vcan, has_socketcan, is_up, set_loopback_up
from tests.evidence.vcan.uml import Unavailable

DIED, UNAVAILABLE, CANNOT_RUN = 125, 69, 127
SECONDS_TO_END = 3.0
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# From the kernel's headers: linux/sched.h, linux/prctl.h.
CLONE_NEWUSER, CLONE_NEWNET = 0x10000000, 0x40000000
PR_SET_PDEATHSIG = 1


def main() -> int:
    parser = argparse.ArgumentParser(prog="vcan_run", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--writable", type=Path, action="append", default=[], metavar="FOLDER")
    parser.add_argument("--steady", action="store_true")
    parser.add_argument("command", nargs="+")
    options = parser.parse_args()
    for number in SIGNALS:
        signal.signal(number, _stop)
    if sys.platform == "linux":  # a guest ends with a killed pytest
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    try:
        return run(options.command, options.writable, steady=options.steady)
    except (Unavailable, CodegenError) as error:
        print(f"vcan_run: {error}", file=sys.stderr)
        return UNAVAILABLE
    except OSError as error:  # of the command
        print(f"vcan_run: {error}", file=sys.stderr)
        return CANNOT_RUN


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    for other in SIGNALS:
        signal.signal(other, signal.SIG_IGN)  # ignored during cleanup
    raise SystemExit(128 + number)


def run(command: Sequence[str], writable: Sequence[Path], *, steady: bool = False) -> int:
    """Return the command's exit code, or DIED. Raises Unavailable, OSError."""
    try:
        return _run_native(command)
    except Unavailable:
        return _run_in_guest(command, writable, steady)


def _run_native(command: Sequence[str]) -> int:
    if not has_socketcan():
        raise Unavailable("this kernel has no SocketCAN")
    environment = os.environ | {"VCAN_RUN": "native"}
    try:
        process = _start(command, environment, _enter_own_network)
    except subprocess.SubprocessError as error:  # _enter_own_network failed
        if not is_up(INTERFACE):
            raise Unavailable(f"no right to a network of one's own, and there is no {INTERFACE}") from error
        process = _start(command, environment)
    code = _finish(process)
    return code if code >= 0 else 128 - code


def _enter_own_network() -> None:
    """Enter a network that ends with its last process. A user other than root becomes root in it."""
    user, group = os.getuid(), os.getgid()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNET) != 0:
        if libc.unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), "unshare")
        for name, text in (("setgroups", "deny"), ("uid_map", f"0 {user} 1"), ("gid_map", f"0 {group} 1")):
            Path("/proc/self", name).write_text(text, encoding="ascii")
    set_loopback_up()
    add_vcan(INTERFACE)


def _run_in_guest(command: Sequence[str], writable: Sequence[Path], steady: bool) -> int:
    uml.find_kernel()
    # Not below TMPDIR: the guest has its own /run and /dev/shm.
    folder = Path(tempfile.mkdtemp(prefix="guest-", dir=cache_folder()))
    try:
        uml.write_job(folder, command, [Path.cwd(), *writable])
        try:
            process = _start(uml.kernel_command(folder), uml.kernel_environment(steady=steady))
        except OSError as error:
            raise Unavailable(str(error)) from error
        code = _finish(process)
        if (folder / "status").exists():
            return int((folder / "status").read_text(encoding="ascii"))
        if not (folder / "booted").exists():
            raise Unavailable(f"the User Mode Linux guest did not start (exit code {code})")
        print(f"vcan_run: the guest died (exit code {code})", file=sys.stderr)
        return DIED
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _start(
    command: Sequence[str], environment: dict[str, str], prepare: Callable[[], None] | None = None
) -> subprocess.Popen[bytes]:
    return subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, start_new_session=True, preexec_fn=prepare)


def _finish(process: subprocess.Popen[bytes]) -> int:
    """Wait for a process and return its exit code; end all processes of its session in any case."""
    try:
        return process.wait()
    finally:
        if process.poll() is None:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(SECONDS_TO_END)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


if __name__ == "__main__":
    sys.exit(main())
