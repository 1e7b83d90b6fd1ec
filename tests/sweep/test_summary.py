"""The summary of a campaign against NumPy over the whole table."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from matplotlib.axes import Axes

from codegen.report.style import to_png
from codegen.report.sweep_plots import pictures
from codegen.report.sweep_text import CRITERIA, TITLES, factors_of, markdown, sections, short
from codegen.sweep.plan import Plan
from codegen.sweep.spec import FACTORS
from codegen.sweep.summary import BINS, JUDGED, QUANTILES, WORST, Figure, Outcome, Summary, Worst, _count_failures, summarise


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
    # Together they are the runs that fail, and no others.
    assert (np.any(list(fails.values()), axis=0) == (rows.meets_fmvss_126 == False)).all()  # noqa: E712
    told = "Fail by: spin {}, ratio at 1 s {}, ratio at 1.75 s {}, lateral displacement {}".format(*found.values())
    assert told in " ".join(dict(sections(summary))[f"sine-with-dwell, {name}"].split())


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
    """Every line has at most 80 columns, with the widest numbers too."""
    text = dict(sections(summary))
    assert list(text) == [f"{scenario}, {controller}" for scenario, controller in summary.outcomes]
    assert "meet FMVSS 126" in text["sine-with-dwell, tracking"]
    page = markdown(summary, "codegen sweep --spec s.toml --replay")
    assert page.count("## ") == len(summary.outcomes)
    assert page.endswith("```\ncodegen sweep --spec s.toml --replay RUN\n```\n")
    assert [name for name, _ in pictures(summary)] == ["overshoot", "sideslip", "ratio", "displacement"]
    widest = {name: Figure(1_000_000, -12.345, 1.0, -0.0123, 1234.5, (-1.234, -99.99, 123456.0)) for name in TITLES}
    worst, failed_by = {name: [Worst(99_999_999, -1234.5)] for name in JUDGED}, dict.fromkeys(CRITERIA, 100_000_000)
    wide = {
        ("s", str(k)): Outcome(100_000_000, 5, {**outcome.figures, **widest}, worst, failed_by=failed_by)
        for k, outcome in enumerate(summary.outcomes.values())
    }
    for one in (summary, replace(summary, outcomes=wide)):
        assert max(len(line) for _, part in sections(one) for line in part.splitlines()) <= 80


def test_numbers_of_the_tables() -> None:
    values = {0.0007: "0.00", -0.0007: "0.00", 0.2234: "0.223", -0.2234: "-0.22", 12.34: "12.3", 1234.5: "1234", 9e5: "9e+05"}
    assert {value: short(value) for value in values} == values


def entries(axes: Axes) -> list[str]:
    return [text.get_text().replace("\n", " ") for text in axes.get_legend().get_texts()]


def of_ratios(*parts: np.ndarray) -> Axes:
    """The panel of one controller in a sine with dwell, with 1000 ratios in percent."""
    figure, values = Figure(), np.concatenate(parts)
    figure.add(values)
    figure.sort_in(values)
    figure.finish()
    outcome = Outcome(1000, 0, {"yaw_rate_ratio_1_75_s_percent": figure})
    ((_, picture),) = pictures(Summary({("sine-with-dwell", "pi"): outcome}, 1000))
    (axes,) = picture.axes
    return axes


@pytest.mark.parametrize(
    ("low", "high", "drawn"),
    [(-0.5, 0.5, False), (0.0, 0.0, False), (30.0, 31.0, False), (-0.5, 12.0, True), (-1.0, 50.0, True)],
)
def test_a_limit_far_from_the_data_is_told_in_words(low: float, high: float, drawn: bool) -> None:
    axes = of_ratios(np.linspace(low, high, 1000))
    left, right = axes.get_xlim()
    assert (left <= 20.0 <= right) == drawn
    (label,) = [text for text in entries(axes) if "limit" in text]
    assert label.startswith("limit of FMVSS 126, 20 % at most")
    assert ("far to the" in label) == (not drawn)
    assert ("left" in label) == (low > 20.0)


def test_runs_far_out_do_not_set_the_axis_or_get_few_plain_ticks() -> None:
    axes = of_ratios(np.linspace(-2.0, 3.0, 990), np.linspace(150.0, 200.0, 10))
    left, right = axes.get_xlim()
    assert -20.0 < left < -2.0 and 20.0 < right < 40.0
    assert "1 % of the runs lie beyond the axis" in entries(axes)
    axes = of_ratios(np.linspace(-5.0, 5.0, 990), -np.geomspace(100.0, 40_000.0, 10))
    assert axes.get_xscale() == "symlog"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["-100000", "-10000", "-1000", "-100", "0", "100"]


def test_long_names_fit_into_the_picture_and_a_controller_that_only_spins_has_its_entry(summary: Summary) -> None:
    long = dict(zip(("pi", "tracking", "passive"), ("W" * 63, "i" * 63, ("a_b " * 16)[:63]), strict=True))
    outcomes = {(scenario, long[controller]): outcome for (scenario, controller), outcome in summary.outcomes.items()}
    spun = outcomes["sine-with-dwell", long["tracking"]].runs
    outcomes["sine-with-dwell", long["tracking"]] = Outcome(spun, spun)
    picture = dict(pictures(replace(summary, outcomes=outcomes)))["sideslip"]
    to_png(picture)
    whole, (left, right) = picture.bbox.padded(1.0), [axes.get_legend().get_window_extent() for axes in picture.axes]
    assert whole.x0 <= left.x0 and left.x1 < right.x0 and right.x1 <= whole.x1 and whole.y0 <= min(left.y0, right.y0)
    assert [sum("100 % spun" in entry for entry in entries(axes)) for axes in picture.axes] == [0, 1]
    # in: the curves keep their height beside the legends
    assert min(axes.get_window_extent().height for axes in picture.axes) / picture.dpi > 2.5


def test_the_factors_of_a_run_in_words() -> None:
    row = dict.fromkeys(FACTORS, 12.3456) | {"delay_samples": 2.0, "mass_percent": -0.0, "overshoot_percent": 7.0}
    assert factors_of(row).replace("\N{NO-BREAK SPACE}", " ") == (
        "mass +0 %, yaw inertia +12.3 %, cg shift +12.3 m, front stiffness +12.3 %, rear stiffness +12.3 %, tyre peak +12.3 %, "
        "rear lag 12.3 s, delay 2 samples, speed noise 12.3 m/s, front angle noise 12.3 deg, yaw rate noise 12.3 deg/s"
    )
    assert "+12.3\N{NO-BREAK SPACE}m," in factors_of(row)  # no line of a title ends between a number and its unit
    assert factors_of({"friction": 0.5}) == ""
