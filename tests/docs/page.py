"""Use of each block of a page: run, written to a file, checked, or skipped for a reason in a table here."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from codegen.configuration import load, preset_text
from tests.docs.blocks import ROOT, Block, Command, blocks, commands_of, matches

NOT_RUN: Mapping[str, str] = {  # command on the page: reason
    **dict.fromkeys(
        (
            "pip install .",
            'pip install -e ".[report,tools]"',
            'pip install ".[verify]"',
            'pip install ".[crosscheck]"',
            "pip wheel --no-deps -w dist .",
            "pip install dist/ars_codegen-*.whl",
            "pip install --require-hashes --no-deps -r requirements-run.lock",
            "pip install --no-deps --no-build-isolation -e .",
        ),
        "needs the checkout and a package index",
    ),
    "make test": "needs the checkout; the page is about the run that this is a part of",
    "codegen sweep --spec sweep.toml --scheduler tcp://scheduler:8786 -o campaign": "needs a cluster; tests/sweep starts one",
    **dict.fromkeys(
        (f"make evidence{options}" for options in ("", " PART=mutation", " QUICK=1", " PART=mutation QUICK=1")),
        "needs the checkout; the page is about the run that this is a part of",
    ),
    "python -m tests.export.demo_bus fmi-ls-bus-examples fmi-ls-bus/headers": "needs checkouts of other projects",
    "python -m tests.export.demo_silkit python3.12": "needs another Python and silkit-py",
    "codegen verify generated/4ws2": "takes minutes; the same with --quick is run",
    "sudo ip link add dev vcan0 type vcan && sudo ip link set up vcan0": "needs root; where blocks with vcan0 run, it is there",
    'openocd -f board/YOUR-BOARD.cfg -c "program fw/build/gcc/firmware.elf verify reset exit"': "needs a board and a probe",
    "codegen hil --build generated/4ws2 --bus pcan:PCAN_USBBUS1 --ecu external": "needs a CAN adapter and a board that answers",
}
"""Commands that are not run. A command that is on no page is an error."""

REPLACEMENTS: Mapping[str, str] = {  # command: another one that is run in its place
    "codegen explore --map 4ws2.npz": "test -e ars.toml || codegen init .",  # it runs until stopped; its button writes ars.toml
    "make sil": "codegen paper -o build",  # make's environment already exists; this is the command it then runs
}

EXAMPLES = ("codegen hil --build generated/4ws2-paper --bus socketcan:vcan0 --ecu native --log run.blf",)
"""Commands whose output differs from the page because they run in real time."""


VERDICTS = ("codegen check 4ws2.npz", "codegen check generated/4ws2.npz --drive")
"""Commands whose exit code is a verdict about a car: 1 where it has a warning. Pages show them for any map."""


def own_configuration(folder: Path) -> None:
    (folder / "ars.toml").write_text(preset_text("recommended"))


def import_examples(folder: Path) -> None:
    """Write the files of the page on imports: a map as MATLAB writes it, two tyres."""
    import numpy as np
    from scipy.io import savemat

    with np.load(ROOT / "generated/4ws2-paper.npz") as archive:
        table = np.where(archive["feasible"], archive["yaw_rate"], np.nan)
        savemat(folder / "b.mat", {"map": {"vx": archive["vx"], "delta_f": archive["delta_f"], "yaw_rate": table.T}})
    own_configuration(folder)
    for block in blocks("docs/import.md"):  # the page mentions a file before it shows it
        if block.mark is not None:
            write(block, folder)
    for name, data in (("front.tir", "mf61.tir"), ("rear.tir", "pac2002.tir")):
        shutil.copy(ROOT / "tests/importing/data" / data, folder / name)


SETUPS: Mapping[str, Callable[[Path], None]] = {
    "docs/flash.md": own_configuration,
    "docs/import.md": import_examples,
    "docs/inca-canape.md": own_configuration,
    "docs/longitudinal.md": own_configuration,
    "docs/references.md": own_configuration,
    "docs/theory-map.md": own_configuration,
}
"""Files of the reader that a page requires."""

GROUP, OWN_GROUP = "239.74.163.2", f"239.75.{os.getpid() >> 8 & 255}.{os.getpid() & 255}"
"""Bus of the examples, and this process's own: pages run in parallel."""

PROGRESS = re.compile(r"^\S[^\n]*: \d+ %(, [^\n]+)?\n", re.MULTILINE)  # a line of progress without a terminal


END = "\x1e"  # encloses the exit code after the output of each command


class Shell:
    """A bash in `folder`, with `codegen` and `python` of this interpreter; its current folder and jobs persist."""

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
        own = {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "NO_COLOR": "1"}
        self._bash = subprocess.Popen(
            ["bash", "--noprofile", "--norc"],
            cwd=self.folder,
            env=os.environ | own | {"COLUMNS": "200", "LC_ALL": "C.UTF-8"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def close(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._bash.pid, signal.SIGKILL)  # including its background processes
        self._bash.communicate()

    def run(self, command: str) -> tuple[int, str]:
        """Return exit code and output, with both streams in order."""
        assert self._bash.stdin is not None and self._bash.stdout is not None
        whole = subprocess.run(["bash", "-n", "-c", command], capture_output=True, text=True, check=False)
        assert whole.returncode == 0, f"not a whole command: {command}\n{whole.stderr}"
        self._bash.stdin.write(f"{{ {command}\n}} </dev/null 2>&1; printf '{END}%d{END}' $?\n".encode())
        self._bash.stdin.flush()
        output = b""
        while output.count(END.encode()) < 2:
            piece = os.read(self._bash.stdout.fileno(), 65536)
            assert piece, f"{command}: the shell ended"
            output += piece
        text, code, _ = output.decode(errors="replace").split(END)
        return int(code), text

    def where(self) -> Path:
        """Return the shell's current folder."""
        return Path(self.run("pwd")[1].strip())


def run_page(page_blocks: Sequence[Block], folder: Path, setup: Callable[[Path], None] | None = None) -> None:
    """Run the blocks in order, in one folder and one shell. Raises AssertionError with page and line of the first failure."""
    with contextlib.closing(Shell(folder)) as shell:
        if setup is not None:
            setup(shell.folder)
        for block in page_blocks:
            if block.mark is not None:
                write(block, shell.where())
            elif block.language in ("console", "sh"):
                for command in commands_of(block):
                    run_command(block, command, shell)
            elif block.language == "python":
                program = shell.where() / "block.py"
                program.write_text(block.text + "\n")
                code, printed = shell.run("python block.py")
                program.unlink()
                assert code == 0, f"{block.place}: exit code {code}\n{printed}"


def run_command(block: Block, command: Command, shell: Shell) -> None:
    """Run one command and compare its output with the page."""
    if command.plain in NOT_RUN:
        return
    text = REPLACEMENTS.get(command.plain, command.text)
    code, printed = shell.run(text.replace(GROUP, OWN_GROUP))
    printed = PROGRESS.sub("", printed).replace(OWN_GROUP, GROUP)
    fails = command.shown is not None and re.search(r"^error: ", command.shown, re.MULTILINE) is not None
    is_verdict = command.plain in VERDICTS and code == 1
    assert is_verdict or (code != 0) == fails, f"{block.place}: {text}: exit code {code}\n{printed}"
    if command.shown is not None and command.plain not in EXAMPLES:
        assert matches(command.shown, printed), f"{block.place}: {text} printed\n{printed}\nbut the page shows\n{command.shown}"


def write(block: Block, folder: Path) -> None:
    """Write a block to the file that its mark names, or add its keys to it."""
    assert block.mark is not None
    kind, name = block.mark
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "file":
        path.write_text(block.text + "\n")
    else:
        path.write_text(with_keys(path.read_text(), block.text))
    if path.name.endswith("ars.toml"):
        load(path)


def with_keys(text: str, changes: str) -> str:
    """Return an ars.toml with keys replaced, or added after their table's header, as a reader would edit it."""
    tomllib.loads(changes)
    lines, table = text.splitlines(), ""
    for line in changes.splitlines():
        headers = [one.split("#")[0].strip() for one in lines]
        if header := re.match(r"\[(?!\[)[^\]]+\]", line):
            table = header[0]
            lines += [] if table in headers else ["", table]
        elif key := re.match(r"(\w+)\s*=", line):
            first = headers.index(table) if table else -1
            last = next((k for k in range(first + 1, len(lines)) if lines[k].startswith("[")), len(lines))
            own = [k for k in range(first + 1, last) if re.match(rf"{key[1]}\s*=", lines[k])]
            lines[own[0] if own else first + 1 : own[0] + 1 if own else first + 1] = [line]
    return "\n".join(lines) + "\n"
