"""Sampled linear model of the rear-steered car, from the commanded rear angle to the measured yaw rate.

Single-track car with linear tyres in continuous time, angles small, front wheels straight ahead:

    beta'    = (F_f + F_r)/(m vx) - r                F_i = -C_i alpha_i
    r'       = (lf F_f - lr F_r)/Iz
    alpha_i  = alpha_i,ss, or with a relaxation length sigma: alpha_i' = vx/sigma (alpha_i,ss - alpha_i)
    alpha_f,ss = beta + lf r/vx,   alpha_r,ss = beta - lr r/vx - delta_r
    delta_m' = (command - delta_m)/lag, or with a motor share q: delta_m' = w/lag, w' = (command - delta_m - w)/(q lag)
    delta_r  = delta_m, or with backlash delta_r' = (delta_m - delta_r)/PLAY_TIME_CONSTANT

(R. Rajamani, Vehicle Dynamics and Control, section 2.3; H. B. Pacejka, Tire and Vehicle Dynamics, section 1.3.3, for the
relaxation length; `vehicle.dynamics.two_track` for the motor and the backlash.) The play itself is nonlinear and left out:
outside of it, the rear wheels follow the motor. A zero-order hold keeps the command over each sample, so the step from sample
to sample is an exact matrix exponential. The command acts a whole number of samples after the measurement from which it was
computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, ComplexArray, FloatArray
from codegen.configuration import Config
from codegen.design.family import Member
from codegen.vehicle.dynamics import (
    MOTOR_RATE,
    PLANT_INPUTS,
    PLANT_STATES,
    PLAY_TIME_CONSTANT,
    plant_states,
    two_track_of_parameters,
)
from codegen.vehicle.plant_car import PLANT_PARAMETERS, varied_cars
from codegen.vehicle.single_track import SingleTrack

STATES = ("sideslip_angle", "yaw_rate", "slip_front", "slip_rear", "rear_angle", "motor_rate", "wheel_angle")
"""States of a car. `plant.actuator_motor_share` and `plant.backlash_deg` each add one of the last two: the rate of the motor
times the lag, and the angle of the rear wheels, if that is not the one of the actuator."""
BETA, YAW_RATE, SLIP_FRONT, SLIP_REAR, REAR, MOTOR = range(len(STATES) - 1)

FREQUENCY_MIN = 0.02
"""Lowest frequency in rad/s, far below every crossing of a loop that responds within minutes."""

POINTS_PER_DECADE = 100
"""Density of the frequency grid. With interpolated crossings, margins of a well-damped loop (sensitivity up to 3) agree with
those of a ten times finer grid within 0.02 dB, 0.01 deg and 0.006."""

DELAY_OF_POLYNOMIALS_MAX = 20
"""Largest delay in samples for which Routh's criterion agrees with the eigenvalues; at 40 samples it does not."""

STABLE_MODULUS = 1.0 - 1e-12
"""Largest modulus of a stable pole: poles on the unit circle, to rounding, are not stable."""


@dataclass(frozen=True, eq=False)
class SampledCar:
    """Cars at speeds, in arrays of any shape (...): x[k+1] = transition x[k] + input u[k-delay], r = x[1].

    Attributes:
        transition: (..., n, n), over STATES, or over other states of which the second is the yaw rate.
        input: (..., n), per rad of command.
        sampling_time: s.
        delay: whole samples between computing a command and its acting.
        numerator, denominator: (n, ...) and (n + 1, ...), coefficients of the transfer function without the delay in powers of
            z - 1, highest first. Powers of z would cancel near z = 1, where the slow poles lie.
    """

    transition: FloatArray
    input: FloatArray
    sampling_time: float
    delay: int
    numerator: FloatArray
    denominator: FloatArray

    def response(self, frequency: FloatArray) -> ComplexArray:
        """Return P(e^(j w T)) at frequencies (f,) in rad/s: (..., f), in rad/s of yaw rate per rad of command, with delay."""
        step = np.expm1(1j * frequency * self.sampling_time)
        above, below = (_horner(coefficients, step) for coefficients in (self.numerator, self.denominator))
        result: ComplexArray = above / below * np.exp(-1j * self.delay * self.sampling_time * frequency)
        return result

    def pick(self, places: Sequence[int]) -> SampledCar:
        """Return the cars at the flat indices `places` (k): a SampledCar of shape (k,)."""
        chosen = list(places)
        size = self.input.shape[-1]
        return SampledCar(
            self.transition.reshape(-1, size, size)[chosen],
            self.input.reshape(-1, size)[chosen],
            self.sampling_time,
            self.delay,
            self.numerator.reshape(size, -1)[:, chosen],
            self.denominator.reshape(size + 1, -1)[:, chosen],
        )

    def steady_gain(self) -> FloatArray:
        """Return P at zero frequency: (...), below zero for a car that is stable on its own."""
        result: FloatArray = self.numerator[-1] / self.denominator[-1]
        return result

    def open_loop_stable(self) -> BoolArray:
        """Return whether each car (...) with its rear wheels held is stable."""
        return _stable(self.transition)

    def closed_loop_stable(self, kp: npt.ArrayLike, ki: npt.ArrayLike) -> BoolArray:
        """Return whether all poles of each closed loop (...) lie inside the unit circle.

        The characteristic polynomial is w z^d D - (kp w + ki T z) N with w = z - 1, and N/D the car without its delay d. Its
        coefficients resolve the poles up to a delay of DELAY_OF_POLYNOMIALS_MAX; beyond, the poles are eigenvalues.
        """
        if self.delay > DELAY_OF_POLYNOMIALS_MAX:
            return _stable(self.closed_loop(kp, ki))
        kp, ki, one = np.asarray(kp, dtype=np.float64), np.asarray(ki, dtype=np.float64), np.ones(())
        held = np.where(ki == 0.0, 1.0, 0.0)  # without integral part its pole is at z = 0 instead of z = 1
        feedback = _times_line(list(self.numerator), kp + ki * self.sampling_time, held * kp + ki * self.sampling_time)
        loop = _times_line(list(self.denominator), one, held)
        for _ in range(self.delay):
            loop = _times_line(loop, one, one)
        unmatched = len(loop) - len(feedback)
        return _is_inside_unit_circle([*loop[:unmatched], *map(np.subtract, loop[unmatched:], feedback)])

    def growth(self, kp: npt.ArrayLike, ki: npt.ArrayLike) -> FloatArray:
        """Return the growth rate (...) in 1/s of the slowest motion of the closed loop; below zero where it decays."""
        result: FloatArray = np.log(np.abs(np.linalg.eigvals(self.closed_loop(kp, ki))).max(axis=-1)) / self.sampling_time
        return result

    def closed_loop(self, kp: npt.ArrayLike, ki: npt.ArrayLike) -> FloatArray:
        """Return the closed loop (..., k, k) from sample to sample: states, delayed commands and integral.

        The loop is u = -(kp e + ki q), q[k] = q[k-1] + T e[k], e = -r. Gains broadcast against (...). With ki = 0 the
        loop has no integrator.
        """
        shape = np.broadcast_shapes(self.input.shape[:-1], np.shape(kp), np.shape(ki))
        kp, ki = np.broadcast_to(kp, shape), np.broadcast_to(ki, shape)
        cars, time = self.input.shape[-1], self.sampling_time
        integrator = cars + self.delay
        loop = np.zeros((*shape, integrator + 1, integrator + 1))
        loop[..., :cars, :cars] = self.transition
        loop[..., integrator, integrator] = ki != 0.0
        loop[..., integrator, YAW_RATE] = -time
        # Delayed commands, the newest first; without delay the command acts on the car at once.
        for age in range(1, self.delay):
            loop[..., cars + age, cars + age - 1] = 1.0
        command = np.zeros((*shape, integrator + 1))
        command[..., YAW_RATE], command[..., integrator] = kp + ki * time, -ki
        if self.delay:
            loop[..., :cars, integrator - 1] = self.input
            loop[..., cars, :] = command
        else:
            loop[..., :cars, :] += self.input[..., np.newaxis] * command[..., np.newaxis, :]
        return loop


def _stable(matrices: FloatArray) -> BoolArray:
    result: BoolArray = np.abs(np.linalg.eigvals(matrices)).max(axis=-1) < STABLE_MODULUS
    return result


Coefficients = Sequence[FloatArray]
"""Coefficients (...) of polynomials in w = z - 1, highest power first; they broadcast together."""


def _times_line(polynomial: Coefficients, slope: FloatArray, constant: FloatArray) -> list[FloatArray]:
    """Return polynomial times (slope w + constant)."""
    raised, same = [each * slope for each in polynomial], [each * constant for each in polynomial]
    return [raised[0], *(one + other for one, other in zip(raised[1:], same[:-1], strict=True)), same[-1]]


def _is_inside_unit_circle(polynomial: Coefficients) -> BoolArray:
    """Return whether all roots of polynomials have |z| < 1, elementwise and so much faster than the eigenvalues of many loops.

    The bilinear transformation z = (1 + s)/(1 - s) maps the unit circle to the imaginary axis, where Routh's criterion applies.
    It is w = 2 s/(1 - s), so roots near z = 1 keep their accuracy.
    """
    degree = len(polynomial) - 1
    in_s: list[Any] = [0.0] * (degree + 1)
    for power, coefficient in zip(range(degree, -1, -1), polynomial, strict=True):
        # (2 s)^power (1 - s)^(degree - power): its coefficients, highest power first, end with s^power.
        binomial = [math.comb(degree - power, k) * (-1.0) ** k for k in range(degree - power, -1, -1)]
        for place, factor in enumerate(binomial):
            in_s[place] = in_s[place] + 2.0**power * factor * coefficient
    sign = np.where(in_s[0] < 0.0, -1.0, 1.0)
    row, below = in_s[0::2], in_s[1::2]
    stable: BoolArray = np.asarray(sign * row[0] > 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # only where a loop is unstable already
        while below:
            stable = stable & (sign * below[0] > 0.0)
            ratio = row[0] / below[0]
            reduced = [one - ratio * other for one, other in zip_longest(row[1:], below[1:], fillvalue=0.0)]
            row, below = below, reduced
    return stable


def _horner(coefficients: FloatArray, at: ComplexArray) -> ComplexArray:
    value: ComplexArray = coefficients[0][..., np.newaxis] + np.zeros_like(at)
    for coefficient in coefficients[1:]:
        value *= at
        value += coefficient[..., np.newaxis]
    return value


def frequency_grid(sampling_time: float, points_per_decade: int = POINTS_PER_DECADE) -> FloatArray:
    """Return frequencies in rad/s, evenly spaced in their logarithm, from FREQUENCY_MIN to pi/T itself."""
    last = np.pi / sampling_time
    grid: FloatArray = np.geomspace(FREQUENCY_MIN, last, 1 + round(points_per_decade * np.log10(last / FREQUENCY_MIN)))
    grid[-1] = last
    return grid


def sample(config: Config, family: Sequence[Member], speed: npt.ArrayLike) -> SampledCar:
    """Return the cars of a family (m) at speeds (n,) in m/s, above zero: a SampledCar of shape (m, n).

    The sampling time is the controller's, the delay `config.designed_delay_samples`.
    """
    a, b = continuous(config, family, np.atleast_1d(np.asarray(speed, dtype=np.float64)))
    return sample_of(a, b, config.controller.sampling_time_s, config.designed_delay_samples)


def sample_of(a: FloatArray, b: FloatArray, time: float, delay: int) -> SampledCar:
    """Sample cars x' = a x + b u, (..., n, n) and (..., n), every `time` s; the yaw rate is the second state."""
    states = b.shape[-1]
    augmented = np.zeros((*b.shape[:-1], states + 1, states + 1))
    augmented[..., :states, :states] = a
    augmented[..., :states, states] = b
    exponential = matrix_exponential(time * augmented)
    transition, inputs = exponential[..., :states, :states].copy(), exponential[..., :states, states].copy()
    return SampledCar(transition, inputs, time, delay, *_transfer_function(transition, inputs))


def continuous(config: Config, family: Sequence[Member], speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return A (m, n, k, k) and B (m, n, k) for the k STATES of the configuration and the commanded rear angle.

    The time constant of the motor is in proportion to the lag of each member, and the relaxation length of the rear tyres to
    that of the front tyres.
    """
    car, plant = SingleTrack.from_config(config), config.plant
    motor_share = plant.actuator_motor_share
    states = MOTOR + bool(motor_share)
    columns = np.array(
        [
            (
                m.actuator_lag,
                m.mass_factor,
                m.front_stiffness_factor,
                m.rear_stiffness_factor,
                m.relaxation_length,
                m.yaw_inertia_factor,
            )
            for m in family
        ]
    ).T[..., np.newaxis]
    lag, mass_factor, front_factor, rear_factor, sigma, inertia_factor = columns
    mass, inertia = car.mass * mass_factor, car.yaw_inertia * mass_factor * inertia_factor
    lf, lr = car.front_arm, car.rear_arm
    relaxed = sigma > 0.0

    a = np.zeros((len(family), speed.size, states, states))
    a[..., BETA, YAW_RATE] = -1.0
    for slip, stiffness, arm, angle, length in (
        (SLIP_FRONT, car.front_stiffness * front_factor, lf, 0.0, sigma),
        (SLIP_REAR, car.rear_stiffness * rear_factor, -lr, -1.0, sigma * plant.rear_relaxation_factor),
    ):
        steady = ((BETA, 1.0), (YAW_RATE, arm / speed), (REAR, angle))
        per_slip = ((BETA, -stiffness / (mass * speed)), (YAW_RATE, -arm * stiffness / inertia))
        # Without relaxation the slip states have no effect, but every car has the same states.
        rate = speed / np.where(relaxed, length, 1.0)
        a[..., slip, slip] = -rate
        for state, share in steady:
            a[..., slip, state] = rate * share
            for motion, effect in per_slip:
                a[..., motion, state] += np.where(relaxed, 0.0, effect * share)
        for motion, effect in per_slip:
            a[..., motion, slip] = np.where(relaxed, effect, 0.0)
    b = np.zeros(a.shape[:-1])
    if motor_share:
        a[..., REAR, MOTOR], b[..., MOTOR] = 1.0 / lag, 1.0 / (motor_share * lag)
        a[..., MOTOR, REAR] = a[..., MOTOR, MOTOR] = -b[..., MOTOR]
    else:
        a[..., REAR, REAR], b[..., REAR] = -1.0 / lag, 1.0 / lag
    return _behind_play(a, b, list(range(REAR, states))) if plant.backlash_deg else (a, b)


def _behind_play(a: FloatArray, b: FloatArray, actuator: list[int]) -> tuple[FloatArray, FloatArray]:
    """Append the angle of rear wheels that follow the motor as they do outside of their play.

    Args:
        a, b: (..., k, k) and (..., k), of rear wheels without play.
        actuator: indices of the actuator's states, first its angle.
    """
    size, angle = b.shape[-1], actuator[0]
    body = [state for state in range(size) if state not in actuator]
    whole = np.zeros((*a.shape[:-2], size + 1, size + 1))
    whole[..., :size, :size] = a
    whole[..., body, size], whole[..., body, angle] = a[..., body, angle], 0.0
    whole[..., size, angle], whole[..., size, size] = 1.0 / PLAY_TIME_CONSTANT, -1.0 / PLAY_TIME_CONSTANT
    return whole, np.concatenate([b, np.zeros((*b.shape[:-1], 1))], axis=-1)


def matrix_exponential(matrices: FloatArray) -> FloatArray:
    """Return exp of matrices (..., k, k) by scaling, Taylor polynomial and squaring, vectorised unlike scipy's.

    Scaled to a norm of 1/2, the polynomial of order 14 is exact to rounding: 0.5**15/15! = 2e-17.
    """
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(max(2.0 * norm, 1.0)))))
    scaled = matrices / 2.0**squarings
    identity = np.eye(matrices.shape[-1])
    result: FloatArray = identity + scaled / 14.0
    for order in range(13, 0, -1):
        result = identity + scaled @ result / order
    for _ in range(squarings):
        result = result @ result
    return result


def _transfer_function(transition: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator in powers of z - 1 by the recursion of Faddeev and LeVerrier on (transition - 1)."""
    size = transition.shape[-1]
    identity = np.eye(size)
    step = transition - identity
    adjugate = np.broadcast_to(identity, step.shape)
    numerator, denominator = [], [np.ones(step.shape[:-2])]
    for order in range(1, size + 1):
        numerator.append(np.einsum("...i,...i->...", adjugate[..., YAW_RATE, :], inputs))
        product = step @ adjugate
        denominator.append(-np.trace(product, axis1=-2, axis2=-1) / order)
        adjugate = product + denominator[-1][..., np.newaxis, np.newaxis] * identity
    return np.array(numerator), np.array(denominator)


ACTUATOR = ("rear_angle", MOTOR_RATE)
"""States of the rear actuator without play, its angle first."""
LEFT_OUT = ("steering_wheel_angle", "position_x", "position_y", "heading")
"""States that the loop does not feed back: the driver's input, and the position of the car."""


@dataclass(frozen=True, eq=False)
class SteadyTurns:
    """Steady turns at which the plant was linearised, (n,) each.

    Attributes:
        sampled: the cars, (n,); meaningless where `found` is false.
        found: whether the turn exists: grip may be insufficient, or the car may have no steady state.
        front_angle: rad.
    """

    sampled: SampledCar
    found: BoolArray
    front_angle: FloatArray


def linearised(
    config: Config, speed: npt.ArrayLike, friction: npt.ArrayLike, mass_factor: npt.ArrayLike = 1.0, grip_share: float = 0.0
) -> SteadyTurns:
    """Linearise the plant at steady turns with straight rear wheels; arguments (n,) broadcast together.

    The slope of the tyres is independent of the mass and proportional to the friction; the yaw inertia is proportional to the
    mass. The delay is `config.designed_delay_samples`.

    Args:
        speed: m/s. friction: of the road. mass_factor: 1 is the configured car.
        grip_share: lateral acceleration over friction times gravity: 0 is straight ahead.
    """
    given = np.broadcast_arrays(*(np.atleast_1d(x) for x in (speed, friction, mass_factor)))
    vx, mu, factor = (np.ascontiguousarray(values, dtype=np.float64) for values in given)
    cars = np.ascontiguousarray(varied_cars(config, mass=factor).T)
    has_play = bool(config.plant.backlash_deg)
    config = config.unchecked({"plant.backlash_deg": 0.0})  # within its play, the rear wheels follow nothing
    names = plant_states(config)
    points = PlantPoints.of(config, np.zeros((len(names), vx.size)), np.zeros((len(PLANT_INPUTS), vx.size)), cars)
    points.inputs[PLANT_INPUTS.index("speed")], points.inputs[PLANT_INPUTS.index("friction")] = vx, mu
    found = np.zeros(vx.shape, dtype=np.bool_)
    # In ten steps of acceleration from straight ahead, so that each step starts near its solution.
    for share in np.linspace(0.1, 1.0, 10) if grip_share else (0.0,):
        points.states[YAW] = share * grip_share * mu * config.road.gravity_m_s2 / vx
        found = points.solve_turns()
    _, a, b = points.linearised()
    kept = [index for index, name in enumerate(names) if name not in LEFT_OUT]
    a = np.where(found[:, np.newaxis, np.newaxis], a[:, kept][:, :, kept], -np.eye(len(kept)))
    b = b[:, kept]
    if has_play:
        a, b = _behind_play(a, b, [place for place, index in enumerate(kept) if names[index] in ACTUATOR])
    sampled = sample_of(a, b, config.controller.sampling_time_s, config.designed_delay_samples)
    ratio = cars[PLANT_PARAMETERS.index("steering_ratio")]
    return SteadyTurns(sampled, found, points.states[WHEEL] / ratio)


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
