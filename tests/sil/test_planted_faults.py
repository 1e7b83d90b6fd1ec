"""Are the checks able to fail? Each fault planted in the generated C must fail the check that is named for it.

The checks are those of the other tests here, and the unaltered C, compiled the same way, passes every one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import pytest

from codegen.config import Kind
from tests import builds
from tests.builds import Built
from tests.sil import (
    checks_control,
    checks_kinds,
    checks_limiter,
    checks_lookup,
    checks_map_reference,
    checks_reference,
    checks_reference_model,
    checks_supervision,
    checks_tracking,
    faults,
    faults_tracking,
    faults_units,
    units,
)
from tests.sil.units import Units

IN_KINDS: dict[Kind, dict[str, tuple[faults.Fault, ...]]] = {"pi": faults.FAULTS, "tracking": faults_tracking.FAULTS}
CONTROLLER_C = "src/ars_controller.c"
BANNER = {
    CONTROLLER_C: "Order of a step: judge the inputs",
    "src/ars_limiter.c": "Order of a step: take the inputs",
    "src/ars_reference_model.c": "The straight-line functions are",
    "src/ars_map.c": "Nothing here takes one of them for a constant",
}


def checks_in(*modules: ModuleType) -> list[Callable[..., object]]:
    """The checks that the modules themselves hold."""
    return [
        value
        for module in modules
        for name, value in vars(module).items()
        if name.startswith("check_") and value.__module__ == module.__name__
    ]


OF_PI = checks_in(checks_lookup, checks_control, checks_supervision)
OF_TRACKING = checks_in(checks_kinds, checks_tracking, checks_reference)
OF_UNITS = {
    "src/ars_limiter.c": checks_in(checks_limiter),
    "src/ars_reference_model.c": checks_in(checks_reference_model),
    "src/ars_map.c": checks_in(checks_map_reference),
}


@pytest.mark.parametrize(
    ("kind", "path", "fault"),
    [
        pytest.param(kind, path, fault, id=f"{kind}: {fault.name}")
        for kind, by_path in IN_KINDS.items()
        for path, planted in by_path.items()
        for fault in planted
    ],
)
def test_the_check_sees(kind: Kind, path: str, fault: faults.Fault) -> None:
    faulty = builds.altered(path, fault.old, fault.new, kind)
    with pytest.raises(AssertionError):
        fault.check(faulty)


@pytest.mark.parametrize(
    ("name", "path", "fault"),
    [
        pytest.param(name, path, fault, id=f"{path[8:-2]}: {fault.name}")
        for (name, path), planted in faults_units.FAULTS.items()
        for fault in planted
    ],
)
def test_the_check_of_a_unit_sees(name: str, path: str, fault: faults_units.Fault) -> None:
    faulty = units.altered(name, path, fault.old, fault.new)
    with pytest.raises(AssertionError):
        fault.check(faulty)


@pytest.mark.parametrize(
    ("kind", "check"),
    [("pi", check) for check in OF_PI] + [("tracking", check) for check in OF_TRACKING],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_the_unaltered_c_passes(kind: Kind, check: Callable[[Built], object]) -> None:
    banner = BANNER[CONTROLLER_C]
    check(builds.altered(CONTROLLER_C, banner, f"{banner} ", kind))  # a comment: all else is done as with a fault


@pytest.mark.parametrize(
    ("name", "path", "check"),
    [(name, path, check) for name, path in faults_units.FAULTS for check in OF_UNITS[path]],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_the_unaltered_unit_passes(name: str, path: str, check: Callable[[Units], object]) -> None:
    banner = BANNER[path]
    check(units.altered(name, path, banner, f"{banner} "))


def test_every_check_is_shown_to_be_able_to_fail() -> None:
    in_kinds = {fault.check for by_path in IN_KINDS.values() for planted in by_path.values() for fault in planted}
    in_units = {fault.check for planted in faults_units.FAULTS.values() for fault in planted}
    every = {*OF_PI, *OF_TRACKING, *(check for checks in OF_UNITS.values() for check in checks)}
    assert {check.__name__ for check in every} == {check.__name__ for check in in_kinds | in_units}


def test_a_fault_that_could_not_be_planted_is_told() -> None:
    """A text that is gone, or stands more than once, must not pass for a fault that was seen."""
    for text in ("no such text", "self->rear_angle"):
        with pytest.raises(LookupError, match="instead of once"):
            builds.altered(CONTROLLER_C, text, "")
