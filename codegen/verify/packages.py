"""The packages of the extra `verify`: imported when they are first needed."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from codegen.errors import CodegenError

EXTRA = 'pip install "ars-codegen[verify]"'


class MissingTool(CodegenError):
    """A package or a program that a check needs is not there: the check is not run."""


def module(name: str, package: str) -> Any:
    """A module of a package.

    Raises:
        MissingTool: it is not installed, or is one that has no such module.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingTool(f"it cannot be imported ({error})", where=package, remedy=EXTRA) from None


def require(name: str) -> None:
    """Refuse to go on without a package that is called as a program. Raises MissingTool."""
    if importlib.util.find_spec(name) is None:
        raise MissingTool("it is not installed", where=name, remedy=EXTRA)
