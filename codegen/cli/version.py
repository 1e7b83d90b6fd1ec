"""Output of `codegen --version`, from the metadata of the packages, which are not imported."""

from __future__ import annotations

import platform
from collections.abc import Iterator

from codegen import __version__

PACKAGES = ("casadi", "numpy", "cffi", "python-can")
"""Packages whose version can change a result."""


def lines() -> Iterator[str]:
    """Yield the version of codegen, then those of its environment."""
    from importlib.metadata import PackageNotFoundError, version

    yield f"codegen, version {__version__}"
    yield f"Python {platform.python_version()}"
    for name in PACKAGES:
        try:
            yield f"{name} {version(name)}"
        except PackageNotFoundError:
            yield f"{name}: not installed"
    yield f"C compiler: {_compiler()}"
    yield f"platform: {platform.system()} {platform.machine()}"


def _compiler() -> str:
    from codegen.errors import BuildError
    from codegen.sil.toolchain import compiler_command, compiler_identity

    try:
        return compiler_identity(compiler_command(), ())[0]
    except BuildError as error:
        return str(error)
