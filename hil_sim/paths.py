"""Paths and a driver that follows them. A path gives the lateral position (m, to the left) for positions along the road (m)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.sampled import matrix_exponential
from codegen.vehicle.single_track import SingleTrack

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

PREVIEW_POINTS = 20


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
    """

    def __init__(self, config: Config, path: RoadPath, speed: float, period: float) -> None:
        self._path, self._speed = path, speed
        self._ratio, self._stop = config.steering.ratio, config.steering.front_angle_stop
        step = PREVIEW_TIME_S / PREVIEW_POINTS
        transition = matrix_exponential(step * _model(config, speed))
        power: FloatArray = np.eye(len(transition))
        rows = []
        for _ in range(PREVIEW_POINTS):
            power = transition @ power
            rows.append(power[0])
        predicted = np.array(rows)  # (points, 5): y ahead for a unit of each state, and of the front angle
        self._by_state, self._by_angle = predicted[:, :4], predicted[:, 4]
        self._ahead = speed * step * np.arange(1, PREVIEW_POINTS + 1, dtype=np.float64)
        self._hands: deque[float] = deque([0.0] * round(DELAY_S / period))

    def steer(self, position: tuple[float, float, float], sideslip_angle: float, yaw_rate: float) -> float:
        """Return the current angle of the steering wheel in rad.

        Args:
            position: m along the road, m to the left, heading in rad.
            sideslip_angle: rad.
            yaw_rate: rad/s.
        """
        x, y, heading = position
        state = np.array([y, heading, self._speed * np.tan(sideslip_angle), yaw_rate])
        missed = self._path.lateral(x + self._ahead) - self._by_state @ state
        angle = float(self._by_angle @ missed / (self._by_angle @ self._by_angle))
        self._hands.append(self._ratio * min(max(angle, -self._stop), self._stop))
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
