"""Where the loop is stable: the linearisation against drives of the generated C."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.config import Config
from codegen.sweep.region import FRICTIONS, MASSES_PERCENT, SPEEDS_KM_H, Region, confirm, region
from tests.sil import builds

SHAPE = (len(MASSES_PERCENT), len(FRICTIONS), len(SPEEDS_KM_H))


def with_integral_gain(factor: float) -> Config:
    controller = builds.CONFIG.controller
    changed = controller.model_copy(update={"integral_gain": factor * controller.integral_gain})
    return builds.CONFIG.model_copy(update={"controller": changed})


@pytest.fixture(scope="module")
def linear() -> Region:
    found = region(builds.CONFIG)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def driven(linear: Region) -> Region:
    folder = builds.paper().folder
    return confirm(linear, folder.files, folder.manifest)


def test_the_paper_s_loop_is_unstable_at_high_speed_and_drives_say_so(driven: Region) -> None:
    assert driven.stable.shape == SHAPE
    assert driven.stable[:, :, 0].all()
    assert not driven.stable[:, :, -1].any()
    assert driven.driven is not None
    assert not driven.contradicted.any()
    assert driven.undecided.sum() < 0.05 * driven.stable.size
    assert (driven.gain_margin_db[~driven.stable] == 0.0).all()


def test_heavier_and_more_slippery_is_sooner_unstable(linear: Region) -> None:
    stable = linear.stable.sum(axis=2)  # speeds
    assert (np.diff(stable, axis=0) <= 0).all()
    assert (np.diff(stable, axis=1) >= 0).all()


def test_drives_of_another_controller_contradict(linear: Region) -> None:
    """A fault in either of the two is seen: here the gains that are computed with are not those of the build."""
    folder = builds.paper().folder
    other = region(with_integral_gain(2.0))
    assert other is not None
    assert confirm(other, folder.files, folder.manifest).contradicted.sum() > 20


def test_a_kind_without_feedback_has_no_region() -> None:
    assert region(builds.FEEDFORWARD_CONFIG) is None


def test_growth_and_stability_say_the_same(linear: Region) -> None:
    assert np.array_equal(linear.growth < 0.0, linear.stable)


def test_nothing_driven_contradicts_nothing(linear: Region) -> None:
    assert linear.driven is None
    assert not linear.contradicted.any()
