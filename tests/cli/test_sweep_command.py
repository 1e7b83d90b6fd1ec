"""`codegen sweep` as its user types it; the campaign itself is tested in tests/sweep."""

import json
from pathlib import Path

import pytest

from tests.sweep.conftest import write_spec

from .conftest import Answer, Refused, Run, edit, everything_in

SCENARIOS = '["step-steer", "sine-with-dwell"]'
ANSWERS: dict[Path, Answer] = {}


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_spec(tmp_path_factory.mktemp("spec"), samples=4)


@pytest.fixture
def driven(run: Run, spec: Path) -> tuple[Path, Answer]:
    """The campaign and the command's answer; driven by the first test that needs it."""
    if spec not in ANSWERS:
        ANSWERS[spec] = run("sweep", "--spec", spec, "-o", spec.parent / "out")
    return spec.parent / "out", ANSWERS[spec]


def test_a_campaign(driven: tuple[Path, Answer], run: Run, spec: Path) -> None:
    folder, answer = driven
    assert answer.code == 0, answer
    assert f"{folder}/runs.parquet: 24 runs, 4 samples" in answer.out
    isa = json.loads((folder / "campaign.json").read_text())["isa"]
    assert f"codegen sweep --spec sweep.toml --isa {isa} --replay RUN" in (folder / "summary.md").read_text()
    before = everything_in(folder)
    assert before.keys() >= {"campaign.json", "runs.parquet", "summary.json", "summary.md", "overshoot.png", "sideslip.png"}
    data = json.loads(run("sweep", "--spec", spec, "-o", folder, "--json").out)
    assert (data["runs"], set(data["scenarios"])) == (24, {"step-steer", "sine-with-dwell"})
    assert everything_in(folder) == before


def test_an_edited_scenario_is_not_mixed_with_earlier_runs(run: Run, here: Path) -> None:
    own = here / "mine.toml"
    own.write_text('name = "mine"\nbase = "step-steer"\nsteering_wheel_angle_deg = 60.0\n')
    edit(write_spec(here, samples=2), (SCENARIOS, '["mine.toml"]'))
    command = ("sweep", "--spec", "sweep.toml", "-o", "out", "--isa")
    answer = run(*command, "none")
    assert answer.code == 0, answer
    assert "instruction set none" in answer.out
    before = Path("out/runs.parquet").read_bytes()
    other_isa = run(*command, "x86-64-v3", "--replay", 1)
    edit(own, ("60.0", "120.0"))
    for answer, words in (
        (other_isa, "out: it was driven with the instruction set none, not x86-64-v3"),
        (run(*command, "none"), "out: it holds another campaign: scenarios has changed since"),
        (run(*command, "none", "--replay", 1), "out: it holds another campaign: scenarios has changed since"),
    ):
        assert (answer.code, answer.err.count("\n")) == (2, 1)
        assert words in answer.err
    assert Path("out/runs.parquet").read_bytes() == before


def test_a_worst_run_again(driven: tuple[Path, Answer], run: Run, spec: Path, tmp_path: Path) -> None:
    folder, _ = driven
    worst = json.loads((folder / "summary.json").read_text())["scenarios"]["step-steer"]["pi"]["worst"]["overshoot_percent"][0]
    plot, record = tmp_path / "run.png", tmp_path / "run.csv"
    answer = run("sweep", "--spec", spec, "--replay", worst["run"], "--plot", plot, "--run", record, "--json")
    assert answer.code == 0, answer
    data = json.loads(answer.out)
    assert (data["scenario"], data["controller"]) == ("step-steer", "pi")
    assert data["overshoot_percent"] == worst["value"]
    assert plot.is_file() and record.read_text().startswith("time_s,")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "-o: no folder is named"),
        (("--replay", 24), "there is no run 24; 0 to 23"),
        (("-o", "OUT", "--plot", "run.png"), "--plot: it does not go with a campaign"),
        (("-o", "OUT", "--scheduler", "nonsense"), "'nonsense' is no address"),
    ],
)
def test_bad_options(refused: Refused, spec: Path, arguments: tuple[object, ...], words: str) -> None:
    assert words in refused("sweep", "--spec", spec, *arguments)


def test_a_spec_that_cannot_be_driven(refused: Refused, here: Path) -> None:
    edit(write_spec(here, samples=8), ('"step-steer", ', '"step-stear", '))
    line = refused("sweep", "--spec", "sweep.toml", "-o", "out")
    assert "sweep.toml: scenarios: there is no scenario 'step-stear'" in line
