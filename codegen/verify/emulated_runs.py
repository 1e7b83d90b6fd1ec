"""Processor in the loop: the generated C computes the same bits on emulated cores as on this machine.

After every call all results and every field of the state are compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Any

import numpy as np

from codegen.errors import BuildError
from codegen.sil.software import Software, Status
from codegen.sil.toolchain import compiler_command, compiler_identity
from codegen.verify import dynamics_bound, traffic
from codegen.verify.drives import Thresholds, recorded
from codegen.verify.emulated_batches import OnHost, OnTarget, Program, Rows, dynamics_program_of, program_of, rows_of_cycles
from codegen.verify.emulated_streams import Source, Stream, differences
from codegen.verify.on_host import MightNotReturn, compiled, require_compiler
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.target import CORTEX_M4F, CORTEX_M7, POWERPC_BE, Core
from codegen.verify.tools import module, require

CORES: Mapping[bool, tuple[Core, ...]] = {True: (CORTEX_M4F, CORTEX_M7, POWERPC_BE), False: (POWERPC_BE,)}
"""Cores whose emulated FPU supports single (True) or double (False) precision builds."""

STEPS, QUICK_STEPS = 100_000, 5_000
OTHERS_SHARE = 0.2
"""Rows of every other batch, as a fraction of the controller's steps."""

RECORDINGS = 5
"""Number of built-in scenarios that are recorded; none in a quick check."""

POINTS, QUICK_POINTS = 500, 100
"""Operating points of the vehicle dynamics."""

FINDINGS_MAX = 3
"""Maximum findings of a core; a difference usually persists."""

SHOWS = (
    "Command, state and frames of every cycle are bit-identical on emulated ECU cores and on this machine, byte order included"
)

LIMITS = (
    "The cores are emulated (Unicorn, based on QEMU), with rounding to nearest and subnormal numbers as after reset. Cores "
    "that flush subnormal numbers to zero, and real hardware, were not tested.",
    "The C was compiled by clang with -O2 -ffp-contract=off. Another compiler generates other instructions: disable fused "
    "multiply-add there, and run the self-test on the ECU.",
)
DOUBLE_LIMIT = (
    "The double-precision build ran only on big-endian PowerPC: the FPUs of the emulated Cortex-M are single-precision."
)
DYNAMICS_LIMIT = (
    "The vehicle dynamics call {functions} of a C library, and libraries differ. If their results differ by at most {ulps} "
    "units in the last place, the dynamics differ by no more than that causes, to first order."
)


def check(subject: Subject, effort: Effort) -> Outcome:
    """Run the C of a build on emulated cores and on this machine, and compare. Raises MissingTool: no compiler or package."""
    require("ziglang")
    module("unicorn", "unicorn")
    module("elftools.elf.elffile", "pyelftools")
    require_compiler()
    try:
        return _compared(subject, effort)
    except MightNotReturn as error:
        return Outcome(SHOWS, "", Verdict.NOT_RUN, (str(error),), limits=LIMITS, tools=_tools())
    except BuildError as error:  # the C does not compile, or leaves the core's memory
        return Outcome(SHOWS, "the C does not run", Verdict.FAILED, (str(error),), limits=LIMITS, tools=_tools())


def streams(subject: Subject, software: Software, program: Program, steps: int, seed: int = 0) -> Iterator[Stream]:
    """Yield the inputs of every core; the random steps of the controller come first."""
    source = Source(Thresholds.of(subject.manifest), program.word, np.random.default_rng(seed))
    others, batches = round(OTHERS_SHARE * steps), program.batches
    yield Stream("random steps", "step", batches["controller"], source.steps(batches["controller"], steps))
    for name, row in (("lookup", "call"), ("limiter", "step"), ("model", "step"), ("can", "message")):
        if name in batches:
            yield Stream(name, row, batches[name], source.numbers(batches[name], others))
    drives = recorded(software)[:RECORDINGS] if steps > QUICK_STEPS else ()
    if drives:
        yield Stream("recorded scenarios", "step", batches["controller"], source.recordings(batches["controller"], drives))
    scenario, cycles = traffic.closed_loop(software)
    task = batches["task"]
    if scenario:
        yield Stream(f"scenario {scenario}", "cycle", task, rows_of_cycles(cycles, task, program.word))
    disturbed = traffic.disturbed(software.config, cycles, others, seed)
    rows = rows_of_cycles(disturbed, task, program.word, traffic.restarts_of(others))
    yield Stream("disturbed traffic", "cycle", task, rows)


def _compared(subject: Subject, effort: Effort) -> Outcome:
    software = compiled(subject)
    program = program_of(software, subject.files)
    here = OnHost(program)
    driven = list(streams(subject, software, program, QUICK_STEPS if effort.quick else STEPS))
    expected = [here.run(stream.batch, stream.rows) for stream in driven]
    column = [output.name for output in driven[0].batch.outputs].index("command.status")
    statuses = {status.name: int((expected[0][:, column] == status).sum()) for status in Status}
    findings = [f"the random steps never reach the status {name}" for name, count in statuses.items() if not count]
    cores = CORES[subject.is_single]
    mismatches: dict[str, dict[str, int]] = {}
    for core in cores:
        mismatches[core.name], found = _on(OnTarget(program, core), subject, here, driven, expected)
        findings += found
    apart = _dynamics(subject, software, effort)
    findings += [line for lines, _ in apart.values() for line in lines]
    steps, calls = len(driven[0].rows), sum(len(stream.rows) for stream in driven[1:])
    return Outcome(
        SHOWS,
        f"{sum(sum(counts.values()) for counts in mismatches.values()):,} mismatches in {len(cores) * steps:,} steps and "
        f"{len(cores) * calls:,} other calls on {len(cores)} core{'s' * (len(cores) > 1)}",
        Verdict.FAILED if findings else Verdict.PASSED,
        tuple(findings),
        {
            "rows": {stream.name: len(stream.rows) for stream in driven},
            "words": {stream.name: len(stream.batch.outputs) for stream in driven},
            "statuses": statuses,
            "mismatches": mismatches,
            "dynamics": {name: figures for name, (_, figures) in apart.items()},
        },
        _limits(subject),
        _tools(),
    )


def _on(
    there: OnTarget, subject: Subject, here: OnHost, driven: list[Stream], expected: list[Rows]
) -> tuple[dict[str, int], list[str]]:
    """Run the streams on a core and return the mismatches by stream, and the findings."""
    counts, findings = {}, []
    if there.processor.call(f"{subject.prefix}_selftest") != 1:
        findings.append(f"{there.name}: the self-test of the build fails")
    for stream, rows in zip(driven, expected, strict=True):
        counts[stream.name], lines = differences(stream, here, there, rows)
        findings += lines
    return counts, findings[:FINDINGS_MAX]


def _dynamics(subject: Subject, software: Software, effort: Effort) -> dict[str, tuple[list[str], dict[str, float]]]:
    """Compare the vehicle dynamics on each core; see `dynamics_bound.compare`."""
    functions = subject.manifest["dynamics_library_functions"]
    program = dynamics_program_of(software, subject.files, functions)
    here, library = OnHost(program), dynamics_bound.library(software.precision)
    points = QUICK_POINTS if effort.quick else POINTS
    return {
        core.name: dynamics_bound.compare(program, here, OnTarget(program, core, library), points, np.random.default_rng(0))
        for core in CORES[subject.is_single]
    }


def _limits(subject: Subject) -> tuple[str, ...]:
    functions, ulps = subject.manifest["dynamics_library_functions"], dynamics_bound.LIBRARY_ULPS
    library = (DYNAMICS_LIMIT.format(functions=", ".join(functions), ulps=ulps),) if functions else ()
    return (*LIMITS, *library, *(() if subject.is_single else (DOUBLE_LIMIT,)))


def _tools() -> dict[str, Any]:
    versions = {name: metadata.version(name) for name in ("unicorn", "ziglang", "pyelftools")}
    return {**versions, "C compiler of this machine": compiler_identity(compiler_command(), ())[0]}
