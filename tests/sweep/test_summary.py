"""The summary of a campaign compared with NumPy over the whole table."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from codegen.report.campaign import CRITERIA, markdown, pictures, sections
from codegen.sweep.plan import Plan
from codegen.sweep.summary import BINS, JUDGED, QUANTILES, WORST, Summary, _count_failures, summarise


@pytest.fixture(scope="module")
def summary(whole: Path, plan: Plan) -> Summary:
    assert pq.ParquetFile(whole).num_row_groups > 1
    return summarise(whole, plan)


def rows_of(whole: Path, key: tuple[str, str]) -> pd.DataFrame:
    table = pq.read_table(whole).to_pandas()
    return table[(table.scenario == key[0]) & (table.controller == key[1])]


def test_every_figure_and_the_worst_runs(whole: Path, summary: Summary) -> None:
    compared = 0
    for key, outcome in summary.outcomes.items():
        rows = rows_of(whole, key)
        assert (outcome.runs, outcome.spun) == (len(rows), rows.spun_at_s.notna().sum())
        for name, figure in outcome.figures.items():
            values = rows[name].dropna().to_numpy(dtype=np.float64)
            assert figure.count == values.size
            scale = max(np.abs(values).max(), 1e-300)
            # Rounding of sums over some hundred values.
            assert figure.mean == pytest.approx(values.mean(), abs=1e-13 * scale)
            assert figure.deviation == pytest.approx(values.std(), abs=1e-7 * scale)
            assert (figure.low, figure.high) == (values.min(), values.max())
            for share, found in zip(QUANTILES, figure.quantiles, strict=True):
                wanted = np.sort(values)[int(np.ceil(share * values.size)) - 1]
                assert abs(found - wanted) <= (figure.high - figure.low) / BINS * (1 + 1e-9)
            compared += 1
        for name, worst in outcome.worst.items():
            ordered = rows[rows[name].notna()].sort_values(name, ascending=not JUDGED[name], kind="stable")
            assert [one.run for one in worst] == ordered.run.tolist()[:WORST]
        spins = rows[rows.spun_at_s.notna()].sort_values(["spun_at_s", "run"])
        assert [one.run for one in outcome.first_spins] == spins.run.tolist()[:WORST]
    assert compared > 30


@pytest.mark.parametrize("name", ["pi", "passive"])
def test_the_criteria_of_fmvss_126_that_runs_fail(whole: Path, plan: Plan, summary: Summary, name: str) -> None:
    assert "fmvss_126_failed_by" not in summary.outcomes["step-steer", name].to_dict()
    rows = rows_of(whole, ("sine-with-dwell", name))
    assert (plan.config.vehicle.mass_kg * (1.0 + rows.mass_percent / 100.0)).max() < 3500.0
    fails = {
        "spin": rows.spun_at_s.notna(),
        "yaw_rate_ratio_1_00_s": rows.yaw_rate_ratio_1_00_s_percent > 35.0,
        "yaw_rate_ratio_1_75_s": rows.yaw_rate_ratio_1_75_s_percent > 20.0,
        "lateral_displacement": rows.lateral_displacement_m < 1.83,
    }
    found = summary.outcomes["sine-with-dwell", name].to_dict()["fmvss_126_failed_by"]
    assert found == {criterion: int(where.sum()) for criterion, where in fails.items()}
    # Together they are exactly the failing runs.
    assert (np.any(list(fails.values()), axis=0) == (rows.meets_fmvss_126 == False)).all()  # noqa: E712
    expected = "Fail by: spin {}, ratio at 1 s {}, ratio at 1.75 s {}, lateral displacement {}".format(*found.values())
    assert expected in " ".join(dict(sections(summary))[f"sine-with-dwell, {name}"].split())


def test_a_heavy_car_fails_by_less_displacement(plan: Plan) -> None:
    nan, mass = np.nan, plan.config.vehicle.mass_kg
    table = {
        "spun_at_s": np.array([nan, nan, 2.0]),
        "mass_percent": 100.0 * (np.array([3499.0, 3501.0, 3501.0]) / mass - 1.0),
        "yaw_rate_ratio_1_00_s_percent": np.array([36.0, 35.0, nan]),
        "yaw_rate_ratio_1_75_s_percent": np.array([0.0, 21.0, nan]),
        "lateral_displacement_m": np.array([1.7, 1.7, 1.5]),
    }
    failed_by: dict[str, int] = {}
    for _ in range(2):  # a file of two groups of rows
        _count_failures(failed_by, table, plan)
    assert failed_by == dict(zip(CRITERIA, (2, 2, 2, 4), strict=True))


def test_text_and_pictures(summary: Summary) -> None:
    text = dict(sections(summary))
    assert list(text) == [f"{scenario}, {controller}" for scenario, controller in summary.outcomes]
    assert "meet FMVSS 126" in text["sine-with-dwell, tracking"]
    page = markdown(summary, "codegen sweep --spec s.toml --replay")
    assert page.count("## ") == len(summary.outcomes)
    assert page.endswith("```\ncodegen sweep --spec s.toml --replay RUN\n```\n")
    assert [name for name, _ in pictures(summary)] == ["overshoot", "map-error", "sideslip", "ratio", "displacement"]
