"""--output of sil, hil and plant: the run in the formats of other tools, and what is refused before it runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from codegen.sil.software import RECORD_COLUMNS
from hil_sim.recording import load_csv

from .conftest import Run

BUILD = Path(__file__).resolve().parents[2] / "generated" / "4ws2"
DBC = BUILD / "ars.dbc"
SHORT = 'name = "short"\nbase = "step-steer"\nduration_s = 11.0\n'
Refused = Callable[..., str]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("short.toml").write_text(SHORT, encoding="utf-8")
    return tmp_path


def sil(*options: object) -> tuple[object, ...]:
    return ("sil", "--build", BUILD, "--scenario", "short.toml", *options)


def test_a_run_goes_out_in_every_format_at_once(run: Run, here: Path) -> None:
    asammdf, parquet = pytest.importorskip("asammdf"), pytest.importorskip("pyarrow.parquet")
    answer = run(*sil("-o", "run.mf4", "--output", "run.parquet", "-o", "run.csv", "--csv", "as-ever.csv"))
    assert answer.code == 0, answer
    names = ("as-ever.csv", "run.mf4", "run.parquet", "run.csv")
    told = [line for line in answer.out.splitlines() if line.startswith("recording: ")]
    assert told == [f"recording: {name}" for name in names]
    assert Path("run.csv").read_bytes() == Path("as-ever.csv").read_bytes()
    record, table = load_csv(Path("run.csv")), parquet.read_table("run.parquet")
    assert len(record) == 1100
    with asammdf.MDF("run.mf4") as signals:
        for number, name in enumerate(RECORD_COLUMNS):
            wanted = record[:, number]
            found = signals.get(name, raw=True).samples, table.column(name).to_numpy()
            assert all(one.astype(np.float64).tobytes() == wanted.tobytes() for one in found), name
        assert set(signals.get("status").samples.tolist()) <= {b"TRACKING", b"LIMITED", b"STANDBY"}


def test_a_run_on_a_bus_too(run: Run, here: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    options = ("--bus", "virtual:out", "--ecu", "cffi", "--lock-step", "--scenario", "short.toml", "--json")
    answer = run("hil", "--build", BUILD, *options, "-o", "run.parquet", "-o", "run.csv")
    assert answer.code == 0, answer
    table = parquet.read_table("run.parquet")
    assert table.column("yaw_rate_rad_s").to_numpy().tobytes() == load_csv(Path("run.csv"))[:, 3].tobytes()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("-o", "run.xlsx"), "run.xlsx: no format for a run; end its name in .mf4, .parquet, .csv; a picture goes to --plot"),
        (("-o", "run"), "run: no format for a run"),
        (("-o", "run.csv", "-o", "run.csv"), "run.csv: it would be written twice; name each file once"),
        (("-o", "run.csv", "-o", "./folder/../run.csv"), "run.csv: it would be written twice"),
        (("-o", "run.csv", "--csv", "run.csv"), "run.csv: it would be written twice"),
        (("-o", "link.csv", "-o", "linked.csv"), "linked.csv: it would be written twice"),
        (("-o", "missing/run.csv"), "missing/run.csv: its folder does not exist"),
        (("-o", "folder.csv"), "folder.csv: there is something that is not a file"),
        (("-o", "good.csv", "-o", BUILD / "run.csv"), "run.csv: it lies inside a build"),
        (("-o",), "requires an argument"),
    ],
)
def test_what_cannot_be_written_is_one_line(
    refused: Refused, here: Path, options: tuple[object, ...], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("folder", "folder.csv"):
        Path(folder).mkdir()
    Path("linked.csv").write_text("", encoding="ascii")
    Path("link.csv").symlink_to("linked.csv")
    monkeypatch.setattr("hil_sim.runs.run", _must_not_run)
    assert told in refused(*sil(*options))


def _must_not_run(*arguments: object, **named: object) -> None:
    raise AssertionError("it ran")


@pytest.mark.parametrize(("package", "name"), [("asammdf", "run.mf4"), ("pyarrow", "run.parquet")])
def test_a_missing_package_is_told_before_the_run(
    refused: Refused, here: Path, monkeypatch: pytest.MonkeyPatch, package: str, name: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr("hil_sim.runs.run", _must_not_run)
    line = refused(*sil("-o", name))
    assert f'{name}: {package}, which writes {Path(name).suffix}, is missing; pip install "ars-codegen[tools]"' in line


def test_a_log_and_a_run_are_two_files(refused: Refused, here: Path) -> None:
    pytest.importorskip("asammdf")
    options = ("--bus", "virtual:nobody-at-all", "--lock-step", "--log", "run.mf4", "-o", "run.mf4")
    assert "run.mf4: it would be written twice" in refused("plant", *options)


@pytest.mark.parametrize("option", ["-o", "--csv"])
@pytest.mark.parametrize("through_a_link", [False, True])
def test_a_recorded_drive_is_not_overwritten(run: Run, refused: Refused, here: Path, option: str, through_a_link: bool) -> None:
    assert run(*sil("-o", "drive.csv")).code == 0
    Path("link.csv").symlink_to("drive.csv")
    target = "link.csv" if through_a_link else "drive.csv"
    for command in (("sil", "--build", BUILD), ("plant", "--bus", "virtual:nobody-writes", "--lock-step")):
        line = refused(*command, "--scenario", "drive.csv", option, target)
        assert f"{target}: it is what this command reads" in line


def test_a_suite_has_one_folder(refused: Refused, here: Path) -> None:
    assert "two: a second folder for the pictures; name one" in refused("sil", "--suite", "tracking", "-o", "one", "-o", "two")


def test_a_log_of_the_bus_is_decoded_by_the_dbc(run: Run, here: Path) -> None:
    """What docs/runs.md says of --log and asammdf, with the values of the run."""
    asammdf = pytest.importorskip("asammdf")
    options = ("--bus", "virtual:decoded", "--ecu", "cffi", "--lock-step", "--scenario", "short.toml", "--json")
    assert run("hil", "--build", BUILD, *options, "--log", "bus.mf4", "-o", "run.csv").code == 0
    record = load_csv(Path("run.csv"))
    with asammdf.MDF("bus.mf4") as log, log.extract_bus_logging({"CAN": [(DBC, 0)]}) as signals:
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


def test_json_names_the_files_that_were_written(run: Run, here: Path) -> None:
    outputs = ("--plot", "run.png", "--csv", "as-ever.csv", "-o", "run.csv")
    answer = run(*sil(*outputs, "--json"))
    assert answer.code == 0, answer
    assert json.loads(answer.out)["files"] == {"plot": ["run.png"], "recording": ["as-ever.csv", "run.csv"]}
    assert answer.err == ""
    bus = ("--bus", "virtual:files", "--ecu", "cffi", "--lock-step", "--scenario", "short.toml")
    answer = run("hil", "--build", BUILD, *bus, "--log", "run.asc", "--json")
    assert answer.code == 0, answer
    assert json.loads(answer.out)["files"] == {"log": ["run.asc"]}
    assert json.loads(run(*sil("--json")).out)["files"] == {}
