"""Frama-C's EVA as a part of the evidence: its report is read, and an alarm counts unless argued. Runs without Frama-C."""

from pathlib import Path

import pytest

from codegen.verify.check import Effort, Verdict
from tests.evidence.frama_c import frama_c
from tests.evidence.frama_c.frama_c import Alarm, Analysis, Argument
from tests.evidence.parts import FOLDERS
from tests.evidence.progress import Progress

ALARM = Alarm("src/ars_map.c", 7, "f", "a = b;", "b > 0", "mem_access", False)
ARGUMENT = Argument(unit="map", function="f", statement="a = b;", claim="b > 0", reason="it is")


def test_an_alarm_counts_unless_it_is_argued_and_an_argument_needs_its_alarm() -> None:
    def findings(alarm: Alarm, *argued: Argument) -> tuple[str, ...]:
        return tuple(frama_c.outcome_of([Analysis("4ws2", "ars", [alarm], 10, (), ("map",))], argued, "25").findings)

    text = "4ws2/src/ars_map.c:7: possible: mem_access: b > 0 in f(): `a = b;`"
    assert findings(ALARM) == (text,) and findings(ALARM, ARGUMENT) == ()
    assert len(findings(ALARM._replace(certain=True), ARGUMENT)) == 2
    assert findings(ALARM, ARGUMENT._replace(claim="other"))[0] == text
    assert frama_c.outcome_of([], [ARGUMENT], "").verdict is Verdict.FAILED, "what was not analysed is not passed"


def test_the_report_of_frama_c_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (FOLDERS[0] / "src/ars_can.c").read_text(encoding="ascii").splitlines()
    line = 1 + next(k for k, each in enumerate(text) if "(int32_t)scaled" in each)
    rows = "directory\tfile\tline\tfunction\tproperty kind\tstatus\tproperty\n"
    rows += f"src\tars_can.c\t{line}\tto_code\tfloat_to_int\tUnknown\t\\is_finite(scaled)\n"
    script = tmp_path / "frama-c"
    script.write_text(
        f"#!/bin/sh\n[ -f driver.c ] && [ -f src/ars_can.c ] && cat > alarms.csv << 'END'\n{rows}END\n"
        "echo '  to_code: 20 stmts out of 21 (95%)'\necho '  clamp: 5 stmts out of 5 (100%)'\n",
        encoding="ascii",
    )
    script.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    outcome = frama_c.run(FOLDERS[:1], Effort(), Progress())
    place = f"4ws2/src/ars_can.c:{line}: possible: float_to_int: \\is_finite(scaled)"
    assert outcome.figures["4ws2"]["alarms"] == [f"{place} in to_code(): `const int32_t whole = (int32_t)scaled;`"]
    assert outcome.figure.startswith("1 alarms, 1 of them argued to be false; 2 of ")
    # Controller, law and limiter define clamp() each, and one is reached.
    assert outcome.findings.count("4ws2: clamp() is not analysed") == 2
    assert "4ws2: to_code() is not analysed" not in outcome.findings
