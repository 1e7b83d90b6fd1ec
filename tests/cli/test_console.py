"""What is told while something takes long: on a terminal, elsewhere, and to programs; and where colour is used."""

from __future__ import annotations

import io
import sys

import pytest

from codegen import console
from codegen.report.live import LiveView
from codegen.verify.check import Outcome, Subject, Verdict
from codegen.verify.runner import Report
from codegen.verify.table import table

COLOURS = ("NO_COLOR", "FORCE_COLOR", "TERM")


class Terminal(io.StringIO):
    """Standard error of somebody who looks on."""

    def isatty(self) -> bool:
        """It is one."""
        return True


@pytest.fixture
def streams(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in COLOURS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")


@pytest.mark.parametrize(
    ("stream", "environment", "expected"),
    [
        (Terminal, {}, True),
        (io.StringIO, {}, False),
        (Terminal, {"NO_COLOR": "1"}, False),
        (Terminal, {"NO_COLOR": ""}, True),  # no-color.org: where it is not empty
        (Terminal, {"TERM": "dumb"}, False),
        (io.StringIO, {"FORCE_COLOR": "1"}, True),
        (io.StringIO, {"FORCE_COLOR": ""}, False),
        (io.StringIO, {"FORCE_COLOR": "1", "NO_COLOR": "1"}, False),
        (Terminal, {"FORCE_COLOR": "1", "TERM": "dumb"}, True),
    ],
)
def test_where_colour_is_used(
    streams: None, monkeypatch: pytest.MonkeyPatch, stream: type[io.StringIO], environment: dict[str, str], expected: bool
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert console.has_colour(stream()) is expected


def told(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO) -> str:
    """What stands on standard error after a progress and a status."""
    monkeypatch.setattr(sys, "stderr", stream)
    with console.progress("half [of it]") as progress:
        progress(1, 2)
        progress(2, 2)
    with console.status("a step [too]"):
        pass
    return stream.getvalue()


def test_a_named_step_stands_on_the_bar_and_is_a_line_of_its_own_elsewhere(
    streams: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    for stream, last in ((io.StringIO(), ""), (Terminal(), "c [d]")):  # a bar is drawn for certain at its end
        monkeypatch.setattr(sys, "stderr", stream)
        with console.progress("placing") as progress:
            for done, step in enumerate(("a [b]", "c [d]")):
                progress(done, 20, step)
            progress(20, 20, last)
        if last:
            assert "placing: c [d]" in stream.getvalue()
        else:
            assert stream.getvalue() == "placing: 0 %, a [b]\nplacing: 5 %, c [d]\nplacing: 100 %\n"


def test_elsewhere_it_is_plain_lines(streams: None, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = "half [of it]: 50 %\nhalf [of it]: 100 %\n"
    assert told(monkeypatch, io.StringIO()) == lines
    monkeypatch.setenv("FORCE_COLOR", "1")  # a bar is no colour
    assert told(monkeypatch, io.StringIO()) == lines
    monkeypatch.setenv("TERM", "dumb")
    assert told(monkeypatch, Terminal()) == lines


def test_on_a_terminal_it_is_a_bar_and_a_line_that_go_away(streams: None, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = told(monkeypatch, Terminal())
    assert "half [of it]" in seen
    assert "a step [too] ..." in seen
    assert "\x1b[3" in seen  # colour
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[3" not in told(monkeypatch, Terminal())


def test_nothing_of_it_is_on_standard_output(
    streams: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for stream in (io.StringIO(), Terminal()):
        told(monkeypatch, stream)
    assert capsys.readouterr().out == ""


def test_a_closed_standard_error_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    with console.status("unseen"):
        pass


def test_colour_that_is_forced_draws_no_live_view(streams: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with LiveView("title", "bus", "ecu", "clock"):
        pass
    assert sys.stderr.getvalue() == ""  # type: ignore[attr-defined]


def test_the_table_of_verify_is_text(streams: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    report = Report(Subject("build", {}, {}), None, {"proof": Outcome("shows", "1", Verdict.PASSED)})  # type: ignore[arg-type]
    assert "proof" in table(report)
    assert "\x1b" not in table(report)
