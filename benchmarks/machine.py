"""The machine and the tools of a run, in words."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from codegen.sil.toolchain import compiler_command, compiler_identity

LIBRARIES = ("casadi", "numpy", "scipy")


def description() -> str:
    """Describe the machine in lines: processor, cores, system, compiler, Python and libraries."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return "\n".join(
        (
            f"{_processor()}, {usable} cores usable; {_system()}; {load()}",
            f"{compiler_identity(compiler_command(), ())[0]}",
            f"Python {platform.python_version()}, {libraries}",
        )
    )


def load() -> str:
    """Describe the load of the machine."""
    return f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"


def _system() -> str:
    """Return the system with the kernel's version, without the builder's name."""
    return f"{platform.system()} {'.'.join(platform.release().split('.')[:2])}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
