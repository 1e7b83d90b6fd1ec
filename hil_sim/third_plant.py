"""Third plant for cross-checks: the configured car with effects that the two-track plant and the controller's design omit.

The car, CasADi expressions that are compiled like those of our own plant, adds roll, tyres that differ between the axles, with
relaxation lengths, and a rear actuator of second order with backlash. `run` adds sensors with noise, bias and jitter and closes
the loop with a generated controller. See docs/second-plant.md.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.sil.plant import Plant, PlantInput, PlantSample
from codegen.sil.software import Software
from codegen.vehicle.dynamics import (
    PLANT_INPUTS,
    PLANT_OUTPUTS,
    PLANT_STATES,
    RELAXATION_STATES,
    Model,
    clamp,
    magic_formula,
    make_model,
)
from codegen.vehicle.plant_car import PlantCar
from codegen.vehicle.tyre import WHEEL_SPEED_MIN
from hil_sim.bench import refuse_bus
from hil_sim.plant_node import SensorModel
from hil_sim.scenarios import Scenario
from hil_sim.second_plant.run import drive
from hil_sim.suite.cells import load_sensitivity, stiffness, together

STATES = (*PLANT_STATES, "roll", "roll_rate", "motor_angle", "motor_rate", *RELAXATION_STATES)
"""States: those of our own plant, the roll angle in rad (positive to the right), and the rear actuator's motor in rad,
before the backlash."""

PLAY_TIME_CONSTANT = 0.004
"""Time constant in s with which the wheels follow the motor: stiff compared with the rest, and slow enough for a step of 1
ms."""


@dataclass(frozen=True)
class Differences:
    """Properties of the car beyond those of the configuration.

    Attributes:
        sprung_fraction: of the mass, on the springs.
        roll_centre_height: m, of both axles.
        roll_per_lateral_acceleration: rad for each m/s^2, steady.
        roll_radius: m, radius of gyration of the sprung mass about its own axis.
        roll_damping: damping ratio.
        stiffness_percent: change of the slopes of front and rear tyre.
        peak_load_sensitivity: p2 of all tyres.
        relaxation_length: m, of front and rear tyre.
        motor_fraction: time constant of the motor's rate over the actuator's lag; the damping ratio is half of the root of its
            inverse.
        play: rad, half of the backlash between motor and wheels.
    """

    sprung_fraction: float = 0.88
    roll_centre_height: float = 0.1
    roll_per_lateral_acceleration: float = math.radians(4.0) / 9.81
    roll_radius: float = 0.55
    roll_damping: float = 0.3
    stiffness_percent: tuple[float, float] = (-10.0, 5.0)
    peak_load_sensitivity: float = -0.15
    relaxation_length: tuple[float, float] = (0.35, 0.5)
    motor_fraction: float = 0.5
    play: float = math.radians(0.05)


DEFAULT = Differences()
NONE = Differences(
    roll_centre_height=0.0,
    roll_per_lateral_acceleration=DEFAULT.roll_per_lateral_acceleration / 20.0,
    stiffness_percent=(0.0, 0.0),
    peak_load_sensitivity=0.0,
    relaxation_length=(0.05, 0.05),
    motor_fraction=0.02,
    play=0.0,
)
"""Differences as small as the integration step allows."""


def roll_car(config: Config, differences: Differences = DEFAULT) -> Model:
    """Return the car: states STATES, inputs and outputs of our own plant.

    Planar motion at a given forward speed with roll about an axis along the road (R. Rajamani, Vehicle Dynamics and Control;
    L. Segel, Theoretical prediction and experimental substantiation of the response of the automobile to steering control,
    1956). The springs and the roll centres move the load between the wheels of an axle. Each tyre builds up its force over its
    relaxation length. The motor's rate follows what the lag and the rate limit of the configured actuator ask for; the wheels
    follow the motor beyond the play.

    Raises:
        ConfigError: the changed tyres are rejected.
    """
    d = differences
    config = together(stiffness(*d.stiffness_percent), load_sensitivity(d.peak_load_sensitivity))(config)
    car, gravity = PlantCar.from_config(config), config.road.gravity_m_s2
    chassis, height = car.chassis, config.vehicle.cg_height_m
    x, u = ca.SX.sym("x", len(STATES)), ca.SX.sym("u", len(PLANT_INPUTS))
    lateral_speed, yaw_rate, wheel_angle, rear, _, _, heading, roll, roll_rate, motor, motor_rate = (x[i] for i in range(11))
    speed, wheel_command, rear_command, friction, yaw_moment, lateral_force = (u[i] for i in range(len(PLANT_INPUTS)))
    front = wheel_angle / chassis.steering_ratio

    # The sprung mass times its height above the roll axis, which with the roll centres gives the whole car's moment.
    first_moment = chassis.mass * (height - d.roll_centre_height)
    sprung = d.sprung_fraction * chassis.mass
    inertia = sprung * d.roll_radius**2 + first_moment**2 / sprung
    restoring = first_moment / d.roll_per_lateral_acceleration  # N m/rad, springs less gravity
    damping = 2.0 * d.roll_damping * math.sqrt(restoring * inertia)
    springs = (restoring + first_moment * gravity) * roll + damping * roll_rate

    share = config.vehicle.front_roll_share
    wheelbase = chassis.cg_to_front_axle + chassis.cg_to_rear_axle
    centres = chassis.mass * d.roll_centre_height * speed * yaw_rate / wheelbase
    moved = (
        (share * springs + centres * chassis.cg_to_rear_axle) / chassis.track,
        ((1.0 - share) * springs + centres * chassis.cg_to_front_axle) / chassis.track,
    )

    force_y, moment = lateral_force, yaw_moment
    slips: list[Any] = []
    slip_rates: list[Any] = []
    axles = ((car.front, chassis.cg_to_front_axle, front), (car.rear, -chassis.cg_to_rear_axle, rear))
    for axle, (tyre, arm, angle) in enumerate(axles):
        axle_speed = lateral_speed + arm * yaw_rate
        slips.append(ca.atan(axle_speed / ca.fmax(speed, WHEEL_SPEED_MIN)) - angle)
        load = clamp(moved[axle], tyre.static_load)
        for side in (1.0, -1.0):  # left, right
            wheel_speed = ca.fmax(speed - side * 0.5 * chassis.track * yaw_rate, WHEEL_SPEED_MIN)
            held = x[11 + len(slip_rates)]
            slip = ca.atan(axle_speed / wheel_speed) - angle
            slip_rates.append(wheel_speed / d.relaxation_length[axle] * (slip - held))
            force = -magic_formula(tyre, held, tyre.static_load - side * load, friction)
            force_y += force * ca.cos(angle)
            moment += arm * force * ca.cos(angle) + side * 0.5 * chassis.track * force * ca.sin(angle)

    # m a - s p = F and J p - s a = M for the lateral acceleration a of the roll axis and the roll acceleration p.
    roll_moment = first_moment * gravity * ca.sin(roll) - springs
    determinant = chassis.mass * inertia - first_moment**2
    acceleration = (inertia * force_y + first_moment * roll_moment) / determinant
    roll_acceleration = (chassis.mass * roll_moment + first_moment * force_y) / determinant

    rate_demand = clamp((clamp(rear_command, chassis.rear_angle_max) - motor) / chassis.rear_lag, chassis.rear_rate_max)
    play = motor - rear
    derivative = ca.vertcat(
        acceleration - speed * yaw_rate,
        moment / chassis.yaw_inertia,
        clamp((wheel_command - wheel_angle) / chassis.steering_lag, chassis.steering_rate_max),
        (play - clamp(play, d.play)) / PLAY_TIME_CONSTANT,
        speed * ca.cos(heading) - lateral_speed * ca.sin(heading),
        speed * ca.sin(heading) + lateral_speed * ca.cos(heading),
        yaw_rate,
        roll_rate,
        roll_acceleration,
        motor_rate,
        (rate_demand - motor_rate) / (d.motor_fraction * chassis.rear_lag),
        *slip_rates,
    )
    sideslip = ca.atan(lateral_speed / ca.fmax(speed, WHEEL_SPEED_MIN))
    output = ca.vertcat(sideslip, force_y / chassis.mass, front, slips[0], slips[1])
    return make_model("roll_car", (STATES, PLANT_INPUTS, PLANT_OUTPUTS), x, u, derivative, output)


class RollPlant(Plant):
    """Third plant, starting straight ahead with all states zero, with the recent values of its sensors.

    Attributes:
        speed: m/s, of the last sample.
        seen: front angle, yaw rate and the actuator's own angle (rad, rad/s) after each of the last plant steps, newest last.

    Raises:
        BuildError: the C does not compile here.
        ConfigError: see `roll_car`.
    """

    def __init__(self, config: Config, differences: Differences = DEFAULT, remembered: int = 1) -> None:
        super().__init__(config, roll_car(config, differences))
        self._ratio = config.steering.ratio
        self.speed = 0.0
        self.seen: deque[tuple[float, float, float]] = deque([(0.0, 0.0, 0.0)], maxlen=remembered)

    @property
    def roll(self) -> float:
        """Roll angle in rad, positive to the right."""
        return float(self._state.roll)

    def sample(self, acting: PlantInput) -> PlantSample:
        """Return the current outputs. The rear angle command does not affect them."""
        self.speed = acting.speed
        return super().sample(acting)

    def advance(self, acting: Iterable[PlantInput]) -> None:
        """Advance by one plant step for each input."""
        for values in acting:
            super().advance((values,))
            state = self._state
            self.seen.append((state.steering_wheel_angle / self._ratio, state.yaw_rate, state.motor_angle))


BIASES: Mapping[str, float] = {
    "front_angle": math.radians(0.05),
    "yaw_rate": math.radians(0.25),
    "rear_angle": math.radians(0.05),
}
"""Bias of each sensor in rad and rad/s."""
SPEED_FACTOR = 1.005
"""Ratio of measured to true speed, for a tyre worn by 2 mm."""
JITTER_STEPS = 2
"""Largest age of a sample in plant steps; all ages are equally frequent."""


@dataclass(frozen=True)
class Errors:
    """Sensor errors in addition to the configured noise, resolution and delay."""

    biases: Mapping[str, float] = field(default_factory=lambda: dict(BIASES))
    speed_factor: float = SPEED_FACTOR
    jitter_steps: int = JITTER_STEPS


class Sensors:
    """The sensors of one run; the same seed gives the same run."""

    def __init__(self, config: Config, errors: Errors, seed: int) -> None:
        self._errors, self._model = errors, SensorModel(config.sensors, seed)
        self._random = np.random.default_rng((seed, 1))
        self._gravity = config.road.gravity_m_s2

    def measure(self, plant: RollPlant, lateral_acceleration: float) -> dict[str, float]:
        """Return the fields of a measurement without the friction, as measured; once a sample.

        The rear angle is that of the actuator's motor: no sensor sees the play behind it. The accelerometer rolls
        with the body.
        """
        age = min(int(self._random.integers(self._errors.jitter_steps + 1)), len(plant.seen) - 1)
        true = dict(zip(("front_angle", "yaw_rate", "rear_angle"), plant.seen[-1 - age], strict=True))
        biased = {name: value + self._errors.biases.get(name, 0.0) for name, value in true.items()}
        biased["speed"] = self._errors.speed_factor * plant.speed
        biased["lateral_acceleration"] = lateral_acceleration + self._gravity * math.sin(plant.roll)
        return {name: self._model.measure(name, value) for name, value in biased.items()}


def run(
    software: Software | None,
    config: Config,
    scenario: Scenario,
    *,
    seed: int = 0,
    differences: Differences = DEFAULT,
    errors: Errors | None = None,
    delay_samples: int = 1,
) -> FloatArray:
    """Return a recording (samples, 12) of a scenario on the third car, columns RECORD_COLUMNS, with the car's true motion.

    Args:
        software: a compiled build; None is the passive car, its rear wheels straight.
        config: of the car; may differ from the build's.
        seed: of noise and jitter.
        differences: from the configured car.
        errors: of the sensors; None takes the defaults.
        delay_samples: control samples between computing a command and its acting.

    Raises:
        BuildError: the C of the car does not compile here.
        CodegenError: the scenario needs a bus.
    """
    if software is not None:
        refuse_bus(scenario)
    errors = Errors() if errors is None else errors
    plant = RollPlant(config, differences, remembered=errors.jitter_steps + 1)
    sensors = Sensors(config, errors, seed)

    def measured(car: PlantSample) -> dict[str, float]:
        return sensors.measure(plant, car.lateral_acceleration)

    return drive(plant, software, config, scenario, measured, delay_samples=delay_samples)
