"""Steady turns of the two-track plant, many at once, and its linearisation there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, two_track_of_parameters
from codegen.vehicle.plant_car import PLANT_PARAMETERS

LATERAL, YAW, WHEEL = (PLANT_STATES.index(name) for name in ("lateral_speed", "yaw_rate", "steering_wheel_angle"))
COMMAND, WHEEL_COMMAND = PLANT_INPUTS.index("rear_angle_command"), PLANT_INPUTS.index("steering_wheel_command")

NEWTON_STEPS = 40
TURN_TOLERANCE = 1e-9
"""Largest residual derivative of a steady turn, m/s^2 and rad/s^2: rounding of forces of some 10 kN."""


@dataclass(frozen=True, eq=False)
class PlantPoints:
    """n cars, each at a state and with inputs; SI units.

    Attributes:
        linear: states, inputs and cars -> derivatives, Jacobian over the states, column of the rear angle's command.
        states: (s, n), in the order of the plant's states; `solve_turns` changes them.
        inputs: (u, n), in the order of PLANT_INPUTS. cars: (k, n), in the order of PLANT_PARAMETERS.
    """

    linear: Any
    states: FloatArray
    inputs: FloatArray
    cars: FloatArray

    @classmethod
    def of(cls, config: Config, states: FloatArray, inputs: FloatArray, cars: FloatArray) -> PlantPoints:
        """Return points of the plant with the tyre curves and the optional parts of a configuration."""
        model = two_track_of_parameters(config)
        x, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(PLANT_INPUTS))
        p = ca.SX.sym("p", len(PLANT_PARAMETERS))
        rate = model.derivative(x, u, p)
        outputs = [rate, ca.densify(ca.jacobian(rate, x)), ca.densify(ca.jacobian(rate, u[COMMAND]))]
        return cls(ca.Function("linear", [x, u, p], outputs).map(states.shape[1]), states, inputs, cars)

    def linearised(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return derivatives (s, n), their Jacobians (n, s, s) over the states, and columns (n, s) of the rear command."""
        rate, jacobian, column = (np.array(values) for values in self.linear(self.states, self.inputs, self.cars))
        count, size = self.states.shape
        return rate, jacobian.reshape(count, size, count).transpose(1, 0, 2), column.T

    def solve_turns(self) -> BoolArray:
        """Solve steady turns with the given yaw rates by Newton's method, and return (n,) which were found.

        The given states are the start. Lateral speed, steering wheel and the states of optional parts are solved.
        """
        further = range(len(PLANT_STATES), self.states.shape[0])
        places, unknowns = [LATERAL, YAW, *further], [LATERAL, WHEEL, *further]
        for _ in range(NEWTON_STEPS):
            self.inputs[WHEEL_COMMAND] = self.states[WHEEL]
            rate, jacobian, _ = self.linearised()
            residual = rate[places]
            if np.all(np.abs(residual) < TURN_TOLERANCE):
                break
            square = jacobian[:, places][:, :, unknowns]
            solvable = np.isfinite(square).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(square))) > 0.0)
            step = np.zeros((residual.shape[1], len(unknowns)))
            step[solvable] = np.linalg.solve(square[solvable], residual.T[solvable][..., np.newaxis])[..., 0]
            self.states[unknowns] -= step.T
        return np.asarray(np.all(np.abs(residual) < TURN_TOLERANCE, axis=0))
