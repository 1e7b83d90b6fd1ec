"""The packages of the extra `verify`: imported when they are first needed."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from codegen.errors import CodegenError

EXTRA = 'pip install "ars-codegen[verify]"'


def module(name: str, package: str) -> Any:
    """A module of a package.

    Raises:
        CodegenError: it is not installed, or is one that has no such module.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise CodegenError(f"it cannot be imported ({error})", where=package, remedy=EXTRA) from None


def require(name: str) -> None:
    """Refuse to go on without a package that is called as a program. Raises CodegenError."""
    if importlib.util.find_spec(name) is None:
        raise CodegenError("it is not installed", where=name, remedy=EXTRA)
