"""`codegen identify --check`: what it prints, and one line for whatever cannot be read."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from codegen.identify.reading import read_drives
from tests.cli.conftest import Refused, Run
from tests.identify.made import frames, write_bus, write_mf4


def test_check_prints_signals_findings_and_a_names_toml(run: Run, tmp_path: Path) -> None:
    write_mf4(tmp_path / "one.mf4")
    lost = [frame for frame in frames() if not (frame.arbitration_id == 290 and 3.0 < frame.timestamp - 1.7e9 < 3.5)]
    write_bus(tmp_path / "two.blf", lost)
    logs = ("--log", tmp_path / "one.mf4", "--log", tmp_path / "two.blf", "--dbc", tmp_path / "car.dbc")
    answer = run("identify", *logs, "--check")
    assert (answer.code, answer.err) == (0, "")
    assert "one    vx                    ESP.VehicleSpeed             km/h" in answer.out
    assert "a gap of 0.52 s at 2.980 s, where 0.02 s are normal" in answer.out
    text = answer.out.rpartition("names.toml of these signals:")[2]
    (tmp_path / "names.toml").write_text(text, encoding="utf-8")
    told = run("identify", "--log", tmp_path / "one.mf4", "--signals", tmp_path / "names.toml", "--check", "--json")
    found = json.loads(told.out)
    assert found["drives"][0]["signals"]["vx"] == {
        "channel": "ESP.VehicleSpeed",
        "unit": "km/h",
        "is_given": True,
        "period": pytest.approx(0.005),
        "samples": 1600,
        "share": 0.9875,  # the filter has no value in the first and last 5 steps
    }
    assert found["findings"] == []


def test_a_frozen_signal_is_reported_as_json_too(run: Run, tmp_path: Path) -> None:
    time = np.arange(0.0, 8.0, 0.01)
    wave = np.sin(np.pi * time)
    table = {"time_s": time, "vx_m_s": np.full(time.size, 20.0), "yaw_rate_rad_s": 0.1 * np.where(time < 4.0, wave, 0.0)}
    pd.DataFrame({**table, "delta_f_rad": 0.02 * wave}).to_csv(tmp_path / "drive.csv", index=False)
    found = json.loads(run("identify", "--log", tmp_path / "drive.csv", "--check", "--json").out)
    assert [(each["kind"], each["lost"]) for each in found["findings"]] == [("frozen", 400)]


def test_the_library_and_the_command_agree(run: Run, tmp_path: Path) -> None:
    path = write_bus(tmp_path / "drive.log", frames())
    reading = read_drives([path], [tmp_path / "car.dbc"])
    told = json.loads(run("identify", "--log", path, "--dbc", tmp_path / "car.dbc", "--check", "--json").out)
    assert told["drives"][0]["duration_s"] == reading.drives[0].time[-1]


def test_what_cannot_be_read_is_rejected_in_one_line(refused: Refused, tmp_path: Path) -> None:
    write_bus(tmp_path / "drive.blf", frames(duration=1.0))
    (tmp_path / "other.dbc").write_text(
        'VERSION ""\nBU_: A\nBO_ 5 Other: 8 A\n SG_ X : 0|8@1+ (1,0) [0|1] "" A\n', encoding="ascii"
    )
    (tmp_path / "empty.csv").write_text("", encoding="ascii")
    (tmp_path / "text.blf").write_text("this is no log", encoding="ascii")
    (tmp_path / "text.dbc").write_text("BO_ x", encoding="ascii")
    (tmp_path / "text.mf4").write_text("this is no log", encoding="ascii")
    (tmp_path / "text.parquet").write_text("this is no log", encoding="ascii")
    (tmp_path / "folder.blf").mkdir()
    time = np.arange(3.0)
    pd.DataFrame({"vx_m_s": time, "yaw_rate_rad_s": time, "delta_f_rad": time}).to_csv(tmp_path / "clockless.csv", index=False)
    pd.DataFrame({"time": [0.0], "vx_m_s": [1.0], "yaw_rate_rad_s": [0.0], "delta_f_rad": [0.0]}).to_csv(
        "short.csv", index=False
    )
    text = {"time": time, "vx_m_s": ["fast"] * 3, "yaw_rate_rad_s": time, "delta_f_rad": time}
    pd.DataFrame(text).to_parquet("words.parquet")
    for arguments, message in (
        (("drive.blf",), "the log of a bus needs its database; give the DBC or ARXML with --dbc"),
        (("drive.blf", "--dbc", "other.dbc"), "none of its"),
        (("drive.blf", "--dbc", "text.dbc"), "text.dbc: not a readable database of a CAN bus"),
        (("drive.blf", "--dbc", "missing.dbc"), "missing.dbc: cannot be read"),
        (("drive.blf", "--dbc", "drive.blf"), "not a database of a bus"),
        (("drive.blf", "--dbc", "car.dbc", "--log", "drive.blf"), "given twice"),
        (("drive.blf", "--dbc", "car.dbc", "--signals", "missing.toml"), "missing.toml: cannot be read"),
        (("text.blf", "--dbc", "car.dbc"), "text.blf: not a readable log of a CAN bus"),
        (("folder.blf", "--dbc", "car.dbc"), "folder.blf: not a file"),
        (("empty.csv",), "empty.csv: empty"),
        (("text.mf4",), "text.mf4: not a readable MF4 file"),
        (("text.parquet",), "text.parquet: not a readable Parquet file"),
        (("clockless.csv",), 'no column is called time; name it in a file for --signals: time = "NAME"; there is vx_m_s'),
        (("short.csv",), "1 samples for vx"),
        (("words.parquet",), "words.parquet: not a readable Parquet file"),
        (("drive.txt.gz",), "not a log; give .mf4"),
        (("missing.csv",), "missing.csv: cannot be read"),
    ):
        assert message in refused("identify", "--check", "--log", *arguments)


@pytest.mark.parametrize(("option", "name"), [("--output", "new.toml"), ("--report", "page.html")])
def test_a_check_rejects_files_that_it_would_not_write(refused: Refused, option: str, name: str) -> None:
    told = refused("identify", "--check", "--log", "drive.csv", option, name)
    assert f"codegen identify {option}: it cannot be combined with --check, which writes no file; leave one out" in told


def test_two_databases_that_differ_in_an_identifier_are_rejected_if_it_is_needed(refused: Refused, tmp_path: Path) -> None:
    write_bus(tmp_path / "drive.blf", frames(duration=1.0))
    text = (tmp_path / "car.dbc").read_text(encoding="ascii")
    logs = ("--log", "drive.blf", "--dbc", "car.dbc", "--dbc", "second.dbc")
    for old, new, message in (
        ("(0.001,0)", "(0.002,0)", "several signals may be vx"),
        ("Motion: 8", "Other: 8", "the identifier 0x120 is in Motion (car.dbc) and Other (second.dbc)"),
    ):
        (tmp_path / "second.dbc").write_text(text.replace(old, new), encoding="ascii")
        assert message in refused("identify", "--check", *logs)
