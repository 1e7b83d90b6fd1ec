"""Versions, sources and tools that determine the results of a campaign."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import codegen
import hil_sim
from codegen.emit.render import templates_root
from codegen.sil.toolchain import compiler_command, compiler_identity

PACKAGES = ("numpy", "scipy", "casadi")
SOURCES = (".py", ".toml")
"""Suffixes of the sources in the packages: modules and presets."""
TEMPLATES_IN_WHEEL = "_templates"


@cache
def versions() -> dict[str, str]:
    """Return name -> version of this package and of PACKAGES."""
    return {"codegen": codegen.__version__, **{name: version(name) for name in PACKAGES}}


def identity() -> dict[str, str]:
    """Return name -> version or digest of all on a machine that determines the results of a chunk, besides its plan.

    Raises:
        BuildError: there is no C compiler.
    """
    line, target, _ = compiler_identity(compiler_command(), ())
    words = line.split(" ", 1)  # `cc (Debian 12.2.0-14) 12.2.0`, by whichever name it was called
    compiler = words[-1] if words[-1].startswith("(") else line
    sources = sources_digest()
    return {
        **versions(),
        "Python": platform.python_version(),
        "C library": " ".join(platform.libc_ver()),
        "C compiler": f"{compiler} for {target}",
        "sources": sources if sources == _AT_START else "changed since it started",
    }


def sources_digest() -> str:
    """Return SHA-256 of the versions and of all sources of this package, in hexadecimal digits.

    During development the sources change without the version.
    """
    found = hashlib.sha256(repr(versions()).encode())
    for name, content in _sources():
        found.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return found.hexdigest()


def _sources() -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each source. The names are the same in a checkout and in an installed wheel."""
    for package in (codegen, hil_sim):
        root = Path(str(package.__file__)).parent
        for path in sorted(path for path in root.rglob("*") if path.suffix in SOURCES):
            inside = path.relative_to(root)
            if inside.parts[0] != TEMPLATES_IN_WHEEL:
                yield f"{package.__name__}/{inside.as_posix()}", path.read_bytes()
    root = templates_root()
    for path in sorted(path for path in root.rglob("*") if path.is_file()):
        yield f"templates/{path.relative_to(root).as_posix()}", path.read_bytes()


_AT_START = sources_digest()
"""Digest when this process began to use the sources. Those that change later are not the ones that run."""
