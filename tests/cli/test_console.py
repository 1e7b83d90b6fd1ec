"""Progress, status and colour: on a terminal, elsewhere, and for programs."""

import io
import sys
from typing import Any

import pytest

from codegen import console
from codegen.report.live import LiveView


class Terminal(io.StringIO):
    """Standard error of a user at a terminal."""

    isatty = staticmethod(lambda: True)  # type: ignore[assignment]


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment that says nothing about colour."""
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
        (io.StringIO, {"FORCE_COLOR": "1", "NO_COLOR": "1"}, False),
    ],
)
def test_use_of_colour(monkeypatch: pytest.MonkeyPatch, stream: Any, environment: dict[str, str], expected: bool) -> None:
    for variable in environment.items():
        monkeypatch.setenv(*variable)
    assert console.has_colour(stream()) is expected


def shown(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO) -> str:
    """Return what stands on standard error after a progress, a progress with named steps, and a status."""
    monkeypatch.setattr(sys, "stderr", stream)
    with console.progress("half [of it]") as progress:
        progress(1, 2)
        progress(2, 2)
    with console.progress("placing") as progress:
        progress(0, 20, "a [b]")
        progress(1, 20, "c [d]")
        progress(20, 20, "c [d]" if stream.isatty() else "")  # a bar is drawn for certain at its end
    with console.status("a step [too]"):
        pass
    return stream.getvalue()


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_without_a_terminal_progress_is_plain_lines(monkeypatch: pytest.MonkeyPatch, stream: type[io.StringIO]) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "dumb")
    steps = "placing: 0 %, a [b]\nplacing: 5 %, c [d]\nplacing: 100 %"
    text = shown(monkeypatch, stream()).replace("100 %, c [d]", "100 %")
    assert text == f"half [of it]: 50 %\nhalf [of it]: 100 %\n{steps}\n"


def test_on_a_terminal_it_is_a_bar_and_a_line_that_go_away(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, Terminal())
    colour = "\x1b[3"
    assert all(words in text for words in ("half [of it]", "placing: c [d]", "a step [too] ...", colour))
    monkeypatch.setenv("NO_COLOR", "1")
    assert colour not in shown(monkeypatch, Terminal())


def test_forced_colour_draws_no_live_view(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(sys, "stderr", stream := io.StringIO())
    with LiveView("title", "bus", "ecu", "clock"):
        pass
    assert stream.getvalue() == ""
