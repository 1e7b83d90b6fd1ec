"""`codegen identify`: the files that it writes, and what it refuses."""

import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

import codegen
from codegen.configuration import load
from codegen.identify.drive import Drive
from codegen.identify.summary import CONFIDENCE_FACTOR
from codegen.importing.toml_edit import whole
from tests.cli.conftest import Refused, Run
from tests.identify.drives import SENSOR, Course, configured_car, drive, true_car

UNITS = {"vx": "m_s", "yaw_rate": "rad_s", "lateral_acceleration": "m_s2"}
SEED = 3


def write(path: Path, one: Drive) -> None:
    columns = {f"{key}_{UNITS.get(key, 'rad')}": values for key, values in one.signals.items()}
    pd.DataFrame({"time_s": one.time, **columns}).to_csv(path, index=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a configuration, a drive, and a drive to hold out."""
    folder = tmp_path_factory.mktemp("made")
    config, errors = true_car(SEED)
    course = Course(config)
    parts = (course.turns(60.0), course.front_sweep(50.0), course.rear_sweep(80.0), course.rear_steps())
    signals = (*SENSOR, "delta_r_command")
    write(folder / "one.csv", drive(config, parts, 0, errors, signals=signals))
    write(folder / "two.csv", drive(config, course.hold_out(), 1, errors, signals=signals))
    (folder / "ars.toml").write_text(whole(configured_car(config), "a test"), encoding="utf-8")
    return folder


@pytest.fixture
def files(made: Path, tmp_path: Path) -> Path:
    """Return a copy of the folder for one test."""
    return Path(shutil.copytree(made, tmp_path / "files"))


def test_a_configuration_a_report_and_facts_are_written(run: Run, files: Path) -> None:
    given = ("identify", "--config", files / "ars.toml", "--log", files / "one.csv", "--hold-out", files / "two.csv")
    answer = run(*given, "-o", files / "found.toml", "--report", files / "found.html")
    assert answer.code == 0
    assert "front cornering stiffness" in answer.out
    assert "front D: as configured, with an assumed deviation" in answer.out
    assert f"written: {files / 'found.toml'}" in answer.out
    white = re.search(r"^errors that may be white noise \(Ljung-Box\): yaw rate in ([01]) of 1 drives, .*", answer.out, re.M)
    page = (files / "found.html").read_text(encoding="utf-8")
    assert "Identified values" in page
    assert "held out" not in page

    text = (files / "found.toml").read_bytes()
    told = json.loads(run(*given, "-o", files / "found.toml", "--json").out)
    assert (files / "found.toml").read_bytes() == text
    true, written = true_car(SEED)[0], load(files / "found.toml")
    assert white is not None and bool(int(white[1])) is told["validation"][0]["white"]["yaw_rate"]
    known = load(files / "ars.toml")
    assert codegen.identify(known, files / "one.csv", hold_out=files / "two.csv").config == written
    inertia = told["quantities"]["yaw_inertia"]
    assert written.vehicle.yaw_inertia_kg_m2 == pytest.approx(inertia["value"], rel=1e-6)
    assert inertia["value"] == pytest.approx(
        true.vehicle.yaw_inertia_kg_m2, abs=2.0 * CONFIDENCE_FACTOR * inertia["standard_deviation"]
    )
    assert told["quantities"]["front_peak"]["value"] is None
    assert written.tyre.front.peak_factor_p1 == load(files / "ars.toml").tyre.front.peak_factor_p1
    assert "tyre.front.peak_factor_p1" in written.identified.keys
    (validation,) = told["validation"]
    assert validation["drive"] == "two"
    # The doubts are the same in the answer, in the file and in the report.
    assert told["doubts"] and written.identified.doubts == told["doubts"]
    assert all(f"in doubt: {doubt}" in answer.err and f"In doubt: {doubt}" in page for doubt in told["doubts"])
    assert "refuse found.toml until it has identified.doubts_accepted = true" in answer.err
    assert validation["identified"]["free_run_rad_s"] < 0.2 * validation["configured"]["free_run_rad_s"]


def test_what_is_missing_or_would_be_lost_is_refused_before_anything_is_written(refused: Refused, files: Path) -> None:
    given = ("identify", "--log", files / "one.csv")
    config, output = ("--config", files / "ars.toml"), ("-o", files / "found.toml")
    for arguments, message in (
        (output, "codegen identify --config: is missing; give --config and -o, or --check"),
        (config, "codegen identify --output: is missing"),
        ((*config, "-o", files / "ars.toml"), "it is an input of this command"),
        ((*config, *output, "--report", files / "no" / "found.html"), "its folder does not exist"),
        ((*config, *output, "--hold-out", files / "one.csv"), "given twice"),
        ((*config, *output, "--hold-out", files / "missing.csv"), "missing.csv: cannot be read"),
    ):
        assert message in refused(*given, *arguments)
    assert not (files / "found.toml").exists()


def test_no_report_is_left_if_the_configuration_cannot_be_written(refused: Refused, files: Path) -> None:
    given = ("identify", "--log", files / "two.csv", "--config", files / "ars.toml", "--report", files / "found.html")
    assert "cannot be written (File name too long)" in refused(*given, "-o", files / f"{'x' * 250}.toml")
    assert not (files / "found.html").exists()


def test_a_fault_of_the_drives_names_the_drives(refused: Refused, files: Path) -> None:
    lines = (files / "one.csv").read_text(encoding="utf-8").splitlines()[:51]
    (files / "short.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    told = refused("identify", "--log", files / "short.csv", "--config", files / "ars.toml", "-o", files / "found.toml")
    assert f"error: {files / 'short.csv'}: identify: no drive has 1 s with speed above" in told
