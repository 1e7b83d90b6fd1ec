"""The XCP slave as a separate sanitized process: packets in, responses out, invariants checked after each packet."""

import contextlib
import shutil
import struct
import subprocess
import tempfile
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from codegen.configuration.xcp import MANDATORY_COMMANDS, NATIVE_COMMANDS
from codegen.sil.toolchain import require_success, run
from codegen.verify.sanitized import SANITIZER_FLAGS, SANITIZERS, environment, find_compiler, launcher
from hil_sim.ecu_process import section_flag

CALIBRATION, MEASUREMENTS = 0x1000_0000, 0x2000_0000
"""XCP addresses that `slave.c` sets up."""

TIMEOUT_S = 120.0
"""Timeout in s: thirty times the longest run, so only an endless run reaches it."""

BUILD = Path(__file__).resolve().parents[2] / "generated/4ws2-paper"
HARNESS = Path(__file__).with_name("slave.c")
INVARIANT_FAILURES = (
    "it wrote next to the calibration",
    "it wrote the reference page",
    "it wrote a measurement",
    "the controller would run with invalid parameters",
    "the controller does not read the reference page",
)


COMMANDS = MANDATORY_COMMANDS | NATIVE_COMMANDS
"""Every command of the slave, and so of the A2L: `test_commands.py` sends each, and every other code."""

_ERROR_CODES = """
    CMD_SYNCH=00 DAQ_ACTIVE=11 CMD_UNKNOWN=20 CMD_SYNTAX=21 OUT_OF_RANGE=22 WRITE_PROTECTED=23 ACCESS_DENIED=24
    PAGE_NOT_VALID=26 MODE_NOT_VALID=27 SEGMENT_NOT_VALID=28 SEQUENCE=29 DAQ_CONFIG=2A MEMORY_OVERFLOW=30
"""
ERRORS = {int(code, 16): name for name, _, code in (entry.partition("=") for entry in _ERROR_CODES.split())}
"""ASAM MCD-1 XCP, table of error codes, without ERR_: those that the slave can return."""


def packet(name: str, *arguments: int | bytes) -> bytes:
    """Return a command: its code, then bytes."""
    rest = b"".join(bytes((value,)) if isinstance(value, int) else value for value in arguments)
    return bytes((COMMANDS[name],)) + rest


def word(value: int) -> bytes:
    return struct.pack("<H", value)


def dword(value: int) -> bytes:
    return struct.pack("<I", value)


def compile_slave(at: Path, build: Path = BUILD) -> Path:
    """Compile a build and the harness in a folder; return the program."""
    compiler = find_compiler().command
    flags = (*SANITIZER_FLAGS, SANITIZERS, "-fno-pie", section_flag("ars"), "-Iinclude", "-Ilinux")
    for folder in ("include", "src", "linux"):
        shutil.copytree(build / folder, at / folder)
    (at / "slave.c").write_bytes(HARNESS.read_bytes())
    # Not sanitized: it reads memory around the calibration, part of which belongs to the sanitizer.
    plain = [flag for flag in flags if flag != SANITIZERS]
    require_success(run([*compiler, *plain, "-c", "slave.c"], at), "slave.c")
    sources = [*sorted(str(path.relative_to(at)) for path in at.glob("src/*.c")), "linux/ars_xcp.c"]
    require_success(run([*compiler, *flags, "-no-pie", *sources, "slave.o", "-o", "slave", "-lm"], at), "src")
    return at / "slave"


class Slave:
    """A running slave; a context manager.

    Attributes:
        places: offsets in the calibration by name, its `size`, that of the `measurements`, and that of a `packet`.
    """

    def __init__(self, program: Path) -> None:
        # No pipe: the sanitizer reports undefined behaviour and the program continues.
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - closed by __exit__
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self._errors}
        self._process = subprocess.Popen([*launcher(), str(program)], env=environment(), **pipes)
        # A slave with a planted fault may loop forever: it is killed, which is reported like any other end.
        self._watch = threading.Timer(TIMEOUT_S, self._process.kill)
        self._watch.daemon = True
        self._watch.start()
        line = self._process.stdout.readline().decode("ascii")
        self.places = {name: int(number) for name, _, number in (word.partition("=") for word in line.split())}

    def command(self, data: bytes) -> bytes | None:
        """Send a packet and return the response, or None."""
        answered, answer = self._request(b"C" + bytes((len(data),)) + data, 1)[0], self._packet()
        self._check_invariants()
        return answer if answered else None

    def event(self) -> list[bytes]:
        """Run the task and return the measurement packets."""
        packets = [self._packet() for _ in range(self._request(b"E", 1)[0])]
        self._check_invariants()
        return packets

    def answer(self, name: str, *arguments: int | bytes) -> bytes | str:
        """Send a command and return the data of its positive response, or the name of the error."""
        answer = self.command(packet(name, *arguments))
        assert answer is not None
        if answer[0] == 0xFF:
            return answer[1:]
        assert (answer[0], len(answer)) == (0xFE, 2), answer.hex()
        return ERRORS[answer[1]]

    def positive(self, name: str, *arguments: int | bytes) -> bytes:
        """Send a command that must succeed and return the data of its response."""
        answer = self.answer(name, *arguments)
        assert isinstance(answer, bytes), f"{name}: {answer}"
        return answer

    def read(self, address: int, size: int) -> bytes:
        """Read memory by UPLOADs."""
        self.positive("SET_MTA", 0, 0, 0, dword(address))
        pieces = [self.positive("UPLOAD", min(7, size - done)) for done in range(0, size, 7)]
        return b"".join(pieces)

    def write(self, address: int, data: bytes) -> bytes | str:
        """Write memory with one DOWNLOAD and return its response."""
        self.positive("SET_MTA", 0, 0, 0, dword(address))
        return self.answer("DOWNLOAD", len(data), data)

    def _request(self, record: bytes, size: int) -> bytes:
        with contextlib.suppress(BrokenPipeError):  # then there is no response
            self._process.stdin.write(record)
            self._process.stdin.flush()
        return self._read(size)

    def _packet(self) -> bytes:
        record = self._read(1 + self.places["packet"])
        assert record[0] < len(record), f"a packet of {record[0]} bytes"
        return record[1 : 1 + record[0]]

    def _check_invariants(self) -> None:
        broken = self._read(1)[0]
        assert not broken, "; ".join(text for bit, text in enumerate(INVARIANT_FAILURES) if broken >> bit & 1)

    def _read(self, size: int) -> bytes:
        data = self._process.stdout.read(size)
        if len(data) < size:
            self._process.wait()
            raise AssertionError(f"the slave ended: {self._error_output()}")
        return data

    def _error_output(self) -> str:
        self._errors.seek(0)
        return self._errors.read(2000)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._process.communicate()
        self._watch.cancel()
        output = self._error_output()
        self._errors.close()
        if error is None:
            assert output == ""
