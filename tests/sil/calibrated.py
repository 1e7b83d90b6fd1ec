"""A build whose calibration section can be written: what a calibration tool does to an ECU's memory."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from codegen.refmap.axis import Axis
from codegen.refmap.extend import TotalMap
from codegen.refmap.lookup import AxisConstants, Lookup
from codegen.sil.compile import Library

# Of a name that linkers put among the data that may be written, though each object is const.
WRITABLE = '-DARS_SECTION_CALIBRATION=__attribute__((section(".data.calibration")))'
AXES = ("speed", "front_angle")
NAMES = ("speed_breakpoints", "front_angle_breakpoints", "yaw_rate_table", "rear_angle_table")


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A compiled build.

    Attributes:
        arrays: the calibration section by the names in C without prefix: breakpoints and tables, to be written in place.
        total: the map that it was built with.
    """

    library: Library
    arrays: dict[str, npt.NDArray[np.float32]]
    total: TotalMap

    @classmethod
    def over(cls, library: Library, total: TotalMap) -> Self:
        """A library that was compiled with `WRITABLE`."""
        found = {}
        for name in NAMES:
            if hasattr(library.lib, f"ars_map_{name}"):
                whole = getattr(library.lib, f"ars_map_{name}")
                buffer = library.ffi.buffer(library.ffi.addressof(whole), library.ffi.sizeof(whole))
                found[name] = np.frombuffer(buffer, dtype=np.float32).reshape(_shape(name, total))
        return cls(library, found, total)

    def restored(self) -> Self:
        """With the numbers of the build again."""
        lookup = Lookup.from_map(self.total, np.float32)
        tables = {"yaw_rate_table": lookup.tables, "rear_angle_table": lookup.rear_tables}
        for axis, constants in zip(AXES, (lookup.speed_axis, lookup.front_axis), strict=True):
            tables[f"{axis}_breakpoints"] = constants.table
        for name, array in self.arrays.items():
            array[...] = tables[name]
        return self

    def is_valid(self) -> bool:
        """What the C says of the map and, which must be the same, of the map and the default parameters."""
        of_map = bool(self.library.lib.ars_map_valid())
        parameters = self.library.ffi.new("ars_parameters_t *", self.library.lib.ars_parameters_default)
        assert bool(self.library.lib.ars_parameters_valid(parameters)) == of_map
        return of_map

    def axis(self, name: str) -> Axis:
        """Of the build: which kind it is."""
        return Axis.from_breakpoints(self.total.speed if name == "speed" else self.total.front_angle)

    @property
    def lookup(self) -> Lookup:
        """The reference of what the memory holds now."""
        axes: dict[str, Any] = {}
        for name in AXES:
            breakpoints = self.arrays[f"{name}_breakpoints"].astype(np.float64)
            axes[name] = AxisConstants(replace(self.axis(name), breakpoints=breakpoints), np.float32)
        built = Lookup.from_map(self.total, np.float32)
        tables = self.arrays["yaw_rate_table"].reshape(built.tables.shape)
        return replace(built, speed_axis=axes["speed"], front_axis=axes["front_angle"], tables=tables)


def _shape(name: str, total: TotalMap) -> tuple[int, ...]:
    if name.endswith("breakpoints"):
        return (total.speed.size if name.startswith("speed") else total.front_angle.size,)
    return (len(total.stack), total.speed.size, total.front_angle.size)
