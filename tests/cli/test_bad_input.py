"""Bad input at the command line: exit code 2, one line with location and remedy, no change on disk.

Messages are tested where they are raised. Here are one case for each command and each message of the command line itself.
"""

import importlib.util
import os
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from codegen import configuration

from .conftest import BUILD, MAP, TRACKING, Refused, Run, edit

HIL = f"hil --build {BUILD} --ecu cffi --bus virtual:x"
SIL = f"sil --build {BUILD}"
SUITE = "sil --suite tracking"
REPORT = f"report --map {MAP} -o r.html"


@pytest.fixture
def files(here: Path) -> None:
    """Create a configuration, and files and folders of the wrong kind for each command."""
    Path("ars.toml").write_text(configuration.preset_text(), encoding="utf-8")
    for name in ("text.npz", "file.csv"):
        Path(name).write_text("vx, delta_f\n", encoding="utf-8")
    for name in ("folder", "folder.npz"):
        Path(name).mkdir()
    for name, target in (("link.csv", "file.csv"), ("link.png", "pipe.png"), ("link.npz", MAP)):
        Path(name).symlink_to(target)
    os.mkfifo("pipe.png")
    for name in ("itself.npz", "itself.png", "itself.csv", "itself"):
        Path(name).symlink_to(name)
    np.savez("bare.npz", vx=[5.0, 10.0], delta_f=[0.1, 0.2], yaw_rate=[[0.1, 0.2], [0.2, 0.4]])


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("init .", "exists already"),
        ("solve --case 4ws2 -o m.npz", "did you mean '4ws-2'"),
        ("solve --case fws -o m.txt", "only .npz is written"),
        (f"solve --case fws -o {BUILD}/fws.npz", "inside a build"),
        ("solve --case 4ws-2 -o m.npz --friction='0.3\n\x1b[31m,0.9'", "is not a number"),
        (f"show {MAP} --against link.npz", "is the map itself"),
        (f"build --map {MAP} --prefix=a-b", "such as ars"),
        (f"build --map {MAP} --max-error 0.05", "has no unit; give a number and deg/s or rad/s"),
        (f"build --map {MAP} --storage int16", "add --max-error or --max-flash"),
        (f"{SIL} --scenario stepsteer", "did you mean 'step-steer'"),
        (f"{SIL} --scenario ecu-loss", "codegen hil"),
        (f"{SIL} --scenario slalom --steering-wheel-angle-deg 9", "--steering-wheel-angle-deg: slalom does not take it"),
        (f"{SIL} --plot link.png", "not a file"),
        (f"{SIL} -o run", "run: no format for a run"),
        (f"{SIL} -o run.csv -o ./folder/../run.csv", "run.csv: it would be written twice; name each file once"),
        (f"{SIL} --scenario file.csv -o link.csv", "link.csv: it is an input of this command"),
        (f"{SIL} --can --jitter nan", "is not a number"),
        (f"{SIL} --limits mine.toml", "--limits: limits belong to a suite; use codegen suite tracking or cars"),
        ("solve --case 4ws-2 -o itself.npz", "itself.npz: it is a link to itself"),
        (f"tune --map {MAP} -o itself.npz", "itself.npz: it is a link to itself"),
        (f"show {MAP} --plot itself.png", "itself.png: it is a link to itself"),
        (f"{SIL} --plot itself.png", "itself.png: it is a link to itself"),
        (f"{SIL} --csv itself.csv", "itself.csv: it is a link to itself"),
        (f"build --map {MAP} -o itself", "itself: "),
        (f"firmware --build {BUILD} -o itself", "itself: it is a link to itself"),
        ("suite trakking", "did you mean 'tracking'"),
        ("sil --suite trakking", "did you mean 'tracking'"),
        (f"show {MAP} --plot map.pdf", "map.pdf: only PNG and SVG pictures are written; name it map.png"),
        (f"{SIL} --plot run", "run: only PNG and SVG pictures are written; name it run.png"),
        ("suite cars --plot x.png", "--plot: this suite draws no pictures; leave it out"),
        (f"suite cars --build {BUILD}", "--build: the cars of this suite have builds of their own; leave it out"),
        ("sil --cars 3", "--cars: random cars belong to their suite; use codegen suite cars"),
        (f"{SUITE} --scenario step-steer", "--scenario: it applies to a single scenario"),
        ("sil -o pictures --build nowhere", "a picture is drawn by plot"),
        (f"hil --build {BUILD} --ecu cffi --bus vcan0", "'vcan0' is not INTERFACE:CHANNEL"),
        (f"{HIL} --lock-step --scenario ecu-loss", "use --real-time"),
        ("plant --json --bus virtual:x --scenario ecu-loss", "cannot be switched off from here"),
        (f"faults --build {BUILD} --ecu native", "add --bus"),
        ("tune --map bare.npz -o t.npz", "bare.npz: it contains no configuration"),
        (f"{REPORT} --build {BUILD} --scenario nosuch", "there is no scenario 'nosuch'"),
        ("explore --map bare.npz", "bare.npz: it was not solved by codegen"),
        (f"explore --map {MAP} --folder gone", "gone: there is no such folder"),
        ("verify nowhere", "nowhere"),
        ("check nowhere", "nowhere"),
        ("check pipe.png", "pipe.png: not a file"),
        ("check folder", "folder: not a generated folder"),
    ],
)
def test_bad_input_gives_one_line(refused: Refused, files: None, command: str, words: str) -> None:
    line = refused(*shlex.split(command))
    assert words in line
    assert "\x1b" not in line


@pytest.mark.parametrize(
    ("command", "change", "words"),
    [
        ("solve --case 4ws-2 -o m.npz", ("per_rad = 119830.0", "per_rad = 60000.0"), "unstable"),
        (f"tune --map {MAP} -o t.npz", ("mass_kg = 2335.07", "mass_kg = 2000.0"), "[vehicle] differ"),
        (f"tune --map {MAP} -o t.npz", ("[cases.4ws-2]", "[cases.mine]"), "there is no case '4ws-2'"),
        (f"explore --map {MAP}", ('kind = "pi"', 'kind = "tracking"'), "ars.toml: controller.tracking.schedule: "),
    ],
)
def test_an_invalid_configuration_is_rejected(
    refused: Refused, files: None, command: str, change: tuple[str, str], words: str
) -> None:
    edit(Path("ars.toml"), change)
    line = refused(*shlex.split(command), "--config", "ars.toml")
    assert "ars.toml" in line and words in line


def test_user_files_in_an_output_folder_stay(run: Run, refused: Refused, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(BUILD, "ours")
    monkeypatch.setattr("codegen.emit.build.choose", lambda *_: pytest.fail("the search began before the folder was checked"))
    for folder in ("ours", "theirs"):
        Path(folder, "src").mkdir(parents=True, exist_ok=True)
        Path(folder, "src/mine.c").write_text("/* mine */\n", encoding="ascii")
        line = refused("build", "--map", MAP, "-o", folder, "--prefix", "other", "--max-error", "1deg/s")
        assert "mine.c" in line or f"{folder}: " in line


def test_a_missing_compiler_is_reported(refused: Refused, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "/nowhere")
    line = refused("sil", "--build", TRACKING)
    assert "compiler" in line and "install" in line


@pytest.mark.parametrize(("package", "command"), [("asammdf>=8.8,<9", f"{SIL} -o run.mf4"), ("plotly>=7.1,<8", REPORT)])
def test_a_missing_package_is_named(refused: Refused, monkeypatch: pytest.MonkeyPatch, package: str, command: str) -> None:
    found, module = importlib.util.find_spec, package.partition(">")[0]
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == module else found(name, *more))
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr("hil_sim.bench.run", lambda *_, **__: pytest.fail("it ran"))
    assert f'pip install "{package}"' in refused(*command.split())
