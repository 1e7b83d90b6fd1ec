"""Input profile of a scenario for a batch. All runs share it; each run scales its speed and steering amplitude."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.units import KM_H
from hil_sim.scenarios import Kind, Scenario

REFERENCE_ANGLE_DEG = 90.0
"""Steering-wheel amplitude of every profile, before the factor of a run is applied."""

SPEED, WHEEL = INPUT_COLUMNS.index("speed"), INPUT_COLUMNS.index("steering_wheel_command")


@dataclass(frozen=True, eq=False)
class Profile:
    """One scenario of a campaign.

    Attributes:
        scenario: the scenario.
        inputs: (steps, 6), columns INPUT_COLUMNS, at the scenario's own speed and REFERENCE_ANGLE_DEG.
        steer_time: start of steering in `inputs`, in s.
        speed: in m/s.
        friction: road friction of the scenario.
        estimate: friction estimate for the controller; NaN: none.
    """

    scenario: Scenario
    inputs: FloatArray
    steer_time: float
    speed: float
    friction: float
    estimate: float

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.scenario.name

    @property
    def kind(self) -> Kind:
        """Kind of the scenario."""
        return self.scenario.kind

    @property
    def digest(self) -> str:
        """SHA-256 of the inputs and of what `amplitudes` and the figures read, in hexadecimal digits."""
        own = self.scenario
        # The inputs have REFERENCE_ANGLE_DEG: the own amplitude is in the settings, or follows from the car by a rule.
        read = (own.kind, own.steer_time, self.steer_time, own.angle_text, asdict(own.settings))
        found = hashlib.sha256(json.dumps(read).encode())
        found.update(np.ascontiguousarray(self.inputs).tobytes())
        return found.hexdigest()

    def amplitudes(self, config: Config, speeds: FloatArray) -> FloatArray:
        """Return the scenario's own steering-wheel amplitude (n,) in rad for speeds (n,) in m/s and the configured car.

        Raises:
            CodegenError: the car cannot do it at one of them.
        """
        if self.scenario.settings.steering_wheel_angle_deg is not None:
            return np.full(speeds.shape, np.radians(self.scenario.settings.steering_wheel_angle_deg))
        wheel = self.inputs[:, WHEEL]
        at = int(np.abs(wheel).argmax())
        # The same instant in the whole scenario, which begins before the profile.
        time = np.array([at * config.plant.sampling_time_s + self.scenario.steer_time - self.steer_time])
        each, place = np.unique(speeds, return_inverse=True)
        found = np.empty(each.shape)
        for index, speed in enumerate(each):
            settings = replace(self.scenario.settings, speed_km_h=float(speed) / KM_H)
            command = np.broadcast_to(self.scenario.drive(config, settings, time)["steering_wheel_command"], (1,))
            found[index] = float(command[0]) / (wheel[at] / np.radians(REFERENCE_ANGLE_DEG))
        return found[place]


def profile_of(scenario: Scenario, config: Config, lead: float, length: float | None) -> Profile:
    """Return the profile from `lead` s before the start of steering to `length` s after it (None: end of the scenario).

    Raises:
        CodegenError: the car cannot do the scenario, or an input other than the steering changes during it.
    """
    settings = replace(scenario.settings, steering_wheel_angle_deg=REFERENCE_ANGLE_DEG)
    inputs = replace(scenario, settings=settings).inputs(config)
    step, period = config.plant.sampling_time_s, config.controller.sampling_time_s
    per_sample = round(period / step)
    begin = max(round((scenario.steer_time - lead) / period), 0)
    end = inputs.shape[0] // per_sample
    if length is not None:
        end = min(end, round((scenario.steer_time + length) / period))
    inputs = np.ascontiguousarray(inputs[begin * per_sample : end * per_sample])
    held = inputs[:, [column for column in range(inputs.shape[1]) if column != WHEEL]]
    if not inputs.size or not np.array_equal(held, np.broadcast_to(held[0], held.shape), equal_nan=True):
        raise CodegenError(
            "its speed or its road changes on the way",
            where=f"scenario {scenario.name}",
            remedy="take one that only steers, such as step-steer or sine-with-dwell",
        )
    first = dict(zip(INPUT_COLUMNS, inputs[0], strict=True))
    return Profile(
        scenario=scenario,
        inputs=inputs,
        steer_time=scenario.steer_time - begin * period,
        speed=float(first["speed"]),
        friction=float(first["friction"]),
        estimate=float(first["friction_estimate"]),
    )
