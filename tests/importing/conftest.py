"""Fixtures of the command line from tests/cli, and readers without a process of their own."""

import importlib
from typing import Any

import pytest

from codegen.errors import one_line
from codegen.importing import child
from tests.cli.conftest import refused, run

__all__ = ["refused", "run"]


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the calls of `codegen.importing.child` in this process, which has imported the libraries."""

    def call(module: str, function: str, *arguments: Any, **_: object) -> Any:
        try:
            return getattr(importlib.import_module(module), function)(*arguments)
        except (ImportError, MemoryError):
            raise
        except Exception as error:
            raise ValueError(one_line(error) or type(error).__name__) from None

    monkeypatch.setattr(child, "call", call)
