"""User Mode Linux: a Linux kernel that runs as an ordinary process, as an ordinary user; here one that has SocketCAN.

Debian's `user-mode-linux`, installed or else fetched and unpacked into the cache. What it runs is `guest_init`.
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.sil.cache import cache_folder
from codegen.sil.toolchain import compiler_command
from tests.evidence.vcan.guest_init import TEMPORARY, Job

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
XSTATE, CLOCK = HERE / "uml-xstate.c", HERE / "uml-clock.c"
PACKAGE = "user-mode-linux"
MODULES = ("can_raw", "can_bcm", "vcan")
MEMORY_MB = 1024


class Unavailable(Exception):
    """There is no way to run a guest here; the message says why."""


@dataclass(frozen=True)
class Kernel:
    """`program` is linux.uml, `modules` the folder of its .ko files."""

    program: Path
    modules: Path


def find_kernel() -> Kernel:
    """The installed one, else the one in the cache, else it is fetched (41 MB). Raises Unavailable."""
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        raise Unavailable("User Mode Linux needs Linux on x86-64")
    fetched = cache_folder() / PACKAGE
    if re.search(r"[\s:]", str(fetched)):  # in a kernel's command line and in LD_PRELOAD nothing can be quoted
        raise Unavailable(
            f"User Mode Linux can have no space and no colon in the cache's path, {fetched.parent}: set ARS_CACHE"
        )
    for root in (Path("/"), fetched):
        if (root / "usr/bin/linux.uml").exists():
            return _kernel_below(root)
    _fetch(fetched)
    return _kernel_below(fetched)


def _kernel_below(root: Path) -> Kernel:
    return Kernel(root / "usr/bin/linux.uml", root / "usr/lib/uml/modules")


def _fetch(target: Path) -> None:
    """Download the package and unpack it: needs no right to install."""
    with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
        # Without the option, apt as root complains that its own user cannot write here.
        _call(["apt-get", "-qq", "-o", "APT::Sandbox::User=root", "download", PACKAGE], scratch)
        for package in Path(scratch).glob("*.deb"):
            _call(["dpkg-deb", "--extract", package.name, "unpacked"], scratch)
        try:
            Path(scratch, "unpacked").rename(target)
        except OSError:  # another process was faster
            if not target.is_dir():
                raise


def _call(command: Sequence[str], folder: str | None = None) -> None:
    try:
        subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    except FileNotFoundError as error:
        raise Unavailable(f"{command[0]} is missing, and {PACKAGE} is not installed") from error
    except subprocess.CalledProcessError as error:
        told = (error.stderr.strip() or f"exit code {error.returncode}").splitlines()[-1]
        raise Unavailable(f"{shlex.join(command)}: {told}; install {PACKAGE}, or run apt-get update") from error


def compile_preload(source: Path) -> Path:
    """The library of a source, newer than that, in the cache. Raises Unavailable, BuildError: there is no compiler."""
    library = cache_folder() / f"{source.stem}.so"
    if not library.exists() or library.stat().st_mtime < source.stat().st_mtime:
        scratch = library.with_suffix(f".{os.getpid()}")
        _call([*compiler_command(), "-O2", "-shared", "-fPIC", "-o", str(scratch), str(source)])
        scratch.rename(library)
    return library


def modules_in_load_order(folder: Path, names: Sequence[str]) -> list[str]:
    """The files of modules and of what they need, each after what it needs itself; those built into the kernel have none."""
    files = {path.stem.replace("-", "_"): path for path in folder.rglob("*.ko")}
    ordered: dict[str, str] = {}

    def add(name: str) -> None:
        file = files.get(name.replace("-", "_"))
        if file is None or name in ordered:
            return
        needed = re.search(rb"\0depends=([^\0]+)\0", file.read_bytes())
        for other in needed[1].decode().split(",") if needed else ():
            add(other)
        ordered[name] = str(file)

    for name in names:
        add(name)
    return list(ordered.values())


def write_job(folder: Path, kernel: Kernel, command: Sequence[str], writable: Sequence[Path]) -> None:
    """Fill `folder` with what the guest reads; its `init` is the program that the kernel starts first."""
    own = {"TMPDIR": TEMPORARY, "VCAN_RUN": "uml"}
    theirs = {name: value for name, value in os.environ.items() if name not in ("LD_PRELOAD", "TMP", "TEMP")}
    modules = modules_in_load_order(kernel.modules, MODULES)
    job = Job(list(command), str(Path.cwd()), theirs | own, [str(path.resolve()) for path in writable], modules)
    job.save(folder / "job.json")
    init = folder / "init"
    python = shlex.join([sys.executable, "-m", "tests.evidence.vcan.guest_init", str(folder)])
    init.write_text(f"#!/bin/sh\ncd {shlex.quote(str(ROOT))} && exec {python}\n", encoding="utf-8")
    init.chmod(0o755)


def kernel_command(folder: Path, kernel: Kernel) -> list[str]:
    """The command line: terminal 0 is standard output, terminal 1, also the kernel's console, standard error."""
    return [
        str(kernel.program),
        f"mem={MEMORY_MB}M",
        f"uml_dir={folder}/",
        "root=/dev/root",
        "rootfstype=hostfs",
        "rootflags=/",
        "ro",
        "quiet",
        "loglevel=0",
        "con=null",
        "con0=null,fd:1",
        "con1=null,fd:2",
        "console=tty1",
        "ssl=null",
        f"init={folder}/init",
    ]


def kernel_environment(*, steady: bool) -> dict[str, str]:
    """Of linux.uml itself. `steady`: its clock does not count what the host takes away (uml-clock.c).

    The guest's memory is an executable mapping of a file in TMPDIR: /dev/shm, where that is large enough and not noexec.
    """
    folder = "/tmp"
    if Path("/dev/shm").is_dir():
        status = os.statvfs("/dev/shm")
        if not status.f_flag & os.ST_NOEXEC and status.f_bavail * status.f_frsize >= MEMORY_MB << 20:
            folder = "/dev/shm"
    preloads = [XSTATE, CLOCK] if steady else [XSTATE]
    return os.environ | {"LD_PRELOAD": ":".join(str(compile_preload(source)) for source in preloads), "TMPDIR": folder}
