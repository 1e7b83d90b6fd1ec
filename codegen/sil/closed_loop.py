"""Closed loop of plant and controller in C. It runs in one call, or step by step from Python with identical results."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration.signals import RECORDED, SignalDefinition
from codegen.sil.software import RECORD_COLUMNS, Software

INPUT_COLUMNS = (
    *("speed", "steering_wheel_command", "friction", "friction_estimate", "yaw_moment", "inhibit"),
    "longitudinal_acceleration",
)
"""Columns of a scenario with one row for each plant step: m/s, rad, -, - (NaN: no estimate), N m, 0 or 1."""

PREVIEW_POINTS = 20
"""Number of points of a path that a driver looks ahead to."""

Driver = Callable[[tuple[float, float, float], float, float], float]
"""Function of position (m forward, m left, heading in rad), sideslip (rad) and yaw rate (rad/s) that returns the steering-wheel
angle (rad)."""


@dataclass(frozen=True)
class LoopOptions:
    """Options of a closed-loop run.

    Attributes:
        controlled: False keeps the rear command at zero: the passive car.
        delay_samples: control samples between the computation of a command and its effect; None uses the configuration's.
        through_can: pass signals and command through protected CAN frames, with their quantisation.
        parameters: C parameter struct (see `Software.parameters`); None uses the build's.
    """

    controlled: bool = True
    delay_samples: int | None = None
    through_can: bool = False
    parameters: Any | None = None


class ClosedLoop:
    """Plant and controller with their states. A run continues from the end of the previous one unless `reset` is called."""

    def __init__(self, software: Software, options: LoopOptions | None = None) -> None:
        options = LoopOptions() if options is None else options
        config = software.config
        ffi = software.ffi
        self._software = software
        self._lib = software.compiled.lib
        self.steps_per_sample = round(config.controller.sampling_time_s / config.plant.sampling_time_s)
        self.sampling_time = config.plant.sampling_time_s * self.steps_per_sample
        self._setup = ffi.new("loop_setup_t *")
        self._setup.plant_step = config.plant.sampling_time_s
        self._setup.steps_per_sample = self.steps_per_sample
        delay = config.plant.command_delay_samples if options.delay_samples is None else options.delay_samples
        if not 0 <= delay <= self._lib.LOOP_DELAY_MAX:
            raise ValueError(f"a delay of {delay} samples is outside 0 to {self._lib.LOOP_DELAY_MAX}")
        self._setup.delay_samples = delay
        self._setup.controlled = options.controlled
        self._setup.through_can = options.through_can
        self._parameters = software.parameters() if options.parameters is None else options.parameters
        self.state = ffi.new("loop_state_t *")
        self.reset()

    def reset(self) -> None:
        """Set all states to zero."""
        self._lib.loop_init(self.state, self._parameters)

    def run(self, inputs: FloatArray) -> FloatArray:
        """Run the loop entirely in C.

        Args:
            inputs: (samples * steps_per_sample, 7), columns INPUT_COLUMNS.

        Returns:
            (samples, columns), RECORD_COLUMNS.
        """
        inputs, samples = self._checked(inputs)
        record = np.empty((samples, len(RECORD_COLUMNS)))
        ffi = self._software.ffi
        self._lib.loop_run(
            self.state,
            self._setup,
            self._parameters,
            samples,
            ffi.cast("loop_input_t *", ffi.from_buffer(inputs)),
            ffi.cast("loop_record_t *", ffi.from_buffer(record, require_writable=True)),
        )
        return record

    def run_stepped(
        self, inputs: FloatArray, driver: Driver | None = None, rear_angle_commands: FloatArray | None = None
    ) -> FloatArray:
        """Run the loop in Python, which calls controller and plant step by step. The results equal those of `run`.

        Args:
            inputs: as for `run`.
            driver: sets the steering wheel in each sample and replaces its column of the inputs.
            rear_angle_commands: (samples,) rad, instead of the controller's command; not for the passive car.
        """
        inputs, samples = self._checked(inputs)
        ffi, lib, software = self._software.ffi, self._lib, self._software
        plant, setup = ffi.addressof(self.state, "plant"), self._setup
        controller = ffi.addressof(self.state, "controller")
        plant_input, output = ffi.new("plant_input_t *"), ffi.new("plant_output_t *")
        measurement = software.new("measurement")
        waiting = list(self.state.commands[0 : setup.delay_samples])
        rows = []
        for sample in range(samples):
            steps = inputs[sample * self.steps_per_sample : (sample + 1) * self.steps_per_sample]
            speed, wheel, friction, _, moment, _, _ = (float(value) for value in steps[0])
            plant_input[0] = (speed, wheel, 0.0, friction, moment)
            lib.plant_output(plant, plant_input, output)
            if driver is not None:
                steps = steps.copy()
                steps[:, 1] = driver((plant.position_x, plant.position_y, plant.heading), output.sideslip_angle, plant.yaw_rate)
            rear_angle, reference, status = 0.0, 0.0, 2
            if setup.controlled:
                scenario = dict(zip(INPUT_COLUMNS, steps[0].tolist(), strict=True))
                for signal in software.measured:
                    setattr(measurement, signal.role, _value(signal, scenario, plant, output))
                command = software.function("controller_step")(controller, self._parameters, measurement)
                rear_angle, reference, status = command.rear_angle, command.yaw_rate_reference, command.status
                if rear_angle_commands is not None:
                    rear_angle = float(rear_angle_commands[sample])
            rows.append(
                (
                    *(sample * self.sampling_time, speed, output.front_angle, plant.yaw_rate, reference),
                    *(output.sideslip_angle, output.lateral_acceleration, rear_angle, plant.rear_angle),
                    *(output.slip_front, output.slip_rear, *(_value(signal, {}, plant, output) for signal in RECORDED)),
                    float(status),
                )
            )
            waiting.append(rear_angle)
            acting = waiting.pop(0)
            for speed, wheel, friction, _, moment, _, _ in steps:
                plant_input[0] = (speed, wheel, acting, friction, moment)
                lib.plant_step(plant, plant_input, setup.plant_step)
        for index, command in enumerate(waiting):
            self.state.commands[index] = command
        return np.array(rows)

    def _checked(self, inputs: FloatArray) -> tuple[FloatArray, int]:
        inputs = np.ascontiguousarray(inputs, dtype=np.float64)
        if inputs.ndim != 2 or inputs.shape[1] != len(INPUT_COLUMNS) or inputs.shape[0] % self.steps_per_sample:
            raise ValueError(
                f"inputs of shape {inputs.shape}; needed: (k * {self.steps_per_sample}, {len(INPUT_COLUMNS)}) for k samples"
            )
        return inputs, inputs.shape[0] // self.steps_per_sample


def _value(signal: SignalDefinition, scenario: Mapping[str, float], plant: Any, output: Any) -> float | bool:
    """Return the value of a signal, read from a scenario row or from the state or output struct of the plant."""
    if not signal.source:
        return False if signal.is_flag else math.nan
    if signal.origin == "scenario":
        value = scenario[signal.origin_name]
    else:
        value = float(getattr(plant if signal.origin == "state" else output, signal.origin_name))
    return abs(value) > 0.0 if signal.is_flag else value
