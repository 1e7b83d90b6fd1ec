"""Batches with every level of vector instructions of this machine, and faults planted in their C."""

import numpy as np
import pytest

from codegen.sil import batch
from codegen.sil.batch import BatchSoftware, Isa, Lanes, compile_batch
from codegen.sil.batch_sources import LANES, batch_sources
from codegen.sil.closed_loop import ClosedLoop
from tests import builds
from tests.sil.test_batch import (
    HERE,
    PROFILES,
    batch_of,
    check_cars,
    check_company,
    check_noise,
    chosen,
    mixed,
    random_car,
    require_bits,
    require_equal,
    rows,
    single_run,
)
from tests.sil.test_batch import test_factors_and_friction_are_those_of_another_scenario as check_factors

on_each_level = pytest.mark.parametrize("isa", HERE)


@on_each_level
def test_cars_and_company(isa: Isa) -> None:
    for kind in ("pi", "tracking"):
        for name in PROFILES:
            check_cars(batch_of(kind, isa), kind, name)
    check_company(batch_of("pi", isa))


@on_each_level
def test_tyres_with_a_relaxation_length(isa: Isa) -> None:
    generator = np.random.default_rng(3)
    soft, stiff = (random_car(generator, builds.CONFIG, relaxation_length_m=length) for length in (0.6, 0.25))
    folder = builds.paper().folder
    software = compile_batch(folder.files, folder.manifest, soft, isa=isa)
    record = software.run(PROFILES["step steer"], Lanes(rows(soft, stiff)))
    for index, car in enumerate((soft, stiff)):
        require_equal(record[:, :, index], single_run("pi", car, PROFILES["step steer"]))


@on_each_level
def test_a_build_in_double_precision(isa: Isa) -> None:
    built = builds.paper("double")
    software = compile_batch(built.folder.files, built.folder.manifest, isa=isa)
    record = software.run(PROFILES["sine with dwell"], Lanes(rows(builds.CONFIG)))
    require_equal(record[:, :, 0], ClosedLoop(built.software).run(PROFILES["sine with dwell"]).T)


FAULTS = {
    "weights of Runge-Kutta": ("batch_plant.c", "(2.0 * k2[i].at[lane])", "(2.001 * k2[i].at[lane])"),
    "factor of the friction": ("batch_plant.c", "input->friction * self->friction_factor.at[lane]", "input->friction"),
    "moment from outside": ("batch_plant.c", ".at[lane] = input->yaw_moment;", ".at[lane] = 0.0;"),
    "a controller for all": ("batch.c", "&self->controller[lane], parameters", "&self->controller[0], parameters"),
    "delay": ("batch.c", "sample + DELAY_SLOTS - delay", "sample + DELAY_SLOTS - (delay / 2u)"),
    "noise of another signal": ("batch.c", "runs, sample, 1u, run", "runs, sample, 2u, run"),
    "noise of another run": ("batch.c", "runs, sample, 2u, run", "runs, sample, 2u, 0u"),
    "command of another run": ("batch.c", "runs->command_factor[run]", "runs->command_factor[0]"),
    "friction estimate": ("batch.c", "runs->friction_estimate[run];", "runs->friction_estimate[self->first];"),
    "inhibit": ("batch.c", "(input->inhibit > 0.0)", "(input->inhibit > 2.0)"),
    "row of another block": ("batch.c", "((size_t)sample * runs->count) + self->first", "((size_t)sample * runs->count)"),
}


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_planted_in_the_batch_is_seen(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One place of its C changed."""
    file, old, new = FAULTS[fault]
    sources = batch_sources(builds.CONFIG, "ars", "single")
    text = sources[f"batch/{file}"].decode("ascii")
    assert text.count(old) == 1
    planted = {**sources, f"batch/{file}": text.replace(old, new).encode("ascii")}
    monkeypatch.setattr(batch, "batch_sources", lambda *_: planted)
    folder = builds.paper().folder
    software = compile_batch(folder.files, folder.manifest, isa="none")
    with pytest.raises(AssertionError):
        check_everything(software)


def check_everything(software: BatchSoftware) -> None:
    for name in PROFILES:
        check_cars(software, "pi", name)
    check_noise(software)
    check_factors(software)
    lanes, every = mixed(2 * LANES)
    whole = software.run(PROFILES["step steer"], lanes)
    require_bits(software.run(PROFILES["step steer"], chosen(lanes, every[::-1])), whole[:, :, ::-1])
