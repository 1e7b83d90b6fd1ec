"""Part "exhaustive": the helper functions of one argument, static ones too, for all 2^32 inputs, against expected results.

The expected results are computed in another way, in double precision, in whole numbers or bit by bit, from the configuration:
see claims_frames.py, claims_control.py and claims_map.py. The C of the build is compiled as it is, with undefined behaviour
reported. A function that takes a number and has neither a claim nor an entry in OTHERS fails the part, and so does a claim
without its function. The claims of all builds that depend on the same C are run once.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import tempfile
from collections.abc import Container, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2

from codegen.errors import BuildError
from codegen.sil import toolchain
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitizers.sanitized import Compiler, find_compiler
from tests.evidence.exhaustive import claims_control, claims_frames, claims_map
from tests.evidence.exhaustive.claim import FLOATS, Absent, Claim, Source, takes_number
from tests.evidence.progress import Progress

SHOWS = "each helper of one argument has the right result for every input, and none has undefined behaviour"
QUICK_STRIDE = 1009
"""Prime, and below the number of floats with one exponent. A quick run adds the inputs around all edges."""
PIECES = 8
"""Parts of the 2^32 inputs that run in parallel."""
FINDINGS_MAX = 3
"""Wrong inputs reported for a claim."""

SEVERAL = "takes several numbers that vary: the proof and the tests cover it"
OTHERS: Mapping[str, str] = {
    "can: error_of": "takes a product and its factors: judged through to_code, for every value of each coding",
    "can: goes_outward": "takes a product and its factors: judged through to_code, for every value of each coding",
    "controller: allowed": SEVERAL,
    "controller: reference_ahead": SEVERAL,
    "controller: reachable_yaw_rate": SEVERAL,
    "controller: feedback_range": SEVERAL,
    "map: place_of": "pairs the results of locate_speed and locate_front_angle",
    "map: capped": SEVERAL,
    "map: yaw_rate_at": SEVERAL,
    "map: yaw_rate_on": SEVERAL,
    "map: @_map_yaw_rate_on_road": SEVERAL,
    "map: @_map_yaw_rate": SEVERAL,
    "map: capped_rear_angle": SEVERAL,
    "map: @_map_reference": SEVERAL,
    "reference_model: curve_at": "judged through both curves, for every argument",
    "reference_model: @_reference_model_start": SEVERAL,
}
"""Unit and function that takes a number and has no claim of its own, with the reason."""

PLAIN = ("-std=c99", "-O1", "-ffp-contract=off", "-w")
FLAGS = ("-std=c99", "-O3", "-march=native", "-fno-trapping-math", "-ffp-contract=off", "-w")
# None of these changes a result. With jump threading, gcc does not vectorize selections by a comparison of floats.
GCC_FLAGS = ("-fno-thread-jumps", "-fno-tree-dominator-opts", "-fno-tree-pre")
# Addresses are for the sanitizers of `codegen verify`: here they would take most of the time.
UNDEFINED = "-fsanitize=float-cast-overflow,signed-integer-overflow,integer-divide-by-zero,shift,bounds"
LINKED = ("controller", "map")
"""Units whose helpers call other units or read the calibration."""

TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)

_UNDEFINED = re.compile(r"^(?P<place>[^\s:]+:\d+)(?::\d+)?: runtime error: (?P<what>.+)$", re.MULTILINE)


@dataclass
class Judge:
    """A claim in C.

    Attributes:
        name: of the function, with the suffix of the claim.
        places: units of builds that have the claim with the same C all the way down.
        inputs, wrong, findings: results.
    """

    name: str
    text: str
    setup: str
    start: str
    body: str
    edges: str
    size: int
    places: list[str] = field(default_factory=list)
    inputs: int = 0
    wrong: int = 0
    findings: list[str] = field(default_factory=list)

    @property
    def is_float(self) -> bool:
        """Whether the inputs are all numbers in single precision."""
        return self.size == FLOATS

    @classmethod
    def of(cls, claim: Claim, source: Source) -> Judge:
        """Render a claim about a build. Raises Absent: the unit has no such function, or one with other parameters."""
        prefix = source.subject.prefix
        function = claim.function.replace("@", prefix)

        def call(name: str = function, /, **arguments: object) -> str:
            return source.call(claim.unit, name, arguments)

        values = {**claim.values, "function": function, "p": prefix, "P": prefix.upper(), "call": call}
        texts = (TEMPLATES.from_string(text).render(values) for text in (claim.setup, claim.start, claim.body, claim.edges))
        return cls(f"{function} ({claim.of})" if claim.of else function, claim.text, *texts, claim.inputs)

    def key(self, source: Source, unit: str) -> str:
        """Return a name that equal claims share: those with the same C all the way down."""
        text = "\n".join((self.setup, self.start, self.body, self.edges))
        whole = repr((self.size, text, source.dependence(unit, text)))
        return f"{self.name} {hashlib.sha256(whole.encode()).hexdigest()[:16]}"

    def pieces(self, stride: int) -> list[tuple[int, int, int]]:
        """Return first input, end and stride of the parts that run in parallel."""
        if not self.is_float:
            return [(0, self.size, 1)]
        size = self.size // (PIECES if stride == 1 else 1)
        return [(first, first + size, stride) for first in range(0, self.size, size)]

    def add(self, results: Sequence[tuple[int, int, Sequence[str]]]) -> None:
        """Store the results of all pieces."""
        self.inputs, self.wrong = sum(result[0] for result in results), sum(result[1] for result in results)
        texts = list(dict.fromkeys(text for result in results for text in result[2]))[:FINDINGS_MAX]
        more = f"; {self.wrong:,} inputs are wrong" if self.wrong else ""
        self.findings = [f"{self.places[0]}: {self.name} {text}{more}" for text in texts]


def run(folders: Sequence[Path], effort: Effort, progress: Progress, only: Container[str] | None = None) -> Outcome:
    """Run the part. A quick run takes a sample of the floats and all inputs around the edges of each claim.

    Args:
        only: units, without prefix; by default all.

    Raises:
        MissingTool: no C compiler has working sanitizers. BuildError: a build is in double precision.
    """
    compiler, stride = find_compiler(), QUICK_STRIDE if effort.quick else 1
    judges: dict[str, Judge] = {}
    findings: list[str] = []
    with tempfile.TemporaryDirectory(prefix="ars-exhaustive-") as scratch, ThreadPoolExecutor(os.cpu_count()) as pool:
        programs, pieces = [], []
        for source in map(Source, map(Subject.read, folders)):
            claims = _claims(source)
            findings += [
                f"{source.subject.name}: there is no unit {unit!r}, which claims are made about"
                for unit in dict.fromkeys(claim.unit for claim in claims)
                if not source.has(unit)
            ]
            for unit in source.units:
                if only is None or unit in only:
                    own, missing = _judges(source, unit, claims)
                    findings += missing
                    new = {key: judge for key, judge in own.items() if judges.setdefault(key, judge) is judge}
                    for key in own:
                        judges[key].places.append(f"{source.subject.name}/{source.path(unit)}")
                    todo = {key: judge for key, judge in new.items() if progress.get(f"{key} {stride}") is None}
                    folder = Path(scratch, source.subject.name, unit)
                    if todo:
                        programs.append((pool.submit(compile_program, compiler, source, unit, [*todo.values()], folder), todo))
        for program, todo in programs:
            for index, (key, judge) in enumerate(todo.items()):
                pieces.append((key, [pool.submit(_run, program, index, piece) for piece in judge.pieces(stride)]))
        running = dict(pieces)
        for key, judge in judges.items():
            judge.add(progress.once(f"{key} {stride}", lambda key=key: [piece.result() for piece in running[key]]))
    return _outcome([*judges.values()], findings, compiler)


def _claims(source: Source) -> list[Claim]:
    if not source.subject.is_single:
        raise BuildError("the inputs of a build in double precision are too many to run all of them", where=source.subject.name)
    return [claim for module in (claims_frames, claims_control, claims_map) for claim in module.claims(source)]


def _judges(source: Source, unit: str, claims: Sequence[Claim]) -> tuple[dict[str, Judge], list[str]]:
    """Return the judges of a unit by key, and why functions have none."""
    judges, missing, where = {}, [], f"{source.subject.name}/{source.path(unit)}"
    own = [claim for claim in claims if claim.unit == unit]
    for claim in own:
        try:
            judge = Judge.of(claim, source)
            judges[judge.key(source, unit)] = judge
        except Absent as error:
            missing.append(f"{source.subject.name}/{error}: {claim.function} cannot be judged")
    known = [name.removeprefix(f"{unit}: ") for name in (*OTHERS, *(claim.function for claim in own))]
    names = {name.replace("@", source.subject.prefix) for name in known}
    missing += [
        f"{where}: {name}() takes a number and has neither a claim nor a reason for having none"
        for name, parameters in source.functions(unit).items()
        if takes_number(parameters) and name not in names
    ]
    return judges, missing


def compile_program(compiler: Compiler, source: Source, unit: str, judges: Sequence[Judge], folder: Path) -> Path:
    """Compile the judges of a unit in a folder of their own. Raises BuildError: the C does not compile."""
    path, files = source.path(unit), source.subject.sources()
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    # A setup that two judges need stands before the first of them.
    firsts = {judge.setup: judge for judge in reversed(judges)}
    shown = [
        {**vars(judge), "is_float": judge.is_float, "setup": judge.setup if firsts[judge.setup] is judge else ""}
        for judge in judges
    ]
    text = TEMPLATES.get_template("exhaustive.c.j2").render(unit=path, judges=shown)
    (folder / "judge.c").write_text(text, encoding="ascii")
    others = [name for name in sorted(files) if name.endswith(".c") and name != path and unit in LINKED]
    flags = (*FLAGS, *(() if "clang" in compiler.version else GCC_FLAGS), UNDEFINED)
    for options, sources in ((flags, ["judge.c"]), (PLAIN, others)):
        if sources:
            command = [*compiler.command, *options, "-I.", "-Iinclude", "-c", *sources]
            toolchain.require_success(toolchain.run(command, folder), path)
    objects = [f"{Path(name).stem}.o" for name in ("judge.c", *others)]
    toolchain.require_success(toolchain.run([*compiler.command, UNDEFINED, *objects, "-o", "judge", "-lm"], folder), path)
    return folder / "judge"


def _run(program: Any, index: int, piece: tuple[int, int, int]) -> tuple[int, int, list[str]]:
    """Run a piece of the inputs of one judge: how many inputs, how many wrong, and the findings."""
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
    counted = [(int(parts[0]), int(parts[1])) for kind, *parts in lines if kind == "inputs"]
    if done.returncode != 0 or not counted or counted[0][0] == 0:
        findings.append(f"ends with exit code {done.returncode} before all inputs have run")
    return *(counted[0] if counted else (0, 0)), findings


def _outcome(judges: Sequence[Judge], missing: Sequence[str], compiler: Compiler) -> Outcome:
    findings = [*missing, *(finding for judge in judges for finding in judge.findings)]
    if not judges:
        findings.append("no claim was judged")
    floats = [judge for judge in judges if judge.is_float]
    few = [judge for judge in judges if not judge.is_float]
    each = min((judge.inputs for judge in floats), default=0)
    figure = f"{len(floats)} helpers x {each:,} inputs, {sum(judge.wrong for judge in floats):,} wrong"
    if few:
        inputs, wrong = sum(judge.inputs for judge in few), sum(judge.wrong for judge in few)
        figure += f"; {len(few)} with few inputs, {inputs:,} in all, {wrong:,} wrong"
    figures = {
        f"{judge.places[0]}: {judge.name}": {
            "claim": judge.text,
            "inputs": judge.inputs,
            "wrong": judge.wrong,
            **({"same_c_in": judge.places[1:]} if judge.places[1:] else {}),
        }
        for judge in judges
    }
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    return Outcome(SHOWS, figure, verdict, tuple(findings), figures, tools={"cc": compiler.version})
