"""`codegen sweep` as its user types it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import click
import pytest

from codegen.cli.sweep_command import _figure, sweep
from codegen.sil.vector import ISAS
from codegen.sweep import plan as planning
from codegen.sweep.chunk import replay
from tests.sweep.conftest import ROOT, damage, write_spec

from .conftest import Answer, Run


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_spec(tmp_path_factory.mktemp("spec"), samples=8)


@pytest.fixture
def driven(run: Run, spec: Path) -> tuple[Path, Answer]:
    """Driven once; afterwards it is only told again."""
    folder = spec.parent / "out"
    return folder, run("sweep", "--spec", spec, "-o", folder)


def test_a_campaign(driven: tuple[Path, Answer], spec: Path) -> None:
    folder, answer = driven
    assert answer.code == 0, answer
    assert f"{folder}/runs.parquet: 48 runs, 8 samples" in answer.out
    isa = json.loads((folder / "campaign.json").read_text())["isa"]
    assert f"codegen sweep --spec {spec} -o {folder} --isa {isa} --replay RUN" in answer.out
    assert f"codegen sweep --spec sweep.toml --isa {isa} --replay RUN" in (folder / "summary.md").read_text()
    assert {path.name for path in folder.iterdir()} >= {
        "campaign.json",
        "runs.parquet",
        "summary.json",
        "summary.md",
        "overshoot.png",
        "sideslip.png",
    }
    assert json.loads((folder / "summary.json").read_text())["runs"] == 48


def test_the_same_again_as_json_changes_no_byte(driven: tuple[Path, Answer], run: Run, spec: Path) -> None:
    folder, _ = driven
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    answer = run("sweep", "--spec", spec, "-o", folder, "--json")
    assert answer.code == 0
    told = json.loads(answer.out)
    assert told["runs"] == 48
    assert set(told["scenarios"]) == {"step-steer", "sine-with-dwell"}
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_run_of_another_campaign_is_not_driven(driven: tuple[Path, Answer], run: Run, tmp_path: Path) -> None:
    answer = run("sweep", "--spec", write_spec(tmp_path, samples=9), "-o", driven[0], "--replay", 1)
    assert answer.code == 2
    assert "it holds another campaign: spec, runs have changed since" in answer.err


def test_an_edited_scenario_is_not_mixed_with_what_was_driven(run: Run, tmp_path: Path) -> None:
    own, out = tmp_path / "mine.toml", tmp_path / "out"
    own.write_text('name = "mine"\nbase = "step-steer"\nsteering_wheel_angle_deg = 60.0\n')
    path = write_spec(tmp_path, samples=2)
    path.write_text(path.read_text().replace('["step-steer", "sine-with-dwell"]', '["mine.toml"]'))
    assert run("sweep", "--spec", path, "-o", out).code == 0
    before = (out / "runs.parquet").read_bytes()
    own.write_text(own.read_text().replace("60.0", "120.0"))
    for more in ((), ("--replay", 1)):
        answer = run("sweep", "--spec", path, "-o", out, *more)
        assert answer.code == 2
        assert f"{out}: it holds another campaign: scenarios has changed since" in answer.err
        assert answer.err.strip().count("\n") == 0
    assert (out / "runs.parquet").read_bytes() == before


def test_a_finished_file_with_a_damaged_page_is_told(driven: tuple[Path, Answer], run: Run, spec: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(driven[0], out)
    damage(out / "runs.parquet", 0)
    answer = run("sweep", "--spec", spec, "-o", out)
    assert answer.code == 2
    assert answer.err.splitlines()[1:] == [  # the first tells the progress
        f"error: {out}/runs.parquet: it is damaged; remove it, and run the same command again"
    ]


def test_the_instruction_set_is_chosen_and_kept(run: Run, spec: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    answer = run("sweep", "--spec", spec, "-o", out, "--isa", "none")
    assert answer.code == 0, answer
    assert "instruction set none" in answer.out
    assert run("sweep", "--spec", spec, "-o", out, "--isa", "none", "--replay", 1).code == 0
    answer = run("sweep", "--spec", spec, "-o", out, "--isa", "x86-64-v3", "--replay", 1)
    assert answer.code == 2
    assert f"{out}: it was driven with the instruction set none, not x86-64-v3" in answer.err
    assert "give --isa none" in answer.err
    assert answer.err.strip().count("\n") == 0


def test_the_instruction_sets_are_those_of_the_batch() -> None:
    (option,) = (parameter for parameter in sweep.params if parameter.name == "isa")
    assert isinstance(option.type, click.Choice)
    assert tuple(option.type.choices) == ISAS


def test_an_edited_build_is_told(run: Run, spec: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "generated/4ws2", tmp_path / "mine")
    source = tmp_path / "mine/src/ars_controller.c"
    source.write_text(source.read_text() + "/* mine */\n")
    own = tmp_path / "sweep.toml"
    own.write_text(spec.read_text().replace(f'{ROOT}/generated/4ws2"', 'mine"'))
    answer = run("sweep", "--spec", own, "-o", tmp_path / "out")
    assert answer.code == 0, answer
    assert "mine/src/ars_controller.c was changed after the build" in answer.err


def test_two_scenarios_of_one_name_are_refused(run: Run, tmp_path: Path) -> None:
    for file, base in (("a.toml", "step-steer"), ("b.toml", "sine-with-dwell")):
        (tmp_path / file).write_text(f'name = "mine"\nbase = "{base}"\n')
    path = write_spec(tmp_path, samples=8)
    path.write_text(path.read_text().replace('["step-steer", "sine-with-dwell"]', '["a.toml", "b.toml"]'))
    answer = run("sweep", "--spec", path, "-o", tmp_path / "out")
    assert answer.code == 2
    assert "two of them are called 'mine'" in answer.err


def test_a_worst_run_again(driven: tuple[Path, Answer], run: Run, spec: Path, tmp_path: Path) -> None:
    folder, _ = driven
    worst = json.loads((folder / "summary.json").read_text())["scenarios"]["step-steer"]["pi"]["worst"]["overshoot_percent"][0]
    plot, record = tmp_path / "run.png", tmp_path / "run.csv"
    answer = run("sweep", "--spec", spec, "--replay", worst["run"], "--plot", plot, "--run", record, "--json")
    assert answer.code == 0, answer
    told = json.loads(answer.out)
    assert (told["scenario"], told["controller"]) == ("step-steer", "pi")
    assert told["overshoot_percent"] == worst["value"]
    assert type(told["run"]) is type(told["sample"]) is int and type(told["settled"]) is bool
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert record.read_text().startswith("time_s,")
    words = run("sweep", "--spec", spec, "--replay", worst["run"]).out.split()
    assert words[words.index("settled") + 1] == ("yes" if told["settled"] else "no")


def test_the_picture_of_a_run_tells_its_car(spec: Path) -> None:
    plan = planning.read(spec)
    found = replay(plan, 1)
    title = " ".join(_figure(plan, found, 1).get_suptitle().split())
    for key, words in (("mass_percent", "mass {:+.3g} %"), ("rear_stiffness_percent", "rear stiffness {:+.3g} %")):
        assert words.format(round(found.row[key], 3)) in title
    assert f"delay {found.row['delay_samples']:g} samples, yaw rate noise 0.1 deg/s" in title


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "-o: no folder is named"),
        (("-o", "OUT", "--replay", 1), "no campaign is there"),
        (("--workers", 2, "--replay", 1), "--workers: it does not go with --replay"),
        (("--replay", 48), "there is no run 48; 0 to 47"),
        (("-o", "OUT", "--plot", "run.png"), "--plot: it does not go with a campaign"),
        (("-o", "OUT", "--scheduler", "tcp://127.0.0.1:9", "--workers", 2), "--workers: the cluster has its own workers"),
        (("-o", "OUT", "--scheduler", "tcp://127.0.0.1:9"), "no Dask scheduler answers"),
        (("-o", "OUT", "--scheduler", "nonsense"), "'nonsense' is no address"),
        (("--replay", 1, "--run", "run.txt"), "no format for a run"),
        (("--replay", 1, "--plot", "run.jpg"), "run.jpg"),
    ],
)
def test_what_is_refused(
    run: Run, spec: Path, tmp_path: Path, arguments: tuple[object, ...], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("codegen.sweep.engine.CONNECT_TIMEOUT", 1.0)
    given = [str(tmp_path / "out") if argument == "OUT" else argument for argument in arguments]
    answer = run("sweep", "--spec", spec, *given)
    assert answer.code == 2
    assert told in answer.err
    assert answer.err.strip().count("\n") == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('generated/4ws2"', 'generated/none"', "sweep.toml: controllers.pi: "),
        ('"step-steer", ', '"step-stear", ', "sweep.toml: scenarios: there is no scenario 'step-stear'"),
        ('"step-steer", ', '"ramp-steer", ', "has no figures for a campaign"),
        ('"step-steer", ', '"ecu-loss", ', "has no figures for a campaign"),
        ("length_s = 3.9", "length_s = 3.0", "length_s: 3 s are too short for the figures of sine-with-dwell"),
        (
            "length_s = 3.9",
            "length_s = 5.5",
            "length_s: step-steer ends 5 s after the driver begins, before 5.5 s; give 5 s or less",
        ),
        ("mass_percent = {", "cg_shift_m = 1.6\nmass_percent = {", "bring the centre of gravity to an axle"),
        ("[40, 110]", "[5, 110]", "beyond steering.front_angle_stop_deg"),
    ],
)
def test_a_spec_that_cannot_be_driven(run: Run, tmp_path: Path, old: str, new: str, told: str) -> None:
    path = write_spec(tmp_path, samples=8)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    answer = run("sweep", "--spec", path, "-o", tmp_path / "out")
    assert answer.code == 2, answer
    assert told in answer.err
    assert answer.err.strip().count("\n") == 0
    assert not (tmp_path / "out").exists()
