"""Recordings and metrics against numbers that were made by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from codegen.errors import CodegenError
from codegen.sil.software import RECORD_COLUMNS
from hil_sim.metrics import step_metrics
from hil_sim.recording import load_csv, save_csv, to_csv
from hil_sim.scenarios import find


def record(sign: float = 1.0, status: float = 0.0) -> np.ndarray:
    """10 ms rows for 6 s: from 2 s on the yaw rate rises in 0.5 s to 0.6 rad/s and falls to 0.5 until 3 s."""
    made = np.zeros((600, len(RECORD_COLUMNS)))
    time = np.arange(600) * 0.01
    made[:, RECORD_COLUMNS.index("time_s")] = time
    made[:, RECORD_COLUMNS.index("yaw_rate_rad_s")] = sign * np.interp(time, [2.0, 2.5, 3.0], [0.0, 0.6, 0.5])
    made[:, RECORD_COLUMNS.index("yaw_rate_reference_rad_s")] = sign * 0.5
    made[:, RECORD_COLUMNS.index("status")] = status
    return made


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_step_response(sign: float) -> None:
    found = step_metrics(record(sign), 2.0)
    assert found.settled
    assert found.yaw_rate_steady_deg_s == pytest.approx(sign * math.degrees(0.5))
    assert found.yaw_rate_peak_deg_s == pytest.approx(sign * math.degrees(0.6))
    assert found.overshoot_percent == pytest.approx(20.0)
    assert found.yaw_rate_reference_deg_s == pytest.approx(sign * math.degrees(0.5))
    # 90 % of 0.5 rad/s lies 0.375 s up the ramp; the row at or after it counts.
    assert found.rise_time_s == pytest.approx(0.38)


def test_no_reference_without_control() -> None:
    assert step_metrics(record(status=2.0), 2.0).yaw_rate_reference_deg_s is None


def test_swinging_run_is_not_settled() -> None:
    made = record()
    made[500:, RECORD_COLUMNS.index("yaw_rate_rad_s")] += 0.01 * np.sin(np.arange(100))
    assert not step_metrics(made, 2.0).settled


def test_csv_reads_back_to_the_same_bits(tmp_path: Path) -> None:
    made = record(status=3.0)
    made[:, 3] = np.random.default_rng(1).normal(size=600)
    save_csv(made, tmp_path / "run.csv")
    np.testing.assert_array_equal(load_csv(tmp_path / "run.csv"), made)
    assert to_csv(made).splitlines()[1].endswith(b",3")


@pytest.mark.parametrize(
    "text", ["", "a,b\n", ",".join(RECORD_COLUMNS) + "\n1,2\n", ",".join(RECORD_COLUMNS) + "\n" + "x," * 11 + "1\n"]
)
def test_csv_that_is_no_run(tmp_path: Path, text: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text)
    with pytest.raises(CodegenError, match=r"run\.csv"):
        load_csv(path)


def test_scenario_is_the_papers() -> None:
    scenario = find("step-steer")
    from codegen import config

    inputs = scenario.inputs(config.preset())
    assert inputs.shape == (15_000, 6)
    np.testing.assert_allclose(inputs[:, 0], 42.5 / 3.6)
    assert inputs[9_999, 1] == 0.0
    assert inputs[10_000, 1] == pytest.approx(math.radians(90.0))
