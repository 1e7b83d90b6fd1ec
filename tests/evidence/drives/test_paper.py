"""Reproduction of the paper's tables within their rounding and plant, printed as in the README."""

import json
import re
from pathlib import Path

import pytest

from codegen.figures.paper_tables import PAPER_TABLE
from codegen.report.paper import Reproduction, reproduce

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    told: list[tuple[int, int, str]] = []
    made = reproduce(tmp_path_factory.mktemp("paper") / "build", lambda *step: told.append(step))
    count = len(told) - 1
    assert [step[:2] for step in told] == [(k, count) for k in range(count + 1)]
    assert [bool(step[2]) for step in told] == [True] * count + [False]  # every part is named before it begins
    return made


def test_yaw_rates_of_the_table(reproduction: Reproduction) -> None:
    """Tolerance: 2 % at the speed that the table names; at the speed that fits its rows, the rounding, 0.6 %."""
    for speed_km_h, tolerance_percent in ((43.9, 2.0), (43.35, 0.6)):
        rows = [row for row in reproduction.table if row.speed_km_h == speed_km_h]
        assert [row.case for row in rows] == list(PAPER_TABLE)
        assert max(abs(row.yaw_rate_difference_percent) for row in rows) <= tolerance_percent
    # The paper prints +38.1 %; the optimum at its speed is +37.8 %, and the next grid column is half a percent away.
    fws, _, four = (row.yaw_rate_deg_s for row in reproduction.table[:3])
    assert 100.0 * (four / fws - 1.0) == pytest.approx(37.8, abs=0.5)


def test_steady_values_and_peak_of_the_runs(reproduction: Reproduction) -> None:
    """The integrator brings the car to its reference: 27.233 and 25.393 deg/s, required within 0.1."""
    for name, steady in (("C1", 27.25), ("C2", 25.4)):
        run = reproduction.runs[name]
        assert run["yaw_rate_steady_deg_s"] == pytest.approx(steady, abs=0.1)
        # After five seconds the transient is far below the last printed digit.
        assert run["yaw_rate_steady_deg_s"] == pytest.approx(run["yaw_rate_reference_deg_s"], abs=1e-3)
    # The printed PI on a reference that jumps: 30.8 deg/s with an actuator lag of 2 ms, 31.7 with the 50 ms of the preset.
    assert 31.6 < reproduction.runs["C1"]["yaw_rate_peak_deg_s"] < 31.8
    assert reproduction.passive["yaw_rate_reference_deg_s"] is None
    assert reproduction.passive["rear_angle_min_deg"] == reproduction.passive["rear_angle_max_deg"] == 0.0


def test_outputs_are_written_and_printed_as_in_the_readme(reproduction: Reproduction) -> None:
    assert all(path.exists() for path in reproduction.outputs.values())
    json.dumps(reproduction.to_dict(), allow_nan=False)
    shown = re.search(r"\$ codegen paper -o build\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert shown is not None
    lines = [line for line in shown[1].splitlines() if line != "..."]
    assert len(lines) > 10 and set(lines) <= set(reproduction.lines())
