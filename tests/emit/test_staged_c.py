"""A CasADi function in stages and for lanes: right against the CasADi machine, each stage only what changes there."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from codegen.emit.staged_c import Stage, staged_body
from codegen.sil.compile import compile_library

LANES = 4
SIZES = {"p": 3, "u": 2, "x": 2}
STAGES = {"car": ["p"], "step": ["u"], "rate": ["x"]}


def everything() -> Any:
    """Each operation that the plant has, over arguments of all stages."""
    p, u, x = (ca.SX.sym(name, size) for name, size in SIZES.items())
    slow = p[0] * p[1] + 2.0
    per_step = ca.fmax(u[0] / p[0], -slow) * p[2]
    turned = ca.sin(p[1] * ca.atan(x[0] / per_step)) + ca.cos(x[1]) * slow
    least = ca.fmin(x[1] / (u[0] * u[0] + 1.0), 0.3) - (-x[0]) / 3.0
    results = ca.vertcat(x[0] / p[0] + u[1] / slow, turned, least, per_step, slow, p[2], 5.0, x[0] / x[1])
    return ca.Function("everything", [p, u, x], [results], ["p", "u", "x"], ["y"])


def compiled(function: Any, stages: Sequence[Stage]) -> Any:
    """A library with `void at(const double *p, const double *u, const double *x, double *y)`, rows of LANES numbers each."""
    arguments = ", ".join(f"const row_t *{name}" for name in function.name_in())
    results = ", ".join(f"row_t *{name}" for name in function.name_out())
    held = [f"    row_t held_{stage.name}[{max(stage.held, 1)}];" for stage in stages]
    loops = [
        line
        for stage in stages
        for line in ("    for (lane = 0; lane < LANES; lane++) {", *stage.body, "    }", f"    (void)held_{stage.name};")
    ]
    call = f"void at({arguments}, {results})"
    header = [f"enum {{ LANES = {LANES} }};", "typedef struct { double at[LANES]; } row_t;", f"{call};"]
    source = ['#include "at.h"', "#include <math.h>", call, "{", *held, "    int lane;", *loops, "}"]
    sources = {"at.h": "\n".join(header) + "\n", "at.c": "\n".join(source) + "\n"}
    return compile_library("staged", sources, ["at.h"], include_folders=(".",))


def evaluated(library: Any, function: Any, values: Mapping[str, npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Results (rows, LANES) of arguments (rows, LANES)."""
    result = np.empty((function.numel_out(0), LANES))
    ffi = library.ffi
    given = [ffi.from_buffer("row_t[]", np.ascontiguousarray(values[name])) for name in function.name_in()]
    library.lib.at(*given, ffi.from_buffer("row_t[]", result, require_writable=True))
    return result


def machine(function: Any, values: Mapping[str, npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    columns = [function(*(values[name][:, lane] for name in function.name_in())) for lane in range(LANES)]
    return np.hstack([np.array(column) for column in columns])


def test_the_casadi_machine_s_results_in_every_lane() -> None:
    function = everything()
    stages = staged_body(function, STAGES)
    library = compiled(function, stages)
    generator = np.random.default_rng(2)
    for _ in range(5):
        values = {name: generator.uniform(0.2, 3.0, (size, LANES)) for name, size in SIZES.items()}
        # A reciprocal and a product round twice where a division rounds once; a dozen operations follow.
        np.testing.assert_allclose(evaluated(library, function, values), machine(function, values), rtol=2e-15, atol=2e-15)


def test_each_stage_reads_its_arguments_and_what_is_held() -> None:
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
