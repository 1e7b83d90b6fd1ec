"""The paper's car and maps, random cars, and a solution of the steady turn independent of the closed forms.

The equations of `SteadyModel` come from the CasADi model through its Jacobian, the slip angles from their definitions.
"""

import functools
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import linprog

from codegen.arrays import FloatArray
from codegen.configuration import Case, Config, preset
from codegen.ecu_map.extend import TotalMap, extend
from codegen.map_file.bounds import Binding
from codegen.map_file.map import ReferenceMap
from codegen.optimum import exact
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.solve import solve_case
from codegen.vehicle.dynamics import Model, single_track
from codegen.vehicle.single_track import SingleTrack
from tests import shared
from tests.whole_car import car

CASE = "random"
PAPER = preset()
CASES = ("fws", "4ws-1", "4ws-2")


@functools.cache
def paper_map(case: str = "4ws-2") -> ReferenceMap:
    """Return one of the paper's cases on the default grid of 101 by 100."""
    return solve_case(PAPER, case)


@functools.cache
def paper_total(case: str = "4ws-2") -> TotalMap:
    """Return the extension of `paper_map`."""
    return extend(paper_map(case), PAPER)


def changed(config: Config, **tables: Mapping[str, Any]) -> Config:
    """Return a configuration with some keys of some tables replaced; see `Config.replace`."""
    return config.replace(tables, "test")


def nonlinear(config: Config, case: str) -> Config:
    """Return a configuration with the nonlinear tyre in one case."""
    return changed(config, cases={case: {**config.cases[case].model_dump(mode="json"), "tyre_model": "magic-formula"}})


@functools.cache
def nonlinear_map(case: str = "4ws-2") -> ReferenceMap:
    """Return the map of one of the paper's cases with the nonlinear tyre, on the default grid."""
    return shared.once(f"nonlinear map {case}", lambda: solve_case(nonlinear(PAPER, case), case))  # type: ignore[no-any-return]


def random_config(rng: np.random.Generator, *, rear_steering: bool | None = None) -> Config:
    """Return a car between a small one and a van with plausible tyres, limits and weight, and a grid of 4 by 4 cells.

    About half of the cars oversteer; their grids end below the critical speed. By default, one in seven has no rear steering.
    """

    def draw(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def tyre() -> dict[str, float]:
        return {
            "cornering_stiffness_n_per_rad": draw(40e3, 250e3),
            "shape_factor_c": draw(1.0, 1.9),
            "curvature_factor_e": draw(-3.0, 0.8),
            "peak_factor_p1": draw(0.7, 1.4),
        }

    steers = draw(0.0, 1.0) > 1.0 / 7.0
    data = {
        "vehicle": {
            "mass_kg": draw(600.0, 4_000.0),
            "yaw_inertia_kg_m2": draw(800.0, 8_000.0),
            "cg_to_front_axle_m": draw(0.8, 2.2),
            "cg_to_rear_axle_m": draw(0.8, 2.2),
        },
        "road": {"friction": draw(0.3, 1.2)},
        "tyre": {"front": tyre(), "rear": tyre()},
        "limits": {
            "sideslip_max_deg": draw(0.8, 8.0),
            "lateral_acceleration_max_g": draw(0.1, 1.0),
            "rear_angle_max_deg": draw(0.5, 8.0),
            "slip_departure_percent": draw(3.0, 20.0),
        },
        "cases": {
            CASE: {
                "rear_steering": steers if rear_steering is None else rear_steering,
                # From nearly free sideslip (the objective is concave) to sideslip as the only objective.
                "sideslip_weight_per_s2": 10.0 ** draw(-2.0, 4.5),
            }
        },
    }
    top = min(draw(60.0, 250.0), 0.97 * 3.6 * SingleTrack.from_config(car(data)).critical_speed)
    data["grid"] = {
        "speed_min_km_h": min(10.0, 0.3 * top),
        "speed_max_km_h": top,
        "speed_points": 4,
        "front_angle_min_deg": 0.2,
        "front_angle_max_deg": draw(3.0, 20.0),
        "front_angle_points": 4,
    }
    return car(data)


@dataclass(frozen=True)
class Turns:
    """Steady turns at one speed and front angle over rear angles (k,): each attribute (k,), rad and rad/s."""

    sideslip: FloatArray
    yaw_rate: FloatArray
    used: dict[Binding, FloatArray]  # used fraction of each constraint's bound

    @property
    def feasible(self) -> npt.NDArray[np.bool_]:
        """Return whether each turn satisfies every constraint."""
        result: npt.NDArray[np.bool_] = np.all([share <= 1.0 for share in self.used.values()], axis=0)
        return result

    def objective(self, weight: float) -> FloatArray:
        """Return -r^2 + weight beta^2."""
        return -(self.yaw_rate**2) + weight * self.sideslip**2


@dataclass(frozen=True)
class SteadyModel:
    """Steady turns of a car by a linear solve with the CasADi model's Jacobian."""

    model: Model
    problem: SteadyTurnProblem

    @classmethod
    def of(cls, config: Config, case: Case) -> Self:
        """Return the car and the bounds of one case."""
        return cls(single_track(config, "linear"), SteadyTurnProblem.from_config(config, case))

    def turns(self, speed: float, front_angle: float, rear_angle: FloatArray) -> Turns:
        """Solve 0 = A [beta, r] + B [delta_f, delta_r] for each rear angle."""
        state, steering = (np.array(matrix) for matrix in self.model.jacobian([0.0, 0.0], [speed, 0.0, 0.0, 1.0]))
        angles = np.vstack([np.full(rear_angle.shape, front_angle), rear_angle])
        sideslip, yaw_rate = -np.linalg.solve(state, steering[:, 1:3] @ angles)
        problem = self.problem
        slip_front = sideslip + problem.car.front_arm * yaw_rate / speed - front_angle
        slip_rear = sideslip - problem.car.rear_arm * yaw_rate / speed - rear_angle
        used = {
            Binding.SIDESLIP: np.abs(sideslip) / problem.sideslip_max,
            Binding.LATERAL_ACCELERATION: np.abs(speed * yaw_rate) / problem.lateral_acceleration_max,
            Binding.SLIP_FRONT: np.abs(slip_front) / problem.front_slip_max,
            Binding.SLIP_REAR: np.abs(slip_rear) / problem.rear_slip_max,
        }
        if problem.rear_angle_max > 0.0:
            used[Binding.REAR_ANGLE] = np.abs(rear_angle) / problem.rear_angle_max
        if math.isfinite(problem.envelope_rear_slip_max):
            straight = sideslip - problem.car.rear_arm * yaw_rate / speed
            used[Binding.ENVELOPE_SIDESLIP] = np.abs(straight) / problem.envelope_rear_slip_max
            used[Binding.ENVELOPE_YAW_RATE] = np.abs(yaw_rate) * speed / problem.envelope_lateral_acceleration_max
        return Turns(sideslip, yaw_rate, used)

    def scan(self, speed: float, front_angle: float, points: int = 4_001) -> tuple[float, float] | None:
        """Return (rear angle, objective) of the best of `points` rear angles; None if none is feasible.

        The scan is refined three times around the best point and both ends of the feasible range.
        """
        limit = self.problem.rear_angle_max
        rear = np.linspace(-limit, limit, points) if limit > 0.0 else np.zeros(1)
        first, best, last = self._feasible_best(speed, front_angle, rear)
        if best is None or first is None or last is None:
            return None
        found = [best]
        for centre in {first[0], best[0], last[0]}:
            width = 2.0 * limit / (points - 1)
            for _ in range(3 if limit > 0.0 else 0):
                around = np.clip(np.linspace(centre - width, centre + width, points), -limit, limit)
                _, refined, _ = self._feasible_best(speed, front_angle, around)
                if refined is not None:
                    found.append(refined)
                    centre, width = refined[0], 2.0 * width / (points - 1)
        return min(found, key=lambda candidate: candidate[1])

    def _feasible_best(self, speed: float, front_angle: float, rear: FloatArray) -> tuple[tuple[float, float] | None, ...]:
        """Return the first, best and last feasible rear angle of a list, each with its objective."""
        turns = self.turns(speed, front_angle, rear)
        inside = np.flatnonzero(turns.feasible)
        if not inside.size:
            return None, None, None
        value = turns.objective(self.problem.sideslip_weight)
        chosen = (inside[0], inside[np.argmin(value[inside])], inside[-1])
        return tuple((float(rear[k]), float(value[k])) for k in chosen)

    def widest_turn(self, speed: float) -> tuple[float, float]:
        """Return the largest feasible front angle and its rear angle (rad), by linear programming."""
        problem = self.problem
        bounds = (problem.sideslip_max, problem.lateral_acceleration_max, problem.front_slip_max, problem.rear_slip_max)
        columns = []
        for front, rear in ((1.0, 0.0), (0.0, 1.0)):
            turns = self.turns(speed, front, np.array([rear]))
            beta, r = float(turns.sideslip[0]), float(turns.yaw_rate[0])
            slip_front = beta + problem.car.front_arm * r / speed - front
            slip_rear = beta - problem.car.rear_arm * r / speed - rear
            columns.append([beta, speed * r, slip_front, slip_rear])
        rows = np.array(columns).T / np.array(bounds)[:, np.newaxis]
        limit = problem.rear_angle_max
        answer = linprog([-1.0, 0.0], np.vstack([rows, -rows]), np.ones(8), bounds=[(0.0, None), (-limit, limit)])
        assert answer.status == 0
        front, rear = (float(value) for value in answer.x)
        return front, rear


def check_against_scan(model: SteadyModel, speeds: FloatArray, angles: FloatArray) -> None:
    """Compare the exact solution with a brute-force scan of the independent model.

    The scan starts at a spacing of 2 limit / 4000, so it may miss a narrower interval; it ends below 1e-12 rad. Near the vertex
    of a parabola the objective resolves the rear angle only to the square root of the rounding error (1e-8 rad), and the yaw
    gain reaches 30/s: hence 1e-6 rad/s. The objective itself agrees to 1e-8 of the larger of one and its size.
    """
    problem = model.problem
    found = exact.solve(problem, speeds, angles)
    spacing = 2.0 * problem.rear_angle_max / 4_000
    for i, j in itertools.product(range(speeds.size), range(angles.size)):
        best = model.scan(speeds[i], angles[j])
        if best is None:
            assert found.margin[i, j] <= spacing + 1e-12
            continue
        assert found.feasible[i, j] or found.margin[i, j] > -1e-12
        if not found.feasible[i, j]:
            continue
        turns = model.turns(speeds[i], angles[j], np.array([found.rear_angle[i, j], best[0]]))
        assert max(float(share[0]) for share in turns.used.values()) <= 1.0 + 1e-9
        mine, scanned = turns.objective(problem.sideslip_weight)
        assert mine == pytest.approx(scanned, abs=1e-8 * max(1.0, abs(scanned)))
        assert found.yaw_rate[i, j] == pytest.approx(turns.yaw_rate[1], abs=1e-6)
        assert found.yaw_rate[i, j] == pytest.approx(turns.yaw_rate[0], abs=1e-12)
        assert found.sideslip[i, j] == pytest.approx(turns.sideslip[0], abs=1e-12)
