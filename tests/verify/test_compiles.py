"""Check `compiles`: a build compiles cleanly, and each kind of obstacle is found where it is."""

from __future__ import annotations

import importlib.util

import pytest

from codegen.verify import host_gcc
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.compilation import check as compiles
from codegen.verify.compilation import mixtures
from codegen.verify.compilation.object_symbols import is_allowed
from codegen.verify.packages import MissingTool
from tests.verify import builds, planted

PI = builds.made("pi", "uneven")


def checked(subject: Subject) -> Outcome:
    return compiles.check(subject, Effort(quick=True))


@pytest.fixture
def no_mixtures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiles, "not_refused", lambda subject: ())
    monkeypatch.setattr(compiles, "takes_fast_math", lambda subject: ())


def with_more(**more: str) -> Subject:
    """Return the build with text at the end of its units: `limiter="..."`."""
    files = dict(PI.files)
    for name, text in more.items():
        files[f"src/ars_{name}.c"] += text.encode()
    return Subject("planted", files, PI.manifest)


def end_of(path: str) -> int:
    """Return the number of the first line after a file."""
    return PI.files[path].count(b"\n") + 1


def c_function(signature: str, body: str) -> str:
    """Return a function with its prototype; its body is on the fourth line."""
    return f"{signature};\n{signature}\n{{\n    {body}\n}}\n"


def test_a_build_compiles_cleanly() -> None:
    outcome = checked(planted.subject_of(PI))
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    needed = outcome.figures["needed_of_others"]
    assert set(needed) == {"x86-64", "Cortex-M4F"}
    assert all({"sinf", "cosf", "atanf"} <= set(names) for names in needed.values())
    assert not any("c11" in label for label in outcome.figures["compilations"])
    figures = outcome.figures
    assert figures["mixtures_refused"] == figures["mixtures"] == len(mixtures.mixtures(planted.subject_of(PI)))
    assert (
        outcome.figure
        == f"0 findings in {len(figures['compilations'])} compilations and {figures['mixtures']} mixtures of builds"
    )


@pytest.mark.usefixtures("no_mixtures")
def test_warnings_are_found_in_their_lines() -> None:
    faults = {
        "limiter": (c_function("float ars_half(float x)", "return x * 0.5;"), 3),
        "e2e": ("int ars_none(int x)\n{\n    return x;\n}\n", 0),
        "can": (c_function("int ars_hidden(int x)", "if (x > 0) { int x = 1; return x; } return x;"), 3),
        "map": (c_function("int ars_equal(float x, float y)", "return x == y;"), 3),
        "task": ("#if ARS_NOT_THERE\n#endif\n", 0),
        "selftest": (c_function("short ars_short(int x)", "return x;"), 3),
    }
    outcome = checked(with_more(**{name: text for name, (text, _) in faults.items()}))
    assert outcome.verdict is Verdict.FAILED
    for name, (_, offset) in faults.items():
        path = f"src/ars_{name}.c"
        start = f"{path}:{end_of(path) + offset}: "
        found = [finding for finding in outcome.findings if finding.startswith(start)]
        assert any("gcc" in finding for finding in found), path
        assert any("clang" in finding for finding in found), path
    assert {finding.partition(":")[0] for finding in outcome.findings} == {f"src/ars_{name}.c" for name in faults}


def test_missing_guards_between_builds_are_found() -> None:
    folder = builds.made("tracking", "uneven")
    subject = planted.subject_of(folder)
    pairs = mixtures.mixtures(subject)
    assert mixtures.Mixture("src/ars_task.c", "include/ars_reference_model.h") in pairs  # through two other headers
    compiled = {path for path in folder.files if path.startswith(("src/", "linux/")) and path.endswith(".c")}
    assert {pair.source for pair in pairs} == compiled
    files, expected = subject.sources("include"), {"include/ars_e2e.h:1: it does not say of which build it is"}
    for path in ("src/ars_can.c", "src/ars_map.c", "src/ars_dynamics.c"):
        lines = folder.files[path].decode().split("\n")
        first = next(k for k, line in enumerate(lines) if line.startswith("#if ") and "_BUILD != " in line)
        guarded = lines[first].split()[1].removeprefix("ARS_").removesuffix("_BUILD").lower()
        expected.add(f"{path}:1: it takes a ars_{guarded}.h of another build")
        files[path] = "\n".join((*lines[:first], *lines[first + 3 :])).encode()
    files["include/ars_e2e.h"] = files["include/ars_e2e.h"].replace(b"#define ARS_E2E_BUILD", b"#define ARS_E2E_MADE")
    files["src/ars_e2e.c"] = folder.files["src/ars_e2e.c"]
    assert set(mixtures.not_refused(Subject("planted", files, folder.manifest))) == expected


def test_a_source_that_takes_fast_math_is_found() -> None:
    limiter, can = planted.source(PI, "ars_limiter"), planted.source(PI, "ars_can")
    subject = planted.subject_of(
        PI,
        ars_limiter=limiter.replace("defined(__FINITE_MATH_ONLY__)", "0"),
        ars_can=can.replace("#error", "/* no error */"),
    )
    assert "src/ars_e2e.c" not in mixtures.units_with_reals(subject)
    assert set(mixtures.takes_fast_math(subject)) == {
        "src/ars_limiter.c:1: it takes -ffinite-math-only",
        "src/ars_can.c:1: it takes -ffast-math",
        "src/ars_can.c:1: it takes -ffinite-math-only",
    }


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
        ("__aeabi_f2d", False, True, False, False),
        ("__extendsfdf2", False, True, False, False),
        ("__aeabi_dadd", False, False, False, True),
        ("__floatunsidf", False, False, False, True),
        ("__adddf3", False, False, True, False),
        ("__aeabi_fadd", False, False, False, False),
        ("malloc", True, False, False, False),
        ("ars_somewhere", False, True, False, False),
    ],
)
def test_functions_that_an_object_may_need(name: str, library: bool, single: bool, has_double: bool, allowed: bool) -> None:
    assert is_allowed(name, library=library, single=single, has_double=has_double) == allowed


@pytest.mark.usefixtures("no_mixtures")
def test_without_gcc_the_check_is_not_run_unless_it_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_gcc, "gcc", lambda: None)
    for name in ("by_clang", "_cxx_linkage"):
        monkeypatch.setattr(compiles, name, lambda *given: ())
    outcome = checked(planted.subject_of(PI))
    assert (outcome.verdict, outcome.findings) == (Verdict.NOT_RUN, (host_gcc.MISSING,))
    monkeypatch.setattr(compiles, "takes_fast_math", lambda subject: ("it takes it",))
    assert checked(planted.subject_of(PI)).verdict is Verdict.FAILED


@pytest.mark.parametrize("package", ["ziglang", "elftools"])
def test_without_its_packages_it_cannot_run(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real_spec, real_import = importlib.util.find_spec, importlib.import_module

    def import_module(name: str, *rest: str) -> object:
        if name.startswith(package):
            raise ImportError(name)
        return real_import(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == package else real_spec(name, *rest))
    monkeypatch.setattr(importlib, "import_module", import_module)
    with pytest.raises(MissingTool, match="pip install"):
        checked(planted.subject_of(PI))
