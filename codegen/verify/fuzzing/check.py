"""Check 7, its bounded part: a fixed number of changed inputs on the CAN receive path and on the step, sanitized.

The harnesses are libFuzzer's (see `fuzz_harness`); the driver here needs no clang, goes by coverage too, and gives the same
inputs on each run. Where Debian's clang is, the campaign in the checkout runs the same harnesses for as long as one likes.
"""

from __future__ import annotations

import re
import struct
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.fuzzing.harness import HARNESSES, Name, driver, seeds, source
from codegen.verify.sanitizers.sanitized import Compiler, compiled, find_compiler, findings_of, run_program

SHOWS = (
    "no frames, measurements, starts or accepted parameters that fuzzing finds make the code crash, leave its bounds, use a "
    "frame with a wrong CRC, or miss the fail-safe"
)
LIMITS = ("Fuzzing tries many inputs and not all; a property that holds for all of them is not proved by it.",)

INPUTS: dict[Name, int] = {"can": 50_000, "step": 100_000}
INPUTS_QUICK = 4_000
SEED = 1

SECONDS_MAX = 600.0
"""Then an input counts as one that does not end: many times what all of them take."""

COVERAGE = "-fsanitize-coverage=trace-pc"

_AT_INPUT = re.compile(r"^at input (\d+)$", re.MULTILINE)


@dataclass(frozen=True)
class _Run:
    """What came of a harness."""

    inputs: int
    corpus: int
    edges: int
    findings: tuple[str, ...]


def check(subject: Subject, effort: Effort) -> Outcome:
    """Both harnesses.

    Raises:
        MissingTool: there is no C compiler with sanitizers.
    """
    compiler = find_compiler()
    try:
        corpus = seeds(subject)
        runs = {name: _run(compiler, subject, name, corpus[name], _inputs(name, effort)) for name in HARNESSES}
    except BuildError as error:
        return Outcome(SHOWS, "not compiled", Verdict.FAILED, (str(error),))
    findings = tuple(f"{name}: {finding}" for name, run in runs.items() for finding in run.findings)
    crashes = sum(bool(run.findings) for run in runs.values())
    return Outcome(
        SHOWS,
        f"{sum(run.inputs for run in runs.values()):,} inputs, {crashes} crashes",
        Verdict.FAILED if findings else Verdict.PASSED,
        findings,
        {
            name: {"inputs": run.inputs, "seeds": len(corpus[name]), "corpus": run.corpus, "edges": run.edges}
            for name, run in runs.items()
        },
        LIMITS,
        {"C compiler with sanitizers": compiler.version},
    )


def _inputs(name: Name, effort: Effort) -> int:
    return INPUTS_QUICK if effort.quick else INPUTS[name]


def _run(compiler: Compiler, subject: Subject, name: Name, corpus: Sequence[bytes], inputs: int) -> _Run:
    around = {f"fuzz_{name}.c": source(subject, name), "fuzz_main.c": driver()}
    with compiled(compiler, subject.sources(), around, (COVERAGE,)) as program:
        stored = program.path.parent / "seeds"
        stored.write_bytes(b"".join(struct.pack("=I", len(data)) + data for data in corpus))
        try:
            result = run_program(program.path, str(stored), str(inputs), str(SEED), seconds=SECONDS_MAX)
        except subprocess.TimeoutExpired:
            return _Run(inputs, 0, 0, ("an input does not end",))
        return _read(result, inputs)


def _read(result: subprocess.CompletedProcess[str], inputs: int) -> _Run:
    findings = findings_of(result.stderr)
    at = _AT_INPUT.search(result.stderr)
    if at is not None:
        findings = tuple(f"{finding}, at input {at[1]} of {inputs}" for finding in findings)
    if result.returncode != 0 and not findings:
        findings = (f"the program ended early: exit code {result.returncode}",)
    if result.returncode != 0:
        return _Run(int(at[1]) if at is not None else 0, 0, 0, findings)
    done, corpus, edges = (int(word) for word in result.stdout.split())
    return _Run(done, corpus, edges, findings)
