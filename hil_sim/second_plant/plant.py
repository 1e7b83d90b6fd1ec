"""The third party's car behind the interface of `codegen.sil.plant.Plant`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.sil.plant import PlantInput, PlantSample
from hil_sim.second_plant import package
from hil_sim.second_plant.rear_steer import FORWARD_SPEED, ROLL, SIDE_SPEED, YAW_RATE, RearSteeredCar

SPEED_GAIN = 10.0
"""1/s: acceleration wanted of engine and brakes for each m/s that the car is too slow."""

STEERING = 2
FRONT_SIDE_SPEED, REAR_SIDE_SPEED = 15, 20
SPINS = slice(23, 27)
"""Places in the state vector, numbered from 0."""

ROLL_MAX = math.radians(30.0)
SIDESLIP_MAX = math.radians(60.0)
"""Beyond, the car lies on its side or slides backwards; tyre data and small-angle suspension say nothing of that."""


class LeftModelError(CodegenError):
    """The car has rolled over or spun to where its model means nothing."""

    def __init__(self, how: str) -> None:
        super().__init__(
            f"the multi-body car has left the range of its model ({how})",
            where="second plant",
            remedy="look at the run before that moment",
        )


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


class MultiBodyPlant:
    """The multi-body car, rolling straight ahead at first, with the steering and the rear actuator of a configuration.

    Both are those of `codegen.vehicle.dynamics.two_track`; besides, the car's own data limit the rate and the angle of its
    front wheels. The speed is not imposed: a proportional controller asks the car's own engine and brakes for it. Signs are ISO
    8855, those of our own plant, and turned around inside.

    Args:
        config: of the actuators, and the time step. See `car_of` for the rest.
        speed: m/s, at the beginning; above 1.
        parameters: of the car; None takes the default of `package.published`.

    Raises:
        CodegenError: the package is missing, or the car would stand.
    """

    def __init__(self, config: Config, speed: float, parameters: Any | None = None) -> None:
        if not speed > 1.0:
            raise CodegenError(
                f"the multi-body car cannot start at {speed:.3g} m/s", where="second plant", remedy="begin above 1 m/s"
            )
        self._config = config
        self._car = RearSteeredCar(package.published() if parameters is None else parameters)
        self._state = [*self._car.straight_ahead(speed), 0.0]  # the last one: the rear angle

    @property
    def speed(self) -> float:
        """Forward speed in m/s: nearly the one that is asked for."""
        return self._state[FORWARD_SPEED]

    @property
    def _sideslip(self) -> float:
        return -math.atan2(self._state[SIDE_SPEED], self._state[FORWARD_SPEED])

    @property
    def position(self) -> tuple[float, float, float]:
        """m forward and m to the left in the road frame, heading in rad."""
        return self._state[0], -self._state[1], -self._state[4]

    def sample(self, acting: PlantInput) -> PlantSample:
        """The car as it is now. The rear angle command makes no difference to it. Raises LeftModelError."""
        state, car = self._state, self._car.parameters
        if not (abs(state[ROLL]) < ROLL_MAX and abs(self._sideslip) < SIDESLIP_MAX):
            raise LeftModelError(f"roll {math.degrees(state[ROLL]):.3g} deg, sideslip {math.degrees(self._sideslip):.3g} deg")
        rates = self._rates(state, acting)
        forward, side, yaw_rate = state[FORWARD_SPEED], state[SIDE_SPEED], state[YAW_RATE]
        # Of all three masses: what the tyres give sideways, over the mass of the car.
        masses = ((car.m_s, SIDE_SPEED), (car.m_uf, FRONT_SIDE_SPEED), (car.m_ur, REAR_SIDE_SPEED))
        pull = sum(mass * rates[place] for mass, place in masses) / sum(mass for mass, _ in masses)
        slip_front = math.atan2(side + car.a * yaw_rate, forward) - state[STEERING]
        slip_rear = math.atan2(side - car.b * yaw_rate, forward) - state[-1]
        return PlantSample(
            front_angle=-state[STEERING],
            yaw_rate=-yaw_rate,
            rear_angle=-state[-1],
            sideslip_angle=self._sideslip,
            lateral_acceleration=-(pull + forward * yaw_rate),
            slip_front=-slip_front,
            slip_rear=-slip_rear,
        )

    def advance(self, acting: Iterable[PlantInput]) -> None:
        """One plant step for each input. Raises LeftModelError."""
        for values in acting:
            self._step(values, self._config.plant.sampling_time_s)

    def _step(self, acting: PlantInput, step: float) -> None:
        """One step (s) of the classical Runge-Kutta method of order four, the input held."""
        start, half = self._state, 0.5 * step
        k1 = self._rates(start, acting)
        k2 = self._rates([x + half * k for x, k in zip(start, k1, strict=True)], acting)
        k3 = self._rates([x + half * k for x, k in zip(start, k2, strict=True)], acting)
        k4 = self._rates([x + step * k for x, k in zip(start, k3, strict=True)], acting)
        sixth = step / 6.0
        state = [x + sixth * (a + 2.0 * (b + c) + d) for x, a, b, c, d in zip(start, k1, k2, k3, k4, strict=True)]
        state[SPINS] = [max(spin, 0.0) for spin in state[SPINS]]  # the package lets no wheel turn backwards
        self._state = state

    def _rates(self, state: list[float], acting: PlantInput) -> list[float]:
        steering, actuator = self._config.steering, self._config.rear_actuator
        *body, rear = state
        wheel_rate = (-acting.steering_wheel_command - body[STEERING] * steering.ratio) / steering.lag_s
        rear_demand = _clamp(-acting.rear_angle_command, actuator.angle_max)
        rear_rate = _clamp((rear_demand - rear) / actuator.lag_s, math.radians(actuator.rate_max_deg_s))
        try:
            rates = self._car.derivative(
                body,
                _clamp(wheel_rate, math.radians(steering.wheel_rate_max_deg_s)) / steering.ratio,
                SPEED_GAIN * (acting.speed - body[FORWARD_SPEED]),
                rear,
                acting.friction / self._car.parameters.tire.p_dy1,
                -acting.yaw_moment,
            )
        except (ArithmeticError, ValueError) as error:
            raise LeftModelError(str(error)) from None
        rates.append(rear_rate)
        return rates
