"""A shell that runs the commands of one page, in a folder that looks like a checkout after `make`."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.docs.blocks import ROOT

END = "\x1e"
"""Stands before the exit code behind the output of each command."""


class Shell:
    """bash in `folder`, with `codegen` and `python` of this interpreter; the folder it stands in and its jobs go on."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "page"
        self.folder.mkdir()
        programs = folder / "bin"
        programs.mkdir()
        for name, call in (("codegen", "-m codegen"), ("python", ""), ("python3", "")):
            program = programs / name
            program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {call} "$@"\n')
            program.chmod(0o755)
        shutil.copytree(ROOT / "generated", self.folder / "generated")
        environment = os.environ | {
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "NO_COLOR": "1",
            "COLUMNS": "200",
            "LC_ALL": "C.UTF-8",
        }
        self._bash = subprocess.Popen(
            ["bash", "--noprofile", "--norc"],
            cwd=self.folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        assert self._bash.stdin is not None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._bash.pid, signal.SIGKILL)  # and what it left in the background
        self._bash.wait()
        self._bash.stdin.close()

    def run(self, command: str) -> tuple[int, str]:
        """Exit code and output, both streams in the order in which they came."""
        assert self._bash.stdin is not None
        whole = subprocess.run(["bash", "-n", "-c", command], capture_output=True, text=True, check=False)
        assert whole.returncode == 0, f"not a whole command: {command}\n{whole.stderr}"
        self._bash.stdin.write(f"{{ {command}\n}} </dev/null 2>&1; printf '{END}%d{END}' $?\n".encode())
        self._bash.stdin.flush()
        assert self._bash.stdout is not None
        output = b""
        while output.count(END.encode()) < 2:
            piece = os.read(self._bash.stdout.fileno(), 65536)
            assert piece, f"{command}: the shell ended"
            output += piece
        text, code, _ = output.decode(errors="replace").split(END)
        return int(code), text

    def where(self) -> Path:
        """The folder in which the shell stands."""
        return Path(self.run("pwd")[1].strip())
