"""Check of the budgets: what keeps them passes, each planted fault is found as what it is, what cannot be counted is told."""

from __future__ import annotations

import functools
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from codegen.config import Kind
from codegen.emit.folder import Folder
from codegen.verify.budgets import check as budgets
from codegen.verify.budgets.taken import CYCLE
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool
from tests.verify import builds
from tests.verify.conftest import OfKind

AMPLE = {
    "lookup_instructions_max": 10_000,
    "reference_instructions_max": 10_000,
    "step_instructions_max": 10_000,
    "limiter_instructions_max": 10_000,
    "task_instructions_max": 10_000,
    "task_stack_bytes_max": 10_000,
    "state_bytes_max": 10_000,
}
"""What no build needs: a test lowers the one that it is about."""


STEP_MAX = 1_500
"""Instructions, limiter included: at 100 MHz and two cycles each, a third of a percent of the period of 10 ms."""


def subject_of(folder: Folder, files: Mapping[str, bytes] | None = None, limits: Mapping[str, int] | None = None) -> Subject:
    """A build, with budgets of its own where some are given."""
    manifest = dict(folder.manifest)
    if limits:
        manifest["configuration"] = {**manifest["configuration"], "budgets": dict(limits)}
    return Subject("sample", files or folder.files, manifest)


FEW = {"QUICK_SAMPLES": 60, "QUICK_ROUNDS": 1, "USUAL_SAMPLES": 20}
"""So few calls that a fault which every call meets is found, and nothing more."""


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    make_few(monkeypatch)


def make_few(patch: pytest.MonkeyPatch) -> None:
    for name, value in FEW.items():
        patch.setattr(f"codegen.verify.budgets.measure.{name}", value)
    patch.setattr("codegen.verify.budgets.states.long_ways", lambda ground: ())


@functools.cache
def sound() -> Outcome:
    """A "pi" as it is made, with the few calls of the planted ones."""
    with pytest.MonkeyPatch.context() as patch:
        make_few(patch)
        return run()


def run(files: Mapping[str, bytes] | None = None, limits: Mapping[str, int] | None = None) -> Outcome:
    return budgets.check(subject_of(builds.made("pi"), files, {**AMPLE, **(limits or {})}), Effort(quick=True))


def planted(path: str, pattern: str, replacement: str) -> dict[str, bytes]:
    """The files of a "pi" with the first match of a pattern in one of them replaced."""
    files = builds.made("pi").files
    text, count = re.subn(pattern, replacement, files[path].decode("ascii"), count=1, flags=re.DOTALL)
    assert count == 1, pattern
    return {**files, path: text.encode("ascii")}


def in_function(name: str, statements: str, before: str = "") -> dict[str, bytes]:
    """Statements in front of all others of a function in the file of its name."""
    unit = re.match(r"ars_[a-z0-9]+", name)
    assert unit
    path = f"src/{unit[0]}.c"
    # Its definition: no semicolon up to the brace. What stands in front of it stays there.
    return planted(path, rf"(ARS_SECTION_CODE [^;{{}}()]*\b{name}\([^;{{}}]*\)\n\{{\n)", rf"{before}\1{statements}")


# --- what keeps them -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", builds.KINDS)
def test_every_kind_keeps_its_budgets(kind: Kind, of_kind: OfKind) -> None:
    found = of_kind(kind)
    assert found.findings == ()
    assert found.verdict is Verdict.PASSED
    most = STEP_MAX if kind == "tracking" else STEP_MAX / 2  # the others have no reference model
    assert found.figures["functions"]["controller_step"]["instructions_with_limiter"]["max"] <= most


@pytest.mark.parametrize(("kind", "layers"), [("tracking", True), ("pi", False)])
def test_uneven_breakpoints_and_several_frictions_have_more(kind: Kind, layers: bool, of_kind: OfKind) -> None:
    found = of_kind(kind, "uneven", layers)
    assert found.findings == ()
    assert found.figures["functions"]["controller_step"]["instructions_with_limiter"]["max"] <= STEP_MAX
    assert found.figures["budgets"]["lookup_instructions_max"] > 95


@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_what_is_told(kind: Kind, of_kind: OfKind) -> None:
    found = of_kind(kind)
    figures = json.loads(json.dumps(found.figures, allow_nan=False))
    functions, stacks = figures["functions"], figures["stack_bytes"]
    lookups = {"map_yaw_rate", "map_yaw_rate_on_road", *({"map_reference"} if kind == "tracking" else set())}
    assert lookups | {"controller_step", "limiter_step", "task_10ms", CYCLE} <= set(functions)
    assert {"on_can_frame, motion", "on_can_frame, conditions"} <= set(functions)
    for count in functions.values():
        for figure in (count["instructions"], count["estimated_cycles"]):
            assert figure["min"] <= figure["mean"] <= figure["max"]
        assert count["instructions"]["max"] < count["estimated_cycles"]["max"]
    step = functions["controller_step"]
    assert step["instructions"]["max"] < step["instructions_with_limiter"]["max"]
    assert functions[CYCLE]["instructions_bound"] >= functions[CYCLE]["instructions"]["max"] > step["instructions"]["max"]
    assert stacks.keys() == {*lookups, "controller_step", "limiter_step", CYCLE}
    assert all(0 <= stack["watermark"] <= stack["bound"] for stack in stacks.values())
    assert stacks[CYCLE]["watermark"] > 0
    assert all(sizes["data"] == sizes["bss"] == 0 for sizes in figures["objects"].values())
    table = builds.made(kind).manifest["map"]["flash_bytes"]
    assert figures["objects"]["src/ars_calibration.c"]["rodata"] >= table
    assert figures["flash_bytes"] > table
    assert figures["mean_over"] == "the built-in scenarios in closed loop"
    assert re.fullmatch(r"lookup \d+, step [\d,]+ \+ limiter \d+, task [\d,]+ \(at most [\d,]+\) instructions", found.figure)
    assert set(found.tools) == {"ziglang", "unicorn", "pyelftools"}


@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_every_block_is_entered_or_named(kind: Kind, of_kind: OfKind) -> None:
    """What stays is where the compiler did not see that two conditions exclude each other."""
    blocks = of_kind(kind).figures["blocks"]
    never = [place for places in blocks["never"].values() for place in places]
    assert blocks["entered"] == blocks["all"] - len(never)
    assert len(never) <= 0.02 * blocks["all"], never
    assert all(re.fullmatch(r"src/ars_\w+\.c:\d+", place) for place in never)
    assert all(place in of_kind(kind).limits[-1] for place in never)
    # The search must come to the rarest of all: a command exactly between two codes.
    assert not any(place.startswith("src/ars_can.c") for place in never)


def test_blocks_behind_limits_that_are_off_are_entered_too() -> None:
    """The paper's controller has neither rate limit nor limiter; a calibration may turn them on."""
    found = budgets.check(Subject.read(Path(__file__).parents[2] / "generated" / "4ws2"), Effort(quick=True))
    blocks = found.figures["blocks"]
    never = [place for places in blocks["never"].values() for place in places]
    assert len(never) <= 0.02 * blocks["all"], never
    assert not any(place.startswith("src/ars_limiter.c") for place in never)


@pytest.mark.usefixtures("few")
def test_the_same_figures_each_time() -> None:
    assert run() == sound()
    assert sound().findings == ()
    assert sound().verdict is Verdict.PASSED


# --- planted faults ------------------------------------------------------------------------------------------------------

BLOATED = "    uint32_t k;\\n    volatile uint32_t planted = 0u;\\n\\n    for (k = 0u; k < 100u; k++) { planted = k; }\\n"


@pytest.mark.parametrize(
    ("function", "key", "told"),
    [
        ("ars_limiter_step", "limiter_instructions_max", "limiter_step: "),
        ("ars_controller_step", "step_instructions_max", "controller_step: "),
        ("ars_map_yaw_rate_on_road", "lookup_instructions_max", "map_yaw_rate_on_road: "),
        ("ars_task_on_can_frame", "task_instructions_max", f"{CYCLE}: "),
    ],
)
@pytest.mark.usefixtures("few")
def test_a_bloated_loop(function: str, key: str, told: str) -> None:
    """As much as there is without it is the budget; with it that is exceeded, and nothing else."""
    limit = _largest(sound(), told.rstrip(": "))
    found = run(in_function(function, BLOATED), {key: limit})
    assert found.verdict is Verdict.FAILED
    assert len(found.findings) == 1
    assert found.findings[0].startswith(told)
    assert f"budgets.{key} is {limit:,}; at speed " in found.findings[0]
    over = int(found.findings[0].removeprefix(told).split(" ")[0].replace(",", ""))
    assert over > limit + 100


def _largest(outcome: Outcome, function: str) -> int:
    count: dict[str, Any] = outcome.figures["functions"][function]
    return int(count.get("instructions_bound", count["instructions"]["max"]))


@pytest.mark.usefixtures("few")
def test_a_buffer_of_its_own() -> None:
    buffer = "static volatile uint8_t planted_buffer[200];"
    files = in_function("ars_limiter_step", "    planted_buffer[0] = 1u;\\n", f"{buffer}\\n\\n")
    found = run(files)
    line = files["src/ars_limiter.c"].decode().splitlines().index(buffer) + 1
    assert found.findings == (
        f"src/ars_limiter.c:{line}: 200 bytes of RAM of its own (planted_buffer); state is the caller's, and maps lie in flash",
    )
    assert found.verdict is Verdict.FAILED


@pytest.mark.usefixtures("few")
def test_a_table_in_ram() -> None:
    """A table without const that others might write to: it has start values, and takes flash and RAM."""
    found = run(planted("src/ars_calibration.c", r"\Z", "float ars_map_other_table[3] = { 1.0f, 2.0f, 3.0f };\n"))
    assert [finding.split(" of RAM ")[1] for finding in found.findings] == [
        "of its own (ars_map_other_table); state is the caller's, and maps lie in flash"
    ]


@pytest.mark.usefixtures("few")
def test_a_deep_stack() -> None:
    deep = "    volatile float planted[64];\\n    volatile uint32_t k = 0u;\\n\\n    planted[k] = 1.0f;\\n"
    found = run(in_function("ars_limiter_step", deep), {"task_stack_bytes_max": 250})
    assert len(found.findings) == 1
    told = re.fullmatch(
        r"cycle: (\d+) bytes of stack, budgets\.task_stack_bytes_max is 250; deepest in ars_task_10ms > .*ars_limiter_step",
        found.findings[0],
    )
    assert told
    assert int(told[1]) > 256
    assert sound().figures["stack_bytes"][CYCLE]["bound"] <= 250


@pytest.mark.usefixtures("few")
def test_stack_that_the_compiler_does_not_know_of() -> None:
    hidden = '    __asm__ volatile ("sub sp, #512; str r0, [sp]; add sp, #512" ::: "memory");\\n'
    found = run(in_function("ars_limiter_step", hidden))
    unread, *told = found.findings
    assert unread.startswith("src/ars_limiter.c: not plain C99: ")  # assembly may hold a loop
    assert {finding.split(":")[0] for finding in told} == {"limiter_step", "controller_step", CYCLE}
    assert re.search(r"limiter_step: 51\d bytes of stack were used, by the compiler \d+ are the most", told[0])


def test_a_call_through_a_pointer_has_no_bound() -> None:
    before = (
        "static float planted_same(float value) { return value * 1.0f; }\\n"
        "float (*volatile const planted_pointer)(float value) = planted_same;\\n\\n"
    )
    found = run(in_function("ars_limiter_init", "    self->speed = planted_pointer(rear_angle);\\n", before))
    (call,) = found.findings
    assert re.fullmatch(
        r"src/ars_limiter\.c:\d+: a call of planted_pointer in ars_limiter_init: instructions without a bound", call
    )
    assert found.verdict is Verdict.FAILED


@pytest.mark.usefixtures("few")
def test_stack_without_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a compiler does not tell how much a function takes."""
    monkeypatch.setattr("codegen.verify.budgets.counting.FLAGS", ("-O2",))
    found = run()
    assert [finding.split(":")[0] for finding in found.findings] == [*sound().figures["stack_bytes"]]
    assert all(": the compiler does not tell how much stack it takes" in finding for finding in found.findings)
    assert found.verdict is Verdict.FAILED


def test_a_loop_without_a_fixed_number_of_rounds() -> None:
    """However few instructions it takes, or if it never ends: it is not run."""
    few = "    uint32_t k = 0u;\\n\\n    while ((float)k < input->speed) { k += 100u; }\\n"
    endless = "    volatile uint32_t k = 0u;\\n\\n    do { k = 0u; } while (k < 1u);\\n"
    for function, loop, kind in (("ars_limiter_step", few, "while"), ("ars_limiter_init", endless, "dowhile")):
        files = in_function(function, loop)
        found = run(files)
        line = 1 + next(k for k, text in enumerate(files["src/ars_limiter.c"].decode().splitlines()) if "while (" in text)
        assert found.findings == (f"src/ars_limiter.c:{line}: {kind} in {function}: instructions without a bound",)
        assert found.verdict is Verdict.FAILED


@pytest.mark.usefixtures("few")
def test_a_large_instance() -> None:
    field = r"\1    float planted[16];\n} ars_controller_t;"
    found = run(
        planted("include/ars_controller.h", r"(    float integral;.*?)\} ars_controller_t;", field), {"state_bytes_max": 64}
    )
    assert len(found.findings) == 1
    assert re.fullmatch(r"ars_controller_t: \d+ bytes, budgets\.state_bytes_max is 64", found.findings[0])


@pytest.mark.usefixtures("few")
def test_flash_is_judged_where_a_budget_is_given() -> None:
    found = run(limits={"flash_bytes_max": 10_000})
    assert len(found.findings) == 1
    assert re.fullmatch(r"all objects: [\d,]+ bytes of flash, budgets\.flash_bytes_max is 10,000", found.findings[0])
    assert found.figures["budgets"]["flash_bytes_max"] == 10_000


# --- what cannot be counted ----------------------------------------------------------------------------------------------


def test_c_that_does_not_compile() -> None:
    found = run(in_function("ars_limiter_step", "    planted;\\n"))
    assert found.verdict is Verdict.FAILED
    assert re.match(r"src/ars_limiter\.c:\d+: the C does not compile: ", found.findings[0])


@pytest.mark.usefixtures("few")
def test_code_that_goes_astray() -> None:
    found = run(in_function("ars_limiter_step", "    *(volatile uint32_t *)0x10u = 1u;\\n"))
    assert found.verdict is Verdict.FAILED
    assert "ended at 0x" in found.findings[0]


@pytest.mark.usefixtures("few")
def test_without_a_compiler_for_this_machine_the_means_are_over_drawn_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    found = run()
    assert found.verdict is Verdict.PASSED
    assert found.figures["mean_over"] == "drawn inputs"
    assert budgets.NOT_IN_CLOSED_LOOP in found.limits
    assert budgets.NOT_IN_CLOSED_LOOP not in sound().limits


def test_double_precision_is_not_for_this_core() -> None:
    folder = builds.made("pi", precision="double")
    found = budgets.check(subject_of(folder), Effort())
    assert found.verdict is Verdict.NOT_RUN
    assert found.findings == ("a build in double precision is not for a Cortex-M4F, whose FPU has single precision",)


@pytest.mark.parametrize(("name", "package"), [("unicorn", "unicorn"), ("elftools.elf.elffile", "pyelftools")])
def test_a_missing_package(monkeypatch: pytest.MonkeyPatch, name: str, package: str) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingTool) as caught:
        run()
    assert str(caught.value).startswith(f"{package}: it cannot be imported (")
    assert str(caught.value).endswith('; pip install "ars-codegen[verify]"')
    assert caught.value.exit_code == 2


def test_a_missing_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingTool, match=r'^ziglang: it is not installed; pip install "ars-codegen\[verify\]"$'):
        run()
