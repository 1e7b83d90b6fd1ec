"""User Mode Linux: a Linux kernel that runs as an ordinary process of an ordinary user; this one has SocketCAN.

It is Debian's package `user-mode-linux`. Its first program is `guest_init`.
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from codegen.cache import cache_folder
from codegen.sil.toolchain import compiler_command
from tests.evidence.vcan.guest_init import TEMPORARY, Job

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
XSTATE, CLOCK = HERE / "uml-xstate.c", HERE / "uml-clock.c"
KERNEL, MODULES_FOLDER = Path("/usr/bin/linux.uml"), Path("/usr/lib/uml/modules")
MODULES = ("can_raw", "can_bcm", "vcan")
MEMORY_MB = 1024


class Unavailable(Exception):
    """A guest cannot run on this machine; the message is the reason."""


def find_kernel() -> Path:
    """Return the installed kernel. Raises Unavailable."""
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        raise Unavailable("User Mode Linux needs Linux on x86-64")
    if re.search(r"[\s:]", str(cache_folder())):  # a kernel's command line and LD_PRELOAD have no quoting
        raise Unavailable(f"User Mode Linux allows no space and no colon in the cache's path, {cache_folder()}: set ARS_CACHE")
    if not KERNEL.exists():
        raise Unavailable(f"this kernel has no SocketCAN, and {KERNEL} is missing; install user-mode-linux")
    return KERNEL


def compile_preload(source: Path) -> Path:
    """Return the compiled library of a source, from the cache unless it is older. Raises BuildError without a compiler."""
    library = cache_folder() / f"{source.stem}.so"
    if not library.exists() or library.stat().st_mtime < source.stat().st_mtime:
        scratch = library.with_suffix(f".{os.getpid()}")
        subprocess.run([*compiler_command(), "-O2", "-shared", "-fPIC", "-o", scratch, source], check=True)
        scratch.rename(library)
    return library


def modules_in_load_order(folder: Path, names: Sequence[str]) -> list[str]:
    """Return the files of modules and their dependencies, each after its own dependencies, without built-in modules."""
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


def write_job(folder: Path, command: Sequence[str], writable: Sequence[Path]) -> None:
    """Write the files that the guest reads. `init` is the program that the kernel starts first."""
    own = {"TMPDIR": TEMPORARY, "VCAN_RUN": "uml"}
    theirs = {name: value for name, value in os.environ.items() if name not in ("LD_PRELOAD", "TMP", "TEMP")}
    modules = modules_in_load_order(MODULES_FOLDER, MODULES)
    job = Job(list(command), str(Path.cwd()), theirs | own, [str(path.resolve()) for path in writable], modules)
    job.save(folder / "job.json")
    init = folder / "init"
    python = shlex.join([sys.executable, "-m", "tests.evidence.vcan.guest_init", str(folder)])
    init.write_text(f"#!/bin/sh\ncd {shlex.quote(str(ROOT))} && exec {python}\n", encoding="utf-8")
    init.chmod(0o755)


def kernel_command(folder: Path) -> list[str]:
    """Return the command line: terminal 0 is standard output, terminal 1, also the kernel's console, standard error."""
    root = "root=/dev/root rootfstype=hostfs rootflags=/ ro quiet loglevel=0"
    terminals = "con=null con0=null,fd:1 con1=null,fd:2 console=tty1 ssl=null"
    return [str(KERNEL), f"mem={MEMORY_MB}M", f"uml_dir={folder}/", *root.split(), *terminals.split(), f"init={folder}/init"]


def kernel_environment(*, steady: bool) -> dict[str, str]:
    """Return the environment of linux.uml. With `steady` its clock ignores pauses by the host (uml-clock.c).

    The guest's memory is an executable mapping of a file in TMPDIR: /dev/shm, if that is large enough and not noexec.
    """
    folder = "/tmp"
    if Path("/dev/shm").is_dir():
        status = os.statvfs("/dev/shm")
        if not status.f_flag & os.ST_NOEXEC and status.f_bavail * status.f_frsize >= MEMORY_MB << 20:
            folder = "/dev/shm"
    preloads = [XSTATE, CLOCK] if steady else [XSTATE]
    return os.environ | {"LD_PRELOAD": ":".join(str(compile_preload(source)) for source in preloads), "TMPDIR": folder}
