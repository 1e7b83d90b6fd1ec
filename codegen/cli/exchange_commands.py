"""Commands that exchange data with other tools: import of maps and tyres; export as A2L, firmware and FMU."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option, note_edited
from codegen.cli.options import FileType, any_file, build_option, configuration_file, folder_to_write
from codegen.errors import CheckFailed, CodegenError
from codegen.files import write_atomically
from codegen.text_table import text_table

if TYPE_CHECKING:
    from codegen.export.firmware import ImageRun
    from codegen.export.fmu.variables import Version, What
    from codegen.importing.tyre import AxleImport, TyreImport


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
@click.option(
    "--config", "config_path", type=configuration_file, help="For tyres: the ars.toml of the car, which is not changed."
)
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
    rows: str | None,
    config_path: Path | None,
    peak: str | None,
    as_json: bool,
    **names: str | None,
) -> None:
    """Import a map from a MATLAB file or a text table, or the tyres of .tir files into a new ars.toml.

    One .tir file is used for both axles, two are front and rear. The extension of FILE selects the format.
    """
    from codegen.emit.outputs import check_output

    for_map: dict[str, object] = {**names, "units": units, "rows": rows}
    for_tyres: dict[str, object] = {"config": config_path, "peak": peak}
    if _are_tyres(files):
        _refuse_options(for_map, "for a map")
        if config_path is None:
            raise CodegenError(
                "tyres need the configuration of a car",
                where=files[0],
                remedy="name its ars.toml with --config and the new one with -o",
            )
        check_output(output, ".toml", (*files, config_path))
        _import_tyres(files, output, config_path, peak, as_json)
        return
    _refuse_options(for_tyres, "for tyres")
    check_output(output, ".npz", files)
    chosen = {key: name for key in MAP_OPTIONS if (name := names[key]) is not None}
    _import_map(files[0], output, chosen, units, rows, as_json)


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


# --- a map ---------------------------------------------------------------------------------------------------------------


def _import_map(path: Path, output: Path, names: dict[str, str], units: str | None, rows: str | None, as_json: bool) -> None:
    from codegen.importing.maps import Choices, import_map
    from codegen.map_file import map as npz
    from codegen.report.summary import map_summary

    axis = "vx" if rows == "vx" else "delta_f" if rows == "delta_f" else None
    imported = import_map(path, Choices(names, units, axis))  # type: ignore[arg-type]
    npz.save(imported.reference_map, output)
    summary = map_summary(imported.reference_map)
    if as_json:
        found: dict[str, Any] = {"map": str(output), "source": str(path), "read": list(imported.said)}
        console.print_json({**found, "variables": imported.columns, **summary.to_dict()})
        return
    console.note(*imported.said)
    console.say(f"{output}: {summary.headline}")
    console.say(text_table(("", "from", "to", "unit", "points"), summary.axis_rows))
    console.say("")
    console.say(text_table(("", "from", "to", "unit"), summary.value_rows))


# --- tyres ---------------------------------------------------------------------------------------------------------------


def _import_tyres(files: tuple[Path, ...], output: Path, config_path: Path, peak: str | None, as_json: bool) -> None:
    from codegen.importing.tyre import import_tyres

    imported = import_tyres(files, config_path, "road" if peak == "road" else "file")
    write_atomically(output, imported.text.encode("utf-8"))
    if as_json:
        console.print_json({"configuration": str(output), **imported.to_dict(), "notes": list(imported.notes)})
        return
    console.note(*imported.notes)
    _print_tyres(imported, output)


def _print_tyres(imported: TyreImport, output: Path) -> None:
    console.say(f"{output}: {', '.join(dict.fromkeys(f'{axle.file} ({axle.version})' for axle in imported.axles))}")
    columns = [_column(axle) for axle in imported.axles]
    rows = [(title, *(column[title] for column in columns)) for title in columns[0]]
    console.say(text_table(("one tyre of the axle", *(axle.axle for axle in imported.axles)), rows))
    console.say(f"next: codegen solve --config {output} --case 4ws-2 -o 4ws2.npz")


def _column(axle: AxleImport) -> dict[str, str]:
    at_peak = "none below 45" if axle.slip_at_peak is None else f"{math.degrees(axle.slip_at_peak):.2f}"
    return {
        "static wheel load [N]": f"{axle.load:.0f}",
        "cornering stiffness [N/rad]": f"{axle.stiffness:.0f}",
        "peak force [N]": f"{axle.peak:.0f}",
        "peak friction": f"{axle.friction:.3f}",
        "slip at the peak [deg]": at_peak,
        "slip bound of the map [deg]": f"{math.degrees(axle.slip_bound):.2f}",
        "removed: horizontal shift [deg]": f"{math.degrees(axle.horizontal_shift):.3f}",
        "removed: vertical shift [N]": f"{axle.vertical_shift:.1f}",
        "removed: difference of E by side": f"{axle.asymmetry:.3f}",
        "curve against the file, up to the slip bound [% of peak]": f"{100.0 * axle.worst:.2f}",
        "the same up to the peak [% of peak]": f"{100.0 * axle.worst_to_peak:.2f}",
        "stiffness against the file at 0.7 of the load [%]": f"{100.0 * axle.stiffness_lighter:+.1f}",
        "stiffness against the file at 1.3 of the load [%]": f"{100.0 * axle.stiffness_heavier:+.1f}",
    }


A2L_SUFFIX = ".a2l"


@cli.command(
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
    from codegen.emit.outputs import check_output
    from codegen.export.a2l import fill
    from codegen.export.elf import Elf

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


@cli.command(
    short_help="Write an FMU for other simulators.",
    epilog=example("codegen fmu --build generated/4ws2 --what controller -o controller.fmu"),
)
@build_option
@click.option(
    "--what",
    type=click.Choice(["controller", "plant", "loop", "ecu"]),
    required=True,
    help="The controller, the car of the build's configuration, both in closed loop, or the whole task with its CAN frames.",
)
@click.option("--bus", is_flag=True, help="With --what plant: the car sends and receives CAN frames (FMI-LS-BUS).")
@click.option("--fmi", "version", type=click.Choice(["2", "3"]), help="FMI 2.0 or 3.0.  [default: 2; with a bus: 3]")
@click.option(
    "-o", "--output", required=True, type=FileType((FMU_SUFFIX,), to_write=True), metavar="FMU", help="The file to write, .fmu."
)
@json_option
def fmu(build_path: Path, what: What, bus: bool, version: Version | None, output: Path, as_json: bool) -> None:
    """Write a co-simulation FMU of a build, with its sources and the binary for this machine.

    A simulator that imports it runs the build's own C, with the same results as `codegen sil`.
    """
    from codegen.emit.outputs import check_output
    from codegen.export.fmu.export import make_fmu
    from codegen.export.fmu.variables import WITH_BUS

    if bus and what not in ("plant", "ecu"):
        raise CodegenError(f"{what} has no bus", where="--bus", remedy="give it with --what plant")
    kind: What = "bus_plant" if bus and what == "plant" else what
    has_bus = kind in WITH_BUS
    version = version or ("3" if has_bus else "2")
    check_output(output, FMU_SUFFIX, (build_path,))
    with console.status(f"compiling {build_path}"):
        made = make_fmu(build_path, kind, version)
    note_edited(build_path, made.edited, quiet=as_json)
    write_atomically(output, made.content)
    counted = {role: sum(each.role == role for each in made.variables) for role in ("input", "output", "fixed", "tunable")}
    parameters = counted["fixed"] + counted["tunable"]
    if as_json:
        console.print_json(
            {
                "fmu": str(output),
                "what": what,
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
        )
        return
    console.say(
        f"{output}: FMI {version}.0 co-simulation, {what}{' on a CAN bus' if has_bus else ''}, for {made.platform}; "
        f"{counted['input']} inputs, {counted['output']} outputs, {parameters} parameter{'' if parameters == 1 else 's'}; "
        + (
            f"internal steps of {made.internal_step:g} s"
            if has_bus
            else f"steps of whole multiples of {made.internal_step:g} s"
        )
    )


@cli.command(
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
    from codegen.emit.write import write_folder
    from codegen.export.firmware import choose_toolchain, project, refuse_target, require_tools, run_image

    if toolchain is not None and not run_it:
        raise CodegenError("it needs --run", where="--toolchain", remedy="add --run, or give TOOLCHAIN=zig to make")
    if run_it:
        require_tools()
    chosen = choose_toolchain(toolchain) if run_it else None
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
        ran = run_image(made.folder.files, made.sent, chosen) if chosen is not None else None
    if as_json:
        console.print_json({**result, "run": None if ran is None else ran.to_dict()})
    else:
        state = "" if changed else " (unchanged)"
        console.say(f"{output}: {len(result['files'])} files{state}; start with {output / 'README.md'}")
    if ran is not None:
        _tell(ran, output, as_json)


def _tell(ran: ImageRun, output: Path, as_json: bool) -> None:
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
