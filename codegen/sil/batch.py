"""Batches of closed-loop runs. Cars, disturbances and noise differ; the scenario and the controller's C are shared.

The two-track plant of `BATCH_LANES` runs is computed together, with vector instructions where compiler and machine support
them. The controller of each run is the C of the build, called once a sample. The result of a run does not depend on the rest
of the batch, bit for bit.

Results differ from a single run (`closed_loop`) of the same car only by rounding, see DIFFERENCE_MAX.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen import configuration
from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config, Sensor, Sensors
from codegen.configuration.can import Can
from codegen.configuration.signals import CARRIED, RECORDED
from codegen.emit.casadi_c import staged_body
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.render import render
from codegen.emit.text import Precision, c_type, literal
from codegen.errors import BuildError
from codegen.sil.closed_loop import INPUT_COLUMNS, PREVIEW_POINTS
from codegen.sil.compile import Mode, compile_library
from codegen.sil.software import RECORD_COLUMNS, Software, require_can_side
from codegen.sil.vector import FUNCTIONS, ISAS, VECTOR_FLAGS, Isa, best_isa, compiler_offers, is_vectorised, machine_runs
from codegen.vehicle.dynamics import ParametricModel, two_track_of_parameters
from codegen.vehicle.plant_car import OPTIONAL_PARTS, PLANT_PARAMETERS, optional_parts

LANES = 8
"""Number of runs that are computed together: the doubles of one AVX-512 vector.

Twice as many gain a few percent, but waste more time when a batch does not fill its last lanes."""

PLANT_UNIT = "batch/batch_plant.c"
"""Source with the vectorised loops."""

_UNRECORDED = ("position_x", "position_y", "heading")
"""States that no column depends on. They are omitted unless a signal reads them."""
_SOURCES = {each.source for each in RECORDED}


def batch_sources(config: Config, prefix: str, precision: Precision, can: Can) -> dict[str, bytes]:
    """Return the C files of the batch for a controller of this prefix and precision, with the signals of its `can`.

    The configuration only decides which of `plant_car.OPTIONAL_PARTS` the plant has; the car of each run is data.
    """
    model = two_track_of_parameters(config)
    context = {
        "build": {"prefix": prefix, "PREFIX": prefix.upper()},
        "real": c_type(precision),
        "zero": literal(0.0, precision),
        "carried": CARRIED,
        "takes_acceleration": any(signal.is_extra for signal in can.measured),
        "recorded": RECORDED,
        "batch": {
            "lanes": LANES,
            "columns": RECORD_COLUMNS,
            "parameters": model.parameters,
            "noises": NOISES,
            "preview_points": PREVIEW_POINTS,
        },
        "plant": _plant_view(model),
    }
    names = ("batch.h", "batch.c", "batch_plant.h", "batch_plant.c")
    return {f"batch/{name}": render(f"sil/{name}.j2", context) for name in names}


def _plant_view(model: ParametricModel) -> dict[str, Any]:
    states = [name for name in model.states if name not in _UNRECORDED or f"state.{name}" in _SOURCES]
    motion = [name for name in model.outputs if name != "front_angle"]
    car, held, rates = staged_body(
        _function(model, "derivative", states, states),
        {"car": ["parameter"], "input": ["input"], "state": ["state"]},
    )
    at_once = {"sample": ["parameter", "input", "state"]}
    (front_angle,) = staged_body(_function(model, "front_angle", states, ["front_angle"]), at_once)
    (moving,) = staged_body(_function(model, "motion", states, motion), at_once)
    return {
        "states": states,
        "inputs": model.inputs,
        "motion": motion,
        "functions": FUNCTIONS,
        "held_car": car.held,
        "held_input": held.held,
        "car": car.body,
        "input": held.body,
        "derivative": rates.body,
        "front_angle": front_angle.body,
        "motion_body": moving.body,
    }


def _function(model: ParametricModel, name: str, states: Sequence[str], results: Sequence[str]) -> Any:
    """Return selected derivatives or outputs of a model as a function of selected states; other states are zero."""
    state = ca.SX.sym("state", len(states))
    u = ca.SX.sym("input", len(model.inputs))
    p = ca.SX.sym("parameter", len(model.parameters))
    x = ca.vertcat(*(state[states.index(known)] if known in states else 0.0 for known in model.states))
    names, function = (model.states, model.derivative) if results[0] in states else (model.outputs, model.output)
    values = function(x, u, p)
    result = ca.vertcat(*(values[names.index(wanted)] for wanted in results))
    return ca.Function(name, [state, u, p], [result], ["state", "input", "parameter"], [name])


__all__ = ["BatchSoftware", "Drivers", "Isa", "Lanes", "best_isa", "compile_batch", "load_batch", "sensor_errors"]

IntArray = npt.NDArray[np.integer[Any]]

DIFFERENCE_MAX = 1e-11
"""Largest difference between a batch run and the single run, in SI units, while the car does not spin.

Vector functions are accurate to 4 units in the last place, scalar functions to 1. Divisions by constants become products with
the reciprocal. Together these cause about twenty roundings per plant step, 1e-14 of an acceleration of 10 m/s^2. Their effect
decays within about a hundred steps, or about a thousand near the limit of grip, and so reaches 1e-13 rad/s. In 8,000 runs of
random cars with and without vectors, step steer and sine with dwell, it was at most 1.5e-13 rad/s and 1.6e-12 m/s^2."""

DIFFERENCE_MAX_FLIPPED = 1e-6
"""Limit of the difference if a measured signal rounds to another float32 value than in the loop.

This happens about once in ten million samples: 6e-8 rad of front angle are 5e-7 rad/s of reference at 8 (rad/s)/rad."""

NOISES = ("speed", "front_angle", "yaw_rate", "rear_angle", "lateral_acceleration")
"""Rows of `Lanes.noise`: fields of the measurement, in SI units."""
_SPEED, _FRICTION = INPUT_COLUMNS.index("speed"), INPUT_COLUMNS.index("friction")


@dataclass(frozen=True, eq=False)
class Drivers:
    """Drivers of n runs who follow one path by linear preview. SI units.

    Attributes:
        path: (points,) m, lateral positions of the path at even distances along the road; held beyond both ends.
        path_spacing: m between two of them.
        path_start: (n,) m along the road, position of the first.
        ahead: (n,) m between two preview points.
        path_weight: (PREVIEW_POINTS, n) rad of steering wheel for each m of the path at the preview points.
        motion_weight: (4, n) weights of lateral position (m), heading (rad), lateral speed (m/s) and yaw rate (rad/s), which
            are subtracted.
        delay_samples: (n,) reaction time in control samples, 0 to 100.
        wheel_angle_max: rad, largest angle of the steering wheel.
    """

    path: FloatArray
    path_spacing: float
    path_start: FloatArray
    ahead: FloatArray
    path_weight: FloatArray
    motion_weight: FloatArray
    delay_samples: IntArray
    wheel_angle_max: float

    def pick(self, runs: BoolArray) -> Drivers:
        """Return the drivers of the runs (n,) that are true."""
        names = ("path_start", "ahead", "path_weight", "motion_weight", "delay_samples")
        return replace(self, **{name: getattr(self, name)[..., runs] for name in names})


@dataclass(frozen=True, eq=False)
class Lanes:
    """Values that differ between the n runs of a batch: an array (n,), or one number for all runs.

    Attributes:
        cars: (n, k), rows from `vehicle.plant_car.plant_parameters`, columns PLANT_PARAMETERS.
        speed_factor: multiplies the scenario's speed; above zero.
        wheel_factor: multiplies the scenario's steering-wheel command.
        friction: replaces the road friction of the scenario. A friction that changes over time is instead multiplied by the
            ratio of this value to the friction of the configuration. None keeps the scenario's friction.
        moment_arm: distance in m ahead of the centre of gravity at which a side force causes the scenario's yaw moment;
            infinite for a moment without a force.
        friction_estimate: replaces the scenario's estimate for the controller; NaN: no estimate.
        delay_samples: control samples between the computation of a command and its effect, 0 to 100; None: the
            configuration's.
        command_factor: multiplies the rear angle command, and so the loop gain, when the command acts; 1 changes nothing.
        controlled: False keeps the rear command at zero: the passive car.
        noise: (samples, 5, n), added to the measured quantities NOISES. None adds nothing.
        drivers: drivers of the runs, who add to the scenario's steering-wheel command; None for none.
    """

    cars: FloatArray
    speed_factor: FloatArray | float = 1.0
    wheel_factor: FloatArray | float = 1.0
    friction: FloatArray | float | None = None
    moment_arm: FloatArray | float = math.inf
    friction_estimate: FloatArray | float = math.nan
    delay_samples: IntArray | int | None = None
    command_factor: FloatArray | float = 1.0
    controlled: BoolArray | bool = True
    noise: FloatArray | None = None
    drivers: Drivers | None = None

    def pick(self, runs: BoolArray) -> Lanes:
        """Return the runs (n,) that are true."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        chosen = {name: value[..., runs] for name, value in values.items() if isinstance(value, np.ndarray) and name != "cars"}
        drivers = None if self.drivers is None else self.drivers.pick(runs)
        return replace(self, cars=self.cars[runs], drivers=drivers, **chosen)


def sensor_errors(sensors: Sensors, samples: int, count: int, seed: int) -> FloatArray:
    """Draw the errors of sensors for `Lanes.noise`, (samples, 5, count): bias, noise, and half a resolution either way.

    Their delays are left out. The settings of one sensor do not affect the errors of others; the same seed gives the same.
    """
    found = np.empty((samples, len(NOISES), count))
    streams = np.random.default_rng(seed).spawn(len(NOISES))
    for place, (name, stream) in enumerate(zip(NOISES, streams, strict=True)):
        sensor: Sensor = getattr(sensors, name)
        rounding = stream.uniform(-0.5 * sensor.resolution, 0.5 * sensor.resolution, (samples, count))
        found[:, place] = sensor.bias + sensor.noise * stream.standard_normal((samples, count)) + rounding
    return found


@dataclass(frozen=True)
class BatchSoftware:
    """A compiled build with the plant for many cars. It has no state; threads may call it concurrently.

    Attributes:
        software: the controller of the build in the batch's own library; it creates parameter structs.
        isa: the vector instructions that the plant uses.
        steps_per_sample: plant steps in a sample of the controller.
    """

    software: Software
    isa: Isa

    @property
    def config(self) -> Config:
        """The configuration of the build."""
        return self.software.config

    @property
    def steps_per_sample(self) -> int:
        """Plant steps in a control sample."""
        return round(self.config.controller.sampling_time_s / self.config.plant.sampling_time_s)

    @property
    def delay_max(self) -> int:
        """Largest command delay, in control samples."""
        return int(self.software.compiled.lib.BATCH_DELAY_MAX)

    def parameters(self, **changes: float) -> Any:
        """The controller's parameter struct with some fields changed (SI units); see `Software.parameters`."""
        return self.software.parameters(**changes)

    def run(
        self,
        profile: FloatArray,
        lanes: Lanes,
        parameters: Any | None = None,
        columns: Sequence[str] = RECORD_COLUMNS,
    ) -> FloatArray:
        """Simulate all runs in this thread, with the interpreter lock released.

        Args:
            profile: (samples * steps_per_sample, 7), columns INPUT_COLUMNS: the scenario that all runs share.
            lanes: values that differ between the runs.
            parameters: controller parameters from `parameters`; None uses the build's.
            columns: subset of RECORD_COLUMNS to compute and store.

        Returns:
            (columns, samples, n).

        Raises:
            ValueError: an array of the wrong shape, a speed that is no number, a delay out of range, an unknown column.
        """
        lib, ffi = self.software.compiled.lib, self.software.ffi
        profile, samples = self._checked_profile(profile)
        profile, own = self._own(profile, lanes, samples)
        count = own["cars"].shape[0]
        record = np.empty((len(columns), samples, count))
        pointers = ffi.new("double *[]", lib.BATCH_COLUMNS)
        for row, name in zip(record, columns, strict=True):
            if name not in RECORD_COLUMNS:
                raise ValueError(f"no column {name!r}; known: {', '.join(RECORD_COLUMNS)}")
            pointers[RECORD_COLUMNS.index(name)] = ffi.cast("double *", ffi.from_buffer(row, require_writable=True))
        scenario = ffi.new("batch_scenario_t *")
        scenario.plant_step = self.config.plant.sampling_time_s
        scenario.steps_per_sample, scenario.samples = self.steps_per_sample, samples
        scenario.inputs = ffi.cast("batch_input_t *", ffi.from_buffer(profile))
        runs = ffi.new("batch_runs_t *")
        runs.count = count
        for name, array in own.items():
            setattr(runs, name, ffi.cast(_C_TYPES.get(name, "double *"), ffi.from_buffer(array)))
        held = None if lanes.drivers is None else self._drivers(lanes.drivers, count)
        if held is not None:
            runs.drivers = held[0]
        chosen = self.parameters() if parameters is None else parameters
        lib.batch_run(scenario, chosen, runs, pointers)
        return record

    def _checked_profile(self, profile: FloatArray) -> tuple[FloatArray, int]:
        profile = np.ascontiguousarray(profile, dtype=np.float64)
        steps = self.steps_per_sample
        if profile.ndim != 2 or profile.shape[1] != len(INPUT_COLUMNS) or profile.shape[0] % steps:
            raise ValueError(f"a profile of shape {profile.shape}; needed: (k * {steps}, {len(INPUT_COLUMNS)}) for k samples")
        if not np.isfinite(profile[:, _SPEED]).all():
            raise ValueError("the profile's speed must be finite")
        return profile, profile.shape[0] // steps

    def _own(self, profile: FloatArray, lanes: Lanes, samples: int) -> tuple[FloatArray, dict[str, npt.NDArray[Any]]]:
        """Return the profile with friction as a factor, and the arrays of batch_runs_t."""
        cars = np.ascontiguousarray(lanes.cars, dtype=np.float64)
        if cars.ndim != 2 or cars.shape[1] != len(PLANT_PARAMETERS):
            raise ValueError(f"cars of shape {cars.shape}; needed: (n, {len(PLANT_PARAMETERS)}), columns PLANT_PARAMETERS")
        own_parts = optional_parts(self.config)
        for part, text in OPTIONAL_PARTS.items():
            if ((cars[:, PLANT_PARAMETERS.index(part)] > 0.0) != (part in own_parts)).any():
                raise ValueError(f"either all cars, including the build's, must have {text}, or none of them")
        own: dict[str, npt.NDArray[Any]] = {"cars": cars}
        friction: Any = 1.0
        if lanes.friction is not None:
            profile = profile.copy()
            of_profile = profile[:, _FRICTION]
            changes = bool(of_profile.size) and bool((of_profile != of_profile[0]).any())
            profile[:, _FRICTION] = of_profile / self.config.road.friction if changes else 1.0
            friction = lanes.friction
        delay = self.config.plant.command_delay_samples if lanes.delay_samples is None else lanes.delay_samples
        values = {
            "speed_factor": (lanes.speed_factor, np.float64),
            "wheel_factor": (lanes.wheel_factor, np.float64),
            "friction_factor": (friction, np.float64),
            "force_factor": (1.0 / np.asarray(lanes.moment_arm), np.float64),
            "friction_estimate": (lanes.friction_estimate, np.float64),
            "delay_samples": (delay, np.int64),
            "command_factor": (lanes.command_factor, np.float64),
            "controlled": (lanes.controlled, np.bool_),
        }
        for name, (value, kind) in values.items():
            own[name] = np.ascontiguousarray(np.broadcast_to(np.asarray(value).astype(kind), cars.shape[0]))
        self._check_own(own)
        own["delay_samples"] = own["delay_samples"].astype(np.uint32)
        if lanes.noise is not None:
            noise = np.ascontiguousarray(lanes.noise, dtype=np.float64)
            if noise.shape != (samples, len(NOISES), cars.shape[0]):
                raise ValueError(f"noise of shape {noise.shape}; needed: ({samples}, {len(NOISES)}, {cars.shape[0]})")
            own["noise"] = noise
        return profile, own

    def _drivers(self, drivers: Drivers, count: int) -> tuple[Any, ...]:
        """Return a batch_drivers_t, and what must live as long as it."""
        ffi = self.software.ffi
        arrays = {
            "path": (drivers.path, (drivers.path.size,)),
            "path_start": (drivers.path_start, (count,)),
            "ahead": (drivers.ahead, (count,)),
            "path_weight": (drivers.path_weight, (PREVIEW_POINTS, count)),
            "motion_weight": (drivers.motion_weight, (4, count)),
        }
        made = ffi.new("batch_drivers_t *")
        made.path_points, made.path_spacing = drivers.path.size, drivers.path_spacing
        made.wheel_angle_max = drivers.wheel_angle_max
        delay = np.asarray(drivers.delay_samples)
        if drivers.path.size < 2 or delay.shape != (count,) or (delay < 0).any() or (delay > self.delay_max).any():
            raise ValueError(f"a driver needs a path of two points, and (n,) delays of 0 to {self.delay_max} samples")
        held: list[npt.NDArray[Any]] = [np.ascontiguousarray(delay, dtype=np.uint32)]
        made.delay_samples = ffi.cast("uint32_t *", ffi.from_buffer(held[0]))
        for name, (values, shape) in arrays.items():
            if values.shape != shape:
                raise ValueError(f"{name} of shape {values.shape}; needed: {shape}")
            held.append(np.ascontiguousarray(values, dtype=np.float64))
            setattr(made, name, ffi.cast("double *", ffi.from_buffer(held[-1])))
        return (made, *held)

    def _check_own(self, own: Mapping[str, npt.NDArray[Any]]) -> None:
        if not (own["speed_factor"] > 0.0).all():
            raise ValueError("speed factors must be above zero")
        delay = own["delay_samples"]
        if ((delay < 0) | (delay > self.delay_max)).any():
            raise ValueError(f"delays of {delay.min()} to {delay.max()} samples; possible: 0 to {self.delay_max}")


_C_TYPES = {"delay_samples": "uint32_t *", "controlled": "bool *"}


def load_batch(build: Path, isa: Isa | None = None) -> BatchSoftware:
    """Compile the C of a build folder for many runs at once; see `compile_batch` for `isa`.

    Raises:
        BuildError: not a build folder, no compiler, C that does not compile, or vectors of the requested level unavailable.
    """
    manifest = read_build(build)
    require_can_side(manifest, build)
    files = read_files(build, manifest, ("include/", "src/"))
    return compile_batch(files, manifest, isa=isa, edited=tuple(verify_hashes(build)))


def compile_batch(
    files: Mapping[str, bytes],
    manifest: Mapping[str, Any],
    config: Config | None = None,
    *,
    isa: Isa | None = None,
    mode: Mode = "auto",
    edited: tuple[str, ...] = (),
) -> BatchSoftware:
    """Compile generated files that are in memory.

    Args:
        files: path -> content of the build.
        manifest: manifest of the build.
        config: source of sampling times, nominal friction, delay, and the optional parts of the plant; None: the build's.
        isa: vector instructions; None uses the best level that compiler and machine support.
        mode: see `compile_library`.
        edited: files of the build that were changed after generation.

    Raises:
        BuildError: as `load_batch`.
    """
    built_for = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    config = config or built_for
    prefix, precision = manifest["options"]["prefix"], manifest["options"]["precision"]
    # The ECU's vehicle model is not used here. `is_vectorised` would reject its scalar calls.
    left_out = {f"include/{prefix}_dynamics.h", f"src/{prefix}_dynamics.c"}
    taken = {path: content for path, content in files.items() if path.startswith(("include/", "src/")) and path not in left_out}
    public = [path for path in taken if path.startswith("include/") and path != f"include/{prefix}_sections.h"]
    sources = {**taken, **batch_sources(config, prefix, precision, built_for.can)}
    if isa is not None:
        _require(isa)
    for level in ISAS[ISAS.index(best_isa()) :] if isa is None else (isa,):
        library = compile_library(
            f"{prefix}_batch",
            sources,
            [*public, "batch/batch.h"],
            include_folders=("include", "batch"),
            unit_flags={PLANT_UNIT: VECTOR_FLAGS[level]},
            mode=mode,
        )
        if is_vectorised(library, level):
            return BatchSoftware(Software(library, prefix, precision, config, edited), level)
    raise BuildError(f"the compiler did not vectorise the plant for {isa}", remedy='use "none"')


def _require(isa: Isa) -> None:
    # Unsupported instructions would terminate the process.
    if not machine_runs(isa):
        raise BuildError(f"this machine does not support {isa}", remedy='use "none", or do not name a level')
    if not compiler_offers(isa):
        raise BuildError(f"the compiler does not vectorise for {isa}", remedy='use "none", or GCC with glibc 2.35 or newer')
