"""The trap build: nothing traps in what is generated, and each kind of undefined behaviour does."""

from __future__ import annotations

import pytest

from codegen.config import Kind
from codegen.errors import BuildError
from codegen.verify.check import Effort, Subject
from codegen.verify.packages import MissingTool
from codegen.verify.pil import runners
from codegen.verify.sanitizers import trap_build
from codegen.verify.sanitizers.trap_build import trapped
from tests.verify import builds, planted

PI = builds.made("pi")


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trap_build, "QUICK_STEPS", 1_500)


def found(subject: Subject) -> tuple[str, ...]:
    return trapped(subject, Effort(quick=True))


@pytest.mark.parametrize("kind", builds.KINDS)
def test_nothing_traps_in_what_is_generated(kind: Kind) -> None:
    assert found(planted.subject_of(builds.made(kind))) == ()


def test_nor_with_uneven_axes_and_several_frictions() -> None:
    assert found(planted.subject_of(builds.made("tracking", "uneven", layers=True))) == ()


@pytest.mark.parametrize(
    ("statement", "why"),
    [
        ("result += 0.0f * (float)(int8_t)((float)far * 1.0e6f);", "Floating-point to integer conversion overflowed"),
        ("result += input->demand / ((float)far * 0.0f);", "Division by zero, or one whose result does not fit"),
        ("result += (float)(1 / (far - 6));", "Division by zero, or one whose result does not fit"),
        ("result += 0.0f * parameters->opposite_phase_max[far];", "Array index out of bounds"),
        ("result += 0.0f * (float)(far * 400000000);", "signed integer multiplication overflow in 'far * 400000000'"),
        ("result += 0.0f * (float)(1u << (far * 6));", "Shift exponent is too large for the type"),
    ],
)
def test_undefined_behaviour_traps(statement: str, why: str) -> None:
    subject = planted.limiter(PI, f"    const int32_t far = (input->demand > 0.05f) ? 6 : 0;\n\n    {statement}")
    lines = subject.files["src/ars_limiter.c"].decode().splitlines()
    line = 1 + lines.index(f"    {statement}")
    (finding,) = found(subject)
    assert finding.startswith(f"src/ars_limiter.c:{line}: {why}, on the Cortex-M4F; ")
    assert ": restart = " in finding


def test_the_row_that_traps_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted over all parts that a drive is cut into: here of 85 rows, and one call of the limiter in each."""
    monkeypatch.setattr(runners, "DATA_BYTES", 8 * 1024)
    (finding,) = found(planted.limiter(PI, "    static int32_t calls = INT32_MAX - 700;\n\n    calls++;"))
    assert ", on the Cortex-M4F; random steps, step 700: restart = " in finding


def test_the_dynamics_are_run_too() -> None:
    subject = planted.wrapped(
        PI,
        "ars_dynamics",
        "ars_dynamics_linear",
        "ars_dynamics_state_t ars_dynamics_linear(const ars_dynamics_state_t *state, const ars_dynamics_input_t *input)",
        "    ars_dynamics_state_t result = planted_ars_dynamics_linear(state, input);\n"
        "    result.yaw_rate += 0.0f * (float)(int)(1.0e30f * input->speed);\n    return result;",
    )
    (finding,) = found(subject)
    assert finding.startswith("src/ars_dynamics.c:")
    assert "; dynamics, point 0: wrong_call = 0, " in finding


def test_c_that_does_not_compile_is_no_finding() -> None:
    with pytest.raises(BuildError, match=r"^src/ars_limiter\.c:\d+: "):
        found(planted.limiter(PI, "    result = ;"))


def test_a_missing_package_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingTool, match=r"^ziglang: it is not installed"):
        found(planted.subject_of(PI))
