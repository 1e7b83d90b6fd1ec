"""The longest step of the controller: bounded for every kind, the sum of its parts, and found where it is rare."""

from __future__ import annotations

import pytest

from codegen.config import Kind
from codegen.errors import BuildError
from codegen.verify.budgets.measure import measure_step
from codegen.verify.budgets.taken import LongestStep
from codegen.verify.check import Effort, Subject
from tests.verify import builds
from tests.verify.conftest import OfKind, Once
from tests.verify.test_budgets import STEP_MAX

NOPS = 1_000
"""Instructions that are planted: more than a step of a "pi" has, so that one with them is the longest."""

QUICK = Effort(quick=True)


def longest(kind: Kind, grid: str = "even", layers: bool = False) -> LongestStep:
    folder = builds.made(kind, grid, layers)
    return measure_step(Subject("sample", folder.files, folder.manifest), QUICK)


@pytest.fixture(scope="session")
def usual(once: Once) -> LongestStep:
    """Of the "pi" without what is planted."""
    found: LongestStep = once("longest-step-pi", lambda: longest("pi"))
    return found


@pytest.mark.parametrize(("grid", "layers"), [("even", True), ("uneven", False)])
def test_of_the_recommended_controller(grid: str, layers: bool) -> None:
    """Of its other builds the check itself tells."""
    found = longest("tracking", grid, layers)
    assert found.mean < found.worst <= STEP_MAX, found


def test_is_that_of_the_check(usual: LongestStep, of_kind: OfKind) -> None:
    told = of_kind("pi").figures["functions"]["controller_step"]
    assert (usual.worst, round(usual.mean, 1)) == tuple(told["instructions_with_limiter"][key] for key in ("max", "mean"))
    assert 0 < usual.worst - usual.limiter <= told["instructions"]["max"]
    assert usual.calls == told["calls"]


def with_nops(path: str, before: str, condition: str = "true") -> LongestStep:
    """A "pi" with instructions more where a condition holds. Written out: the compiler guesses the size by counting."""
    planted = f'    if ({condition}) {{ __asm__ volatile ("{"nop; " * NOPS}"); }}\n'
    folder = builds.made("pi")
    files = builds.with_text(folder, path, before, planted + before)
    return measure_step(Subject("sample", files, folder.manifest), QUICK)


def test_the_limiter_s_part_is_told_apart(usual: LongestStep) -> None:
    after = with_nops("src/ars_limiter.c", "    self->rear_angle = clamp(target, ")
    assert 0 < usual.limiter < usual.worst
    # With so many the compiler lays the code out anew, by a few instructions.
    assert after.worst - usual.worst == after.limiter - usual.limiter
    assert after.limiter - usual.limiter == pytest.approx(NOPS, abs=5)


CONTROLLER = "src/ars_controller.c"
LAW_STARTS = "    self->status = law_step("
COUNT_IS_FULL = "    self->good_samples = 0u;\n    if ((self->status"


@pytest.mark.parametrize(
    ("where", "condition", "follows"),
    [
        # After a gap or standby alone.
        pytest.param(LAW_STARTS, "starts", True, id="the law starts afresh"),
        pytest.param("            self->good_samples = 0u;\n            self->status", "true", True, id="a recovery ends"),
        pytest.param("        self->implausible_samples = 0u;\n", "self->implausible_samples > 0u", True, id="plausible again"),
        pytest.param("            /* between the two speeds nothing changes */\n", "true", True, id="between two speeds"),
        # After eleven minutes without a sample.
        pytest.param(COUNT_IS_FULL, "self->bad_samples == UINT16_MAX", False, id="a count is full"),
    ],
)
def test_what_is_rare_is_found(where: str, condition: str, follows: bool, usual: LongestStep) -> None:
    """And, where the law may follow on it, with nearly the longest of what else a step can do."""
    found = with_nops(CONTROLLER, where, condition).worst
    assert found >= NOPS + (0.9 * usual.worst if follows else 0)


def test_double_precision_is_refused() -> None:
    folder = builds.made("pi", precision="double")
    with pytest.raises(BuildError, match=r"^options\.precision: .*single precision; build with --precision single$"):
        measure_step(Subject("sample", folder.files, folder.manifest), QUICK)
