"""Compile the shared library of an FMU for the current platform."""

from __future__ import annotations

import platform
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from codegen.errors import BuildError
from codegen.export.fmu.standard import Version
from codegen.sil.compile import DEFAULT_FLAGS
from codegen.sil.toolchain import compiler_command, require_success, run

FLAGS = (*DEFAULT_FLAGS, "-fvisibility=hidden")
"""Compiler flags of the SIL, for identical results; only FMI functions are exported."""

_ARCHITECTURES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}


def library_path(version: Version, identifier: str) -> str:
    """Return the path of the binary in the archive. FMI 3.0 names the processor; FMI 2.0 only system and word length.

    Raises:
        BuildError: the platform is not supported.
    """
    system = next((name for name in ("linux", "darwin") if sys.platform.startswith(name)), None)
    architecture = _ARCHITECTURES.get(platform.machine().lower())
    if system is None or architecture is None:
        where = f"{sys.platform} on {platform.machine()}"
        raise BuildError("no FMU can be compiled here", where=where, remedy="use Linux or macOS on x86-64 or AArch64")
    folder = f"{architecture}-{system}" if version == "3" else f"{system}64"
    return f"binaries/{folder}/{identifier}.{'dylib' if system == 'darwin' else 'so'}"


def compile_binary(sources: Mapping[str, bytes], name: str) -> bytes:
    """Compile C sources to the shared library `name`; equal sources and compilers give equal bytes.

    Raises:
        BuildError: no compiler, or C that does not compile.
    """
    if sys.platform == "darwin":
        kind = ["-dynamiclib", f"-Wl,-install_name,@rpath/{name}"]
    else:  # without symbols of its own and build id, which change with nothing that counts
        kind = ["-shared", "-s", "-Wl,--build-id=none"]
    units = sorted(path for path in sources if path.endswith(".c"))
    with tempfile.TemporaryDirectory(prefix="ars-fmu-") as scratch:
        folder = Path(scratch)
        try:
            for path, content in sources.items():
                (folder / path).write_bytes(content)
            require_success(run([*compiler_command(), *FLAGS, *kind, *units, "-o", name, "-lm"], folder), name)
            return (folder / name).read_bytes()
        except OSError as error:
            raise BuildError(
                f"the FMU cannot be compiled: {error.strerror}", where=scratch, remedy="free some space"
            ) from error
