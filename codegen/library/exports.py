"""Files for other tools, made from a build: FMU, A2L, AUTOSAR, firmware."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

from codegen.emit.folder import Folder, check_output, refuse_folder
from codegen.emit.write import write_folder
from codegen.errors import CheckFailed, CodegenError, suggestion
from codegen.export import firmware
from codegen.export.a2l import fill
from codegen.export.arxml import WHAT, Access, Protection
from codegen.export.arxml import export as describe
from codegen.export.elf import Elf
from codegen.export.firmware import ImageRun
from codegen.export.fmu.export import make_fmu
from codegen.export.fmu.variables import WITH_BUS, Version, What
from codegen.files import write_atomically
from codegen.library.builds import BuildLike, edited_notes, folder_of
from codegen.library.result import PathLike, Progress, Result, Work, path_of, public
from codegen.text import text_table

A2L_SUFFIX, FMU_SUFFIX = ".a2l", ".fmu"


class Export(Result):
    """Files for another tool that were written.

    Attributes:
        path: the file or folder.
        facts: what it contains, as JSON values.
    """

    def __init__(
        self,
        path: Path,
        lines: Sequence[str],
        facts: Mapping[str, Any],
        notes: Sequence[str] = (),
        failure: CheckFailed | None = None,
    ) -> None:
        self.path, self.facts, self.notes, self.failure = path, facts, tuple(notes), failure
        self._lines = lines

    def lines(self) -> list[str]:
        """Return what was written."""
        return [*self._lines]

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts."""
        return {**self.facts}


@public
def export(
    build: BuildLike,
    what: Literal["fmu", "a2l", "arxml", "firmware"],
    path: PathLike,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> Export:
    """Write a build for another tool.

    - "fmu", an .fmu. `model`: "controller" (default), "plant", "loop" or "ecu". `bus`: the plant exchanges CAN frames. `fmi`:
      "2" or "3".
    - "a2l", an .a2l. `elf`: a program linked with the build; required. `instance`: path of the task, if there are several.
    - "arxml", a folder. `e2e`: "transformer" (default) or "task". `access`: "explicit" (default) or "implicit".
    - "firmware", a folder. `run`: also run it in QEMU. `toolchain`: "gcc" or "zig".

    Args:
        build: a build, or the path of its folder.
        what: the format.
        path: the file or folder to write.
        progress: called with the share of the work that is done.
        options: see above.

    Raises:
        CodegenError: there is no such format or option, or the build cannot be exported.
    """
    if what not in FORMATS:
        raise CodegenError(
            f"there is no export {what!r}", remedy=f"known: {', '.join(FORMATS)}{suggestion(str(what), FORMATS)}"
        )
    write, known = FORMATS[what]
    for name, value in options.items():
        if name not in known:
            remedy = f"known: {', '.join(known)}{suggestion(name, known)}"
            raise CodegenError(f"{what} has no option {name!r}", where="export", remedy=remedy)
        if known[name] and value not in known[name]:
            raise CodegenError(
                f"{value!r} is no {name} of {what}", where="export", remedy=f"known: {', '.join(map(str, known[name]))}"
            )
    return write(folder_of(build), path_of(path, "the path of an export"), progress, **options)


def _a2l(
    build: Path, path: Path, progress: Progress | None, elf: PathLike | None = None, instance: str | None = None
) -> Export:
    """Write the A2L of a build with the addresses that its objects have in a linked program."""
    program = path_of(elf, "elf: a linked program")
    check_output(path, A2L_SUFFIX, (build, program))
    with Work(progress).status(f"reading {program}"):
        filled = fill(build, Elf.read(program), instance)
    write_atomically(path, filled.text.encode("ascii"))
    address, size = filled.segment
    notes = [*edited_notes(build, tuple(filled.edited))]
    if filled.left_out:
        why = f"{filled.instance} does not have them" if filled.instance else f"no task or controller in {program.name}"
        notes.append(f"{len(filled.left_out)} measurements left out: {why}")
    facts = {
        "a2l": str(path),
        "elf": str(program),
        "instance": filled.instance or None,
        "objects": {name: f"0x{place.address:08X}" for name, place in filled.places.items()},
        "left_out": list(filled.left_out),
        "calibration": {"address": f"0x{address:08X}", "bytes": size},
        "edited": list(filled.edited),
    }
    return Export(path, [f"{path}: {len(filled.places)} objects; calibration 0x{address:08X}, {size} bytes"], facts, notes)


def _fmu(
    build: Path,
    path: Path,
    progress: Progress | None,
    model: What = "controller",
    bus: bool = False,
    fmi: Version | None = None,
) -> Export:
    """Write a co-simulation FMU of a build, with its sources and the binary for this machine."""
    if bus and model not in ("plant", "ecu"):
        raise CodegenError(f"{model} has no bus", where="`bus=`", remedy="give it with `model='plant'`")
    kind: What = "bus_plant" if bus and model == "plant" else model
    has_bus = kind in WITH_BUS
    version: Version = fmi or ("3" if has_bus else "2")
    check_output(path, FMU_SUFFIX, (build,))
    with Work(progress).status(f"compiling {build}"):
        made = make_fmu(build, kind, version)
    write_atomically(path, made.content)
    counted = {role: sum(each.role == role for each in made.variables) for role in ("input", "output", "fixed", "tunable")}
    parameters = counted["fixed"] + counted["tunable"]
    facts = {
        "fmu": str(path),
        "what": model,
        "bus": has_bus,
        "fmi": f"{version}.0",
        "model_identifier": made.identifier,
        "token": made.token,
        "platform": made.platform,
        "internal_step_s": made.internal_step,
        "bytes": len(made.content),
        "inputs": counted["input"],
        "outputs": counted["output"],
        "parameters": parameters,
        "edited": list(made.edited),
    }
    steps = "internal steps of" if has_bus else "steps of whole multiples of"
    line = (
        f"{path}: FMI {version}.0 co-simulation, {model}{' on a CAN bus' if has_bus else ''}, for {made.platform}; "
        f"{counted['input']} inputs, {counted['output']} outputs, {parameters} parameter{'' if parameters == 1 else 's'}; "
        f"{steps} {made.internal_step:g} s"
    )
    return Export(path, [line], facts, edited_notes(build, tuple(made.edited)))


def _arxml(
    build: Path, path: Path, progress: Progress | None, e2e: Protection = "transformer", access: Access = "explicit"
) -> Export:
    """Write the ARXML (R22-11) of a build, and the C between the RTE and the controller."""
    refuse_folder(path, WHAT, "a description for AUTOSAR")
    with Work(progress).status(f"describing {build}"):
        made = describe(build, e2e, access)
    changed, files = _written(made.folder, path)
    facts: dict[str, Any] = {"build": str(build), "autosar": str(path), "e2e": e2e, "access": access}
    facts |= {"changed": changed, "files": files, "edited": list(made.edited)}
    state = "" if changed else " (unchanged)"
    line = f"{path}: {len(files)} files{state}, E2E by the {e2e}, {access} access; import {path / made.arxml}"
    return Export(path, [line], facts, edited_notes(build, tuple(made.edited)))


def _firmware(build: Path, path: Path, progress: Progress | None, run: bool = False, toolchain: str | None = None) -> Export:
    """Write a small bare-metal project for a Cortex-M4F, which runs the task of a build against a recorded drive."""
    if toolchain is not None and not run:
        raise CodegenError("it needs `run=True`", where="`toolchain=`", remedy="add `run=True`, or give TOOLCHAIN=zig to make")
    if run:
        firmware.require_tools()
    chosen = firmware.choose_toolchain(toolchain) if run else None
    firmware.refuse_target(path)
    work = Work(progress, "recording", *(["running"] if run else []))
    with work.status("recording", f"recording a run of {build}"):
        made = firmware.project(build)
    changed, files = _written(made.folder, path)
    ran = None
    if chosen is not None:
        with work.status("running", "compiling the firmware and running it in QEMU"):
            ran = firmware.run_image(made.folder.files, made.sent, chosen)
    facts = {"build": str(build), "firmware": str(path), "changed": changed, "files": files}
    facts |= {"edited": list(made.edited), "run": None if ran is None else ran.to_dict()}
    state = "" if changed else " (unchanged)"
    lines = [f"{path}: {len(files)} files{state}; start with {path / 'README.md'}"]
    failure = None
    if ran is not None:
        lines.append(_ran_table(ran))
        failure = None if ran.passed else CheckFailed(_failure(ran), where=path)
    return Export(path, lines, facts, edited_notes(build, tuple(made.edited)), failure)


def _written(folder: Folder, path: Path) -> tuple[bool, list[str]]:
    """Write a folder, and return whether anything changed, and its files."""
    return write_folder(folder, path), [*sorted(folder.files), "manifest.json"]


def _ran_table(ran: ImageRun) -> str:
    rows = [
        ("frames compared with the SIL", ran.compared),
        ("different", ran.different),
        ("faults", ran.faults),
        ("cycles, begun by a tick of SysTick", ran.cycles),
        ("flash [bytes]", ran.sizes.flash),
        ("RAM [bytes], both stacks included", ran.sizes.ram),
        ("deepest stack of the program [bytes]", ran.stack),
    ]
    return text_table((f"in QEMU, built by {ran.toolchain}", ""), [(name, str(value)) for name, value in rows])


def _failure(ran: ImageRun) -> str:
    ended = "" if ran.exit_code == 0 else f"; it ended with {ran.message!r}, exit code {ran.exit_code}"
    if ran.faults:
        return f"the image ran into a fault: {ran.message}"
    if ran.different:
        return f"{ran.different} of {ran.compared} frames differ from the SIL's, first in {ran.first_difference}{ended}"
    return f"all frames equal the SIL's, but the run failed: {ran.message}, exit code {ran.exit_code}"


FORMATS: Mapping[str, tuple[Callable[..., Export], Mapping[str, tuple[Any, ...]]]] = {
    "fmu": (_fmu, {"model": ("controller", "plant", "loop", "ecu"), "bus": (False, True), "fmi": (None, *get_args(Version))}),
    "a2l": (_a2l, {"elf": (), "instance": ()}),
    "arxml": (_arxml, {"e2e": get_args(Protection), "access": get_args(Access)}),
    "firmware": (_firmware, {"run": (False, True), "toolchain": (None, "gcc", "zig")}),
}
"""Format -> function that writes it, and its options with their values; () for any."""
