"""`codegen firmware`: a bare-metal project around a build, and its run in QEMU."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.run_options import build_option
from codegen.cli.values import folder_to_write
from codegen.errors import CheckFailed, CodegenError

if TYPE_CHECKING:
    from codegen.export.firmware.image import ImageRun


@click.command(
    short_help="Write a bare-metal Cortex-M4F project around a build.",
    epilog=example("codegen firmware --build generated/4ws2 -o fw --run"),
)
@build_option
@click.option("-o", "--output", required=True, type=folder_to_write, metavar="DIR", help="Where the project goes.")
@click.option("--run", "run_it", is_flag=True, help="Also build it, run it in QEMU and compare its frames with the SIL's.")
@click.option(
    "--toolchain",
    type=click.Choice(["gcc", "zig"]),
    help="Compiler for --run; by default arm-none-eabi-gcc if installed, else zig.",
)
@json_option
def firmware(build_path: Path, output: Path, run_it: bool, toolchain: str | None, as_json: bool) -> None:
    """Write a small bare-metal project for a Cortex-M4F: it boots and runs the task of a build against a recorded drive.

    No vendor code, no C library. With --run the image is built in a folder of its own, run in QEMU (mps2-an386), and exits with
    1 where a frame differs from that of the software in the loop.
    """
    from codegen.emit.write import write_folder
    from codegen.export.firmware import image
    from codegen.export.firmware.project import project, refuse_target

    if toolchain is not None and not run_it:
        raise CodegenError("it is of --run", where="--toolchain", remedy="add --run, or give TOOLCHAIN=zig to make")
    if run_it:
        image.require_tools()
    chosen = image.choose_toolchain(toolchain) if run_it else None
    refuse_target(output)
    with console.status(f"recording a drive of {build_path}"):
        made = project(build_path)
    for path in () if as_json else made.edited:
        console.note(f"{build_path / path} was changed after the build; the firmware takes it as it is")
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
    from codegen.report.summary import table

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
        console.say(table((f"in QEMU, built by {ran.toolchain}", ""), [(name, str(value)) for name, value in rows]))
    if not ran.passed:
        raise CheckFailed(_failure(ran), where=output)


def _failure(ran: ImageRun) -> str:
    ended = "" if ran.exit_code == 0 else f"; it ended with {ran.message!r}, exit code {ran.exit_code}"
    if ran.faults:
        return f"the image ran into a fault: {ran.message}"
    if ran.different:
        return f"{ran.different} of {ran.compared} frames differ from the SIL's, first in {ran.first_difference}{ended}"
    return f"the frames are the SIL's, but not the run: {ran.message}, exit code {ran.exit_code}"


COMMANDS = (firmware,)
