"""A driver who follows a path by optimal preview.

C. C. MacAdam, Application of an Optimal Preview Control for Simulation of Closed-Loop Automobile Driving, IEEE Transactions on
Systems, Man, and Cybernetics 11(6), 1981, 393-399. At each instant he chooses the steering angle that, held, would bring the
car as he knows it closest to the path over the preview time, in the mean square. His hands follow after a delay.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.design.sampled import matrix_exponential
from codegen.vehicle.single_track import SingleTrack
from hil_sim.paths import RoadPath

FloatArray = npt.NDArray[np.float64]

PREVIEW_TIME_S, DELAY_S = 1.0, 0.2
"""The reaction time of a driver who knows what is coming, and the shortest preview, in steps of 0.2 s, with which he then keeps
the paper's passive car on the double lane change at 70 km/h."""

PREVIEW_POINTS = 20


class PreviewDriver:
    """Steers along a path at a constant speed.

    The car as he knows it is the linear single track without rear steering: states y (m), psi (rad), v_y (m/s) and r (rad/s).

    Args:
        config: of the car.
        path: to follow.
        speed: m/s.
        period: s between two decisions.
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
