"""Progress, status and colour: on a terminal, elsewhere, and for programs."""

import ast
import io
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from codegen import console

ROOT = Path(__file__).resolve().parents[2]


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


EVIL = "yaw\x1b]0:PWNED\x07\x1b[31m\u202e rate\x9b2J"
CLEAN = "yaw]0:PWNED[31m rate2J"


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_no_escape_sequence_of_a_file_reaches_the_terminal(monkeypatch: pytest.MonkeyPatch, stream: type[io.StringIO]) -> None:
    monkeypatch.setattr(sys, "stdout", out := stream())
    monkeypatch.setattr(sys, "stderr", err := stream())
    console.say(EVIL, f"two\n\tlines {EVIL}")
    console.note(f"a\n{EVIL}")
    console.warn(f"{EVIL}\r")
    console.complain(f"error: {EVIL}")
    console.print_json({EVIL: EVIL})
    assert out.getvalue().startswith(f"{CLEAN}\ntwo\n\tlines {CLEAN}\n{{\n") and out.getvalue().isascii()
    assert err.getvalue() == f"note: a {CLEAN}\nwarning: {CLEAN}\nerror: {CLEAN}\n"
    assert "\x1b" not in out.getvalue()


def test_only_our_own_colour_reaches_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", out := Terminal())
    console.say(console.Coloured(EVIL, EVIL, EVIL, "red"))
    assert out.getvalue() == f"{CLEAN}\x1b[31m{CLEAN}\x1b[0m{CLEAN}\n"


def test_progress_and_status_are_clean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", plain := io.StringIO())
    with console.progress(EVIL) as progress:
        progress(1, 2, EVIL)
        progress(2, 2)
    assert plain.getvalue() == f"{CLEAN}: 50 %, {CLEAN}\n{CLEAN}: 100 %\n"
    monkeypatch.setattr(sys, "stderr", screen := Terminal())
    with console.progress(EVIL) as progress, console.status(EVIL):
        progress(1, 2, EVIL)
    assert "\x1b]0" not in screen.getvalue() and "\x07" not in screen.getvalue() and "\u202e" not in screen.getvalue()


def test_no_other_module_prints() -> None:
    """Apart from programs of their own, and the cache, which is below `console` and prints one clean line."""
    allowed = {"codegen/console.py", "codegen/cache.py", "codegen/verify/cbmc.py", "ars_codegen/__init__.py"}
    found = {
        path.relative_to(ROOT).as_posix()
        for package in ("codegen", "hil_sim", "ars_codegen")
        for path in (ROOT / package).rglob("*.py")
        if re.search(r"\bprint\(|\.s?echo\(|stdout\.write", text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("print", "click.echo", "click.secho", "sys.stdout.write")
    }
    assert found == allowed
