"""The separate units of a build (map, limiter, reference model) with calls over arrays.

Arrays are passed as memory, so that any bit pattern arrives. A signalling NaN would not survive a Python float.
"""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import Lookup
from codegen.emit.dynamics_view import model_state
from codegen.emit.folder import Folder
from codegen.emit.text import Precision, c_type, numpy_type
from codegen.sil.compile import Library

RealArray = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class Units:
    """The units of a compiled build with the loops of `probe`, the build's map and its configuration."""

    folder: Folder
    total: TotalMap
    config: Config
    library: Library

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

    def _in(self, array: Any) -> Any:
        contiguous = np.ascontiguousarray(array, dtype=self.real)
        return self.library.ffi.from_buffer(f"{c_type(self.precision)}[]", contiguous)

    def _out(self, *shape: int) -> tuple[RealArray, Any]:
        array = np.empty(shape, dtype=self.real)
        return array, self.library.ffi.from_buffer(f"{c_type(self.precision)}[]", array, require_writable=True)

    def map_reference(self, speed: Any, front_angle: Any, friction: Any = np.nan) -> RealArray:
        """Return rows (4, n) for arrays that broadcast to (n,): yaw rate (rad/s), rear angle (rad), the road's lateral
        acceleration (m/s^2), and the yaw rate (rad/s) of the function that returns only that."""
        arrays = np.broadcast_arrays(*(np.asarray(values, dtype=self.real) for values in (speed, front_angle, friction)))
        found, pointer = self._out(arrays[0].size, 4)
        self.library.lib.probe_map(*(self._in(array) for array in arrays), pointer, arrays[0].size)
        return found.T

    def limiter_parameters(self, **changes: Any) -> Any:
        """Return the build's limiter parameters with an effective rate and bounds, and with changes; they must be valid."""
        parameters = self.library.ffi.new("ars_limiter_parameters_t *", self.library.lib.ars_parameters_default.limiter)
        points = len(parameters.opposite_phase_speed)
        values: dict[str, Any] = {
            "rear_rate_max": np.radians(40.0),
            "opposite_phase_speed": (np.linspace(60.0, 120.0, points) / 3.6).tolist(),
            "opposite_phase_max": np.radians(np.linspace(3.5, 1.5, points)).tolist(),
        }
        for name, value in (values | changes).items():
            setattr(parameters, name, value)
        return parameters

    def limiter(self, parameters: Any, inputs: Any, start: float = 0.0) -> RealArray:
        """Return angles (n,) of a limiter that starts at an angle (rad), for inputs (n, 3): speed, front angle, demand."""
        self_ = self.library.ffi.new("ars_limiter_t *")
        self.library.lib.ars_limiter_init(self_, start)
        angles, pointer = self._out(len(inputs))
        self.library.lib.probe_limiter(self_, parameters, self._in(inputs), pointer, len(inputs))
        return angles

    def model_from(self, states: Any, inputs: Any) -> RealArray:
        """Return states one step after states (n, k) with inputs (n, 4)."""
        after, pointer = self._out(*np.shape(states))
        self.library.lib.probe_model_from(self._in(states), self._in(inputs), pointer, len(inputs))
        return after

    def model_start(self, inputs: Any) -> RealArray:
        """Return the model's start states (n, k) for inputs (n, 3): speed, yaw rate, rear angle."""
        states, pointer = self._out(len(inputs), len(model_state(self.config)))
        self.library.lib.probe_model_start(self._in(inputs), pointer, len(inputs))
        return states
