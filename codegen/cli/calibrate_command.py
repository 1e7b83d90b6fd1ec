"""The command for calibration data: read, check, compare, convert, and patch into images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option, note_edited
from codegen.cli.options import FileType, any_file, build_option, configuration_file, picture_to_write
from codegen.errors import CodegenError
from codegen.files import write_atomically
from codegen.text_table import text_table

if TYPE_CHECKING:
    from codegen.export.calibration.build import BuildCalibration
    from codegen.export.calibration.images import Image
    from codegen.export.calibration.layout import Values
    from codegen.export.calibration.sets import CalibrationSet, Difference

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
    "image_path",
    type=any_file,
    metavar="IMAGE",
    help="Start from the values in an ELF, S-record or Intel HEX image.",
)
@click.option(
    "--addresses", type=any_file, metavar="ELF|A2L", help="For S-record and Intel HEX: the program's ELF, or its A2L."
)
@click.option("--config", "config_path", type=configuration_file, help="For .toml: the ars.toml whose keys are replaced.")
@click.option("--plot", type=picture_to_write, metavar="PNG", help="Without -o: draw the differences.")
@json_option
def calibrate(
    build_path: Path,
    files: tuple[Path, ...],
    output: Path | None,
    image_path: Path | None,
    addresses: Path | None,
    config_path: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Read calibration data as DCM 2.0 or CDF 2.0 (.cdfx), check them with the build's own C, and compare or convert them.

    FILEs are merged over the values of the build, or of --image, in their order. With -o the result is written. Otherwise one
    FILE is compared with these values, and two with each other; without FILE the values are listed.
    """
    from codegen.emit.outputs import check_output
    from codegen.export.calibration.build import BuildCalibration
    from codegen.export.calibration.images import Image
    from codegen.export.calibration.sets import merged

    inputs = (build_path, *files, image_path, addresses, config_path)
    _refuse(output, image_path, addresses, config_path, plot, len(files))
    if output is not None:
        suffix = output.suffix.lower()
        if suffix in WRITTEN_ENDINGS or image_path is None:
            wanted = suffix
        else:  # a program on Linux has no extension; its copy may be named .elf
            wanted = image_path.suffix.lower() or (IMAGE_ENDINGS[0] if suffix else "")
        check_output(output, wanted, inputs)
    check_output(plot, ".png", inputs)
    with console.status(f"compiling {build_path}"):
        build = BuildCalibration.load(build_path)
    note_edited(build_path, build.edited, quiet=as_json)
    image = None if image_path is None else Image.load(image_path, addresses, build_path, build.layout)
    base, name = (build.values, "build") if image is None else (image.read(), image.path.name)
    if output is not None:
        _write(build, merged(build, base, name, files), image, output, config_path, as_json)
        return
    own = merged(build, build.values, "build", ())
    sets = [merged(build, base, name, files[k : k + 1]) for k in range(max(len(files), 1))]
    if len(sets) == 1 and (files or image):
        sets = [merged(build, base, name, ()) if files else own, *sets]
    _note_stale(sets)
    if len(sets) == 1:
        _list(build, sets[0].values, as_json)
    else:
        _compare(build, sets[0], sets[1], plot, as_json)


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
        raise CodegenError(
            f"{suffix or 'a name without extension'} is not a format of calibration data",
            where=output,
            remedy=f"write {', '.join(WRITTEN_ENDINGS)}, or give the image to patch with --image",
        )


def _write(
    build: BuildCalibration, made: CalibrationSet, image: Image | None, output: Path, config_path: Path | None, as_json: bool
) -> None:
    from codegen.export.calibration.sets import READERS, differences

    _note_stale([made])
    suffix, layout = output.suffix.lower(), build.layout
    if suffix in READERS:
        title = f"Calibration of the build {layout.build_id}, made by codegen"
        content, what = READERS[suffix].write(made.values, layout, title), f"{len(layout.objects)} objects"
    elif suffix == ".toml":
        from codegen.export.calibration.convert import toml_of

        config = toml_of(made.values, build, config_path)
        content, what = config.text.encode("utf-8"), f"{len(config.changed)} keys changed"
        if any(each.object in layout.map_objects for each in differences(build.values, made.values, layout)):
            console.note("the map of the set is not that of the build; write it as .npz")
    elif suffix == ".npz":
        from codegen.export.calibration.convert import map_of
        from codegen.map_file import map as npz

        written = map_of(made.values, build, output)
        content, what = npz.to_bytes(written.map), "the map of the set"
        for name in written.lost:
            console.note(f"{name} is changed outside of the breakpoints of the map as well; a build extends the map anew")
    else:
        assert image is not None  # see _refuse
        content, what = image.patched(made.values), f"{image.format} image"
    write_atomically(output, content)
    checksum = int(made.values[layout.checksum.name])
    changed = [each.object.name for each in differences(build.values, made.values, layout)]
    if as_json:
        console.print_json(
            {"output": str(output), "build": str(build.folder), "changed": changed, "checksum": f"0x{checksum:08X}"}
        )
        return
    console.say(f"{output}: {what}, {len(changed)} other than in the build; checksum 0x{checksum:08X}")


def _note_stale(sets: list[CalibrationSet]) -> None:
    for each in sets:
        if each.stale_checksum:
            console.note(f"{each.name} has a checksum that does not belong to its values; it is replaced")


def _list(build: BuildCalibration, values: Values, as_json: bool) -> None:
    from codegen.export.calibration.labels import number_text, python_numbers

    objects = build.layout.objects
    if as_json:
        console.print_json({"build": str(build.folder), "values": {name: python_numbers(values[name]) for name in objects}})
        return
    rows = []
    for name, each in objects.items():
        numbers = values[name]
        shown = number_text(numbers[()]) if numbers.ndim == 0 else f"{numbers.min():.4g} to {numbers.max():.4g}"
        rows.append((name, " x ".join(map(str, reversed(each.shape))) or "1", shown, each.unit))
    console.say(text_table(("", "size", "value", "unit"), rows, left=1))


def _compare(build: BuildCalibration, first: CalibrationSet, second: CalibrationSet, plot: Path | None, as_json: bool) -> None:
    from codegen.export.calibration.sets import differences

    found = differences(first.values, second.values, build.layout)
    if not found and plot is not None:
        console.note(f"{plot} is not written: nothing differs")
        plot = None
    if plot is not None:
        _draw(build, found, (first, second), plot)
    if as_json:
        entries: list[dict[str, Any]] = [
            {
                "name": each.object.name,
                "unit": each.object.unit,
                "numbers": each.count,
                "first": each.first,
                "second": each.second,
                "at": list(each.at),
            }
            for each in found
        ]
        console.print_json(
            {"first": first.name, "second": second.name, "differences": entries, "plot": None if plot is None else str(plot)}
        )
        return
    console.say(f"first:  {first.name}\nsecond: {second.name}\n")
    if not found:
        console.say("no difference")
        return
    rows = [
        (
            each.object.name,
            str(each.count),
            f"{each.first:.6g}",
            f"{each.second:.6g}",
            f"{each.second - each.first:+.3g}",
            each.object.unit,
            _place(build, each),
        )
        for each in found
    ]
    console.say(text_table(("", "numbers", "first", "second", "difference", "unit", "largest at"), rows))
    if plot is not None:
        console.say(f"\nplot: {plot}")


def _place(build: BuildCalibration, difference: Difference) -> str:
    """Return the place of the largest difference: breakpoints with units, or the number of a breakpoint."""
    if difference.object.kind == "AXIS":
        return f"breakpoint {difference.at[0]:g}"
    units = [build.layout.objects[name].unit for name in difference.object.axes]
    return ", ".join(f"{value:.4g} {unit}" for value, unit in zip(difference.at, units, strict=True))


def _draw(build: BuildCalibration, found: list[Difference], sets: tuple[CalibrationSet, CalibrationSet], plot: Path) -> None:
    """Draw values and curves that differ, and the maps if one of their objects does."""
    from codegen.export.calibration.convert import map_of
    from codegen.export.calibration.sets import curves_of
    from codegen.report.calibration_plots import CurveChange, ValueChange, calibration_figure
    from codegen.report.style import save

    first, second = sets
    with console.status("drawing"):
        values = [
            ValueChange(each.object.name, each.object.unit, each.first, each.second)
            for each in found
            if each.object.kind == "VALUE"
        ]
        curves = [CurveChange(*each) for each in curves_of(found, first.values, second.values, build.layout)]
        maps = None
        if any(each.object in build.layout.map_objects for each in found):
            maps = map_of(first.values, build, first.name).map, map_of(second.values, build, second.name).map
        save(calibration_figure(values, curves, maps, (first.name, second.name)), plot)
