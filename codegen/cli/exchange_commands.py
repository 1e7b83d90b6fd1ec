"""Commands that exchange data with other tools: import, logs, calibration data; export as A2L, ARXML, firmware and FMU."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import click

import codegen
from codegen import console
from codegen.cli.base import cli, example, json_option, show
from codegen.cli.options import (
    Command,
    FileType,
    any_file,
    build_option,
    channel_option,
    check_picture,
    configuration_file,
    database_option,
    drive_log,
    folder_to_write,
    picture_to_write,
    signals_option,
)
from codegen.errors import CodegenError

TYRE_ENDING = ".tir"
READ_ENDINGS = (".mat", ".csv", ".tsv", ".txt", ".dat", TYRE_ENDING)
MAP_OPTIONS = ("vx", "delta_f", "yaw_rate", "beta", "delta_r", "feasible")
READ = "supported are .mat, .csv, .tsv, .txt, .dat (a map) and .tir (a tyre)"


@cli.command(
    name="import",
    short_help="Import a map from a .mat or text table, or tyres from .tir files.",
    epilog=example(
        "codegen import map.mat --units vx=km/h,delta_f=deg,yaw_rate=deg/s -o map.npz\n"
        "  codegen import table.csv -o map.npz\n"
        "  codegen import front.tir rear.tir --config ars.toml -o new.toml"
    ),
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=FileType(READ_ENDINGS))
@click.option(
    "-o",
    "--output",
    required=True,
    type=FileType((".npz", ".toml"), to_write=True),
    metavar="OUT",
    help="The map (.npz), or for tyres the new ars.toml (.toml).",
)
@click.option("--vx", metavar="NAME", help="Variable or column of the speeds, if it has no common name.")
@click.option("--delta-f", metavar="NAME", help="Variable or column of the front angles at the road wheel.")
@click.option("--yaw-rate", metavar="NAME", help="Variable or column of the yaw rates.")
@click.option("--beta", metavar="NAME", help="Variable or column of the sideslip angles; optional.")
@click.option("--delta-r", metavar="NAME", help="Variable or column of the rear angles; optional.")
@click.option(
    "--feasible", metavar="NAME", help="Variable or column of 1 and 0; by default cells without a value are infeasible."
)
@click.option(
    "--units", metavar="LIST", help="Units, such as vx=km/h,delta_f=deg,yaw_rate=deg/s, if the names do not contain them."
)
@click.option("--rows", type=click.Choice(["vx", "delta_f"]), help="Axis along the rows of a table, if it is ambiguous.")
@click.option("--config", type=configuration_file, help="For tyres: the ars.toml of the car, which is not changed.")
@click.option(
    "--peak",
    type=click.Choice(["file", "road"]),
    help="For tyres: the peak friction of the file (default), or road.friction.",
)
@json_option
def import_(
    files: tuple[Path, ...],
    output: Path,
    units: str | None,
    rows: Literal["vx", "delta_f"] | None,
    config: Path | None,
    peak: str | None,
    as_json: bool,
    **names: str | None,
) -> None:
    """Import a map from a MATLAB file or a text table, or the tyres of .tir files into a new ars.toml.

    One .tir file is used for both axles, two are front and rear. The extension of FILE selects the format.
    """
    from codegen.emit.folder import check_output

    for_map: dict[str, object] = {**names, "units": units, "rows": rows}
    for_tyres: dict[str, object] = {"config": config, "peak": peak}
    if _are_tyres(files):
        _refuse_options(for_map, "for a map")
        if config is None:
            raise CodegenError(
                "tyres need the configuration of a car",
                where=files[0],
                remedy="name its ars.toml with --config and the new one with -o",
            )
        check_output(output, ".toml", (*files, config))
        tyres = codegen.import_tyres(files, config, peak="road" if peak == "road" else "file")
        tyres.save(output)
        show(tyres, as_json)
        return
    _refuse_options(for_tyres, "for tyres")
    check_output(output, ".npz", files)
    chosen = {key: name for key in MAP_OPTIONS if (name := names[key]) is not None}
    found = codegen.import_map(files[0], units=units, rows=rows, variables=chosen)
    found.save(output)
    show(found, as_json)


def _are_tyres(files: tuple[Path, ...]) -> bool:
    """Return whether the files are tyres. Raises CodegenError if they are neither tyres nor a single map."""
    from codegen.importing.maps import MATLAB_ENDINGS, TABLE_ENDINGS

    endings = [path.suffix.lower() for path in files]
    for path, ending in zip(files, endings, strict=True):
        if ending == ".npz":
            raise CodegenError("is a map already", where=path, remedy="use it directly with codegen show and codegen build")
        if ending not in (TYRE_ENDING, *MATLAB_ENDINGS, *TABLE_ENDINGS):
            raise CodegenError(f"{ending or 'a name without ending'} is not supported", where=path, remedy=READ)
    tyres = endings.count(TYRE_ENDING)
    if tyres == len(files) <= 2:
        return True
    if len(files) > 1:
        raise CodegenError(f"{len(files)} files", where=files[-1], remedy="give one map, or one or two .tir files")
    return False


def _refuse_options(options: dict[str, object], purpose: str) -> None:
    for key, value in options.items():
        if value is not None:
            raise CodegenError(f"this option is {purpose}", where=f"--{key.replace('_', '-')}", remedy="leave it out")


A2L_SUFFIX, FMU_SUFFIX = ".a2l", ".fmu"


def _output_option(suffix: str) -> Callable[[Command], Command]:
    """Return the option -o, --output of a command that writes one file with a suffix."""
    kind, text = FileType((suffix,), to_write=True), f"The file to write, {suffix}."
    return click.option("-o", "--output", "path", required=True, type=kind, metavar=suffix[1:].upper(), help=text)


@cli.command(
    short_help="Write the A2L of a linked program.",
    epilog=example("codegen a2l --build generated/4ws2 --elf ecu.elf -o ecu.a2l"),
)
@build_option
@click.option("--elf", required=True, type=any_file, metavar="ELF", help="A program linked with the build.")
@click.option("--instance", metavar="PATH", help="Task or controller object, such as ecu.task; needed if there are several.")
@_output_option(A2L_SUFFIX)
@json_option
def a2l(as_json: bool, **given: Any) -> None:
    """Write the A2L of a build with the addresses that its objects have in a linked program.

    Byte order and types come from the program too; the identity of the build and the size of each object must match it.
    """
    show(codegen.export(what="a2l", **given, progress=console.shown), as_json)


@cli.command(
    short_help="Write an FMU for other simulators.",
    epilog=example("codegen fmu --build generated/4ws2 --what controller -o controller.fmu"),
)
@build_option
@click.option(
    "--what",
    "model",
    type=click.Choice(["controller", "plant", "loop", "ecu"]),
    required=True,
    help="The controller, the car of the build's configuration, both in closed loop, or the whole task with its CAN frames.",
)
@click.option("--bus", is_flag=True, help="With --what plant: the car sends and receives CAN frames (FMI-LS-BUS).")
@click.option("--fmi", type=click.Choice(["2", "3"]), help="FMI 2.0 or 3.0.  [default: 2; with a bus: 3]")
@_output_option(FMU_SUFFIX)
@json_option
def fmu(as_json: bool, **given: Any) -> None:
    """Write a co-simulation FMU of a build, with its sources and the binary for this machine.

    A simulator that imports it runs the build's own C, with the same results as `codegen sil`.
    """
    show(codegen.export(what="fmu", **given, progress=console.shown), as_json)


@cli.command(
    short_help="Write a bare-metal Cortex-M4F project around a build.",
    epilog=example("codegen firmware --build generated/4ws2 -o fw --run"),
)
@build_option
@click.option("-o", "--output", "path", required=True, type=folder_to_write, metavar="DIR", help="Folder for the project.")
@click.option("--run", is_flag=True, help="Also build it, run it in QEMU and compare its frames with the SIL's.")
@click.option(
    "--toolchain",
    type=click.Choice(["gcc", "zig"]),
    help="Compiler for --run; by default arm-none-eabi-gcc if installed, else zig.",
)
@json_option
def firmware(as_json: bool, **given: Any) -> None:
    """Write a small bare-metal project for a Cortex-M4F: it boots and runs the task of a build against a recorded drive.

    No vendor code, no C library. --run also builds the image in a temporary folder and runs it in QEMU (mps2-an386); exits
    with 1 if a frame differs from the software in the loop.
    """
    show(codegen.export(what="firmware", **given, progress=console.shown), as_json)


@cli.command(
    short_help="Describe a build for AUTOSAR Classic: ARXML, and the adapter in C.",
    epilog=example("codegen arxml --build generated/4ws2 -o autosar"),
)
@build_option
@click.option("-o", "--output", "path", required=True, type=folder_to_write, metavar="DIR", help="Folder for the description.")
@click.option(
    "--e2e",
    type=click.Choice(["transformer", "task"]),
    default="transformer",
    show_default=True,
    help="What checks the frames: the RTE's E2E transformer, or the task of the build on raw frames.",
)
@click.option(
    "--access",
    type=click.Choice(["explicit", "implicit"]),
    default="explicit",
    show_default=True,
    help="How the runnable reads the messages: by Rte_Read, or by Rte_IRead, which needs the transformer.",
)
@json_option
def arxml(as_json: bool, **given: Any) -> None:
    """Write the ARXML (R22-11) of a build, and the C between the RTE and the controller.

    The ARXML contains the software component with its types, ports, parameters and runnables, and the system with frames,
    signals and E2E protection. The C goes to the ECU project together with the sources of the build.
    """
    show(codegen.export(what="arxml", **given, progress=console.shown), as_json)


@cli.command(
    short_help="Account for every frame or row of a log.",
    epilog=example("codegen log drive2.blf --dbc generated/4ws2/ars.dbc --channel 1"),
)
@click.argument("path", metavar="FILE", type=drive_log)
@database_option
@channel_option
@signals_option
@json_option
def log(as_json: bool, **given: Any) -> None:
    """Account for every frame of the log of a CAN bus, or every row of a measurement.

    A bus (.blf, .asc, .log of candump, .mf4): the frames in the file, those that are read and those that are skipped, with the
    reason; for each channel, direction and identifier, what becomes of them: used, copies of others, of several senders, in no
    database; the kind of clock, and stamps that go back or repeat; and all that is not plain.

    A measurement (.mf4, .csv, .parquet): the rows in the file, those that are read and those that are skipped, with the reason;
    for each channel, the samples with a number, and those without one; the same about the stamps of each group of channels.

    The commands that read a log use the same account.
    """
    show(codegen.log(**given, progress=console.shown), as_json)


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
    from codegen.emit.folder import check_output

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
