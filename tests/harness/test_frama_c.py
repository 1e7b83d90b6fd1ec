"""Frama-C's EVA as a part of the evidence: reading its report, arguments about alarms, and the driver. Runs without Frama-C."""

import dataclasses
import stat
from pathlib import Path

import pytest

from codegen.errors import BuildError
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.packages import MissingTool
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
    return Analysis("4ws2", "ars", alarms, 10, 100, 90, (), unreached, ("map",))


def test_every_public_function_has_an_entry() -> None:
    for folder in FOLDERS:
        subject = Subject.read(folder)
        assert ("entry_reference_model();" in frama_c.driver_of(subject)) is (subject.kind == "tracking")
    header = "include/ars_limiter.h"
    text = subject.files[header].replace(b"#ifdef __cplusplus\n}", b"void ars_limiter_new(int value);\n#ifdef __cplusplus\n}")
    with pytest.raises(BuildError, match=r"no entry of frama_c.c.j2 calls ars_limiter_new\(\)"):
        frama_c.driver_of(dataclasses.replace(subject, files={**subject.files, header: text}))


def test_an_alarm_counts_unless_it_is_argued() -> None:
    outcome = frama_c.outcome_of([analysis(ALARM)], [], "25")
    assert (outcome.verdict, outcome.findings) == (Verdict.FAILED, (TEXT,))
    argued = frama_c.outcome_of([analysis(ALARM)], [ARGUMENT], "25")
    assert argued.verdict is Verdict.PASSED
    assert argued.figure == "1 alarms, 1 of them argued to be false; 10 of 10 functions, 90 of 100 statements; Frama-C 25"
    assert argued.figures["4ws2"]["alarms"] == [TEXT]
    # A certain alarm cannot be argued away.
    assert frama_c.outcome_of([analysis(ALARM._replace(certain=True))], [ARGUMENT], "").verdict is Verdict.FAILED


@pytest.mark.parametrize("field", ["unit", "function", "statement", "claim"])
def test_an_argument_is_for_one_alarm_and_needs_it(field: str) -> None:
    other = ARGUMENT._replace(**{field: "other"})
    findings = frama_c.outcome_of([analysis(ALARM)], [other], "").findings
    text = f"frama_c.toml: {other.unit}: {other.function}: `{other.claim}` is argued to be a false alarm, but is no alarm"
    # A build may lack the unit of an argument.
    assert findings == ((TEXT,) if field == "unit" else (TEXT, text))


def test_functions_that_are_not_analysed_fail() -> None:
    outcome = frama_c.outcome_of([analysis(unreached=("g",))], [], "")
    assert (outcome.findings, outcome.verdict) == (("4ws2: g() is not analysed",), Verdict.FAILED)
    assert "9 of 10 functions" in outcome.figure
    assert frama_c.outcome_of([], [], "").verdict is Verdict.FAILED


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
    figures = outcome.figures["4ws2"]
    assert figures["alarms"] == [
        f"4ws2/src/ars_can.c:{line}: possible: float_to_int: \\is_finite(scaled) in to_code(): "
        "`const int32_t whole = (int32_t)scaled;`"
    ]
    assert (figures["analysed"], figures["statements"], figures["reached"], figures["partly_reached"]) == (
        2,
        26,
        25,
        ["to_code"],
    )
    assert outcome.figure.startswith("1 alarms, 1 of them argued to be false; 2 of ")
    # The controller and the limiter both define clamp(), and one is reached.
    assert outcome.findings.count("4ws2: clamp() is not analysed") == 1
    assert "4ws2: to_code() is not analysed" not in outcome.findings
    script.write_text("#!/bin/sh\necho '[kernel] src/ars_e2e.c:7: syntax error'\nexit 1\n", encoding="ascii")
    with pytest.raises(BuildError, match=r"4ws2/src/ars_e2e.c:7: Frama-C rejects the C: syntax error"):
        frama_c.run([PI], Effort(), Progress())


def test_without_frama_c_the_part_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingTool, match=r"frama-c: it is not installed"):
        frama_c.run([PI], Effort(), Progress())
