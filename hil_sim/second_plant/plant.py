"""Third-party multi-body car behind the interface of `codegen.sil.plant.Plant`, with rear steering, which the model lacks.

The model's right-hand side calls four tyre functions through one name of its module, each for the wheels LF, RF, LR, RR in
that order. Its code object runs in a namespace in which that name is `SteeredTyres`. For the rear wheels it

- takes the slip angle of the turned wheel, alpha - delta_r,
- takes the longitudinal slip from the speed along the turned wheel,
- calls the original tyre functions for the forces in the wheel's axes, and
- returns them in the car's axes, as the model does at the front.

The equation of the wheel's spin needs the force in the wheel's axes and is corrected afterwards. The installed package and its
modules are not changed, and two instances share nothing.

The model's axes are x forward, y to the right, z down (SAE J670): angles and rates are positive to the right.
"""

from __future__ import annotations

import importlib
import math
import types
from collections.abc import Iterable
from typing import Any

from codegen import configuration
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.requirements import pip_install
from codegen.sil.plant import PlantInput, PlantSample

PUBLISHED = {1: "Ford Escort", 2: "BMW 320i", 3: "VW Vanagon"}
"""The cars of the package that have the data of the multi-body model."""

DEFAULT_CAR = 2
PACKAGE = "commonroad-vehicle-models"


def module(name: str) -> Any:
    """Import the module `vehiclemodels.<name>`.

    Raises:
        CodegenError: the package is not installed, or is one that has no such module.
    """
    try:
        return importlib.import_module(f"vehiclemodels.{name}")
    except ImportError as error:
        raise CodegenError(
            f"the multi-body car cannot be imported ({error})",
            where=PACKAGE,
            remedy=pip_install(PACKAGE),
        ) from None


def published(number: int = DEFAULT_CAR) -> Any:
    """Return a new parameter set of one of the PUBLISHED cars in SI units, with the package's names.

    Raises:
        CodegenError: no such car, or see `module`.
    """
    if number not in PUBLISHED:
        known = ", ".join(f"{key} ({name})" for key, name in PUBLISHED.items())
        raise CodegenError(f"there is no multi-body car {number}", where=PACKAGE, remedy=f"known: {known}")
    return module("vehicle_parameters").setup_vehicle_parameters(vehicle_id=number)


GRAVITY = 9.81
"""m/s^2, as the multi-body model has it."""

SLIP_STEP = 1e-4
"""Half of the step in rad over which the tyre's slope at zero slip is taken. The relative error is (B step)^2 / 3."""


def static_loads(parameters: Any) -> tuple[float, float]:
    """Return the static load of one front and of one rear wheel in N: body and axle masses."""
    wheelbase = parameters.a + parameters.b
    body = parameters.m_s * GRAVITY / wheelbase
    return (
        0.5 * (body * parameters.b + parameters.m_uf * GRAVITY),
        0.5 * (body * parameters.a + parameters.m_ur * GRAVITY),
    )


def cornering_stiffness(parameters: Any, load: float) -> float:
    """Return the slope of the car's tyre function at zero slip and camber in N/rad, for one wheel at a load (N)."""
    lateral = module("utils.tire_model").formula_lateral
    left, right = (lateral(slip, 0.0, load, parameters.tire)[0] for slip in (-SLIP_STEP, SLIP_STEP))
    return float(left - right) / (2.0 * SLIP_STEP)


def front_roll_share(parameters: Any) -> float:
    """Return the share of the front axle in the roll stiffness: springs (K T^2 / 2 for an axle) and auxiliary stiffness."""
    front = 0.5 * parameters.K_sf * parameters.T_f**2 - parameters.K_tsf
    rear = 0.5 * parameters.K_sr * parameters.T_r**2 - parameters.K_tsr
    return float(front / (front + rear))


def car_of(parameters: Any, base: Config | None = None) -> Config:
    """Return the configuration of a multi-body car: vehicle, tyres and road; the rest as in `base`.

    Mass, inertia, heights and arms are the data's, the track is the mean of both axles. The tyre formula has the form of
    ours, so C, E and the peak friction are its own; the stiffness is its slope at the static load of each axle. The default of
    `base` is the recommended preset.

    Raises:
        CodegenError: the package is missing.
        ConfigError: the configuration does not support the data.
    """
    tyre = parameters.tire
    front, rear = (
        {
            "cornering_stiffness_n_per_rad": cornering_stiffness(parameters, load),
            "shape_factor_c": tyre.p_cy1,
            "curvature_factor_e": tyre.p_ey1,
        }
        for load in static_loads(parameters)
    )
    data = (configuration.preset("recommended") if base is None else base).model_dump(mode="json")
    data["vehicle"] = {
        "mass_kg": parameters.m,
        "yaw_inertia_kg_m2": parameters.I_z,
        "cg_height_m": parameters.h_cg,
        "track_m": 0.5 * (parameters.T_f + parameters.T_r),
        "cg_to_front_axle_m": parameters.a,
        "cg_to_rear_axle_m": parameters.b,
        "front_roll_share": front_roll_share(parameters),
    }
    data["tyre"] = {"front": front, "rear": rear}
    data["road"] = {"friction": tyre.p_dy1, "gravity_m_s2": GRAVITY}
    return configuration.parse(data, "commonroad-vehicle-models")


FUNCTIONS, WHEELS = 4, 4
FIRST_REAR = 2

FORWARD_SPEED, YAW_RATE, ROLL, PITCH, SIDE_SPEED, HEIGHT = 3, 5, 6, 8, 10, 11
FRONT_HEIGHT, REAR_HEIGHT = 16, 21
REAR_SPIN = (25, 26)
"""Places in the state vector, numbered from 0."""


class SteeredTyres:
    """The tyre functions as the right-hand side calls them, with the rear wheels turned and the friction of the road scaled.

    The names are the third party's. Friction scales the forces of every wheel and leaves the slip at which they peak, as our
    own plant has it.
    """

    def __init__(self, tyres: Any) -> None:
        self._tyres = tyres
        self.prepare(0.0, (1.0, 1.0), 0.0, 1.0)

    def prepare(self, rear_angle: float, rear_speeds: tuple[float, float], rear_side_speed: float, friction: float) -> None:
        """Set up one call of the right-hand side.

        Args:
            rear_angle: rad.
            rear_speeds: m/s forward at the left and the right rear wheel.
            rear_side_speed: m/s sideways at the rear axle.
            friction: of the road over that of the tyre data.
        """
        self._angle, self._friction = rear_angle, friction
        self._cos, self._sin = math.cos(rear_angle), math.sin(rear_angle)
        # 1 - slip is R omega over the speed along the wheel. The change is zero, exactly, for wheels straight ahead.
        self._slip_change = tuple(
            1.0 - speed / (speed * self._cos + rear_side_speed * self._sin) if rear_angle else 0.0 for speed in rear_speeds
        )
        self._pure_lateral: list[tuple[float, float, float, float]] = []
        self._across: list[float] = []
        self.spin_excess: list[float] = []
        """Force along the wheel minus force along the car, in N for each rear wheel."""
        self.calls = [0] * FUNCTIONS

    def _wheel(self, function: int) -> int:
        wheel = self.calls[function]
        self.calls[function] = wheel + 1
        return wheel

    def _turned(self, slip: float, wheel: int) -> float:
        return slip + (1.0 - slip) * self._slip_change[wheel - FIRST_REAR]

    def formula_longitudinal(self, slip: float, camber: float, load: float, tyre: Any) -> float:
        """Return the force of pure longitudinal slip in the wheel's axes in N, an input of `formula_longitudinal_comb`."""
        wheel = self._wheel(0)
        if wheel >= FIRST_REAR:
            slip = self._turned(slip, wheel)
        force: float = self._tyres.formula_longitudinal(slip, camber, load, tyre)
        return force

    def formula_lateral(self, slip_angle: float, camber: float, load: float, tyre: Any) -> tuple[float, float]:
        """Return force (N, wheel's axes) and friction of pure lateral slip, inputs of `formula_lateral_comb`."""
        wheel = self._wheel(1)
        if wheel >= FIRST_REAR:
            slip_angle -= self._angle
        force, friction = self._tyres.formula_lateral(slip_angle, camber, load, tyre)
        if wheel >= FIRST_REAR:
            self._pure_lateral.append((camber, friction, load, force))
        return force, friction

    def formula_longitudinal_comb(self, slip: float, slip_angle: float, pure: float, tyre: Any) -> float:
        """Return the force along the car in N. For a rear wheel, also compute and keep the force across the car."""
        wheel = self._wheel(2)
        if wheel < FIRST_REAR:
            return self._friction * float(self._tyres.formula_longitudinal_comb(slip, slip_angle, pure, tyre))
        slip, slip_angle = self._turned(slip, wheel), slip_angle - self._angle
        lateral = self._pure_lateral[wheel - FIRST_REAR]
        along = self._friction * self._tyres.formula_longitudinal_comb(slip, slip_angle, pure, tyre)
        across = self._friction * self._tyres.formula_lateral_comb(slip, slip_angle, *lateral, tyre)
        along_car: float = along * self._cos - across * self._sin
        self._across.append(across * self._cos + along * self._sin)
        self.spin_excess.append(along - along_car)
        return along_car

    def formula_lateral_comb(
        self, slip: float, slip_angle: float, camber: float, friction: float, load: float, pure: float, tyre: Any
    ) -> float:
        """Return the force across the car in N."""
        wheel = self._wheel(3)
        if wheel >= FIRST_REAR:
            return self._across[wheel - FIRST_REAR]
        return self._friction * float(self._tyres.formula_lateral_comb(slip, slip_angle, camber, friction, load, pure, tyre))


class RearSteeredCar:
    """The right-hand side of the multi-body car with two more inputs: the rear angle and the friction of the road.

    Args:
        parameters: a parameter set of the package; see `published`.

    Raises:
        CodegenError: the package is missing, or is an unsupported release.
    """

    def __init__(self, parameters: Any) -> None:
        original = module("vehicle_dynamics_mb").vehicle_dynamics_mb
        self.parameters = parameters
        self._tyres = SteeredTyres(module("utils.tire_model"))
        namespace = {**original.__globals__, "tireModel": self._tyres}
        self._right_hand_side = types.FunctionType(original.__code__, namespace, original.__name__)
        self.derivative(self.straight_ahead(10.0), 0.0, 0.0)  # rejects an unknown release before a run

    def straight_ahead(self, speed: float) -> list[float]:
        """Return the state (29) of the car rolling straight at a speed (m/s), at rest on its springs.

        It is the package's initial state except for height and pitch of the body. The package lifts the body by the static
        deflection of the tyres, so it would bounce for the first second.
        """
        car = self.parameters
        start = module("init_mb").init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], car)
        state = [float(value) for value in start]
        front, rear = state[FRONT_HEIGHT], state[REAR_HEIGHT]
        state[PITCH] = (rear - front) / (car.a + car.b)
        state[HEIGHT] = front + car.a * state[PITCH]
        return state

    def derivative(
        self,
        state: list[float],
        steering_rate: float,
        acceleration: float,
        rear_angle: float = 0.0,
        friction: float = 1.0,
        yaw_moment: float = 0.0,
    ) -> list[float]:
        """Return the time derivative (29) of a state (29).

        Args:
            state: the package's; not changed.
            steering_rate: rad/s at the front wheels. acceleration: m/s^2, demanded from engine and brakes.
            rear_angle: rad. friction: of the road over that of the tyre data. yaw_moment: N m, from outside.

        Raises:
            ArithmeticError, ValueError: the model has no value there, as with a wheel that rolls backwards.
            CodegenError: an unsupported release of the package.
        """
        car, spin = self.parameters, 0.5 * self.parameters.T_r * state[YAW_RATE]
        forward = state[FORWARD_SPEED]
        side_speed = state[SIDE_SPEED] - car.b * state[YAW_RATE]
        self._tyres.prepare(rear_angle, (forward + spin, forward - spin), side_speed, friction)
        rates: list[float] = self._right_hand_side(list(state), (steering_rate, acceleration), car)
        if self._tyres.calls != [WHEELS] * FUNCTIONS:
            raise CodegenError(
                "the multi-body car does not call its tyre functions once a wheel; this release is not known",
                where=PACKAGE,
                remedy=pip_install(PACKAGE),
            )
        for place, excess in zip(REAR_SPIN, self._tyres.spin_excess, strict=True):
            if state[place] >= 0.0:  # the package stops a wheel that would turn backwards
                rates[place] -= car.R_w / car.I_y_w * excess
        rates[YAW_RATE] += yaw_moment / car.I_z
        return rates


SPEED_GAIN = 10.0
"""Gain of the speed controller in 1/s: acceleration demanded for each m/s of speed error."""

STEERING = 2
FRONT_SIDE_SPEED, REAR_SIDE_SPEED = 15, 20
SPINS = slice(23, 27)
"""Places in the state vector, numbered from 0."""

ROLL_MAX = math.radians(30.0)
SIDESLIP_MAX = math.radians(60.0)
"""Range of the model; beyond it the car lies on its side or slides backwards, which the tyre data and the suspension do not
cover."""


class LeftModelError(CodegenError):
    """The car has rolled over or spun beyond the range of its model."""

    def __init__(self, how: str) -> None:
        super().__init__(
            f"the multi-body car has left the range of its model ({how})",
            where="second plant",
            remedy="check the run before that time",
        )


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


class MultiBodyPlant:
    """Multi-body car with the steering and the rear actuator of a configuration, starting straight ahead.

    Both are those of `codegen.vehicle.dynamics.two_track`; in addition, the car's own data limit the rate and the angle of
    its front wheels. The speed is not imposed: a proportional controller drives the car's engine and brakes. Signs are ISO
    8855, those of our own plant, and turned around inside.

    Args:
        config: of the actuators, and the time step. See `car_of` for the rest.
        speed: m/s, at the beginning; above 1.
        parameters: of the car; None takes the default of `published`.

    Raises:
        CodegenError: the package is missing, or the car would not move.
    """

    def __init__(self, config: Config, speed: float, parameters: Any | None = None) -> None:
        if not speed > 1.0:
            raise CodegenError(
                f"the multi-body car cannot start at {speed:.3g} m/s", where="second plant", remedy="begin above 1 m/s"
            )
        self._config = config
        self._car = RearSteeredCar(published() if parameters is None else parameters)
        self._state = [*self._car.straight_ahead(speed), 0.0]  # the last one: the rear angle

    @property
    def speed(self) -> float:
        """Forward speed in m/s, close to the demanded one."""
        return self._state[FORWARD_SPEED]

    @property
    def _sideslip(self) -> float:
        return -math.atan2(self._state[SIDE_SPEED], self._state[FORWARD_SPEED])

    @property
    def position(self) -> tuple[float, float, float]:
        """Position forward and to the left in the road frame in m, and heading in rad."""
        return self._state[0], -self._state[1], -self._state[4]

    def sample(self, acting: PlantInput) -> PlantSample:
        """Return the current outputs. The rear angle command does not affect them. Raises LeftModelError."""
        state, car = self._state, self._car.parameters
        if not (abs(state[ROLL]) < ROLL_MAX and abs(self._sideslip) < SIDESLIP_MAX):
            raise LeftModelError(f"roll {math.degrees(state[ROLL]):.3g} deg, sideslip {math.degrees(self._sideslip):.3g} deg")
        rates = self._rates(state, acting)
        forward, side, yaw_rate = state[FORWARD_SPEED], state[SIDE_SPEED], state[YAW_RATE]
        # Mean over the three masses: the lateral tyre force over the mass of the car.
        masses = ((car.m_s, SIDE_SPEED), (car.m_uf, FRONT_SIDE_SPEED), (car.m_ur, REAR_SIDE_SPEED))
        pull = sum(mass * rates[place] for mass, place in masses) / sum(mass for mass, _ in masses)
        slip_front = math.atan2(side + car.a * yaw_rate, forward) - state[STEERING]
        slip_rear = math.atan2(side - car.b * yaw_rate, forward) - state[-1]
        lateral_acceleration = -(pull + forward * yaw_rate)
        return PlantSample(
            front_angle=-state[STEERING],
            yaw_rate=-yaw_rate,
            rear_angle=-state[-1],
            sideslip_angle=self._sideslip,
            lateral_acceleration=lateral_acceleration,
            slip_front=-slip_front,
            slip_rear=-slip_rear,
            measured_rear_angle=-state[-1],
            measured_lateral_acceleration=lateral_acceleration,
        )

    def advance(self, acting: Iterable[PlantInput]) -> None:
        """Advance by one plant step for each input. Raises LeftModelError."""
        for values in acting:
            self._step(values, self._config.plant.sampling_time_s)

    def _step(self, acting: PlantInput, step: float) -> None:
        """Advance by one step (s) of the classical Runge-Kutta method of order four, with the input held."""
        start, half = self._state, 0.5 * step
        k1 = self._rates(start, acting)
        k2 = self._rates([x + half * k for x, k in zip(start, k1, strict=True)], acting)
        k3 = self._rates([x + half * k for x, k in zip(start, k2, strict=True)], acting)
        k4 = self._rates([x + step * k for x, k in zip(start, k3, strict=True)], acting)
        sixth = step / 6.0
        state = [x + sixth * (a + 2.0 * (b + c) + d) for x, a, b, c, d in zip(start, k1, k2, k3, k4, strict=True)]
        state[SPINS] = [max(spin, 0.0) for spin in state[SPINS]]  # in the package no wheel turns backwards
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
