"""`codegen a2l`: the description of a program's calibration for calibration tools."""

from __future__ import annotations

from pathlib import Path

import click

from codegen import console
from codegen.cli.base import example, json_option
from codegen.cli.run_options import build_option
from codegen.cli.values import FileType, any_file

SUFFIX = ".a2l"


@click.command(
    short_help="Write the A2L of a linked program.",
    epilog=example("codegen a2l --build generated/4ws2 --elf ecu.elf -o ecu.a2l"),
)
@build_option
@click.option("--elf", "elf_path", required=True, type=any_file, metavar="ELF", help="A program linked with the build.")
@click.option("--instance", metavar="PATH", help="Object of the task or controller, such as ecu.task; where there are several.")
@click.option(
    "-o", "--output", required=True, type=FileType((SUFFIX,), to_write=True), metavar="A2L", help="The file to write, .a2l."
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

    check_output(output, SUFFIX, (build_path, elf_path))
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


COMMANDS = (a2l,)
