"""Inputs of driver and road, as columns over time, and paths with a driver that follows them.

A manoeuvre is a function `(config, settings, time (n,) in s)` of the car, of the values that a user may change, and of time. It
returns columns by the names of `codegen.sil.closed_loop.INPUT_COLUMNS`, each a number or (n,), in SI. Omitted columns have
defaults: the road of the configuration, no friction estimate, no other input. Amplitudes are derived from the car. A path gives
the lateral position (m, to the left) for positions along the road (m).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.sampled import matrix_exponential
from codegen.errors import CodegenError
from codegen.metrics.sine import DWELL_FREQUENCY, DWELL_LENGTH, DWELL_PAUSE
from codegen.sil.closed_loop import PREVIEW_POINTS
from codegen.units import KM_H, STANDARD_GRAVITY
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import static_wheel_loads
from hil_sim.settings import Settings

Columns = Mapping[str, npt.ArrayLike]

DWELL_MULTIPLE = 5.0
"""FMVSS 126, S5.2.3: from five times the angle that gives 0.3 g on, the lateral displacement is judged."""
DWELL_ACCELERATION = 0.3 * STANDARD_GRAVITY

RAMP_RATE = 0.1
"""Rise of the lateral acceleration of a linear car, in m/s^2 per second; slow enough for every instant to be a steady turn."""

SWEEP_FROM, SWEEP_TO = 0.1, 4.0
"""Hz; figures are read between 0.2 and 3.5 Hz, away from both ends."""
SWEEP_ACCELERATION = 2.0
"""Steady lateral acceleration in m/s^2: the linear range, half of that in ISO 7401 for the step input."""

SPLIT_LOW_SHARE = 1.0 / 3.0
"""Friction of the slippery side over that of the other one: UN R13-H, annex 6, calls for half or less."""
SPLIT_BUILD_UP = 0.5
"""Time in s over which the brake system raises the force at the front wheel with grip."""


Manoeuvre = Callable[[Config, Settings, FloatArray], Columns]


def steering_wheel_angle(config: Config, speed: float, lateral_acceleration: float) -> float:
    """Return the steering wheel angle in rad at which the linear passive car holds a lateral acceleration (m/s^2) at a speed
    (m/s).

    delta_f = (L/vx^2 + K) ay, times the steering ratio (Rajamani, section 3.3).

    Raises:
        CodegenError: the car is unstable at that speed, or the wheels would be at their stop.
    """
    car = SingleTrack.from_config(config)
    front_angle = (car.wheelbase / speed**2 + car.understeer_coefficient) * lateral_acceleration
    wanted = f"{lateral_acceleration:.3g} m/s^2 at {speed / KM_H:.3g} km/h"
    if front_angle <= 0.0:
        raise CodegenError(
            f"this car oversteers and is unstable at {speed / KM_H:.3g} km/h",
            where="scenario",
            remedy=f"choose a speed below {car.critical_speed / KM_H:.0f} km/h, or give steering_wheel_angle_deg",
        )
    if front_angle > config.steering.front_angle_stop:
        raise CodegenError(
            f"{wanted} needs a front angle of {math.degrees(front_angle):.3g} deg, beyond steering.front_angle_stop_deg",
            where="scenario",
            remedy="choose a higher speed, or give steering_wheel_angle_deg",
        )
    return front_angle * config.steering.ratio


def _given_angle(settings: Settings, otherwise: Callable[[], float]) -> float:
    given = settings.steering_wheel_angle_deg
    return otherwise() if given is None else math.radians(given)


def step(start: float, front_angle_deg: float | None = None) -> Manoeuvre:
    """Return a step of the steering wheel at `start` (s). The plant limits its rate.

    Without an angle in the settings, the front wheels turn by `front_angle_deg`.
    """

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        angle = _given_angle(settings, lambda: math.radians(front_angle_deg or 0.0) * config.steering.ratio)
        return {"speed": settings.speed, "steering_wheel_command": np.where(time >= start - 1e-9, angle, 0.0)}

    return drive


def corner(start: float, length: float, front_angle_deg: float) -> Manoeuvre:
    """Turn the steering wheel evenly over `length` s from `start`, then hold it."""

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        angle = _given_angle(settings, lambda: math.radians(front_angle_deg) * config.steering.ratio)
        return {"speed": settings.speed, "steering_wheel_command": angle * np.clip((time - start) / length, 0.0, 1.0)}

    return drive


def ramp(start: float, end: float) -> Manoeuvre:
    """Return a slowly increasing steer from `start` to `end` (s) at constant speed, to RAMP_RATE * (end - start) in a
    linear car."""

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        last = _given_angle(settings, lambda: steering_wheel_angle(config, settings.speed, RAMP_RATE * (end - start)))
        return {"speed": settings.speed, "steering_wheel_command": last * np.clip((time - start) / (end - start), 0.0, 1.0)}

    return drive


def dwell_shape(time: FloatArray) -> FloatArray:
    """Return the sine with dwell of amplitude one from time zero: three quarters of a period, the dwell, the last quarter."""
    three_quarters = 0.75 / DWELL_FREQUENCY
    moving = np.where(time < three_quarters, time, np.maximum(time - DWELL_PAUSE, three_quarters))
    inside = (time >= 0.0) & (time < DWELL_LENGTH)
    result: FloatArray = np.where(inside, np.sin(2.0 * np.pi * DWELL_FREQUENCY * moving), 0.0)
    return result


def sine_with_dwell(start: float) -> Manoeuvre:
    """Return the steering input of FMVSS 126, S7.9, at constant speed; in the standard the car coasts."""

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        angle = _given_angle(
            settings, lambda: DWELL_MULTIPLE * steering_wheel_angle(config, settings.speed, DWELL_ACCELERATION)
        )
        return {"speed": settings.speed, "steering_wheel_command": angle * dwell_shape(time - start)}

    return drive


def sine_sweep(start: float, end: float) -> Manoeuvre:
    """Return a sine sweep from SWEEP_FROM to SWEEP_TO with equal time for each octave, faded in and out.

    It begins and ends at rest, so the transforms of response and input have no leakage.
    """
    fade_in, fade_out = 1.0 / SWEEP_FROM, 2.0 / SWEEP_TO

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        angle = _given_angle(settings, lambda: steering_wheel_angle(config, settings.speed, SWEEP_ACCELERATION))
        length, octaves = end - start, math.log(SWEEP_TO / SWEEP_FROM)
        inside = np.clip(time - start, 0.0, length)
        phase = 2.0 * np.pi * SWEEP_FROM * length / octaves * np.expm1(octaves * inside / length)
        fade = np.clip(np.minimum(inside / fade_in, (length - inside) / fade_out), 0.0, 1.0)
        smooth = 0.5 - 0.5 * np.cos(np.pi * fade)
        return {"speed": settings.speed, "steering_wheel_command": angle * smooth * np.sin(phase)}

    return drive


def speed_ramp(times: tuple[float, float, float, float]) -> Manoeuvre:
    """Return a speed ramp from half the speed at which feedback ends to twice that from which it is whole and back, with the
    steering wheel held.

    Args:
        times: s at which the speed begins to rise, stays, begins to fall, stays.
    """

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        ends, whole = config.controller.feedback_speeds_km_h
        low = 0.5 * ends * KM_H
        high = 2.0 * whole * KM_H if settings.speed_km_h is None else settings.speed
        # Turned in within the first half second; the plant limits the rate.
        angle = _given_angle(settings, lambda: 0.0)
        return {
            "speed": np.interp(time, times, (low, high, high, low)),
            "steering_wheel_command": np.where(time >= 0.5 - 1e-9, angle, 0.0),
        }

    return drive


def straight(config: Config, settings: Settings, time: FloatArray) -> Columns:
    """Drive straight at constant speed; a driver steers if there is one (`Scenario.path`)."""
    del config, time
    return {"speed": settings.speed}


def yaw_moment(start: float, moment: float) -> Manoeuvre:
    """Drive straight at constant speed, with a yaw moment (N m) from `start` (s) and the steering wheel held."""

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        del config
        return {"speed": settings.speed, "yaw_moment": np.where(time >= start - 1e-9, moment, 0.0)}

    return drive


@dataclass(frozen=True)
class SplitBraking:
    """Braking with one side of the car on a slippery surface, as the plant sees it.

    Attributes:
        yaw_moment: N m, towards the side with grip, at the full brake forces.
        deceleration: m/s^2.
        friction: friction left for lateral forces: the mean of both sides.
    """

    yaw_moment: float
    deceleration: float
    friction: float


def split_braking(config: Config) -> SplitBraking:
    """Return the forces of an anti-lock brake system on split friction, from the static loads.

    Each front wheel brakes with what its own side gives, mu F_z; both rear wheels with what the slippery side gives
    ("select low"), so that only the front axle turns the car: M = (w/2) (mu_high - mu_low) F_zf, with F_zf of one wheel.
    Braking shifts load forward and combined slip takes lateral force from the tyres: both are left out, as the plant has
    neither. (Robert Bosch GmbH, Automotive Handbook, antilock braking systems.)
    """
    high = config.road.friction
    low = SPLIT_LOW_SHARE * high
    front, rear = static_wheel_loads(config)
    return SplitBraking(
        yaw_moment=0.5 * config.vehicle.track_m * (high - low) * front,
        deceleration=((high + low) * front + 2.0 * low * rear) / config.vehicle.mass_kg,
        friction=0.5 * (high + low),
    )


def split_friction(start: float, end: float) -> Manoeuvre:
    """Drive straight and brake between `start` and `end` (s) with grip on the left side; the steering wheel is held.

    The brake system's yaw-moment build-up delay lets the force at the gripping wheel rise over SPLIT_BUILD_UP. `inhibit` stays
    off, to show what the rear wheels can do; with it the controller would not act.
    """

    def drive(config: Config, settings: Settings, time: FloatArray) -> Columns:
        braking = split_braking(config)
        acting = (time >= start - 1e-9) & (time < end - 1e-9)
        slowest = 5.0 * KM_H
        speed = settings.speed - braking.deceleration * np.clip(time - start, 0.0, end - start)
        return {
            "speed": np.maximum(speed, min(slowest, settings.speed)),
            "friction": braking.friction,
            "yaw_moment": braking.yaw_moment * np.where(acting, np.clip((time - start) / SPLIT_BUILD_UP, 0.0, 1.0), 0.0),
        }

    return drive


BODY_BEYOND_TRACK_M = 0.25
"""Width of the body beyond the track, in m: one tyre's width. The configuration does not contain the body's width."""

CONES_PER_LANE = 5
CONES, CONE_SPACING_M, CONE_CLEARANCE_M = 6, 36.0, 0.3
"""Slalom: number of cones, distance between cones in m, and clearance from a cone to the car's side in m. No standard
defines them."""


@dataclass(frozen=True)
class RoadPath:
    """Path of a driver.

    Attributes:
        lateral: function from positions along the road (m, any shape) to lateral positions (m).
        start, length: in m; the path is straight before and after.
        cones: (k, 3) m: position along the road, and the smallest and the largest lateral position of the centre of gravity at
            which the sides of the car clear the cones there; infinite where there is no cone on that side.
    """

    lateral: Callable[[FloatArray], FloatArray]
    start: float
    length: float
    cones: FloatArray


PathOf = Callable[[Config, float], RoadPath]
"""Function from a configuration and the start position (m) to a path."""


def _rise(x: FloatArray, start: float, length: float) -> FloatArray:
    """Return half a cosine from 0 to 1."""
    result: FloatArray = 0.5 - 0.5 * np.cos(np.pi * np.clip((x - start) / length, 0.0, 1.0))
    return result


def body_width(config: Config) -> float:
    """Return the width of the body in m."""
    return config.vehicle.track_m + BODY_BEYOND_TRACK_M


def double_lane_change(config: Config, start: float) -> RoadPath:
    """Return the obstacle avoidance track of ISO 3888-2:2011, table 1, beginning at `start` (m).

    Lanes of 12 m, 11 m and 12 m, of width 1.1 b + 0.25 m, b + 1 m, and 1.3 b + 0.25 m or 3 m where that is more, with b the
    width of the car. Gaps of 13.5 m and 12.5 m. The second lane is 1 m to the left of the others, whose left edges are in line.
    The path runs along the middle of the lanes. It changes between them by half a cosine, the longest on which the car just
    clears the cones at the ends of both lanes.
    """
    width = body_width(config)
    widths = (1.1 * width + 0.25, width + 1.0, max(1.3 * width + 0.25, 3.0))
    middles = (0.0, 0.5 * widths[0] + 1.0 + 0.5 * widths[1], 0.5 * (widths[0] - widths[2]))
    ends, begins = (start + 12.0, start + 36.5, start + 61.0), (start + 25.5, start + 49.0)
    changes = []
    for lane in range(2):
        size = middles[lane + 1] - middles[lane]
        # Shares of the half cosine at which the sides of the car are in line with the cones.
        leaves, enters = (math.acos(1.0 - (widths[place] - width) / abs(size)) / math.pi for place in (lane, lane + 1))
        length = (begins[lane] - ends[lane]) / (1.0 - enters - leaves)
        changes.append((size, ends[lane] - leaves * length, length))

    def lateral(x: FloatArray) -> FloatArray:
        result: FloatArray = np.sum([size * _rise(x, begin, length) for size, begin, length in changes], axis=0)
        return result

    cones = [
        (x, middle - 0.5 * (lane_width - width), middle + 0.5 * (lane_width - width))
        for begin, end, middle, lane_width in zip((start, *begins), ends, middles, widths, strict=True)
        for x in np.linspace(begin, end, CONES_PER_LANE)
    ]
    return RoadPath(lateral, start, 61.0, np.array(cones))


def slalom(config: Config, start: float) -> RoadPath:
    """Return a sine around cones in line. From `start` (m) it grows to its amplitude within one cone spacing; it fades
    likewise."""
    side = 0.5 * body_width(config)
    amplitude = side + CONE_CLEARANCE_M
    length = (CONES + 1) * CONE_SPACING_M

    def lateral(x: FloatArray) -> FloatArray:
        envelope = _rise(x, start, CONE_SPACING_M) - _rise(x, start + length - CONE_SPACING_M, CONE_SPACING_M)
        result: FloatArray = amplitude * envelope * np.cos(np.pi * (x - start) / CONE_SPACING_M)
        return result

    passed_on_the_right = ((-math.inf, -side), (side, math.inf))
    cones = [(start + number * CONE_SPACING_M, *passed_on_the_right[(number + 1) % 2]) for number in range(1, CONES + 1)]
    return RoadPath(lateral, start, length, np.array(cones))


PREVIEW_TIME_S, DELAY_S = 1.0, 0.2
"""Preview time and reaction time of an expecting driver. The preview is the shortest, in steps of 0.2 s, that keeps the paper's
passive car on the double lane change at 70 km/h."""


@dataclass(frozen=True)
class Hands:
    """Habits of a driver.

    Attributes:
        preview_time_s: time over which the driver looks ahead.
        delay_s: reaction time.
        gain: factor on the angle of the steering wheel.
    """

    preview_time_s: float = PREVIEW_TIME_S
    delay_s: float = DELAY_S
    gain: float = 1.0


EXPECTING = Hands()
"""The driver of all scenarios with a path."""


@dataclass(frozen=True)
class Preview:
    """A driver's law at one speed: the angle of the steering wheel as a weighted sum, in rad.

    Attributes:
        ahead: m between two of the PREVIEW_POINTS.
        path_weight: (PREVIEW_POINTS,) rad for each m of the path's lateral position.
        motion_weight: (4,) weights of lateral position (m), heading (rad), lateral speed (m/s) and yaw rate (rad/s), which are
            subtracted.
    """

    ahead: float
    path_weight: FloatArray
    motion_weight: FloatArray

    @classmethod
    def of(cls, config: Config, speed: float, hands: Hands) -> Preview:
        """Return the law of a driver in a car at a speed in m/s."""
        step = hands.preview_time_s / PREVIEW_POINTS
        transition = matrix_exponential(step * _model(config, speed))
        power: FloatArray = np.eye(len(transition))
        rows = []
        for _ in range(PREVIEW_POINTS):
            power = transition @ power
            rows.append(power[0])
        predicted = np.array(rows)  # (points, 5): y ahead for a unit of each state, and of the front angle
        by_angle = predicted[:, 4]
        weight = hands.gain * config.steering.ratio / (by_angle @ by_angle) * by_angle
        return cls(speed * step, weight, weight @ predicted[:, :4])


class PreviewDriver:
    """Driver that follows a path at a constant speed by optimal preview.

    C. C. MacAdam, Application of an Optimal Preview Control for Simulation of Closed-Loop Automobile Driving, IEEE Transactions
    on Systems, Man, and Cybernetics 11(6), 1981, 393-399. At each instant the driver chooses the steering angle that, if held,
    minimises the mean square distance to the path over the preview time. The steering wheel follows after a delay. The driver's
    model is the linear single track without rear steering: states y (m), psi (rad), v_y (m/s) and r (rad/s).

    Args:
        config: configuration of the car.
        path: path to follow.
        speed: speed in m/s.
        period: time between two decisions in s.
        hands: habits of the driver.
    """

    def __init__(self, config: Config, path: RoadPath, speed: float, period: float, hands: Hands = EXPECTING) -> None:
        self._path, self._speed, self._preview = path, speed, Preview.of(config, speed, hands)
        self._largest = config.steering.ratio * config.steering.front_angle_stop
        self._hands: deque[float] = deque([0.0] * round(hands.delay_s / period))

    def steer(self, position: tuple[float, float, float], sideslip_angle: float, yaw_rate: float) -> float:
        """Return the current angle of the steering wheel in rad.

        Args:
            position: m along the road, m to the left, heading in rad.
            sideslip_angle: rad.
            yaw_rate: rad/s.
        """
        x, y, heading = position
        state = np.array([y, heading, self._speed * np.tan(sideslip_angle), yaw_rate])
        ahead = x + self._preview.ahead * np.arange(1, PREVIEW_POINTS + 1, dtype=np.float64)
        angle = float(self._preview.path_weight @ self._path.lateral(ahead) - self._preview.motion_weight @ state)
        self._hands.append(min(max(angle, -self._largest), self._largest))
        return self._hands.popleft()


def _model(config: Config, speed: float) -> FloatArray:
    """Return the rates of (y, psi, v_y, r, front angle); the front angle is held (Rajamani, section 2.3)."""
    car = SingleTrack.from_config(config)
    axles = ((car.front_arm, car.front_stiffness), (-car.rear_arm, car.rear_stiffness))
    rates = np.zeros((5, 5))
    rates[0, 1:3] = speed, 1.0
    rates[1, 3] = 1.0
    for arm, stiffness in axles:
        effects = np.array([1.0 / car.mass, arm / car.yaw_inertia]) * stiffness
        rates[2:4, 2] -= effects / speed
        rates[2:4, 3] -= effects * arm / speed
        if arm > 0.0:
            rates[2:4, 4] = effects
    rates[2, 3] -= speed
    return rates
