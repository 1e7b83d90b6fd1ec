"""Part "frama-c": the value analysis EVA of Frama-C over the shipped C, as a second opinion on the proof.

frama_c.c.j2 calls every public function with all that its contract allows. EVA then follows ranges of values, not relations
between them: where it cannot exclude that an index, an address, a division or a conversion goes wrong, it raises an alarm. Each
alarm is a finding unless frama_c.toml argues that it is a false one; an argument without its alarm is a finding too.
"""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import jinja2
from pydantic import BaseModel, ConfigDict

from codegen import config as configuration
from codegen.emit.c_outline import units
from codegen.emit.can_view import task_name
from codegen.emit.text import c_type
from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool

SHOWS = "a value analysis finds no index, address, division, conversion or use of an unset value that could go wrong"
ARGUED = Path(__file__).with_name("frama_c.toml")
ENTRIES = ("map", "dynamics", "can", "e2e", "limiter", "reference_model", "controller", "task")
LIMITS = (
    "Frama-C follows ranges and not relations: that outputs stay within their bounds is for the proof.",
    "The functions of the C library have their specifications from Frama-C, not their code.",
)

EVA = (
    *("-eva", "-eva-no-print", "-eva-msg-key=-initial-state"),
    *("-eva-domains", "cvalue,equality,gauges,symbolic-locations"),
    # Loops over frames, schedules and breakpoints one step at a time; the map's checksum as a whole.
    *("-eva-auto-loop-unroll", "32", "-eva-slevel", "0", "-eva-ilevel", "256", "-eva-plevel", "256"),
    *("-eva-subdivide-non-linear", "60", "-eva-subdivide-non-linear-function", "crc_of:0"),
    # NaN and infinity are numbers here, as they are for the code.
    *("-warn-special-float", "none", "-warn-signed-downcast", "-warn-pointer-downcast"),
)
MACHINE = "x86_32"
"""Sizes of an ECU's types: 32-bit int, long and addresses."""

_REACHED = re.compile(r"^ {2}(?P<function>\w+): (?P<reached>\d+) stmts out of (?P<statements>\d+) ", re.MULTILINE)
_ERROR = re.compile(r"^\[\w+\] (?:(?P<place>\S+:\d+): )?\s*(?P<what>syntax error|User Error: .*|.*aborted.*)", re.MULTILINE)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_PROTOTYPE = re.compile(r"\b(\w+)\s*\([^(){};]*\)\s*;")


@dataclass(frozen=True)
class Alarm:
    """What EVA cannot exclude.

    Attributes:
        unit: path in the build. line: in it.
        function: that it is in. statement: the line's text.
        claim: what would have to hold, in ACSL; `kind` as Frama-C calls it.
        certain: whether it goes wrong whenever it is reached.
    """

    unit: str
    line: int
    function: str
    statement: str
    claim: str
    kind: str
    certain: bool


class Argument(BaseModel):
    """Why an alarm is a false one. `unit` is without prefix; the others are those of the alarm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    unit: str
    function: str
    statement: str
    claim: str
    reason: str


@dataclass(frozen=True)
class Analysis:
    """What EVA says of a build.

    Attributes:
        name: of the build. prefix: of its names.
        alarms: all of them.
        functions, analysed: how many are defined in the C, and reached.
        statements, reached: in the functions that are reached. partly: those functions of which some statement is not reached.
        unreached: functions that are defined and not reached, with their unit.
        units: without prefix.
    """

    name: str
    prefix: str
    alarms: tuple[Alarm, ...]
    functions: int
    statements: int
    reached: int
    partly: tuple[str, ...]
    unreached: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def analysed(self) -> int:
        """Functions that are reached."""
        return self.functions - len(self.unreached)


def run(folders: Sequence[Path], effort: Effort) -> Outcome:
    """The part of the campaign; the same, quick or not.

    Raises:
        MissingTool: there is no frama-c. BuildError: it does not take the C.
    """
    del effort
    program = find_frama_c()
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        analyses = list(pool.map(lambda folder: analyse(program, Subject.read(folder)), folders))
    return outcome_of(analyses, arguments(), _version(program))


def find_frama_c() -> str:
    """Its path. Raises MissingTool."""
    path = shutil.which("frama-c")
    if path is None:
        raise MissingTool("it is not installed", where="frama-c", remedy="apt install frama-c-base")
    return path


def arguments(path: Path = ARGUED) -> tuple[Argument, ...]:
    """What is argued about alarms."""
    entries = tomllib.loads(path.read_text(encoding="utf-8"))["false_alarm"]
    return tuple(Argument.model_validate(entry) for entry in entries)


def _version(program: str) -> str:
    done = subprocess.run([program, "-version"], capture_output=True, text=True, check=False)
    return done.stdout.strip()


def analyse(program: str, subject: Subject, entries: Sequence[str] = ENTRIES) -> Analysis:
    """EVA over a build, from some entries of the driver.

    Raises:
        BuildError: a public function has no entry, or Frama-C does not take the C.
    """
    driver = driver_of(subject, entries)
    with tempfile.TemporaryDirectory(prefix="ars-frama-c-") as name:
        root = Path(name).resolve()
        for path, content in subject.sources().items():
            (root / path).parent.mkdir(parents=True, exist_ok=True)
            (root / path).write_bytes(content)
        (root / "driver.c").write_text(driver, encoding="ascii")
        sources = sorted(path for path in subject.sources("src") if path.endswith(".c"))
        options = ("-machdep", MACHINE, "-cpp-extra-args=-Iinclude")
        command = [program, *options, "driver.c", *sources, *EVA, "-metrics-eva-cover", "-then", "-report-csv", "alarms.csv"]
        # Frama-C goes by PWD, not by where it is.
        environment = {**os.environ, "LC_ALL": "C.UTF-8", "PWD": str(root)}
        done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, errors="replace", check=False)
        report = root / "alarms.csv"
        if done.returncode != 0 or not report.is_file():
            said = _ERROR.search(done.stdout + done.stderr)
            what = said["what"] if said else f"it ended with exit code {done.returncode}"
            place = f"{subject.name}/{said['place']}" if said and said["place"] else subject.name
            raise BuildError(f"Frama-C does not take the C: {what}", where=place)
        rows = list(csv.DictReader(report.read_text(encoding="utf-8").splitlines(), delimiter="\t", quoting=csv.QUOTE_NONE))
    return _analysis(subject, done.stdout, rows)


def driver_of(subject: Subject, entries: Sequence[str] = ENTRIES) -> str:
    """The driver in C. Raises BuildError: a public function that no entry calls."""
    options = subject.manifest["options"]
    config = configuration.parse(subject.manifest["configuration"], "manifest.json: configuration")
    with_model = f"include/{subject.prefix}_reference_model.h" in subject.files
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    public = set(_public(subject))
    text = environment.from_string(ARGUED.with_name("frama_c.c.j2").read_text(encoding="ascii")).render(
        p=subject.prefix,
        real=c_type(options["precision"]),
        task=task_name(config.controller.sampling_time_s),
        with_model=with_model,
        with_reference=f"{subject.prefix}_map_reference" in public,
        entries=[entry for entry in entries if with_model or entry != "reference_model"],
    )
    missing = sorted(name for name in public if f"{name}(" not in text)
    if missing:
        raise BuildError(f"no entry of frama_c.c.j2 calls {missing[0]}()", where=subject.name)
    return text


def _public(subject: Subject) -> Iterator[str]:
    for content in subject.sources("include").values():
        yield from _PROTOTYPE.findall(_COMMENT.sub(" ", content.decode("ascii")))


def _analysis(subject: Subject, said: str, rows: Sequence[dict[str, str]]) -> Analysis:
    covered = {found["function"]: found for found in _REACHED.finditer(said)}
    outlines = units(subject.sources("src"))
    # Where several units have a function of one name, Frama-C numbers them.
    defined = Counter(function.name for unit in outlines for function in unit.functions)
    own = {name: [one for key, one in covered.items() if re.fullmatch(rf"{name}(?:_\d+)?", key)] for name in defined}
    unreached = [name for name, times in defined.items() for _ in range(times - len(own[name]))]
    reached = [one for found in own.values() for one in found]
    return Analysis(
        name=subject.name,
        prefix=subject.prefix,
        alarms=tuple(_alarm(subject, row) for row in rows if row["directory"] == "src"),
        functions=defined.total(),
        statements=sum(int(one["statements"]) for one in reached),
        reached=sum(int(one["reached"]) for one in reached),
        partly=tuple(sorted({one["function"] for one in reached if one["reached"] != one["statements"]})),
        unreached=tuple(unreached),
        units=tuple(Path(unit.path).stem.removeprefix(f"{subject.prefix}_") for unit in outlines),
    )


def _alarm(subject: Subject, row: dict[str, str]) -> Alarm:
    unit, line = f"src/{row['file']}", int(row["line"])
    text = subject.files[unit].decode("ascii").splitlines()[line - 1]
    statement = " ".join(_COMMENT.sub(" ", text).split())
    return Alarm(unit, line, row["function"], statement, row["property"], row["property kind"], "nvalid" in row["status"])


def outcome_of(analyses: Sequence[Analysis], argued: Sequence[Argument], version: str) -> Outcome:
    """Passed where every function is analysed, every alarm is argued to be false, and every argument has its alarm."""
    findings: list[str] = []
    used: list[Argument] = []
    for analysis in analyses:
        findings += [f"{analysis.name}: {name}() is not analysed" for name in analysis.unreached]
        for alarm in analysis.alarms:
            argument = next((one for one in argued if _is_of(one, alarm, analysis.prefix)), None)
            if argument is None or alarm.certain:
                findings.append(_told(analysis.name, alarm))
            else:
                used.append(argument)
    known = {unit for analysis in analyses for unit in analysis.units}
    findings += [
        f"frama_c.toml: {one.unit}: {one.function}: `{one.claim}` is argued to be a false alarm, and is none"
        for one in argued
        if one not in used and one.unit in known
    ]
    if not analyses:
        findings.append("nothing was analysed")
    alarms = sum(len(each.alarms) for each in analyses)
    figures = {
        each.name: {
            "functions": each.functions,
            "analysed": each.analysed,
            "statements": each.statements,
            "reached": each.reached,
            "partly_reached": list(each.partly),
            "alarms": [_told(each.name, alarm) for alarm in each.alarms],
        }
        for each in analyses
    }
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    figure = f"{alarms} alarms, {len(used)} of them argued to be false; {_coverage(analyses)}; Frama-C {version}"
    return Outcome(SHOWS, figure, verdict, tuple(findings), figures, LIMITS, {"frama-c": version})


def _coverage(analyses: Sequence[Analysis]) -> str:
    analysed, functions = sum(each.analysed for each in analyses), sum(each.functions for each in analyses)
    reached, statements = sum(each.reached for each in analyses), sum(each.statements for each in analyses)
    return f"{analysed:,} of {functions:,} functions, {reached:,} of {statements:,} statements"


def _is_of(argument: Argument, alarm: Alarm, prefix: str) -> bool:
    return (argument.unit, argument.function, argument.statement, argument.claim) == (
        alarm.unit.removeprefix(f"src/{prefix}_").removesuffix(".c"),
        alarm.function,
        alarm.statement,
        alarm.claim,
    )


def _told(build: str, alarm: Alarm) -> str:
    sure = "certain" if alarm.certain else "possible"
    return f"{build}/{alarm.unit}:{alarm.line}: {sure}: {alarm.kind}: {alarm.claim} in {alarm.function}(): `{alarm.statement}`"
