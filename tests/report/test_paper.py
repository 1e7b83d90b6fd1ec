"""The paper reproduced: its tables within what its rounding and its plant allow, and README's figures as they come out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from codegen.report.paper import Reproduction, reproduce
from codegen.report.published import PAPER_TABLE

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    return reproduce(tmp_path_factory.mktemp("paper") / "build")


@pytest.mark.parametrize(("speed_km_h", "tolerance_percent"), [(43.9, 2.0), (43.35, 0.6)])
def test_yaw_rates_of_the_table(reproduction: Reproduction, speed_km_h: float, tolerance_percent: float) -> None:
    """2 % at the speed that the table names; 0.6 % at the one where its rows fit, which is what its rounding leaves."""
    rows = [row for row in reproduction.table if row.speed_km_h == speed_km_h]
    assert [row.case for row in rows] == list(PAPER_TABLE)
    for row in rows:
        assert abs(row.yaw_rate_difference_percent) <= tolerance_percent, row


def test_gain_of_4ws2_over_fws(reproduction: Reproduction) -> None:
    """The paper prints +38.1 %; the optimum at its speed is +37.8 %, and half a percent tells it from the next grid column."""
    fws, _, four = (row.yaw_rate_deg_s for row in reproduction.table[:3])
    assert 100.0 * (four / fws - 1.0) == pytest.approx(37.8, abs=0.5)


@pytest.mark.parametrize(("name", "steady"), [("C1", 27.25), ("C2", 25.4)])
def test_steady_yaw_rate_of_the_runs(reproduction: Reproduction, name: str, steady: float) -> None:
    """The integrator takes the car to its reference: 27.233 and 25.393 deg/s, asked for within 0.1."""
    run = reproduction.runs[name]
    assert run.yaw_rate_steady_deg_s == pytest.approx(steady, abs=0.1)
    assert run.yaw_rate_reference_deg_s is not None
    # Steady means that: after five seconds what is left of the transient is far below the last digit that is printed.
    assert run.yaw_rate_steady_deg_s == pytest.approx(run.yaw_rate_reference_deg_s, abs=1e-3)


def test_peak_is_told_apart_from_the_steady_value(reproduction: Reproduction) -> None:
    run = reproduction.runs["C1"]
    # The printed PI on a reference that jumps: 30.8 deg/s with an actuator lag of 2 ms, 31.7 with the 50 ms of the preset.
    assert 31.6 < run.yaw_rate_peak_deg_s < 31.8
    text = "\n".join(reproduction.lines())
    for words in ("steady, here", "peak, here", "paper's maximum", "rear angle, smallest", "|front slip|", "|sideslip|"):
        assert words in text


def test_passive_car_has_no_reference(reproduction: Reproduction) -> None:
    assert reproduction.passive.yaw_rate_reference_deg_s is None
    assert reproduction.passive.rear_angle_min_deg == reproduction.passive.rear_angle_max_deg == 0.0


def test_everything_that_is_named_was_written(reproduction: Reproduction) -> None:
    for path in reproduction.outputs.values():
        assert path.exists(), path
    json.dumps(reproduction.to_dict(), allow_nan=False)


def test_output_in_the_readme_is_what_comes_out(reproduction: Reproduction) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = re.search(r"\$ make sil\n(.*?)```", readme, re.DOTALL)
    assert shown is not None
    printed = set(reproduction.lines())
    lines = [line for line in shown.group(1).splitlines() if line != "..."]
    assert len(lines) > 10
    for line in lines:
        assert line in printed, line
