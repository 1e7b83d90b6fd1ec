"""`codegen explore` as its user starts and ends it; the page itself is tested in tests/explore and tests/browser."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import urllib.request
import webbrowser
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen import config as configuration
from codegen.cli.explore_command import _opened
from codegen.refmap import map as npz
from codegen.refmap.solve import solve_case

from .conftest import Run

Refused = Callable[..., str]
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def solved(tmp_path: Path) -> Path:
    data = configuration.preset().model_dump(mode="json")
    data["grid"] |= {"speed_points": 11, "front_angle_points": 10}
    path = tmp_path / "map.npz"
    npz.save(solve_case(configuration.parse(data, "test"), "4ws-2"), path)
    return path


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_its_address_serves_and_ends_on_a_signal(solved: Path, number: int) -> None:
    command = [sys.executable, "-m", "codegen", "explore", "--map", solved.name, "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        command, cwd=solved.parent, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:")
        assert process.stdout.readline() == "Ctrl-C ends it.\n"
        with urllib.request.urlopen(address, timeout=60) as page:
            assert b"<title>Explore map</title>" in page.read()
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")
    assert [path.name for path in solved.parent.iterdir()] == ["map.npz"]


BROWSER = """
import json, os, pathlib, sys, urllib.parse, urllib.request

path = pathlib.Path(urllib.request.url2pathname(urllib.parse.urlsplit(sys.argv[1]).path))
modes = [oct(os.stat(each).st_mode & 0o777) for each in (path, path.parent)]
told = {"arguments": sys.argv[1:], "path": str(path), "text": path.read_text(encoding="utf-8"), "modes": modes}
pathlib.Path(__file__).with_suffix(".json").write_text(json.dumps(told), encoding="utf-8")
"""


@pytest.mark.skipif(os.name != "posix", reason="modes of files, and a script as browser")
def test_the_browser_is_not_started_with_the_key(solved: Path, tmp_path: Path) -> None:
    """What a process is started with can be read by every user of the computer."""
    script = tmp_path / "browser.py"
    script.write_text(BROWSER, encoding="utf-8")
    command = [sys.executable, "-m", "codegen", "explore", "--map", solved.name]
    own = {"PYTHONPATH": str(ROOT), "BROWSER": f"{sys.executable} {script} %s", "DISPLAY": ":0", "TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        command, cwd=solved.parent, env={**os.environ, **own}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert process.stdout.readline() == "Ctrl-C ends it.\n"
        # It ends after the browser has been started, and not before.
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")
    told = json.loads(script.with_suffix(".json").read_text(encoding="utf-8"))
    key = address.partition("key=")[2]
    assert len(key) >= 32
    assert key not in " ".join(told["arguments"])
    assert f"url={address}" in told["text"]
    assert told["modes"] == ["0o600", "0o700"]
    assert not Path(told["path"]).exists()
    assert {path.name for path in tmp_path.iterdir()} == {"map.npz", "browser.py", "browser.json"}


@pytest.mark.parametrize("fault", ["no browser", "no folder", "no screen"])
def test_a_browser_that_is_not_opened_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], fault: str
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(webbrowser, "open", lambda address: fault != "no browser")
    for name, value in (("DISPLAY", ":0"), ("WAYLAND_DISPLAY", "")):
        monkeypatch.setenv(name, "" if fault == "no screen" else value)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone" if fault == "no folder" else tmp_path))
    with _opened("http://127.0.0.1:1/?key=secret"):
        assert capsys.readouterr().err == "note: no browser was opened; open that address in one on this computer\n"
    assert list(tmp_path.iterdir()) == []


def test_no_such_map(refused: Refused) -> None:
    assert "nowhere.npz" in refused("explore", "--map", "nowhere.npz")


def test_a_bare_map_has_nothing_to_explore(refused: Refused, solved: Path) -> None:
    whole = npz.load(solved)
    bare = dataclasses.replace(whole, config=None, case=None, active=None, sideslip=None, rear_angle=None, meta={})
    npz.save(bare, solved)
    assert "map.npz: it was not solved here" in refused("explore", "--map", "map.npz")


def test_a_configuration_without_the_case_of_the_map(refused: Refused, solved: Path) -> None:
    text = configuration.preset_text().replace("[cases.4ws-2]", "[cases.other]")
    (solved.parent / "ars.toml").write_text(text, encoding="utf-8")
    assert "there is no case '4ws-2'" in refused("explore", "--map", "map.npz", "--config", "ars.toml")


def test_an_untuned_controller(refused: Refused, solved: Path) -> None:
    (solved.parent / "ars.toml").write_text(configuration.preset_text("recommended"), encoding="utf-8")
    line = refused("explore", "--map", "map.npz", "--config", "ars.toml")
    assert line.startswith("error: ars.toml: controller.tracking.schedule: ")
    assert "codegen tune" in line


def test_a_folder_that_is_not_there(refused: Refused, solved: Path) -> None:
    assert "gone: there is no such folder" in refused("explore", "--map", "map.npz", "--folder", "gone")


def test_a_port_that_is_taken(refused: Refused, solved: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert f"--port: port {port} is in use" in refused("explore", "--map", "map.npz", "--no-browser", "--port", port)
    assert "--port" in refused("explore", "--map", "map.npz", "--port", "65536")


def test_without_plotly_the_extra_is_named(refused: Refused, solved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "plotly" else found(name, *more))
    line = refused("explore", "--map", "map.npz")
    assert 'pip install "ars-codegen[report]"' in line


def test_help_names_the_options(run: Run) -> None:
    answer = run("explore", "--help")
    for option in ("--map", "--config", "--folder", "--port", "--no-browser"):
        assert option in answer.out
