"""The summary of a campaign against NumPy over the whole table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from codegen.report.sweep_plots import pictures
from codegen.report.sweep_text import markdown, sections
from codegen.sweep import store
from codegen.sweep.campaign import run_campaign
from codegen.sweep.engine import Threads
from codegen.sweep.plan import Plan
from codegen.sweep.summary import BINS, JUDGED, QUANTILES, WORST, Summary, summarise


@pytest.fixture(scope="module")
def path(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file in several groups of rows, as long campaigns have it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "ROWS_PER_GROUP", 400)
        return run_campaign(plan, tmp_path_factory.mktemp("campaign") / "out", Threads(1))


@pytest.fixture(scope="module")
def summary(path: Path, plan: Plan) -> Summary:
    return summarise(path, plan)


def test_it_was_read_in_several_groups(path: Path) -> None:
    assert pq.ParquetFile(path).num_row_groups > 1


def test_every_figure_of_every_group(path: Path, plan: Plan, summary: Summary) -> None:
    table = pq.read_table(path).to_pandas()
    compared = 0
    for (scenario, controller), outcome in summary.outcomes.items():
        rows = table[(table.scenario == scenario) & (table.controller == controller)]
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
    assert compared > 30


def test_the_worst_are_the_worst(path: Path, summary: Summary) -> None:
    table = pq.read_table(path).to_pandas()
    for (scenario, controller), outcome in summary.outcomes.items():
        rows = table[(table.scenario == scenario) & (table.controller == controller)]
        for name, found in outcome.worst.items():
            ordered = rows[rows[name].notna()].sort_values(name, ascending=not JUDGED[name], kind="stable")
            assert [one.run for one in found] == ordered.run.tolist()[:WORST]
        spins = rows[rows.spun_at_s.notna()].sort_values(["spun_at_s", "run"])
        assert [one.run for one in outcome.first_spins] == spins.run.tolist()[:WORST]


def test_text_and_pictures(summary: Summary) -> None:
    told = dict(sections(summary, "codegen sweep --spec s.toml --replay"))
    assert list(told) == [f"{scenario}, {controller}" for scenario, controller in summary.outcomes]
    assert "codegen sweep --spec s.toml --replay " in told["step-steer, pi"]
    assert "meets FMVSS 126" in told["sine-with-dwell, tracking"]
    assert markdown(summary, "again").count("## ") == len(summary.outcomes)
    assert [name for name, _ in pictures(summary)] == ["overshoot", "sideslip", "ratio", "displacement"]
