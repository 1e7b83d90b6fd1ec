"""Are the checks able to fail? Each fault planted in the generated C must fail the check that is named for it.

The checks are those of the other tests here, and the unaltered C, compiled the same way, passes every one of them.
"""

from __future__ import annotations

import pytest

from tests.sil import builds, checks_control, checks_lookup, checks_supervision
from tests.sil.faults import FAULTS, Check, Fault

PLANTED = [pytest.param(path, fault, id=fault.name) for path, faults in FAULTS.items() for fault in faults]
CHECKS = [
    value
    for module in (checks_lookup, checks_control, checks_supervision)
    for name, value in vars(module).items()
    if name.startswith("check_")
]


@pytest.mark.parametrize(("path", "fault"), PLANTED)
def test_the_check_sees(path: str, fault: Fault) -> None:
    faulty = builds.altered(path, fault.old, fault.new)
    with pytest.raises(AssertionError):
        fault.check(faulty)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_unaltered_c_passes(check: Check) -> None:
    banner = "Order of a step: judge the inputs"
    check(builds.altered("src/ars_controller.c", banner, f"{banner} "))  # a comment: all else is done as with a fault


def test_every_check_is_shown_to_be_able_to_fail() -> None:
    assert {check.__name__ for check in CHECKS} == {fault.check.__name__ for faults in FAULTS.values() for fault in faults}


def test_a_fault_that_could_not_be_planted_is_told() -> None:
    """A text that is gone, or stands more than once, must not pass for a fault that was seen."""
    for text in ("no such text", "self->rear_angle"):
        with pytest.raises(LookupError, match="instead of once"):
            builds.altered("src/ars_controller.c", text, "")
