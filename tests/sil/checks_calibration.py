"""Checks of a map that calibration changes in memory.

Each check takes a build with writable calibration in its original state and raises AssertionError if the build fails it.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import AxisConstants, Lookup
from codegen.ecu_map.storage import Axis
from codegen.sil.compile import Library

RANGES = {
    "yaw_rate_table": (0.0, 10.0),
    "rear_angle_table": (-0.5, 0.5),
    "speed_breakpoints": (0.0, 150.0),
    "front_angle_breakpoints": (0.0, 1.2),
}
"""rad/s, rad, m/s, rad: ranges of the reference map, docs/interface.md."""
ALL_MAX = 500
"""Number of elements up to which every element of a table is tested."""


# Linkers place a section of this name in writable data although its objects are const.
WRITABLE = '-DARS_SECTION_CALIBRATION=__attribute__((section(".data.calibration")))'
AXES = ("speed", "front_angle")
NAMES = ("speed_breakpoints", "front_angle_breakpoints", "yaw_rate_table", "rear_angle_table")


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A compiled build with writable calibration.

    Attributes:
        arrays: calibration section by the names in C without prefix: breakpoints and tables, writable in place.
        total: map of the build.
    """

    library: Library
    arrays: dict[str, npt.NDArray[np.float32]]
    total: TotalMap

    @classmethod
    def over(cls, library: Library, total: TotalMap) -> Self:
        """Return the build of a library that was compiled with `WRITABLE`."""
        found = {}
        for name in NAMES:
            if hasattr(library.lib, f"ars_map_{name}"):
                whole = getattr(library.lib, f"ars_map_{name}")
                buffer = library.ffi.buffer(library.ffi.addressof(whole), library.ffi.sizeof(whole))
                found[name] = np.frombuffer(buffer, dtype=np.float32).reshape(_shape(name, total))
        return cls(library, found, total)

    def restored(self) -> Self:
        """Return the build after restoring its original numbers."""
        lookup = Lookup.from_map(self.total, np.float32)
        tables = {"yaw_rate_table": lookup.tables, "rear_angle_table": lookup.rear_tables}
        for axis, constants in zip(AXES, (lookup.speed_axis, lookup.front_axis), strict=True):
            tables[f"{axis}_breakpoints"] = constants.table
        for name, array in self.arrays.items():
            array[...] = tables[name]
        return self

    def is_valid(self) -> bool:
        """Return the C's verdict on the map; it must be the same for the map with parameters that accept any speed."""
        of_map = bool(self.library.lib.ars_map_valid())
        parameters = self.library.ffi.new("ars_parameters_t *", self.library.lib.ars_parameters_default)
        parameters.inputs.speed_max = parameters.limiter.speed_max = RANGES["speed_breakpoints"][1]
        assert bool(self.library.lib.ars_parameters_valid(parameters)) == of_map
        return of_map

    def axis(self, name: str) -> Axis:
        """Return the build's axis, which has its kind."""
        return Axis.from_breakpoints(self.total.speed if name == "speed" else self.total.front_angle)

    @property
    def lookup(self) -> Lookup:
        """Return the reference for the current memory."""
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


def check_each_number_of_the_tables(built: Calibrated) -> None:
    """Check that each table element accepts the ends of its range, and neither one bit beyond nor NaN.

    Of a large table, the elements at its edges and some inside are tested.
    """
    for name in ("yaw_rate_table", "rear_angle_table"):
        if name not in built.arrays:
            continue
        numbers = built.arrays[name].reshape(-1)
        low, high = (np.float32(bound) for bound in RANGES[name])
        below, above = np.nextafter(low, np.float32(-np.inf)), np.nextafter(high, np.float32(np.inf))
        for k in _cells(built.arrays[name].shape):
            kept = numbers[k]
            for value, wanted in ((low, True), (high, True), (below, False), (above, False), (np.nan, False)):
                numbers[k] = value
                assert built.is_valid() == wanted, (name, k, value)
            numbers[k] = kept


def _cells(shape: tuple[int, ...]) -> list[int]:
    """Return flat indices into a table of shape (layers, rows, columns)."""
    places = np.arange(int(np.prod(shape))).reshape(shape)
    if places.size <= ALL_MAX:
        return [int(place) for place in places.ravel()]
    inside = np.random.default_rng(5).choice(places.ravel(), 40, replace=False)
    edges = [places[:, ::9, 0], places[:, ::9, -1], places[:, 0, ::9], places[:, -1, ::9], places[:, -1, -1], inside]
    return [int(place) for place in np.unique(np.concatenate([each.ravel() for each in edges]))]


def check_each_breakpoint_is_above_the_one_before(built: Calibrated) -> None:
    """Check that equal, NaN and out-of-range breakpoints are rejected at every index, as is a first one above zero.

    An axis that is scaled keeps its kind: with half the steps it is valid, up to its range and not beyond.
    """
    for name in AXES:
        points = built.arrays[f"{name}_breakpoints"]
        kept, (low, high) = points.copy(), RANGES[f"{name}_breakpoints"]
        for k in range(points.size):
            wrong = [np.nan, np.float32(high) * np.float32(1.01), np.float32(low) - np.float32(0.01)]
            for value in wrong + ([points[k - 1]] if k else []):
                points[k] = value
                assert not built.is_valid(), (name, k, value)
                points[...] = kept
        points[0] = np.float32(1e-6)
        assert not built.is_valid(), name
        points[...] = kept
        if built.axis(name).has_first_cell:  # zero width: the core begins at zero too, and is even
            points[1:] = np.linspace(0.0, float(kept[-1]), points.size - 1, dtype=np.float32)
            assert not built.is_valid(), name
            points[...] = kept
        for scale, wanted in ((0.5, True), (high / kept[-1], True), (1.001 * high / kept[-1], False)):
            points[...] = np.minimum(np.float32(scale) * kept, np.float32(high)) if wanted else np.float32(scale) * kept
            assert built.is_valid() == wanted, (name, scale)
            points[...] = kept


def check_even_axes_stay_even(built: Calibrated) -> None:
    """Check that a breakpoint of an even core may deviate by less than a hundredth of a step.

    A core that ends elsewhere has other steps. An uneven axis is free. The margin of half a percent covers rounding, which is
    some 1e-5 steps for 0.6 rad in steps of 0.1 deg and for 33 m/s in steps of 1 km/h.
    """
    for name in AXES:
        axis, points = built.axis(name), built.arrays[f"{name}_breakpoints"]
        for k in range(1, points.size - 1):
            inside = axis.even and axis.core_start < k < axis.core_end
            kept, step = points[k], axis.step if axis.even else 0.0
            for share, wanted in ((0.00995, True), (-0.00995, True), (0.01005, False), (-0.01005, False)):
                if inside:
                    points[k] = kept + np.float32(share * step)
                    assert built.is_valid() == wanted, (name, k, share)
            if not axis.even:
                points[k] = np.float32(0.5) * (points[k - 1] + kept)
                assert built.is_valid(), (name, k)
            points[k] = kept
        for end in (axis.core_start, axis.core_end) if axis.even else ():
            kept = points[end]
            points[end] += np.float32(0.02 * axis.step if end else 0.0)
            assert built.is_valid() == (end == 0), (name, end)
            points[end] = kept


def check_even_to_the_bit(built: Calibrated) -> None:
    """Check that a deviation of exactly a hundredth of a step, in the C's own numbers, is still even, on both sides."""
    axis, points = built.axis("front_angle"), built.arrays["front_angle_breakpoints"]
    if not axis.even:
        return
    kept, cells = points.copy(), axis.core_end - axis.core_start
    first = np.float32(0.125 if axis.core_start else 0.0)
    last = np.float32(0.5)
    while True:  # about one end in several hundred is free of rounding
        last = np.nextafter(last, np.float32(1.0))
        step = (last - first) / np.float32(cells)
        tolerance = np.float32(0.01) * step
        places = [first + (step + off) for off in (tolerance, -tolerance)]
        if [(place - first) - step for place in places] == [tolerance, -tolerance]:
            break
    points[axis.core_start : axis.core_end + 1] = first + step * np.arange(cells + 1, dtype=np.float32)
    points[axis.core_end] = last
    points[axis.core_end + 1 :] = last + np.float32(0.1)
    for place in places:
        points[axis.core_start + 1] = place
        assert built.is_valid()
    points[axis.core_start + 1] = np.nextafter(places[0], np.float32(1.0))
    assert not built.is_valid()
    points[...] = kept


def check_the_lookup_takes_what_stands_there(built: Calibrated) -> None:
    """Check that the C has the bits of the reference for other numbers and other breakpoints of the same kind."""
    rng = np.random.default_rng(7)
    for _ in range(5):
        built.restored()
        built.arrays["yaw_rate_table"][...] = rng.uniform(0.0, 0.3, built.arrays["yaw_rate_table"].shape)
        for name in AXES:
            points = built.arrays[f"{name}_breakpoints"]
            points[...] = np.float32(rng.uniform(0.5, 1.2)) * points
            if built.axis(name).has_last_cell:
                points[-1] = points[-2] + np.float32(rng.uniform(0.2, 1.0)) * (points[-1] - points[-2])
        assert built.is_valid()
        lookup = built.lookup
        speed = rng.uniform(0.0, 1.2 * float(lookup.speed_axis.top), 400).astype(np.float32)
        angle = rng.uniform(-1.2, 1.2, 400).astype(np.float32) * lookup.front_axis.top
        for axis, values in ((lookup.speed_axis, speed), (lookup.front_axis, angle)):
            values[: axis.table.size] = axis.table
        wanted = lookup(speed, angle)
        found = [built.library.lib.ars_map_yaw_rate(*pair) for pair in zip(speed.tolist(), angle.tolist(), strict=True)]
        np.testing.assert_array_equal(np.array(found, dtype=np.float32), wanted)


def check_parameters_judge_the_map_too(built: Calibrated) -> None:
    """Check that `ars_parameters_valid` agrees with `ars_map_valid` where the parameters are valid; see
    `Calibrated.is_valid`."""
    assert built.is_valid()
    built.arrays["yaw_rate_table"].reshape(-1)[0] = np.nan
    assert not built.is_valid()
