"""The simulated car in compiled C, without a controller."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from codegen import configuration
from codegen.configuration import Config
from codegen.configuration.signals import RECORDED
from codegen.emit.dynamics_view import FunctionView
from codegen.emit.render import render
from codegen.sil.compile import Library, compile_library
from codegen.vehicle.dynamics import Model, two_track


@dataclass(frozen=True)
class PlantInput:
    """Inputs of the car: m/s, rad at the steering wheel, rad at the rear wheels, peak friction, yaw moment in N m."""

    speed: float
    steering_wheel_command: float
    rear_angle_command: float
    friction: float
    yaw_moment: float = 0.0


@dataclass(frozen=True)
class PlantSample:
    """Outputs of the car at one time, in rad, rad/s and m/s^2: see PLANT_OUTPUTS. `recorded` maps the role of each signal in
    `RECORDED` to its value."""

    front_angle: float
    yaw_rate: float
    rear_angle: float
    sideslip_angle: float
    lateral_acceleration: float
    slip_front: float
    slip_rear: float
    measured_rear_angle: float
    measured_lateral_acceleration: float
    recorded: Mapping[str, float] = field(default_factory=dict)

    def recorded_values(self) -> list[float]:
        """Return the values of all signals in `RECORDED`, in order; NaN for those that this car does not have."""
        return [self.recorded.get(each.role, math.nan) for each in RECORDED]


class Plant:
    """The two-track car of a configuration, starting straight ahead with all states zero.

    Args:
        config: configuration of the car and its time step.
        model: model of another car. Its states, inputs and outputs must include those of `two_track`.

    Raises:
        BuildError: no compiler, or C that does not compile.
    """

    def __init__(self, config: Config, model: Model | None = None) -> None:
        library = _two_track_library(config.to_json()) if model is None else _library(config, model)
        self._lib = library.lib
        self._step = config.plant.sampling_time_s
        self._state: Any = library.ffi.new("plant_state_t *")
        self._input: Any = library.ffi.new("plant_input_t *")
        self._output: Any = library.ffi.new("plant_output_t *")

    def sample(self, acting: PlantInput) -> PlantSample:
        """Return the current outputs. The rear angle command does not affect them."""
        self._set(acting)
        self._lib.plant_output(self._state, self._input, self._output)
        state, output = self._state, self._output
        return PlantSample(
            output.front_angle,
            state.yaw_rate,
            state.rear_angle,
            output.sideslip_angle,
            output.lateral_acceleration,
            output.slip_front,
            output.slip_rear,
            output.measured_rear_angle,
            output.measured_lateral_acceleration,
            {each.role: getattr(state if each.origin == "state" else output, each.origin_name) for each in RECORDED},
        )

    @property
    def speed(self) -> float:
        """Imposed speed in m/s at the last sample or step; zero before."""
        speed: float = self._input.speed
        return speed

    @property
    def position(self) -> tuple[float, float, float]:
        """Position in the road frame: m forward, m left, heading in rad."""
        return self._state.position_x, self._state.position_y, self._state.heading

    def advance(self, acting: Iterable[PlantInput]) -> None:
        """Advance by one plant step for each input."""
        for values in acting:
            self._set(values)
            self._lib.plant_step(self._state, self._input, self._step)

    def _set(self, acting: PlantInput) -> None:
        target = self._input
        target.speed = acting.speed
        target.steering_wheel_command = acting.steering_wheel_command
        target.rear_angle_command = acting.rear_angle_command
        target.friction = acting.friction
        target.yaw_moment = acting.yaw_moment


@lru_cache(maxsize=8)
def _two_track_library(configuration_json: str) -> Library:
    """Return the library of the two-track car. Cached, because deriving its equations takes longer than most runs."""
    return _library(configuration.parse(json.loads(configuration_json), "plant"), None)


def _library(config: Config, model: Model | None) -> Library:
    return compile_library("plant", plant_sources(config, model), ["plant.h"], include_folders=(".",))


def plant_sources(config: Config, model: Model | None = None) -> dict[str, bytes]:
    """Return plant.h and plant.c of the two-track car or of another model."""
    model = two_track(config) if model is None else model
    assert model.output is not None  # the plant has outputs by construction
    context = {
        "plant": {
            "states": model.states,
            "inputs": model.inputs,
            "outputs": model.outputs,
            "derivative": FunctionView("derivative", model.derivative, "double"),
            "output": FunctionView("output", model.output, "double"),
        },
    }
    return {name: render(f"sil/{name}.j2", context) for name in ("plant.h", "plant.c")}
