"""Calibration data of a build: read, check, compare, convert, and patch into an image."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from codegen.arrays import AnyArray
from codegen.emit.folder import check_output
from codegen.errors import CodegenError
from codegen.export.calibration.build import BuildCalibration
from codegen.export.calibration.convert import map_of, toml_of
from codegen.export.calibration.images import Image
from codegen.export.calibration.labels import number_text, python_numbers
from codegen.export.calibration.sets import CALIBRATION_READERS, CalibrationSet, Difference, curves_of, differences, merged
from codegen.figures.draw import draw
from codegen.files import write_atomically
from codegen.library.builds import BuildLike, edited_notes, folder_of
from codegen.library.logs import paths_of
from codegen.library.result import PathLike, Progress, Result, Work, drawn, path_of, public
from codegen.map_file import map as npz
from codegen.report.calibration_plots import CurveChange, ValueChange, calibration_picture
from codegen.text import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SET_ENDINGS = (".dcm", ".cdfx")
WRITTEN_ENDINGS = (*SET_ENDINGS, ".toml", ".npz")
IMAGE_ENDINGS = (".elf", ".s19", ".hex")


class Calibration(Result):
    """A set of calibration data, checked with the build's own C.

    Without a file and an image it lists the values of the build. One file is compared with them, or with those of the image;
    two files are compared with each other.

    Attributes:
        values: name of each object -> its values, all files merged in their order.
        changed: names of the objects with other values than the build's.
        checksum: of the calibration.
    """

    def __init__(self, build: BuildCalibration, image: Image | None, files: Sequence[Path]) -> None:
        self._build, self._image = build, image
        base, name = (build.values, "build") if image is None else (image.read(), image.path.name)
        self._merged = merged(build, base, name, files)
        sets = [merged(build, base, name, files[k : k + 1]) for k in range(max(len(files), 1))]
        if len(sets) == 1 and (files or image):
            sets = [merged(build, base, name, ()) if files else merged(build, build.values, "build", ()), *sets]
        self._sets = sets
        self._edited = edited_notes(build.folder, tuple(build.edited))
        self.notes = (*self._edited, *_stale_notes(sets))
        layout = build.layout
        self.values: dict[str, AnyArray] = {name: self._merged.values[name] for name in layout.objects}
        self.changed = tuple(each.object.name for each in differences(build.values, self._merged.values, layout))
        self.checksum = int(self._merged.values[layout.checksum.name])
        self._found = differences(sets[0].values, sets[1].values, layout) if len(sets) == 2 else []
        self._written: tuple[Path, str] | None = None

    def save(self, path: PathLike, config: PathLike | None = None) -> None:
        """Write the set in the format of the extension: .dcm, .cdfx, .toml (ars.toml), .npz (its map), or the patched image.

        Args:
            path: the file to write.
            config: for .toml: the ars.toml whose keys are replaced.

        Raises:
            CodegenError: there is no such format, or it cannot be written.
        """
        place = path_of(path, "the path of a set")
        values, build = self._merged.values, self._build
        suffix, layout = place.suffix.lower(), build.layout
        check_output(place, suffix)
        self.notes = (*self._edited, *_stale_notes([self._merged]))
        if suffix in CALIBRATION_READERS:
            title = f"Calibration of the build {layout.build_id}, made by codegen"
            content, what = CALIBRATION_READERS[suffix].write(values, layout, title), f"{len(layout.objects)} objects"
        elif suffix == ".toml":
            written = toml_of(values, build, None if config is None else path_of(config, "the path of an ars.toml"))
            content, what = written.text.encode("utf-8"), f"{len(written.changed)} keys changed"
            if any(each.object in layout.map_objects for each in differences(build.values, values, layout)):
                self.notes += ("the map of the set is not that of the build; write it as .npz",)
        elif suffix == ".npz":
            own = map_of(values, build, place)
            content, what = npz.to_bytes(own.map), "the map of the set"
            outside = "is changed outside of the breakpoints of the map as well; a build extends the map anew"
            self.notes += tuple(f"{name} {outside}" for name in own.lost)
        elif self._image is not None:
            content, what = self._image.patched(values), f"{self._image.format} image"
        else:
            raise no_format(place)
        write_atomically(place, content)
        self._written = place, what

    def plot(self, path: PathLike | None = None) -> Figure | None:
        """Draw values and curves that differ, and the maps if one of their objects does; None if nothing does."""
        figure = self._figure()
        if figure is None:
            self.notes += (f"{path} is not written: nothing differs",) if path is not None else ()
            return None
        return drawn(figure, path)

    def _figure(self) -> Figure | None:
        if not self._found:
            return None
        (first, second), build, found = self._sets, self._build, self._found
        values = [
            ValueChange(each.object.name, each.object.unit, each.first, each.second)
            for each in found
            if each.object.kind == "VALUE"
        ]
        curves = [CurveChange(*each) for each in curves_of(found, first.values, second.values, build.layout)]
        maps = None
        if any(each.object in build.layout.map_objects for each in found):
            maps = map_of(first.values, build, first.name).map, map_of(second.values, build, second.name).map
        return draw(calibration_picture(values, curves, maps, (first.name, second.name)))

    def lines(self) -> Iterator[str]:
        """Yield what was written, else the differences, else the values."""
        if self._written is not None:
            path, what = self._written
            yield f"{path}: {what}, {len(self.changed)} other than in the build; checksum 0x{self.checksum:08X}"
        elif len(self._sets) == 1:
            yield text_table(("", "size", "value", "unit"), list(self._value_rows()), left=1)
        else:
            yield f"first:  {self._sets[0].name}\nsecond: {self._sets[1].name}\n"
            header = ("", "numbers", "first", "second", "difference", "unit", "largest at")
            yield text_table(header, [self._row(each) for each in self._found]) if self._found else "no difference"

    def _value_rows(self) -> Iterator[tuple[str, ...]]:
        for name, each in self._build.layout.objects.items():
            numbers = self.values[name]
            shown = number_text(numbers[()]) if numbers.ndim == 0 else f"{numbers.min():.4g} to {numbers.max():.4g}"
            yield name, " x ".join(map(str, reversed(each.shape))) or "1", shown, each.unit

    def _row(self, each: Difference) -> tuple[str, ...]:
        numbers = f"{each.first:.6g}", f"{each.second:.6g}", f"{each.second - each.first:+.3g}"
        return each.object.name, str(each.count), *numbers, each.object.unit, self._place(each)

    def _place(self, difference: Difference) -> str:
        """Return the place of the largest difference: breakpoints with units, or the number of a breakpoint."""
        if difference.object.kind == "AXIS":
            return f"breakpoint {difference.at[0]:g}"
        units = [self._build.layout.objects[name].unit for name in difference.object.axes]
        return ", ".join(f"{value:.4g} {unit}" for value, unit in zip(difference.at, units, strict=True))

    def to_dict(self) -> dict[str, Any]:
        """Return the same."""
        folder = str(self._build.folder)
        if self._written is not None:
            facts = {"output": str(self._written[0]), "build": folder}
            return {**facts, "changed": list(self.changed), "checksum": f"0x{self.checksum:08X}"}
        if len(self._sets) == 1:
            return {"build": folder, "values": {name: python_numbers(numbers) for name, numbers in self.values.items()}}
        entries = [
            {
                "name": each.object.name,
                "unit": each.object.unit,
                "numbers": each.count,
                "first": each.first,
                "second": each.second,
                "at": list(each.at),
            }
            for each in self._found
        ]
        return {"first": self._sets[0].name, "second": self._sets[1].name, "differences": entries}


def _stale_notes(sets: Sequence[CalibrationSet]) -> Iterator[str]:
    for each in sets:
        if each.stale_checksum:
            yield f"{each.name} has a checksum that does not belong to its values; it is replaced"


def no_format(path: Path) -> CodegenError:
    """Return the error for a set or an image in no known format."""
    return CodegenError(
        f"{path.suffix.lower() or 'a name without extension'} is not a format of calibration data",
        where=path,
        remedy=f"write {', '.join(WRITTEN_ENDINGS)}, or give the image to patch with `image=`",
    )


@public
def calibrate(
    build: BuildLike,
    files: PathLike | Sequence[PathLike] = (),
    *,
    image: PathLike | None = None,
    addresses: PathLike | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Read calibration data as DCM 2.0 or CDF 2.0 (.cdfx), and check them with the build's own C.

    Args:
        build: a build, or the path of its folder.
        files: sets, which are merged over the values of the build, or of the image, in their order.
        image: start from the values in an ELF, S-record or Intel HEX image.
        addresses: for S-record and Intel HEX: the program's ELF, or its A2L.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: a file cannot be read, or the C rejects its values.
    """
    folder, places = folder_of(build), paths_of(files, "a set")
    elf = None if addresses is None else path_of(addresses, "an ELF or A2L")
    with Work(progress).status(f"compiling {folder}"):
        compiled = BuildCalibration.load(folder)
        start = None if image is None else Image.load(path_of(image, "an image"), elf, folder, compiled.layout)
        return Calibration(compiled, start, places)
