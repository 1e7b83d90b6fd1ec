"""Part "libfuzzer": the harnesses of `codegen.verify.sanitizer_runs` under coverage-guided libFuzzer.

The properties are those of `codegen verify`. An input that breaks one is stored in build/fuzzing/, where the harness runs it
again.
"""

import os
import re
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from codegen.sil.toolchain import compiler_identity
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitized import Compiler, compiled, environment, findings_of
from codegen.verify.sanitizer_runs import Name, harness, seeds
from tests.evidence.coverage.coverage import find_tool
from tests.evidence.coverage.mcdc import VERSION
from tests.evidence.parts import ROOT
from tests.evidence.progress import Progress

RUNS, QUICK_RUNS = 150_000, 5_000
"""Inputs for each harness of each build. The seed is fixed, so results repeat."""

SHOWS = (
    "No frames, measurements, initial states or valid parameters found by fuzzing make the code crash, exceed its bounds, use "
    "a frame with a wrong CRC, or miss the fail-safe"
)
FAILING_INPUTS = ROOT / "build" / "fuzzing"
LIMITS = ("-max_len=2048", "-timeout=60", "-seed=1")
COUNTED = "-fsanitize=fuzzer-no-link"

_EDGES = re.compile(r"INFO: Loaded 1 modules\s+\((\d+) ")
_PROGRESS = re.compile(r"^#(\d+)\s+\w+\s+cov: (\d+) ", re.MULTILINE)
_KEPT = re.compile(r"Test unit written to (\S+)")


@dataclass(frozen=True)
class Run:
    """Result of a harness: inputs tried, and covered edges of the generated code, without those that the sanitizers add."""

    inputs: int
    reached: int
    edges: int
    findings: Sequence[str]


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part. Raises MissingTool: clang is not installed."""
    clang, count = find_clang(), QUICK_RUNS if effort.quick else RUNS
    todo: list[tuple[str, Subject, Name, Sequence[bytes]]] = [
        # Seeds are made before the threads start: CasADi releases the interpreter's lock, and its symbols are not thread-safe.
        (f"{subject.name} {name}", subject, name, inputs)
        for subject in map(Subject.read, folders)
        for name, inputs in seeds(subject).items()
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        running = {
            key: pool.submit(fuzz, clang, subject, name, inputs, count)
            for key, subject, name, inputs in todo
            if progress.done.get(f"{key} {count}") is None
        }
        results: dict[str, dict[str, Any]] = {
            key: progress.once(f"{key} {count}", lambda key=key: asdict(running[key].result())) for key, *_ in todo
        }
    findings = tuple(f"{key}: {finding}" for key, result in results.items() for finding in result["findings"])
    reached = ", ".join(f"{100 * result['reached'] / max(result['edges'], 1):.0f} %" for result in results.values())
    return Outcome(
        SHOWS,
        f"{sum(result['inputs'] for result in results.values()):,} inputs, {len(findings)} findings, edges {reached}",
        Verdict.FAILED if findings else Verdict.PASSED,
        findings,
        {key: {name: value for name, value in result.items() if name != "findings"} for key, result in results.items()},
        tools={"clang": clang.version},
    )


def find_clang() -> Compiler:
    """Return clang. Raises MissingTool."""
    path = find_tool(f"clang-{VERSION}", f"clang-{VERSION} libclang-rt-{VERSION}-dev")
    return Compiler((path,), compiler_identity((path,), ())[0])


def fuzz(
    clang: Compiler, subject: Subject, name: Name, inputs: Sequence[bytes], count: int, kept: Path = FAILING_INPUTS
) -> Run:
    """Fuzz one harness of a build from initial inputs; store inputs that break a property.

    Raises BuildError: the C does not compile.
    """
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="ars-corpus-") as corpus:
        for number, data in enumerate(inputs):
            Path(corpus, f"seed-{number:02}").write_bytes(data)
        prefix = f"-artifact_prefix={kept}/{subject.name}-{name}-"
        found = read(*_execute(clang, subject, name, (COUNTED,), (corpus, f"-runs={count}", prefix)))
        edges = read(*_execute(clang, subject, name, ("-fno-sanitize=all", COUNTED), (corpus, "-runs=0")))
    return replace(found, reached=edges.reached, edges=edges.edges)


def _execute(clang: Compiler, subject: Subject, name: Name, flags: Sequence[str], arguments: Sequence[str]) -> tuple[str, int]:
    """Compile a harness with additional flags and run it; return its standard error and exit code."""
    around = {f"fuzz_{name}.c": harness(subject, name)}
    with compiled(clang, subject.sources(), around, flags, ("-fsanitize=fuzzer",)) as program:
        done = subprocess.run(
            [program, *arguments, *LIMITS],
            env={**environment(), "UBSAN_OPTIONS": "halt_on_error=1"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
    return done.stderr, done.returncode


def read(report: str, code: int) -> Run:
    """Return the result from libFuzzer's standard error and exit code."""
    edges, progress, written = _EDGES.search(report), _PROGRESS.findall(report), _KEPT.search(report)
    findings = findings_of(report)
    if code != 0 and not findings:
        findings = (next((line for line in report.splitlines() if "ERROR" in line), f"it ends with exit code {code}"),)
    if written is not None:
        findings = tuple(f"{finding} ({Path(written[1]).name})" for finding in findings)
    inputs, reached = map(int, progress[-1] if progress else (0, 0))
    return Run(inputs, reached, int(edges[1]) if edges else 0, findings)
