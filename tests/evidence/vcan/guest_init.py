"""Process 1 of the User Mode Linux guest: prepare it, run the job, store its exit code, power off.

`python -m tests.evidence.vcan.guest_init FOLDER`. FOLDER, on the host, holds `job.json` (see `Job`). This program creates
`booted` there when the command starts, and `status` with its exit code. Without `status` the guest died. Errors are printed in
one line.

The guest's root is the host's, read-only; /dev, /run and /dev/shm are its own.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import subprocess
import sys
import termios
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.evidence.vcan.interfaces import INTERFACE, add_vcan, set_loopback_up

TEMPORARY = "/run/tmp"
CANNOT_RUN = 127
RECEIVE_BUFFER = 4 << 20
"""Receive buffer of each socket, in bytes."""

# From the kernel's headers: linux/mount.h, linux/reboot.h, asm/unistd_64.h.
MS_NOSUID, MS_NODEV = 2, 4
RB_POWER_OFF = 0x4321FEDC
SYS_FINIT_MODULE = 313

_LIBC = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class Job:
    """The guest's job: load `modules` (.ko files, in order), make the `writable` folders writable, run `command`."""

    command: list[str]
    folder: str
    environment: dict[str, str]
    writable: list[str]
    modules: list[str]

    def save(self, file: Path) -> None:
        file.write_text(json.dumps(asdict(self)), encoding="utf-8")

    @staticmethod
    def load(file: Path) -> Job:
        return Job(**json.loads(file.read_text(encoding="utf-8")))


def main(folder: Path) -> None:
    try:
        _mount_own_file_systems()
        _mount("none", str(folder), "hostfs", options=str(folder))
        _connect_outputs()
        job = Job.load(folder / "job.json")
        _prepare(job)
        _write(folder / "booted", "")
        status = _run(job)
        for output in (1, 2):
            termios.tcdrain(output)
        _write(folder / "status", str(status))
    except Exception as error:
        _print_error(f"the guest cannot start: {error}")
    finally:
        os.sync()
        _LIBC.reboot(RB_POWER_OFF)


def _mount_own_file_systems() -> None:
    _mount("proc", "/proc", "proc")
    _mount("sys", "/sys", "sysfs")
    for name, target in (("fd", ""), ("stdin", "/0"), ("stdout", "/1"), ("stderr", "/2")):
        with contextlib.suppress(FileExistsError):
            Path("/dev", name).symlink_to(f"/proc/self/fd{target}")
    for folder, kind, options in (
        ("/dev/pts", "devpts", "mode=620,ptmxmode=666"),
        ("/dev/shm", "tmpfs", "mode=1777"),
        ("/run", "tmpfs", "mode=755"),
    ):
        Path(folder).mkdir(exist_ok=True)
        _mount(kind, folder, kind, MS_NOSUID | (MS_NODEV if kind == "tmpfs" else 0), options)
    Path(TEMPORARY).mkdir()
    Path(TEMPORARY).chmod(0o1777)


def _connect_outputs() -> None:
    """Connect terminals 0 and 1 to the host's standard output and error; as pipes, so that line ends stay unchanged."""
    for target, device, mode in ((0, "null", os.O_RDONLY), (1, "tty0", os.O_RDWR), (2, "tty1", os.O_RDWR)):
        opened = os.open(f"/dev/{device}", mode | os.O_NOCTTY)
        os.dup2(opened, target)
        if device != "null":
            attributes = termios.tcgetattr(target)
            attributes[1] &= ~termios.OPOST
            attributes[3] &= ~(termios.ECHO | termios.ISIG | termios.ICANON)
            termios.tcsetattr(target, termios.TCSANOW, attributes)


def _prepare(job: Job) -> None:
    for folder in job.writable:
        _mount("none", folder, "hostfs", options=folder)
    for module in job.modules:
        _load_module(module)
    set_loopback_up()
    add_vcan(INTERFACE)
    # If the host stops a process for a second, all frames of that second wait for it. A default socket holds about 200 frames
    # and drops the others.
    for limit in ("rmem_default", "rmem_max"):
        Path("/proc/sys/net/core", limit).write_text(str(RECEIVE_BUFFER), encoding="ascii")


def _run(job: Job) -> int:
    try:
        child = subprocess.Popen(job.command, cwd=job.folder, env=job.environment, start_new_session=True)
    except OSError as error:
        _print_error(f"vcan_run: {error}")
        return CANNOT_RUN
    while True:  # process 1 is also the parent of all orphans
        ended, status = os.wait()
        if ended == child.pid:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else 128 - code


def _mount(source: str, target: str, kind: str, flags: int = 0, options: str = "") -> None:
    if _LIBC.mount(source.encode(), target.encode(), kind.encode(), ctypes.c_ulong(flags), options.encode()) != 0:
        raise OSError(ctypes.get_errno(), f"mount: {os.strerror(ctypes.get_errno())}", target)


def _load_module(file: str) -> None:
    opened = os.open(file, os.O_RDONLY)
    if _LIBC.syscall(SYS_FINIT_MODULE, opened, b"", 0) != 0:
        raise OSError(ctypes.get_errno(), f"module: {os.strerror(ctypes.get_errno())}", file)
    os.close(opened)


def _print_error(line: str) -> None:
    os.write(2, f"{line}\n".encode())  # sys.stderr may be None: the kernel starts process 1 without open files


def _write(file: Path, text: str) -> None:
    """Write a file and sync it to the host's disk."""
    with file.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
