"""What checks work with: packages of the extra `verify`, imported on demand, and files of a build in a folder."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from codegen.errors import BuildError, CodegenError
from codegen.requirements import pip_install


class MissingTool(CodegenError):
    """A package or program that a check requires is missing, so the check is not run."""


def module(name: str, package: str) -> Any:
    """Return a module of a package.

    Raises:
        MissingTool: the package is not installed, or has no such module.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingTool(f"it cannot be imported ({error})", where=package, remedy=pip_install(package)) from None


def require(name: str) -> Path:
    """Return the folder of a package that contains a program. Raises MissingTool: it is not installed."""
    spec = importlib.util.find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        raise MissingTool("it is not installed", where=name, remedy=pip_install(name))
    return Path(spec.submodule_search_locations[0])


@contextlib.contextmanager
def stored(files: Mapping[str, str | bytes]) -> Iterator[Path]:
    """Store files, content by path, in a temporary folder. Raises BuildError if the disk is full."""
    try:
        with tempfile.TemporaryDirectory(prefix="ars-verify-") as scratch:
            folder = Path(scratch)
            for path, content in files.items():
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                (folder / path).write_bytes(content.encode() if isinstance(content, str) else content)
            yield folder
    except OSError as error:
        raise BuildError(
            f"the files cannot be stored: {error.strerror or error}", remedy="free space for temporary files"
        ) from error
