"""Progress, status and colour: on a terminal, elsewhere, and for programs."""

import io
import sys
from typing import Any

import pytest

from codegen import console


class Terminal(io.StringIO):
    """Standard error of a user at a terminal."""

    isatty = staticmethod(lambda: True)  # type: ignore[assignment]


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove colour settings from the environment."""
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")


@pytest.mark.parametrize(
    ("stream", "environment", "expected"),
    [
        (Terminal, {}, True),
        (io.StringIO, {}, False),
        (Terminal, {"NO_COLOR": "1"}, False),
        (Terminal, {"TERM": "dumb"}, False),
        (io.StringIO, {"FORCE_COLOR": "1", "NO_COLOR": ""}, True),  # no-color.org: only if it is not empty
    ],
)
def test_use_of_colour(monkeypatch: pytest.MonkeyPatch, stream: Any, environment: dict[str, str], expected: bool) -> None:
    for variable in environment.items():
        monkeypatch.setenv(*variable)
    assert console.has_colour(stream()) is expected


def test_without_a_terminal_progress_is_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", stream := io.StringIO())
    with console.progress("half [of it]") as progress:
        progress(1, 2)
        progress(2, 2)
    with console.progress("placing") as progress:
        progress(0, 20, "a [b]")
        progress(1, 20, "c [d]")
    assert stream.getvalue() == "half [of it]: 50 %\nhalf [of it]: 100 %\nplacing: 0 %, a [b]\nplacing: 5 %, c [d]\n"
