"""Part "exhaustive": helper functions of one argument, including static ones, for all 2^32 inputs.

The expected results are computed differently: in double precision, in integers or bit by bit, from the configuration; see
claims_frames.py, claims_control.py and claims_map.py. The C is compiled unchanged, with undefined behaviour reported. A
function with a numeric argument must have a claim or an entry in OTHERS, and each claim must have its function; otherwise the
part fails.
"""

import os
import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain
from pathlib import Path

from codegen.errors import BuildError
from codegen.sil import toolchain
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitized import Compiler, find_compiler
from tests.evidence.exhaustive import claims_control, claims_frames, claims_map
from tests.evidence.exhaustive.claim import FLOATS, TEMPLATES, Claim, Source
from tests.evidence.progress import Progress

SHOWS = "each helper of one argument has the right result for every input, and none has undefined behaviour"
QUICK_STRIDE = 1009
"""Prime, and below the number of floats with one exponent. A quick run adds the inputs around all edges."""
PIECES = 8
"""Pieces of the 2^32 inputs that run in parallel."""
FINDINGS_MAX = 3
"""Wrong inputs reported per claim."""

SEVERAL = "takes several numbers that vary: the contracts and the tests cover it"
CONTINUES = "continues a CRC: covered by the CRC of one number; tests compare that of the whole calibration"
OTHERS: Mapping[str, str] = {
    **{f"checksum: {name}": CONTINUES for name in ("crc_step", "@_checksum_whole")},
    "map: @_map_crc": CONTINUES,
    "parameters: @_parameters_crc": CONTINUES,
    "reference_model: @_reference_model_crc": CONTINUES,
    "selftest: with_the_rest": CONTINUES,
    "can: error_of": "takes a product and its factors: covered by to_code, for every value of each coding",
    "can: goes_outward": "takes a product and its factors: covered by to_code, for every value of each coding",
    "reference_model: curve_at": "covered by both curves, for every argument",
    "map: place_of": "pairs the results of locate_speed and locate_front_angle",
    "controller: within_step": SEVERAL,
    "task: start_from": "keeps the angle that controller_place() holds: covered by bounded, and by the contract",
    **{f"task: {name}": SEVERAL for name in ("is_outer", "no_farther_out", "wait_for_wheels", "stay_near_wheels")},
    "law: allowed": SEVERAL,
    "law: @_law_init": "keeps the number or starts the model from it: tests of the state after a start cover it",
    "grip: @_grip_update": SEVERAL,
    **{
        f"inputs: {name}": SEVERAL
        for name in (
            "follow",
            "prove",
            "is_frozen",
            "take_speed",
            "take_front_angle",
            "judge_lateral",
            "turn_of_lateral",
            "check_speed",
            "compare_with_lateral",
            "contradicts",
        )
    },
    **{f"inputs: {name}": SEVERAL for name in ("take_yaw_rate", "learn_offsets", "@_inputs_step")},
    **{f"inputs: {name}": SEVERAL for name in ("follow_linear_vehicle", "expect")},
    **{
        f"law: {name}": SEVERAL
        for name in (
            "observe_sideslip",
            "@_law_rest",
            "interpolated",
            "reference_ahead",
            "reachable_yaw_rate",
            "feedback_range",
        )
    },
    **{f"law: {name}": SEVERAL for name in ("start_law", "track", "@_law_step")},
    **{f"map: {name}": SEVERAL for name in ("capped", "yaw_rate_at", "capped_rear_angle")},
    **{f"map: @_map_{name}": SEVERAL for name in ("yaw_rate", "yaw_rate_on_road", "reference")},
    "reference_model: @_reference_model_start": SEVERAL,
}
"""Unit and function with a numeric argument but without a claim, with the reason."""

PLAIN = ("-std=c99", "-O1", "-ffp-contract=off", "-w")
FLAGS = ("-std=c99", "-O3", "-march=native", "-fno-trapping-math", "-ffp-contract=off", "-w")
# These do not change results. With jump threading, gcc does not vectorise selections by a comparison of floats.
GCC_FLAGS = ("-fno-thread-jumps", "-fno-tree-dominator-opts", "-fno-tree-pre")
# `codegen verify` checks addresses with its sanitizers; here they would take most of the time.
UNDEFINED = "-fsanitize=float-cast-overflow,signed-integer-overflow,integer-divide-by-zero,shift,bounds"
LINKED = ("parameters", "law", "controller", "map", "grip", "reference_model", "task")
"""Units whose helpers call other units or read the calibration."""

_UNDEFINED = re.compile(r"^(?P<place>[^\s:]+:\d+)(?::\d+)?: runtime error: (?P<what>.+)$", re.MULTILINE)


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part. A quick run uses a sample of the floats and all inputs around the edges of each claim.

    Raises:
        MissingTool: no C compiler has working sanitizers. BuildError: a build is in double precision.
    """
    compiler, stride = find_compiler(), QUICK_STRIDE if effort.quick else 1
    findings: list[str] = []
    judged = []
    with tempfile.TemporaryDirectory(prefix="ars-exhaustive-") as scratch, ThreadPoolExecutor(os.cpu_count()) as pool:
        for source in map(Source, map(Subject.read, folders)):
            claims, missing = claims_of(source)
            findings += missing
            for path in source.functions:
                place = f"{source.subject.name}/{path}"
                keys = {f"{place}: {claim.name}": claim for claim in claims if source.path(claim.unit) == path}
                todo = {key: claim for key, claim in keys.items() if progress.done.get(f"{key} {stride}") is None}
                program = (
                    pool.submit(compile_program, compiler, source, path, [*todo.values()], Path(scratch, place))
                    if todo
                    else None
                )
                running = {key: [pool.submit(_run, program, index, piece) for piece in pieces_of(claim, stride)]
                           for index, (key, claim) in enumerate(todo.items()) if program}  # fmt: skip
                judged += [(key, claim, running.get(key, [])) for key, claim in keys.items()]
        results = [
            (key, claim, *progress.once(f"{key} {stride}", lambda pieces=pieces: _sum([each.result() for each in pieces])))
            for key, claim, pieces in judged
        ]
    return _outcome(results, findings, compiler)


def claims_of(source: Source) -> tuple[list[Claim], list[str]]:
    """Return the claims about a build, and findings: claims without a function and functions without a claim."""
    name, prefix = source.subject.name, source.subject.prefix
    if not source.subject.is_single:
        raise BuildError("the inputs of a build in double precision are too many to run all of them", where=name)
    modules = (claims_frames, claims_control, claims_map)
    every = [claim.rendered(prefix) for module in modules for claim in module.claims(source)]
    claims = [claim for claim in every if claim.function in source.functions.get(source.path(claim.unit), ())]
    known = {f"{claim.unit}: {claim.function}" for claim in claims} | {other.replace("@", prefix) for other in OTHERS}
    findings = [f"{name}/{source.path(claim.unit)}: {claim.name} is not there" for claim in every if claim not in claims]
    findings += [
        f"{name}/{path}: {function}() takes a number and has neither a claim nor a reason for having none"
        for path, functions in source.functions.items()
        for function, takes_number in functions.items()
        if takes_number and f"{path.removeprefix(source.path('')[:-2]).removesuffix('.c')}: {function}" not in known
    ]
    return claims, findings


def pieces_of(claim: Claim, stride: int) -> list[tuple[int, int, int]]:
    """Return first input, end and stride of the pieces that run in parallel."""
    if claim.inputs != FLOATS:
        return [(0, claim.inputs, 1)]
    size = FLOATS // (PIECES if stride == 1 else 1)
    return [(first, first + size, stride) for first in range(0, FLOATS, size)]


def compile_program(compiler: Compiler, source: Source, path: str, claims: Sequence[Claim], folder: Path) -> Path:
    """Compile the checks of a unit in their own folder. Raises BuildError: the C does not compile."""
    files = source.subject.sources()
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    text = TEMPLATES.get_template("exhaustive.c.j2").render(unit=path, claims=claims, floats=FLOATS)
    (folder / "judge.c").write_text(text, encoding="ascii")
    is_linked = path in map(source.path, LINKED)
    others = [name for name in sorted(files) if name.endswith(".c") and name != path and is_linked]
    flags = (*FLAGS, *(() if "clang" in compiler.version else GCC_FLAGS), UNDEFINED)
    for options, sources in ((flags, ["judge.c"]), (PLAIN, others)):
        if sources:
            command = [*compiler.command, *options, "-I.", "-Iinclude", "-c", *sources]
            toolchain.require_success(toolchain.run(command, folder), path)
    objects = [f"{Path(name).stem}.o" for name in ("judge.c", *others)]
    toolchain.require_success(toolchain.run([*compiler.command, UNDEFINED, *objects, "-o", "judge", "-lm"], folder), path)
    return folder / "judge"


def _run(program: Future[Path], index: int, piece: tuple[int, int, int]) -> tuple[int, int, list[str]]:
    """Run a piece of the inputs of one claim; return the number of inputs, the number of wrong ones, and the findings."""
    done = subprocess.run(
        [str(program.result()), *map(str, (index, *piece))],
        env={**os.environ, "LC_ALL": "C", "UBSAN_OPTIONS": "print_stacktrace=0:halt_on_error=0:color=never"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    findings = [f"{found['place']}: undefined behaviour: {found['what']}" for found in _UNDEFINED.finditer(done.stderr)]
    lines = [line.split("|") for line in done.stdout.splitlines()]
    findings += ["of {} ({}): {}: {}, not {}".format(*parts) for kind, *parts in lines if kind == "wrong"]
    inputs, wrong = next(((int(parts[0]), int(parts[1])) for kind, *parts in lines if kind == "inputs"), (0, 0))
    if done.returncode != 0 or inputs == 0:
        findings.append(f"ends with exit code {done.returncode} before all inputs have run")
    return inputs, wrong, findings


def _sum(results: Sequence[tuple[int, int, list[str]]]) -> tuple[int, int, list[str]]:
    inputs, wrong, findings = zip(*results, strict=True)
    return sum(inputs), sum(wrong), list(dict.fromkeys(chain(*findings)))[:FINDINGS_MAX]


def _outcome(results: Sequence[tuple[str, Claim, int, int, list[str]]], missing: Sequence[str], compiler: Compiler) -> Outcome:
    findings, figures = [*missing], {}
    for key, claim, inputs, wrong, texts in results:
        findings += [f"{key} {text}" + (f"; {wrong:,} inputs are wrong" if wrong else "") for text in texts]
        figures[key] = {"claim": claim.text, "inputs": inputs, "wrong": wrong}
    if not results:
        findings.append("no claim was judged")
    floats = [inputs for _, claim, inputs, *_ in results if claim.inputs == FLOATS]
    few = [inputs for _, claim, inputs, *_ in results if claim.inputs != FLOATS]
    figure = f"{len(floats)} helpers x {min(floats, default=0):,} inputs; {len(few)} with few inputs, {sum(few):,} in all; "
    figure += f"{sum(wrong for *_, wrong, _ in results):,} wrong"
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    return Outcome(SHOWS, figure, verdict, tuple(findings), figures, tools={"cc": compiler.version})
