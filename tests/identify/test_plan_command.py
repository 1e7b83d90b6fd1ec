"""`codegen identify --plan`: the folder that it writes, and what it refuses."""

import json
from pathlib import Path

import pytest

from codegen.emit.folder import read_manifest
from codegen.importing.toml_edit import whole
from hil_sim.scenario_files import find
from tests.cli.conftest import Refused, Run
from tests.identify.test_drive_plan import CAR

GIVEN = ("identify", "--config", "ars.toml", "--duration", "30", "--lateral-acceleration-max", "9.5")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("ars.toml").write_text(whole(CAR, "a test"), encoding="utf-8")


def test_scenarios_a_report_and_facts_are_written_and_a_new_plan_replaces_them(run: Run) -> None:
    answer = run(*GIVEN, "--plan", "plan", "--report", "plan.html")
    assert answer.code == 0
    assert "written: plan" in answer.out
    assert "sideslip offset, sideslip delay: sideslip is not measured" in answer.out
    page = Path("plan.html").read_text(encoding="utf-8")
    assert "Predicted uncertainty" in page
    told = json.loads(run(*GIVEN, "--plan", "again", "--json").out)
    for name in ("manifest.json", *(drive["scenario"] for drive in told["drives"])):
        assert Path("plan", name).read_bytes() == Path("again", name).read_bytes()
    assert sum(drive["duration_s"] for drive in told["drives"]) == told["duration_s"] <= 30.0
    for drive in told["drives"]:
        assert drive["scenario"][:-4] in page
        assert find(f"plan/{drive['scenario']}", CAR).duration == pytest.approx(drive["duration_s"])
    front = told["quantities"]["front_stiffness"]
    assert front["is_determined"]
    assert 0.0 < front["standard_deviation"] < 0.5 * front["share"] * front["configured"] * 1.001
    assert read_manifest(Path("plan"))["plan"]["quantities"]["front_stiffness"] == front

    assert run(*GIVEN, "--duration", "12", "--plan", "plan").code == 0
    assert len(list(Path("plan").glob("*.csv"))) == 1


def test_what_cannot_be_planned_or_would_be_lost_is_refused(refused: Refused) -> None:
    Path("mine").mkdir()
    Path("mine", "notes.txt").write_text("mine", encoding="ascii")
    Path("names.toml").write_text('vx = { signal = "v" }\n', encoding="ascii")
    Path("ideal.toml").write_text(
        whole(CAR.model_copy(update={"sensors": CAR.sensors.model_copy(update={"yaw_rate": _ideal()})}), "a test")
    )
    for arguments, message in (
        (("--plan", "plan"), "codegen identify --config: is missing; name the ars.toml of the car"),
        (("--config", "ars.toml"), "codegen identify --log: is missing; name a measured drive, or give --plan DIR"),
        (
            ("--config", "ars.toml", "--plan", "mine"),
            "contains 'notes.txt', which no manifest of codegen names; nothing was changed; choose another folder",
        ),
        (("--config", "ars.toml", "--plan", "plan", "--check"), "--check: it cannot be combined with --plan; leave it out"),
        (("--config", "ars.toml", "--plan", "plan", "-o", "new.toml"), "--output: it cannot be combined with --plan"),
        (("--log", "one.csv", "--check", "--duration", "60"), "--duration: it belongs to --plan; add --plan DIR"),
        (("--config", "ars.toml", "--plan", "plan", "--duration", "5"), "--duration: 5 s is less than the shortest drive, 8 s"),
        (("--config", "ars.toml", "--plan", "plan", "--signals", "names.toml"), "--signals: yaw_rate is not measured"),
        (("--config", "ars.toml", "--plan", "plan", "--report", "no/plan.html"), "its folder does not exist"),
        (("--config", "ars.toml", "--plan", "plan", "--lateral-acceleration-max", "nan"), "'nan' is not a number"),
        (("--config", "ideal.toml", "--plan", "plan"), "sensors.yaw_rate: it has neither noise nor resolution"),
    ):
        assert message in refused("identify", *arguments)
    assert not Path("plan").exists()


def _ideal() -> object:
    return CAR.sensors.yaw_rate.model_copy(update={"noise_deg_s": 0.0, "resolution_deg_s": 0.0})
