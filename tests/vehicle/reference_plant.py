"""An independent car model, written from the physics, as the oracle of the plant. It imports nothing from the project.

A rigid body moves in the plane at a given forward speed, on four wheels. The side force of each wheel follows from the slip
angle by the Magic Formula at that wheel's load and acts across the wheel. The lateral acceleration vx r transfers load from the
inner to the outer wheels, with a given share for each axle, until the inner wheel lifts. Where their figures are not zero:
the four slip angles that determine the forces are states too, the body rolls, and the rear actuator has a motor with inertia
and play behind it.
"""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.whole_car import with_car

SPRUNG, ROLL_CENTRE, ROLL_RADIUS, ROLL_DAMPING, PLAY_TIME = 0.88, 0.1, 0.55, 0.3, 0.004
"""Fraction of the mass, m, m, damping ratio, s: the constants of a body that rolls and of the play."""
ROLLING_SPEED_MIN = 0.5
"""m/s: a slower wheel counts as rolling at this speed."""


@dataclass(frozen=True)
class TyreData:
    """Data of one tyre. `slope` is its cornering stiffness in N/rad at static load and dry-road friction."""

    slope: float
    shape: float = 1.3
    curvature: float = -0.5
    peak: float = 1.0
    peak_with_load: float = 0.0
    shift_angle: float = 0.0
    shift_force: float = 0.0


@dataclass(frozen=True)
class Lag:
    """First-order lag with a rate limit: s, and units of the angle per second."""

    time_constant: float
    rate_limit: float

    def rate(self, error: float) -> float:
        """Return the rate of an angle that differs from its command by `error`."""
        return min(max(error / self.time_constant, -self.rate_limit), self.rate_limit)


@dataclass(frozen=True)
class Car:
    """A car in SI units. The defaults are the published car; its linear tyre data are for one tyre."""

    mass: float = 2335.07
    inertia: float = 5376.432
    height: float = 0.42
    track: float = 1.627
    to_front: float = 1.574
    to_rear: float = 1.566
    roll_share_front: float = 0.6
    gravity: float = 9.81
    dry_friction: float = 0.9
    front: TyreData = TyreData(119_540.0)
    rear: TyreData = TyreData(119_830.0)
    steering_ratio: float = 90.0 / 6.75
    steering: Lag = Lag(0.005, math.radians(300.0))
    rear_actuator: Lag = Lag(0.05, math.radians(30.0))
    rear_angle_max: float = math.radians(3.5)
    load_transfer_scale: float = 1.0
    relaxation_length: float = 0.0
    rear_relaxation_factor: float = 1.0
    kept_stiffness: float = 0.0
    roll_gradient: float = 0.0  # rad for each m/s^2
    motor_share: float = 0.0
    play: float = 0.0  # rad, from one end to the other

    @property
    def further_states(self) -> list[str]:
        """Return the names of the states after the seven of the rigid car."""
        slips = [f"slip_{axle}_{side}" for axle in ("front", "rear") for side in ("left", "right")]
        parts = (
            (self.relaxation_length, slips),
            (self.roll_gradient, ["roll", "roll_rate"]),
            (self.play, ["motor_angle"]),
            (self.motor_share, ["motor_rate"]),
        )
        return [name for value, names in parts if value for name in names]

    @property
    def body(self) -> tuple[float, float, float, float]:
        """Return the sprung mass times its height above the roll axis, its inertia about it, springs and dampers."""
        sprung = SPRUNG * self.mass
        lever = self.mass * (self.height - ROLL_CENTRE) / sprung  # all of the moment comes from the sprung mass
        inertia = sprung * (ROLL_RADIUS**2 + lever**2)
        restoring = sprung * lever / self.roll_gradient
        return (
            sprung * lever,
            inertia,
            restoring + sprung * lever * self.gravity,
            2 * ROLL_DAMPING * (restoring * inertia) ** 0.5,
        )

    @property
    def wheels(self) -> np.ndarray:
        """Return positions (x forward, y left) of front left, front right, rear left, rear right; shape (4, 2)."""
        side = 0.5 * self.track
        return np.array([[self.to_front, side], [self.to_front, -side], [-self.to_rear, side], [-self.to_rear, -side]])

    def static_loads(self) -> np.ndarray:
        """Return the loads of the four wheels at rest, from force and pitch balance; shape (4,)."""
        arms = self.wheels[:, 0]
        front_pair, rear_pair = np.linalg.solve([[2.0, 2.0], [2.0 * arms[0], 2.0 * arms[2]]], [self.mass * self.gravity, 0.0])
        return np.array([front_pair, front_pair, rear_pair, rear_pair])

    def loads(self, lateral_acceleration: float, roll: float = 0.0, roll_rate: float = 0.0) -> np.ndarray:
        """Return the loads of the four wheels in a turn. Roll balance about the ground line: w (dF_front + dF_rear) = m ay
        h. A body that rolls moves load by its springs and dampers, and at the roll centres by the forces of the axles."""
        at_rest = self.static_loads()
        shares = np.array([self.roll_share_front, 1.0 - self.roll_share_front])
        couples = self.load_transfer_scale * self.mass * lateral_acceleration * self.height * shares
        if self.roll_gradient:
            _, _, springs, dampers = self.body
            carried = np.array([self.to_rear, self.to_front]) / (self.to_front + self.to_rear)
            couples = (springs * roll + dampers * roll_rate) * shares
            couples = couples + self.mass * carried * lateral_acceleration * ROLL_CENTRE
        moved = np.repeat(couples / self.track, 2)
        moved = np.sign(moved) * np.minimum(np.abs(moved), at_rest)
        return at_rest - np.sign(self.wheels[:, 1]) * moved

    def tyre_force(self, wheel: int, slip: float, load: float, friction: float) -> float:
        """Return the signed side force of one tyre, N."""
        tyre = self.front if wheel < 2 else self.rear
        nominal = float(self.static_loads()[wheel])
        wetness = friction / self.dry_friction
        slope = tyre.slope * (wetness + self.kept_stiffness * (1.0 - wetness))
        stiffness_factor = slope / (tyre.shape * friction * tyre.peak * nominal)
        height = friction * max(tyre.peak + tyre.peak_with_load * (load - nominal) / nominal, 0.0) * load
        argument = stiffness_factor * (slip - tyre.shift_angle)
        bent = (1.0 - tyre.curvature) * argument + tyre.curvature * math.atan(argument)
        return height * math.sin(tyre.shape * math.atan(bent)) + tyre.shift_force

    def slip_angles(self, points: np.ndarray, speed: float, lateral: float, yaw_rate: float, steer: np.ndarray) -> np.ndarray:
        """Return slip angles at body points (n, 2) with wheels that point along `steer` (n,)."""
        along = speed - yaw_rate * points[:, 1]
        across = lateral + yaw_rate * points[:, 0]
        forwards = np.clip(along / ROLLING_SPEED_MIN, -1.0, 1.0)  # in reverse a turned wheel slips to the other side
        return np.arctan2(across, np.maximum(np.abs(along), ROLLING_SPEED_MIN)) - forwards * steer

    def body_rates(
        self,
        speed: float,
        yaw_rate: float,
        slip: np.ndarray,
        steer: np.ndarray,
        friction: float,
        outside: tuple[float, float],
        roll: tuple[float, float],
    ) -> tuple[float, float]:
        """Return lateral acceleration of the centre of gravity (m/s^2) and yaw acceleration (rad/s^2) from four slip angles.

        `outside` is a yaw moment (N m) and a lateral force (N).
        """
        places, loads = self.wheels, self.loads(speed * yaw_rate, *roll)
        pull = np.array([-self.tyre_force(k, slip[k], loads[k], friction) for k in range(4)])
        forces = pull[:, None] * np.column_stack([-np.sin(steer), np.cos(steer)])  # unit vectors across the wheels
        torque = places[:, 0] * forces[:, 1] - places[:, 1] * forces[:, 0]
        moment, force = outside
        return (float(forces[:, 1].sum()) + force) / self.mass, (float(torque.sum()) + moment) / self.inertia

    def derivative(self, state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Return the rates of [lateral speed, yaw rate, steering wheel, rear angle, x, y, heading, *further_states].

        Inputs are [speed, steering wheel command, rear command, friction, yaw moment, lateral force].
        """
        lateral, yaw_rate, wheel, rear, _, _, heading = state[:7]
        further = dict(zip(self.further_states, state[7:], strict=True))
        speed, wheel_command, rear_command, friction, moment, force = inputs
        steer = np.array([wheel / self.steering_ratio] * 2 + [rear] * 2)
        slip = self.slip_angles(self.wheels, speed, lateral, yaw_rate, steer)
        held, rates_of = slip, dict[str, float]()
        if self.relaxation_length:  # 63 % over one relaxation length rolled
            held = state[7:11]
            rolling = np.maximum(np.abs(speed - yaw_rate * self.wheels[:, 1]), ROLLING_SPEED_MIN)
            lengths = self.relaxation_length * np.array([1.0, 1.0, *[self.rear_relaxation_factor] * 2])
            rates_of = dict(zip(self.further_states, (slip - held) * rolling / lengths, strict=False))
        roll = further.get("roll", 0.0), further.get("roll_rate", 0.0)
        acceleration, yaw_acceleration = self.body_rates(speed, yaw_rate, held, steer, friction, (moment, force), roll)
        if self.roll_gradient:  # the centre of gravity swings about the roll axis, to the right of it
            lever, inertia, springs, dampers = self.body
            tilting = lever * self.gravity * math.sin(roll[0]) - springs * roll[0] - dampers * roll[1]
            balance = np.array([[self.mass, -lever], [-lever, inertia]])
            acceleration, rolled = np.linalg.solve(balance, [self.mass * acceleration, tilting])
            rates_of |= {"roll": roll[1], "roll_rate": rolled}
        drift = complex(speed, lateral) * complex(math.cos(heading), math.sin(heading))
        followed = min(max(rear_command, -self.rear_angle_max), self.rear_angle_max)
        motor = further.get("motor_angle", rear)
        turning = self.rear_actuator.rate(followed - motor)
        if self.motor_share:
            inert = self.motor_share * self.rear_actuator.time_constant
            rates_of["motor_rate"] = (turning - further["motor_rate"]) / inert
            turning = further["motor_rate"]
        rates_of["motor_angle"] = rear_rate = turning
        if self.play:
            beyond = max(abs(motor - rear) - 0.5 * self.play, 0.0)
            rear_rate = math.copysign(beyond, motor - rear) / PLAY_TIME
        actuators = self.steering.rate(wheel_command - wheel), rear_rate
        rates = [acceleration - speed * yaw_rate, yaw_acceleration, *actuators, drift.real, drift.imag, yaw_rate]
        return np.array([*rates, *(rates_of[name] for name in self.further_states)])

    def outputs(self, state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Return sideslip angle, lateral acceleration, front angle, slip angles at the middle of the front and rear axle, and
        rear angle and lateral acceleration as measured."""
        lateral, yaw_rate, wheel, rear = state[:4]
        further = dict(zip(self.further_states, state[7:], strict=True))
        speed, friction = inputs[0], inputs[3]
        front = wheel / self.steering_ratio
        middles = np.array([[0.0, 0.0], [self.to_front, 0.0], [-self.to_rear, 0.0]])
        sideslip, slip_front, slip_rear = self.slip_angles(middles, speed, lateral, yaw_rate, np.array([0.0, front, rear]))
        steer = np.array([front, front, rear, rear])
        held = state[7:11] if self.relaxation_length else self.slip_angles(self.wheels, speed, lateral, yaw_rate, steer)
        roll, outside = further.get("roll", 0.0), (0.0, inputs[5])
        rolling = (roll, further.get("roll_rate", 0.0))
        acceleration, _ = self.body_rates(speed, yaw_rate, held, steer, friction, outside, rolling)
        measured = further.get("motor_angle", rear), acceleration + self.gravity * math.sin(roll)
        return np.array([sideslip, acceleration, front, slip_front, slip_rear, *measured])


_VEHICLE = "mass_kg yaw_inertia_kg_m2 cg_height_m track_m cg_to_front_axle_m cg_to_rear_axle_m front_roll_share"
_TYRE = (
    "cornering_stiffness_n_per_rad shape_factor_c curvature_factor_e peak_factor_p1 peak_load_sensitivity_p2 "
    "horizontal_shift_deg vertical_shift_n"
)


def tables(car: Car) -> dict[str, Any]:
    """Return the car as the tables of a configuration."""
    vehicle = car.mass, car.inertia, car.height, car.track, car.to_front, car.to_rear, car.roll_share_front
    front, rear = (astuple(replace(tyre, shift_angle=math.degrees(tyre.shift_angle))) for tyre in (car.front, car.rear))
    wheel_rate, rear_rate = (math.degrees(lag.rate_limit) for lag in (car.steering, car.rear_actuator))
    rear_angle, rear_lag = math.degrees(car.rear_angle_max), car.rear_actuator.time_constant
    transfer = "paper" if car.load_transfer_scale == 0.5 else "moment-balance"
    steering = {"ratio": car.steering_ratio, "wheel_rate_max_deg_s": wheel_rate, "lag_s": car.steering.time_constant}
    return {
        "vehicle": dict(zip(_VEHICLE.split(), vehicle, strict=True)),
        "road": {"friction": car.dry_friction, "gravity_m_s2": car.gravity},
        "tyre": {"front": dict(zip(_TYRE.split(), front, strict=True)), "rear": dict(zip(_TYRE.split(), rear, strict=True))},
        "steering": {**steering, "front_angle_stop_deg": 35.0},
        "rear_actuator": {"angle_max_deg": rear_angle, "rate_max_deg_s": rear_rate, "lag_s": rear_lag},
        "plant": {"load_transfer": transfer, **parts(car)},
    }


def parts(car: Car) -> dict[str, float]:
    """Return the keys of [plant] with the optional parts of a car."""
    return {
        "relaxation_length_m": car.relaxation_length,
        "rear_relaxation_factor": car.rear_relaxation_factor,
        "slippery_stiffness_share": car.kept_stiffness,
        "roll_deg_per_g": math.degrees(car.roll_gradient) * car.gravity,
        "actuator_motor_share": car.motor_share,
        "backlash_deg": math.degrees(car.play),
    }


# From the mass to the friction of dry road, the tyres, the steering and the rear actuator, in the order of the fields.
OTHER = Car(
    *(1_480.0, 2_350.0, 0.61, 1.52, 1.08, 1.57, 0.55, 9.8, 1.0),
    TyreData(61_000.0, 1.45, -1.1, 1.05, -0.12, math.radians(0.15), 60.0),
    TyreData(58_000.0, 1.2, 0.3, 0.95, -0.2, math.radians(-0.1), -45.0),
    *(15.5, Lag(0.02, math.radians(450.0)), Lag(0.03, math.radians(60.0)), math.radians(5.0)),
    load_transfer_scale=0.5,  # as printed in the paper
)
"""A car in which every term of the model is active, except the optional parts."""
COMPLETE = replace(
    OTHER,
    load_transfer_scale=1.0,
    relaxation_length=0.4,
    rear_relaxation_factor=1.3,
    kept_stiffness=0.6,
    roll_gradient=math.radians(5.0) / OTHER.gravity,
    motor_share=0.5,
    play=math.radians(0.2),
)
"""A car with all optional parts."""
CARS: dict[str, tuple[dict[str, Any], Car]] = {
    "paper": (with_car({}), Car()),
    "other": (tables(OTHER), OTHER),
    "relaxed": (with_car({"plant": {"relaxation_length_m": 0.4}}), Car(relaxation_length=0.4)),
    "complete": (tables(COMPLETE), COMPLETE),
    "motor": (tables(replace(OTHER, motor_share=0.4)), replace(OTHER, motor_share=0.4)),
    "play": (tables(replace(OTHER, play=0.004)), replace(OTHER, play=0.004)),
}


def simulate(car: Car, holds: Sequence[tuple[float, np.ndarray]], period: float) -> np.ndarray:
    """Return states from rest at 0 and after each `period` s, over `holds`: (whole periods in s, constant inputs).

    Each period is integrated separately: the error control finds the kinks of the rate limits, and nothing is interpolated.
    """
    rows = [np.zeros(7 + len(car.further_states))]
    for duration, inputs in holds:
        for _ in range(round(duration / period)):
            how = {"rtol": 1e-11, "atol": 1e-13, "first_step": period}
            solution = solve_ivp(lambda _, x, u: car.derivative(x, u), (0.0, period), rows[-1], "DOP853", args=(inputs,), **how)
            assert solution.success, solution.message
            rows.append(solution.y[:, -1])
    return np.array(rows)
