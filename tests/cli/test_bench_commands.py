"""hil, ecu, plant, faults, scenarios and sil --can at the command line."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from codegen.sil.software import RECORD_COLUMNS
from hil_sim.scenarios import SCENARIOS

from .conftest import Run, everything_in

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "generated" / "4ws2"
SHORT = """\
name = "short"
base = "step-steer"
duration_s = 11.0
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("short.toml").write_text(SHORT, encoding="utf-8")
    return tmp_path


@pytest.fixture
def bus(request: pytest.FixtureRequest) -> str:
    return f"virtual:{request.node.name}"


def test_hil_writes_plot_recording_and_log_and_tells(run: Run, here: Path, bus: str) -> None:
    outputs = ("--plot", "run.png", "--csv", "run.csv", "--log", "run.blf")
    answer = run("hil", "--build", BUILD, "--bus", bus, "--ecu", "cffi", "--lock-step", "--scenario", "short.toml", *outputs)
    assert answer.code == 0, answer
    for words in (
        "yaw rate, steady [deg/s]",
        "controlled",
        "passive",
        "bus: 1100 cycles, 11 s in",
        "commands: 1100, 0 gaps",
        "cycles=1100 ",
    ):
        assert words in answer.out
    assert answer.err == ""  # no view where there is no terminal
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")
    assert len(Path("run.csv").read_text(encoding="ascii").splitlines()) == 1101
    with can.LogReader("run.blf") as log:
        assert sum(1 for _ in log) == 3300


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_equal_runs_in_lock_step_give_equal_logs(run: Run, here: Path, bus: str, suffix: str) -> None:
    for name in ("one", "other"):
        command = ("hil", "--build", BUILD, "--bus", bus, "--ecu", "cffi", "--lock-step", "--scenario", "short.toml")
        assert run(*command, "--log", f"{name}{suffix}").code == 0
    assert Path(f"one{suffix}").read_bytes() == Path(f"other{suffix}").read_bytes()


def test_hil_as_json(run: Run, here: Path, bus: str) -> None:
    answer = run(*("hil", "--build", BUILD, "--bus", bus, "--ecu", "cffi", "--lock-step", "--scenario", "short.toml", "--json"))
    told = json.loads(answer.out)
    assert told["clock"] == "lock-step"
    assert told["bus_figures"]["commands"] == told["bus_figures"]["cycles"] == 1100
    assert told["bus_figures"]["times"] is None
    assert set(told["metrics"]) == {"controlled", "passive"}


def test_hil_in_real_time_tells_times(run: Run, here: Path, bus: str) -> None:
    Path("quick.toml").write_text('name = "quick"\nbase = "ecu-loss"\nduration_s = 10.2\n', encoding="utf-8")
    answer = run("hil", "--build", BUILD, "--bus", bus, "--ecu", "cffi", "--scenario", "quick.toml", "--json")
    assert answer.code == 0, answer
    figures = json.loads(answer.out)["bus_figures"]
    assert figures["cycles"] == 1020
    assert figures["times"]["response_median_ms"] > 0.0
    assert figures["cycles_in_status"]["FAIL_SAFE"] > 0  # the second without an ECU


def test_sil_through_can_takes_faults_and_sensors(run: Run, here: Path) -> None:
    answer = run("sil", "--build", BUILD, "--can", "--sensors", "--seed", "3", "--scenario", "ecu-loss", "--json")
    assert json.loads(answer.out)["bus_figures"]["cycles_in_status"]["DEGRADED"] == 3
    one, other = (run("sil", "--build", BUILD, "--can", "--sensors", "--seed", seed).out for seed in ("3", "4"))
    assert one != other


@pytest.mark.parametrize("build", ["4ws2", "4ws2-tracking"])
def test_faults_are_a_table_and_as_defined(run: Run, here: Path, build: str) -> None:
    answer = run("faults", "--build", BUILD.parent / build)
    assert answer.code == 0, answer
    lines = answer.out.splitlines()
    assert " ".join(lines[0].split()) == (
        "injected reached fail-safe after |rear angle| up to its rate up to command step back after as defined seen"
    )
    assert any(line.startswith("50 samples lost") and "FAIL_SAFE" in line and "30 ms" in line for line in lines)
    assert not any("defined is" in line for line in lines)
    assert json.loads(run("faults", "--build", BUILD, "--json").out)["faults"][0]["name"] == "drop-1"


def test_scenarios_are_listed(run: Run) -> None:
    told = run("scenarios").out
    for name, scenario in SCENARIOS.items():
        assert f"\n{name}: " in f"\n{told}"
        assert scenario.source in told
    assert [entry["name"] for entry in json.loads(run("scenarios", "--json").out)] == list(SCENARIOS)


class TestEcuAndPlantInTwoTerminals:
    """Processes of their own over UDP multicast, which crosses processes without any CAN."""

    @pytest.fixture
    def address(self) -> str:
        return f"udp_multicast:239.74.164.{2 + os.getpid() % 250}"

    @pytest.fixture
    def ecu(self, address: str) -> Callable[..., subprocess.Popen[str]]:
        def start(*options: str) -> subprocess.Popen[str]:
            command = [sys.executable, "-m", "codegen", "ecu", "--build", str(BUILD), "--bus", address, *options]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n", process.communicate()
            return process

        return start

    def test_they_meet(self, run: Run, here: Path, address: str, ecu: Callable[..., subprocess.Popen[str]]) -> None:
        process = ecu("--lock-step")
        answer = run("plant", "--bus", address, "--lock-step", "--scenario", "short.toml")
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate()
        assert answer.code == 0, answer
        assert answer.err == "note: no --config: the paper's preset is taken\n"
        assert "commands: 1100, 0 gaps" in answer.out
        assert process.returncode == 0
        assert "cycles=1100 " in said

    def test_ctrl_c_ends_the_ecu_in_order(self, ecu: Callable[..., subprocess.Popen[str]]) -> None:
        process = ecu()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate()
        assert process.returncode == 0
        assert said.startswith("cycles=")

    def test_an_ecu_does_not_outlive_its_bench(self, ecu: Callable[..., subprocess.Popen[str]]) -> None:
        process = ecu("--parent", "1")  # not this process
        _, said = process.communicate()
        assert process.returncode == 0
        assert said.startswith("cycles=")


class TestBadInput:
    """Exit code 2, one line, nothing on disk."""

    HIL = ("hil", "--build", BUILD, "--ecu", "cffi")

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ((*HIL, "--bus", "vcan0"), "'vcan0' is not INTERFACE:CHANNEL"),
            ((*HIL, "--bus", "socketkan:vcan0"), "python-can has no interface 'socketkan'"),
            ((*HIL, "--bus", "virtual:x", "--scenario", "step-ster"), "did you mean 'step-steer'?"),
            ((*HIL, "--bus", "virtual:x", "--scenario", "missing.toml"), "missing.toml"),
            ((*HIL, "--bus", "virtual:x", "--log", "run.txt"), ".blf, .asc, .log, .mf4"),
            ((*HIL, "--bus", "virtual:x", "--log", "nowhere/run.blf"), "its folder does not exist"),
            ((*HIL, "--bus", "virtual:x", "--plot", "run.pdf"), "only .png is written"),
            ((*HIL, "--bus", "virtual:x", "--lock-step", "--scenario", "ecu-loss"), "take --real-time"),
            ((*HIL, "--bus", "virtual:x", "--seed", "-1"), "seed"),
            (("hil", "--build", BUILD, "--bus", "virtual:x", "--ecu", "native"), "the native ECU speaks SocketCAN"),
            (("hil", "--build", BUILD, "--bus", "virtual:x", "--ecu", "external", "--lock-step"), "a clock of its own"),
            (("hil", "--build", BUILD, "--bus", "virtual:x"), "Missing option '--ecu'"),
            (("hil", "--build", "nowhere", "--bus", "virtual:x", "--ecu", "cffi"), "nowhere"),
            (("ecu", "--build", BUILD, "--bus", "virtual"), "is not INTERFACE:CHANNEL"),
            (("ecu", "--build", BUILD, "--bus", "virtual:x", "--ecu", "native"), "the native ECU speaks SocketCAN"),
            (("plant", "--bus", "virtual:x", "--config", "missing.toml"), "missing.toml"),
            (("sil", "--build", BUILD, "--sensors"), "add --can"),
            (("sil", "--build", BUILD, "--scenario", "ecu-loss"), "codegen hil"),
            (("faults", "--build", "nowhere"), "nowhere"),
            (("faults", "--build", BUILD, "--ecu", "native"), "add --bus"),
            (("plant", "--json", "--bus", "virtual:x", "--scenario", "ecu-loss"), "cannot be switched off from here"),
        ],
    )
    def test_one_line(self, refused: Callable[..., str], arguments: tuple[object, ...], words: str) -> None:
        assert words in refused(*arguments)

    def test_a_run_without_an_answer_leaves_nothing_behind(self, run: Run, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        from hil_sim import bench

        monkeypatch.setattr(bench, "ANSWER_TIMEOUT", 0.01)
        before = everything_in(here)
        answer = run("plant", "--bus", "virtual:nobody", "--lock-step", "--csv", "run.csv", "--plot", "run.png")
        assert answer.code == 2
        assert "no answer to the frames of 0.00 s" in answer.err
        assert everything_in(here) == before


def test_a_build_without_a_can_side_is_told(refused: Callable[..., str], tmp_path: Path) -> None:
    """As an older version made it."""
    old = tmp_path / "old"
    shutil.copytree(BUILD, old)
    manifest = json.loads((old / "manifest.json").read_text(encoding="ascii"))
    for path in list(manifest["files"]):
        if any(part in path for part in ("_can.", "_e2e.", "_task.", ".dbc", "linux/")):
            (old / path).unlink()
            del manifest["files"][path]
    (old / "manifest.json").write_text(json.dumps(manifest), encoding="ascii")
    for command in (("sil",), ("hil", "--bus", "virtual:x", "--ecu", "cffi"), ("faults",)):
        assert "build it again" in refused(*command, "--build", "old")


def test_edited_c_is_noted(run: Run, here: Path, bus: str) -> None:
    shutil.copytree(BUILD, "edited")
    source = Path("edited/src/ars_task.c")
    source.write_text(source.read_text(encoding="ascii") + "/* by hand */\n", encoding="ascii")
    answer = run("hil", "--build", "edited", "--bus", bus, "--ecu", "cffi", "--lock-step", "--scenario", "short.toml")
    assert answer.code == 0
    assert "src/ars_task.c was changed after the build" in answer.err


def test_a_run_that_nobody_answers_says_so(run: Run, here: Path, bus: str) -> None:
    Path("brief.csv").write_text("time_s,speed_m_s,front_angle_rad\n0,10,0\n0.3,10,0\n", encoding="utf-8")
    answer = run("plant", "--bus", bus, "--scenario", "brief.csv")
    assert answer.code == 0, answer
    assert "no command came from any ECU" in answer.err
    assert "FAIL_SAFE" in answer.out


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_run_that_is_ended_keeps_its_log_and_leaves_no_ecu(here: Path, number: signal.Signals) -> None:
    script = (
        "import os, signal, sys\n"
        "from hil_sim import bench\n"
        "from codegen import cli\n"
        "for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP): signal.signal(each, signal.SIG_DFL)\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "close = bench._Recorder.close_cycle\n"
        "def ending(recorder, cycle, *more):\n"
        "    close(recorder, cycle, *more)\n"
        f"    if cycle == 50: os.kill(os.getpid(), {int(number)})\n"
        "bench._Recorder.close_cycle = ending\n"
        "sys.argv[0] = 'codegen'\n"
        "cli.main()\n"
    )
    arguments = ["hil", "--build", str(BUILD), "--bus", "virtual:x", "--ecu", "cffi", "--lock-step", "--log", "run.asc"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, env=environment, check=False
    )
    assert ended.returncode == (130 if number == signal.SIGINT else 128 + number), ended
    with can.LogReader("run.asc") as log:
        assert sum(1 for _ in log) >= 3 * 51
    assert {path.name for path in here.iterdir()} == {"run.asc", "short.toml"}


def test_a_recorded_run_can_be_driven_again(run: Run, here: Path) -> None:
    assert run("sil", "--build", BUILD, "--csv", "run.csv").code == 0
    answer = run("sil", "--build", BUILD, "--can", "--scenario", "run.csv", "--csv", "again.csv")
    assert answer.code == 0, answer
    assert Path("again.csv").read_text(encoding="ascii").splitlines()[0] == ",".join(RECORD_COLUMNS)
