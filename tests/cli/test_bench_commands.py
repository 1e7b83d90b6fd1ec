"""hil, ecu, plant, faults, scenarios and sil --can, and the files of runs."""

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import can
import pytest
from pyarrow import parquet

from hil_sim.logs import load_csv

from .conftest import BUILD, MAIN, ROOT, TRACKING, Run, program

HIL = ("hil", "--build", BUILD, "--bus", "virtual:hil", "--ecu", "cffi", "--lock-step", "--scenario", "short.toml")


@pytest.fixture
def short(here: Path) -> Path:
    """Write a scenario of 1100 cycles to the current folder."""
    Path("short.toml").write_text('name = "short"\nbase = "step-steer"\nduration_s = 11.0\n', encoding="utf-8")
    return Path("short.toml")


def test_hil_prints_its_figures_and_writes_every_file(run: Run, short: Path) -> None:
    answer = run(*HIL, "--plot", "run.png", "--csv", "run.csv", "--log", "run.blf")
    assert (answer.code, answer.err) == (0, ""), answer  # no view without a terminal
    figures = ("yaw rate, steady [deg/s]", "controlled", "passive", "bus: 1100 cycles, 11 s in", "commands: 1100, 0 gaps")
    assert [words for words in figures if words not in answer.out] == []
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")
    with can.LogReader("run.blf") as log:
        assert sum(1 for _ in log) == 3300
    data = json.loads(run(*HIL, "--log", "bus.mf4", "-o", "run.parquet", "--json").out)
    assert (data["clock"], data["files"]) == ("lock-step", {"log": ["bus.mf4"], "recording": ["run.parquet"]})
    record = load_csv(Path("run.csv"))
    assert parquet.read_table("run.parquet").column("yaw_rate_rad_s").to_pylist() == record[:, 3].tolist()


def test_sil_through_can_with_faults_and_sensors(run: Run, here: Path) -> None:
    options = ("sil", "--build", BUILD, "--can", "--sensors", "--scenario", "ecu-loss", "--json")
    one, other = (json.loads(run(*options, "--seed", seed).out) for seed in (3, 4))
    assert one["bus_figures"]["cycles_in_status"]["DEGRADED"] == 2 + 3  # until the messages are valid, and during the loss
    assert one["metrics"] != other["metrics"]


def test_sil_with_the_third_plant(run: Run, here: Path) -> None:
    options = ("sil", "--build", BUILD, "--plant", "roll", "--scenario", "step-steer", "--json")
    one, other = (json.loads(run(*options, "--seed", seed).out)["metrics"] for seed in (3, 4))
    assert one["controlled"] != other["controlled"] and one["passive"] == other["passive"]
    answer = run(*options, "--can")
    message = "error: --plant: runs through CAN frames support only the two-track car; leave --can out"
    assert (answer.code, answer.err) == (2, f"{message}\n")


def test_faults_prints_a_table_of_defined_outcomes(run: Run) -> None:
    answer = run("faults", "--build", TRACKING)
    assert answer.code == 0, answer
    lines = answer.out.splitlines()
    assert any(line.startswith("50 samples lost") and "FAIL_SAFE" in line and "30 ms" in line for line in lines)
    assert not any("defined is" in line for line in lines)


def test_an_ecu_in_its_own_process(run: Run, short: Path) -> None:
    """UDP multicast connects processes without CAN."""
    address = f"udp_multicast:239.74.164.{2 + os.getpid() % 250}"
    command = program(MAIN, "ecu", "--build", BUILD, "--bus", address, "--lock-step")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n", process.communicate()
    answer = run("plant", "--bus", address, "--lock-step", "--scenario", short)
    assert (answer.code, answer.err) == (0, "note: no --config: using the paper's preset\n"), answer
    assert "commands: 1100, 0 gaps" in answer.out
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate()
    assert process.returncode == 0
    assert said.startswith("cycles=1100 ")


def test_an_ecu_ends_with_the_process_that_started_it(run: Run) -> None:
    answer = run("ecu", "--build", BUILD, "--bus", "virtual:alone", "--parent", os.getpid())  # no process is its own parent
    assert (answer.code, answer.out) == (0, "ready\n")


def test_notes_of_a_run(run: Run, short: Path) -> None:
    Path("brief.csv").write_text("time_s,speed_m_s,front_angle_rad\n0,10,0\n0.3,10,0\n", encoding="utf-8")
    answer = run("plant", "--bus", "virtual:nobody", "--scenario", "brief.csv")
    assert answer.code == 0, answer
    assert "no ECU sent a command" in answer.err
    assert "FAIL_SAFE" in answer.out
    shutil.copytree(BUILD, "edited")
    with Path("edited/CMakeLists.txt").open("a", encoding="utf-8") as file:  # not C, so nothing is recompiled
        file.write("# by hand\n")
    answer = run("sil", "--scenario", short, "--build", "edited")
    assert answer.code == 0
    assert "CMakeLists.txt was changed after the build" in answer.err


def test_a_run_in_every_format_at_once(run: Run, short: Path) -> None:
    sil, names = ("sil", "--build", BUILD, "--scenario", short, "--plot", "run.png"), ["as-ever.csv", "run.mf4", "run.parquet"]
    answer = run(*sil, "-o", "run.mf4", "--output", "run.parquet", "-o", "run.csv", "--csv", "as-ever.csv", "--json")
    assert answer.code == 0, answer
    assert json.loads(answer.out)["files"] == {"plot": ["run.png"], "recording": [*names, "run.csv"]}
    assert Path("run.csv").read_bytes() == Path("as-ever.csv").read_bytes()
    assert len(load_csv(Path("run.csv"))) == 1100
    assert "recording: again.csv" in run("sil", "--build", BUILD, "--scenario", short, "--csv", "again.csv").out.splitlines()


def test_scenarios_are_listed(run: Run) -> None:
    plain, data = run("scenarios").out, json.loads(run("scenarios", "--json").out)
    assert [each["name"] for each in data][:2] == ["step-steer", "ramp-steer"] and all(each["what"] in plain for each in data)
