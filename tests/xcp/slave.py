"""The XCP slave alone, sanitized, as a process: packets in, answers out, and what it must never do looked for after each."""

from __future__ import annotations

import struct
import subprocess
import tempfile
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from codegen.emit.folder import Folder
from codegen.sil.toolchain import require_success, run
from codegen.verify.sanitizers.sanitized import FLAGS, SANITIZERS, environment, find_compiler, launcher
from hil_sim.native import section_flag

CALIBRATION, MEASUREMENTS = 0x1000_0000, 0x2000_0000
"""Addresses on the wire, of `slave.c`."""

PATIENCE = 120.0
"""s: thirty times what the longest run takes; only one that does not end waits so long."""

HARNESS = Path(__file__).with_name("slave.c")
BROKEN = (
    "it wrote beside the calibration",
    "it wrote the reference page",
    "it wrote a measurement",
    "the controller would run with what is not valid",
    "the controller does not read the reference page",
)

COMMANDS = {
    "CONNECT": 0xFF,
    "DISCONNECT": 0xFE,
    "GET_STATUS": 0xFD,
    "SYNCH": 0xFC,
    "GET_COMM_MODE_INFO": 0xFB,
    "GET_ID": 0xFA,
    "SET_MTA": 0xF6,
    "UPLOAD": 0xF5,
    "SHORT_UPLOAD": 0xF4,
    "BUILD_CHECKSUM": 0xF3,
    "DOWNLOAD": 0xF0,
    "SET_CAL_PAGE": 0xEB,
    "GET_CAL_PAGE": 0xEA,
    "GET_PAG_PROCESSOR_INFO": 0xE9,
    "GET_SEGMENT_INFO": 0xE8,
    "GET_PAGE_INFO": 0xE7,
    "COPY_CAL_PAGE": 0xE4,
    "SET_DAQ_PTR": 0xE2,
    "WRITE_DAQ": 0xE1,
    "SET_DAQ_LIST_MODE": 0xE0,
    "GET_DAQ_LIST_MODE": 0xDF,
    "START_STOP_DAQ_LIST": 0xDE,
    "START_STOP_SYNCH": 0xDD,
    "GET_DAQ_CLOCK": 0xDC,
    "GET_DAQ_PROCESSOR_INFO": 0xDA,
    "GET_DAQ_RESOLUTION_INFO": 0xD9,
    "GET_DAQ_EVENT_INFO": 0xD7,
    "FREE_DAQ": 0xD6,
    "ALLOC_DAQ": 0xD5,
    "ALLOC_ODT": 0xD4,
    "ALLOC_ODT_ENTRY": 0xD3,
}
"""ASAM MCD-1 XCP, table of commands."""

ERRORS = {
    0x00: "ERR_CMD_SYNCH",
    0x11: "ERR_DAQ_ACTIVE",
    0x20: "ERR_CMD_UNKNOWN",
    0x21: "ERR_CMD_SYNTAX",
    0x22: "ERR_OUT_OF_RANGE",
    0x23: "ERR_WRITE_PROTECTED",
    0x24: "ERR_ACCESS_DENIED",
    0x26: "ERR_PAGE_NOT_VALID",
    0x27: "ERR_MODE_NOT_VALID",
    0x28: "ERR_SEGMENT_NOT_VALID",
    0x29: "ERR_SEQUENCE",
    0x2A: "ERR_DAQ_CONFIG",
    0x30: "ERR_MEMORY_OVERFLOW",
}
"""ASAM MCD-1 XCP, table of error codes: those that it can answer."""


def packet(name: str, *arguments: int | bytes) -> bytes:
    """A command: its code, then bytes."""
    rest = b"".join(bytes((value,)) if isinstance(value, int) else value for value in arguments)
    return bytes((COMMANDS[name],)) + rest


def word(value: int) -> bytes:
    """Two bytes."""
    return struct.pack("<H", value)


def dword(value: int) -> bytes:
    """Four bytes."""
    return struct.pack("<I", value)


class Objects:
    """The sources of a build and the harness, compiled but for the slave, which a test may change."""

    def __init__(self, folder: Folder, at: Path) -> None:
        self._compiler, self._at, self._files = find_compiler().command, at, folder.files
        self._flags = (*FLAGS, SANITIZERS, "-fno-pie", section_flag("ars"), "-Iinclude", "-Ilinux")
        for path, content in folder.files.items():
            if path.startswith(("include/", "src/", "linux/")):
                (at / path).parent.mkdir(parents=True, exist_ok=True)
                (at / path).write_bytes(content)
        (at / "slave.c").write_bytes(HARNESS.read_bytes())
        units = sorted(path for path in folder.files if path.startswith("src/") and path.endswith(".c"))
        require_success(run([*self._compiler, *self._flags, "-c", *units], at), "src")
        # Not sanitized: it looks at memory around the calibration, of which the sanitizer holds some.
        plain = [flag for flag in self._flags if flag != SANITIZERS]
        require_success(run([*self._compiler, *plain, "-c", "slave.c"], at), "slave.c")
        self._objects = [Path(unit).with_suffix(".o").name for unit in (*units, "slave.c")]

    def program(self, name: str = "slave", *changes: tuple[str, str]) -> Path:
        """Linked with the slave, in which some text is replaced by other text."""
        text = self._files["linux/ars_xcp.c"].decode("ascii")
        for old, new in changes:
            assert text.count(old) == 1, f"{text.count(old)} times {old}"
            text = text.replace(old, new)
        (self._at / f"{name}_xcp.c").write_text(text, encoding="ascii")
        command = [*self._compiler, *self._flags, "-no-pie", f"{name}_xcp.c", *self._objects, "-o", name, "-lm"]
        require_success(run(command, self._at), f"{name}_xcp.c")
        return self._at / name


class Slave:
    """One that runs; a context manager.

    Attributes:
        places: offsets in the calibration by name, its `size`, and the size of the `measurements`.
    """

    def __init__(self, program: Path) -> None:
        # No pipe: undefined behaviour is told, and the program goes on.
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - closed by __exit__
        self._process = subprocess.Popen(
            [*launcher(), str(program)],
            env=environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
        )
        # One with a planted fault may write anywhere and then loop for ever: it is ended, which is told like any other end.
        self._watch = threading.Timer(PATIENCE, self._process.kill)
        self._watch.daemon = True
        self._watch.start()
        assert self._process.stdout is not None
        line = self._process.stdout.readline().decode("ascii")
        self.places = {name: int(number) for name, _, number in (word.partition("=") for word in line.split())}

    def command(self, data: bytes) -> bytes | None:
        """The answer to a packet, or None."""
        answered, answer = self._ask(b"C" + bytes((len(data),)) + data, 1)[0], self._packet()
        self._close()
        return answer if answered else None

    def event(self) -> list[bytes]:
        """The packets after a run of the task."""
        packets = [self._packet() for _ in range(self._ask(b"E", 1)[0])]
        self._close()
        return packets

    def positive(self, name: str, *arguments: int | bytes) -> bytes:
        """What a positive answer says behind its first byte."""
        answer = self.command(packet(name, *arguments))
        assert answer is not None
        assert answer[0] == 0xFF, f"{name}: {ERRORS[answer[1]]}"
        return answer[1:]

    def error(self, name: str, *arguments: int | bytes) -> str:
        """The name of the error that a command gives."""
        answer = self.command(packet(name, *arguments))
        assert answer is not None
        assert (answer[0], len(answer)) == (0xFE, 2), answer.hex()
        return ERRORS[answer[1]]

    def read(self, address: int, size: int) -> bytes:
        """By UPLOADs."""
        self.positive("SET_MTA", 0, 0, 0, dword(address))
        pieces = [self.positive("UPLOAD", min(7, size - done)) for done in range(0, size, 7)]
        return b"".join(pieces)

    def write(self, address: int, data: bytes) -> str | None:
        """By one DOWNLOAD; the error, or None."""
        self.positive("SET_MTA", 0, 0, 0, dword(address))
        answer = self.command(packet("DOWNLOAD", len(data), data))
        assert answer is not None
        return None if answer == b"\xff" else ERRORS[answer[1]]

    def _ask(self, record: bytes, size: int) -> bytes:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(record)
            self._process.stdin.flush()
        except BrokenPipeError:
            self._fail()
        return self._read(size)

    def _packet(self) -> bytes:
        told = self._read(9)
        assert told[0] <= 8, f"a packet of {told[0]} bytes"
        return told[1 : 1 + told[0]]

    def _close(self) -> None:
        broken = self._read(1)[0]
        assert not broken, "; ".join(text for bit, text in enumerate(BROKEN) if broken >> bit & 1)

    def _read(self, size: int) -> bytes:
        assert self._process.stdout is not None
        told = self._process.stdout.read(size)
        if len(told) < size:
            self._fail()
        return told

    def _fail(self) -> None:
        self._process.wait()
        raise AssertionError(f"the slave ended: {self._said()}")

    def _said(self) -> str:
        self._errors.seek(0)
        return self._errors.read(2000)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._process.communicate()
        self._watch.cancel()
        said = self._said()
        self._errors.close()
        if error is None:
            assert said == ""
