"""`codegen sweep` at the command line; tests/sweep covers campaigns."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from codegen import configuration
from codegen.importing.toml_edit import whole
from codegen.map_file import map as npz
from codegen.sweep import measured, store
from codegen.sweep import plan as planning
from tests import builds
from tests.sweep.conftest import write_spec

from .conftest import Answer, Refused, Run, edit, everything_in

ANSWERS: dict[Path, Answer] = {}


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_spec(tmp_path_factory.mktemp("spec"), samples=4)


@pytest.fixture
def driven(run: Run, spec: Path) -> tuple[Path, Answer]:
    """Return the campaign and the command's output; the first test that needs it runs the command."""
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


def test_a_folder_with_another_campaign_is_rejected(driven: tuple[Path, Answer], run: Run, spec: Path) -> None:
    folder, _ = driven
    before, isa = everything_in(folder), json.loads((folder / "campaign.json").read_text())["isa"]
    other = "x86-64-v3" if isa == "none" else "none"
    for more in ((), ("--replay", 1)):
        answer = run("sweep", "--spec", spec, "-o", folder, "--isa", other, *more)
        assert (answer.code, answer.err.count("\n")) == (2, 1)
        assert f"out: it was simulated with the instruction set {isa}, not {other}" in answer.err
    assert everything_in(folder) == before


def test_replay_of_a_worst_run(driven: tuple[Path, Answer], run: Run, spec: Path, tmp_path: Path) -> None:
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
        (("-o", "OUT", "--plot", "run.png"), "--plot: it cannot be combined with a campaign"),
        (("-o", "OUT", "--scheduler", "nonsense"), "'nonsense' is not a valid address"),
    ],
)
def test_bad_options(refused: Refused, spec: Path, arguments: tuple[object, ...], words: str) -> None:
    assert words in refused("sweep", "--spec", spec, *arguments)


def test_a_measured_car_needs_no_spec(run: Run, refused: Refused, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller is made from the car's own map; kind "pi" needs no tuning."""
    monkeypatch.setattr(measured, "SPEC", {**measured.SPEC, "samples": 6})
    table = {"keys": ["vehicle.yaw_inertia_kg_m2"], "standard_deviations": [100.0], "correlations": [[1.0]]}
    data = {**builds.CONFIG.model_dump(mode="json", exclude_none=True), "identified": table}
    (here / "identified.toml").write_text(whole(configuration.parse(data, "test"), "a test"), encoding="utf-8")
    before = everything_in(here)
    assert "--spec: no factors to vary are given; give --spec sweep.toml or" in refused("sweep", "-o", "out")
    assert everything_in(here) == before
    answer = run("sweep", "--from", "identified.toml", "-o", "out")
    assert answer.code == 0, answer
    assert "out/runs.parquet: 24 runs, 6 samples" in answer.out
    assert "\ncars drawn from identified.toml: vehicle.yaw_inertia_kg_m2\ncontroller: that of out/4ws-2.npz\n" in answer.out
    assert "codegen sweep --from identified.toml -o out --isa" in answer.out
    assert "codegen sweep --from identified.toml --isa" in (here / "out/summary.md").read_text()
    assert npz.load(here / "out/4ws-2.npz").config == configuration.load(here / "identified.toml")
    found = json.loads(run("sweep", "--from", "identified.toml", "-o", "out", "--replay", 20, "--json").out)
    assert (
        found["vehicle.yaw_inertia_kg_m2"] == pq.read_table(here / "out/runs.parquet")["vehicle.yaw_inertia_kg_m2"][20].as_py()
    )
    # The build of the written map is the same controller, and the spec says the same.
    assert run("build", "--map", "out/4ws-2.npz", "-o", "own").code == 0
    spec = 'samples = 6\nseed = 1\nscenarios = ["step-steer", "sine-with-dwell"]\n[controllers]\npi = "own"\npassive = ""\n'
    (here / "sweep.toml").write_text(spec, encoding="utf-8")
    plan = planning.read(here / "sweep.toml", measured_path=here / "identified.toml")
    assert store.facts_text(plan) == (here / "out/campaign.json").read_text()


def test_an_impossible_spec_is_rejected(refused: Refused, here: Path) -> None:
    edit(write_spec(here, samples=8), ('"step-steer", ', '"step-stear", '))
    line = refused("sweep", "--spec", "sweep.toml", "-o", "out")
    assert "sweep.toml: scenarios: there is no scenario 'step-stear'" in line
