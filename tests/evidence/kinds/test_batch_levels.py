"""Batches with every level of vector instructions of this machine."""

import pytest

from codegen.sil.batch import Isa
from tests.sil.test_batch import AVAILABLE_ISAS, PARTS, PROFILES, batch_of, check_cars, check_independence, check_parts

on_each_level = pytest.mark.parametrize("isa", AVAILABLE_ISAS)


@on_each_level
def test_cars_and_independence(isa: Isa) -> None:
    for kind in ("pi", "tracking"):
        for name in PROFILES:
            check_cars(batch_of(kind, isa), kind, name)
    check_independence(batch_of("pi", isa))


@on_each_level
def test_parts_of_the_plant(isa: Isa) -> None:
    for key in PARTS.keys() - {"rear_relaxation_factor", "command_delay_samples"}:
        check_parts("pi", isa, [key])
