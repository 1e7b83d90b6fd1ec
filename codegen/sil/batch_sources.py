"""Render the C of the batch: closed loops of many runs around the controller of a build."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from codegen.configuration import Config
from codegen.configuration.signals import CARRIED, RECORDED
from codegen.emit.render import render
from codegen.emit.staged_c import staged_body
from codegen.emit.text import Precision, c_type, literal
from codegen.sil.software import RECORD_COLUMNS
from codegen.sil.vector import FUNCTIONS
from codegen.vehicle.dynamics import ParametricModel, two_track_of_parameters

LANES = 8
"""Runs that are computed together: the doubles of one AVX-512 vector.

Twice as many gain a few percent, but waste more when a batch does not fill its last lanes."""

PLANT_UNIT = "batch/batch_plant.c"
"""The source whose loops become vectors."""

_UNRECORDED = ("position_x", "position_y", "heading")
"""States that no column depends on; omitted unless a signal reads them."""
_SOURCES = {each.source for each in RECORDED}


def batch_sources(config: Config, prefix: str, precision: Precision) -> dict[str, bytes]:
    """Return the C files of the batch for a controller of this prefix and precision.

    The configuration only decides whether the tyres have a relaxation length; the car of each run is data.
    """
    model = two_track_of_parameters(config)
    context = {
        "build": {"prefix": prefix, "PREFIX": prefix.upper()},
        "real": c_type(precision),
        "zero": literal(0.0, precision),
        "carried": CARRIED,
        "recorded": RECORDED,
        "batch": {"lanes": LANES, "columns": RECORD_COLUMNS, "parameters": model.parameters},
        "plant": _plant_view(model),
    }
    names = ("batch.h", "batch.c", "batch_plant.h", "batch_plant.c")
    return {f"batch/{name}": render(f"sil/{name}.j2", context) for name in names}


def _plant_view(model: ParametricModel) -> dict[str, Any]:
    states = [name for name in model.states if name not in _UNRECORDED or f"state.{name}" in _SOURCES]
    motion = [name for name in model.outputs if name != "front_angle"]
    car, held, rates = staged_body(
        _function(model, "derivative", states, states),
        {"car": ["parameter"], "input": ["input"], "state": ["state"]},
    )
    at_once = {"sample": ["parameter", "input", "state"]}
    (front_angle,) = staged_body(_function(model, "front_angle", states, ["front_angle"]), at_once)
    (moving,) = staged_body(_function(model, "motion", states, motion), at_once)
    return {
        "states": states,
        "inputs": model.inputs,
        "motion": motion,
        "functions": FUNCTIONS,
        "held_car": car.held,
        "held_input": held.held,
        "car": car.body,
        "input": held.body,
        "derivative": rates.body,
        "front_angle": front_angle.body,
        "motion_body": moving.body,
    }


def _function(model: ParametricModel, name: str, states: Sequence[str], results: Sequence[str]) -> Any:
    """Return selected derivatives or outputs of a model as a function of selected states; other states are zero."""
    state = ca.SX.sym("state", len(states))
    u = ca.SX.sym("input", len(model.inputs))
    p = ca.SX.sym("parameter", len(model.parameters))
    x = ca.vertcat(*(state[states.index(known)] if known in states else 0.0 for known in model.states))
    names, function = (model.states, model.derivative) if results[0] in states else (model.outputs, model.output)
    values = function(x, u, p)
    result = ca.vertcat(*(values[names.index(wanted)] for wanted in results))
    return ca.Function(name, [state, u, p], [result], ["state", "input", "parameter"], [name])
