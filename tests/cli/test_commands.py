"""Each command once as its help shows it, and what it promises about output, JSON, notes and exit codes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from codegen import __version__
from codegen import config as configuration
from codegen.cli import cli
from codegen.sil.software import RECORD_COLUMNS

from .conftest import Run, everything_in

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = sorted(cli.commands)


def small_config(folder: Path) -> Path:
    """An ars.toml with a small grid, which makes plots and builds quick."""
    text = configuration.preset_text()
    text = text.replace("speed_points = 101", "speed_points = 11").replace(
        "front_angle_points = 100", "front_angle_points = 10"
    )
    path = folder / "ars.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def solved(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small solved map in the current folder."""
    monkeypatch.chdir(tmp_path)
    answer = run("solve", "--config", small_config(tmp_path), "--case", "4ws-2", "-o", "4ws2.npz")
    assert answer.code == 0, answer
    return Path("4ws2.npz")


@pytest.mark.parametrize("preset", ["recommended", "paper"])
def test_a_user_goes_from_init_to_a_run(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, preset: Literal["recommended", "paper"]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("init", "my-car", *(["--preset", preset] if preset == "paper" else [])).code == 0
    monkeypatch.chdir(tmp_path / "my-car")
    assert configuration.load(Path("ars.toml")) == configuration.preset(preset)
    assert run("solve", "--config", "ars.toml", "--case", "4ws-2", "-o", "4ws2.npz").code == 0
    if preset == "recommended":
        refused = run("build", "--map", "4ws2.npz")
        assert refused.code == 2
        assert "codegen tune" in refused.err
        assert run("tune", "--map", "4ws2.npz", "-o", "4ws2.npz").code == 0
    shown = run("show", "4ws2.npz", "--plot", "map.png")
    assert "6582 of 10100 cells feasible" in shown.out
    assert "front slip + rear slip" in shown.out
    assert run("build", "--map", "4ws2.npz").code == 0
    ran = run("sil", "--build", "generated/4ws2", "--plot", "run.png", "--csv", "run.csv")
    assert "yaw rate, steady [deg/s]" in ran.out
    for picture in ("map.png", "run.png"):
        assert Path(picture).read_bytes().startswith(b"\x89PNG")
    assert Path("run.csv").read_text(encoding="ascii").splitlines()[0] == ",".join(RECORD_COLUMNS)
    names = {path.name for path in Path().iterdir()}
    assert names == {"ars.toml", "4ws2.npz", "generated", "map.png", "run.png", "run.csv"}


def test_build_writes_what_the_interface_names(run: Run, solved: Path) -> None:
    assert run("build", "--map", solved).code == 0
    built = set(everything_in(Path("generated/4ws2")))
    assert built >= {
        "README.md",
        "CMakeLists.txt",
        "manifest.json",
        "include/ars_controller.h",
        "include/ars_map.h",
        "include/ars_dynamics.h",
        "src/ars_controller.c",
        "src/ars_map.c",
        "src/ars_dynamics.c",
        "example/example_main.c",
    }


def test_build_check_says_whether_the_folder_is_up_to_date(run: Run, solved: Path) -> None:
    missing = run("build", "--map", solved, "--check")
    assert missing.code == 1
    assert not Path("generated").exists()
    run("build", "--map", solved)
    assert run("build", "--map", solved, "--check").code == 0
    source = Path("generated/4ws2/src/ars_controller.c")
    source.write_text(source.read_text() + "\n/* edited */\n")
    stale = run("build", "--map", solved, "--check")
    assert stale.code == 1
    assert "src/ars_controller.c" in stale.err
    assert len(stale.err.splitlines()) == 1
    assert run("build", "--map", solved).code == 0
    assert run("build", "--map", solved, "--check").code == 0


def test_a_bare_map_builds_with_the_papers_car_and_says_so(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    speed, angle = np.array([5.0, 15.0, 30.0]), np.array([0.02, 0.05, 0.1])
    np.savez("mine.npz", vx=speed, delta_f=angle, yaw_rate=np.minimum(np.outer(speed / 3.2, angle), 5.0 / speed[:, np.newaxis]))
    answer = run("build", "--map", "mine.npz")
    assert answer.code == 0
    assert "the paper's PI" in answer.err
    # The default controller: with its rate limit of 25 deg/s, which the paper's has not.
    assert ".rear_rate_max = 0.43633232f" in Path("generated/mine/src/ars_calibration.c").read_text()
    assert "those of the paper's car" in Path("generated/mine/README.md").read_text()
    assert run("sil", "--build", "generated/mine").code == 0
    assert json.loads(run("build", "--map", "mine.npz", "--json").out)["notes"]


def test_a_map_is_enough_and_brings_its_own_configuration(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = small_config(tmp_path)
    path.write_text(path.read_text().replace("integral_gain = 1.0", "integral_gain = 0.75"))
    run("solve", "--config", path, "--case", "4ws-2", "-o", "own.npz")
    path.unlink()
    notes = run("build", "--map", "own.npz").err.splitlines()
    assert [note.partition(" of kind")[0] for note in notes] == ["note: the feedback"]  # its margins, and nothing borrowed
    assert ".integral_gain = 0.75f" in Path("generated/own/src/ars_calibration.c").read_text()


def test_a_configuration_given_beside_the_map_wins(run: Run, solved: Path) -> None:
    path = Path("ars.toml")
    path.write_text(path.read_text().replace("integral_gain = 1.0", "integral_gain = 0.5"))
    run("build", "--map", solved, "--config", path)
    assert ".integral_gain = 0.5f" in Path("generated/4ws2/src/ars_calibration.c").read_text()


def test_a_configuration_of_another_car_is_noted(run: Run, solved: Path) -> None:
    path = Path("ars.toml")
    path.write_text(path.read_text().replace("mass_kg = 2335.07", "mass_kg = 1800.0"))
    assert "another car" in run("build", "--map", solved, "--config", path).err


def test_data_of_the_car_that_are_not_given_are_named(run: Run, tmp_path: Path) -> None:
    path = small_config(tmp_path)
    path.write_text(path.read_text().replace("mass_kg = 2335.07", ""))
    answer = run("solve", "--config", path, "--case", "fws", "-o", tmp_path / "map.npz")
    assert answer.code == 0
    assert "vehicle.mass_kg" in answer.err


def test_a_car_that_never_settles_has_no_steady_value(run: Run, solved: Path) -> None:
    """A gain thirty times the paper's ends in a limit cycle."""
    path = Path("ars.toml")
    path.write_text(path.read_text().replace("integral_gain = 1.0", "integral_gain = 30.0"))
    run("build", "--map", solved, "--config", path)
    assert "NO: means only" in run("sil", "--build", "generated/4ws2").out
    assert json.loads(run("sil", "--build", "generated/4ws2", "--json").out)["metrics"]["controlled"]["settled"] is False


def test_no_arguments_show_the_help(run: Run) -> None:
    answer = run()
    assert answer.code == 2
    assert "Commands:" in answer.err


def test_a_run_of_edited_c_says_so(run: Run, solved: Path) -> None:
    run("build", "--map", solved)
    source = Path("generated/4ws2/src/ars_controller.c")
    source.write_text(source.read_text() + "\n/* edited */\n")
    assert "ars_controller.c was changed after the build" in run("sil", "--build", "generated/4ws2").err


def test_a_failing_self_test_is_a_failed_check(run: Run, solved: Path) -> None:
    run("build", "--map", solved)
    source = Path("generated/4ws2/src/ars_calibration.c")
    text, count = re.subn(r"expected_checksum = 0x[0-9A-F]{8}u", "expected_checksum = 0x12345678u", source.read_text())
    assert count == 1
    source.write_text(text)
    answer = run("sil", "--build", "generated/4ws2")
    assert answer.code == 1
    assert "self-test" in answer.err


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_each_command_shows_an_example(run: Run, command: str) -> None:
    answer = run(command, "--help")
    assert answer.code == 0
    assert f"Example:\n    codegen {command}" in answer.out


def test_every_printing_command_takes_json(run: Run, solved: Path) -> None:
    outputs = (
        run("solve", "--config", "ars.toml", "--case", "fws", "-o", "fws.npz", "--json"),
        run("show", solved, "--json"),
        run("build", "--map", solved, "--json"),
        run("build", "--map", solved, "--check", "--json"),
        run("sil", "--build", "generated/4ws2", "--json"),
    )
    for answer in outputs:
        assert answer.code == 0
        assert isinstance(json.loads(answer.out), dict)


def test_both_methods_write_the_same_map(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = small_config(tmp_path)
    plain = run("solve", "--config", path, "--case", "4ws-2", "-o", "ipopt.npz", "--method", "ipopt")
    run("solve", "--config", path, "--case", "4ws-2", "-o", "exact.npz")
    # A plain line for each tenth where there is no terminal.
    assert "solving 4ws-2: 100 %" in plain.err.splitlines()
    with np.load("ipopt.npz") as one, np.load("exact.npz") as other:
        np.testing.assert_array_equal(one["feasible"], other["feasible"])
        np.testing.assert_allclose(one["yaw_rate"], other["yaw_rate"], rtol=0.0, atol=1e-6)  # the agreement asked of them


def codegen(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command as its own process, from a checkout or an installed package."""
    return subprocess.run(
        [sys.executable, "-m", "codegen", *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        check=False,
    )


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_imports_neither_casadi_nor_a_plotting_library(option: str) -> None:
    script = (
        f"import sys; from codegen import cli; sys.argv = ['codegen', '{option}']\n"
        "try: cli.main()\n"
        "except SystemExit: pass\n"
        "heavy = {'casadi', 'matplotlib', 'scipy', 'numpy', 'pydantic', 'jinja2', 'cffi', 'can', 'rich'} & set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or None)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=False)
    assert result.returncode == 0, result.stderr


def test_version() -> None:
    result = codegen("--version")
    assert result.returncode == 0
    lines = result.stdout.splitlines()
    assert lines[0] == f"codegen, version {__version__}"
    assert [line.split()[0] for line in lines[1:]] == ["Python", "casadi", "numpy", "cffi", "python-can", "C", "platform:"]
    assert lines[3] == f"numpy {np.__version__}"


def test_version_without_a_compiler_says_so() -> None:
    result = codegen("--version", CC="no-such-compiler")
    assert result.returncode == 0
    assert "no-such-compiler" in result.stdout


def test_a_reader_that_stops_reading_is_no_error(tmp_path: Path) -> None:
    command = f"{sys.executable} -m codegen --help | true"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    result = subprocess.run(command, shell=True, capture_output=True, text=True, env=environment, check=False, cwd=tmp_path)
    assert result.stderr == ""


def test_debug_shows_the_traceback_wherever_it_stands(tmp_path: Path) -> None:
    missing = str(tmp_path / "missing.npz")
    for arguments in (("--debug", "show", missing), ("show", missing, "--debug")):
        result = codegen(*arguments)
        assert "Traceback" in result.stderr
        assert result.returncode != 0
    assert "Traceback" not in codegen("show", missing).stderr
