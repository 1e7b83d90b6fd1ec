"""Check `compiles`: each kind of problem is found at its location. tests/evidence/verify has builds that compile cleanly."""

import pytest

from codegen.verify import compilers
from codegen.verify import compilers as compiles
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.tools import MissingTool
from tests.verify import builds, planted
from tests.verify.test_static_analysis import c_function

PI = builds.made("pi", "uneven")


def checked(subject: Subject) -> Outcome:
    return compiles.check(subject, Effort(quick=True))


FAULTS = {
    "limiter": (c_function("float ars_half(float x)", "return x * 0.5;"), 3),
    "e2e": ("int ars_none(int x)\n{\n    return x;\n}\n", 0),
    "can": (c_function("int ars_hidden(int x)", "if (x > 0) { int x = 1; return x; } return x;"), 3),
    "map": (c_function("int ars_equal(float x, float y)", "return x == y;"), 3),
    "task": ("#if ARS_NOT_THERE\n#endif\n", 0),
    "selftest": (c_function("short ars_short(int x)", "return x;"), 3),
}
"""Text at the end of a unit, and the offset of the warning's line in it."""


def test_warnings_are_found_in_their_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiles, "not_refused", lambda subject: ())
    monkeypatch.setattr(compiles, "takes_fast_math", lambda subject: ())
    faulty = {f"src/ars_{name}.c": (text, offset) for name, (text, offset) in FAULTS.items()}
    others = ("include/", "src/ars_dynamics.c")
    files = {path: content for path, content in PI.files.items() if path.startswith(others) or path in faulty}
    files |= {path: files[path] + text.encode() for path, (text, _) in faulty.items()}
    outcome = checked(Subject("planted", files, PI.manifest))
    assert outcome.verdict is Verdict.FAILED
    for path, (_, offset) in faulty.items():
        start = f"{path}:{len(PI.files[path].splitlines()) + 1 + offset}: "
        found = [finding for finding in outcome.findings if finding.startswith(start)]
        assert any("gcc" in finding for finding in found), path
        assert any("clang" in finding for finding in found), path
    assert {finding.partition(":")[0] for finding in outcome.findings} == faulty.keys()


def test_missing_guards_between_builds_are_found() -> None:
    folder = builds.made("tracking", "uneven")
    subject = planted.subject_of(folder)
    pairs = compilers.mixtures(subject)
    assert compilers.Mixture("src/ars_task.c", "include/ars_reference_model.h") in pairs  # through two other headers
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
    assert set(compilers.not_refused(Subject("planted", files, folder.manifest))) == expected


def test_a_source_that_takes_fast_math_is_found() -> None:
    limiter, can, e2e = (planted.source(PI, f"ars_{name}") for name in ("limiter", "can", "e2e"))
    limiter, can = limiter.replace("defined(__FINITE_MATH_ONLY__)", "0"), can.replace("#error", "/* no error */")
    files = {path: content for path, content in PI.files.items() if path.startswith("include/")}
    files |= {f"src/ars_{name}.c": text.encode() for name, text in (("limiter", limiter), ("can", can), ("e2e", e2e))}
    assert set(compilers.takes_fast_math(Subject("planted", files, PI.manifest))) == {
        "src/ars_limiter.c:1: it takes -ffinite-math-only",
        "src/ars_can.c:1: it takes -ffast-math",
        "src/ars_can.c:1: it takes -ffinite-math-only",
    }


def test_without_its_packages_it_cannot_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingTool, match=r"^ziglang: .*pip install"):
        checked(planted.subject_of(PI))
