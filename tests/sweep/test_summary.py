"""The summary of a campaign against NumPy over the whole table."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib.axes import Axes

from codegen.report.style import to_png
from codegen.report.sweep_plots import pictures
from codegen.report.sweep_text import CRITERIA, TITLES, factors_of, markdown, sections, short
from codegen.sweep import plan as planning
from codegen.sweep import store
from codegen.sweep.campaign import run_campaign
from codegen.sweep.chunk import Table, run_chunk
from codegen.sweep.engine import Threads
from codegen.sweep.plan import Plan
from codegen.sweep.spec import FACTORS
from codegen.sweep.summary import BINS, JUDGED, QUANTILES, WORST, Figure, Outcome, Summary, Worst, _count_failures, summarise

RUNS_PER_SAMPLE = 6


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


def test_what_fmvss_126_is_failed_by(path: Path, plan: Plan, summary: Summary) -> None:
    table = pq.read_table(path).to_pandas()
    told = dict(sections(summary))
    assert all(not outcome.failed_by for (scenario, _), outcome in summary.outcomes.items() if scenario == "step-steer")
    assert "fmvss_126_failed_by" not in summary.outcomes["step-steer", "pi"].to_dict()
    for name in ("pi", "tracking", "passive"):
        rows = table[(table.scenario == "sine-with-dwell") & (table.controller == name)]
        mass = plan.config.vehicle.mass_kg * (1.0 + rows.mass_percent / 100.0)
        assert mass.max() < 3500.0
        fails = {
            "spin": rows.spun_at_s.notna(),
            "yaw_rate_ratio_1_00_s": rows.yaw_rate_ratio_1_00_s_percent > 35.0,
            "yaw_rate_ratio_1_75_s": rows.yaw_rate_ratio_1_75_s_percent > 20.0,
            "lateral_displacement": rows.lateral_displacement_m < 1.83,
        }
        found = summary.outcomes["sine-with-dwell", name].to_dict()["fmvss_126_failed_by"]
        assert found == {criterion: int(where.sum()) for criterion, where in fails.items()}
        # Together they are the runs that fail, and no others.
        union = fails["spin"] | fails["yaw_rate_ratio_1_00_s"] | fails["yaw_rate_ratio_1_75_s"] | fails["lateral_displacement"]
        assert (union == (rows.meets_fmvss_126 == False)).all()  # noqa: E712
        words = " ".join(told[f"sine-with-dwell, {name}"].split())
        assert (
            f"Fail by: spin {found['spin']}, ratio at 1 s {found['yaw_rate_ratio_1_00_s']}, "
            f"ratio at 1.75 s {found['yaw_rate_ratio_1_75_s']}, lateral displacement {found['lateral_displacement']}"
        ) in words


def test_a_heavy_car_fails_by_less_displacement(plan: Plan) -> None:
    percent = 100.0 * (np.array([3499.0, 3501.0, 3501.0]) / plan.config.vehicle.mass_kg - 1.0)
    table = {
        "spun_at_s": np.array([np.nan, np.nan, 2.0]),
        "mass_percent": percent,
        "yaw_rate_ratio_1_00_s_percent": np.array([36.0, 35.0, np.nan]),
        "yaw_rate_ratio_1_75_s_percent": np.array([0.0, 21.0, np.nan]),
        "lateral_displacement_m": np.array([1.7, 1.7, 1.5]),
    }
    failed_by: dict[str, int] = {}
    for _ in range(2):  # a file of two groups of rows
        _count_failures(failed_by, table, plan)
    assert failed_by == {
        "spin": 2,
        "yaw_rate_ratio_1_00_s": 2,
        "yaw_rate_ratio_1_75_s": 2,
        "lateral_displacement": 4,
    }


@dataclass(frozen=True)
class Invents:
    """An engine that drives nothing: one chunk again and again, with other numbers and other figures."""

    plan: Plan
    pattern: Table

    def run(self, work: object, numbers: Iterable[int]) -> Iterator[tuple[int, Table]]:
        for number in numbers:
            samples = self.plan.samples_of(number)
            run = np.arange(RUNS_PER_SAMPLE * samples.start, RUNS_PER_SAMPLE * samples.stop)
            table = {name: np.resize(values, run.size) for name, values in self.pattern.items()}
            random = np.random.default_rng(number)
            for name in table.keys() - {*store.WHOLE, *store.NAMES, *store.YES_NO}:
                table[name] = table[name] + random.random(run.size)
            yield number, {**table, "run": run, "sample": run // RUNS_PER_SAMPLE}


def most_memory(plan: Plan, pattern: Table, folder: Path, samples: int) -> list[int]:
    """Bytes while so many samples go to the disk and are counted: of pyarrow as it writes, as it reads; of Python and NumPy."""
    longer = replace(plan, spec=plan.spec.model_copy(update={"samples": samples}))
    pool = pa.default_memory_pool()
    writing = pa.proxy_memory_pool(pool)  # counts from here on
    tracemalloc.start()
    try:
        pa.set_memory_pool(writing)
        path = run_campaign(longer, folder, Invents(longer, pattern))
        pa.set_memory_pool(pool)
        assert summarise(path, longer).runs == RUNS_PER_SAMPLE * samples
        traced = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        pa.set_memory_pool(pool)
    assert pq.read_metadata(path).num_rows == RUNS_PER_SAMPLE * samples
    # What a file is buffered in comes from the pool itself, whichever is set.
    reading = max(pool.bytes_allocated() for _ in store.read_batches(path))
    return [writing.max_memory(), reading, traced]


def test_memory_does_not_grow_with_the_runs(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pattern = run_chunk(plan, 0)
    monkeypatch.setattr(planning, "RUNS_PER_CHUNK", 2048)  # fewer parts, or the disk would take most of the time
    most_memory(plan, pattern, tmp_path / "first", 100)  # what is loaded and kept does not count
    few, many = (most_memory(plan, pattern, tmp_path / str(samples), samples) for samples in (4_000, 12_000))
    # A batch that has rows of two groups holds more than one of a single group; thrice the runs would be far beyond that.
    assert all(more <= 1.2 * less for less, more in zip(few, many, strict=True)), (few, many)


def test_text_and_pictures(summary: Summary) -> None:
    told = dict(sections(summary))
    assert list(told) == [f"{scenario}, {controller}" for scenario, controller in summary.outcomes]
    assert all(len(line) <= 80 for text in told.values() for line in text.splitlines())
    assert "meet FMVSS 126" in told["sine-with-dwell, tracking"]
    text = markdown(summary, "codegen sweep --spec s.toml --replay")
    assert text.count("## ") == len(summary.outcomes)
    assert text.endswith("```\ncodegen sweep --spec s.toml --replay RUN\n```\n")
    assert [name for name, _ in pictures(summary)] == ["overshoot", "sideslip", "ratio", "displacement"]


def test_the_widest_numbers_fit_into_80_columns(summary: Summary) -> None:
    for outcome in summary.outcomes.values():
        wide = {name: Figure(1_000_000, -12.345, 1.0, -0.0123, 1234.5, (-1.234, -99.99, 123456.0)) for name in TITLES}
        worst = {name: [Worst(99_999_999, -1234.5)] for name in JUDGED}
        failed_by = dict.fromkeys(CRITERIA, 100_000_000)
        changed = replace(
            summary, outcomes={("s", "c"): Outcome(100_000_000, 5, {**outcome.figures, **wide}, worst, failed_by=failed_by)}
        )
        ((_, text),) = sections(changed)
        assert max(len(line) for line in text.splitlines()) <= 80


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0007, "0.00"),
        (-0.0007, "0.00"),
        (0.2234, "0.223"),
        (-0.2234, "-0.22"),
        (12.34, "12.3"),
        (1234.5, "1234"),
        (9e5, "9e+05"),
    ],
)
def test_numbers_of_the_tables(value: float, text: str) -> None:
    assert short(value) == text


def far_out(*, below: bool) -> Summary:
    """Some runs 1,000 times beyond the others."""
    return of_ratios(
        np.concatenate([np.linspace(-5.0, 5.0, 990), np.geomspace(100.0, 40_000.0, 10) * (-1.0 if below else 1.0)])
    )


def of_ratios(values: np.ndarray) -> Summary:
    """Of one controller in a sine with dwell, (1000,) ratios in percent."""
    figure = Figure()
    figure.add(values)
    figure.sort_in(values)
    figure.finish()
    return Summary({("sine-with-dwell", "pi"): Outcome(1000, 0, {"yaw_rate_ratio_1_75_s_percent": figure})}, 1000)


@pytest.mark.parametrize(
    ("below", "wanted"),
    [
        (False, ["0", "100", "1000", "10000", "100000"]),
        (True, ["-100000", "-10000", "-1000", "-100", "0", "100"]),
    ],
)
def test_an_axis_far_beyond_the_usual_has_few_plain_ticks(below: bool, wanted: list[str]) -> None:
    ((_, picture),) = pictures(far_out(below=below))
    (axes,) = picture.axes
    assert axes.get_xscale() == "symlog"
    assert [label.get_text() for label in axes.get_xticklabels()] == wanted


def test_an_axis_of_usual_figures_is_linear(summary: Summary) -> None:
    assert {axes.get_xscale() for _, picture in pictures(summary) for axes in picture.axes} == {"linear"}


@pytest.mark.parametrize(
    ("low", "high", "drawn"),
    [(-0.5, 0.5, False), (0.0, 0.0, False), (30.0, 31.0, False), (-0.5, 12.0, True), (-1.0, 50.0, True)],
)
def test_a_limit_far_from_the_data_is_told_in_words(low: float, high: float, drawn: bool) -> None:
    ((_, picture),) = pictures(of_ratios(np.linspace(low, high, 1000)))
    (axes,) = picture.axes
    left, right = axes.get_xlim()
    assert (left <= 20.0 <= right) == drawn
    (label,) = [text.get_text() for text in axes.get_legend().get_texts() if "limit" in text.get_text()]
    assert label.startswith("limit of FMVSS 126,\n20 % at most")
    assert ("far to the" in label) == (not drawn)
    assert ("left" in label) == (low > 20.0)


def test_a_few_runs_far_out_do_not_set_the_axis() -> None:
    """The legend counts them."""
    ratios = np.concatenate([np.linspace(-2.0, 3.0, 990), np.linspace(150.0, 200.0, 10)])
    ((_, picture),) = pictures(of_ratios(ratios))
    (axes,) = picture.axes
    left, right = axes.get_xlim()
    assert -20.0 < left < -2.0 and 20.0 < right < 40.0
    assert "1 % of the runs\nlie beyond the axis" in [text.get_text() for text in axes.get_legend().get_texts()]


def entries(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    assert legend is not None
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


def renamed(summary: Summary, names: dict[str, str]) -> Summary:
    """With other names of the controllers."""
    outcomes = {(scenario, names[controller]): outcome for (scenario, controller), outcome in summary.outcomes.items()}
    return replace(summary, outcomes=outcomes)


def all_spun(outcome: Outcome) -> Outcome:
    return Outcome(runs=outcome.runs, spun=outcome.runs)


@pytest.mark.parametrize("where", ["some", "all"])
def test_a_controller_of_which_all_runs_spin_is_told(summary: Summary, where: str) -> None:
    """It has no figures; it is not to be left out for that."""
    gone = {key: where == "all" or key[1] == "tracking" for key in summary.outcomes if key[0] == "sine-with-dwell"}
    spun = {key: all_spun(outcome) if gone.get(key) else outcome for key, outcome in summary.outcomes.items()}
    (panel,) = [
        axes
        for name, picture in pictures(replace(summary, outcomes=spun))
        for axes in picture.axes
        if name == "sideslip" and axes.get_title(loc="left") == "sine-with-dwell"
    ]
    for (_, controller), told in zip(gone, entries(panel), strict=True):
        assert told.startswith(controller)
        assert told.endswith(", 100 % spun") == gone["sine-with-dwell", controller]
    assert ("all runs spin" in [text.get_text() for text in panel.texts]) == (where == "all")


def test_every_panel_names_every_controller(summary: Summary) -> None:
    controllers = {controller for _, controller in summary.outcomes}
    for name, picture in pictures(summary):
        for axes in picture.axes:
            named = {entry.partition(":")[0].partition(",")[0] for entry in entries(axes)}
            assert controllers <= named, (name, axes.get_title(loc="left"))


@pytest.mark.parametrize("letter", ["W", "i", "a_b "])
def test_names_as_long_as_they_may_be_fit_into_the_pictures(summary: Summary, letter: str) -> None:
    """No legend or title leaves the picture, or lies on that of the next panel."""
    controllers = list(dict.fromkeys(controller for _, controller in summary.outcomes))
    long = {name: (f"{place}" + letter * 63)[:63] for place, name in enumerate(controllers)}
    for name, picture in pictures(renamed(summary, long)):
        to_png(picture)
        whole = picture.bbox.padded(1.0)
        for axes in picture.axes:
            boxes = [axes.get_legend().get_window_extent(), axes.get_tightbbox()]
            assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 for box in boxes), name
        legends = [axes.get_legend().get_window_extent() for axes in picture.axes]
        assert all(left.x1 < right.x0 for left, right in pairwise(legends)), name
        heights = [axes.get_window_extent().height / picture.dpi for axes in picture.axes]
        assert min(heights) > 2.5, name  # in: what the curves have is not what the legends leave


def test_the_factors_of_a_run_in_words() -> None:
    row = dict.fromkeys(FACTORS, 12.3456) | {"delay_samples": 2.0, "mass_percent": -0.0, "overshoot_percent": 7.0}
    assert factors_of(row).replace("\N{NO-BREAK SPACE}", " ") == (
        "mass +0 %, yaw inertia +12.3 %, cg shift +12.3 m, front stiffness +12.3 %, rear stiffness +12.3 %, tyre peak +12.3 %, "
        "rear lag 12.3 s, delay 2 samples, speed noise 12.3 m/s, front angle noise 12.3 deg, yaw rate noise 12.3 deg/s"
    )
    assert "+12.3\N{NO-BREAK SPACE}m," in factors_of(row)  # no line of a title ends between a number and its unit
    assert factors_of({"friction": 0.5}) == ""
