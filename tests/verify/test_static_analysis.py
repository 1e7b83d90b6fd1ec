"""Check `static-analysis`: the analysers' findings equal the rows of `deviations.md`.

The build is small, two units and all headers, because the analysers need half a minute for a whole one.
"""

import functools
import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from codegen.emit.deviations import DEVIATIONS_FILE, excerpt, read_deviations
from codegen.errors import CodegenError
from codegen.verify import on_host, static_analysis
from codegen.verify.number_tables import malformed
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.target import source_tree
from codegen.verify.tools import MissingTool
from tests.verify import builds

PI = builds.made("pi", "uneven")
E2E, LIMITER = UNITS = ("src/ars_e2e.c", "src/ars_limiter.c")


def checked(files: Mapping[str, bytes]) -> Outcome:
    return static_analysis.check(Subject("sample", files, PI.manifest), Effort(quick=True))


def with_rows(files: Mapping[str, bytes], *rows: str) -> dict[str, bytes]:
    return {**files, DEVIATIONS_FILE: files[DEVIATIONS_FILE] + "".join(f"{row}\n" for row in rows).encode()}


@functools.cache
def small() -> dict[str, bytes]:
    """Return the small build with the rows for the missing units, whose names are otherwise undefined or unused."""
    others = re.compile(r"\| src/(?!ars_e2e|ars_limiter)|\|[^|]*\|[^|]*\| 5\.9 \|")
    files = {path: content for path, content in PI.files.items() if path.startswith("include/") or path in UNITS}
    files[DEVIATIONS_FILE] = b"".join(
        line for line in PI.files[DEVIATIONS_FILE].splitlines(keepends=True) if not others.match(line.decode())
    )
    functions = [
        (path, match)
        for path in UNITS
        for match in re.finditer(r"^ARS_SECTION_CODE (?!static|.*_crc).*?(\w+)\(.*", files[path].decode(), re.M)
    ]
    rows = (f"| {path} | {each[1]} | 8.7 | advisory | `{excerpt(each[0])}` | other units call it |" for path, each in functions)
    return with_rows(files, *rows)


def c_function(signature: str, *body: str) -> str:
    """Return a function with its prototype; its body begins on the fourth line."""
    return "\n".join((f"{signature};", signature, "{", *(f"    {line}" for line in body), "}", ""))


def test_a_build_passes_with_its_rows() -> None:
    """A row names its line by function and text, so it stays valid when lines are added above."""
    files = {**small(), LIMITER: b"/* one */\n/* two */\n" + small()[LIMITER]}
    outcome = checked(files)
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    listed = [row for _, row in read_deviations(files[DEVIATIONS_FILE].decode())]
    assert sum(outcome.figures["deviations"].values()) == len(listed) <= sum(outcome.figures["findings"].values())
    assert set(outcome.figures["deviations"]) == {"8.7", "8.9", "19.2", "multiCondition"}


PLANTED = (
    (c_function("int32_t ars_jump(int32_t x)", "if (x > 7) { goto end; }", "return 1;", "end:", "return 0;"), {3: "15.1"}),
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
"""Functions, and the rules they violate by line offset."""
ROWS = (
    "| src/ars_e2e.c | ars_crc | 15.5 | advisory | `return x;` | the function is easier to read so |",
    "| src/ars_e2e.c | | 17.3 | mandatory | `x = y(z);` | it works |",
    "| src/ars_e2e.c | | 10.3 | advisory | `x = y \\| z;` | it is no more than a word |",
    "| src/ars_e2e.c | | -Wanalyzer-null-dereference | checker | `*x = 1;` | it is never null |",
)
"""Deviations without a finding; two of them are also not permitted."""


def test_violations_and_wrong_rows_are_located() -> None:
    files = small()
    text, first = files[LIMITER].decode(), files[LIMITER].count(b"\n") + 1
    violations = []
    for function, faults in PLANTED:
        violations += [(text.count("\n") + 1 + offset, rule) for offset, rule in faults.items()]
        text += function
    lines = files[DEVIATIONS_FILE].decode().splitlines(keepends=True)
    gone, twice, *_ = (number for number, row in read_deviations("".join(lines)) if row.file == E2E)
    unlisted, doubled = dict(read_deviations("".join(lines)))[gone], lines[twice - 1]
    unlisted_line = [excerpt(line) for line in files[E2E].decode().splitlines()].index(unlisted.code) + 1
    del lines[gone - 1]
    table = {DEVIATIONS_FILE: "".join((*lines, doubled)).encode(), LIMITER: text.encode()}
    outcome = checked(with_rows({**files, **table}, *ROWS))
    assert outcome.verdict is Verdict.FAILED
    count, found = len(lines) + 1, set(outcome.findings)
    of_table = {each for each in found if each.startswith(DEVIATIONS_FILE)}
    double = next(each for each in of_table if each.endswith(f"is listed in line {twice - 1} already"))
    assert double.startswith(f"{DEVIATIONS_FILE}:{count}: ")
    assert of_table - {double} == {
        f"{DEVIATIONS_FILE}:{count + 2}: rule 17.3 is mandatory: there is no deviation from it",
        f"{DEVIATIONS_FILE}:{count + 3}: rule 10.3 is required, not advisory",
        *(
            f"{DEVIATIONS_FILE}:{count + k}: rule {rule} is not broken in "
            f"{'ars_crc (src/ars_e2e.c)' if k == 1 else 'src/ars_e2e.c'}: a deviation without a finding"
            for k, rule in enumerate(("15.5", "17.3", "10.3", "-Wanalyzer-null-dereference"), 1)
        ),
    }
    for file, line, rule in ((E2E, unlisted_line, unlisted.rule), *((LIMITER, *each) for each in violations)):
        assert any(each.startswith(f"{file}:{line}: ") and f"[{rule}], not in {DEVIATIONS_FILE}" in each for each in found), (
            line,
            rule,
        )
    others = [each for each in found - of_table if not each.startswith(f"{E2E}:{unlisted_line}: ")]
    assert all(int(re.match(rf"{LIMITER}:(\d+): ", each)[1]) >= first for each in others)  # type: ignore[index]


def test_a_table_with_a_missing_number_or_other_than_plain_literals_is_found() -> None:
    build = builds.made("tracking", "uneven")
    path = "src/ars_calibration.c"
    for old, new in (("0.0f, 0.0f, 0.0f, 0.0f,", "0.0f, 0.0f, 0.0f,"), ("0.0f, 0.0f,", "0.0f, 1.0f - 1.0f,")):
        text = build.files[path].decode()
        assert list(malformed(build.files, build.manifest)) == []
        planted = {**build.files, path: text.replace(old, new, 1).encode()}
        (finding,) = malformed(planted, build.manifest)
        assert re.fullmatch(rf"{path}: ars_map_yaw_rate_table is not \d+ x \d+ plain numbers of type float", finding)


def test_without_an_analysing_gcc_or_a_readable_table_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    head = PI.files[DEVIATIONS_FILE].partition(b"| src/")[0]
    files = with_rows({**small(), DEVIATIONS_FILE: head}, ROWS[-1])  # this row's validity cannot be decided
    monkeypatch.setattr(static_analysis, "judged_by_misra", lambda tree: ())
    monkeypatch.setattr(static_analysis, "judged_as_programs", lambda *given: ())
    monkeypatch.setattr(static_analysis, "GCC_FLAGS", ("-std=c99", "-O2"))
    outcome = checked(files)
    assert outcome.verdict is Verdict.NOT_RUN
    (why,) = outcome.findings
    assert "does not find what was planted" in why
    monkeypatch.setattr(on_host, "gcc", lambda: None)
    outcome = checked(files)
    assert (outcome.verdict, outcome.findings) == (Verdict.NOT_RUN, (on_host.GCC_MISSING,))
    with pytest.raises(CodegenError, match=r"deviations\.md: line \d+ is not a row .* build it again"):
        checked(with_rows(PI.files, "| src/ars_map.c | 12 | 15.5 | advisory | no reason |"))


def test_without_a_working_cppcheck_it_cannot_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(static_analysis.sys, "executable", str(tmp_path / "no-python"))
    with source_tree({"src/a.c": b"int a;\n"}) as tree, pytest.raises(MissingTool, match=r"planted for it \(.*15\.1"):
        static_analysis.judged_by_misra(tree)
