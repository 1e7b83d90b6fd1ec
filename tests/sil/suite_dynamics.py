"""The vehicle's equations in C against CasADi's own machine, within the rounding of single precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from codegen.vehicle.dynamics import TyreModel, single_track
from tests.emit import test_casadi_c as machine
from tests.sil.case import Case

MODELS: tuple[TyreModel, ...] = ("linear", "magic-formula")
POINTS = 250


def _known(case: Case) -> list[tuple[str, Any, Any]]:
    """Name of each function, what the machine gives and how far rounding may be from it."""
    config = case.built.software.config
    x, u = machine.dynamics_points(POINTS)
    wide = machine.as_double(x, u)
    known = []
    for model in MODELS:
        functions, name = single_track(config, model), machine.c_name(model)
        (bound,) = machine.rounding_bounds(functions.derivative, *wide)
        known.append((name, machine.machine_derivative(config, model, x, u), bound))
        both = machine.by_rows(*machine.rounding_bounds(functions.jacobian, *wide))
        known.append((f"{name}_jacobian", machine.machine_jacobian(config, model, x, u), both))
    return known


def check_dynamics(case: Case) -> None:
    """Values and Jacobians of both tyres are the machine's, and a speed below one counts as one."""
    if "dynamics" not in case.known:
        case.known["dynamics"] = _known(case)
    x, u = machine.dynamics_points(POINTS)
    software = case.built.software
    for name, wanted, bound in case.known["dynamics"]:
        assert (np.abs(machine.generated(software, name, x, u) - wanted) <= bound).all(), name
    for model in MODELS:
        for what in ("", "_jacobian"):
            machine.test_speeds_below_one_count_as_one(software, model, what)
