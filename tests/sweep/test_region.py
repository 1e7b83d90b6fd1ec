"""The region of stability: the linearisation against drives of the generated C."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from codegen.report.html.blocks import Gallery, Table, Text
from codegen.report.html.robust import DRIVEN_HEADER, region_blocks
from codegen.sweep.region import FRICTIONS, MASSES_PERCENT, SPEEDS_KM_H, Region, confirm, region
from tests import builds

SHAPE = (len(MASSES_PERCENT), len(FRICTIONS), len(SPEEDS_KM_H))


@pytest.fixture(scope="module")
def linear() -> Region:
    found = region(builds.CONFIG)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def driven(linear: Region) -> Region:
    folder = builds.paper().folder
    return confirm(linear, folder.files, folder.manifest)


def test_the_papers_loop_is_unstable_at_high_speed(driven: Region, linear: Region) -> None:
    assert driven.stable.shape == SHAPE
    assert driven.stable[:, :, 0].all()
    assert not driven.stable[:, :, -1].any()
    assert driven.driven is not None
    assert linear.driven is None and not linear.contradicted.any()
    assert not driven.contradicted.any()
    assert driven.undecided.sum() < 0.05 * driven.stable.size
    assert (driven.gain_margin_db[~driven.stable] == 0.0).all()
    stable = linear.stable.sum(axis=2)  # mass and low friction reduce the number of stable speeds
    assert (np.diff(stable, axis=0) <= 0).all()
    assert (np.diff(stable, axis=1) >= 0).all()


def test_drives_of_another_controller_contradict(linear: Region) -> None:
    """A fault in either of the two is found: here the linearisation uses other gains than the build."""
    folder = builds.paper().folder
    controller = builds.CONFIG.controller
    changed = controller.model_copy(update={"integral_gain": 2.0 * controller.integral_gain})
    other = region(builds.CONFIG.model_copy(update={"controller": changed}))
    assert other is not None
    assert confirm(other, folder.files, folder.manifest).contradicted.sum() > 20


def test_drives_confirm_the_gain_margins(driven: Region) -> None:
    sample = driven.margin_sample
    assert sample.sum() >= driven.stable.sum() // 4
    assert sample.any(axis=(1, 2)).all()  # every mass, friction and speed at which a loop is stable
    assert sample.any(axis=(0, 2)).all()
    assert np.array_equal(sample.any(axis=(0, 1)), driven.stable.any(axis=(0, 1)))
    assert driven.margin_driven is not None
    assert (driven.margin_driven[0][sample] == 1.0).all()
    assert (driven.margin_driven[1][sample] == 0.0).all()
    assert np.isnan(driven.margin_driven[:, ~sample]).all()
    assert not driven.margin_contradicted.any()
    assert driven.margin_undecided.sum() < 0.05 * sample.sum()


def test_wrong_margins_are_contradicted(linear: Region) -> None:
    """Cells with a margin that is too small and cells with one that is too large, in turn."""
    folder = builds.paper().folder
    factor = np.where(np.arange(linear.stable.size).reshape(linear.stable.shape) // 2 % 2, 0.8, 1.25)
    wrong = confirm(replace(linear, gain_limit=factor * linear.gain_limit), folder.files, folder.manifest)
    for one in (0.8, 1.25):
        sample = wrong.margin_sample & (factor == one)
        assert (wrong.margin_contradicted & sample).sum() > 0.9 * sample.sum() > 0
    assert not wrong.contradicted.any()


def test_poles_and_margins_agree(linear: Region) -> None:
    has = np.isfinite(linear.gain_limit)
    assert np.array_equal(has, linear.stable)  # each loop of the paper has a largest gain
    assert np.array_equal(linear.growth < 0.0, linear.stable)
    assert (linear.limit_growth[0][has] < 0.0).all()
    assert (linear.limit_growth[1][has] > 0.0).all()
    assert np.allclose(20.0 * np.log10(linear.gain_limit[has]), linear.gain_margin_db[has])


def test_the_report_counts_what_was_driven(driven: Region, linear: Region) -> None:
    (table,) = (block for block in region_blocks({"pi": driven}) if isinstance(block, Table) and block.header == DRIVEN_HEADER)
    (_, _, cells, near, agreed, otherwise), (_, what, *margin) = table.rows
    assert (int(cells), int(otherwise)) == (driven.stable.size, 0)
    assert int(near) + int(agreed) == driven.stable.size
    assert what == "gain margin, at 0.9 and 1.1 times"
    assert [int(cell) for cell in margin] == [driven.margin_sample.sum(), 0, driven.margin_sample.sum(), 0]
    tables = [block.rows for block in region_blocks({"pi": linear}) if isinstance(block, Table)]
    assert [("pi", "not driven", "0", "-", "-", "-")] in tables


def test_kinds_without_feedback_are_reported_as_the_car_alone(linear: Region) -> None:
    """An oversteering car has a critical speed; its loop is unstable at other speeds."""
    assert region(builds.FEEDFORWARD_CONFIG) is None
    config = builds.CONFIG
    car = config.vehicle.model_copy(update={"cg_to_front_axle_m": 1.8, "cg_to_rear_axle_m": 1.2})
    alone = region(config.model_copy(update={"vehicle": car}))
    assert alone is not None
    assert (~alone.without).any()
    blocks = list(region_blocks({"pi": alone}))
    (text,) = (block.text for block in blocks if isinstance(block, Text) and "Kinds without feedback" in block.text)
    assert "(feedforward, proportional)" in text
    rows = next(block for block in blocks if isinstance(block, Table)).rows
    assert [row[0] for row in rows] == ["pi"] * len(MASSES_PERCENT) + ["without feedback"] * len(MASSES_PERCENT)
    for mass, row in enumerate(rows[len(MASSES_PERCENT) :]):
        for stable, cell in zip(alone.without[mass, ::2], row[2:], strict=True):
            first = next((speed for speed, ok in zip(SPEEDS_KM_H, stable, strict=True) if not ok), None)
            assert cell == ("not up to 380" if first is None else f"{first:g}")
    assert linear.without.all()  # the paper's car


def test_the_line_of_6_db_is_named_in_the_caption(linear: Region) -> None:
    """Rotated labels in the chart would read "9" for 6."""

    def captions(one: Region) -> list[str]:
        gallery = next(block for block in region_blocks({"pi": one}) if isinstance(block, Gallery))
        for chart in gallery.charts:
            (line,) = (trace for trace in chart.figure["data"] if trace["type"] == "contour")
            assert not line["contours"]["showlabels"]
        return [chart.caption for chart in gallery.charts]

    assert all("In white: line: 6 dB" in one for one in captions(linear))
    ample = replace(linear, gain_margin_db=np.full_like(linear.gain_margin_db, 12.0))
    assert not any("6 dB" in one for one in captions(ample))
