"""hil, ecu, plant, faults, scenarios and sil --can, and the files that runs are written to."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import asammdf
import can
import numpy as np
import pytest
from pyarrow import parquet

from codegen.sil.software import RECORD_COLUMNS
from hil_sim.recording import load_csv
from hil_sim.scenarios import SCENARIOS

from .conftest import BUILD, MAIN, ROOT, TRACKING, Run, program

SHORT = 'name = "short"\nbase = "step-steer"\nduration_s = 11.0\n'


@pytest.fixture
def short(here: Path) -> Path:
    """A scenario of 1100 cycles in the current folder."""
    Path("short.toml").write_text(SHORT, encoding="utf-8")
    return Path("short.toml")


@pytest.fixture
def hil(request: pytest.FixtureRequest) -> tuple[object, ...]:
    bus = f"virtual:{request.node.name}"
    return ("hil", "--build", BUILD, "--bus", bus, "--ecu", "cffi", "--lock-step", "--scenario", "short.toml")


def test_hil_prints_its_figures_and_writes_every_file(run: Run, short: Path, hil: tuple[object, ...]) -> None:
    outputs = ("--plot", "run.png", "--csv", "run.csv", "--log", "run.blf")
    answer = run(*hil, *outputs)
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
    assert answer.err == ""  # no view without a terminal
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")
    assert len(Path("run.csv").read_text(encoding="ascii").splitlines()) == 1101
    with can.LogReader("run.blf") as log:
        assert sum(1 for _ in log) == 3300
    first = Path("run.blf").read_bytes()
    again = run(*hil, "--log", "run.blf", "-o", "run.parquet", "--json")
    assert Path("run.blf").read_bytes() == first
    data = json.loads(again.out)
    assert data["clock"] == "lock-step"
    assert data["bus_figures"]["commands"] == data["bus_figures"]["cycles"] == 1100
    assert data["bus_figures"]["times"] is None
    assert set(data["metrics"]) == {"controlled", "passive"}
    assert data["files"] == {"log": ["run.blf"], "recording": ["run.parquet"]}
    assert parquet.read_table("run.parquet").column("yaw_rate_rad_s").to_pylist() == load_csv(Path("run.csv"))[:, 3].tolist()


def test_sil_through_can_with_faults_and_sensors(run: Run, here: Path) -> None:
    options = ("sil", "--build", BUILD, "--can", "--sensors", "--scenario", "ecu-loss", "--json")
    one, other = (json.loads(run(*options, "--seed", seed).out) for seed in (3, 4))
    assert one["bus_figures"]["cycles_in_status"]["DEGRADED"] == 3
    assert one["metrics"] != other["metrics"]


def test_faults_are_a_table_and_as_defined(run: Run) -> None:
    answer = run("faults", "--build", TRACKING)
    assert answer.code == 0, answer
    lines = answer.out.splitlines()
    assert " ".join(lines[0].split()) == (
        "injected reached fail-safe after |rear angle| up to its rate up to command step back after as defined seen"
    )
    assert any(line.startswith("50 samples lost") and "FAIL_SAFE" in line and "30 ms" in line for line in lines)
    assert not any("defined is" in line for line in lines)
    assert json.loads(run("faults", "--build", BUILD, "--json").out)["faults"][0]["name"] == "drop-1"


def test_scenarios_are_listed(run: Run) -> None:
    data = run("scenarios").out
    for name, scenario in SCENARIOS.items():
        assert f"\n{name}: " in f"\n{data}"
        assert scenario.source in data
    assert [entry["name"] for entry in json.loads(run("scenarios", "--json").out)] == list(SCENARIOS)


@pytest.mark.parametrize(
    ("options", "number"), [(("--lock-step",), signal.SIGTERM), ((), signal.SIGINT), (("--parent", "1"), None)]
)
def test_an_ecu_in_a_process_of_its_own(run: Run, short: Path, options: tuple[str, ...], number: signal.Signals | None) -> None:
    """UDP multicast crosses processes without any CAN. With the parent process gone (1 is not this one), it ends by itself."""
    address = f"udp_multicast:239.74.164.{2 + os.getpid() % 250}"
    command = program(MAIN, "ecu", "--build", BUILD, "--bus", address, *options)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n", process.communicate()
    if "--lock-step" in options:
        answer = run("plant", "--bus", address, "--lock-step", "--scenario", short)
        assert answer.code == 0, answer
        assert answer.err == "note: no --config: the paper's preset is taken\n"
        assert "commands: 1100, 0 gaps" in answer.out
    if number is not None:
        process.send_signal(number)
    _, said = process.communicate()
    assert process.returncode == 0
    assert said.startswith("cycles=1100 " if "--lock-step" in options else "cycles=")


def test_notes_of_a_run(run: Run, short: Path, hil: tuple[object, ...]) -> None:
    Path("brief.csv").write_text("time_s,speed_m_s,front_angle_rad\n0,10,0\n0.3,10,0\n", encoding="utf-8")
    answer = run("plant", "--bus", "virtual:nobody", "--scenario", "brief.csv")
    assert answer.code == 0, answer
    assert "no command came from any ECU" in answer.err
    assert "FAIL_SAFE" in answer.out
    shutil.copytree(BUILD, "edited")
    with Path("edited/CMakeLists.txt").open("a", encoding="utf-8") as file:  # no C, so nothing is compiled again
        file.write("# by hand\n")
    answer = run(*hil, "--build", "edited")
    assert answer.code == 0
    assert "CMakeLists.txt was changed after the build" in answer.err


def test_a_run_in_every_format_at_once(run: Run, short: Path) -> None:
    sil = ("sil", "--build", BUILD, "--scenario", short)
    names = ["as-ever.csv", "run.mf4", "run.parquet", "run.csv"]
    answer = run(*sil, "-o", "run.mf4", "--output", "run.parquet", "-o", "run.csv", "--csv", "as-ever.csv", "--plot", "run.png")
    assert answer.code == 0, answer
    assert [line for line in answer.out.splitlines() if line.startswith("recording: ")] == [
        f"recording: {name}" for name in names
    ]
    assert Path("run.csv").read_bytes() == Path("as-ever.csv").read_bytes()
    record, table = load_csv(Path("run.csv")), parquet.read_table("run.parquet")
    assert len(record) == 1100
    with asammdf.MDF("run.mf4") as signals:
        for number, name in enumerate(RECORD_COLUMNS):
            wanted = record[:, number]
            found = signals.get(name, raw=True).samples, table.column(name).to_numpy()
            assert all(one.astype(np.float64).tobytes() == wanted.tobytes() for one in found), name
        assert set(signals.get("status").samples.tolist()) <= {b"TRACKING", b"LIMITED", b"STANDBY"}
    data = json.loads(run(*sil, "--plot", "run.png", "--csv", "a.csv", "-o", "b.csv", "--json").out)
    assert data["files"] == {"plot": ["run.png"], "recording": ["a.csv", "b.csv"]}
    driven_again = run("sil", "--build", BUILD, "--can", "--scenario", "run.csv", "--csv", "again.csv")
    assert driven_again.code == 0, driven_again
    assert Path("again.csv").read_text(encoding="ascii").splitlines()[0] == ",".join(RECORD_COLUMNS)


def test_a_log_of_the_bus_is_decoded_by_the_dbc(run: Run, short: Path, hil: tuple[object, ...]) -> None:
    """Check the use of --log and asammdf in docs/runs.md against the values of the run."""
    assert run(*hil, "--log", "bus.mf4", "-o", "run.csv").code == 0
    record = load_csv(Path("run.csv"))
    with asammdf.MDF("bus.mf4") as log, log.extract_bus_logging({"CAN": [(BUILD / "ars.dbc", 0)]}) as signals:
        for name, unit, column, resolution in (
            ("Speed", "m/s", "speed_m_s", 0.005),
            ("YawRate", "rad/s", "yaw_rate_rad_s", 2e-4),
            ("RearAngle", "rad", "rear_angle_rad", 5e-5),
            ("RearAngleCommand", "rad", "rear_angle_command_rad", 5e-5),
        ):
            one = signals.get(name)
            assert one.unit == unit
            wanted = record[:, RECORD_COLUMNS.index(column)]
            # Half a step of the signal, and the rounding of its decoding.
            np.testing.assert_allclose(one.samples, wanted, rtol=0.0, atol=0.5 * resolution + 1e-12)
        assert {bytes(text) for text in signals.get("Status").samples} <= {b"TRACKING", b"LIMITED", b"STANDBY"}
