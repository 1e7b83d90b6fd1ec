"""Searches for breakpoints that take long."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from codegen.emit.evidence import excess_note
from codegen.errors import BuildError
from codegen.refmap.axis import Axis
from codegen.refmap.extend import extend
from codegen.refmap.model_excess import model_excess
from codegen.refmap.place import Maker, Request, Target, choose
from codegen.refmap.place_ground import ground_of
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import solve_stack
from codegen.refmap.storage import RAW_MAX
from tests import shared
from tests.refmap.cars import PAPER, changed, nonlinear, nonlinear_map, paper_map
from tests.refmap.placing import ROUNDING, coarsely, errors_against_optimum, largest_error, rear_angle_error, truth_of
from tests.refmap.test_nonlinear import built, tracking, with_car
from tests.refmap.test_place import BARE_BOUND, WIDE, bare, ground, one, two

pytestmark = pytest.mark.long


def test_a_search_does_not_depend_on_earlier_searches_and_fills_the_bytes_of_a_bound() -> None:
    """A search for bytes finds no larger error than a search for a bound, but for its step (`TIGHTER`, 3 %)."""
    target = Target(1, np.float32, "float")
    used, fresh = (Maker(ground_of(bare(), PAPER), target) for _ in range(2))
    assert used.for_error(2.0 * BARE_BOUND) is not None
    again, first = (maker.for_error(BARE_BOUND, ("uneven",)) for maker in (used, fresh))
    assert again is not None and first is not None
    for name in ("speed", "front_angle", "yaw_rate", "rear_angle", "rule"):
        np.testing.assert_array_equal(getattr(again.total, name), getattr(first.total, name))
    even = used.for_error(BARE_BOUND, ("even",))
    assert even is not None and even.bounded_error <= BARE_BOUND
    best = used.for_error(BARE_BOUND)  # the spacing with fewer bytes
    assert best is not None and best.flash_bytes <= min(even.flash_bytes, first.flash_bytes)
    assert all(Axis.from_breakpoints(axis).even for axis in (even.total.speed, even.total.front_angle))
    filled = used.for_flash(first.flash_bytes, ("uneven",))
    assert filled is not None and filled.flash_bytes <= first.flash_bytes
    assert filled.bounded_error <= first.bounded_error / 0.97


def test_with_the_nonlinear_tyre_the_bound_holds_against_the_optimum() -> None:
    config = coarsely(nonlinear(PAPER, "4ws-2"))
    reference_map = shared.once("coarse nonlinear map", lambda: solve_case(config, "4ws-2"))
    maker = Maker(ground_of(reference_map, config), Target(2, np.float32, "float"))
    found = maker.for_error(WIDE, ("uneven",))
    assert found is not None and found.origin == "surfaces" and 0.0 < found.gap < 0.03 * WIDE
    yaw_rate, rear_angle = errors_against_optimum(config, "4ws-2", found.total)
    assert 0.4 * WIDE < yaw_rate <= found.error.yaw_rate_whole <= found.bounded_error <= WIDE
    assert rear_angle <= found.error.rear_angle
    assert maker.for_error(0.99 * maker.gap) is None  # no table is more accurate than its ground


def test_a_build_of_kind_tracking_reports_the_excess_of_its_reference_model() -> None:
    """The evidence tier drives at the operating point that is named."""
    folder = built(with_car(nonlinear_map(), tracking()), tracking())
    assert not folder.manifest["reference_model_excess"]["enough"]
    named = re.search(r"trim_max_percent = (\d+) keeps them", excess_note(folder.manifest))
    assert named is not None
    enough = tracking(float(named[1]))
    mended = built(with_car(nonlinear_map(), enough), enough)
    assert mended.manifest["reference_model_excess"]["enough"] and excess_note(mended.manifest) == ""
    # It is that of the tables in the build, not of the solved map.
    config, found = tracking(), with_car(nonlinear_map(), tracking())
    total = extend(found, config, config.steering.front_angle_stop)
    turned = replace(total, rear_angle=total.rear_angle - math.radians(0.2))
    assert model_excess(found, turned, config).percent > model_excess(found, total, config).percent + 1.0


def test_the_bound_holds_at_random_points_against_the_optimum_solved_there() -> None:
    found = one()
    assert (found.origin, found.spacing, found.gap) == ("optimum", "uneven", 0.0)
    error = largest_error(found.total, truth_of(PAPER, "4ws-2"), 1)
    assert 0.4 * WIDE < error <= found.error.yaw_rate_whole + ROUNDING
    assert found.error.yaw_rate <= found.error.yaw_rate_whole <= WIDE
    assert found.bounded_error == found.error.yaw_rate_whole
    assert found.flash_bytes < 130  # 116 are found
    total = found.total
    assert (total.speed[0], total.front_angle[0]) == (0.0, 0.0)
    assert (total.speed[-1], total.front_angle[-1]) == (paper_map().speed[-1], PAPER.steering.front_angle_stop)


def test_the_bound_holds_for_two_tables_of_16_bits() -> None:
    """Also for the rear angle, as the yaw rate that it is worth; raw numbers are the nearest ones."""
    found = two()
    assert largest_error(found.total, truth_of(PAPER, "4ws-2"), 2) <= found.error.yaw_rate_whole + ROUNDING
    error = rear_angle_error(found, PAPER, "4ws-2")
    assert 0.4 * WIDE < error <= found.error.rear_yaw_rate_whole + ROUNDING
    assert max(found.error.rear_yaw_rate_whole, found.error.yaw_rate_whole) == found.bounded_error <= WIDE
    scales = found.total.scales
    assert scales is not None
    surface = ground().layers[-1].surface(found.total.speed, found.total.front_angle)
    tables = ((found.total.yaw_rate, scales.yaw_rate), (found.total.rear_angle, scales.rear_angle))
    for (stored, scale), exactly, reported in zip(tables, surface, found.rounding, strict=True):
        raw = stored / scale
        assert np.array_equal(raw, np.rint(raw)) and np.abs(raw).max() == RAW_MAX
        assert float(np.float32(scale)) == scale
        off = np.abs(stored - np.minimum(exactly, stored.max())).max()
        assert off == pytest.approx(reported, rel=1e-9) and off <= 0.5 * scale * (1.0 + 1e-6)


def test_a_request_that_cannot_be_met_is_refused_with_one_that_can() -> None:
    """The evidence tier requests errors that no table can have."""
    for max_error, max_flash, place, remedy in (
        (None, 12, "--max-flash", "the smallest one takes 32 bytes"),
        (BARE_BOUND, 40, "--max-error, --max-flash", "in 40 bytes"),
    ):
        with pytest.raises(BuildError) as caught:
            choose(bare(), PAPER, Request(max_error, max_flash, "float", ""), 1, np.float32)
        assert caught.value.where == place and remedy in caught.value.remedy and "\n" not in str(caught.value)


def test_the_excess_is_the_largest_of_every_friction() -> None:
    """On a slippery road the same error of a table is a larger part of what the map requires."""
    config = changed(tracking(), grid={"speed_points": 31, "front_angle_points": 30})
    stack = solve_stack(config, "4ws-2", [0.4, 0.9])
    total = extend(stack, config, config.steering.front_angle_stop)
    found = model_excess(stack, total, config)
    assert found.friction == 0.4
    alone = model_excess(replace(stack, layers=()), replace(total, layers=()), config)
    assert alone.friction == 0.9 and alone.percent < found.percent
