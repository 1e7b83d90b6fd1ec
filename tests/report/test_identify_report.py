"""Report of `codegen identify`: bands of the tyre curves, numbers, signals and findings."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from codegen import configuration
from codegen.identify.reading import read_drives
from codegen.identify.summary import significant, whiteness_rows
from codegen.identify.validation import Whiteness
from codegen.report.html.identify import BAND_CARS, _curves, data_section
from codegen.report.html.page import Table, render
from tests.report.figures import unpacked

DEVIATION = 0.02


def curves(config: configuration.Config) -> Any:
    reached: Any = SimpleNamespace(slip=(0.05, 0.05))
    return [chart.figure["data"] for chart in _curves(cast(Any, SimpleNamespace(config=config)), config, reached)]


def test_the_band_of_a_tyre_is_that_of_its_stiffness_where_the_curve_is_straight() -> None:
    data = configuration.preset().model_dump(mode="json", exclude_none=True)
    key, stiffness = "cornering_stiffness_n_per_rad", data["tyre"]["front"]["cornering_stiffness_n_per_rad"]
    data["identified"] = {
        "keys": [f"tyre.front.{key}"],
        "standard_deviations": [DEVIATION * stiffness],
        "correlations": [[1.0]],
        "interval_floor_percent": 0.0,
    }
    front, rear = curves(configuration.parse(data, "test"))
    band, identified = front[0], front[1]
    assert band["name"] == "95 % band"
    low, high = np.split(unpacked(band["y"]), 2)
    width = (high[::-1] - low)[1] / unpacked(identified["y"])[1]
    # The quantiles of n draws have a standard error of sqrt(p (1 - p) / n) over the density; four of both.
    error = 2**0.5 * (0.025 * 0.975 / BAND_CARS) ** 0.5 / 0.0584
    assert width == pytest.approx(2.0 * 1.96 * DEVIATION, abs=4.0 * error * DEVIATION)
    low, high = np.split(unpacked(rear[0]["y"]), 2)
    assert (low == high[::-1]).all()


def test_there_is_no_band_without_measured_uncertainty() -> None:
    front, rear = curves(configuration.preset())
    assert [one["name"] for one in front] == [one["name"] for one in rear] == ["identified", "configured"]


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (119_544.2, 5, "119540"),
        (-957.0, 2, "-960"),
        (0.00049, 2, "0.00049"),
        (1.0, 5, "1"),
        (0.0, 5, "0"),
        (13.333333, 5, "13.333"),
    ],
)
def test_large_numbers_have_no_exponent(value: float, digits: int, text: str) -> None:
    assert significant(value, digits) == text


def test_a_large_statistic_has_no_exponent() -> None:
    test = Whiteness(0.996, 15_834.2, 20, 0.0)
    assert whiteness_rows(cast(Any, SimpleNamespace(whiteness={"yaw_rate": test})))[0][2] == "15830"


def test_signals_and_findings_are_in_the_report(tmp_path: Path) -> None:
    time = np.arange(0.0, 8.0, 0.01)
    wave = np.sin(np.pi * time)
    table = {"time_s": time, "vx_m_s": np.full(time.size, 20.0), "yaw_rate_rad_s": 0.1 * np.where(time < 4.0, wave, 0.0)}
    pd.DataFrame({**table, "delta_f_rad": 0.02 * wave}).to_csv(tmp_path / "drive.csv", index=False)
    section = data_section(read_drives([tmp_path / "drive.csv"]))
    identifiers = re.findall(r' id="([^"]+)"', render("Identification", [section]).decode("utf-8"))
    assert len(identifiers) == len(set(identifiers)), "the script of the page finds its data by an identifier"
    signals, findings = section.blocks
    assert isinstance(signals, Table)
    assert isinstance(findings, Table)
    assert [row[:3] for row in signals.rows] == [
        ("drive", "vx", "vx_m_s"),
        ("drive", "yaw_rate", "yaw_rate_rad_s"),
        ("drive", "delta_f", "delta_f_rad"),
    ]
    assert [row[:4] for row in findings.rows] == [("drive", "yaw_rate", "frozen", "400")]
