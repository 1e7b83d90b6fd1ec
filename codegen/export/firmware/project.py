"""The firmware project of a build, in memory: its files from the templates, the build's C and a recorded drive."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from codegen import __version__
from codegen.emit.can_view import task_name
from codegen.emit.folder import MANIFEST, Folder, owned_paths, read_files, read_manifest, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.render import render, verbatim
from codegen.emit.text import comment_text
from codegen.errors import BuildError
from codegen.files import resolved
from codegen.sil.software import Software, load
from hil_sim.codec import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import Scenario, find


@dataclass(frozen=True)
class Drive:
    """A recorded run without faults on the bus.

    Attributes:
        received: for each cycle the frames that came before its task ran.
        sent: for each cycle the frame that its task sent.
    """

    received: tuple[tuple[Frame, ...], ...]
    sent: tuple[Frame, ...]


def record(software: Software, scenario: Scenario) -> Drive:
    """Run the compiled task and the plant in closed loop, as `codegen sil --can` does, and return the frames."""
    node, task = PlantNode(software.config, scenario, precision=software.precision), software.task()
    received, sent = [], []
    for cycle in range(node.cycles):
        frames = tuple(node.outgoing(cycle))
        for frame in frames:
            task.on_can_frame(frame.id, frame.data)
        answer = Frame(*task.run())
        node.receive(answer)
        node.finish(cycle)
        received.append(frames)
        sent.append(answer)
    return Drive(tuple(received), tuple(sent))


def frame_text(frame: Frame) -> str:
    """Return a frame in the format of the firmware and of candump -L: 201#0011223344556677."""
    return f"{frame.id:03X}#{frame.data.hex().upper()}"


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
RENDERED = ("main.c", "trace.c", "trace.h", "firmware_config.h")


@dataclass(frozen=True)
class TraceFrame:
    """A row of the trace, in C."""

    cycle: int
    id: str
    length: int
    data: str


@dataclass(frozen=True)
class FirmwareView:
    """Context of the templates."""

    build_name: str
    build_id: str
    manifest_sha256: str
    edited: tuple[str, ...]
    version: str
    prefix: str
    kind: str
    period_text: str
    reload: int
    task_function: str
    sources: tuple[str, ...]
    drive_text: str
    cycles: int
    frames: tuple[TraceFrame, ...]


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
    _refuse_what_no_image_can_be_made_of(manifest, build)
    software = load(build)
    files = {
        f"controller/{path}": content
        for path, content in read_files(build, manifest, ("include/", "src/")).items()
        if not path.endswith(("_dynamics.c", "_dynamics.h"))  # the task does not need them, and they need a C library
    }
    scenario = find(SCENARIO, software.config)
    drive = record(software, scenario)
    digest = hashlib.sha256((build / MANIFEST).read_bytes()).hexdigest()
    sources = (*(f"src/{name}.c" for name in PROGRAM), *sorted(path for path in files if path.endswith(".c")))
    view = _view(manifest, software, digest, sources, scenario.title, drive)
    sent = tuple(frame_text(frame) for frame in drive.sent)
    files |= _program(view) | {"expected.txt": "".join(f"{line}\n" for line in sent).encode("ascii")}
    facts = {
        "schema_version": 1,
        "version": __version__,
        "what": WHAT,
        "name": manifest["name"],
        "options": manifest["options"],
        "build": {"id": manifest["build_id"], "manifest_sha256": digest, "edited": list(software.edited)},
        "drive": {"scenario": scenario.name, "cycles": view.cycles, "frames": len(view.frames)},
    }
    return Project(Folder(files, facts), sent, software.edited)


def refuse_target(target: Path) -> None:
    """Check that writing a project to a folder destroys nothing.

    Raises:
        BuildError: the folder holds generated output of another kind, or a firmware project in which a file was changed; or
        it lies inside such a folder.
    """
    place = resolved(target, BuildError)
    for parent in place.parents:
        if owned_paths(parent):
            raise BuildError("it lies inside a generated folder", where=target, remedy=f"name a folder outside of {parent}")
    if not owned_paths(place):
        return
    if read_manifest(place).get("what") != WHAT:
        raise BuildError("it is a build, not a firmware project", where=target, remedy="choose another folder with -o")
    if (place / MADE_BY_MAKE).exists():
        remedy = f"run `make -C {target} clean`, then this command again; or choose another folder with -o"
        raise BuildError(f"it holds {MADE_BY_MAKE}/, which its Makefile made", where=target, remedy=remedy)
    if changed := verify_hashes(place):
        remedy = "nothing was changed; choose another folder with -o, or move that one away"
        raise BuildError(f"{changed[0]} was changed since it was written", where=target, remedy=remedy)


def _refuse_what_no_image_can_be_made_of(manifest: Mapping[str, Any], build: Path) -> None:
    if manifest["options"]["precision"] != "single":
        raise BuildError(
            "it computes in double precision, and the FPU of a Cortex-M4F is single",
            where=build,
            remedy="build with --precision single",
        )


def _view(
    manifest: Mapping[str, Any], software: Software, digest: str, sources: tuple[str, ...], title: str, drive: Drive
) -> FirmwareView:
    period = software.config.controller.sampling_time_s
    ticks = round(period * CLOCK_HZ)
    if ticks - 1 > SYSTICK_RELOAD_MAX:
        limit = (SYSTICK_RELOAD_MAX + 1) / CLOCK_HZ
        raise BuildError(
            f"a sampling time of {period:g} s is too long for a timer of 24 bits at 25 MHz",
            where="controller.sampling_time_s",
            remedy=f"take at most {limit:.2g} s",
        )
    return FirmwareView(
        build_name=comment_text(manifest["name"]),
        build_id=f"0x{manifest['build_id']}",
        manifest_sha256=digest,
        edited=tuple(comment_text(path) for path in software.edited),
        version=__version__,
        prefix=software.prefix,
        kind=manifest["options"]["kind"],
        period_text=f"{period * 1e3:g} ms",
        reload=ticks - 1,
        task_function=task_name(period),
        sources=sources,
        drive_text=comment_text(title),
        cycles=len(drive.sent),
        frames=tuple(
            TraceFrame(cycle, f"0x{frame.id:03X}", len(frame.data), ", ".join(f"0x{byte:02X}u" for byte in frame.data))
            for cycle, frames in enumerate(drive.received)
            for frame in frames
        ),
    )


def _program(view: FirmwareView) -> dict[str, bytes]:
    names = (*(f"src/{name}" for name in RENDERED), "mps2_an386.ld", "Makefile", "README.md")
    rendered = {name: render(f"firmware/{name.removeprefix('src/')}.j2", {"firmware": view}) for name in names}
    return rendered | {f"src/{name}": verbatim(f"firmware/{name}") for name in VERBATIM}
