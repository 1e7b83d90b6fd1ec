"""`codegen log`."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.identify.made import frames, write_bus


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_it_accounts_for_every_frame(run: Run, tmp_path: Path) -> None:
    write_bus(tmp_path / "drive.blf", frames(duration=1.0))
    plain = run("log", "drive.blf", "--dbc", "car.dbc")
    assert plain.code == 0 and "frames: 250 in the file, 250 read, 0 skipped" in plain.out
    assert plain.out.rstrip().endswith("no findings")
    answer = run("log", "drive.blf", "--dbc", "car.dbc", "--json")
    facts = json.loads(answer.out)
    assert facts["frames"] == {"in_file": 250, "read": 250, "skipped": [], "other_entries": {}}
    assert {row["messages"][0]: row["used"] for row in facts["identifiers"]} == {"Motion": 100, "Steering": 100, "Rear": 50}


def test_the_channel_is_chosen(run: Run, tmp_path: Path) -> None:
    lines = [f"({1 + 0.01 * k:.6f}) can{k % 2} 120#{k:016X}\n" for k in range(100)]
    (tmp_path / "drive.log").write_text("".join(lines), encoding="ascii")
    write_bus(tmp_path / "other.blf", frames(duration=1.0))
    text = run("log", "drive.log", "--dbc", "car.dbc").out
    assert "choose a bus with --channel can0 or can1" in text
    facts = json.loads(run("log", "drive.log", "--dbc", "car.dbc", "--channel", "can1", "--json").out)
    assert [row.get("used", 0) for row in facts["channels"]] == [0, 50]
    answer = run("log", "drive.log", "--channel", "can3")
    assert answer.code == 2 and "the log has no channel 'can3'" in answer.err


def test_it_accounts_for_every_row(run: Run, tmp_path: Path) -> None:
    (tmp_path / "drive.csv").write_text("when,vx\n0,20\n10,\n20,21\n", encoding="ascii")
    (tmp_path / "names.toml").write_text('time = "when"\ntime_unit = "ms"\n', encoding="ascii")
    plain = run("log", "drive.csv", "--signals", "names.toml")
    assert plain.code == 0 and "rows: 3 in the file, 3 read, 0 skipped" in plain.out
    assert "vx" in plain.out and "1 no value" in plain.out and plain.out.rstrip().endswith("no findings")
    facts = json.loads(run("log", "drive.csv", "--signals", "names.toml", "--json").out)
    assert facts["rows"] == {"in_file": 3, "read": 3, "other_entries": {"line of names": 1}}
    assert facts["channels"] == [{"channel": "vx", "unit": "", "group": 0, "samples": 2, "without": {"no value": 1}}]
    answer = run("log", "drive.csv", "--signals", "names.toml", "--channel", "can3")
    assert answer.code == 2 and "it is not the log of a bus" in answer.err
