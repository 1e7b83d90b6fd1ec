"""The generated safety limiter: what it guarantees whatever computed the demand, against an independent model, and alone."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from elftools.elf.elffile import ELFFile
from elftools.elf.sections import SymbolTableSection
from hypothesis import given
from hypothesis import strategies as st

from codegen.config import Config
from codegen.sil.toolchain import compiler_command
from tests import builds
from tests.sil import checks_limiter, units
from tests.sil.checks_limiter import CHANGES
from tests.sil.units import Units

POINTS: dict[str, dict[str, Any]] = {
    "two breakpoints": {},
    "five breakpoints": {
        "opposite_phase_speed_km_h": [20.0, 40.0, 41.0, 90.0, 200.0],
        "opposite_phase_max_deg": [3.5, 2.0, 3.0, 0.0, 1.0],
    },
    "off": {"rear_rate_max_deg_s": "off", "opposite_phase_max_deg": "off"},
}


def config(**changes: Any) -> Config:
    """The recommended configuration with another limiter."""
    data = builds.FEEDFORWARD_CONFIG.model_dump()
    data["limiter"].update(changes)
    return Config.model_validate(data)


@pytest.fixture(scope="module", params=[(name, precision) for name in POINTS for precision in builds.PRECISIONS], ids=str)
def limiter(request: pytest.FixtureRequest) -> Units:
    """With few and many breakpoints, in both precisions."""
    name, precision = request.param
    return units.make(builds.paper_map(), config(**POINTS[name]), precision, ("limiter",))


@pytest.fixture(scope="module", params=builds.PRECISIONS)
def recommended(request: pytest.FixtureRequest) -> Units:
    """The limiter of the recommended configuration."""
    return units.tracking(request.param)


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_every_step_is_that_of_the_independent_model(limiter: Units, changes: dict[str, Any]) -> None:
    checks_limiter.check_limiter_same_as_model(limiter, changes)


def test_nothing_leads_out_of_bounds_from_any_state(limiter: Units) -> None:
    checks_limiter.check_limiter_always_bounded(limiter)


@given(st.lists(st.tuples(*[st.floats(width=32)] * 3), min_size=1, max_size=30), st.floats(width=32))
def test_no_sequence_leads_out_of_bounds(inputs: list[tuple[float, float, float]], start: float) -> None:
    """In bounds and at the rate: from the first step on that began inside."""
    recommended = units.tracking()
    parameters = recommended.limiter_parameters()
    angles = recommended.limiter(parameters, np.array(inputs, dtype=np.float32), start).astype(np.float64)
    assert (np.abs(angles) <= parameters.rear_angle_max).all()
    travel = parameters.rear_rate_max * checks_limiter.period(recommended)
    assert (np.abs(np.diff(angles)) <= travel + parameters.rear_angle_max * recommended.eps).all()


def test_opposite_phase_ends_at_the_bound_for_the_speed(recommended: Units) -> None:
    checks_limiter.check_opposite_phase(recommended)


def test_in_phase_the_whole_angle_is_free(recommended: Units) -> None:
    checks_limiter.check_in_phase(recommended)


def test_what_is_inside_the_bounds_passes(recommended: Units) -> None:
    checks_limiter.check_passes(recommended)


def test_what_is_not_available_counts_as_the_last(recommended: Units) -> None:
    checks_limiter.check_limiter_holds(recommended)


def test_parameters_are_judged_one_by_one(limiter: Units) -> None:
    checks_limiter.check_limiter_parameters(limiter)


def test_the_defaults_are_those_of_the_configuration() -> None:
    """The checks here set the parameters from the configuration; the generated defaults are the same numbers."""
    for kind in ("pi", "tracking"):
        parameters = builds.of_kind(kind).software.parameters()
        own = units.make(builds.paper_map(), builds.CONFIGS[kind], "single", ("limiter",)).limiter_parameters()
        for name in dir(own):
            have, want = getattr(parameters.limiter, name), getattr(own, name)
            assert (have == want) if isinstance(want, float) else (list(have) == list(want)), name


MAIN = """
#include <stdio.h>
#include "ars_limiter.h"

static const ars_limiter_parameters_t parameters = {
    .rear_angle_max = 0.06f, .rear_rate_max = 0.7f, .opposite_phase_speed = { 16.0f, 33.0f },
    .opposite_phase_max = { 0.06f, 0.026f }, .in_phase_from_front_angle = 0.017f, .speed_max = 110.0f, .front_angle_max = 0.78f
};

int main(void)
{
    ars_limiter_t limiter;
    ars_limiter_input_t input;

    if (!ars_limiter_parameters_valid(&parameters)) {
        return 1;
    }
    ars_limiter_init(&limiter, 0.01f);
    while (fread(&input, sizeof(input), 1u, stdin) == 1u) {
        const float angle = ars_limiter_step(&limiter, &parameters, &input);
        (void)fwrite(&angle, sizeof(angle), 1u, stdout);
    }
    return 0;
}
"""


def test_it_works_alone_in_front_of_any_other_controller(tmp_path: Path) -> None:
    """Its source, its header and the sections are all that it needs; no library is called."""
    files = units.tracking().folder.files
    for name in ("include/ars_limiter.h", "include/ars_sections.h", "src/ars_limiter.c"):
        (tmp_path / Path(name).name).write_bytes(files[name])
    (tmp_path / "main.c").write_text(MAIN)
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    alone = [*compiler_command(), *flags]
    subprocess.run([*alone, "-ffreestanding", "-c", "ars_limiter.c", "-o", "limiter.o"], cwd=tmp_path, check=True)
    subprocess.run([*alone, "main.c", "limiter.o", "-o", "limiter"], cwd=tmp_path, check=True)
    with (tmp_path / "limiter.o").open("rb") as stream:
        table = ELFFile(stream).get_section_by_name(".symtab")
        assert isinstance(table, SymbolTableSection)
        assert {symbol.name for symbol in table.iter_symbols() if symbol["st_shndx"] == "SHN_UNDEF"} <= {""}
    parameters = units.tracking().limiter_parameters(
        rear_angle_max=0.06,
        rear_rate_max=0.7,
        opposite_phase_speed=[16.0, 33.0],
        opposite_phase_max=[0.06, 0.026],
        in_phase_from_front_angle=0.017,
        speed_max=110.0,
        front_angle_max=0.78,
    )
    inputs = checks_limiter.drive(units.tracking(), parameters, 3000)
    output = subprocess.run(["./limiter"], cwd=tmp_path, input=inputs.tobytes(), capture_output=True, check=True).stdout
    angles = np.array(struct.unpack(f"={len(inputs)}f", output), dtype=np.float32)
    assert np.array_equal(angles, units.tracking().limiter(parameters, inputs, 0.01))
