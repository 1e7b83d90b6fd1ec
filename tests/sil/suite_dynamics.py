"""Comparison of the vehicle equations in C with CasADi: within single-precision rounding, or bit for bit in double
precision."""

from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.sil.software import Software
from codegen.vehicle.dynamics import TyreModel, single_track
from tests.sil.case import Case
from tests.sil.rounding import rounding_bounds

MODELS: tuple[TyreModel, ...] = ("linear", "magic-formula")
POINTS = 250


def dynamics_points(count: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return states and inputs of cars in normal driving and in a slide."""
    rng = np.random.default_rng(6)
    x = rng.normal(size=(count, 2)) * [0.06, 0.4]
    u = np.column_stack([rng.uniform(1.0, 60.0, count), rng.normal(size=(count, 2)) * 0.08, rng.uniform(0.1, 1.2, count)])
    return x.astype(np.float32), u.astype(np.float32)


def generated(software: Software, name: str, x: npt.NDArray[Any], u: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the rows of the generated function's results; a Jacobian as 2 x (2 + 4) by rows."""
    function = software.function(f"dynamics_{name}")
    state, given = software.new("dynamics_state"), software.new("dynamics_input")
    rows = []
    for point, values in zip(x, u, strict=True):
        state.sideslip_angle, state.yaw_rate = point
        given.speed, given.front_angle, given.rear_angle, given.friction = values
        result = function(state, given)
        if name.endswith("jacobian"):
            rows.append([*result.state[0], *result.input[0], *result.state[1], *result.input[1]])
        else:
            rows.append([result.sideslip_angle, result.yaw_rate])
    return np.array(rows)


def _by_rows(dfdx: Any, dfdu: Any) -> FloatArray:
    """Return CasADi's column-major elements in the order of `generated`, (n, elements)."""
    return np.hstack([dfdx[:, 0::2], dfdu[:, 0::2], dfdx[:, 1::2], dfdu[:, 1::2]])


def _only(result: Any) -> Any:
    return result


def _known(case: Case) -> list[tuple[str, Any, Any]]:
    """Return each function's name, CasADi's double-precision result and the bound of its rounding error."""
    x, u = (points.astype(np.float64) for points in dynamics_points(POINTS))
    is_single = case.built.real is np.float32
    known = []
    for model in MODELS:
        functions, name = single_track(case.built.software.config, model), model.replace("-", "_")
        for function, arranged, what in ((functions.derivative, _only, ""), (functions.jacobian, _by_rows, "_jacobian")):
            results = function.map(POINTS)(x.T, u.T)
            columns = results if isinstance(results, tuple) else (results,)
            wanted = arranged(*(np.array(each).reshape(-1, POINTS, order="F").T for each in columns))
            bound = arranged(*rounding_bounds(function, x, u)) if is_single else 0.0
            known.append((name + what, wanted, bound))
    return known


def check_dynamics(case: Case) -> None:
    """Check values and Jacobians of both tyres against CasADi, and that a speed below 1 m/s counts as 1 m/s."""
    if "dynamics" not in case.known:
        case.known["dynamics"] = _known(case)
    x, u = dynamics_points(POINTS)
    for name, wanted, bound in case.known["dynamics"]:
        assert (np.abs(generated(case.built.software, name, x, u) - wanted) <= bound).all(), name
        slow = u[:20].copy()
        found = {}
        for speed in (1.0, 0.999, 0.1, 0.0, -0.0, -20.0, -np.inf, np.nan, 1.001):
            slow[:, 0] = speed
            found[speed] = generated(case.built.software, name, x[:20], slow)
        faster = found.pop(1.001)
        assert all(np.array_equal(values, found[1.0]) for values in found.values()), name
        assert not (faster == found[1.0]).all(axis=1).any(), name
