"""Typed Python interface to the generated controller and the plant as compiled C.

`load` compiles a build folder together with the plant of its configuration.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen import configuration
from codegen.configuration import Config
from codegen.configuration.signals import MEASURED, RECORDED, SignalDefinition
from codegen.configuration.signals import RECORD_COLUMNS as RECORD_COLUMNS
from codegen.configuration.signals import Measurement as Measurement
from codegen.configuration.signals import Status as Status
from codegen.emit.can_view import task_name, task_view
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.render import render
from codegen.emit.text import Precision, c_type, literal, numpy_type
from codegen.errors import BuildError
from codegen.sil.compile import DEFAULT_FLAGS, Library, Mode, compile_library
from codegen.sil.plant import plant_sources


@dataclass(frozen=True)
class Command:
    """Result of a controller step: rear angle (rad), yaw-rate reference (rad/s) and status."""

    rear_angle: float
    yaw_rate_reference: float
    status: Status


@dataclass(frozen=True)
class Software:
    """A compiled build: controller, map, dynamics, plant and closed loop in one library.

    Attributes:
        compiled: the cffi module; `lib` holds every public C function.
        prefix: prefix of the C names.
        precision: precision of the controller's numbers.
        config: configuration of the build.
        edited: files of the build folder that were changed after generation.
    """

    compiled: Library
    prefix: str
    precision: Precision
    config: Config
    edited: tuple[str, ...] = ()

    @property
    def ffi(self) -> Any:
        """The cffi FFI of the library."""
        return self.compiled.ffi

    def function(self, name: str) -> Any:
        """Return the C function or object `<prefix>_<name>`."""
        return getattr(self.compiled.lib, f"{self.prefix}_{name}")

    def new(self, name: str) -> Any:
        """Return a zeroed C struct `<prefix>_<name>_t`, owned by Python."""
        return self.ffi.new(f"{self.prefix}_{name}_t *")

    @property
    def real(self) -> type[np.float32] | type[np.float64]:
        """NumPy type of the controller's numbers."""
        return numpy_type(self.precision)

    @cached_property
    def measured(self) -> tuple[SignalDefinition, ...]:
        """Signals from the car in the struct of a measurement."""
        names = {name for name, _ in self.ffi.typeof(f"{self.prefix}_measurement_t").fields}
        return tuple(signal for signal in MEASURED if signal.role in names)

    def fill(self, struct: Any, measurement: Measurement) -> None:
        """Fill a measurement struct of the C."""
        for signal in self.measured:
            setattr(struct, signal.role, getattr(measurement, signal.role))

    def selftest(self) -> bool:
        """Run the generated self-test."""
        return bool(self.function("selftest")())

    def parameters(self, **changes: float) -> Any:
        """Return a copy of the default parameter struct with some fields changed (SI units).

        Raises:
            ValueError: the struct has no such field.
        """
        parameters = self.new("parameters")
        parameters[0] = self.function("parameters_default")
        known = dir(parameters)
        for name, value in changes.items():
            if name not in known:
                raise ValueError(f"no parameter {name!r}; known: {', '.join(known)}")
            setattr(parameters, name, value)
        return parameters

    def map_yaw_rate(
        self,
        speed: npt.ArrayLike,
        front_angle: npt.ArrayLike,
        friction: npt.ArrayLike = math.nan,
        acceleration: npt.ArrayLike = 0.0,
    ) -> npt.NDArray[Any]:
        """Look up the yaw rate (rad/s) in C for broadcast arrays of m/s, rad, friction (NaN: the map's friction) and m/s^2."""
        given = (speed, front_angle, friction, acceleration)
        arrays = np.broadcast_arrays(*(np.asarray(values, dtype=self.real) for values in given))
        flat = [np.ascontiguousarray(array).ravel() for array in arrays]
        result = np.empty(flat[0].size, dtype=self.real)
        pointer = f"{c_type(self.precision)} *"
        self.compiled.lib.loop_map(
            *(self.ffi.cast(pointer, self.ffi.from_buffer(array)) for array in flat),
            self.ffi.cast(pointer, self.ffi.from_buffer(result, require_writable=True)),
            result.size,
        )
        return result.reshape(arrays[0].shape)

    def task(self, parameters: Any | None = None) -> Task:
        """Return a new instance of the ECU's cyclic task."""
        chosen = self.parameters() if parameters is None else parameters
        name = task_name(self.config.controller.sampling_time_s)
        return Task(self.ffi, self.new("task"), chosen, self.function, name, self.config.can.frame_bytes)

    def controller(self, rear_angle: float = 0.0, parameters: Any | None = None) -> Controller:
        """Return a new controller instance, initialised at a rear angle (rad)."""
        return Controller(self, rear_angle, parameters)


class Controller:
    """One instance of the generated controller. Instances are independent. Do not share one between threads."""

    def __init__(self, software: Software, rear_angle: float = 0.0, parameters: Any | None = None) -> None:
        self._software = software
        self.state = software.new("controller")
        self.parameters = software.parameters() if parameters is None else parameters
        self._measurement = software.new("measurement")
        self._step = software.function("controller_step")
        self.init(rear_angle)

    def init(self, rear_angle: float) -> None:
        """Initialise at the current angle of the actuator (rad)."""
        self._software.function("controller_init")(self.state, rear_angle)

    def step(self, measurement: Measurement) -> Command:
        """Run one sample."""
        self._software.fill(self._measurement, measurement)
        command = self._step(self.state, self.parameters, self._measurement)
        return Command(command.rear_angle, command.yaw_rate_reference, Status(command.status))

    def run(self, measurements: Sequence[Measurement]) -> list[Command]:
        """Run many samples in one call of C."""
        prefix, ffi = self._software.prefix, self._software.ffi
        samples = ffi.new(f"{prefix}_measurement_t[]", len(measurements))
        commands = ffi.new(f"{prefix}_command_t[]", len(measurements))
        for sample, measurement in zip(samples, measurements, strict=True):
            self._software.fill(sample, measurement)
        self._software.compiled.lib.loop_controller(self.state, self.parameters, samples, commands, len(measurements))
        return [Command(command.rear_angle, command.yaw_rate_reference, Status(command.status)) for command in commands]


def load(build: Path, config: Config | None = None, flags: Sequence[str] = DEFAULT_FLAGS) -> Software:
    """Compile the C of a build folder with the plant of a configuration (default: that of the build).

    Raises:
        BuildError: not a build folder, no compiler, or C that does not compile.
    """
    manifest = read_build(build)
    require_can_side(manifest, build)
    files = read_files(build, manifest, ("include/", "src/"))
    return compile_build(files, manifest, config, flags=flags, edited=tuple(verify_hashes(build)))


def writable_flags(prefix: str) -> tuple[str, ...]:
    """Return the compiler flags that put calibration and constants of a build into writable memory, although they are const."""
    # Linkers put a section of this name into writable memory.
    section = "__DATA,ars_calib" if sys.platform == "darwin" else ".data.calibration"
    kinds = ("CALIBRATION", "CONST")
    return tuple(f'-D{prefix.upper()}_SECTION_{kind}=__attribute__((section("{section}")))' for kind in kinds)


def require_can_side(manifest: Mapping[str, Any], build: Path) -> None:
    """Raise BuildError if the build has no CAN task."""
    if f"include/{manifest['options']['prefix']}_task.h" not in manifest["files"]:
        raise BuildError("the build has no CAN task; an older codegen wrote it", where=build, remedy="build it again")


def compile_build(
    files: Mapping[str, bytes],
    manifest: Mapping[str, Any],
    config: Config | None = None,
    *,
    flags: Sequence[str] = DEFAULT_FLAGS,
    mode: Mode = "auto",
    edited: tuple[str, ...] = (),
) -> Software:
    """Compile generated files that are in memory. See `load`; for `flags` and `mode` see `compile_library`."""
    built_for = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    prefix, precision = manifest["options"]["prefix"], manifest["options"]["precision"]
    sources = {path: content for path, content in files.items() if path.startswith(("include/", "src/"))}
    sources.update(bench_sources(config or built_for, prefix, precision, built_for.can.measured))
    public = [path for path in sources if path.startswith("include/") and path != f"include/{prefix}_sections.h"]
    headers = [*public, "bench/plant.h", "bench/loop.h"]
    library = compile_library(f"{prefix}_sil", sources, headers, include_folders=("include", "bench"), flags=flags, mode=mode)
    return Software(library, prefix, precision, config or built_for, edited)


def bench_sources(
    config: Config, prefix: str, precision: Precision, measured: Sequence[SignalDefinition] | None = None
) -> dict[str, bytes]:
    """Return the C of the plant and of the closed loop around a controller of this prefix and precision.

    `measured` are the signals of its measurement, by default those of the configuration.
    """
    measured = config.can.measured if measured is None else measured
    context = {
        "build": {"prefix": prefix, "PREFIX": prefix.upper()},
        "real": c_type(precision),
        "zero": literal(0.0, precision),
        "loop": {"columns": RECORD_COLUMNS},
        "measured": measured,
        "takes_acceleration": any(signal.is_extra for signal in measured),
        "recorded": RECORDED,
        "task": task_view(config),
    }
    loop = {f"bench/{name}": render(f"sil/{name}.j2", context) for name in ("loop.h", "loop.c")}
    return {**loop, **{f"bench/{name}": content for name, content in plant_sources(config).items()}}


COUNTERS = ("cycles", "late_cycles", "early_cycles", "lost_samples")
"""Public counters of a task."""


class Task:
    """One `<prefix>_task_t` with its functions. Instances are independent. Do not share one between threads."""

    def __init__(
        self, ffi: Any, state: Any, parameters: Any, function: Callable[[str], Any], period_name: str, frame_bytes: int
    ) -> None:
        self.state = state
        self._parameters = parameters  # the C keeps a pointer to them
        self._on_can_frame, self._is_complete = function("task_on_can_frame"), function("task_is_complete")
        self._run = function(period_name)
        self._data = ffi.new(f"uint8_t[{frame_bytes}]")
        self._buffer = ffi.buffer(self._data)
        function("task_init")(state, parameters)

    def on_can_frame(self, identifier: int, data: bytes) -> None:
        """Receive a data frame of the configured kind."""
        self._on_can_frame(self.state, identifier, data, len(data))

    @property
    def is_complete(self) -> bool:
        """Whether both messages of the car have arrived since the last run."""
        return bool(self._is_complete(self.state))

    def run(self) -> tuple[int, bytes]:
        """Run one sample and return identifier and data of the frame to send."""
        return self._run(self.state, self._data), bytes(self._buffer)

    def counters(self) -> dict[str, int]:
        """Return the value of each counter in COUNTERS."""
        return {name: getattr(self.state, name) for name in COUNTERS}
