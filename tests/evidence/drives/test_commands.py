"""Commands that search or drive for long."""

import json
import math
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen import config as configuration
from codegen.cli.suite_command import instructions_of_step
from codegen.config import Config
from codegen.refmap import map as npz
from codegen.refmap import place_sweep
from codegen.verify.budgets.measure import measure
from codegen.verify.check import Effort, Subject
from hil_sim.suite import candidate
from hil_sim.suite.candidate import Candidate
from hil_sim.suite.tracking import SuiteResult
from tests.cli.conftest import BUILD, MAP, TRACKING, Run, edit
from tests.cli.test_suite_command import PICTURES, SMALL_TUNING
from tests.cli.test_tune import NONLINEAR, solve, stored, write_config

pytestmark = pytest.mark.long
MAGIC = b"\x89PNG"


def answer_of(run: Run, *arguments: object) -> Any:
    """Return the JSON of a command that succeeds."""
    answer = run(*arguments, "--json")
    assert answer.code == 0, answer
    return json.loads(answer.out)


def test_error_against_flash_as_table_plot_and_json(run: Run, maps: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(place_sweep, "BOUNDS", (math.radians(1.0), math.radians(0.5)))
    answer = run("show", maps["linear"], "--flash", "--plot", "flash.png")
    assert answer.code == 0 and Path("flash.png").read_bytes().startswith(MAGIC)
    lines = answer.out.splitlines()
    assert "as it is 22 x 22 breakpoints" in lines[0]
    assert [line.split()[0] for line in lines if line[:1].isdigit()] == ["1", "0.5"]
    named = [f"{bound} deg/s, {way}" for bound in ("1", "0.5") for way in ("even", "uneven", "int16")]
    assert [line.split(" %, ")[-1] for line in answer.err.splitlines()] == [*named, "placing breakpoints: 100 %"]
    data = answer_of(run, "show", maps["linear"], "--flash")
    assert {point["way"] for point in data["placed"]} == {"even", "uneven", "int16"}
    for point in data["placed"]:
        assert point["error_whole_domain_rad_s"] <= point["max_error_rad_s"]
        assert point["flash_bytes"] < data["grid"]["flash_bytes"]


def test_a_report_of_a_build_that_is_driven_with_faults(run: Run, here: Path) -> None:
    data = answer_of(run, "report", "--map", MAP, "--build", BUILD, "-o", "report.html")
    assert (data["notes"], data["bytes"]) == ([], Path("report.html").stat().st_size)
    assert {"runs", "margins", "map-loss", "compare-difference-1"} <= set(data["charts"])
    text = Path("report.html").read_text(encoding="utf-8")
    assert all(f'<th scope="col" class="number">{name}</th>' in text for name in ("pi", "tracking", "passive car"))
    assert "4 samples lost: one too many" in text


def test_a_report_of_cars_and_maps_that_differ(run: Run, here: Path) -> None:
    def report(map_path: Path | str, build: Path | str) -> str:
        answer = run("report", "--map", map_path, "--build", build, "--no-simulation", "-o", "report.html")
        assert answer.code == 0
        return answer.err

    assert "was built from another map" in report(TRACKING.with_suffix(".npz"), BUILD)
    np.savez("own.npz", vx=[10.0, 20.0], delta_f=[0.02, 0.04], yaw_rate=[[0.1, 0.2], [0.15, 0.25]])
    Path("ars.toml").write_text(configuration.preset_text(), encoding="utf-8")
    edit(Path("ars.toml"), ("mass_kg = 2335.07", "mass_kg = 1450.0"))
    # The car of a bare map is that of its build.
    assert run("build", "--map", "own.npz", "--config", "ars.toml", "-o", "b").code == 0
    assert report("own.npz", "b") == "report: 10 %\nreport: 30 %\nreport: 100 %\n"
    assert "<td>1450 kg</td>" in Path("report.html").read_text(encoding="utf-8").replace('<td class="">', "<td>")
    shutil.copy(MAP, "own.npz")
    assert run("build", "--map", "own.npz", "--config", "ars.toml", "-o", "b").code == 0
    assert "describes another car than the map was solved for" in report("own.npz", "b")


def test_pictures_of_the_suite_of_a_build(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    seen = suite(good, edited=("src/ars_map.c",), notes=("the multi-body car is missing",))
    answer = run("sil", "--suite", "tracking", "--build", BUILD, "-o", "pictures", "--plot", "one.png")
    assert answer.code == 0, answer
    assert seen[0].folder == BUILD
    edited = "note: src/ars_map.c was changed after the build; it was tested as it is\n"
    assert answer.err == f"{edited}note: the multi-body car is missing\n"
    assert {path.name for path in Path("pictures").iterdir()} == PICTURES
    assert Path("one.png").read_bytes() == Path("pictures/overview.png").read_bytes()


def test_baselines_of_a_scenario(run: Run, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through frames too, whose quantisation is in the figures of the baselines then."""
    found, small = candidate.tuned, configuration.parse({"tuning": SMALL_TUNING}, "test").tuning
    designs: dict[str, Config] = {}

    def design(config: Config, *more: Any) -> Config:
        key = config.to_json()
        if key not in designs:
            designs[key] = found(config.model_copy(update={"tuning": small}), *more)
        return designs[key]

    monkeypatch.setattr(candidate, "tuned", design)
    sil = ("sil", "--build", BUILD, "--csv", "run.csv")
    alone = answer_of(run, *sil)["metrics"]
    record = Path("run.csv").read_bytes()
    answer = run(*sil, "--baselines", "--plot", "run.png")
    assert answer.out.splitlines()[1].split() == ["controlled", "tracking", "feedforward", "proportional", "passive"]
    assert Path("run.csv").read_bytes() == record and Path("run.png").read_bytes().startswith(MAGIC)
    framed, direct = (answer_of(run, *sil, "--baselines", *more)["metrics"] for more in (("--can",), ()))
    assert direct["controlled"] == alone["controlled"]
    assert direct["tracking"]["overshoot_percent"] < 2.0 < direct["controlled"]["overshoot_percent"]
    assert framed["feedforward"] != direct["feedforward"]
    steady = direct["feedforward"]["yaw_rate_steady_deg_s"]
    assert framed["feedforward"]["yaw_rate_steady_deg_s"] == pytest.approx(steady, rel=1e-2)


def test_hil_in_real_time_reports_times(run: Run, here: Path) -> None:
    Path("short.toml").write_text('name = "quick"\nbase = "ecu-loss"\nduration_s = 10.2\n', encoding="utf-8")
    bus = ("--bus", "virtual:real-time", "--ecu", "cffi", "--real-time")
    figures = answer_of(run, "hil", "--build", BUILD, *bus, "--scenario", "short.toml")["bus_figures"]
    assert figures["cycles"] == 1020
    assert figures["times"]["response_median_ms"] > 0.0
    assert figures["cycles_in_status"]["FAIL_SAFE"] > 0  # the second without an ECU


def test_the_trim_is_raised_to_the_need_of_a_map_of_the_nonlinear_tyre(run: Run, here: Path) -> None:
    map_path = solve(write_config(grid=(31, 41), more=NONLINEAR), "nonlinear")
    answer = run("tune", "--map", map_path, "-o", map_path)
    assert answer.code == 0, answer
    trim = stored(map_path).controller.tracking.trim_max_percent
    assert trim > 1.0 and trim == int(trim)
    assert f"controller.tracking.trim_max_percent: {trim:g} instead of 1; " in answer.out
    assert "trim_max_percent" not in answer_of(run, "tune", "--map", map_path, "-o", map_path)  # enough now
    build = run("build", "--map", map_path, "-o", "x")
    assert build.code == 0 and "slip bounds" not in build.err


def test_a_grid_too_coarse_for_any_trim(run: Run, here: Path) -> None:
    map_path = solve(write_config(more=NONLINEAR), "nonlinear")
    for changed in ("20 instead of 1", "20"):  # the second time it stays
        answer = run("tune", "--map", map_path, "-o", map_path)
        assert f"controller.tracking.trim_max_percent: {changed}, the largest, and not enough: " in answer.out
        assert "a finer [grid]" in answer.out.splitlines()[-1]
    assert stored(map_path).controller.tracking.trim_max_percent == 20.0
    data = run("build", "--map", map_path, "-o", "x").err
    assert "no trim takes back so much, and a finer [grid]" in data and "keeps them" not in data


def test_breakpoints_for_an_error_and_a_size(run: Run, maps: dict[str, Path]) -> None:
    options = ("build", "--map", maps["linear"], "--max-error", "0.01rad/s", "--storage", "int16", "-o", "x")
    first = run(*options)
    assert first.code == 0 and "breakpoints, " in first.out and "bytes: at most" in first.out
    assert run(*options, "--check").code == 0
    assert run(*options[:5], "-o", "x", "--check").code == 1
    assert "--max-error 0.01rad/s --storage int16 -o DIR" in Path("x/README.md").read_text(encoding="ascii")
    data = answer_of(run, *options, "--max-flash", "1kB")["placement"]
    assert data["flash_bytes"] <= 1000 and data["error_rad_s"] <= data["error_whole_domain_rad_s"] <= 0.01
    stored_options = json.loads(Path("x/manifest.json").read_bytes())["options"]
    assert stored_options.items() >= {"max_error_rad_s": 0.01, "max_flash_bytes": 1000, "storage": "int16"}.items()


def test_the_instructions_are_those_of_the_check_of_budgets(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are counted in another process, so the function must be one that can be sent there."""
    monkeypatch.setattr("codegen.verify.budgets.measure.SAMPLES", 60)
    monkeypatch.setattr("codegen.verify.budgets.measure.ROUNDS", 1)
    subject = Subject.read(BUILD)
    found = pickle.loads(pickle.dumps(instructions_of_step))(subject.files, subject.manifest)
    expected = measure(subject, Effort()).counts["controller_step"].with_limiter
    assert expected is not None and found == expected.largest > 200


def test_the_table_and_the_json_of_tune_show_the_stored_schedule(run: Run, solved: Path) -> None:
    answer = run("tune", "--map", solved, "-o", "tuned.npz")
    schedule = stored(Path("tuned.npz")).controller.tracking.schedule
    assert schedule is not None
    lines = answer.out.splitlines()
    demands = "at least 8 dB, 45 deg, and a peak sensitivity of at most 1.8"
    assert lines[0] == f"tuned.npz: 9 cars, delay of 1 samples; asked for: {demands}"
    columns = ("speed_km_h", "proportional_gain_s", "integral_gain", "gain_margin_db", "phase_margin_deg", "sensitivity")
    rows = [line.split() for line in lines[4:-1]]
    for number, name in enumerate(columns):
        assert [float(row[number]) for row in rows] == getattr(schedule, name)
    result = answer_of(run, "tune", "--map", solved, "-o", "tuned.npz")
    assert (result["configuration"], result["family"], result["configured_car"]["enough"]) == ("map", 9, True)
    assert result["demands"] == {"gain_margin_db": 8.0, "phase_margin_deg": 45.0, "sensitivity_max": 1.8}
    assert [row["integral_gain"] for row in result["breakpoints"]] == schedule.integral_gain
    factors = {"mass_factor", "front_stiffness_factor", "rear_stiffness_factor"}
    assert result["breakpoints"][0]["limiting"].keys() == {"actuator_lag", "relaxation_length", *factors}


def test_a_given_configuration_counts_and_is_stored(run: Run, solved: Path) -> None:
    """Also for a user's own table, which has none. The output may be the map itself, and a second run changes nothing."""
    speeds = "[controller.inputs]\nspeed_max_km_h = "
    other = write_config((f"{speeds}400.0", f"{speeds}150.0"))
    speed, angle = np.array([5.0, 15.0, 30.0]), np.array([0.02, 0.05, 0.1])
    np.savez("bare.npz", vx=speed, delta_f=angle, yaw_rate=np.minimum(np.outer(speed / 3.2, angle), 5.0 / speed[:, np.newaxis]))
    for path in (solved, Path("bare.npz")):
        before = npz.load(path)
        assert answer_of(run, "tune", "--map", path, "--config", other, "-o", path)["configuration"] == "ars.toml"
        controller, after = stored(path).controller, npz.load(path)
        assert (controller.kind, controller.inputs.speed_max_km_h) == ("tracking", 150.0)
        assert controller.tracking.schedule is not None and controller.tracking.schedule.speed_km_h[-1] == 150.0
        assert after.case == before.case
        np.testing.assert_array_equal(before.yaw_rate, after.yaw_rate)
        first = path.read_bytes()
        assert run("tune", "--map", path, "-o", path).code == 0
        assert path.read_bytes() == first
