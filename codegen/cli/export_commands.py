"""Commands that export a build to other tools: A2L, firmware and FMU."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.run_options import build_option
from codegen.cli.values import FileType, any_file, folder_to_write
from codegen.errors import CheckFailed, CodegenError

if TYPE_CHECKING:
    from codegen.export.firmware.image import ImageRun
    from codegen.export.fmu.standard import Version
    from codegen.export.fmu.variables import What

A2L_SUFFIX = ".a2l"


@click.command(
    short_help="Write the A2L of a linked program.",
    epilog=example("codegen a2l --build generated/4ws2 --elf ecu.elf -o ecu.a2l"),
)
@build_option
@click.option("--elf", "elf_path", required=True, type=any_file, metavar="ELF", help="A program linked with the build.")
@click.option("--instance", metavar="PATH", help="Task or controller object, such as ecu.task; needed if there are several.")
@click.option(
    "-o", "--output", required=True, type=FileType((A2L_SUFFIX,), to_write=True), metavar="A2L", help="The file to write, .a2l."
)
@json_option
def a2l(build_path: Path, elf_path: Path, instance: str | None, output: Path, as_json: bool) -> None:
    """Write the A2L of a build with the addresses that its objects have in a linked program.

    Byte order and types come from the program too; the identity of the build and the size of each object must match it.
    """
    from codegen.cli.bench_report import note_edited
    from codegen.emit.outputs import check_output
    from codegen.export.a2l.elf import Elf
    from codegen.export.a2l.fill import fill
    from codegen.files import write_atomically

    check_output(output, A2L_SUFFIX, (build_path, elf_path))
    filled = fill(build_path, Elf.read(elf_path), instance)
    note_edited(build_path, filled.edited, quiet=as_json)
    write_atomically(output, filled.text.encode("ascii"))
    address, size = filled.segment
    if as_json:
        console.print_json(
            {
                "a2l": str(output),
                "elf": str(elf_path),
                "instance": filled.instance or None,
                "objects": {name: f"0x{place.address:08X}" for name, place in filled.places.items()},
                "left_out": list(filled.left_out),
                "calibration": {"address": f"0x{address:08X}", "bytes": size},
                "edited": list(filled.edited),
            }
        )
        return
    console.say(f"{output}: {len(filled.places)} objects; calibration 0x{address:08X}, {size} bytes")
    if filled.left_out:
        why = f"{filled.instance} does not have them" if filled.instance else f"no task or controller in {elf_path.name}"
        console.note(f"{len(filled.left_out)} measurements left out: {why}")


FMU_SUFFIX = ".fmu"


@click.command(
    short_help="Write an FMU for other simulators.",
    epilog=example("codegen fmu --build generated/4ws2 --what controller -o controller.fmu"),
)
@build_option
@click.option(
    "--what",
    type=click.Choice(["controller", "plant", "loop"]),
    required=True,
    help="The controller, the car of the build's configuration, or both in closed loop.",
)
@click.option("--fmi", "version", type=click.Choice(["2", "3"]), default="2", show_default=True, help="FMI 2.0 or 3.0.")
@click.option(
    "-o", "--output", required=True, type=FileType((FMU_SUFFIX,), to_write=True), metavar="FMU", help="The file to write, .fmu."
)
@json_option
def fmu(build_path: Path, what: What, version: Version, output: Path, as_json: bool) -> None:
    """Write a co-simulation FMU of a build, with its sources and the binary for this machine.

    A simulator that imports it runs the build's own C, with the same results as `codegen sil`.
    """
    from codegen.cli.bench_report import note_edited
    from codegen.emit.outputs import check_output
    from codegen.export.fmu.export import make_fmu
    from codegen.files import write_atomically

    check_output(output, FMU_SUFFIX, (build_path,))
    with console.status(f"compiling {build_path}"):
        made = make_fmu(build_path, what, version)
    note_edited(build_path, made.edited, quiet=as_json)
    write_atomically(output, made.content)
    counted = {role: sum(each.role == role for each in made.variables) for role in ("input", "output", "fixed", "tunable")}
    parameters = counted["fixed"] + counted["tunable"]
    if as_json:
        console.print_json(
            {
                "fmu": str(output),
                "what": what,
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
        )
        return
    console.say(
        f"{output}: FMI {version}.0 co-simulation, {what}, for {made.platform}; {counted['input']} inputs, "
        f"{counted['output']} outputs, {parameters} parameters; steps of whole multiples of {made.internal_step:g} s"
    )


@click.command(
    short_help="Write a bare-metal Cortex-M4F project around a build.",
    epilog=example("codegen firmware --build generated/4ws2 -o fw --run"),
)
@build_option
@click.option("-o", "--output", required=True, type=folder_to_write, metavar="DIR", help="Folder for the project.")
@click.option("--run", "run_it", is_flag=True, help="Also build it, run it in QEMU and compare its frames with the SIL's.")
@click.option(
    "--toolchain",
    type=click.Choice(["gcc", "zig"]),
    help="Compiler for --run; by default arm-none-eabi-gcc if installed, else zig.",
)
@json_option
def firmware(build_path: Path, output: Path, run_it: bool, toolchain: str | None, as_json: bool) -> None:
    """Write a small bare-metal project for a Cortex-M4F: it boots and runs the task of a build against a recorded drive.

    No vendor code, no C library. --run also builds the image in a temporary folder and runs it in QEMU (mps2-an386); exits
    with 1 if a frame differs from the software in the loop.
    """
    from codegen.cli.bench_report import note_edited
    from codegen.emit.write import write_folder
    from codegen.export.firmware import image
    from codegen.export.firmware.project import project, refuse_target

    if toolchain is not None and not run_it:
        raise CodegenError("it needs --run", where="--toolchain", remedy="add --run, or give TOOLCHAIN=zig to make")
    if run_it:
        image.require_tools()
    chosen = image.choose_toolchain(toolchain) if run_it else None
    refuse_target(output)
    with console.status(f"recording a run of {build_path}"):
        made = project(build_path)
    note_edited(build_path, made.edited, quiet=as_json)
    changed = write_folder(made.folder, output)
    result: dict[str, Any] = {
        "build": str(build_path),
        "firmware": str(output),
        "changed": changed,
        "files": [*sorted(made.folder.files), "manifest.json"],
        "edited": list(made.edited),
    }
    with console.status("compiling the firmware and running it in QEMU") if run_it else contextlib.nullcontext():
        ran = image.run_image(made.folder.files, made.sent, chosen) if chosen is not None else None
    if as_json:
        console.print_json({**result, "run": None if ran is None else ran.to_dict()})
    else:
        state = "" if changed else " (unchanged)"
        console.say(f"{output}: {len(result['files'])} files{state}; start with {output / 'README.md'}")
    if ran is not None:
        _tell(ran, output, as_json)


def _tell(ran: ImageRun, output: Path, as_json: bool) -> None:
    from codegen.text_table import text_table

    if not as_json:
        rows = [
            ("frames compared with the SIL", ran.compared),
            ("different", ran.different),
            ("faults", ran.faults),
            ("cycles, begun by a tick of SysTick", ran.cycles),
            ("flash [bytes]", ran.sizes.flash),
            ("RAM [bytes], both stacks included", ran.sizes.ram),
            ("deepest stack of the program [bytes]", ran.stack),
        ]
        console.say(text_table((f"in QEMU, built by {ran.toolchain}", ""), [(name, str(value)) for name, value in rows]))
    if not ran.passed:
        raise CheckFailed(_failure(ran), where=output)


def _failure(ran: ImageRun) -> str:
    ended = "" if ran.exit_code == 0 else f"; it ended with {ran.message!r}, exit code {ran.exit_code}"
    if ran.faults:
        return f"the image ran into a fault: {ran.message}"
    if ran.different:
        return f"{ran.different} of {ran.compared} frames differ from the SIL's, first in {ran.first_difference}{ended}"
    return f"all frames equal the SIL's, but the run failed: {ran.message}, exit code {ran.exit_code}"


COMMANDS = (a2l, firmware, fmu)
