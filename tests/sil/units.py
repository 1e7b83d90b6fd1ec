"""The units of a build that stand alone - map, limiter, reference model - compiled without the rest, with calls over arrays.

Arrays go in and out as they are in memory, so that any bit pattern arrives: a signalling NaN that passes through a Python float
does not.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.config import Config
from codegen.emit.folder import Folder
from codegen.emit.text import Precision, c_type, numpy_type
from codegen.refmap import map as refmap
from codegen.refmap.extend import TotalMap, extend
from codegen.refmap.lookup import Lookup
from codegen.refmap.map import ReferenceMap
from codegen.refmap.stack import solve_stack
from codegen.sil.compile import Library, compile_library
from tests import builds
from tests.sil import relinked
from tests.sil.probe import DECLARATIONS, DEFINITIONS

RealArray = npt.NDArray[Any]
UNITS = ("map", "limiter", "reference_model")


@dataclass(frozen=True, eq=False)
class Units:
    """The units of a build in memory, compiled when first called.

    Attributes:
        folder: the generated files. total: the map that they hold. config: what they were made for.
        only: the units to compile.
    """

    folder: Folder
    total: TotalMap
    config: Config
    only: tuple[str, ...] = UNITS

    @property
    def precision(self) -> Precision:
        precision: Precision = self.folder.manifest["options"]["precision"]
        return precision

    @property
    def real(self) -> Any:
        """NumPy type of the numbers."""
        return numpy_type(self.precision)

    @property
    def eps(self) -> float:
        """Spacing of the numbers at 1."""
        return float(np.finfo(self.real).eps)

    @functools.cached_property
    def lookup(self) -> Lookup:
        """The NumPy reference of the map."""
        return Lookup.from_map(self.total, self.real)

    @property
    def sources(self) -> tuple[dict[str, bytes], list[str]]:
        """The files of the units with the loops of this module; and the headers that Python calls."""
        public = [f"include/ars_{unit}.h" for unit in self.only]
        numbers = ("calibration",) if "map" in self.only else ()  # those of the map; they stand with the parameters'
        headers = [path for path in self.folder.files if path.startswith("include/")]
        names = [*headers, *(f"src/ars_{unit}.c" for unit in (*self.only, *numbers))]
        sources = {name: self.folder.files[name] for name in names}
        includes = "".join(f'#include "ars_{unit}.h"\n' for unit in self.only)
        real = c_type(self.precision)
        header = "#include <stdint.h>\n" + includes + "".join(DECLARATIONS[unit] for unit in self.only)
        source = '#include "probe.h"\n#include <string.h>\n' + "".join(DEFINITIONS[unit] for unit in self.only)
        probe = {"probe/probe.h": header.replace("REAL", real), "probe/probe.c": source.replace("REAL", real)}
        return sources | {path: text.encode("ascii") for path, text in probe.items()}, [*public, "probe/probe.h"]

    @functools.cached_property
    def library(self) -> Library:
        """The sources, compiled."""
        sources, headers = self.sources
        return compile_library("ars_units", sources, headers, include_folders=("include", "probe"))

    def _in(self, array: Any) -> Any:
        contiguous = np.ascontiguousarray(array, dtype=self.real)
        return self.library.ffi.from_buffer(f"{c_type(self.precision)}[]", contiguous)

    def _out(self, *shape: int) -> tuple[RealArray, Any]:
        array = np.empty(shape, dtype=self.real)
        return array, self.library.ffi.from_buffer(f"{c_type(self.precision)}[]", array, require_writable=True)

    def map_reference(self, speed: Any, front_angle: Any, friction: Any = np.nan) -> RealArray:
        """Rows (4, n) for arrays that broadcast to (n,): yaw rate (rad/s), rear angle (rad), lateral acceleration of the road
        (m/s^2), and the yaw rate (rad/s) of the function that gives nothing else."""
        arrays = np.broadcast_arrays(*(np.asarray(values, dtype=self.real) for values in (speed, front_angle, friction)))
        found, pointer = self._out(arrays[0].size, 4)
        self.library.lib.probe_map(*(self._in(array) for array in arrays), pointer, arrays[0].size)
        return found.T

    def limiter_parameters(self, **changes: Any) -> Any:
        """The limiter's parameters of the build's configuration with some changed; its valid-function decides on them."""
        ffi = self.library.ffi
        parameters = ffi.new("ars_limiter_parameters_t *")
        limiter, inputs, actuator = self.config.limiter, self.config.controller.inputs, self.config.rear_actuator
        rate, angles = limiter.rear_rate_max_deg_s, limiter.opposite_phase_max_deg
        speeds = limiter.opposite_phase_speed_km_h
        values = {
            "rear_angle_max": actuator.angle_max,
            "rear_rate_max": 1000.0 if rate == "off" else np.radians(rate),
            "opposite_phase_speed": [speed / 3.6 for speed in speeds],
            "opposite_phase_max": [actuator.angle_max] * len(speeds) if angles == "off" else np.radians(angles).tolist(),
            "in_phase_from_front_angle": np.radians(limiter.in_phase_from_front_angle_deg),
            "speed_max": inputs.speed_max_km_h / 3.6,
            "front_angle_max": np.radians(inputs.front_angle_max_deg),
        }
        for name, value in (values | changes).items():
            setattr(parameters, name, value)
        return parameters

    def limiter(self, parameters: Any, inputs: Any, start: float = 0.0) -> RealArray:
        """Angles (n,) of a limiter that starts at an angle (rad) and takes inputs (n, 3): speed, front angle, demand."""
        self_ = self.library.ffi.new("ars_limiter_t *")
        self.library.lib.ars_limiter_init(self_, start)
        angles, pointer = self._out(len(inputs))
        self.library.lib.probe_limiter(self_, parameters, self._in(inputs), pointer, len(inputs))
        return angles

    def limiter_from(self, parameters: Any, states: Any, known: Any, inputs: Any) -> RealArray:
        """Angles (n,) after one step each from states (n, 3) of angle, speed, front angle; speed known (n,) or not."""
        angles, pointer = self._out(len(inputs))
        flags = self.library.ffi.from_buffer("uint8_t[]", np.ascontiguousarray(known, dtype=np.uint8))
        self.library.lib.probe_limiter_from(self._in(states), flags, parameters, self._in(inputs), pointer, len(inputs))
        return angles

    def model(self, start: Any, inputs: Any) -> RealArray:
        """States (n, 3) of a reference model that starts in a state (3,) and takes inputs (n, 4)."""
        self_ = self.library.ffi.new("ars_reference_model_t *", tuple(float(value) for value in start))
        states, pointer = self._out(len(inputs), 3)
        self.library.lib.probe_model(self_, self._in(inputs), pointer, len(inputs))
        return states

    def model_from(self, states: Any, inputs: Any) -> RealArray:
        """States (n, 3) after one step each from states (n, 3) with inputs (n, 4)."""
        after, pointer = self._out(len(inputs), 3)
        self.library.lib.probe_model_from(self._in(states), self._in(inputs), pointer, len(inputs))
        return after

    def model_start(self, inputs: Any) -> RealArray:
        """States (n, 3) where the model starts for inputs (n, 3): speed, yaw rate, rear angle."""
        states, pointer = self._out(len(inputs), 3)
        self.library.lib.probe_model_start(self._in(inputs), pointer, len(inputs))
        return states

    def curves(self, x: Any) -> tuple[RealArray, RealArray]:
        """Values of the front and the rear tyre's curve."""
        front, front_pointer = self._out(len(x))
        rear, rear_pointer = self._out(len(x))
        self.library.lib.probe_curves(self._in(x), front_pointer, rear_pointer, len(x))
        return front, rear


def make(reference_map: ReferenceMap, config: Config, precision: Precision = "single", only: tuple[str, ...] = UNITS) -> Units:
    """Render; compile when first called."""
    return Units(builds.render(reference_map, config, precision), extend(reference_map, config), config, only)


@functools.cache
def tracking(precision: Precision = "single") -> Units:
    """The units of `builds.tracking`."""
    return make(builds.paper_map(), builds.TRACKING_CONFIG, precision)


FRICTIONS = (0.3, 0.5, 0.7, 0.9)


def _stack(friction: tuple[float, ...], **changes: Any) -> ReferenceMap:
    config = builds.CONFIG.model_copy(update={"grid": builds.CONFIG.grid.model_copy(update=changes)})
    return solve_stack(config, "4ws-2", friction)


def _rough_stack() -> ReferenceMap:
    """No layer, cell or table can stand in for another."""
    speed, front_angle = np.array([2.0, 3.0, 7.5, 8.0, 21.0, 40.0]), np.array([0.003, 0.01, 0.02, 0.1, 0.11])
    rng = np.random.default_rng(3)
    ceiling = np.minimum(2.0, 19.0 / speed)[:, np.newaxis]  # the map contract allows 2 g
    arrays = {
        "vx": speed,
        "delta_f": front_angle,
        "yaw_rate": rng.uniform(0.02, 1.0, (6, 5)) * ceiling,
        "delta_r": rng.uniform(-0.08, 0.08, (6, 5)),
        "friction": np.array([0.2, 0.21, 0.6]),
        "friction_yaw_rate": rng.uniform(0.02, 1.0, (3, 6, 5)) * ceiling,
        "friction_delta_r": rng.uniform(-0.08, 0.08, (3, 6, 5)),
    }
    return refmap.from_arrays(arrays, "sample")


SMALL = {"speed_points": 21, "front_angle_points": 20}
MAPS: dict[str, Callable[[], ReferenceMap]] = {
    **{name: builds.MAPS[name] for name in ("paper", "uneven", "two points each", "one cell", "rough")},
    "stack": lambda: _stack(FRICTIONS, **SMALL),
    "stack of two, uneven": lambda: _stack(
        (0.4, 0.9), speed_breakpoints_km_h=builds.UNEVEN_SPEED, front_angle_breakpoints_deg=builds.UNEVEN_ANGLE
    ),
    "rough stack": _rough_stack,
}


@functools.cache
def of_map(name: str, precision: Precision) -> Units:
    """The map unit of one of MAPS, with the tables of the optimum's rear angle."""
    return make(MAPS[name](), builds.FEEDFORWARD_CONFIG, precision, ("map",))


def named(name: str) -> Units:
    """Those of `tracking`, or of one of MAPS in single precision."""
    return tracking() if name == "tracking" else of_map(name, "single")


@functools.cache
def _objects(name: str) -> relinked.Objects:
    return relinked.Objects(*named(name).sources)


@functools.cache
def altered(name: str, path: str, old: str, new: str) -> Units:
    """Units (see `named`) with one place of their C changed. Raises LookupError: see `builds.altered_folder`."""
    original = named(name)
    changed = replace(original, folder=builds.altered_folder(original.folder, path, old, new))
    changed.__dict__["library"] = _objects(name).library(changed.sources[0])  # in place of the one that it would compile
    return changed
