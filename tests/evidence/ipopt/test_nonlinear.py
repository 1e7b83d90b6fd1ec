"""The nonlinear map against IPOPT and a dense search on more cars, and driven in closed loop near its slip bounds."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from codegen.config import KM_H
from codegen.emit.evidence import excess_note
from codegen.refmap.nonlinear import NonlinearTurns
from codegen.refmap.place import Request
from codegen.sil.software import compile_build
from tests.refmap.cars import CASES, PAPER, nonlinear, nonlinear_map
from tests.refmap.test_nonlinear import (
    SLIP_TOLERANCE,
    built,
    check_against_dense_search,
    check_against_ipopt,
    steady_slips,
    tracking,
    with_car,
)


@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.long), pytest.param(3, marks=pytest.mark.long)])
def test_against_a_dense_search(seed: int) -> None:
    check_against_dense_search(seed, 3)


@pytest.mark.parametrize("case", CASES)
def test_against_ipopt(case: str) -> None:
    check_against_ipopt(case, 20, 6)


def test_closed_loop_keeps_the_slip_bounds_in_steady_state() -> None:
    """On breakpoints near the end of the map."""
    found, config = nonlinear_map(), nonlinear(PAPER, "4ws-2")
    folder = built(found, config)
    software = compile_build(folder.files, folder.manifest)
    for row, fraction in ((22, 0.99), (40, 0.95), (60, 0.95), (90, 0.9)):
        column = int(fraction * np.flatnonzero(found.feasible[row])[-1])
        slips = steady_slips(software, config, float(found.speed[row]), float(found.front_angle[column]))
        assert (slips <= 1.0 + SLIP_TOLERANCE).all(), (row, slips)


def test_kind_tracking_keeps_them_with_the_trim_that_the_build_names() -> None:
    """With the default trim the bound is exceeded at the operating point that is named."""
    config = tracking()
    folder = built(with_car(nonlinear_map(), config), config)
    named = re.search(r"trim_max_percent = (\d+) keeps them", excess_note(folder.manifest))
    assert named is not None
    point = folder.manifest["reference_model_excess"]
    speed, front_angle = point["at_km_h"] * KM_H, math.radians(point["at_front_angle_deg"])
    slips = steady_slips(compile_build(folder.files, folder.manifest), config, speed, front_angle)
    assert slips.max() > 1.0 + 2.0 * SLIP_TOLERANCE
    enough = tracking(float(named[1]))
    mended = built(with_car(nonlinear_map(), enough), enough)
    slips = steady_slips(compile_build(mended.files, mended.manifest), enough, speed, front_angle)
    assert (slips <= 1.0 + SLIP_TOLERANCE).all(), slips


@pytest.mark.long
def test_kind_tracking_keeps_them_on_chosen_breakpoints() -> None:
    """Beside the edge of the map, where the rear angle that the reference model takes from its table turns fastest."""
    config = tracking(5.0)
    request = Request(math.radians(0.1), None, "int16", "--max-error 0.1deg/s --storage int16")
    folder = built(with_car(nonlinear_map(), config), config, request=request)
    assert folder.manifest["reference_model_excess"]["enough"]
    software, turns = compile_build(folder.files, folder.manifest), NonlinearTurns.from_config(config, config.cases["4ws-2"])
    for speed in np.array([70.0, 95.0, 110.0]) * KM_H:
        edge = float(turns.edge(np.array([speed])).front_angle[0])
        for fraction in (0.7, 0.9, 0.99):
            slips = steady_slips(software, config, float(speed), fraction * edge)
            assert (slips <= 1.0 + SLIP_TOLERANCE).all(), (speed / KM_H, fraction, slips)
