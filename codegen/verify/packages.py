"""Import the packages of the extra `verify` on demand."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import Any

from codegen.errors import CodegenError
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
