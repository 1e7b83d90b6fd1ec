"""Signals at inconvenient moments."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import FrameType

import pytest

from codegen import interrupts
from codegen.sil import toolchain


@pytest.fixture(autouse=True)
def restored() -> Iterator[None]:
    with ExitStack() as stack:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            stack.callback(signal.signal, number, signal.getsignal(number))
        yield


def test_a_second_ctrl_c_does_not_interrupt_the_cleanup_of_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(interrupts.time, "monotonic", lambda: now)
    interrupts.install_handlers({signal.SIGINT: interrupts.raise_once(lambda _: KeyboardInterrupt())})
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)
    now += interrupts.REPEATED_INTERRUPT_IGNORED_S
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_signal_in_code_that_swallows_exceptions_is_raised_after_it() -> None:
    """CasADi's operators have `except:` around their whole body."""
    came: list[int] = []

    def handler(number: int, frame: FrameType | None) -> None:
        came.append(number)
        raise SystemExit(number)

    interrupts.install_handlers({signal.SIGTERM: handler})
    inside = {
        "__name__": interrupts.EXCEPTION_SWALLOWING_MODULES[0],
        "raise_signal": lambda: signal.raise_signal(signal.SIGTERM),
        "came": came,
    }
    exec("def swallow():\n    try: raise_signal()\n    except: pass\n    return list(came)\n", inside)
    assert inside["swallow"]() == []  # type: ignore[operator]
    with pytest.raises(SystemExit):
        signal.pause()  # until the handler of the timer raises
    assert came == [signal.SIGTERM]
    import casadi

    assert casadi.SX.__module__ in interrupts.EXCEPTION_SWALLOWING_MODULES


def test_files_of_a_killed_compiler_are_removed_later(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "import os; print(os.environ['TMPDIR'])"]
    assert toolchain.run(command, tmp_path).stdout.strip() == str(tmp_path)
