"""The generated controller on a Cortex-M4F: the same bits as here, and a bounded number of instructions."""

from __future__ import annotations

import functools
import math
import sys

import numpy as np
import pytest

from codegen.config import Kind
from codegen.emit.folder import Folder
from codegen.errors import BuildError, CodegenError
from codegen.sil.software import Measurement, Status
from codegen.verify import cortex_m
from codegen.verify.cortex_m import InstructionCounts, compare_with_host, count_steps, worst_step, worst_step_instructions
from codegen.verify.drives import Ground, drawn, recorded
from codegen.verify.target.on_target import drive_of
from tests.verify import builds

STEP_MAX = 1_500
"""Instructions: at 100 MHz and two cycles each, a third of a percent of the period of 10 ms."""

NOPS = 400
"""Instructions that are planted: so many that a step with them is the longest of its status."""

TURN = Measurement(15.0, 0.07, 0.3, friction=0.8)
LOST = Measurement(math.nan, 0.07, 0.3)


@functools.cache
def longest(kind: Kind = "tracking", grid: str = "even", layers: bool = False) -> InstructionCounts:
    folder = builds.made(kind, grid, layers)
    return worst_step(folder.files, folder.manifest, builds.compiled(kind, grid, layers))


@pytest.mark.parametrize("layers", [False, True], ids=["one map", "4 frictions"])
@pytest.mark.parametrize("grid", builds.GRIDS)
def test_the_longest_step_of_the_recommended_controller(grid: str, layers: bool) -> None:
    found = longest("tracking", grid, layers)
    assert found.worst <= STEP_MAX, found
    assert found.mean < found.worst
    assert set(found.worst_by_status) == set(Status)
    assert sum(found.parts.values()) == found.worst
    assert {"ars_controller_step", "ars_limiter_step", "ars_map_reference", "ars_reference_model_step"} <= set(found.parts)


@pytest.mark.parametrize("kind", builds.KINDS[1:])
def test_the_longest_step_of_the_others(kind: Kind) -> None:
    found = longest(kind)
    assert found.worst <= STEP_MAX / 2  # they have no reference model
    assert set(found.worst_by_status) == set(Status)


@pytest.mark.parametrize("kind", builds.KINDS)
def test_closed_loop_commands_have_the_same_bits_as_on_the_host(kind: Kind) -> None:
    folder, software = builds.made(kind), builds.compiled(kind)
    found = compare_with_host(folder.files, folder.manifest, recorded(software), software)
    assert found.samples >= 2_000
    assert found.different == ()


@pytest.mark.parametrize(("grid", "layers"), [("even", False), ("uneven", True)])
def test_commands_for_anything_have_the_same_bits_as_on_the_host(grid: str, layers: bool) -> None:
    """NaN, infinity, gaps and jumps included: every command is finite, so no payload of a NaN can differ."""
    folder, software = builds.made("tracking", grid, layers), builds.compiled("tracking", grid, layers)
    found = compare_with_host(folder.files, folder.manifest, drawn(Ground.of(folder.manifest), 1_000), software)
    assert found.samples == 5_000
    assert found.different == ()


def test_a_command_that_differs_is_found() -> None:
    """The smallest change: the limiter's result, one unit in the last place away, where the car turns to the right."""
    folder, path = builds.made("pi"), "src/ars_limiter.c"
    old = "    return self->rear_angle;\n}"
    new = "    return (input->front_angle < 0.0f) ? (self->rear_angle * 1.0000001f) : self->rear_angle;\n}"
    drive = drive_of([TURN, TURN, Measurement(15.0, -0.07, -0.2), TURN])
    found = compare_with_host(builds.with_text(folder, path, old, new), folder.manifest, [drive], builds.compiled("pi"))
    assert found.different == ((0, 2),)


# --- counting ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder() -> Folder:
    return builds.made("pi")


def nops_in(folder: Folder, before: str, condition: str = "true") -> dict[str, bytes]:
    """The build with instructions more where a condition holds. Written out: the compiler guesses the size by counting."""
    planted = f'    if ({condition}) {{ __asm__ volatile ("{"nop; " * NOPS}"); }}\n'
    return builds.with_text(folder, "src/ars_controller.c", before, planted + before)


def test_each_step_is_counted_by_itself(folder: Folder) -> None:
    """Instructions more in the fail-safe show in its steps alone, each of them once."""
    drive = drive_of([TURN] * 3 + [LOST] * 6)
    before = count_steps(folder.files, folder.manifest, [drive])
    after = count_steps(nops_in(folder, "    self->yaw_rate_reference = 0.0f;\n}\n\n/* The estimate"), folder.manifest, [drive])
    assert before.steps == 9
    assert after.worst_by_status[Status.FAIL_SAFE] == before.worst_by_status[Status.FAIL_SAFE] + NOPS
    for status in (Status.TRACKING, Status.LIMITED, Status.DEGRADED):
        assert after.worst_by_status.get(status) == before.worst_by_status.get(status)
    # Six samples are lost: as many are held as the configuration says, the others are in the fail-safe.
    lost = 6 - builds.config_of("pi").controller.fail_safe.degraded_samples_max
    assert after.mean == pytest.approx(before.mean + NOPS * lost / 9.0)


def test_worst_input_is_the_measurement_of_the_longest_step(folder: Folder) -> None:
    drive = drive_of([TURN, TURN, TURN, LOST])
    found = count_steps(nops_in(folder, "    self->good_samples = 0u;\n    if ((self->status"), folder.manifest, [drive])
    assert found.worst == found.worst_by_status[Status.DEGRADED]
    assert math.isnan(found.worst_input[-1].speed)
    assert [each.speed for each in found.worst_input[:-1]] == [15.0, 15.0]


def test_drives_longer_than_the_targets_memory_are_run_in_parts(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = drawn(Ground.of(folder.manifest), 300)[2]
    whole = count_steps(folder.files, folder.manifest, [drive])
    monkeypatch.setattr("codegen.verify.target.on_target.CHUNK", 7)
    assert count_steps(folder.files, folder.manifest, [drive]).to_dict() == whole.to_dict()


@pytest.mark.parametrize(
    ("where", "condition", "found"),
    [
        # The law starts afresh, which follows only on a gap or standby.
        ("    self->status = law_step(", "starts", (Status.TRACKING, Status.LIMITED)),
        # The last moment of a recovery from the fail-safe.
        (
            "            self->good_samples = 0u;\n            self->status",
            "true",
            (Status.TRACKING, Status.LIMITED, Status.STANDBY),
        ),
        ("        self->implausible_samples = 0u;\n", "true", tuple(Status)),
        ("            /* between the two speeds nothing changes */\n", "true", tuple(Status)),
    ],
)
def test_the_search_finds_what_is_rare(where: str, condition: str, found: tuple[Status, ...]) -> None:
    folder, before = builds.made("pi"), longest("pi")
    after = worst_step(nops_in(folder, where, condition), folder.manifest, builds.compiled("pi"))
    # What is rare need not be met in what was the longest step before, but it must not be missed.
    longer = [status for status in found if after.worst_by_status[status] >= before.worst_by_status[status] + NOPS // 2]
    assert longer


def test_the_search_goes_to_the_last_cell_of_the_schedule() -> None:
    speeds = np.concatenate([drive[:, 0] for drive in drawn(Ground.of(builds.made().manifest), 1_000)])
    breakpoints = np.array(builds.SCHEDULE["speed_km_h"], dtype=np.float32) / np.float32(3.6)
    cells = np.searchsorted(breakpoints, speeds[np.isfinite(speeds)])
    assert set(range(len(breakpoints))) <= set(cells.tolist())


def test_the_number_alone(folder: Folder) -> None:
    """As the suite takes it, and the same each time."""
    number = worst_step_instructions(folder.files, folder.manifest)
    assert number == longest("pi").worst


def test_optimisation_counts(folder: Folder) -> None:
    drive = drive_of([TURN] * 3)
    counts = {flag: count_steps(folder.files, folder.manifest, [drive], flags=(flag,)).worst for flag in ("-O0", "-Os", "-O2")}
    assert counts["-O2"] < counts["-O0"]
    assert counts["-Os"] < counts["-O0"]


# --- what cannot be counted --------------------------------------------------------------------------------------------


def test_double_precision_is_refused() -> None:
    folder = builds.made("pi", precision="double")
    with pytest.raises(BuildError, match=r"^options\.precision: .*single precision; build with --precision single$"):
        count_steps(folder.files, folder.manifest, [drive_of([TURN])])


def test_c_that_does_not_compile(folder: Folder) -> None:
    files = builds.with_text(folder, "src/ars_limiter.c", "bool valid = ", "bool valid == ")
    with pytest.raises(BuildError, match=r"^src/ars_limiter\.c:\d+: the C does not compile: "):
        cortex_m.count_steps(files, folder.manifest, [drive_of([TURN])])


@pytest.mark.parametrize(("name", "package"), [("unicorn", "unicorn"), ("elftools.elf.elffile", "pyelftools")])
def test_a_missing_package(folder: Folder, monkeypatch: pytest.MonkeyPatch, name: str, package: str) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(CodegenError) as caught:
        worst_step_instructions(folder.files, folder.manifest)
    assert str(caught.value).startswith(f"{package}: it cannot be imported (")
    assert str(caught.value).endswith('; pip install "ars-codegen[verify]"')
    assert caught.value.exit_code == 2


def test_a_missing_compiler(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(CodegenError, match=r'^ziglang: it is not installed; pip install "ars-codegen\[verify\]"$'):
        worst_step_instructions(folder.files, folder.manifest)
