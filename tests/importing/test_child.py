"""Calls in a process of their own: the result or the error returns; a crash, a long call or too much memory is an error."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.importing.child import ChildError, call
from codegen.limits import Limits


def test_the_result_returns() -> None:
    np.testing.assert_array_equal(call("numpy", "arange", 5), np.arange(5))
    assert call("builtins", "print", "a library that prints") is None


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        (("os", "abort"), ChildError, "its reader crashed, exit code -6"),
        (("builtins", "int", "x"), ValueError, "invalid literal for int"),
        (("no_such_package", "read"), ImportError, "No module named 'no_such_package'"),
        pytest.param(
            ("builtins", "bytes", 2 * 10**9),
            MemoryError,
            "takes more than 1.6 GB of memory",
            marks=pytest.mark.skipif(sys.platform != "linux", reason="only Linux enforces the limit"),
        ),
    ],
)
def test_a_failure_returns(arguments: tuple[Any, ...], kind: type[Exception], words: str | None) -> None:
    with pytest.raises(kind, match=words):
        call(*arguments)


def test_a_long_call_ends() -> None:
    limits = Limits(seconds=0.3)
    for work in ("import threading; threading.Event().wait()", "while True: pass"):
        with pytest.raises(ChildError, match=r"does not end within 0\.9 s by the clock"):
            call("builtins", "exec", work, limits=limits)


def test_modules_in_the_current_folder_are_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit(99)", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert call("numpy", "zeros", 1) == 0.0
