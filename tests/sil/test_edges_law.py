"""The edges of the control laws."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from codegen.config import Kind
from codegen.emit.text import Precision
from tests import builds
from tests.builds import Built
from tests.sil import answers, checks_edges_law
from tests.sil.checks_edges_law import OF_TRACKING

CONTROLLER_C = "src/ars_controller.c"


@pytest.mark.parametrize("check", OF_TRACKING, ids=lambda check: check.__name__)
@pytest.mark.parametrize("precision", builds.PRECISIONS)
def test_an_edge_of_tracking(precision: Precision, check: Callable[[Built], None]) -> None:
    check(builds.of_kind("tracking", precision))


@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_rough_drives_have_the_bits_of_the_independent_model(kind: Kind) -> None:
    built = builds.of_kind(kind)
    for seed, changes in enumerate(checks_edges_law.rough_changes(built).values()):
        answers.check_drive(built, answers.answers_of(built, changes, checks_edges_law.rough(built, seed, 1000)))


@pytest.mark.parametrize(
    ("check", "old", "new"),
    [
        (OF_TRACKING[0], "    self->front_rate = 0.0f;\n    self->yaw_rate = 0.0f;", "    self->yaw_rate = 1.0f;"),
        (OF_TRACKING[1], "        self->reached = 0.0f;\n", "        self->reached = 1.0f;\n"),
        (OF_TRACKING[3], "(asked < (0.5f * self->grip))", "(asked <= (0.5f * self->grip))"),
        (OF_TRACKING[4], "(shortfall > parameters->grip_shortfall)", "(shortfall >= parameters->grip_shortfall)"),
        (OF_TRACKING[5], "limited = (feedback > range.high)", "limited = (feedback >= range.high)"),
    ],
)
def test_a_fault_at_an_edge_is_seen(check: Callable[[Built], None], old: str, new: str) -> None:
    with pytest.raises(AssertionError):
        check(builds.altered(CONTROLLER_C, old, new, "tracking"))


def test_a_fault_that_only_rough_drives_show_is_seen() -> None:
    old = "turns_left = (measurement->yaw_rate > 0.0f)"
    wrong = builds.altered(CONTROLLER_C, old, old.replace("> 0", ">= 0"), "tracking")

    def judge() -> None:
        for known in checks_edges_law.answers_of_rough(wrong):
            answers.check_drive(wrong, known)

    with pytest.raises(AssertionError):
        judge()
