"""Programs that judge helpers: made from exhaustive.c.j2 around a unit of a build, compiled, run."""

from __future__ import annotations

import functools
import hashlib
import os
import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from codegen.sil.toolchain import require_success, run
from codegen.verify.check import Subject
from codegen.verify.sanitizers.sanitized import Compiler
from tests.evidence.exhaustive.exhaustive_helper import Helper
from tests.evidence.exhaustive.exhaustive_source import Judged

PLAIN = ("-std=c99", "-O1", "-ffp-contract=off", "-w")
FLAGS = (
    *("-std=c99", "-O2", "-ffp-contract=off", "-w"),
    # What depends on a number. Addresses are for the sanitizers of `codegen verify`, and would take most of the time here.
    "-fsanitize=float-cast-overflow,signed-integer-overflow,integer-divide-by-zero,shift,bounds",
)
LINKED = ("controller", "map")
"""Units whose helpers call other units, or read the calibration."""
PIECES = 4
"""In which the inputs of a helper are gone through, at the same time where there are processors for it."""

_UNDEFINED = re.compile(r"^(?P<place>[^\s:]+:\d+)(?::\d+)?: runtime error: (?P<what>.+)$", re.MULTILINE)


@dataclass(frozen=True)
class Judge:
    """A helper's claim as C.

    Attributes:
        name: of the helper, with what tells it apart.
        key: equal for claims that are the same C all the way down.
    """

    name: str
    claim: str
    floats: bool
    inputs: int
    setup: str
    start: str
    body: str
    edges: str
    key: str


@dataclass(frozen=True)
class Verdicts:
    """What came of going through inputs: how many, how many of them wrong, and some of these in words."""

    inputs: int
    wrong: int
    told: tuple[str, ...]


@functools.cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )


def judge_of(helper: Helper, judged: Judged) -> Judge:
    """The C of a claim over a unit. Raises Absent: the unit has no such function, or calls it otherwise."""
    prefix = judged.subject.prefix

    def call(function: str, /, **arguments: object) -> str:
        return judged.call(function.replace("@", prefix), arguments)

    context: dict[str, Any] = {**helper.values, "p": prefix, "P": prefix.upper(), "call": call}
    setup, start, body, edges = (
        _templates().from_string(text).render(context) for text in (helper.setup, helper.start, helper.body, helper.edges)
    )
    name = helper.function.replace("@", prefix) + (f" ({helper.of})" if helper.of else "")
    text = "\n".join((setup, start, body, edges))
    whole = repr((name, helper.inputs, text, judged.dependence(text)))
    return Judge(
        name, helper.claim, helper.floats, helper.inputs, setup, start, body, edges, hashlib.sha256(whole.encode()).hexdigest()
    )


@dataclass(frozen=True)
class Program:
    """A compiled program.

    Attributes:
        path: of the executable.
        judges: in its order.
    """

    path: Path
    judges: tuple[Judge, ...]

    def go_through(self, index: int, first: int, last: int, stride: int) -> Verdicts:
        """One claim, for the inputs from `first` until before `last`."""
        environment = {**os.environ, "LC_ALL": "C", "UBSAN_OPTIONS": "print_stacktrace=0:halt_on_error=0:color=never"}
        done = subprocess.run(
            [str(self.path), *map(str, (index, first, last, stride))],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        told = [f"{found['place']}: undefined behaviour: {found['what']}" for found in _UNDEFINED.finditer(done.stderr)]
        counted = (0, 0)
        for line in done.stdout.splitlines():
            kind, *parts = line.split("|")
            if kind == "wrong":
                told.append("of {} ({}): {}: {}, not {}".format(*parts))
            else:
                counted = (int(parts[0]), int(parts[1]))
        if done.returncode != 0 or counted[0] == 0:
            told.append(f"it ended with exit code {done.returncode} before all inputs were gone through")
        return Verdicts(*counted, tuple(dict.fromkeys(told)))


def pieces(judge: Judge, stride: int) -> list[tuple[int, int, int]]:
    """First, last and stride of the parts in which a claim's inputs are gone through."""
    if not judge.floats:
        return [(0, judge.inputs, 1)]
    count = PIECES if stride == 1 else 1
    size = judge.inputs // count
    return [(k * size, (k + 1) * size, stride) for k in range(count)]


def compile_program(compiler: Compiler, subject: Subject, unit: str, judges: Sequence[Judge], folder: Path) -> Program:
    """A program around a unit, such as "map", in a folder of its own. Raises BuildError: C that does not compile."""
    path = f"src/{subject.prefix}_{unit}.c"
    for name, content in subject.sources().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    # A setup that two claims need stands before the first of them.
    firsts = {judge.setup: judge for judge in reversed(judges)}
    shown = [{**vars(judge), "setup": judge.setup if firsts[judge.setup] is judge else ""} for judge in judges]
    text = _templates().get_template("exhaustive.c.j2").render(unit=path, judges=shown)
    (folder / "judge.c").write_text(text, encoding="ascii")
    others = [name for name in sorted(subject.sources("src")) if name.endswith(".c") and name != path and unit in LINKED]
    for options, sources in ((FLAGS, ["judge.c"]), (PLAIN, others)):
        if sources:
            require_success(run([*compiler.command, *options, "-I.", "-Iinclude", "-c", *sources], folder), path)
    objects = [f"{Path(name).stem}.o" for name in ("judge.c", *others)]
    require_success(run([*compiler.command, *FLAGS, *objects, "-o", "judge", "-lm"], folder), path)
    return Program(folder / "judge", tuple(judges))
