"""Check `processor-in-the-loop`: a difference of the byte order is found. tests/evidence/verify has sound builds."""

import sys

import pytest

from codegen.verify import bounded_loops
from codegen.verify import emulated_runs as pil
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.target import POWERPC_BE
from codegen.verify.tools import MissingTool
from tests.verify import builds, planted

STEPS = 1_500
"""Enough for the tour through every status and some of the other steps."""
PI = builds.made("pi", "uneven")


@pytest.fixture(autouse=True)
def little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run few steps on the big-endian core only, without the dynamics and the search for endless loops."""
    monkeypatch.setattr(pil, "QUICK_STEPS", STEPS)
    monkeypatch.setattr(pil, "CORES", {True: (POWERPC_BE,)})
    monkeypatch.setattr(pil, "_dynamics", lambda *given: {})
    monkeypatch.setattr(bounded_loops, "complaints", lambda files, manifest: ())


def checked(subject: Subject) -> Outcome:
    return pil.check(subject, Effort(quick=True))


def test_a_difference_of_the_byte_order_is_found() -> None:
    body = (
        "    union { uint16_t word; uint8_t bytes[2]; } unpacked;\n"
        "    planted_ars_can_pack_rear_steer_command(signals, data);\n"
        "    unpacked.word = signals->diagnostics;\n    data[6] = unpacked.bytes[0];\n    data[7] = unpacked.bytes[1];"
    )
    subject = planted.wrapped(PI, "ars_can_pack_rear_steer_command", body)
    found = checked(subject)
    assert found.verdict is Verdict.FAILED
    assert found.findings[0].startswith("PowerPC, big-endian: can, message ")
    assert ": command_data[4..7] is 0x" in found.findings[0]
    assert "on this machine; speed = " in found.findings[0]
    assert any(": disturbed traffic, cycle " in finding for finding in found.findings)
    assert found.figures["mismatches"]["PowerPC, big-endian"]["random steps"] == 0


@pytest.mark.parametrize(("name", "package"), [("unicorn", "unicorn"), ("elftools.elf.elffile", "pyelftools")])
def test_a_missing_tool_is_no_verdict(monkeypatch: pytest.MonkeyPatch, name: str, package: str) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingTool, match=f"^{package}: it "):
        checked(planted.subject_of(PI))
