"""From a configuration to a run, and the common behaviour of all commands: notes, JSON, help, versions, exit codes."""

import importlib.metadata
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from codegen import configuration
from codegen.cli import cli
from codegen.emit.from_files import prepare
from codegen.optimum import uncertain
from codegen.sil.software import RECORD_COLUMNS

from .conftest import BUILD, MAP, TRACKING, Refused, Run, edit, everything_in, python


def test_from_init_to_run(run: Run, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("init", "my-car", "--preset", "paper").code == 0
    monkeypatch.chdir("my-car")
    assert configuration.load(Path("ars.toml")) == configuration.preset("paper")
    assert run("solve", "--config", "ars.toml", "--case", "4ws-2", "-o", "4ws2.npz").code == 0
    assert "6582 of 10100 cells feasible" in run("show", "4ws2.npz", "--plot", "map.png").out
    assert run("build", "--map", "4ws2.npz").code == 0
    ran = run("sil", "--build", "generated/4ws2", "--plot", "run.png", "--csv", "run.csv")
    assert "yaw rate, steady [deg/s]" in ran.out
    assert Path("map.png").read_bytes()[:4] == Path("run.png").read_bytes()[:4] == b"\x89PNG"
    assert Path("run.csv").read_text(encoding="ascii").splitlines()[0] == ",".join(RECORD_COLUMNS)
    assert {path.name for path in Path().iterdir()} == {"ars.toml", "4ws2.npz", "generated", "map.png", "run.png", "run.csv"}


def test_build_check(run: Run, here: Path) -> None:
    build = ("build", "--map", shutil.copy(MAP, "4ws2.npz"))
    assert run(*build, "--check").code == 1
    assert not Path("generated").exists()
    assert "little margin" in json.loads(run(*build, "--json").out)["warnings"][-1]
    current = run(*build, "--check", "--json")
    assert current.code == 0 and json.loads(current.out)
    edited = Path("generated/4ws2/src/ars_controller.c")
    edited.write_bytes(edited.read_bytes() + b"\n/* edited */\n")
    stale = run(*build, "--check")
    assert (stale.code, stale.err.count("\n")) == (1, 1)
    assert "src/ars_controller.c" in stale.err


def test_a_build_that_another_numpy_made_is_up_to_date(run: Run, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the versions may differ. Every other change is reported, and nothing else with it."""
    build, folder = ("build", "--map", shutil.copy(MAP, "4ws2.npz")), Path("generated/4ws2")
    assert run(*build).code == 0
    (folder / "verify.json").write_text("{}")
    files, version = everything_in(folder), importlib.metadata.version
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "9.9.9" if name == "numpy" else version(name))
    current = run(*build, "--check")
    assert (current.code, current.out) == (0, "generated/4ws2: up to date\n")
    assert f"numpy {version('numpy')}, here 9.9.9" in current.err
    assert "(unchanged)" in run(*build).out and everything_in(folder) == files
    prepared = prepare(Path("4ws2.npz"))
    for path in ("manifest.json", "sbom.cdx.json", "README.md", "ars.dbc", "src/ars_map.c", "verify/every_function.c"):
        content = (folder / path).read_bytes()
        (folder / path).write_bytes(content.replace(b"0.1.0", b"0.1.1") if path.endswith(".json") else content + b"\n")
        assert prepared.differences() == [f"{path}: differs"]
        (folder / path).write_bytes(content)
    stale = run(*build, "--precision", "double", "--check", "--json")
    assert stale.code == 1 and {"manifest.json: differs", "sbom.cdx.json: differs"} < {*json.loads(stale.out)["differences"]}
    assert run(*build, "--precision", "double").code == 0
    assert json.loads((folder / "manifest.json").read_text())["tools"]["numpy"] == "9.9.9"


def test_check_prints_a_line_per_warning_and_returns_1(run: Run, here: Path) -> None:
    """`check` reports a map in km/h, `build` rejects it unless overridden; a build folder has its facts."""
    for subject in (MAP.with_name("4ws2.npz"), TRACKING):
        answer = run("check", subject, "--json")
        judged = json.loads(answer.out)["judgement"].get("rows", [])
        faults = [row for row in judged if row["verdict"] in ("worse", "missed")]
        assert (answer.code, len(json.loads(answer.out)["warnings"])) == (1 if faults else 0, len(faults))
    speed, angle = np.array([20.0, 60.0, 110.0]), np.array([0.02, 0.05, 0.1])
    np.savez("km-h.npz", vx=speed, delta_f=angle, yaw_rate=np.minimum(np.outer(speed / 12.0, angle), 0.3))
    answer = run("check", "km-h.npz")
    _, warning, last = answer.err.splitlines()
    assert answer.code == 1 and warning.startswith("warning: ") and "is vx in km/h?" in warning
    assert last == "error: km-h.npz: 1 warning; resolve it"
    refused = run("build", "--map", "km-h.npz")
    assert (refused.code, refused.err.count("\n")) == (2, 1) and "is vx in km/h?" in refused.err
    assert run("build", "--map", "km-h.npz", "--beyond-grip").code == 0
    found = json.loads(run("check", "generated/km-h", "--json").out)
    assert found["kind"] == "build" and any("not verified" in text for text in found["notes"])


def test_a_bare_map_builds_with_the_papers_car(run: Run, here: Path) -> None:
    speed, angle = np.array([5.0, 15.0, 30.0]), np.array([0.02, 0.05, 0.1])
    np.savez("mine.npz", vx=speed, delta_f=angle, yaw_rate=np.minimum(np.outer(speed / 3.2, angle), 5.0 / speed[:, np.newaxis]))
    answer = run("build", "--map", "mine.npz")
    assert answer.code == 0
    assert "the paper's PI" in answer.err
    assert "those of the paper's car" in Path("generated/mine/README.md").read_text(encoding="utf-8")


def test_another_configuration_than_the_one_in_the_map(run: Run, here: Path) -> None:
    config = here / "ars.toml"
    config.write_text(configuration.preset_text(), encoding="utf-8")
    edit(config, ("integral_gain = 1.0", "integral_gain = 13.0"))
    assert run("build", "--map", MAP, "-o", "own", "--config", config).code == 0
    edit(config, ("mass_kg = 2335.07", ""))
    for command in (("build", "--map", MAP, "-o", "no"), ("solve", "--case", "4ws-2", "-o", "no.npz")):
        answer = run(*command, "--config", config)
        assert (answer.code, answer.out) == (2, "")
        assert answer.err == f"error: {config}: vehicle.mass_kg is missing; add it; `codegen init DIR` writes a complete file\n"
    assert ".integral_gain = 13.0f" in Path("own/src/ars_calibration.c").read_text(encoding="ascii")


def test_a_run_of_edited_c_is_noted(run: Run, here: Path) -> None:
    shutil.copytree(BUILD, "edited")
    source = Path("edited/src/ars_calibration.c")
    text, count = re.subn(r"expected_checksum = 0x[0-9A-F]{8}u", "expected_checksum = 0x12345678u", source.read_text("ascii"))
    assert count == 1
    source.write_text(text, encoding="ascii")
    answer = run("sil", "--build", "edited")
    assert answer.code == 1
    assert "self-test" in answer.err


@pytest.mark.parametrize("command", sorted(cli.commands))
def test_help_of_each_command_shows_an_example(run: Run, command: str) -> None:
    answer = run(command, "--help")
    assert answer.code == 0
    assert f"Example:\n    codegen {command}" in answer.out


HEAVY = "{'casadi', 'matplotlib', 'scipy', 'numpy', 'pydantic', 'jinja2', 'cffi', 'can', 'rich'}"
QUICK = f"""
try: main()
except SystemExit: sys.exit(', '.join({HEAVY} & set(sys.modules)) or None)
"""


@pytest.mark.parametrize("words", ["--help", "solve --case ", "show g"])
def test_help_and_completion_import_nothing_heavy(words: str) -> None:
    asked = {"_CODEGEN_COMPLETE": "bash_complete", "COMP_WORDS": f"codegen {words}", "COMP_CWORD": "3"}
    options, environment = ([words], {}) if words.startswith("-") else ([], asked)
    result = python(f"from codegen.cli import main\n{QUICK}", *options, **environment)
    assert result.returncode == 0, result.stderr


def test_a_map_for_a_share_of_the_cars_is_written_beside_the_nominal_one(
    run: Run, refused: Refused, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uncertain, "FIRST_CARS", 40)
    keys = "['vehicle.yaw_inertia_kg_m2', 'tyre.rear.cornering_stiffness_n_per_rad']"
    identified = f"\n[identified]\nkeys = {keys}\nstandard_deviations = [50, 4000]\ncorrelations = [[1, 0.3], [0.3, 1]]\n"
    text = configuration.preset_text().replace("speed_points = 101", "speed_points = 8")
    Path("car.toml").write_text(
        text.replace("front_angle_points = 100", "front_angle_points = 9") + identified, encoding="utf-8"
    )
    options = ("solve", "--config", "car.toml", "--case", "4ws-2", "-o", "own.npz", "--uncertain", "0.5")
    told = run(*options)
    line = r"limits tightened to .*rear angle [\d.]+ %.*; \d+ of 40 drawn cars exceed a limit \(50 % must keep them\)"
    assert told.code == 0 and re.search(f"map: {line}\n", told.out)
    found = re.search(
        r"own-nominal.npz: the map with the whole limits; (\d+) % of the cars exceed one. Its yaw rate is ", told.out
    )
    assert found is not None
    facts = json.loads(run(*options, "--json").out)
    assert facts["tightening"]["share"] == 0.5 and round(facts["nominal"]["lost_percent"]) == int(found[1]) > 50
    assert facts["nominal"]["yaw_rate_max_deg_s"] > 0.0
    assert re.search(f"^{line}$", run("show", "own.npz").out, re.MULTILINE)
    assert "tightened" not in run("show", "own-nominal.npz").out
    # The map builds without the file and with it.
    assert (
        run("build", "--map", "own.npz", "-o", "a").code
        == run("build", "--map", "own.npz", "-o", "b", "--config", "car.toml").code
        == 0
    )
    sources = [Path(folder, "src/ars_calibration.c").read_bytes() for folder in "ab"]
    assert sources[0] == sources[1]
    for other in (("--friction", "0.5,0.9"), ("--longitudinal-acceleration", "-4,0"), ("--method", "ipopt")):
        assert f"{other[0]}: cannot be combined with --uncertain; leave one" in refused(*options, *other).replace(" ipopt", "")
    assert "no identified keys" in refused("solve", "--case", "4ws-2", "-o", "own.npz", "--uncertain", "0.9")


def test_a_stack_over_acceleration_is_solved_shown_and_built(run: Run, refused: Refused, here: Path) -> None:
    options = ("solve", "--case", "4ws-2", "-o", "moving.npz", "--longitudinal-acceleration", "-4,0,3")
    told = run(*options)
    assert told.code == 0 and "; a stack with longitudinal acceleration -4, 3 m/s^2" in told.out
    assert "0 (the map itself)" in run("show", "moving.npz").out
    assert run("build", "--map", "moving.npz", "-o", "moving").code == 0
    assert "braking and traction | maps for -4, 0, 3 m/s^2" in (here / "moving" / "README.md").read_text()
    both = refused(*options, "--friction", "0.5,0.9")
    assert "--longitudinal-acceleration: a map has one stack; leave it or --friction out" in both
    assert "'x' is not a number" in refused(*options[:-1], "-4,x")
