"""The sampled car and its loop in python-control, built from blocks; no matrix is shared with the code under test."""

import control
import numpy as np

from codegen.configuration import Config
from codegen.design.family import Member
from codegen.vehicle.dynamics import PLAY_TIME_CONSTANT
from codegen.vehicle.single_track import SingleTrack


def sampled_car(config: Config, member: Member, speed: float, delay: int) -> control.StateSpace:
    """Return the discrete model from commanded rear angle to yaw rate: body and tyres in a loop, actuator and delay in series.

    The tyres receive the body's slip angles, each through a first-order lag of length sigma; the body receives the tyres'
    forces.
    """
    car = SingleTrack.from_config(config)
    mass = car.mass * member.mass_factor
    inertia = car.yaw_inertia * member.mass_factor * member.yaw_inertia_factor
    lf, lr = car.front_arm, car.rear_arm
    # Side forces in; steady slip angles (wheels straight ahead) and yaw rate out.
    body = control.ss(
        [[0.0, -1.0], [0.0, 0.0]],
        [[1.0 / (mass * speed), 1.0 / (mass * speed)], [lf / inertia, -lr / inertia]],
        [[1.0, lf / speed], [1.0, -lr / speed], [0.0, 1.0]],
        np.zeros((3, 2)),
    )
    factors = [member.front_stiffness_factor, member.rear_stiffness_factor]
    stiffness = np.diag(factors) * [car.front_stiffness, car.rear_stiffness]
    sigma = member.relaxation_length
    if sigma > 0.0:
        pace = np.diag([speed / sigma, speed / (sigma * config.plant.rear_relaxation_factor)])
        tyres = control.ss(-pace, pace, -stiffness, np.zeros((2, 2)))
    else:
        tyres = control.ss([], [], [], -stiffness)
    # The body in a loop with its tyres; by linearity, the rear angle acts through separate tyres.
    slips_of_body = control.ss([], [], [], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    rolling = control.feedback(body, tyres * slips_of_body, sign=1)
    yaw_rate = control.ss([], [], [], [[0.0, 0.0, 1.0]]) * rolling
    forces = tyres * control.ss([], [], [], [[0.0], [-1.0]])  # the rear angle reduces the rear slip angle
    lag, share = member.actuator_lag, config.plant.actuator_motor_share
    actuator = control.ss(control.tf([1.0], [share * lag**2, lag, 1.0] if share else [lag, 1.0]))
    if config.plant.backlash_deg:
        actuator = control.ss(control.tf([1.0], [PLAY_TIME_CONSTANT, 1.0])) * actuator
    time = config.controller.sampling_time_s
    sampled = control.c2d(yaw_rate * forces * actuator, time, method="zoh")
    late = control.tf([1.0], [1.0] + delay * [0.0], time)
    return sampled * control.ss(late) if delay else sampled


def loop(config: Config, member: Member, speed: float, kp: float, ki: float) -> control.StateSpace:
    """Return L = -(Kp + Ki T z/(z - 1)) P."""
    time = config.controller.sampling_time_s
    controller = kp + ki * control.tf([time, 0.0], [1.0, -1.0], time) if ki else control.tf([kp], [1.0], time)
    return -sampled_car(config, member, speed, config.tuning.delay_samples) * control.ss(controller)
