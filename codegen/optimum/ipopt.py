"""Solve the steady-turn problem point by point with IPOPT: the reference for the other solvers.

The solver shares no equations with `exact` or `nonlinear`. The variables are (beta, r, delta_r); steady state is an equality
constraint made from the CasADi models (see `turns`). The solver is built once and warm-started along the grid. Where the
objective is concave over the steady turns, it starts from both ends and keeps the better result.

Where floor and cap change the optimum (`demand`), a second optimisation takes the turn nearest to the yaw rate asked for.

For a law (`rear_law`) the objective is the squared distance from it. The turn of the law is feasible if the smallest distance
is zero, or if the rear angle is at its end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import MapError
from codegen.interrupts import deferred
from codegen.map_file.bounds import BOUNDS, TurnQuantities
from codegen.optimum.demand import Demand
from codegen.optimum.exact import Solution, binding
from codegen.optimum.problem import STABILITY_MARGIN, SteadyTurnProblem
from codegen.optimum.turns import SteadyTurns
from codegen.units import KM_H
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, TyreModel, single_track, two_track
from codegen.vehicle.tyre import WHEEL_SPEED_MIN

STABILITY_SCALE = 100.0
"""Divisor of the stability constraint, in determinants of a neutral car. It exceeds every turn's, so only one side binds."""


@dataclass(frozen=True)
class TurnExpressions:
    """A steady turn over z (3,), the sideslip, yaw rate and rear angle, each divided by its element of `scale`.

    Attributes:
        residual: (2,) zero in a steady turn, of order one.
        used: shares of bounds, each between -1 and 1 where they are kept; |z[0]| and |z[2]| are also bounded by one.
        slips: (2,) rad, of the front and the rear axle.
        objective: as in `problem`, or for a law the square of `distance`.
        distance: of a law's quantity from its value, over a slip bound; zero for an optimisation.
    """

    residual: Any
    used: Any
    slips: Any
    objective: Any
    distance: Any
    scale: FloatArray


def turn_expressions(
    config: Config, problem: SteadyTurnProblem, tyre_model: TyreModel, z: Any, speed: Any, front: Any, wanted: Any
) -> TurnExpressions:
    """Return the expressions of one case over the symbols z, speed (m/s), front angle (rad) and the value of a law (rad)."""
    scale = np.array([problem.sideslip_max, 1.0, problem.rear_angle_max or math.radians(1.0)])
    beta, yaw_rate, rear = (z[i] * scale[i] for i in range(3))
    equations = _single_track if tyre_model == "linear" else _two_track
    rates, slips, further = equations(config, (beta, yaw_rate, rear), speed, front)
    # Residuals as angles over a slip bound, so that all constraints are of order one.
    car = problem.car
    residual = ca.vertcat(
        rates[0] * car.mass * speed / (car.front_stiffness * problem.front_slip_max),
        rates[1] * car.yaw_inertia / (car.front_arm * car.front_stiffness * problem.front_slip_max),
    )
    turn = TurnQuantities(speed, front, yaw_rate, beta, *slips, rear)
    limits = [(bound, problem.limit_of(bound)) for bound in BOUNDS if not bound.is_variable]
    used = ca.vertcat(*(bound.value(turn) / limit for bound, limit in limits if math.isfinite(limit)), *further)
    objective, distance = -(yaw_rate**2) + problem.sideslip_weight * beta**2, 0.0 * beta
    if problem.law is not None:
        distance = (problem.law.bound.value(turn) - wanted) / problem.front_slip_max
        objective = distance**2
    return TurnExpressions(residual, used, ca.vertcat(*slips), objective, distance, scale)


Turn = tuple[Any, Any, Any]


def _single_track(config: Config, turn: Turn, speed: Any, front: Any) -> tuple[Any, tuple[Any, Any], tuple[Any, ...]]:
    """(beta', r'), slip angles, and no further constraint."""
    beta, yaw_rate, rear = turn
    model, vehicle = single_track(config, "linear"), config.vehicle
    rates = model.derivative(ca.vertcat(beta, yaw_rate), ca.vertcat(speed, front, rear, 0.9))
    slip_front = beta + vehicle.cg_to_front_axle_m * yaw_rate / speed - front
    slip_rear = beta - vehicle.cg_to_rear_axle_m * yaw_rate / speed - rear
    return rates, (slip_front, slip_rear), ()


def _two_track(config: Config, turn: Turn, speed: Any, front: Any) -> tuple[Any, tuple[Any, Any], tuple[Any, ...]]:
    """(beta', r'), the slip outputs, and the share that keeps the turn off its stability limit."""
    beta, yaw_rate, rear = turn
    model = two_track(without_shifts(config))
    rolling = ca.fmax(speed, WHEEL_SPEED_MIN)
    x, u = ca.SX.zeros(len(PLANT_STATES)), ca.SX.zeros(len(PLANT_INPUTS))
    x[0], x[1], x[2], x[3] = rolling * ca.tan(beta), yaw_rate, front * config.steering.ratio, rear
    u[0], u[1], u[2], u[3] = speed, x[2], rear, config.road.friction
    assert model.output is not None  # the plant has outputs
    derivative, output = model.derivative(x, u), model.output(x, u)
    neutral = config.vehicle.wheelbase / rolling
    determinant, effect = _stability(model, x, u)
    _, straight = _stability(model, ca.SX.zeros(len(PLANT_STATES)), u)
    spare = (determinant - STABILITY_MARGIN * neutral * effect) / (STABILITY_SCALE * neutral * straight)
    rates = ca.vertcat(derivative[0] / speed, derivative[1])
    return rates, (output[3], output[4]), (1.0 - spare,)


def _stability(model: Any, x: Any, u: Any) -> tuple[Any, Any]:
    """Determinant of the plant's Jacobian over lateral speed and yaw rate, and over it -d r/d delta_r in steady turns."""
    jacobian = model.jacobian(x, u)[0]
    determinant = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
    return determinant, jacobian[0, 0] * jacobian[1, 3] - jacobian[1, 0] * jacobian[0, 3]


def without_shifts(config: Config) -> Config:
    """Return the configuration for which the map is solved: tyres without shifts, on the ideal car."""
    none = {"horizontal_shift_deg": 0.0, "vertical_shift_n": 0.0}
    return config.with_ideal_plant().replace({"tyre": {"front": none, "rear": none}})


Progress = Callable[[int, int], None]

# Tight, because the comparison is: a bound that is just touched leaves an error of sqrt(mu), so mu must end far below 1e-12.
_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-12,
    "ipopt.compl_inf_tol": 1e-16,
    "ipopt.constr_viol_tol": 1e-12,
    "ipopt.dual_inf_tol": 1e-8,
    "ipopt.acceptable_iter": 0,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.honor_original_bounds": "yes",
    "ipopt.mu_target": 0.0,
    "ipopt.max_iter": 200,
    "ipopt.mu_strategy": "monotone",
    "ipopt.mu_init": 1e-2,
}
# For the few points where rounding stops IPOPT short of that: still within 1e-6 of a scaled variable.
_EASIER_OPTIONS = {**_OPTIONS, "ipopt.tol": 1e-10, "ipopt.compl_inf_tol": 1e-14}
_NO_STEP_LEFT = "Search_Direction_Becomes_Too_Small"
# A linear problem, whose value alone counts: tighter than this it may stall without end where its solution is not unique.
_ELASTIC_OPTIONS = {**_OPTIONS, "ipopt.tol": 1e-10, "ipopt.compl_inf_tol": 1e-10, "ipopt.constr_viol_tol": 1e-10}
_CONVERGED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
_FEASIBILITY_TOLERANCE = 1e-9
_LAW_TOLERANCE = 1e-6
"""Largest distance from a law, over a slip bound, and of the rear angle from its end; a touched bound leaves sqrt(1e-16)."""
_TIE = 1e-9
"""Objectives closer than this count as equal, relative to the larger of one and their size."""


@dataclass(frozen=True)
class _Solvers:
    """Optimisations, elastic feasibility problem and tangent of the steady turns, in variables scaled to order one.

    `optimum` is that of the objective, `nearest` that of the distance from a yaw rate; each with strict and easier options.
    """

    optimum: tuple[Any, Any]
    nearest: tuple[Any, Any]
    elastic: Any
    tangent: Any
    slips: Any
    distance: Any
    scale: FloatArray
    bounds: FloatArray
    shares: int
    """Number of bounds in addition to those on the variables."""


def _build(config: Config, problem: SteadyTurnProblem, tyre_model: TyreModel) -> _Solvers:
    z, slack = ca.SX.sym("z", 3), ca.SX.sym("s")
    speed, front, wanted = ca.SX.sym("vx"), ca.SX.sym("delta_f"), ca.SX.sym("wanted")
    turn = turn_expressions(config, problem, tyre_model, z, speed, front, wanted)
    parameters = ca.vertcat(speed, front, wanted)

    def solvers(objective: Any) -> tuple[Any, Any]:
        steady_turn = {"x": z, "p": parameters, "f": objective, "g": ca.vertcat(turn.residual, turn.used)}
        strict, easier = (ca.nlpsol("optimum", "ipopt", steady_turn, options) for options in (_OPTIONS, _EASIER_OPTIONS))
        return strict, easier

    # |z_beta| and |z_rear| become constraints here, so that all of them can be relaxed by the same slack.
    box = ca.vertcat(turn.used, z[0], z[2])
    relaxed = ca.vertcat(turn.residual, box - slack, box + slack)
    elastic = ca.nlpsol(
        "elastic", "ipopt", {"x": ca.vertcat(z, slack), "p": parameters, "f": slack, "g": relaxed}, _ELASTIC_OPTIONS
    )
    direction = -ca.solve(ca.jacobian(turn.residual, z[:2]), ca.jacobian(turn.residual, z[2]))
    steady_tangent = ca.vertcat(direction, 1.0)
    curvature = steady_tangent.T @ ca.hessian(turn.objective, z)[0] @ steady_tangent
    tangent = ca.Function("curvature", [parameters, z], [ca.simplify(curvature)])
    slips = ca.Function("slips", [z, parameters], [turn.slips])
    distance = ca.Function("distance", [z, parameters], [turn.distance])
    rear_bound = 1.0 if problem.rear_angle_max > 0.0 else 0.0
    bounds = np.array([1.0, np.inf, rear_bound])
    optimum, nearest = solvers(turn.objective), solvers((z[1] * turn.scale[1] - wanted) ** 2)
    return _Solvers(optimum, nearest, elastic, tangent, slips, distance, turn.scale, bounds, int(turn.used.numel()))


def solve(
    config: Config,
    turns: SteadyTurns,
    speed: FloatArray,
    front_angle: FloatArray,
    progress: Progress | None = None,
    tyre_model: TyreModel = "linear",
) -> Solution:
    """Solve for speeds (n,) in m/s and front angles (m,) in rad, one cell after the other.

    Args:
        turns: the case; its demand is taken from there.
        progress: called with (cells done, cells in all) after each speed.
        tyre_model: "linear" for the single-track car with linear tyres, "magic-formula" for the two-track plant.

    Returns:
        As `exact.solve`; `margin` is NaN, for an interior-point method does not know the feasible interval.

    Raises:
        MapError: IPOPT does not converge; names the operating point.
    """
    problem = turns.problem
    solvers = _build(config, problem, tyre_model)
    pairs = [values.ravel() for values in np.broadcast_arrays(speed[:, np.newaxis], front_angle)]
    demand = turns.demand(pairs[0], pairs[1])
    if demand is not None:
        demand = Demand(*(np.reshape(values, (speed.size, -1)) for values in np.broadcast_arrays(demand.least, demand.limit)))
    shape = (speed.size, front_angle.size)
    result, slips = np.full((*shape, 3), np.nan), np.full((*shape, 2), np.nan)
    with deferred() as stop_if_asked:
        for i, vx in enumerate(speed):
            warm, feasible_expected = np.zeros(3), True
            for j, delta_f in enumerate(front_angle):
                wanted = 0.0 if problem.law is None else float(problem.law.value(vx, delta_f))
                parameters = np.array([vx, delta_f, wanted])
                point = _solve_point(solvers, parameters, warm, feasible_expected=feasible_expected)
                stop_if_asked()
                feasible_expected = point is not None
                if point is not None and demand is not None:
                    asked = Demand(demand.least[i, j], demand.limit[i, j]).of_optimum(point[1] * solvers.scale[1])
                    point = _nearest(solvers, np.array([vx, delta_f, float(asked)]), point)
                if point is not None and _is_of_law(solvers, parameters, point):
                    result[i, j] = point * solvers.scale
                    slips[i, j] = np.asarray(solvers.slips(point, parameters)).ravel()
                if point is not None:
                    warm = point
            if progress is not None:
                progress((i + 1) * front_angle.size, speed.size * front_angle.size)
    sideslip, yaw_rate, rear_angle = (result[..., k] for k in range(3))
    turn = TurnQuantities(speed[:, np.newaxis], front_angle, yaw_rate, sideslip, slips[..., 0], slips[..., 1], rear_angle)
    return Solution(
        yaw_rate=yaw_rate,
        sideslip=sideslip,
        rear_angle=rear_angle,
        feasible=np.isfinite(yaw_rate),
        active=binding(problem, turn, demand),
        margin=np.full(shape, np.nan),
    )


def _solve_point(solvers: _Solvers, parameters: FloatArray, warm: FloatArray, *, feasible_expected: bool) -> FloatArray | None:
    """The optimum in scaled variables, or None where the point is infeasible.

    An infeasible point costs IPOPT's restoration far more than the elastic problem, which therefore goes first where a
    neighbour was infeasible. It alone decides that a point is infeasible: an optimisation that fails proves nothing.
    """
    inside: FloatArray | None = None
    if not feasible_expected:
        inside = _feasible_point(solvers, parameters, warm)
        if inside is None:
            return None
    best = _best(solvers, parameters, _starts(solvers, parameters, warm))
    if best is None:
        inside = _feasible_point(solvers, parameters, warm) if inside is None else inside
        if inside is None:
            return None
        best = _best(solvers, parameters, [inside])
    if best is None:
        raise _not_converged(parameters, "the optimum")
    return best


def _nearest(solvers: _Solvers, parameters: FloatArray, optimum: FloatArray) -> FloatArray:
    """Return the feasible turn with the yaw rate nearest to the one asked for, from the optimum."""
    found = _run(solvers, solvers.nearest, parameters, optimum)
    if found is None:
        raise _not_converged(parameters, "the yaw rate asked for")
    return found[1]


def _is_of_law(solvers: _Solvers, parameters: FloatArray, point: FloatArray) -> bool:
    """Return whether a turn is that of the law, and not only the nearest inside the bounds. Every optimum is.

    A rear angle at an end counts if the law wants it beyond: sideslip and rear angle both rise with the rear angle.
    """
    distance = float(solvers.distance(point, parameters))
    at_end = abs(point[2]) >= 1.0 - _LAW_TOLERANCE and distance * point[2] <= 0.0
    return at_end or abs(distance) <= _LAW_TOLERANCE


def _starts(solvers: _Solvers, parameters: FloatArray, warm: FloatArray) -> list[FloatArray]:
    """The neighbour's solution; both ends of the rear angle where the objective is concave over the steady turns."""
    steers = solvers.bounds[2] > 0.0
    if steers and float(solvers.tangent(parameters, warm)) <= 0.0:
        return [np.array([warm[0], warm[1], end]) for end in (-1.0, 1.0)]
    return [warm]


def _best(solvers: _Solvers, parameters: FloatArray, starts: list[FloatArray]) -> FloatArray | None:
    """Return the best turn that IPOPT finds from several starts; of equally good ones, the one furthest to the left."""
    found = [answer for answer in (_run(solvers, solvers.optimum, parameters, start) for start in starts) if answer is not None]
    if not found:
        return None
    least = min(objective for objective, _ in found)
    # Without a weight on sideslip a turn to the right can be as good; a front angle to the left selects the left one.
    equal = [point for objective, point in found if objective <= least + _TIE * max(1.0, abs(least))]
    return max(equal, key=lambda point: float(point[1]))


def _not_converged(parameters: FloatArray, what: str) -> MapError:
    speed, front_angle = (float(value) for value in parameters[:2])
    return MapError(
        f"IPOPT does not converge to {what}",
        where=f"{speed / KM_H:.6g} km/h, {math.degrees(front_angle):.6g} deg",
        remedy="take the exact method, or check the vehicle data",
    )


def _run(
    solvers: _Solvers, options: tuple[Any, Any], parameters: FloatArray, start: FloatArray
) -> tuple[float, FloatArray] | None:
    """Objective and point that IPOPT converges to from `start`, or None."""
    for optimum in options:
        answer = optimum(
            x0=start,
            p=parameters,
            lbx=-solvers.bounds,
            ubx=solvers.bounds,
            lbg=np.append([0.0, 0.0], -np.ones(solvers.shares)),
            ubg=np.append([0.0, 0.0], np.ones(solvers.shares)),
        )
        status = optimum.stats()["return_status"]
        if status in _CONVERGED:
            return float(answer["f"]), np.asarray(answer["x"]).ravel()
        if status != _NO_STEP_LEFT:
            break
    return None


def _feasible_point(solvers: _Solvers, parameters: FloatArray, start: FloatArray) -> FloatArray | None:
    """Return the point furthest inside all constraints; None if even that point violates one."""
    steers = solvers.bounds[2] > 0.0
    # Without rear steering delta_r is fixed at zero and has no bound to relax.
    limits = np.append(np.ones(solvers.shares + 1), 1.0 if steers else np.inf)
    fixed = np.inf if steers else 0.0
    infinite = np.full(limits.size, np.inf)
    for first in (start, np.zeros(3)):
        answer = solvers.elastic(
            x0=np.append(first, 1.0),
            p=parameters,
            lbx=[-np.inf, -np.inf, -fixed, -np.inf],
            ubx=[np.inf, np.inf, fixed, np.inf],
            lbg=np.concatenate([[0.0, 0.0], -infinite, -limits]),
            ubg=np.concatenate([[0.0, 0.0], limits, infinite]),
        )
        if solvers.elastic.stats()["return_status"] in _CONVERGED:
            point = np.asarray(answer["x"]).ravel()
            return point[:3] if point[3] <= _FEASIBILITY_TOLERANCE else None
    raise _not_converged(parameters, "a feasible point")
