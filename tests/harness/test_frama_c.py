"""Frama-C's EVA as a part of the evidence: reading its report, arguments about alarms, and the driver. Runs without Frama-C."""

import stat
from pathlib import Path

import pytest

from codegen.verify.check import Effort, Verdict
from tests.evidence.frama_c import frama_c
from tests.evidence.frama_c.frama_c import Alarm, Analysis, Argument
from tests.evidence.parts import FOLDERS
from tests.evidence.progress import Progress

PI = FOLDERS[0]
ALARM = Alarm("src/ars_map.c", 7, "f", "a = b;", "b > 0", "mem_access", False)
ARGUMENT = Argument(unit="map", function="f", statement="a = b;", claim="b > 0", reason="it is")
TEXT = "4ws2/src/ars_map.c:7: possible: mem_access: b > 0 in f(): `a = b;`"


def analysis(*alarms: Alarm, unreached: tuple[str, ...] = ()) -> Analysis:
    """Return an analysis with alarms."""
    return Analysis("4ws2", "ars", alarms, 10, unreached, ("map",))


def test_an_alarm_counts_unless_it_is_argued() -> None:
    outcome = frama_c.outcome_of([analysis(ALARM)], [], "25")
    assert (outcome.verdict, outcome.findings) == (Verdict.FAILED, (TEXT,))
    argued = frama_c.outcome_of([analysis(ALARM)], [ARGUMENT], "25")
    assert argued.verdict is Verdict.PASSED
    assert argued.figure == "1 alarms, 1 of them argued to be false; 10 of 10 functions; Frama-C 25"
    assert argued.figures["4ws2"]["alarms"] == [TEXT]
    # A certain alarm cannot be argued away, and what was not analysed is not passed.
    for none in ([analysis(ALARM._replace(certain=True))], [analysis(unreached=("g",))], []):
        assert frama_c.outcome_of(none, [ARGUMENT], "").verdict is Verdict.FAILED


def test_an_argument_is_for_one_alarm_and_needs_it() -> None:
    for field in ("function", "statement", "claim"):
        findings = frama_c.outcome_of([analysis(ALARM)], [ARGUMENT._replace(**{field: "other"})], "").findings
        assert findings[0] == TEXT and findings[1].endswith("is argued to be a false alarm, but is no alarm")


def test_the_report_of_frama_c_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (PI / "src/ars_can.c").read_text(encoding="ascii").splitlines()
    line = 1 + next(k for k, each in enumerate(text) if "(int32_t)scaled" in each)
    rows = "directory\tfile\tline\tfunction\tproperty kind\tstatus\tproperty\n" + "".join(
        f"{folder}\tars_can.c\t{line}\tto_code\tfloat_to_int\tUnknown\t\\is_finite(scaled)\n"
        for folder in ("src", "share/libc")
    )
    script = tmp_path / "frama-c"
    script.write_text(
        f"""#!/bin/sh
[ "$1" = -version ] && echo 25 && exit
[ -f driver.c ] && [ -f src/ars_can.c ] || exit 3
cat > alarms.csv << 'END'
{rows}END
echo "  to_code: 20 stmts out of 21 (95%)"
echo "  clamp: 5 stmts out of 5 (100%)"
""",
        encoding="ascii",
    )
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    outcome = frama_c.run([PI], Effort(), Progress())
    (alarm,) = outcome.figures["4ws2"]["alarms"]
    place = f"4ws2/src/ars_can.c:{line}: possible: float_to_int: \\is_finite(scaled)"
    assert alarm == f"{place} in to_code(): `const int32_t whole = (int32_t)scaled;`"
    assert outcome.figure.startswith("1 alarms, 1 of them argued to be false; 2 of ")
    # The controller and the limiter both define clamp(), and one is reached.
    assert outcome.findings.count("4ws2: clamp() is not analysed") == 1
    assert "4ws2: to_code() is not analysed" not in outcome.findings
