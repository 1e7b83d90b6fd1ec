"""libFuzzer on both harnesses of `codegen.verify.fuzzing.harness`, with clang: the same properties as in `codegen verify`, for
as long as one likes.

    python -m tests.evidence.libfuzzer.libfuzzer [FOLDER ...] [--seconds 60]

An input that breaks something is kept in build/fuzzing/, and can be given to the harness again.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_identity
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.fuzzing.check import SHOWS
from codegen.verify.fuzzing.harness import HARNESSES, Name, seeds, source
from codegen.verify.packages import MissingTool
from codegen.verify.sanitizers.sanitized import Compiler, compiled, environment, findings_of
from tests.evidence.part import FOLDERS, ROOT

SECONDS, QUICK_SECONDS = 60, 5
"""For each harness of each build."""

KEPT = ROOT / "build" / "fuzzing"
INPUT_BYTES_MAX = 2048
INPUT_SECONDS_MAX = 20

CLANGS = ("clang-19", *(f"clang-{version}" for version in range(30, 13, -1)), "clang")

COUNTED = "-fsanitize=fuzzer-no-link"

_TRIVIAL = """#include <stddef.h>
#include <stdint.h>
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    (void)data;
    (void)size;
    return 0;
}
"""

_EDGES = re.compile(r"INFO: Loaded 1 modules\s+\((\d+) ")
_PROGRESS = re.compile(r"^#(\d+)\s+\w+\s+cov: (\d+) ft: (\d+)(?: corp: (\d+)/)?", re.MULTILINE)
_KEPT = re.compile(r"Test unit written to (\S+)")


@dataclass(frozen=True)
class Run:
    """What came of a harness: inputs tried, edges reached of all that the generated code has, features, size of the corpus. The
    edges are those of the code without the sanitizers' own."""

    inputs: int
    reached: int
    edges: int
    features: int
    corpus: int
    findings: tuple[str, ...]


def run(folders: Sequence[Path], effort: Effort, seconds: float | None = None, inputs: int | None = None) -> Outcome:
    """The part of the campaign.

    Args:
        folders: the builds.
        effort: how long, where nothing else is said.
        seconds: for each harness of each build.
        inputs: at most so many, whatever time it takes.

    Raises:
        MissingTool: no clang with libFuzzer.
    """
    clang = find_clang()
    budget = f"-runs={inputs}" if inputs is not None else f"-max_total_time={seconds or _seconds(effort):g}"
    runs = {
        f"{folder.name} {name}": fuzz(clang, subject, name, budget)
        for folder in folders
        for subject in (Subject.read(folder),)
        for name in HARNESSES
    }
    findings = tuple(f"{what}: {finding}" for what, done in runs.items() for finding in done.findings)
    reached = ", ".join(f"{100 * done.reached / max(done.edges, 1):.0f} %" for done in runs.values())
    return Outcome(
        SHOWS,
        f"{sum(done.inputs for done in runs.values()):,} inputs, {len(findings)} findings, edges {reached}",
        Verdict.FAILED if findings else Verdict.PASSED,
        findings,
        {what: {key: value for key, value in vars(done).items() if key != "findings"} for what, done in runs.items()},
        tools={"clang": clang.version},
    )


def _seconds(effort: Effort) -> float:
    return QUICK_SECONDS if effort.quick else SECONDS


def find_clang() -> Compiler:
    """A clang that links libFuzzer. Raises MissingTool."""
    for name in CLANGS:
        path = shutil.which(name)
        if path is not None and _links((path,)):
            return Compiler((path,), compiler_identity((path,), ())[0])
    raise MissingTool("no clang with libFuzzer is here", where="clang", remedy="apt install clang-19 libclang-rt-19-dev")


def _links(command: tuple[str, ...]) -> bool:
    try:
        with compiled(Compiler(command, ""), {}, {"trivial.c": _TRIVIAL}, link=("-fsanitize=fuzzer",)):
            return True
    except BuildError:
        return False


def fuzz(clang: Compiler, subject: Subject, name: Name, budget: str, kept: Path = KEPT) -> Run:
    """One harness of a build, with the budget as libFuzzer takes it; inputs that break something are put into `kept`.

    Raises:
        BuildError: C that does not compile.
    """
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="ars-corpus-") as corpus:
        for number, data in enumerate(seeds(subject)[name]):
            Path(corpus, f"seed-{number:02}").write_bytes(data)
        given = (budget, "-seed=1", f"-timeout={INPUT_SECONDS_MAX}", f"-artifact_prefix={kept}/{subject.name}-{name}-")
        found = read(*_told(clang, subject, name, (COUNTED,), (corpus, *given)))
        edges = read(*_told(clang, subject, name, ("-fno-sanitize=all", COUNTED), (corpus, "-runs=0")))
    return replace(found, reached=edges.reached, edges=edges.edges)


def _told(clang: Compiler, subject: Subject, name: Name, flags: Sequence[str], arguments: Sequence[str]) -> tuple[str, int]:
    """What a harness compiled with more flags says on standard error, and its exit code."""
    around = {f"fuzz_{name}.c": source(subject, name)}
    with compiled(clang, subject.sources(), around, flags, ("-fsanitize=fuzzer",)) as program:
        result = subprocess.run(
            [program.path, *arguments, f"-max_len={INPUT_BYTES_MAX}"],
            env={**environment(), "UBSAN_OPTIONS": "halt_on_error=1"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
    return result.stderr, result.returncode


def read(report: str, code: int) -> Run:
    """A run from what libFuzzer says on standard error, and its exit code."""
    edges, progress, written = _EDGES.search(report), _PROGRESS.findall(report), _KEPT.search(report)
    findings = findings_of(report)
    if code != 0 and not findings:
        said = next((line for line in report.splitlines() if "ERROR" in line), f"it ended with exit code {code}")
        findings = (said,)
    if written is not None:
        findings = tuple(f"{finding} ({Path(written[1]).name})" for finding in findings)
    inputs, reached, features, corpus = (int(number or 0) for number in (progress[-1] if progress else (0,) * 4))
    return Run(inputs, reached, int(edges[1]) if edges else 0, features, corpus, findings)


def main() -> int:
    """From the command line; 1 where something is found."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.evidence.libfuzzer.libfuzzer", description="Fuzz builds with libFuzzer."
    )
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="by default the committed builds")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="for each harness of each build")
    options = parser.parse_args()
    outcome = run(options.folders or FOLDERS, Effort(), options.seconds)
    print(outcome.figure)
    for finding in outcome.findings:
        print(finding, file=sys.stderr)
    for what, figures in outcome.figures.items():
        print(f"{what}: {', '.join(f'{value:,} {key}' for key, value in figures.items())}")
    return 1 if outcome.findings else 0


if __name__ == "__main__":
    sys.exit(main())
