"""The command for calibration data: read, check, compare, convert, and patch into images."""

from __future__ import annotations

from pathlib import Path

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import FileType, any_file, build_option, check_picture, configuration_file, picture_to_write
from codegen.errors import CodegenError

SET_ENDINGS = (".dcm", ".cdfx")
WRITTEN_ENDINGS = (*SET_ENDINGS, ".toml", ".npz")
IMAGE_ENDINGS = (".elf", ".s19", ".hex")


@cli.command(
    short_help="Read, check, compare and convert calibration data, or patch them into an image.",
    epilog=example(
        "codegen calibrate --build generated/4ws2 -o set.dcm\n"
        "  codegen calibrate --build generated/4ws2 set.dcm --plot changes.png\n"
        "  codegen calibrate --build generated/4ws2 set.dcm gains.cdfx -o new.cdfx\n"
        "  codegen calibrate --build generated/4ws2 set.dcm --image ecu.s19 --addresses ecu.elf -o new.s19"
    ),
)
@build_option
@click.argument("files", metavar="[FILE]...", nargs=-1, type=FileType(SET_ENDINGS))
@click.option(
    "-o",
    "--output",
    type=FileType((*WRITTEN_ENDINGS, *IMAGE_ENDINGS), to_write=True),
    metavar="OUT",
    help="Write the set: .dcm, .cdfx, .toml (ars.toml), .npz (its map), or the patched image, with its extension.",
)
@click.option(
    "--image",
    type=any_file,
    metavar="IMAGE",
    help="Start from the values in an ELF, S-record or Intel HEX image.",
)
@click.option(
    "--addresses", type=any_file, metavar="ELF|A2L", help="For S-record and Intel HEX: the program's ELF, or its A2L."
)
@click.option("--config", type=configuration_file, help="For .toml: the ars.toml whose keys are replaced.")
@click.option("--plot", type=picture_to_write, metavar="PNG|SVG", help="Without -o: draw the differences.")
@json_option
def calibrate(
    build: Path,
    files: tuple[Path, ...],
    output: Path | None,
    image: Path | None,
    addresses: Path | None,
    config: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Read calibration data as DCM 2.0 or CDF 2.0 (.cdfx), check them with the build's own C, and compare or convert them.

    FILEs are merged over the values of the build, or of --image, in their order. With -o the result is written. Otherwise one
    FILE is compared with these values, and two with each other; without FILE the values are listed.
    """
    from codegen.emit.outputs import check_output

    inputs = (build, *files, image, addresses, config)
    _refuse(output, image, addresses, config, plot, len(files))
    if output is not None:
        suffix = output.suffix.lower()
        if suffix in WRITTEN_ENDINGS or image is None:
            wanted = suffix
        else:  # a program on Linux has no extension; its copy may be named .elf
            wanted = image.suffix.lower() or (IMAGE_ENDINGS[0] if suffix else "")
        check_output(output, wanted, inputs)
    check_picture(plot, inputs)
    found = codegen.calibrate(build, files, image=image, addresses=addresses, progress=console.shown)
    if output is not None:
        found.save(output, config)
        show(found, as_json)
        return
    drawn = None
    if plot is not None:
        with console.status("drawing"):
            drawn = None if found.plot(plot) is None else plot
    show(found, as_json, drawn if files or image else ...)


def _refuse(
    output: Path | None, image: Path | None, addresses: Path | None, config: Path | None, plot: Path | None, count: int
) -> None:
    """Raise CodegenError for options that do not go together."""
    suffix = None if output is None else output.suffix.lower()
    if addresses is not None and image is None:
        raise CodegenError("has no effect here", where="--addresses", remedy="add --image, or leave it out")
    if config is not None and suffix != ".toml":
        raise CodegenError("has no effect here", where="--config", remedy="write a .toml with -o, or leave it out")
    if plot is not None and (output is not None or (count == 0 and image is None)):
        raise CodegenError("draws a comparison", where="--plot", remedy="give one or two FILEs and no -o")
    if output is None and count > 2:
        raise CodegenError(f"{count} files", where="codegen calibrate", remedy="compare two, or merge them with -o")
    if output is not None and suffix not in WRITTEN_ENDINGS and image is None:
        from codegen.library.calibration import no_format

        raise no_format(output)
