"""How breakpoints are classified, and that the cell of every value is found."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.refmap.axis import EVENNESS, Axis
from codegen.refmap.extend import TotalMap
from codegen.refmap.lookup import AxisConstants, Real

FloatArray = npt.NDArray[np.float64]
REALS: tuple[Real, ...] = (np.float32, np.float64)
UNEVEN = [0.0, 1.0, 2.5, 3.0, 7.0, 7.5]


def axis(*breakpoints: float) -> Axis:
    return Axis.from_breakpoints(np.array(breakpoints))


@pytest.mark.parametrize(
    ("breakpoints", "first", "last", "step"),
    [
        ([0.0, 1.0, 2.0, 3.0, 4.0], False, False, 1.0),
        ([0.0, 4.0, 5.0, 6.0, 7.0], True, False, 1.0),
        ([0.0, 0.1, 1.1, 2.1, 3.1], True, False, 1.0),  # narrower, too
        ([0.0, 1.0, 2.0, 3.0, 9.0], False, True, 1.0),
        ([0.0, 1.0, 2.0, 3.0, 3.2], False, True, 1.0),
        ([0.0, 5.0, 5.5, 6.0, 6.5, 40.0], True, True, 0.5),
        ([0.0, 2.0], False, False, 2.0),
        ([0.0, 2.0, 3.0], True, False, 1.0),  # three points are always even: one cell of the two is the core
        ([0.0, 2.0, 3.0, 13.0], True, True, 1.0),
        ([0.0, 1.0, 2.0, 5.0], False, True, 1.0),
    ],
)
def test_even_with_at_most_one_other_cell_at_either_end(breakpoints: list[float], first: bool, last: bool, step: float) -> None:
    found = axis(*breakpoints)
    assert found.even
    assert (found.has_first_cell, found.has_last_cell) == (first, last)
    assert (found.core_start, found.core_end) == (int(first), len(breakpoints) - 1 - int(last))
    assert found.step == pytest.approx(step, rel=1e-15)
    assert found.size == len(breakpoints)


@pytest.mark.parametrize(
    "breakpoints",
    [
        UNEVEN,
        [0.0, 1.0, 3.0, 4.0, 6.0],
        [0.0, 1.0, 2.0, 3.5, 4.5],  # the odd cell is not at an end
        [0.0, 0.5, 1.0, 1.5, 3.0, 5.0],  # two odd cells at one end
    ],
)
def test_anything_else_is_uneven(breakpoints: list[float]) -> None:
    found = axis(*breakpoints)
    assert not found.even
    assert not found.has_first_cell and not found.has_last_cell
    assert (found.core_start, found.core_end) == (0, len(breakpoints) - 1)


@pytest.mark.parametrize("step", [1e-4, 0.0174, 1.0, 20.0])
@pytest.mark.parametrize("place", [1, 7, 19])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_tolerance_is_a_share_of_the_step(step: float, place: int, sign: float) -> None:
    """Rounding of the breakpoints is a hundred times finer than the tolerance here, so 0.9 and 1.2 of it are told apart."""
    breakpoints = step * np.arange(21.0)
    assert EVENNESS == 1e-9
    breakpoints[place] += 0.9 * sign * EVENNESS * step
    assert Axis.from_breakpoints(breakpoints).even
    breakpoints[place] += 0.3 * sign * EVENNESS * step
    # Beside an end as well: the two cells that share the breakpoint are both wrong.
    assert not Axis.from_breakpoints(breakpoints).even


def test_axes_of_the_paper_are_even(totals: Mapping[str, TotalMap]) -> None:
    """Standstill to 20 km/h is a wider cell, 10 deg to the stop too; 0 to 0.1 deg is as wide as the rest."""
    total = totals["4ws-2"]
    speed, front_angle = (Axis.from_breakpoints(values) for values in (total.speed, total.front_angle))
    assert (speed.even, speed.has_first_cell, speed.has_last_cell, speed.size) == (True, True, False, 102)
    assert (front_angle.even, front_angle.has_first_cell, front_angle.has_last_cell, front_angle.size) == (
        True,
        False,
        True,
        102,
    )


# --- finding the cell ---------------------------------------------------------------------------------------------------


def uneven(n: int) -> Axis:
    """n breakpoints, no two cells alike."""
    found = Axis.from_breakpoints(np.cumsum(1.0 + 0.37 * np.arange(n)) - 1.0)
    assert not found.even
    return found


@pytest.mark.parametrize("n", [*range(5, 40), 63, 64, 65, 66, 127, 128, 129, 130, 1000])
def test_search_steps_reach_every_cell_and_no_further(n: int) -> None:
    """Each value of a cell, its ends included, is found there: the lower end belongs to it, the upper to the next."""
    steps = uneven(n).search_steps
    assert all(a == 2 * b for a, b in pairwise(steps)) and steps[-1] == 1
    assert sum(steps) >= n - 2 > sum(steps) // 2  # the last cell is reached, and not with a step to spare
    constants = AxisConstants(uneven(n), np.float64)
    lower, upper = constants.axis.breakpoints[:-1], constants.axis.breakpoints[1:]
    for inside, fraction in ((lower, 0.0), (0.75 * lower + 0.25 * upper, 0.25), (np.nextafter(upper, 0.0), 1.0)):
        cell, position = constants.locate(inside)
        np.testing.assert_array_equal(cell, np.arange(n - 1))
        np.testing.assert_allclose(position, fraction, rtol=0.0, atol=1e-12)
    cell, position = constants.locate(upper[-1:])
    assert (cell[0], position[0]) == (n - 2, 1.0)


def test_two_uneven_points_need_no_search() -> None:
    assert axis(0.0, 2.0).search_steps == ()


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(
    "breakpoints",
    [
        np.linspace(0.0, 7.0, 8),
        np.concatenate([[0.0], np.linspace(20.0, 120.0, 101) / 3.6]),
        np.concatenate([np.radians(np.linspace(0.0, 10.0, 101)), [np.radians(35.0)]]),
        np.concatenate([[0.0], np.linspace(3.0, 5.0, 33), [9.0]]),
        np.array([0.0, 2.0]),
        np.array(UNEVEN),
    ],
    ids=["even", "first", "last", "both", "two points", "uneven"],
)
def test_position_is_that_of_the_definition(breakpoints: FloatArray, real: Real) -> None:
    """Cell number plus position inside grows like the linear interpolation of the cell numbers. Rounding may choose the
    neighbouring cell at its very end, so their sum is compared: to four roundings of a position of 100 cells, 4 u 100, which in
    single precision is 2.4e-5 of a cell."""
    constants = AxisConstants(Axis.from_breakpoints(breakpoints), real)
    x = np.linspace(0.0, breakpoints[-1], 4_001).astype(real)
    x = np.unique(np.concatenate([x, breakpoints.astype(real)]))
    x = np.minimum(x, constants.top)
    cell, position = constants.locate(x)
    assert position.dtype == real
    assert np.all((cell >= 0) & (cell <= breakpoints.size - 2))
    expected = np.interp(x.astype(np.float64), breakpoints, np.arange(breakpoints.size))
    tolerance = 2.0 * 100.0 * float(np.finfo(real).eps)
    np.testing.assert_allclose(cell + position.astype(np.float64), expected, rtol=0.0, atol=tolerance)


@given(st.lists(st.floats(1e-3, 10.0), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_any_breakpoints(widths: list[float], share: float) -> None:
    constants = AxisConstants(Axis.from_breakpoints(np.concatenate([[0.0], np.cumsum(widths)])), np.float64)
    breakpoints = constants.axis.breakpoints
    x = np.array([0.0, share * breakpoints[-1], breakpoints[-1]])
    cell, position = constants.locate(x)
    expected = np.interp(x, breakpoints, np.arange(breakpoints.size))
    # EVENNESS of a step, at most.
    np.testing.assert_allclose(cell + position, expected, rtol=0.0, atol=1e-8)
