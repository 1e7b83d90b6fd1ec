"""Programs with AddressSanitizer and UndefinedBehaviorSanitizer: compile them, run them and read their reports.

A compiler is used only if its sanitizers find three planted faults first. A program with the generated code of a build serves
as an ECU behind a pipe: whatever the code does there, wrong addresses included, this process goes on. The commands are defined
in `templates/verify/served_ecu.c.j2`.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import struct
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.emit.render import verbatim
from codegen.emit.text import numpy_type
from codegen.errors import BuildError, CodegenError
from codegen.programs import run_program
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sil.software import RECORD_COLUMNS
from codegen.sil.toolchain import compiler_command, compiler_identity, require_success, run
from codegen.verify.drives import Samples
from codegen.verify.outcomes import Subject
from codegen.verify.tools import MissingTool, stored

SANITIZERS = "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow"
"""Sanitizers; `undefined` does not include the last two."""

SANITIZER_FLAGS = ("-std=c99", "-O1", "-g", "-fno-omit-frame-pointer", "-ffp-contract=off")
PLAIN_FLAGS = ("-std=c99", "-O2", "-g", "-ffp-contract=off")

OPTIONS = {
    "ASAN_OPTIONS": "detect_leaks=0:malloc_context_size=0:quarantine_size_mb=8:abort_on_error=1:color=never",
    "UBSAN_OPTIONS": "print_stacktrace=0:halt_on_error=0:color=never",
}
"""Options of the runtimes. Undefined behaviour is reported and the program continues, so that a run finds several faults; a
wrong address ends it."""

SYMBOLIZERS = ("llvm-symbolizer", *(f"llvm-symbolizer-{version}" for version in range(30, 10, -1)))
"""Programs that turn addresses into lines for clang's runtime; gcc's needs none."""

FINDINGS_MAX = 20

ROOT = "/generated"
"""Folder of the sources in debug information, independent of the build folder."""

CANARY_FAULTS = {"a": "heap-buffer-overflow", "c": "outside the range of representable values", "d": "division by zero"}

_UNDEFINED = re.compile(r"^(?P<place>[^\s:]+:\d+)(?::\d+)?: runtime error: (?P<what>.+)$", re.MULTILINE)
_ADDRESS = re.compile(r"==ERROR: AddressSanitizer: (?P<what>[\w-]+)")
_ACCESS = re.compile(r"^(?P<how>READ|WRITE) of size (?P<size>\d+)", re.MULTILINE)
_FRAME = re.compile(r"^\s+#\d+ 0x[0-9a-f]+ in (?P<function>\S+) (?P<place>[^\s:]+:\d+)", re.MULTILINE)
_PROPERTY = re.compile(r"^(?P<what>property not held: .+)$", re.MULTILINE)


@dataclass(frozen=True)
class Compiler:
    """Words of the command of a compiler with working sanitizers, and its version line."""

    command: tuple[str, ...]
    version: str


def find_compiler() -> Compiler:
    """Return the first of the user's C compiler, gcc and clang whose sanitizers find the planted faults.

    Raises:
        MissingTool: there is none.
    """
    candidates: list[tuple[str, ...]] = []
    with contextlib.suppress(BuildError):
        candidates.append(compiler_command())
    # If the user names a compiler with CC, no other one is tried.
    others = (
        () if os.environ.get("CC", "").strip() else ("gcc", "clang", *(f"clang-{version}" for version in range(30, 10, -1)))
    )
    candidates += [(str(Path(path).absolute()),) for name in others if (path := shutil.which(name))]
    for command in dict.fromkeys(candidates):
        if _finds_planted_faults(command):
            return Compiler(command, compiler_identity(command, ())[0])
    tried = ", ".join(shlex.join((Path(command[0]).name, *command[1:])) for command in candidates) or "no C compiler is here"
    raise MissingTool(
        f"no C compiler whose sanitizers find a planted fault ({tried})",
        where="sanitizers",
        remedy="install gcc with libasan and libubsan, or clang with compiler-rt",
    )


@lru_cache(maxsize=16)
def _finds_planted_faults(command: tuple[str, ...]) -> bool:
    try:
        with stored({"canary.c": verbatim("verify/canary.c")}) as tree:
            require_success(run([*command, *SANITIZER_FLAGS, SANITIZERS, "canary.c", "-o", "canary"], tree), "canary.c")
            return all(
                what in run_sanitized(tree / "canary", fault, seconds=60).stderr for fault, what in CANARY_FAULTS.items()
            )
    except (BuildError, OSError):
        return False


@lru_cache(maxsize=1)
def launcher() -> tuple[str, ...]:
    """Return the command that disables address randomisation, if allowed. Older runtimes find no room for their shadow
    memory in some layouts."""
    program = shutil.which("setarch")
    if program is None or run_program([program, "-R", "true"]).returncode != 0:
        return ()
    return (program, "-R")


def run_sanitized(program: Path, *arguments: str, seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a sanitized program to its end. Raises subprocess.TimeoutExpired after `seconds`."""
    return run_program([*launcher(), str(program), *arguments], timeout=seconds, environment=environment())


def environment() -> dict[str, str]:
    """Return the environment of a sanitized program."""
    found = {**os.environ, **OPTIONS, "LC_ALL": "C"}
    symbolizer = next((path for name in SYMBOLIZERS if (path := shutil.which(name))), None)
    return found if symbolizer is None else {**found, "ASAN_SYMBOLIZER_PATH": symbolizer}


@contextlib.contextmanager
def compiled(
    compiler: Compiler,
    sources: Mapping[str, bytes],
    plain: Mapping[str, bytes],
    flags: Sequence[str] = (),
    link: Sequence[str] = (),
) -> Iterator[Path]:
    """Compile a program of sanitized sources and of plain ones around them, in a folder that is gone when the context ends.

    Args:
        sources: relative path -> content of the sanitized sources, headers included.
        plain: likewise for the plain ones.
        flags: additional flags for the sanitized sources.
        link: additional flags for linking.

    Raises:
        BuildError: C that does not compile, or a full disk.
    """
    with stored({f"tree/{path}": content for path, content in {**plain, **sources}.items()}) as folder:
        scratch = folder.resolve()
        tree = scratch / "tree"
        search = [f"-I{name}" for name in ("include", "bench") if (tree / name).is_dir()]
        common = [*search, f"-fdebug-prefix-map={tree}={ROOT}", "-c"]
        every = {**dict.fromkeys(plain, PLAIN_FLAGS), **dict.fromkeys(sources, (*SANITIZER_FLAGS, SANITIZERS, *flags))}
        objects = {unit: f"{scratch}/{number}.o" for number, unit in enumerate(every) if unit.endswith(".c")}
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            commands = ([*compiler.command, *every[unit], *common, unit, "-o", name] for unit, name in objects.items())
            for unit, result in zip(objects, pool.map(lambda command: run(command, tree), commands), strict=True):
                require_success(result, unit)
        linking = [*compiler.command, SANITIZERS, *link, *objects.values(), "-o", "program", "-lm"]
        require_success(run(linking, scratch), "linking")
        yield scratch / "program"


def findings_of(report: str) -> tuple[str, ...]:
    """Return a line with file and line for each report of the sanitizers and of a harness on standard error."""
    text = report.replace(f"{ROOT}/", "")
    found = [f"{match['place']}: undefined behaviour: {match['what']}" for match in _UNDEFINED.finditer(text)]
    found += [_address(text[match.start() :], match["what"]) for match in _ADDRESS.finditer(text)]
    found += [match["what"] for match in _PROPERTY.finditer(text)]
    return tuple(dict.fromkeys(found))[:FINDINGS_MAX]


def _address(text: str, what: str) -> str:
    # The innermost frame of the sources; the runtime's own memcpy may be above it.
    frames = [frame for frame in _FRAME.finditer(text) if not frame["place"].startswith(("/", "."))]
    access = _ACCESS.search(text)
    how = f", {access['how'].lower()} of {access['size']} bytes" if access else ""
    where = f" in {frames[0]['function']}" if frames else ""
    return f"{frames[0]['place'] if frames else 'the program'}: wrong address: {what}{how}{where}"


Numbers = npt.NDArray[Any]

BATCH = 16_384
"""Steps or look-ups of one command: their answers fit the program's buffer."""

SECONDS_MAX = 120.0
"""Time after which a program counts as caught in a loop: ten times its run time on a slow machine."""


class Ended(CodegenError):
    """The program ended before it answered."""


class ServedEcu:
    """Commands of the program as functions. Each raises Ended if the program ends.

    Attributes:
        real: NumPy type of the build's numbers.
        findings: reports of the sanitizers, filled when the program ends.
    """

    def __init__(self, process: subprocess.Popen[bytes], real: type[np.float32] | type[np.float64], frame_bytes: int) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self.real, self._frame_bytes = real, frame_bytes
        self.findings: tuple[str, ...] = ()
        self._to: IO[bytes] = process.stdin
        self._from: IO[bytes] = process.stdout
        self._command = np.dtype([("rear_angle", real), ("yaw_rate_reference", real), ("status", np.uint32)])

    def selftest(self) -> bool:
        """Return whether the generated self-test passes."""
        return bool(struct.unpack("=I", self._ask(b"s", 4))[0])

    def start(self, rear_angle: float) -> None:
        """Initialise the controller at a rear angle in rad."""
        self._ask(b"i" + self.real(rear_angle).tobytes())

    def drive(self, drive: Samples) -> Numbers:
        """Run the controller. Return its commands, (samples,) with the fields rear_angle, yaw_rate_reference, status."""
        samples = np.empty(len(drive), dtype=np.dtype([("values", self.real, 6), ("inhibit", np.uint8)]))
        with np.errstate(invalid="ignore"):  # a signalling NaN, where the build is in double precision
            samples["values"], samples["inhibit"] = drive[:, :6], drive[:, 6] != 0.0
        return self._batches(b"d", samples, self._command)

    def look_up(self, places: Numbers, friction: float, acceleration: float) -> tuple[Numbers, Numbers]:
        """Look up yaw rate and rear angle (0 if the build has none) at places (n, 2) of speed and front angle."""
        more = np.full((len(places), 2), (friction, acceleration), dtype=self.real)
        rows = np.column_stack([places, more])
        found = self._batches(b"m", rows, np.dtype((self.real, 2)))
        return found[:, 0], found[:, 1]

    def run_loop(self, inputs: FloatArray, steps_per_sample: int, *, through_can: bool) -> FloatArray:
        """Run a closed loop with the plant of the build and return the recording (samples, 12), columns RECORD_COLUMNS."""
        samples = len(inputs) // steps_per_sample
        rows = np.ascontiguousarray(inputs[: samples * steps_per_sample], dtype=np.float64)
        assert rows.shape[1] == len(INPUT_COLUMNS)
        head = struct.pack("=III", through_can, steps_per_sample, samples)
        answer = self._ask(b"l" + head + rows.tobytes(), samples * len(RECORD_COLUMNS) * 8)
        return np.frombuffer(answer, dtype=np.float64).reshape(samples, -1)

    def task(self) -> Self:
        """Initialise the only task of the program. Its methods are those of `codegen.sil.software.Task` that a bench calls."""
        self._ask(b"t")
        return self

    def on_can_frame(self, identifier: int, data: bytes) -> None:
        """Receive a frame in the task."""
        self._ask(b"f" + struct.pack("=IB", identifier, len(data)) + data)

    def run(self) -> tuple[int, bytes]:
        """Run one sample of the task. Return id and data of the frame to send."""
        answer = self._ask(b"c", 4 + self._frame_bytes)
        return struct.unpack("=I", answer[:4])[0], answer[4:]

    def _batches(self, command: bytes, rows: Numbers, answer: np.dtype[Any]) -> Numbers:
        parts = []
        for start in range(0, len(rows), BATCH):
            part = rows[start : start + BATCH]
            data = self._ask(command + struct.pack("=I", len(part)) + part.tobytes(), len(part) * answer.itemsize)
            parts.append(np.frombuffer(data, dtype=answer))
        return np.concatenate(parts)

    def _ask(self, data: bytes, size: int = 0) -> bytes:
        """Send a command and return its answer. A command without an answer is sent with the next that has one."""
        try:
            self._to.write(data)
            if size > 0:
                self._to.flush()
        except OSError:
            raise Ended("the program ended") from None
        answer = self._from.read(size)
        if len(answer) != size:
            raise Ended("the program ended")
        return answer


@contextlib.contextmanager
def served(program: Path, subject: Subject) -> Iterator[ServedEcu]:
    """Run the sanitized code of a build behind a pipe. If the program ends early, the context ends and the findings contain
    it."""
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [*launcher(), str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, env=environment()
        )
        watch = threading.Timer(SECONDS_MAX, process.kill)
        watch.start()
        found = ServedEcu(process, numpy_type(subject.precision), subject.config.can.frame_bytes)
        ended = False
        try:
            yield found
        except Ended:
            ended = True
        finally:
            with contextlib.suppress(OSError):
                process.stdin.close()  # type: ignore[union-attr]
            process.wait()
            watch.cancel()
            process.stdout.close()  # type: ignore[union-attr]
        log.seek(0)
        found.findings = findings_of(log.read().decode(errors="replace"))
        if ended and not found.findings:
            code = process.returncode
            how = f"signal {-code}" if code < 0 else f"exit code {code}"
            found.findings = (f"the program ended early: {how}",)
