"""Tests of `sanitizers` that take seconds each."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from codegen.errors import BuildError
from codegen.verify.pil import runners
from codegen.verify.sanitizers import trap_build
from tests.verify import planted
from tests.verify.test_sanitizers import PI, QUICK, with_wrapped


def test_undefined_behaviour_traps_in_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limiter and the dynamics, which are run apart. The row is counted over all parts that a stream is cut into."""
    monkeypatch.setattr(runners, "DATA_BYTES", 8 * 1024)
    counting = "    static int32_t calls = INT32_MAX - 700;\n\n    calls++;"
    subject = with_wrapped(
        replace(PI, files=planted.limiter(PI, counting).files),
        dynamics_linear=(
            "    ars_dynamics_state_t result = planted_ars_dynamics_linear(state, input);\n"
            "    result.yaw_rate += 0.0f * (float)(int)(1.0e30f * input->speed);\n    return result;"
        ),
    )
    line = 1 + subject.files["src/ars_limiter.c"].decode().splitlines().index("    calls++;")
    limiter, dynamics = trap_build.trapped(subject, QUICK)
    assert limiter.startswith(f"src/ars_limiter.c:{line}: signed integer addition overflow")
    assert ", on the Cortex-M4F; random steps, step 700: restart = " in limiter
    assert re.match(r"src/ars_dynamics\.c:\d+: Floating-point to integer conversion overflowed, ", dynamics)
    assert "; dynamics, point 0: wrong_call = 0, " in dynamics
    with pytest.raises(BuildError, match=r"^src/ars_limiter\.c:\d+: "):
        trap_build.trapped(planted.limiter(PI, "    result = ;"), QUICK)
