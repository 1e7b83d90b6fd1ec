"""The edges of the units that stand alone."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from codegen.emit.text import Precision
from tests.sil import units
from tests.sil.checks_edges_units import CHECKS, OF_THE_MODEL
from tests.sil.units import Units


@pytest.mark.parametrize("check", [*CHECKS, *OF_THE_MODEL], ids=lambda check: check.__name__)
@pytest.mark.parametrize("precision", ["single", "double"])
def test_an_edge_of_a_unit(precision: Precision, check: Callable[[Units], None]) -> None:
    check(units.tracking(precision))


@pytest.mark.parametrize(
    ("check", "old", "new"),
    [
        (CHECKS[0], "if (speed >= to)", "if (speed > to)"),
        (CHECKS[1], "opposite_phase_speed[k], 0.0f, 200.0f", "opposite_phase_speed[k], 0.5f, 200.0f"),
        (CHECKS[1], "parameters->opposite_phase_speed[k - 1u] < ", "parameters->opposite_phase_speed[k - 1u] <= "),
    ],
)
def test_a_fault_at_an_edge_is_seen(check: Callable[[Units], None], old: str, new: str) -> None:
    with pytest.raises(AssertionError):
        check(units.altered("tracking", "src/ars_limiter.c", old, new))


def test_a_fault_at_the_end_of_a_curve_is_seen() -> None:
    wrong = units.altered("tracking", "src/ars_reference_model.c", "= cells - 1u;", "= cells - 2u;")
    with pytest.raises(AssertionError):
        OF_THE_MODEL[0](wrong)
