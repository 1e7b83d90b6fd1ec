"""The firmware project of a build, its image, and a run in QEMU that is compared with the software in the loop."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal

from codegen import __version__
from codegen.emit.can_view import CanView, task_name
from codegen.emit.folder import MANIFEST, Folder, owned_paths, read_files, read_manifest, refuse_folder
from codegen.emit.manifest import read_build
from codegen.emit.render import render, verbatim
from codegen.emit.text import comment_text
from codegen.errors import BuildError, CodegenError, one_line
from codegen.files import resolved
from codegen.programs import run_program
from codegen.requirements import pip_install
from codegen.sil.software import Software, load
from codegen.sil.toolchain import require_success
from hil_sim.codec import Frame, frame_of
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from hil_sim.scenarios import Scenario


def record(software: Software, scenario: Scenario) -> tuple[list[tuple[Frame, ...]], list[Frame]]:
    """Run the compiled task and the plant in closed loop, as `codegen sil --can` does, without faults on the bus.

    Returns:
        For each cycle the frames that came before its task ran, and the frame that its task sent.
    """
    node, task = PlantNode(software.config, scenario, precision=software.precision), software.task()
    received, sent = [], []
    for cycle in range(node.cycles):
        frames = tuple(node.outgoing(cycle))
        for frame in frames:
            task.on_can_frame(frame.id, frame.data)
        answer = frame_of(software.config.can, *task.run())
        node.receive(answer)
        node.finish(cycle)
        received.append(frames)
        sent.append(answer)
    return received, sent


SCENARIO = "step-steer"
WHAT = "firmware"
"""Manifest entry that distinguishes a firmware project from a build."""

CLOCK_HZ = 25_000_000
"""Clock of QEMU's mps2-an386 (Arm DAI 0386: SYSCLK)."""

SYSTICK_RELOAD_MAX = 2**24 - 1
MADE_BY_MAKE = "build"
PROGRAM = ("main", "startup", "board_mps2_an386", "report", "memory", "trace")
VERBATIM = ("startup.c", "board_mps2_an386.c", "report.c", "memory.c", "board.h", "startup.h", "report.h")
"""Sources that are the same in every project."""
RENDERED = (
    *("src/main.c", "src/trace.c", "src/trace.h", "src/firmware_config.h"),
    *("mps2_an386.ld", "Makefile", "README.md"),
)


@dataclass(frozen=True)
class Project:
    """A firmware project and the expected frames of its image.

    Attributes:
        folder: files of the project.
        sent: expected frames as text, one for each cycle.
        edited: files of the build that were changed after generation.
    """

    folder: Folder
    sent: tuple[str, ...]
    edited: tuple[str, ...]


def project(build: Path) -> Project:
    """Return the project of a build without writing files.

    Raises:
        BuildError: not a build, one of double precision, or C that does not compile.
    """
    manifest = read_build(build)
    if manifest["options"]["precision"] != "single":
        what = "it computes in double precision, and the FPU of a Cortex-M4F is single"
        raise BuildError(what, where=build, remedy="build with `precision='single'`")
    software = load(build)
    files = {
        f"controller/{path}": content
        for path, content in read_files(build, manifest, ("include/", "src/")).items()
        if not path.endswith(("_dynamics.c", "_dynamics.h"))  # the task does not need them, and they need a C library
    }
    scenario = find(SCENARIO, software.config)
    received, answers = record(software, scenario)
    can = CanView(software.config, software.precision)
    digits = 8 if can.is_extended else 3
    # As the firmware prints a frame: 201#0011223344556677.
    sent = tuple(f"{frame.id:0{digits}X}#{frame.data.hex().upper()}" for frame in answers)
    digest = hashlib.sha256((build / MANIFEST).read_bytes()).hexdigest()
    period = software.config.controller.sampling_time_s
    view = {
        "build_name": comment_text(manifest["name"]),
        "build_id": f"0x{manifest['build_id']}",
        "manifest_sha256": digest,
        "edited": [comment_text(path) for path in software.edited],
        "version": __version__,
        "prefix": software.prefix,
        "kind": manifest["options"]["kind"],
        "period_text": f"{period * 1e3:g} ms",
        "reload": _systick_reload(period),
        "frames_text": can.frames_text,
        "frame_bytes": can.frame_bytes,
        "identifier_digits": digits,
        "task_function": task_name(period),
        "sources": [*(f"src/{name}.c" for name in PROGRAM), *sorted(path for path in files if path.endswith(".c"))],
        "drive_text": comment_text(scenario.title),
        "cycles": len(sent),
        "frames": [(cycle, frame) for cycle, frames in enumerate(received) for frame in frames],
    }
    files |= {name: render(f"firmware/{name.removeprefix('src/')}.j2", {"firmware": view}) for name in RENDERED}
    files |= {f"src/{name}": verbatim(f"firmware/{name}") for name in VERBATIM}
    files["expected.txt"] = "".join(f"{line}\n" for line in sent).encode("ascii")
    facts = {
        "schema_version": 1,
        "version": __version__,
        "what": WHAT,
        "name": manifest["name"],
        "options": manifest["options"],
        "build": {"id": manifest["build_id"], "manifest_sha256": digest, "edited": list(software.edited)},
        "drive": {"scenario": scenario.name, "cycles": len(sent), "frames": sum(map(len, received))},
    }
    return Project(Folder(files, facts), sent, software.edited)


def _systick_reload(period: float) -> int:
    """Return the timer clocks of a period in s, less one. Raises BuildError: the timer is too short."""
    ticks = round(period * CLOCK_HZ)
    if ticks - 1 > SYSTICK_RELOAD_MAX:
        limit = (SYSTICK_RELOAD_MAX + 1) / CLOCK_HZ
        raise BuildError(
            f"a sampling time of {period:g} s is too long for a timer of 24 bits at 25 MHz",
            where="controller.sampling_time_s",
            remedy=f"take at most {limit:.2g} s",
        )
    return ticks - 1


def refuse_target(target: Path) -> None:
    """Check that writing a project to a folder destroys nothing. Raises BuildError: see `refuse_folder`, or it was built."""
    place = resolved(target, BuildError)
    if owned_paths(place) and read_manifest(place).get("what") == WHAT and (place / MADE_BY_MAKE).exists():
        remedy = f"run `make -C {target} clean`, then this command again; or choose another folder"
        raise BuildError(f"it holds {MADE_BY_MAKE}/, which its Makefile made", where=target, remedy=remedy)
    refuse_folder(target, WHAT, "a firmware project")


Toolchain = Literal["gcc", "zig"]

GCC, QEMU = "arm-none-eabi-gcc", "qemu-system-arm"
RUN_LIMIT = 300.0
"""Time limit of a run in s; a run takes about 1 s."""

VARIABLES_OF_MAKE = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "MAKEOVERRIDES", "BUILD", "TOOLCHAIN", "QEMU", "ZIG")
"""Variables removed from the environment of make, because a calling make or the user could change the image with them."""

LAST_WORDS = ("end:", "fault:", "self-test failed", "main returned")

_END = re.compile(r"end: cycles=(\d+) ticks=(\d+) lost_samples=(\d+) fpu=([01]) stack=(\d+)")


@dataclass(frozen=True)
class Sizes:
    """Bytes of memory: flash holds code, constants and the start values of data; RAM holds data and both stacks."""

    flash: int
    ram: int


@dataclass(frozen=True)
class ImageRun:
    """Result of running an image.

    Attributes:
        toolchain: toolchain that built the image.
        compared: number of frames compared with the software in the loop.
        different: number of missing, extra or different frames.
        first_difference: description of the first one; "" if there is none.
        faults: exceptions that ended the program: 0 or 1.
        message: last line of the program's output.
        exit_code: exit code of the program; 0 for success.
        cycles, ticks: runs of the task, and timer ticks that started them.
        lost_samples: cycles without a good sample.
        fpu: whether the FPU was used.
        stack: bytes of stack used.
        sizes: memory sizes of the image.
    """

    toolchain: str
    compared: int
    different: int
    first_difference: str
    faults: int
    message: str
    exit_code: int
    cycles: int
    ticks: int
    lost_samples: int
    fpu: bool
    stack: int
    sizes: Sizes

    @property
    def passed(self) -> bool:
        """Whether all frames equal those of the software in the loop, on time and without a fault."""
        same = self.different == 0 and self.ticks == self.cycles == self.compared
        return same and self.fpu and self.faults == 0 and self.exit_code == 0

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {**asdict(self), "passed": self.passed}


def choose_toolchain(wanted: str | None) -> Toolchain:
    """Return the toolchain: the requested one, else GCC if installed, else zig's clang.

    Raises:
        CodegenError: it is not installed.
    """
    has_zig = importlib.util.find_spec("ziglang") is not None
    if wanted != "zig" and shutil.which(GCC):
        return "gcc"
    if wanted != "gcc" and has_zig:
        return "zig"
    if wanted == "zig":
        raise CodegenError("it is not installed", where="ziglang", remedy=pip_install("ziglang"))
    remedy = "install it (Debian, Ubuntu: apt install gcc-arm-none-eabi)"
    raise CodegenError(
        "it is not installed", where=GCC, remedy=f"{remedy}, or take `toolchain='zig'` ({pip_install('ziglang')})"
    )


def require_tools() -> None:
    """Raise CodegenError if make or QEMU is missing."""
    for program, package in (("make", "make"), (QEMU, "qemu-system-arm")):
        if shutil.which(program) is None:
            remedy = f"install it (Debian, Ubuntu: apt install {package}), or leave out `run=True`"
            raise CodegenError("it is not installed", where=program, remedy=remedy)


def run_image(files: Mapping[str, bytes], expected: Sequence[str], toolchain: Toolchain) -> ImageRun:
    """Build a project in a temporary folder, run the image, and compare its frames.

    Raises:
        CodegenError: make or QEMU is missing, or QEMU fails.
        BuildError: the files do not compile, or do not fit.
    """
    require_tools()
    try:
        with tempfile.TemporaryDirectory(prefix="ars-firmware-") as scratch:
            folder = Path(scratch, "firmware")
            for path, content in files.items():
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                (folder / path).write_bytes(content)
            require_success(_make(folder, toolchain, "--silent", "all"), "the firmware")
            sizes = image_sizes((folder / "build" / "firmware.elf").read_bytes())
            ended = _run(folder, toolchain)
    except OSError as error:
        remedy = "free space for temporary files"
        raise BuildError(f"the image cannot be made: {error.strerror or error}", remedy=remedy) from error
    return _judged(ended, expected, toolchain, sizes)


def image_sizes(image: bytes) -> Sizes:
    """Return the memory sizes of an image, a 32-bit little-endian ELF (specification 1.2, figure 1-8: section headers)."""
    offset, entry_size, count = (struct.unpack_from(form, image, at)[0] for form, at in (("<I", 32), ("<H", 46), ("<H", 48)))
    write, allocated, no_bits = 1, 2, 8
    flash = ram = 0
    for at in range(offset, offset + entry_size * count, entry_size):
        _, kind, flags, _, _, size = struct.unpack_from("<6I", image, at)
        if flags & allocated:
            flash += size if kind != no_bits else 0
            ram += size if flags & write or kind == no_bits else 0
    return Sizes(flash, ram)


def _make(folder: Path, toolchain: Toolchain, *arguments: str) -> subprocess.CompletedProcess[str]:
    zig = [f"ZIG={shlex.quote(sys.executable)} -m ziglang"] if toolchain == "zig" else []
    # No cache: the folder is new each time, so zig's own cache would only grow.
    cache = str(folder.parent / "cache")
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES_OF_MAKE}
    environment |= {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    command = ["make", "--no-print-directory", "BUILD=build", f"TOOLCHAIN={toolchain}", *zig, *arguments]
    return run_program(command, folder, environment=environment)


def _run(folder: Path, toolchain: Toolchain) -> subprocess.CompletedProcess[str]:
    """Run the image in QEMU as `make run` does, without make, which would hide the exit code."""
    told = _make(folder, toolchain, "--dry-run", "run")
    require_success(told, "make run")
    try:
        return run_program(shlex.split(told.stdout), folder, timeout=RUN_LIMIT)
    except subprocess.TimeoutExpired:
        remedy = "examine it with `make run` and a debugger"
        raise CodegenError(f"the image did not end within {RUN_LIMIT:g} s", where=QEMU, remedy=remedy) from None


def _judged(ended: subprocess.CompletedProcess[str], expected: Sequence[str], toolchain: str, sizes: Sizes) -> ImageRun:
    lines = ended.stdout.splitlines()
    sent = [line for line in lines if "#" in line]
    pairs = list(enumerate(zip_longest(sent, expected, fillvalue="nothing")))
    different = [(cycle, ours, theirs) for cycle, (ours, theirs) in pairs if ours != theirs]
    message = next((line for line in reversed(lines) if line.startswith(LAST_WORDS)), "")
    if not message:
        message = one_line(ended.stderr) or "it ended without a message"
        if ended.returncode >= 0 and not sent:
            raise CodegenError(message, where=QEMU, remedy="check that it supports the machine mps2-an386 (QEMU 4.1 or newer)")
    counts = [int(count) for count in end.groups()] if (end := _END.fullmatch(message)) else [0, 0, 0, 0, 0]
    cycles, ticks, lost_samples, fpu, stack = counts
    return ImageRun(
        toolchain=toolchain,
        compared=len(expected),
        different=len(different),
        first_difference="cycle {}: {} sent, {} expected".format(*different[0]) if different else "",
        faults=int(message.startswith("fault:") or ended.returncode < 0),
        message=message,
        exit_code=ended.returncode,
        cycles=cycles,
        ticks=ticks,
        lost_samples=lost_samples,
        fpu=bool(fpu),
        stack=stack,
        sizes=sizes,
    )
