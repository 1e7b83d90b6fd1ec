"""The stability region: the linearisation compared with runs of the generated C."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from codegen.configuration import parse
from codegen.report.html.page import Text
from codegen.report.html.robust import region_blocks
from codegen.sil.batch import BatchSoftware
from codegen.sweep import region as regions
from codegen.sweep.region import (
    ALONE_UNSTABLE,
    MASSES_PERCENT,
    MODEL_UNSTABLE,
    REGION_FRICTIONS,
    REGION_SPEEDS_KM_H,
    UNEXPLAINED,
    Region,
    _is_stable,
    confirm,
    region,
    speeds_of,
)
from codegen.verify.outcomes import Subject
from tests import builds

GENERATED = Path(__file__).parents[2] / "generated"
SHAPE = (len(MASSES_PERCENT), len(REGION_FRICTIONS), len(REGION_SPEEDS_KM_H))


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
    assert driven.stable[:, :, 0].all() and not driven.stable[:, :, -1].any()
    assert driven.driven is not None and not driven.contradicted.any()
    assert linear.driven is None and not linear.contradicted.any()
    assert driven.undecided.sum() < 0.05 * driven.stable.size
    stable = linear.stable.sum(axis=2)  # mass and low friction reduce the number of stable speeds
    assert (np.diff(stable, axis=0) <= 0).all() and (np.diff(stable, axis=1) >= 0).all()


def test_with_motor_and_backlash_the_gain_margins_are_those_of_the_generated_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within 5 % of the gain, half of what the report checks. Within its play the loop has no gain, so that even beyond its
    margin it would be stable; outside of it the rear wheels lag behind the motor, which costs 5 to 10 %."""
    monkeypatch.setattr(regions, "MARGIN_SHARES", (0.95, 1.05))
    build = Subject.read(GENERATED / "4ws2")
    config = parse(build.manifest["configuration"], "manifest.json")
    assert config.plant.backlash_deg > 0.0
    linear = region(config)
    assert linear is not None and linear.margin_sample.any()
    driven = confirm(linear, build.files, build.manifest)
    assert not driven.contradicted.any() and not driven.margin_contradicted.any()


def test_the_region_ends_with_the_margins() -> None:
    """Its grid has the last speed of a designed controller, and of fixed gains only those that the controller accepts."""
    tracking, pi = builds.TRACKING_CONFIG, builds.CONFIG
    assert speeds_of(tracking) == REGION_SPEEDS_KM_H[:6] and speeds_of(pi) == REGION_SPEEDS_KM_H
    assert speeds_of(tracking.replace({"vehicle.top_speed_km_h": 150.0})) == (*REGION_SPEEDS_KM_H[:7], 150.0)
    assert speeds_of(pi.replace({"vehicle.top_speed_km_h": 90.0})) == (*REGION_SPEEDS_KM_H[:4], 90.0)


def test_poles_and_margins_agree(linear: Region) -> None:
    has = np.isfinite(linear.gain_limit)
    assert np.array_equal(has, linear.stable)  # each loop of the paper has a maximum gain
    assert np.array_equal(linear.growth < 0.0, linear.stable)
    assert (linear.limit_growth[0][has] < 0.0).all() and (linear.limit_growth[1][has] > 0.0).all()
    assert np.allclose(20.0 * np.log10(linear.gain_limit[has]), linear.gain_margin_db[has])
    assert (linear.gain_margin_db[~has] == 0.0).all()


def test_runs_confirm_the_gain_margins(driven: Region) -> None:
    sample = driven.margin_sample
    assert sample.sum() >= driven.stable.sum() // 4
    for axes in ((1, 2), (0, 2), (0, 1)):  # every mass, friction and speed with a stable loop
        assert np.array_equal(sample.any(axis=axes), driven.stable.any(axis=axes))
    assert driven.margin_driven is not None
    assert (driven.margin_driven[0][sample] == 1.0).all() and (driven.margin_driven[1][sample] == 0.0).all()
    assert np.isnan(driven.margin_driven[:, ~sample]).all()
    assert not driven.margin_contradicted.any() and driven.disagreement == ""
    assert driven.margin_undecided.sum() < 0.05 * sample.sum()


def test_a_linearisation_with_other_gains_or_margins_is_contradicted(linear: Region) -> None:
    """The faults are margins that are too small and too large, and twice the build's integral gain."""
    folder, controller = builds.paper().folder, builds.CONFIG.controller
    factor = np.where(np.arange(linear.stable.size).reshape(SHAPE) // 2 % 2, 0.8, 1.25)
    wrong = confirm(replace(linear, gain_limit=factor * linear.gain_limit), folder.files, folder.manifest)
    for one in (0.8, 1.25):
        sample = wrong.margin_sample & (factor == one)
        assert (wrong.margin_contradicted & sample).sum() > 0.9 * sample.sum() > 0
    changed = controller.model_copy(update={"integral_gain": 2.0 * controller.integral_gain})
    other = region(builds.CONFIG.model_copy(update={"controller": changed}))
    assert other is not None
    assert not wrong.contradicted.any()
    disagreeing = replace(other, driven=wrong.driven)
    cells = int(disagreeing.contradicted.sum())
    assert cells > 20
    first = REGION_SPEEDS_KM_H[int(disagreeing.contradicted.any(axis=(0, 1)).argmax())]
    message = disagreeing.disagreement
    # The paper's car is stable without control and its law has no reference model: nothing explains them.
    assert (
        f"{cells} of {linear.stable.size} cells" in message
        and f"unexplained in {cells}; " in message
        and "bounded feedback" not in message
    )
    assert disagreeing.explanations == {ALONE_UNSTABLE: 0, MODEL_UNSTABLE: 0, UNEXPLAINED: cells}
    assert replace(disagreeing, critical_speed_km_h=first).explanations[MODEL_UNSTABLE] == cells
    assert replace(disagreeing, without=~disagreeing.without).explanations[ALONE_UNSTABLE] == cells
    assert disagreeing.disagreeing_from == first and wrong.explanations[ALONE_UNSTABLE] == 0
    explained = replace(disagreeing, critical_speed_km_h=first).disagreement
    assert f"reference model unstable in {cells} (bounded feedback" in explained and "unexplained" not in explained
    blocks = list(region_blocks({"other": disagreeing}))
    assert [block.text for block in blocks if isinstance(block, Text) and block.kind == "notice"] == [f"other: {message}."]


def test_a_disagreement_names_its_own_cause_and_a_possible_remedy(linear: Region) -> None:
    """A build rejects a largest speed below the last one of its map, which is 120 km/h."""
    assert linear.map_last_speed_km_h == 120.0

    def message(speed_km_h: float, **changes: Any) -> str:
        driven = linear.stable.copy()
        driven[1, 4, REGION_SPEEDS_KM_H.index(speed_km_h)] ^= True
        growth = np.where(linear.stable, -1.0, 1.0)
        return replace(linear, driven=driven, growth=growth, **changes).disagreement

    found = f"simulations contradict the computed stability in 1 of {linear.stable.size} cells and 0 of "
    of_margins = f"{linear.margin_sample.sum()} gain margins"
    assert message(60.0) == f"{found}{of_margins}, at 60 km/h; unexplained in 1; do not rely on the margins there"
    assert message(140.0).endswith(", at 140 km/h; unexplained in 1; set controller.inputs.speed_max_km_h below 140")
    assert "; car alone unstable in 1 (bounded" in message(60.0, without=~linear.without)
    assert message(40.0, map_last_speed_km_h=30.0).endswith("; do not rely on the margins there")  # at least 50 km/h


class _PlantedBatch:
    """A batch that returns given oscillations: amplitudes at whole seconds, in rad/s."""

    def __init__(self, *swings: list[float]) -> None:
        self.swings = swings
        self.parameters, self.config = builds.paper().software.parameters, builds.CONFIG

    def run(self, profile: np.ndarray, *_: object, **__: object) -> np.ndarray:
        samples = profile.shape[0] // round(builds.CONFIG.controller.sampling_time_s / builds.CONFIG.plant.sampling_time_s)
        time = np.arange(samples) * builds.CONFIG.controller.sampling_time_s
        rows = [np.interp(time, np.arange(len(swing)), swing) * np.sin(20.0 * time) for swing in self.swings]
        return np.array(rows).T[np.newaxis]


def test_growing_oscillations_are_unstable_and_decaying_ones_are_not() -> None:
    dies, grows = [1e-2 * 0.5**k for k in range(11)], [1e-4 * 2.0**k for k in range(11)]
    ends = [1e-3, 1e-3, 3e-3, 1e-2, 1e-1, 1e-2, *[0.0] * 5]
    planted = cast(BatchSoftware, _PlantedBatch(dies, grows, ends))
    ones = np.ones(3)
    assert list(_is_stable(planted, builds.CONFIG, None, 0.0 * ones, ones, 30.0 * ones, ones)) == [True, False, False]


def test_kinds_without_feedback_are_reported_as_the_car_alone(linear: Region) -> None:
    """An oversteering car has a critical speed."""
    assert region(builds.FEEDFORWARD_CONFIG) is None
    assert linear.without.all()  # the paper's car
    car = builds.CONFIG.vehicle.model_copy(update={"cg_to_front_axle_m": 1.8, "cg_to_rear_axle_m": 1.2})
    alone = region(builds.CONFIG.model_copy(update={"vehicle": car}))
    assert alone is not None
    assert (~alone.without).any()
    blocks = list(region_blocks({"pi": alone}))
    assert any("(feedforward, proportional)" in block.text for block in blocks if isinstance(block, Text))
