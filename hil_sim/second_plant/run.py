"""Closed loop of the third party's car and a generated controller, and its test cells."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.map_file.map import ReferenceMap
from codegen.sil.plant import PlantInput, PlantSample
from codegen.sil.software import RECORD_COLUMNS, Measurement, Software, Status
from codegen.units import KM_H
from hil_sim import manoeuvres
from hil_sim.scenarios import Scenario
from hil_sim.second_plant.plant import LeftModelError, MultiBodyPlant
from hil_sim.settings import Settings

SPEEDS_KM_H = (40.0, 70.0, 100.0)
SHARES = (0.3, 0.6, 0.9)
"""Fractions of the largest feasible front angle of the car's map at a speed."""

STEER_TIME, DURATION = 0.5, 4.0
"""Start of steering and duration of a cell, in s."""


@dataclass(frozen=True)
class StepCell:
    """A step steer: speed in km/h, share of the largest feasible front angle, and that front angle in rad."""

    speed_km_h: float
    share: float
    front_angle: float

    @property
    def scenario(self) -> Scenario:
        """Return the step as a scenario."""
        angle = math.degrees(self.front_angle)
        return Scenario(
            name=f"cell-{self.speed_km_h:g}-{100.0 * self.share:g}",
            subject="Step steer",
            what=f"a step to {100.0 * self.share:g} % of the largest feasible front angle",
            source="ISO 7401:2011, clause 10 (step input)",
            duration=DURATION,
            steer_time=STEER_TIME,
            kind="step",
            drive=manoeuvres.step(STEER_TIME, front_angle_deg=angle),
            settings=Settings(speed_km_h=self.speed_km_h),
            angle_text=f"{angle:.3g} deg at the front wheels",
        )


def largest_front_angle(reference_map: ReferenceMap, speed: float) -> float:
    """Return the largest feasible front angle (rad) of a map at a speed (m/s), interpolated linearly.

    Raises:
        CodegenError: the map does not reach that speed.
    """
    if not reference_map.speed[0] <= speed <= reference_map.speed[-1]:
        raise CodegenError(
            f"the map has no speed of {speed / KM_H:.4g} km/h",
            where="second plant",
            remedy=f"solve it from {SPEEDS_KM_H[0]:g} to {SPEEDS_KM_H[-1]:g} km/h or beyond",
        )
    angles = np.where(reference_map.feasible, reference_map.front_angle, 0.0).max(axis=1)
    return float(np.interp(speed, reference_map.speed, angles))


def cells(reference_map: ReferenceMap) -> tuple[StepCell, ...]:
    """Return the nine cells of a map: SPEEDS_KM_H by SHARES. Raises CodegenError if the map does not reach the speeds."""
    return tuple(
        StepCell(speed, share, share * largest_front_angle(reference_map, speed * KM_H))
        for speed in SPEEDS_KM_H
        for share in SHARES
    )


def run(
    software: Software | None,
    config: Config,
    scenario: Scenario,
    *,
    parameters: Any | None = None,
    controller_parameters: Any | None = None,
) -> FloatArray:
    """Return a recording (samples, 12) of a scenario on the multi-body car, columns RECORD_COLUMNS.

    The speed is the car's own. After the car leaves the model's range, rows hold the time, NaN and the last status, which
    `hil_sim.metrics.spin_time` counts as a spin.

    Args:
        software: a compiled build; None is the passive car, its rear wheels straight.
        config: of the car (see `car_of`), its actuators and time steps; may differ from the build's.
        scenario: scenario; its faults are ignored, because there is no bus.
        parameters: of the car; None takes the default of `plant.published`.
        controller_parameters: a C parameter struct; None takes the build's.

    Raises:
        CodegenError: the package is missing, or the scenario cannot be driven.
    """
    plant = MultiBodyPlant(config, float(scenario.inputs(config)[0, 0]), parameters)

    def measured(car: PlantSample) -> dict[str, float]:
        return {"speed": plant.speed, **measured_of(car)}

    return drive(plant, software, config, scenario, measured, controller_parameters=controller_parameters)


def measured_of(car: PlantSample) -> dict[str, float]:
    """Return the fields of a measurement that sensors without errors take from a sample."""
    return {
        "front_angle": car.front_angle,
        "yaw_rate": car.yaw_rate,
        "rear_angle": car.measured_rear_angle,
        "lateral_acceleration": car.measured_lateral_acceleration,
    }


class SteppedPlant(Protocol):
    """A car that is simulated step by step from Python."""

    @property
    def speed(self) -> float:
        """Speed in m/s at the last sample."""

    @property
    def position(self) -> tuple[float, float, float]:
        """Position forward and to the left in the road frame in m, and heading in rad."""

    def sample(self, acting: PlantInput) -> PlantSample:
        """Return the current outputs."""

    def advance(self, acting: Iterable[PlantInput]) -> None:
        """Advance by one plant step for each input."""


def drive(
    plant: SteppedPlant,
    software: Software | None,
    config: Config,
    scenario: Scenario,
    measured: Callable[[PlantSample], Mapping[str, float]],
    *,
    controller_parameters: Any | None = None,
) -> FloatArray:
    """Return a recording (samples, 12) of a scenario on any car; see `run`.

    Args:
        plant: car at its start.
        measured: function that returns the fields of a measurement at a sample, in SI units; called once a sample.
    """
    inputs, driver, commands = scenario.inputs(config), scenario.driver(config), scenario.rear_angle_commands(config)
    controller = None if software is None else software.controller(parameters=controller_parameters)
    period = config.controller.sampling_time_s
    per_sample = round(period / config.plant.sampling_time_s)
    record = np.full((len(inputs) // per_sample, len(RECORD_COLUMNS)), math.nan)
    record[:, 0] = np.arange(len(record)) * period
    waiting = deque([0.0] * config.driven_delay_samples)
    command, reference, status = 0.0, 0.0, Status.STANDBY
    for index, row in enumerate(record):
        steps = inputs[index * per_sample : (index + 1) * per_sample].tolist()
        speed, wheel, friction, estimate, moment, inhibit, acceleration = steps[0]
        try:
            car = plant.sample(PlantInput(speed, wheel, 0.0, friction, moment))
            if driver is not None:
                wheel = driver.steer(plant.position, car.sideslip_angle, car.yaw_rate)
                steps = [[step[0], wheel, *step[2:]] for step in steps]
            if controller is not None:
                sample = {**measured(car), **car.recorded, "friction": estimate, "longitudinal_acceleration": acceleration}
                answer = controller.step(Measurement(**sample, inhibit=bool(inhibit)))
                command, reference, status = answer.rear_angle, answer.yaw_rate_reference, answer.status
                if commands is not None:
                    command = float(commands[index])
            row[1:] = (
                *(plant.speed, car.front_angle, car.yaw_rate, reference, car.sideslip_angle, car.lateral_acceleration),
                *(command, car.rear_angle, car.slip_front, car.slip_rear, *car.recorded_values(), status),
            )
            waiting.append(command)
            acting = waiting.popleft()
            plant.advance(PlantInput(v, angle, acting, mu, torque) for v, angle, mu, _, torque, *_ in steps)
        except LeftModelError:
            record[index:, -1] = status
            break
    return record
