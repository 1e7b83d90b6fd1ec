"""A CasADi function in stages and lanes: equal to the CasADi machine, with each stage depending only on its arguments."""

import re
from typing import Any

import casadi as ca
import pytest

from codegen.emit.casadi_c import staged_body

SIZES = {"p": 3, "u": 2, "x": 2}
STAGES = {"car": ["p"], "step": ["u"], "rate": ["x"]}


def everything() -> Any:
    """Return an expression with each operation of the plant, over arguments of all stages."""
    p, u, x = (ca.SX.sym(name, size) for name, size in SIZES.items())
    slow = p[0] * p[1] + 2.0
    per_step = ca.fmax(u[0] / p[0], -slow) * p[2]
    turned = ca.sin(p[1] * ca.atan(x[0] / per_step)) + ca.cos(x[1]) * slow
    least = ca.fmin(x[1] / (u[0] * u[0] + 1.0), 0.3) - (-x[0]) / 3.0
    results = ca.vertcat(x[0] / p[0] + u[1] / slow, turned, least, per_step, slow, p[2], 5.0, x[0] / x[1])
    return ca.Function("everything", [p, u, x], [results], ["p", "u", "x"], ["y"])


def test_each_stage_reads_its_arguments_and_stored_values() -> None:
    car, step, rate = staged_body(everything(), STAGES)
    assert set(re.findall(r"\b(\w+)\[", "".join(car.body))) == {"p", "held_car", "at"}
    assert "x[" not in "".join(step.body)
    assert set(re.findall(r"\bheld_\w+", "".join(rate.body))) == {"held_car", "held_step"}
    for stage in (car, step):
        stored = re.findall(rf"held_{stage.name}\[(\d+)\]\.at\[lane\] =", "".join(stage.body))
        assert sorted(map(int, stored)) == list(range(stage.held))
    assert rate.held == 0


def test_stages_that_do_not_name_each_argument_once_and_an_operation_without_a_form_in_c() -> None:
    for stages in ({"car": ["p"], "rate": ["x"]}, {"all": ["p", "u", "x", "x"]}, {"all": ["p", "u", "y"]}):
        with pytest.raises(ValueError, match="do not name each of p, u, x once"):
            staged_body(everything(), stages)
    x = ca.SX.sym("x")
    with pytest.raises(ValueError, match="no C form"):
        staged_body(ca.Function("f", [x], [ca.exp(x)], ["x"], ["y"]), {"all": ["x"]})
