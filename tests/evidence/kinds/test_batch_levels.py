"""Batches with every level of vector instructions of this machine."""

import numpy as np
import pytest

from codegen.sil.batch import Isa, Lanes, compile_batch
from tests import builds
from tests.sil.test_batch import (
    AVAILABLE_ISAS,
    PROFILES,
    batch_of,
    check_cars,
    check_independence,
    random_car,
    require_equal,
    rows,
    single_run,
)

on_each_level = pytest.mark.parametrize("isa", AVAILABLE_ISAS)


@on_each_level
def test_cars_and_independence(isa: Isa) -> None:
    for kind in ("pi", "tracking"):
        for name in PROFILES:
            check_cars(batch_of(kind, isa), kind, name)
    check_independence(batch_of("pi", isa))


@on_each_level
def test_tyres_with_a_relaxation_length(isa: Isa) -> None:
    generator = np.random.default_rng(3)
    soft, stiff = (random_car(generator, builds.CONFIG, relaxation_length_m=length) for length in (0.6, 0.25))
    folder = builds.paper().folder
    software = compile_batch(folder.files, folder.manifest, soft, isa=isa)
    record = software.run(PROFILES["step steer"], Lanes(rows(soft, stiff)))
    for index, car in enumerate((soft, stiff)):
        require_equal(record[:, :, index], single_run("pi", car, PROFILES["step steer"]))
