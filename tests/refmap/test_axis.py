"""Classification of breakpoints, and location of the cell of a value."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.refmap.axis import EVENNESS, Axis
from codegen.refmap.lookup import AxisConstants


@pytest.mark.parametrize(
    ("breakpoints", "first", "last", "step"),
    [
        ([0.0, 1.0, 2.0, 3.0, 4.0], False, False, 1.0),
        ([0.0, 4.0, 5.0, 6.0, 7.0], True, False, 1.0),
        ([0.0, 0.1, 1.1, 2.1, 3.1], True, False, 1.0),
        ([0.0, 1.0, 2.0, 3.0, 9.0], False, True, 1.0),
        ([0.0, 5.0, 5.5, 6.0, 6.5, 40.0], True, True, 0.5),
        ([0.0, 2.0], False, False, 2.0),
        ([0.0, 2.0, 3.0], True, False, 1.0),  # one cell of the two is the core
        ([0.0, 2.0, 3.0, 13.0], True, True, 1.0),
        ([0.0, 1.0, 2.0, 5.0], False, True, 1.0),
        # Uneven: one odd cell that is not at an end, two odd cells at one end, no two cells alike.
        ([0.0, 1.0, 2.0, 3.5, 4.5], False, False, None),
        ([0.0, 0.5, 1.0, 1.5, 3.0, 5.0], False, False, None),
        ([0.0, 1.0, 2.5, 3.0, 7.0, 7.5], False, False, None),
    ],
)
def test_an_even_axis_has_at_most_one_other_cell_at_either_end(
    breakpoints: list[float], first: bool, last: bool, step: float | None
) -> None:
    found = Axis.from_breakpoints(np.array(breakpoints))
    assert found.even == (step is not None)
    assert (found.has_first_cell, found.has_last_cell) == (first, last)
    assert (found.core_start, found.core_end) == (int(first), len(breakpoints) - 1 - int(last))
    assert step is None or found.step == pytest.approx(step, rel=1e-15)
    assert found.size == len(breakpoints)


@pytest.mark.parametrize("step", [1e-4, 20.0])
@pytest.mark.parametrize("index", [1, 7, 19])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_tolerance_is_a_fraction_of_the_step(step: float, index: int, sign: float) -> None:
    """The breakpoints are rounded a hundred times finer than the tolerance, which resolves 0.9 and 1.2 of it."""
    breakpoints = step * np.arange(21.0)
    breakpoints[index] += 0.9 * sign * EVENNESS * step
    assert Axis.from_breakpoints(breakpoints).even
    breakpoints[index] += 0.3 * sign * EVENNESS * step
    # Also beside an end: the two cells that share the breakpoint are both wrong.
    assert not Axis.from_breakpoints(breakpoints).even


@pytest.mark.parametrize("n", [5, 6, 7, 8, 9, 10, 33, 34, 65, 66, 1000])
def test_search_steps_reach_every_cell_and_no_further(n: int) -> None:
    """The lower end of a cell belongs to it, the upper end to the next one."""
    axis = Axis.from_breakpoints(np.cumsum(1.0 + 0.37 * np.arange(n)) - 1.0)
    assert not axis.even
    steps = axis.search_steps
    assert all(a == 2 * b for a, b in pairwise(steps)) and steps[-1] == 1
    assert sum(steps) >= n - 2 > sum(steps) // 2  # reaches the last cell without a step to spare
    constants = AxisConstants(axis, np.float64)
    lower, upper = axis.breakpoints[:-1], axis.breakpoints[1:]
    for inside, fraction in ((lower, 0.0), (0.75 * lower + 0.25 * upper, 0.25), (np.nextafter(upper, 0.0), 1.0)):
        cell, position = constants.locate(inside)
        np.testing.assert_array_equal(cell, np.arange(n - 1))
        np.testing.assert_allclose(position, fraction, rtol=0.0, atol=1e-12)
    cell, position = constants.locate(upper[-1:])
    assert (cell[0], position[0]) == (n - 2, 1.0)
    assert Axis.from_breakpoints(np.array([0.0, 2.0])).search_steps == ()


@given(st.lists(st.floats(1e-3, 10.0) | st.just(1.0), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_position_on_any_axis(widths: list[float], fraction: float) -> None:
    constants = AxisConstants(Axis.from_breakpoints(np.concatenate([[0.0], np.cumsum(widths)])), np.float64)
    breakpoints = constants.axis.breakpoints
    x = np.array([0.0, fraction * breakpoints[-1], breakpoints[-1]])
    cell, position = constants.locate(x)
    # EVENNESS of a step, at most.
    np.testing.assert_allclose(cell + position, np.interp(x, breakpoints, np.arange(breakpoints.size)), rtol=0.0, atol=1e-8)
