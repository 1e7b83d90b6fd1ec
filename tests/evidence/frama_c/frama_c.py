"""Part "frama-c": the value analysis EVA of Frama-C over the generated C, a second opinion on the proof.

frama_c.c.j2 calls every public function with all that its contract allows. EVA follows ranges of values, not relations between
them. It raises an alarm where it cannot exclude that an index, an address, a division or a conversion goes wrong. Each alarm is
a finding unless frama_c.toml argues that it is false. An argument without its alarm is a finding too.
"""

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
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import jinja2

from codegen import config as configuration
from codegen.emit.c_outline import units
from codegen.emit.can_view import task_name
from codegen.emit.text import c_type
from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.progress import Progress

SHOWS = "a value analysis finds no index, address, division, conversion or use of an unset value that could go wrong"
ARGUED = Path(__file__).with_name("frama_c.toml")
ENTRIES = ("map", "dynamics", "can", "e2e", "inputs", "limiter", "reference_model", "grip", "law", "controller", "task")
OF_REFERENCE_MODEL = ("reference_model", "grip")
"""Entries of the units that only some kinds of controller have."""
TYPES = ["dynamics_state", "dynamics_input", "limiter_parameters", "limiter_input", "measurement", "parameters"]
TYPES += ["rear_steer_command", "vehicle_conditions", "vehicle_motion", "reference_model_input", "inputs_parameters"]
"""Types of which the driver gives any value."""
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

_REACHED = re.compile(r"^ {2}(\w+): \d+ stmts out of \d+ ", re.MULTILINE)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_PROTOTYPE = re.compile(r"\b(\w+)\s*\([^(){};]*\)\s*;")


class Alarm(NamedTuple):
    """A property (`claim`, in ACSL) that EVA cannot prove in a line; certain where it is violated whenever it is reached."""

    unit: str
    line: int
    function: str
    statement: str
    claim: str
    kind: str
    certain: bool


class Argument(NamedTuple):
    """Why an alarm is false. `unit` is without prefix; the others are those of the alarm."""

    unit: str
    function: str
    statement: str
    claim: str
    reason: str


@dataclass(frozen=True)
class Analysis:
    """Result of EVA for a build: alarms, number of functions, those that EVA does not reach, and units without prefix."""

    name: str
    prefix: str
    alarms: Sequence[Alarm]
    functions: int
    unreached: Sequence[str]
    units: Sequence[str]


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part; a quick run is a whole one.

    Raises:
        MissingTool: frama-c is not installed. BuildError: it rejects the C.
    """
    program = find_frama_c()
    subjects = [Subject.read(folder) for folder in folders]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        running = {one.name: pool.submit(analyse, program, one) for one in subjects if progress.get(one.name) is None}
        stored = [progress.once(one.name, lambda name=one.name: asdict(running[name].result())) for one in subjects]
    analyses = [Analysis(**{**one, "alarms": [Alarm(*alarm) for alarm in one["alarms"]]}) for one in stored]
    version = subprocess.run([program, "-version"], capture_output=True, text=True, check=False).stdout.strip()
    return outcome_of(analyses, arguments(), version)


def find_frama_c() -> str:
    """Return the path of the program. Raises MissingTool."""
    path = shutil.which("frama-c")
    if path is None:
        raise MissingTool("it is not installed", where="frama-c", remedy="apt install frama-c-base")
    return path


def arguments() -> list[Argument]:
    """Return the arguments about false alarms."""
    return [Argument(**entry) for entry in tomllib.loads(ARGUED.read_text(encoding="utf-8"))["false_alarm"]]


def analyse(program: str, subject: Subject, entries: Sequence[str] = ENTRIES) -> Analysis:
    """Run EVA over a build, from some entries of the driver.

    Raises:
        BuildError: a public function has no entry, or Frama-C rejects the C.
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
        # Frama-C reads the current folder from PWD.
        environment = {**os.environ, "LC_ALL": "C.UTF-8", "PWD": str(root)}
        done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, errors="replace", check=False)
        report = root / "alarms.csv"
        if done.returncode != 0 or not report.is_file():
            raise BuildError(f"Frama-C rejects the C: {(done.stdout + done.stderr)[-500:]}", where=subject.name)
        rows = list(csv.DictReader(report.read_text(encoding="utf-8").splitlines(), delimiter="\t", quoting=csv.QUOTE_NONE))
    return _analysis(subject, done.stdout, rows)


def driver_of(subject: Subject, entries: Sequence[str] = ENTRIES) -> str:
    """Return the driver in C. Raises BuildError: no entry calls a public function."""
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
        entries=[entry for entry in entries if with_model or entry not in OF_REFERENCE_MODEL],
        units=[unit for unit in ENTRIES if with_model or unit not in OF_REFERENCE_MODEL],
        types=TYPES if with_model else TYPES[:-1],
    )
    missing = sorted(name for name in public if f"{name}(" not in text)
    if missing:
        raise BuildError(f"no entry of frama_c.c.j2 calls {missing[0]}()", where=subject.name)
    return text


def _public(subject: Subject) -> Iterator[str]:
    for content in subject.sources("include").values():
        yield from _PROTOTYPE.findall(_COMMENT.sub(" ", content.decode("ascii")))


def _analysis(subject: Subject, output: str, rows: Sequence[dict[str, str]]) -> Analysis:
    covered = _REACHED.findall(output)
    outlines = units(subject.sources("src"))
    # Where several units have a function of one name, Frama-C numbers them.
    defined = Counter(function.name for unit in outlines for function in unit.functions)
    own = {name: [key for key in covered if re.fullmatch(rf"{name}(?:_\d+)?", key)] for name in defined}
    unreached = [name for name, times in defined.items() for _ in range(times - len(own[name]))]
    return Analysis(
        name=subject.name,
        prefix=subject.prefix,
        alarms=[_alarm(subject, row) for row in rows if row["directory"] == "src"],
        functions=defined.total(),
        unreached=unreached,
        units=[Path(unit.path).stem.removeprefix(f"{subject.prefix}_") for unit in outlines],
    )


def _alarm(subject: Subject, row: dict[str, str]) -> Alarm:
    unit, line = f"src/{row['file']}", int(row["line"])
    text = subject.files[unit].decode("ascii").splitlines()[line - 1]
    statement = " ".join(_COMMENT.sub(" ", text).split())
    return Alarm(unit, line, row["function"], statement, row["property"], row["property kind"], "nvalid" in row["status"])


def outcome_of(analyses: Sequence[Analysis], argued: Sequence[Argument], version: str) -> Outcome:
    """Return the outcome: passed if every function is analysed, every alarm is argued, and every argument has its alarm."""
    findings: list[str] = []
    used: list[Argument] = []
    for each in analyses:
        findings += [f"{each.name}: {name}() is not analysed" for name in each.unreached]
        for alarm in each.alarms:
            unit = alarm.unit.removeprefix(f"src/{each.prefix}_").removesuffix(".c")
            place = (unit, alarm.function, alarm.statement, alarm.claim)
            argument = next((one for one in argued if one[:-1] == place), None)
            if argument is None or alarm.certain:
                findings.append(_text(each.name, alarm))
            else:
                used.append(argument)
    known = {unit for each in analyses for unit in each.units}
    findings += [
        f"frama_c.toml: {one.unit}: {one.function}: `{one.claim}` is argued to be a false alarm, but is no alarm"
        for one in argued
        if one not in used and one.unit in known
    ]
    if not analyses:
        findings.append("nothing was analysed")
    figures = {
        each.name: {
            "functions": each.functions,
            "analysed": each.functions - len(each.unreached),
            "alarms": [_text(each.name, alarm) for alarm in each.alarms],
        }
        for each in analyses
    }
    functions, unreached = sum(each.functions for each in analyses), sum(len(each.unreached) for each in analyses)
    figure = f"{sum(len(each.alarms) for each in analyses)} alarms, {len(used)} of them argued to be false; "
    figure += f"{functions - unreached:,} of {functions:,} functions; Frama-C {version}"
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    return Outcome(SHOWS, figure, verdict, tuple(findings), figures, LIMITS, {"frama-c": version})


def _text(build: str, alarm: Alarm) -> str:
    sure = "certain" if alarm.certain else "possible"
    return f"{build}/{alarm.unit}:{alarm.line}: {sure}: {alarm.kind}: {alarm.claim} in {alarm.function}(): `{alarm.statement}`"
