"""A tyre curve that is added to the list reaches the configuration, all solvers, the plant and the reference model's table."""

from __future__ import annotations

from tests.additions.copy import Copy

KEY = """    curve: Annotated[Literal["magic-formula", "tanh"], Meaning("shape of the force over the slip angle")] = Field(
        default="magic-formula", exclude_if=lambda name: name == "magic-formula"
    )
"""
CURVE = """

def _tanh_and_slope(tyre: CurveFactors, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    value = np.tanh(x)
    return value, tyre.stiffness_factor * (1.0 - value * value)


TANH = TyreCurve(
    value=lambda _tyre, x, functions: functions.tanh(x),
    value_and_slope=_tanh_and_slope,
    tabulated=lambda _tyre, x: np.tanh(x),
    initial_slope=lambda _tyre: 1.0,
    peak=lambda _tyre: math.inf,
)
"""

CHECK = """
import math
from pathlib import Path

import numpy as np

from codegen.configuration import parse, preset
from codegen.emit.dynamics_view import tabulate
from codegen.importing.toml_edit import whole
from codegen.map_file.map import from_bytes, to_bytes
from codegen.map_file.map import on_road
from codegen.optimum.solve import solve_case
from codegen.vehicle.plant_car import plant_parameters
from codegen.vehicle.dynamics import two_track, two_track_of_parameters
from codegen.vehicle.tyre import AxleTyres

data = preset().model_dump()
assert "curve" not in data["tyre"]["front"]  # existing maps do not change
for axle in ("front", "rear"):
    data["tyre"][axle]["curve"] = "tanh"
data["grid"].update(speed_min_km_h=40.0, speed_max_km_h=90.0, speed_points=3, front_angle_min_deg=1.0, front_angle_max_deg=4.0)
data["grid"]["front_angle_points"] = 4
config = parse(data, "test")
tyre = AxleTyres.from_config(config).front

# The tyre: force, stiffness and the slip bound at which tanh departs from its tangent.
stiffness = config.tyre.front.cornering_stiffness_n_per_rad
peak = config.road.friction * tyre.static_load
assert math.isclose(float(tyre.force(0.03)), peak * math.tanh(stiffness / peak * 0.03), rel_tol=1e-12)
assert math.isclose(tyre.cornering_stiffness, stiffness, rel_tol=1e-12) and tyre.peak_slip == math.inf
bound = stiffness / peak * AxleTyres.from_config(config).front_slip_bound
assert math.isclose(math.tanh(bound) / bound, 0.9, rel_tol=1e-9)

# The solvers: they agree with both models of the turn, and the map keeps the curve.
for tyre_model in ("linear", "magic-formula"):
    data["cases"]["4ws-2"]["tyre_model"] = tyre_model
    config = parse(data, "test")
    own, reference = (solve_case(config, "4ws-2", method) for method in ("exact", "ipopt"))
    assert own.feasible.any() and (own.feasible == reference.feasible).all()
    assert np.nanmax(np.abs(own.yaw_rate - reference.yaw_rate)) < 1e-6
    assert from_bytes(to_bytes(own), "test").config.tyre.front.curve == "tanh"

Path("ars.toml").write_text(whole(config, "test"))

# Another road keeps the curve.
assert on_road(config, 0.5).tyre.front.curve == "tanh"

# The plant: its side force is that of four wheels with this curve, and the car of parameters is the same.
states, inputs = np.zeros(7), np.array([20.0, 0.0, 0.0, config.road.friction, 0.0, 0.0])
states[0] = 0.5
slip = math.atan(0.5 / 20.0)
tyres = AxleTyres.from_config(config)
force = -2.0 * sum(
    config.road.friction * each.static_load * math.tanh(each.stiffness_factor * slip) for each in (tyres.front, tyres.rear)
)
derivative = np.array(two_track(config).derivative(states, inputs)).ravel()
assert math.isclose(derivative[0], force / config.vehicle.mass_kg, rel_tol=1e-12)
open_car = np.array(two_track_of_parameters(config).derivative(states, inputs, plant_parameters(config))).ravel()
assert np.allclose(open_car, derivative, rtol=1e-12, atol=1e-12)

# The table of the reference model in C.
table = tabulate(tyres.front)
places = np.linspace(0.0, 1.0, len(table.values))[1:-1]
assert np.allclose(table.values[1:-1], np.tanh(table.compression * places / (1.0 - places)), atol=1e-12)
assert table.values[-1] == 1.0
"""


def test_a_tyre_curve_is_one_entry_of_the_list(tree: Copy) -> None:
    car = "codegen/configuration/car.py"
    meaning = '    """Name in `vehicle.tyre.CURVES`; with a second curve this becomes a key."""\n'
    old = f'    curve: ClassVar[str] = "magic-formula"\n{meaning}'
    tree.replace(car, old, KEY)
    curves = "codegen/vehicle/tyre.py"
    tree.replace(curves, "\nCURVES = {", CURVE + "\nCURVES = {")
    tree.replace(curves, '"magic-formula": MAGIC_FORMULA}', '"magic-formula": MAGIC_FORMULA, "tanh": TANH}')
    tree.replace("codegen/emit/casadi_c.py", 'ca.OP_ATAN: "atan"}', 'ca.OP_ATAN: "atan", ca.OP_TANH: "tanh"}')
    tree.run("-c", CHECK)
    tree.commands(
        "check ars.toml",
        "solve --config ars.toml --case 4ws-2 -o new.npz",
        "build --map new.npz -o new",
        "sil --build new",
        "report --map new.npz --no-simulation -o report.html",
    )
    assert len(tree.touched) <= 3
