"""ECU as a separate process, or as a thread on a bus that exists only in this process; the native ECU among them.

Both can be started, killed as by a power failure, restarted and stopped. An ECU process prints `ready` once it can receive,
ends on SIGTERM, and prints a line of counters to standard error. The native ECU is the Linux program of a build, compiled once
and kept in the cache, from the files that the manifest names, in their current state. Nothing is written into the build.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from codegen import cache, configuration
from codegen.cache import cache_folder
from codegen.emit.folder import read_files
from codegen.emit.manifest import read_build
from codegen.errors import BuildError, CodegenError
from codegen.sil.software import Software
from codegen.sil.toolchain import compiler_command, compiler_identity, require_success, run
from hil_sim.bus import Bus, BusAddress, require_fd
from hil_sim.ecu_node import EcuNode

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-g", "-fno-pie", "-no-pie")
"""The same arithmetic as in `codegen.sil`: no fused multiply-add. For XCP: 32-bit addresses and debug information."""

FOLDERS = ("include/", "src/", "linux/")
CACHE_FORMAT = 3
"""Version of the cached program; increase it when its sources or the build change."""


def command(build: Path, interface: str, *, lock_step: bool = False, parent: int | None = None, xcp: bool = False) -> list[str]:
    """Return the command line of the ECU on a CAN interface, for `EcuProcess` or `os.execv`; compile it if necessary.

    Args:
        parent: id of the starting process; the ECU ends with it. None: it runs on its own.
        xcp: whether a master can measure and calibrate.

    Raises:
        BuildError: see `compile_ecu`; a build without XCP.
        CodegenError: frames of CAN FD on an interface of classical CAN.
    """
    if xcp:
        _require_xcp(build)
    config = configuration.parse(read_build(build)["configuration"], build)
    if config.can.is_fd or (xcp and config.xcp.is_fd):
        require_fd(interface)
    options = ["--lock-step"] if lock_step else []
    options += ["--xcp"] if xcp else []
    options += [] if parent is None else ["--parent", str(parent)]
    return [str(compile_ecu(build)), *options, interface]


def _require_xcp(build: Path) -> None:
    manifest = read_build(build)
    source = "linux/ars_xcp.c"
    if source not in read_files(build, manifest, FOLDERS):
        raise BuildError(f"the build has no {source}", where=build, remedy="build again with `codegen build`")


def section_flag(prefix: str) -> str:
    """Return the flag that puts the calibration into a section of its own, whose ends the linker defines."""
    return f'-D{prefix.upper()}_SECTION_CALIBRATION=__attribute__((section("{prefix}_calibration")))'


def compile_ecu(build: Path) -> Path:
    """Return the executable from the cache, compiling it if necessary.

    Raises:
        BuildError: not a build, or one without the program; not Linux, no compiler, C that does not compile, a full disk.
    """
    if sys.platform != "linux":
        raise BuildError("the native ECU needs Linux", where=build, remedy="use `ecu='cffi'`")
    manifest = read_build(build)
    prefix, sources = manifest["options"]["prefix"], read_files(build, manifest, FOLDERS)
    program = "linux/ars_ecu.c"
    if program not in sources:
        raise BuildError(f"the build has no {program}", where=build, remedy="build again with `codegen build`")
    compiler = compiler_command()
    flags = (*FLAGS, section_flag(prefix))
    name, folder = f"{prefix}_ecu_{_key(sources, compiler, flags)}", cache_folder()
    try:
        found = cache.find(folder, name) or _compile(sources, program, (*compiler, *flags), folder, name)
        return found.path
    except OSError as error:
        raise BuildError(
            f"the native ECU cannot be stored: {error.strerror or error}",
            where=folder,
            remedy="free space there, or set ARS_CACHE",
        ) from error


def counters(line: str) -> dict[str, int]:
    """Parse the last line of an ECU, `name=count` separated by spaces."""
    return {name: int(count) for name, _, count in (word.partition("=") for word in line.split())}


def _key(sources: dict[str, bytes], compiler: tuple[str, ...], flags: tuple[str, ...]) -> str:
    description = {
        "format": CACHE_FORMAT,
        "sources": {path: hashlib.sha256(content).hexdigest() for path, content in sources.items()},
        "flags": flags,
        "compiler": [compiler, compiler_identity(compiler, ())],
    }
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def _compile(sources: dict[str, bytes], program: str, compile_c: tuple[str, ...], folder: Path, name: str) -> cache.Entry:
    with cache.scratch(folder) as scratch:
        tree, made = scratch / "tree", scratch / "ecu"
        for path, content in sources.items():
            (tree / path).parent.mkdir(parents=True, exist_ok=True)
            (tree / path).write_bytes(content)
        units = sorted(path for path in sources if path.endswith(".c"))
        same_everywhere = f"-fdebug-prefix-map={tree}=."
        require_success(run([*compile_c, same_everywhere, "-Iinclude", *units, "-o", str(made), "-lm"], tree), program)
        return cache.keep(folder, name, made.read_bytes(), executable=True)


READY = "ready"
START_TIMEOUT = 30.0
"""Timeout in s for `ready`: Python has to start, and the C may have to be compiled."""
STOP_TIMEOUT = 5.0
"""Time from SIGTERM to SIGKILL, in s."""


class EcuProcess:
    """An ECU in another program; a context manager.

    Args:
        command: its command line. The program must end by itself if the bench is gone.
    """

    def __init__(self, command: Sequence[str | Path]) -> None:
        self._command = [str(word) for word in command]
        self._process: subprocess.Popen[str] | None = None
        self._errors: IO[str] = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed by __exit__

    def start(self) -> None:
        """Start the program and return at once."""
        self.kill()
        try:
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self._errors, text=True
            )
        except OSError as error:
            raise CodegenError(f"the ECU cannot be started: {error.strerror}", where=self._command[0]) from error

    def wait_until_ready(self) -> None:
        """Wait until the process prints `ready`.

        Raises:
            CodegenError: the process ended before that, or a timeout.
        """
        process = self._process
        assert process is not None
        assert process.stdout is not None
        lines: list[str] = []
        output = process.stdout
        reader = threading.Thread(target=lambda: lines.append(output.readline()), daemon=True)
        reader.start()
        reader.join(START_TIMEOUT)
        if lines and lines[0].strip() == READY:
            return
        ended = bool(lines)  # end of file: the message is on standard error
        self.kill()
        text = self.last_line()
        what = (text.removeprefix("error: ") or "it ended without a message") if ended else f"silent for {START_TIMEOUT:g} s"
        raise CodegenError(f"the ECU did not start: {what}")

    def kill(self) -> None:
        """Kill the process, as a power failure would."""
        if self._process is not None:
            self._process.kill()
            self._reap()

    def stop(self) -> str:
        """Stop the process and return its last output (its counters)."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(STOP_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
            self._reap()
        return self.last_line()

    @property
    def alive(self) -> bool:
        """Whether the program runs."""
        return self._process is not None and self._process.poll() is None

    def last_line(self) -> str:
        """Return the last line on standard error."""
        self._errors.flush()
        descriptor = self._errors.fileno()
        text = os.pread(descriptor, os.fstat(descriptor).st_size, 0).decode("utf-8", "replace")
        return text.strip().rpartition("\n")[2]

    def _reap(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.wait()
            if process.stdout is not None:
                process.stdout.close()

    def __enter__(self) -> Self:
        self.start()
        try:
            self.wait_until_ready()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.kill()
        self._errors.close()


def cffi_command(build: Path, address: BusAddress, *, lock_step: bool) -> list[str]:
    """Return the command line of a cffi ECU in a process of its own."""
    clock = "--lock-step" if lock_step else "--real-time"
    place = ["--build", str(build), "--bus", str(address), "--ecu", "cffi", clock]
    return [sys.executable, "-m", "codegen", "ecu", *place, "--parent", str(os.getpid())]


class EcuThread:
    """A cffi ECU in this process; a context manager. For `virtual`, a bus that no other process sees."""

    def __init__(self, software: Software, address: BusAddress, *, lock_step: bool) -> None:
        self._software, self._address, self._lock_step = software, address, lock_step
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._node: EcuNode | None = None

    def start(self) -> None:
        """Start the thread. From then on it receives frames."""
        self.kill()
        bus = Bus(self._address, self._software.config.can)
        stop = threading.Event()
        node = EcuNode(self._software, bus)
        run = _served(node, bus, self._lock_step, stop)
        self._stop, self._node = stop, node
        self._thread = threading.Thread(target=run, name="ECU", daemon=True)
        self._thread.start()

    def kill(self) -> None:
        """Stop the thread."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def stop(self) -> str:
        """Stop the ECU and return its counters."""
        self.kill()
        return "" if self._node is None else counters_line(self._node)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.kill()


def _served(node: EcuNode, bus: Bus, lock_step: bool, stop: threading.Event) -> Callable[[], None]:
    def run() -> None:
        with bus:
            node.run(lock_step, stop.is_set)

    return run


def counters_line(node: EcuNode) -> str:
    """Return the counters of an ECU as the native ECU prints them: `name=count`, separated by spaces."""
    task = node.task.counters()
    counts = {
        "cycles": node.counters.cycles,
        "late": node.counters.late,
        "late_samples": task["late_cycles"],
        "early_samples": task["early_cycles"],
        "lost_samples": task["lost_samples"],
        "discarded": node.counters.discarded,
        "send_errors": node.counters.send_errors,
    }
    return " ".join(f"{name}={count}" for name, count in counts.items())
