"""Use of each block of a page: run, written to a file, checked, or left out for a reason in a table here."""

import os
import re
import shutil
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from codegen.config import load, preset_text
from tests.docs.blocks import ROOT, Block, Command, blocks, commands, matches
from tests.docs.shell import Shell

NOT_RUN: Mapping[str, str] = {  # command on the page: reason
    'pip install "ars-codegen[verify]"': "needs a package index",
    'pip install "ars-codegen[crosscheck]"': "needs a package index, as above",
    "codegen sil --suite tracking --build generated/4ws2": "takes minutes; tests/cli has made results",
    "codegen sweep --spec sweep.toml --scheduler tcp://scheduler:8786 -o campaign": "needs a cluster; tests/sweep starts one",
    "codegen verify generated/4ws2": "takes minutes; the same with --quick is run",
    "sudo ip link add dev vcan0 type vcan && sudo ip link set up vcan0": "needs root; where blocks with vcan0 run, it is there",
    'openocd -f board/YOUR-BOARD.cfg -c "program fw/build/gcc/firmware.elf verify reset exit"': "needs a board and a probe",
    "codegen hil --build generated/4ws2 --bus pcan:PCAN_USBBUS1 --ecu external": "needs a CAN adapter and a board that answers",
}
"""Commands that are not run. One that no page has any more is an error."""

INSTEAD: Mapping[str, tuple[str, str]] = {  # command: another one that is run in its place, and the reason
    "codegen explore --map 4ws2.npz": (
        "test -e ars.toml || codegen init .",
        "it serves until it is interrupted, and its button writes ars.toml",
    ),
    "make sil": ("codegen paper -o build", "the environment that make sets up is there already; this is what it then runs"),
}

EXAMPLES: Mapping[str, str] = {  # command: reason not to compare its output with the page
    "codegen hil --build generated/4ws2 --bus socketcan:vcan0 --ecu native --log run.blf": "in real time: its timing differs",
}

NOT_READ: Mapping[tuple[str, str], str] = {  # page and first line of a block without any use: reason
    ("docs/taking-over.md", "list(APPEND ZEPHYR_EXTRA_MODULES ${CMAKE_CURRENT_SOURCE_DIR}/4ws2)"): "needs a Zephyr SDK",
}


def import_examples(folder: Path) -> None:
    """Write the files of the page on imports: a map as MATLAB writes it, two tyres."""
    import numpy as np
    from scipy.io import savemat

    with np.load(ROOT / "generated/4ws2.npz") as archive:
        table = np.where(archive["feasible"], archive["yaw_rate"], np.nan)
        savemat(folder / "b.mat", {"map": {"vx": archive["vx"], "delta_f": archive["delta_f"], "yaw_rate": table.T}})
    own_configuration(folder)
    for block in blocks("docs/import.md"):  # the page speaks of a file before it shows it
        if block.mark is not None:
            write(block, folder)
    for name, data in (("front.tir", "mf61.tir"), ("rear.tir", "pac2002.tir")):
        shutil.copy(ROOT / "tests/importing/data" / data, folder / name)


def own_configuration(folder: Path) -> None:
    (folder / "ars.toml").write_text(preset_text("recommended"))


SETUPS: Mapping[str, Callable[[Path], None]] = {
    "docs/flash.md": own_configuration,
    "docs/import.md": import_examples,
    "docs/theory-map.md": own_configuration,
}
"""Files of the reader's own, with which a page begins."""

GROUP, OWN_GROUP = "239.74.163.2", f"239.75.{os.getpid() >> 8 & 255}.{os.getpid() & 255}"
"""The bus of the examples, and this process's own: pages are run side by side."""

PROGRAMS: Mapping[str, tuple[str, ...]] = {
    "docs/tutorial.md": ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm", "make"),
    "docs/firmware.md": ("arm-none-eabi-gcc", "qemu-system-arm", "make"),
    "docs/taking-over.md": ("make",),
}
"""Programs that a page needs beside a C compiler."""

PROGRESS = re.compile(r"^\S[^\n]*: \d+ %\n", re.MULTILINE)  # a line of progress without a terminal
NAME_IN_C = re.compile(r"\b(?:ars|ARS)_\w+")


def run_page(page_blocks: Sequence[Block], folder: Path, setup: Callable[[Path], None] | None = None) -> None:
    """Run the blocks in order, in one folder and one shell. AssertionError with page and line of the first that fails."""
    with Shell(folder) as shell:
        if setup is not None:
            setup(shell.folder)
        for block in page_blocks:
            if block.mark is not None:
                write(block, shell.where())
            elif block.language in ("console", "sh"):
                for command in commands(block):
                    run_command(block, command, shell)
            elif block.language == "python":
                program = shell.where() / "block.py"
                program.write_text(block.text + "\n")
                code, printed = shell.run("python block.py")
                program.unlink()
                assert code == 0, f"{block.place}: exit code {code}\n{printed}"


def run_command(block: Block, command: Command, shell: Shell) -> None:
    """Run one command, and compare its output with the page."""
    if command.plain in NOT_RUN:
        return
    text = INSTEAD[command.plain][0] if command.plain in INSTEAD else command.text
    code, printed = shell.run(text.replace(GROUP, OWN_GROUP))
    printed = PROGRESS.sub("", printed).replace(OWN_GROUP, GROUP)
    fails = command.shown is not None and re.search(r"^error: ", command.shown, re.MULTILINE) is not None
    assert (code != 0) == fails, f"{block.place}: {text}: exit code {code}\n{printed}"
    if command.shown is not None and command.plain not in EXAMPLES:
        assert matches(command.shown, printed), f"{block.place}: {text} prints\n{printed}\nand the page shows\n{command.shown}"


def write(block: Block, folder: Path) -> None:
    """Write a block to the file that its mark names, or put its keys into it."""
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
    """Put keys into an ars.toml in place of its own, or behind their table's header, as a reader edits it."""
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


def unread(block: Block) -> str | None:
    """Return a message for a block that is neither run, nor written, nor checked, nor in a table; else None."""
    is_used = block.language in ("console", "sh", "python", "text", "c") or block.mark is not None
    if is_used or (block.page, block.text.splitlines()[0]) in NOT_READ:
        return None
    return f"{block.place}: nothing is done with a block of {block.language!r}; mark it with <!-- file: NAME --> or the like"


def names_in_headers() -> set[str]:
    """Return the names in the headers of the committed builds."""
    headers = (ROOT / "generated").glob("*/include/*.h")
    return {name for header in headers for name in NAME_IN_C.findall(header.read_text(encoding="utf-8"))}
