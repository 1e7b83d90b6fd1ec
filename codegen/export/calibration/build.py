"""The calibration of a build: its own values, and the checks of the build's own C for any other values.

The C is compiled with its calibration in writable memory. `<prefix>_parameters_valid`, `<prefix>_selftest` and the checksum are
those of the generated code, so this module repeats none of their rules.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config, parse
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.objects import CalibrationObject, Layout, Numbers, Values
from codegen.errors import BuildError, CodegenError
from codegen.sil.compile import DEFAULT_FLAGS, Library, compile_library
from codegen.sil.software import writable_flags

_HEADER, _SOURCE = "calibration/objects.h", "calibration/objects.c"

_using = threading.RLock()
"""Held while values are written and checked: they are global in the library, of which a process has only one."""


@dataclass(frozen=True, eq=False)
class BuildCalibration:
    """A build with its calibration.

    Attributes:
        folder: folder of the build.
        manifest: its manifest.
        layout: its calibration objects.
        values: its own values, with the checksum that belongs to them.
        edited: files of the build that were changed after generation.
    """

    folder: Path
    manifest: Mapping[str, Any]
    layout: Layout
    values: Values
    edited: tuple[str, ...]
    _library: Library

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Compile a build and read its values. Raises BuildError: no build, no compiler, or its own values are rejected."""
        manifest = read_build(folder)
        layout = Layout.of(manifest, folder)
        files = read_files(folder, manifest, ("include/", "src/"))
        public = [path for path in files if path.startswith("include/") and not path.endswith("_sections.h")]
        sources = {**files, **_access(layout, public)}
        library = compile_library(
            f"{layout.prefix}_calibration",
            sources,
            [*public, _HEADER],
            include_folders=("include", "calibration"),
            flags=(*DEFAULT_FLAGS, *writable_flags(layout.prefix)),
        )
        values: Values = {}
        with _using:
            for index, each in enumerate(layout.objects.values()):
                values[each.name] = each.physical_values(_memory(library, index, each).copy())
        own = cls(folder, manifest, layout, values, tuple(verify_hashes(folder)), library)
        own.check(values, {})
        return own

    @property
    def config(self) -> Config:
        """Configuration of the build."""
        return parse(self.manifest["configuration"], "manifest.json: configuration")

    def check(self, values: Values, origins: Mapping[str, object]) -> None:
        """Check a complete set, and set its checksum to that of the C.

        Args:
            values: values of all objects; the checksum in it is replaced.
            origins: file of each value that is not the build's own.

        Raises:
            CodegenError: the build rejects the set. The message names the object.
        """
        for name, each in self.layout.objects.items():
            if fault := _fault(each, values[name]):
                raise CodegenError(fault, where=_where(origins, name), remedy="correct the value")
        with self._written(values):
            if not self._is_valid():
                raise self._conflict(values, origins)
            checksum = self.layout.checksum
            values[checksum.name] = np.array(self._function("calibration_checksum")(), dtype=checksum.dtype)
            self._write({checksum.name: values[checksum.name]})
            if not self._function("selftest")():
                raise BuildError("the self-test of the build fails with these values", where=self.folder, remedy="build again")

    def looked_up(
        self, values: Values, speed: Numbers, front_angle: Numbers, road: Sequence[float], *, with_rear_angle: bool
    ) -> list[FloatArray]:
        """Return the yaw rates (n, m) in rad/s, and the rear angles in rad if wanted, that the C looks up with a valid set.

        Args:
            speed: (n,) m/s. front_angle: (m,) rad. road: further arguments of the lookup.
            with_rear_angle: whether the kind of controller looks up rear angles.
        """
        with self._written(values):
            if with_rear_angle:
                reference = self._function("map_reference")
                found = [[reference(v, angle, *road) for angle in front_angle] for v in speed]
                return [
                    np.array([[getattr(each, name) for each in row] for row in found]) for name in ("yaw_rate", "rear_angle")
                ]
            yaw_rate = self._function("map_yaw_rate_on_road")
            return [np.array([[yaw_rate(v, angle, *road) for angle in front_angle] for v in speed])]

    def _conflict(self, values: Values, origins: Mapping[str, object]) -> CodegenError:
        """Return the error for values that are valid alone, but not together."""
        first, *others = self._conflicts(values)
        with_others = f", together with {', '.join(others[:3])}" if others else ""
        rejects = f"{self.layout.prefix}_parameters_valid() of the build rejects the set"
        conditions = self._conditions(first)
        if self.layout.objects[first] in self.layout.map_objects:
            conditions = ["axes from zero, and even ones to stay even to a hundredth of a step"]
        remedy = f"it requires {' and '.join(conditions)}" if conditions else "change the values together"
        what = f"{_shown(values[first])} conflicts with other values{with_others}: {rejects}"
        return CodegenError(what, where=_where(origins, first), remedy=remedy)

    def _conditions(self, name: str) -> list[str]:
        """Return the conditions of the build between a parameter and others."""
        path = self.layout.objects[name].link.removeprefix(f"{self.layout.prefix}_parameters_default.")
        return [str(each) for each in self.layout.conditions if path in (each.left, each.right)]

    def _conflicts(self, values: Values) -> list[str]:
        """Return the objects whose values cause a rejection: each one alone, as far as one alone does."""
        own = self.values
        changed = [name for name in own if name != self.layout.checksum.name and not np.array_equal(own[name], values[name])]

        def is_valid_with(base: Values, name: str, value: Numbers) -> bool:
            self._write({**base, name: value})
            return self._is_valid()

        remedies = [name for name in changed if is_valid_with(values, name, own[name])]
        causes = [name for name in changed if not is_valid_with(own, name, values[name])]
        return remedies or causes or changed or [self.layout.checksum.name]

    def _is_valid(self) -> bool:
        return bool(self._function("parameters_valid")(self._library.lib.calibration_parameters()))

    def _function(self, name: str) -> Any:
        return getattr(self._library.lib, f"{self.layout.prefix}_{name}")

    @contextmanager
    def _written(self, values: Values) -> Iterator[None]:
        with _using:
            try:
                self._write(values)
                yield
            finally:
                self._write(self.values)

    def _write(self, values: Values) -> None:
        for index, each in enumerate(self.layout.objects.values()):
            if each.name in values:
                _memory(self._library, index, each)[...] = each.raw(values[each.name])


def _access(layout: Layout, headers: list[str]) -> dict[str, bytes]:
    """Return C that gives the address and size of each object, in the order of the layout, and the parameters."""
    includes = "".join(f'#include "{Path(path).name}"\n' for path in headers)
    links = [each.link for each in layout.objects.values()]
    parameters = f"const {layout.prefix}_parameters_t *calibration_parameters(void)"
    header = f"""{includes}
void *calibration_object(unsigned k);
unsigned calibration_bytes(unsigned k);
{parameters};
"""
    source = f"""#include "objects.h"
static void *const objects[] = {{ {", ".join(f"(void *)&({link})" for link in links)} }};
static const unsigned bytes[] = {{ {", ".join(f"sizeof({link})" for link in links)} }};
void *calibration_object(unsigned k) {{ return objects[k]; }}
unsigned calibration_bytes(unsigned k) {{ return bytes[k]; }}
{parameters} {{ return &{layout.prefix}_parameters_default; }}
"""
    return {_HEADER: header.encode(), _SOURCE: source.encode()}


def _memory(library: Library, index: int, each: CalibrationObject) -> Numbers:
    """Return a view of an object in the memory of the library. Raises BuildError if its size in C is another one."""
    size = library.lib.calibration_bytes(index)
    if size != each.bytes:
        raise BuildError(f"{size} bytes in C, {each.bytes} in the manifest", where=each.name, remedy="build again")
    view: Numbers = np.frombuffer(library.ffi.buffer(library.lib.calibration_object(index), size), dtype=each.stored)
    return view.reshape(each.shape)


def _fault(each: CalibrationObject, values: Numbers) -> str:
    """Return the first fault that an object has alone, or ""."""
    slack = 0.49 * (each.scale or 0.0)  # raw numbers are rounded to whole steps
    low, high = each.dtype.type(each.low - slack), each.dtype.type(each.high + slack)
    unit = f" {each.unit}" if each.unit else ""
    outside = ~((values >= low) & (values <= high))  # true for NaN
    if outside.any():
        at = np.argwhere(outside)[0]
        place = f" at {list(map(int, at))}" if at.size else ""
        return f"{float(values[tuple(at)]):.9g}{place} is outside {each.low:.9g} to {each.high:.9g}{unit}"
    if each.kind == "AXIS" and (steps := np.flatnonzero(np.diff(values) <= 0)).size:
        k = int(steps[0]) + 1
        return f"breakpoint {k} ({float(values[k]):.9g}{unit}) is not above the one before it ({float(values[k - 1]):.9g})"
    return ""


def _shown(values: Numbers) -> str:
    return f"{float(values):.9g}" if values.ndim == 0 else f"one of its {values.size} values"


def _where(origins: Mapping[str, object], name: str) -> str:
    return f"{origins[name]}: {name}" if name in origins else name
