"""Commands with long searches or simulations."""

import json
from pathlib import Path
from typing import Any

import pytest

from hil_sim.suite import subjects
from tests.cli.conftest import BUILD, MAP, Run
from tests.cli.test_suite_command import SMALL_TUNING
from tests.cli.test_tune import NONLINEAR, solve, stored, write_config
from tests.whole_car import car

pytestmark = pytest.mark.long
MAGIC = b"\x89PNG"


def answer_of(run: Run, *arguments: object) -> Any:
    """Return the JSON output of a successful command."""
    answer = run(*arguments, "--json")
    assert answer.code == 0, answer
    return json.loads(answer.out)


def test_a_report_of_a_build_with_injected_faults(run: Run, here: Path) -> None:
    data = answer_of(run, "report", "--map", MAP, "--build", BUILD, "-o", "report.html")
    assert (data["notes"], data["bytes"]) == ([], Path("report.html").stat().st_size)
    assert {"runs", "margins", "map-loss", "compare-difference-1"} <= set(data["charts"])
    text = Path("report.html").read_text(encoding="utf-8")
    assert all(f'<th scope="col" class="number">{name}</th>' in text for name in ("pi", "tracking", "passive car"))
    assert "4 samples lost: one too many" in text


def test_baselines_of_a_scenario(run: Run, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames are included: their quantisation affects the baselines too."""
    found, small = subjects.tuned, car({"tuning": SMALL_TUNING}).tuning
    monkeypatch.setattr(
        subjects, "tuned", lambda solved, config, *more: found(solved, config.model_copy(update={"tuning": small}), *more)
    )
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


def test_the_trim_is_raised_as_a_nonlinear_map_requires(run: Run, here: Path) -> None:
    map_path = solve(write_config(grid=(31, 41), more=NONLINEAR), "nonlinear")
    answer = run("tune", "--map", map_path, "-o", map_path)
    assert answer.code == 0, answer
    trim = stored(map_path).controller.tracking.trim_max_percent
    assert trim > 1.0 and trim == int(trim)
    assert f"controller.tracking.trim_max_percent: {trim:g} instead of 1; " in answer.out
    assert "trim_max_percent" not in answer_of(run, "tune", "--map", map_path, "-o", map_path)  # sufficient now
    build = run("build", "--map", map_path, "-o", "x")
    assert build.code == 0 and "trim" not in build.err


def test_breakpoints_for_an_error_or_a_size(run: Run, maps: dict[str, Path]) -> None:
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
