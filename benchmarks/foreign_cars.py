"""Cars that the project's model does not describe, many at once: brush and TMeasy tyres, roll, load transfer, relaxation.

Nothing of `codegen.vehicle` is used. A car has four wheels on a body that rolls about an axis through the roll centres of both
axles. The load transfer follows from springs, dampers and roll centres, and the cornering stiffness of a tyre rises less than
its load. Each force follows the slip of its wheel after a relaxation length. Axes: ISO 8855; roll is positive where the body
leans out of a turn to the left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.units import DEGREE

GRAVITY = 9.81
WHEELS = 4
"""Front left, front right, rear left, rear right."""
LEFT = np.array([1.0, -1.0, 1.0, -1.0])
FRONT = np.array([True, True, False, False])

TyreForce = Callable[[FloatArray, FloatArray, FloatArray, "Cars"], FloatArray]
"""Tangent of the slip angle, stiffness (N/rad) and largest force (N) of tyres, each (n, 4), and the cars -> force (n, 4), N."""


def brush(slip: FloatArray, stiffness: FloatArray, peak: FloatArray, _cars: Cars) -> FloatArray:
    """Return the force of a brush with a parabolic pressure (H. B. Pacejka, Tire and Vehicle Dynamics, section 3.2.1)."""
    sliding = np.minimum(stiffness * np.abs(slip) / (3.0 * peak), 1.0)
    return np.sign(slip) * peak * (1.0 - (1.0 - sliding) ** 3)


def tmeasy(slip: FloatArray, stiffness: FloatArray, peak: FloatArray, cars: Cars) -> FloatArray:
    """Return the force of TMeasy (W. Hirschberg, G. Rill, H. Weinfurter, Vehicle System Dynamics 45 S1, 2007).

    A fraction up to the largest force, then parabolas to the sliding force, which begins at three times that slip.
    """
    ratio, slide = cars.peak_ratio[:, None], cars.sliding_share[:, None]
    at_peak = ratio * peak / stiffness
    s = np.abs(slip) / at_peak
    rising = ratio * s / (1.0 + s * (s + ratio - 2.0))
    beyond = np.clip((s - 1.0) / 2.0, 0.0, 1.0)
    falling = 1.0 - (1.0 - slide) * beyond**2 * (3.0 - 2.0 * beyond)
    return np.sign(slip) * peak * np.where(s < 1.0, rising, falling)


@dataclass(frozen=True, eq=False)
class Cars:
    """Cars, one for each element of the arrays (n,). SI units.

    Attributes:
        tyre: shape of all tyres.
        front_arm, rear_arm: from the centre of gravity to the axles. height: of it above the road.
        sprung_share: mass of the body over that of the car. roll_arm: height of the body's mass above the roll axis.
        roll_inertia: about the roll axis. roll_stiffness: N m/rad, without the weight of the body; roll_damping: N m s/rad.
        front_roll_share: part of both at the front. front_centre, rear_centre: heights of the roll centres.
        front_stiffness, rear_stiffness: of one tyre at its static load, N/rad. stiffness_gain: its relative rise for each
            relative rise of the load.
        front_friction, rear_friction: at the static load. friction_loss: its relative fall for each relative rise of the load.
        peak_ratio, sliding_share: of TMeasy: slope at zero times slip of the largest force, and sliding force, over that force.
        front_relaxation, rear_relaxation: lengths.
    """

    tyre: TyreForce
    mass: FloatArray
    yaw_inertia: FloatArray
    front_arm: FloatArray
    rear_arm: FloatArray
    height: FloatArray
    track: FloatArray
    sprung_share: FloatArray
    roll_arm: FloatArray
    roll_inertia: FloatArray
    roll_stiffness: FloatArray
    roll_damping: FloatArray
    front_roll_share: FloatArray
    front_centre: FloatArray
    rear_centre: FloatArray
    front_stiffness: FloatArray
    rear_stiffness: FloatArray
    stiffness_gain: FloatArray
    front_friction: FloatArray
    rear_friction: FloatArray
    friction_loss: FloatArray
    peak_ratio: FloatArray
    sliding_share: FloatArray
    front_relaxation: FloatArray
    rear_relaxation: FloatArray

    @property
    def wheelbase(self) -> FloatArray:
        """Wheelbase (n,) in m."""
        return self.front_arm + self.rear_arm

    @property
    def static_loads(self) -> FloatArray:
        """Loads (n, 4) of the wheels at rest, N."""
        half = 0.5 * self.mass * GRAVITY / self.wheelbase
        return np.where(FRONT, (half * self.rear_arm)[:, None], (half * self.front_arm)[:, None])

    def forces(self, slip: FloatArray, load: FloatArray) -> FloatArray:
        """Return the side forces (n, 4) in N, opposite to slips (n, 4), at loads (n, 4)."""
        static = self.static_loads
        more = load / static - 1.0
        stiffness, friction = (
            np.where(FRONT, front[:, None], rear[:, None])
            for front, rear in ((self.front_stiffness, self.rear_stiffness), (self.front_friction, self.rear_friction))
        )
        stiffness = stiffness * np.maximum(1.0 + self.stiffness_gain[:, None] * more, 0.05)
        peak = friction * np.maximum(1.0 - self.friction_loss[:, None] * more, 0.3) * np.maximum(load, 1.0)
        return -self.tyre(slip, stiffness, peak, self)


STATES = 9
"""Lateral speed, yaw rate, roll angle and rate, slips of four wheels, and the angle of the rear wheels."""
OUTPUTS = ("vx", "delta_f", "yaw_rate", "delta_r", "lateral_acceleration", "sideslip", "front_force", "rear_force")
"""Columns of `simulate`. The lateral acceleration is that of an accelerometer on the body. Forces are those of an axle."""


def simulate(cars: Cars, rows: FloatArray, step: float, actuator: Sequence[tuple[float, float, float]]) -> FloatArray:
    """Return the outputs (steps, n, number of OUTPUTS) of cars from straight running.

    Args:
        rows: (steps, n, 3) speed in m/s, front angle and rear command in rad.
        step: s. actuator: lag (s), rate (rad/s) and angle (rad) of the rear actuator of each car.
    """
    lag, rate, limit = np.array(actuator).T
    height = cars.roll_arm
    body = cars.sprung_share * cars.mass
    determinant = cars.mass * cars.roll_inertia - (body * height) ** 2
    static, arms = cars.static_loads, np.where(FRONT, cars.front_arm[:, None], -cars.rear_arm[:, None])
    roll_share = np.where(FRONT, cars.front_roll_share[:, None], 1.0 - cars.front_roll_share[:, None])
    other_arm = np.where(FRONT, cars.rear_arm[:, None], cars.front_arm[:, None]) / cars.wheelbase[:, None]
    centre = np.where(FRONT, cars.front_centre[:, None], cars.rear_centre[:, None])
    relaxation = np.where(FRONT, cars.front_relaxation[:, None], cars.rear_relaxation[:, None])
    side = -LEFT / cars.track[:, None]  # a turn to the left loads the right wheels

    def rates(
        x: FloatArray, row: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        lateral, yaw_rate, roll, roll_rate, rear = x[:, 0], x[:, 1], x[:, 2], x[:, 3], x[:, 8]
        speed, front = row[:, 0], row[:, 1]
        moment = cars.roll_stiffness * roll + cars.roll_damping * roll_rate
        transfer = roll_share * moment[:, None] + (cars.mass * acceleration)[:, None] * other_arm * centre
        load = np.maximum(static + side * transfer, 0.0)
        angle = np.where(FRONT, front[:, None], rear[:, None])
        wheel_speed = np.maximum(speed[:, None] - 0.5 * LEFT * cars.track[:, None] * yaw_rate[:, None], 1.0)
        slip = np.tan(np.arctan((lateral[:, None] + arms * yaw_rate[:, None]) / wheel_speed) - angle)
        force = cars.forces(x[:, 4:8], load) * np.cos(angle)
        pull = force.sum(axis=1)
        turn = body * GRAVITY * height * roll - moment
        side_acceleration = (pull * cars.roll_inertia + body * height * turn) / determinant
        roll_acceleration = (cars.mass * turn + body * height * pull) / determinant
        found = np.empty_like(x)
        found[:, 0] = side_acceleration - speed * yaw_rate
        found[:, 1] = (arms * force).sum(axis=1) / cars.yaw_inertia
        found[:, 2], found[:, 3] = roll_rate, roll_acceleration
        found[:, 4:8] = wheel_speed / relaxation * (slip - x[:, 4:8])
        found[:, 8] = np.clip((np.clip(row[:, 2], -limit, limit) - rear) / lag, -rate, rate)
        return found, force, side_acceleration, roll_acceleration

    count = len(cars.mass)
    x, acceleration = np.zeros((count, STATES)), np.zeros(count)
    result = np.empty((len(rows), count, len(OUTPUTS)))
    for index, row in enumerate(rows):
        first, force, acceleration, roll_acceleration = rates(x, row, acceleration)
        speed, front, lateral, yaw_rate = row[:, 0], row[:, 1], x[:, 0], x[:, 1]
        result[index] = np.stack(
            (
                speed,
                front,
                yaw_rate,
                x[:, 8],
                acceleration - height * roll_acceleration + GRAVITY * np.sin(x[:, 2]),
                np.arctan2(lateral, speed),
                force[:, :2].sum(axis=1),
                force[:, 2:].sum(axis=1),
            ),
            axis=1,
        )
        middle, *_ = rates(x + 0.5 * step * first, row, acceleration)
        x = x + step * middle
    return result


def random_cars(rng: np.random.Generator, tyre: TyreForce, count: int) -> Cars:
    """Draw cars from small ones to heavy SUVs; size goes with the mass."""

    def even(low: float, high: float) -> FloatArray:
        return rng.uniform(low, high, count)

    size = even(0.0, 1.0)
    mass = 1_300.0 + 1_500.0 * size
    wheelbase, share = 2.5 + 0.5 * size + even(-0.1, 0.1), even(0.46, 0.58)
    arms = wheelbase * (1.0 - share), wheelbase * share
    height, track = 0.5 + 0.2 * size + even(-0.03, 0.03), 1.5 + 0.15 * size
    sprung, centres = even(0.85, 0.92), (even(0.03, 0.1), even(0.08, 0.16))
    roll_arm = height - 0.5 * (centres[0] + centres[1])
    roll_per_g = even(3.0, 6.0) * DEGREE
    stiffness = mass * sprung * GRAVITY * roll_arm * (1.0 / roll_per_g + 1.0)
    inertia = mass * sprung * (0.35 * track) ** 2 + mass * sprung * roll_arm**2
    rear_slip = even(1.8, 3.5) * DEGREE
    front_slip = rear_slip + even(0.3, 2.5) * DEGREE
    return Cars(
        tyre=tyre,
        mass=mass,
        yaw_inertia=mass * arms[0] * arms[1] * even(0.9, 1.1),
        front_arm=arms[0],
        rear_arm=arms[1],
        height=height,
        track=track,
        sprung_share=sprung,
        roll_arm=roll_arm,
        roll_inertia=inertia,
        roll_stiffness=stiffness,
        roll_damping=2.0 * even(0.2, 0.4) * np.sqrt(stiffness * inertia),
        front_roll_share=even(0.5, 0.65),
        front_centre=centres[0],
        rear_centre=centres[1],
        front_stiffness=0.5 * mass * GRAVITY * share / front_slip,
        rear_stiffness=0.5 * mass * GRAVITY * (1.0 - share) / rear_slip,
        stiffness_gain=even(0.5, 0.9),
        front_friction=even(0.95, 1.1),
        rear_friction=even(0.98, 1.12),
        friction_loss=even(0.02, 0.15),
        peak_ratio=even(1.9, 2.6),
        sliding_share=even(0.85, 0.98),
        front_relaxation=even(0.25, 0.6),
        rear_relaxation=even(0.25, 0.6),
    )


def is_driven(outputs: FloatArray) -> bool:
    """Return whether a car (samples, outputs) stayed on its wheels and did not spin."""
    return bool(np.isfinite(outputs).all() and np.abs(outputs[:, OUTPUTS.index("sideslip")]).max() < math.radians(20.0))
