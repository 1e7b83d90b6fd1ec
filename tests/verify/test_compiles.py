"""The C of the builds compiles cleanly, and what would keep it from that is found."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping

import pytest

from codegen.config import Kind
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.verify import host_gcc
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.compilation import check as compiles
from codegen.verify.compilation import mixtures
from codegen.verify.compilation.object_symbols import is_allowed
from codegen.verify.packages import MissingTool
from tests.verify import builds

QUICK = Effort(quick=True)


def subject_of(folder: Folder, files: Mapping[str, bytes] | None = None) -> Subject:
    return Subject("sample", files or folder.files, folder.manifest)


def with_more(folder: Folder, **more: str) -> Subject:
    """The build with text behind its sources: `limiter="..."`."""
    files = dict(folder.files)
    for name, text in more.items():
        files[f"src/ars_{name}.c"] += text.encode()
    return subject_of(folder, files)


def c_function(signature: str, body: str) -> str:
    """A function with its prototype; its body is on the fourth line."""
    return f"{signature};\n{signature}\n{{\n    {body}\n}}\n"


SECRET = c_function("uint8_t ars_e2e_secret(uint8_t x)", "return x;")


def lines(folder: Folder, path: str) -> int:
    """Number of the first line behind a file."""
    return folder.files[path].count(b"\n") + 1


def found(outcome: Outcome, start: str) -> list[str]:
    return [finding for finding in outcome.findings if finding.startswith(start)]


@pytest.mark.parametrize(
    ("kind", "grid", "layers", "precision"),
    [("tracking", "uneven", True, "single"), ("pi", "even", False, "double")],
)
def test_builds_compile_everywhere(kind: Kind, grid: str, layers: bool, precision: Precision) -> None:
    outcome = compiles.check(subject_of(builds.made(kind, grid, layers, precision)), Effort())
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    needed = outcome.figures["needed_of_others"]
    assert len(needed) == 7
    suffix = "f" if precision == "single" else ""
    for core, names in needed.items():
        assert {f"sin{suffix}", f"cos{suffix}", f"atan{suffix}"} <= set(names), core
    # Only a core without a double FPU calls for help, and only where doubles are wanted: the search sees them.
    assert ("__aeabi_dmul" in needed["Cortex-M4F"]) == (precision == "double")
    assert ("__muldf3" in needed["RV32IMAFC"]) == (precision == "double")
    assert not any("df" in name for name in needed["PowerPC, big-endian"])


def test_the_short_run_has_the_host_and_one_target() -> None:
    outcome = compiles.check(subject_of(builds.made("proportional")), QUICK)
    assert outcome.findings == ()
    assert set(outcome.figures["needed_of_others"]) == {"x86-64", "Cortex-M4F"}
    assert not any("c11" in label for label in outcome.figures["compilations"])


def test_warnings_are_found_where_they_are() -> None:
    folder = builds.made("pi")
    planted = {
        "limiter": c_function("float ars_half(float x)", "return x * 0.5;"),
        "e2e": "int ars_none(int x)\n{\n    return x;\n}\n",
        "can": c_function("int ars_hidden(int x)", "if (x > 0) { int x = 1; return x; } return x;"),
        "map": c_function("int ars_equal(float x, float y)", "return x == y;"),
        "task": "#if ARS_NOT_THERE\n#endif\n",
        "selftest": c_function("short ars_short(int x)", "return x;"),
    }
    inside = {"limiter": 3, "e2e": 0, "can": 3, "map": 3, "task": 0, "selftest": 3}
    outcome = compiles.check(with_more(folder, **planted), QUICK)
    assert outcome.verdict is Verdict.FAILED
    for name, offset in inside.items():
        path = f"src/ars_{name}.c"
        told = found(outcome, f"{path}:{lines(folder, path) + offset}: ")
        assert any("gcc" in finding for finding in told), path
        assert any("clang" in finding for finding in told), path
    assert {finding.partition(":")[0] for finding in outcome.findings} == {f"src/ars_{name}.c" for name in planted}


def test_functions_that_a_target_may_lack_are_found() -> None:
    """In code without a warning: every conversion is written out, every function declared."""
    folder = builds.made("pi")
    planted = {
        "limiter": c_function("float ars_half(float x)", "return (float)((double)x * 0.1);"),
        "e2e": "float sinf(float x);\n" + c_function("float ars_sine(float x)", "return sinf(x);"),
        "dynamics": "float expf(float x);\n" + c_function("float ars_power(float x)", "return expf(x);"),
        "task": c_function("void ars_clear(float *x)", "*x = 0.0f;"),
    }
    outcome = compiles.check(with_more(folder, **planted), QUICK)
    assert outcome.verdict is Verdict.FAILED
    assert "src/ars_limiter.c: needs __aeabi_dmul, double precision (Cortex-M4F)" in outcome.findings
    assert "src/ars_e2e.c: needs sinf, which a bare target need not have (x86-64, Cortex-M4F)" in outcome.findings
    assert "src/ars_dynamics.c: needs expf, which a bare target need not have (x86-64, Cortex-M4F)" in outcome.findings
    needs = [finding for finding in outcome.findings if ": needs " in finding]
    assert {finding.partition(":")[0] for finding in needs} == {f"src/ars_{name}.c" for name in ("limiter", "e2e", "dynamics")}


def test_a_header_that_needs_another_is_found() -> None:
    folder = builds.made("pi")
    files = builds.with_text(
        folder, "include/ars_map.h", "\n#endif /* ARS_MAP_H */", "size_t ars_map_ready(void);\n#endif /* ARS_MAP_H */"
    )
    outcome = compiles.check(subject_of(folder, files), QUICK)
    assert outcome.verdict is Verdict.FAILED
    assert found(outcome, "include/ars_map.h:")
    assert all("size_t" in finding for finding in found(outcome, "include/ars_map.h:"))


def test_a_header_that_is_no_cxx_is_found() -> None:
    folder = builds.made("pi")
    start = '#ifdef __cplusplus\nextern "C" {\n#endif\n'
    files = builds.with_text(folder, "include/ars_e2e.h", start, "")
    files["include/ars_e2e.h"] = files["include/ars_e2e.h"].replace(b"#ifdef __cplusplus\n}\n#endif\n", b"")
    outcome = compiles.check(subject_of(folder, files), QUICK)
    assert 'include/: ars_e2e_crc is not declared extern "C" for C++' in outcome.findings
    assert all("ars_e2e_" in finding and "extern" in finding for finding in outcome.findings)


def test_what_no_header_declares_is_found() -> None:
    folder = builds.made("pi")
    outcome = compiles.check(with_more(folder, e2e=SECRET), QUICK)
    assert outcome.findings == ("include/: no header declares ars_e2e_secret",)


@pytest.mark.parametrize("path", ["src/ars_can.c", "src/ars_map.c", "src/ars_dynamics.c", "include/ars_controller.h"])
def test_a_missing_guard_between_builds_is_found(path: str) -> None:
    folder = builds.made("tracking")
    lines_of_file = folder.files[path].split(b"\n")
    (first, *_) = [k for k, line in enumerate(lines_of_file) if line.startswith(b"#if ") and b"_BUILD != " in line]
    guarded = lines_of_file[first].split()[1].decode().removeprefix("ARS_").removesuffix("_BUILD").lower()
    files = {**folder.files, path: b"\n".join((*lines_of_file[:first], *lines_of_file[first + 3 :]))}
    told = list(mixtures.not_refused(subject_of(folder, files)))
    assert told
    assert all(finding.endswith(f"takes a ars_{guarded}.h of another build") for finding in told)
    if path.startswith("src/"):
        assert told == [f"{path}:1: it takes a ars_{guarded}.h of another build"]


def test_every_source_refuses_every_header_of_another_build() -> None:
    folder = builds.made("tracking")
    subject = subject_of(folder)
    assert list(mixtures.not_refused(subject)) == []
    pairs = mixtures.mixtures(subject)
    assert mixtures.Mixture("src/ars_task.c", "include/ars_reference_model.h") in pairs  # by way of two others
    assert {pair.source for pair in pairs} == {
        path for path in folder.files if path.startswith(("src/", "linux/")) and path.endswith(".c")
    }


def test_a_header_without_its_build_is_found() -> None:
    folder = builds.made("pi")
    text = folder.files["include/ars_can.h"].decode()
    files = {**folder.files, "include/ars_can.h": text.replace("#define ARS_CAN_BUILD", "#define ARS_CAN_MADE").encode()}
    assert "include/ars_can.h:1: it does not say of which build it is" in list(mixtures.not_refused(subject_of(folder, files)))


@pytest.mark.parametrize("kind", builds.KINDS)
def test_every_source_with_reals_refuses_fast_math(kind: Kind) -> None:
    subject = subject_of(builds.made(kind))
    assert list(mixtures.takes_fast_math(subject)) == []
    assert "src/ars_e2e.c" not in mixtures.units_with_reals(subject)
    assert "src/ars_limiter.c" in mixtures.units_with_reals(subject)


def test_a_source_that_takes_fast_math_is_found() -> None:
    folder = builds.made("pi")
    text = folder.files["src/ars_limiter.c"].decode()
    files = {**folder.files, "src/ars_limiter.c": text.replace("defined(__FINITE_MATH_ONLY__)", "0").encode()}
    files["src/ars_can.c"] = folder.files["src/ars_can.c"].replace(b"#error", b"/* no error */")
    told = set(mixtures.takes_fast_math(subject_of(folder, files)))
    assert {
        "src/ars_limiter.c:1: it takes -ffinite-math-only",
        "src/ars_can.c:1: it takes -ffast-math",
        "src/ars_can.c:1: it takes -ffinite-math-only",
    } == told


@pytest.mark.parametrize(
    ("name", "library", "single", "has_double", "allowed"),
    [
        ("memcpy", False, True, False, True),
        ("__aeabi_memclr4", False, True, False, True),
        ("sinf", True, True, False, True),
        ("sinf", False, True, False, False),
        ("sin", True, True, False, False),
        ("sin", True, False, True, True),
        ("expf", True, True, False, False),
        ("__aeabi_dadd", False, True, False, False),
        ("__aeabi_f2d", False, True, False, False),
        ("__adddf3", True, True, False, False),
        ("__extendsfdf2", False, True, False, False),
        ("__aeabi_dadd", False, False, False, True),
        ("__floatunsidf", False, False, False, True),
        ("__adddf3", False, False, True, False),
        ("__aeabi_fadd", False, False, False, False),
        ("malloc", True, False, False, False),
        ("ars_somewhere", False, True, False, False),
    ],
)
def test_what_an_object_may_need(name: str, library: bool, single: bool, has_double: bool, allowed: bool) -> None:
    assert is_allowed(name, library=library, single=single, has_double=has_double) == allowed


def test_without_gcc_the_rest_runs_and_it_counts_as_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_gcc, "gcc", lambda: None)
    folder = builds.made("pi")
    outcome = compiles.check(subject_of(folder), QUICK)
    assert outcome.verdict is Verdict.NOT_RUN
    assert outcome.findings == (host_gcc.MISSING,)
    assert compiles.check(with_more(folder, e2e=SECRET), QUICK).verdict is Verdict.FAILED


@pytest.mark.parametrize("package", ["ziglang", "elftools"])
def test_without_its_packages_it_is_not_run(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real_spec, real_import = importlib.util.find_spec, importlib.import_module

    def find_spec(name: str, *rest: str) -> object:
        return None if name == package else real_spec(name, *rest)

    def import_module(name: str, *rest: str) -> object:
        if name.startswith(package):
            raise ImportError(name)
        return real_import(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", find_spec)
    monkeypatch.setattr(importlib, "import_module", import_module)
    with pytest.raises(MissingTool, match="pip install"):
        compiles.check(subject_of(builds.made("pi")), QUICK)
