"""Checks of the generated reference model. Each takes the units of a build and raises AssertionError if the build fails it."""

import math
from collections.abc import Sequence

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.vehicle.plant_car import load_transfer_losses
from codegen.vehicle.tyre import AxleTyres
from tests.oracle.tracking import (
    ARGUMENT_MAX,
    LATERAL_ACCELERATION_MAX,
    SIDESLIP_MAX,
    SecondReferenceModel,
    TableCurve,
)
from tests.sil.checks_lookup import RealArray, any_numbers, special_values
from tests.sil.units import Units

KM_H = 1.0 / 3.6


def limits(units: Units) -> tuple[RealArray, RealArray]:
    """Return the limits of the state, as many as it has numbers, and of the inputs (4,)."""
    inputs = units.config.controller.inputs
    rear = math.radians(units.config.rear_actuator.angle_max_deg)
    yaw_rate, front = math.radians(inputs.yaw_rate_max_deg_s), math.radians(inputs.front_angle_max_deg)
    arguments = [ARGUMENT_MAX] * 2 if units.config.plant.relaxation_length_m else []
    states = np.array([SIDESLIP_MAX, yaw_rate, rear, LATERAL_ACCELERATION_MAX, *arguments], dtype=units.real)
    return states, np.array([inputs.speed_max_km_h * KM_H, front, rear, units.config.road.friction], dtype=units.real)


def random_states(units: Units, count: int, seed: int) -> RealArray:
    """Return states (count, n) that the C can leave: plain ones, some at their bounds, some next to zero."""
    rng, real, bounds = np.random.default_rng(seed), units.real, limits(units)[0]
    shape = (count, bounds.size)
    states = rng.uniform(-1.0, 1.0, shape) * rng.choice([1.0, 0.2, 0.01], (count, 1))
    states = np.where(rng.random(shape) < 0.05, rng.choice([-1.0, 1.0, 0.0, -0.0], shape), states)
    tiny = rng.choice([float(np.finfo(real).smallest_subnormal), float(np.finfo(real).tiny), -1e-30], shape)
    states = np.where(rng.random(shape) < 0.02, tiny, states).astype(real) * bounds
    return states.astype(real)


def random_inputs(units: Units, count: int, seed: int) -> RealArray:
    """Return plausible inputs (count, 4); a tenth exceed their limits, and no friction is negative."""
    rng = np.random.default_rng(seed)
    inputs = rng.uniform(-0.1, 1.0, (count, 4)) * rng.choice([0.1, 0.4, 1.0, 1.4], (count, 4))
    inputs[:, 1:3] *= rng.choice([-1.0, 1.0], (count, 2))
    inputs[:, 3] = np.abs(inputs[:, 3])
    result: RealArray = (inputs * limits(units)[1]).astype(units.real)
    return result


def wild_inputs(units: Units, count: int, seed: int, columns: int = 4) -> RealArray:
    """Return inputs (count, columns) of any bit pattern."""
    rng = np.random.default_rng(seed)
    special = np.concatenate([special_values(units.real), limits(units)[1]])
    return np.stack([any_numbers(rng, units.real, count, special) for _ in range(columns)], axis=1)


def exact_step(config: Config, state: FloatArray, inputs: FloatArray, curves: Sequence[TableCurve], step: float) -> FloatArray:
    """Return sideslip and yaw rate one linearly implicit midpoint step later, and the acceleration at its beginning: (3, n).

    With a relaxation length the step is one of the leapfrog scheme: the arguments of the curves follow by the midpoint rule,
    and the motion follows from the forces in the middle of the step. They are the last of (5, n) then.

    `state` is (2, n) or (4, n), and `inputs` (4, n) with the rear angle in the middle of the step, with a relaxation length at
    its beginning. The matrices map the motion to slips, and side forces to the motion's derivative. A steered axle whose wheel
    carries dFz more than the other is retarded by w/2 delta Fy dFz/Fz, with dFz = rho m ay h / w in front.
    """
    motion, lagging = state[:2], state[2:]
    vehicle, tyres = config.vehicle, AxleTyres.from_config(config)
    speed, friction, ones = inputs[0], inputs[3], np.ones(state.shape[1])
    lf, lr = vehicle.cg_to_front_axle_m * ones, vehicle.cg_to_rear_axle_m * ones
    slips_of = np.array([[ones, lf / speed], [ones, -lr / speed]])
    push = ones / (vehicle.mass_kg * speed)
    motion_of = np.array([[push, push], [lf / vehicle.yaw_inertia_kg_m2, -lr / vehicle.yaw_inertia_kg_m2]])
    forces, stiffness, after = [], [], []
    slips = np.einsum("ijn,jn->in", slips_of, motion) - inputs[1:3]
    for k, (tyre, curve, slip) in enumerate(zip((tyres.front, tyres.rear), curves, slips, strict=True)):
        argument = tyre.stiffness_factor * (slip - tyre.horizontal_shift)
        if lagging.size:
            share = step * speed / config.plant.relaxation_length_m
            argument = ((1.0 - 0.5 * share) * lagging[k] + share * argument) / (1.0 + 0.5 * share)
            after.append(np.clip(argument, -ARGUMENT_MAX, ARGUMENT_MAX))
        value, slope = curve(argument)
        peak = friction * tyre.peak_factor * tyre.static_load
        forces.append(-2.0 * (peak * value + tyre.vertical_shift))
        stiffness.append(-2.0 * peak * tyre.stiffness_factor * slope)
    rate = np.einsum("ijn,jn->in", motion_of, np.array(forces)) - np.stack([motion[1], 0.0 * ones])
    roll, weight = 0.5 * vehicle.cg_height_m * (forces[0] + forces[1]), vehicle.mass_kg * config.road.gravity_m_s2
    for force, angle, share, arm in zip(
        forces, inputs[1:3], (vehicle.front_roll_share, 1.0 - vehicle.front_roll_share), (lr, lf), strict=True
    ):
        static = weight * arm / (2.0 * vehicle.wheelbase)
        rate[1] -= share * roll / static * angle * force / vehicle.yaw_inertia_kg_m2
    acceleration = (forces[0] + forces[1]) / vehicle.mass_kg
    if lagging.size:
        yaw_rate = motion[1] + step * rate[1]
        sideslip = motion[0] + step * (acceleration / speed - 0.5 * (motion[1] + yaw_rate))
        return np.stack([sideslip, yaw_rate, acceleration, *after])
    jacobian = np.einsum("ikn,kn,kjn->nij", motion_of, np.array(stiffness), slips_of) - np.array([[0.0, 1.0], [0.0, 0.0]])
    change: FloatArray = np.linalg.solve(np.eye(2) - 0.5 * step * jacobian, step * rate.T[..., np.newaxis])[..., 0]
    return np.stack([*(motion + change.T), acceleration])


def check_model_physics(units: Units) -> None:
    """Check that one step is that of `exact_step` for the single-track car with load transfer.

    Tolerance: the slope has some 30 operations on terms of at most mu g L / v_min and mu g m L / Iz, each rounded by half a
    unit. The curve's argument is of size B times the slip; its rounding is multiplied by a slope of at most C B. With a
    relaxation length, the argument is about as large as that of the slip or of the state, with five more roundings.
    """
    config, count = units.config, 20_000
    states = random_states(units, count, 11)
    states[:, 4:] *= units.real(0.01)  # to 10, where the curve still changes
    states = states.astype(np.float64)
    inputs = random_inputs(units, count, 12).astype(np.float64)
    model = SecondReferenceModel(config, np.float64)
    tyres = AxleTyres.from_config(config)
    after = units.model_from(states, inputs).astype(np.float64)
    moved = np.clip(float(model.share) * (inputs[:, 2] - states[:, 2]), -model.travel, model.travel)
    rear = np.clip(states[:, 2] + moved, -model.rear_angle_max, model.rear_angle_max)
    assert np.abs(after[:, 2] - rear).max() <= 4.0 * units.eps * model.rear_angle_max
    ahead = 0.0 if states.shape[1] > 4 else 0.5
    u = np.stack([np.maximum(inputs[:, 0], model.speed_min), inputs[:, 1], states[:, 2] + ahead * moved, inputs[:, 3]])
    losses = load_transfer_losses(config)
    curves = [TableCurve.of(tyre, np.float64, loss) for tyre, loss in zip((tyres.front, tyres.rear), losses, strict=True)]
    motion, rest = [0, 1], [*range(3, states.shape[1])]
    exact = exact_step(config, states[:, motion + rest[1:]].T, u, curves, config.controller.sampling_time_s)
    bounds = limits(units)[0][motion + rest, np.newaxis].astype(np.float64)
    exact = np.clip(exact, -bounds, bounds)
    slip = (
        np.abs(states[:, 0]) + 2.0 * np.abs(states[:, 1]) / u[0] + np.abs(u[1]) + 0.1 + 0.1 * np.abs(states[:, 4:]).sum(axis=1)
    )
    acceleration = 9.81 * np.maximum(u[3], 0.9) * (30.0 + 60.0 * slip)
    period = config.controller.sampling_time_s
    rounded = [period * 3.0 / u[0] * acceleration, period * 3.0 * acceleration, acceleration, *[60.0 * slip] * len(rest[1:])]
    tolerance = units.eps * (np.abs(exact) + np.array(rounded))
    assert (np.abs(after[:, motion + rest].T - exact) <= tolerance).all()
