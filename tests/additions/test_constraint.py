"""A bound of the optimisation that is added to the list reaches all solvers, the map file, the report and the explorer."""

from __future__ import annotations

from tests.additions.copy import Copy

KEY = """    front_sideslip_max_deg: Annotated[
        float | None, Range(0.1, 20.0, "deg"), Meaning("bound on the sideslip of the front axle")
    ] = Field(default=None, exclude_if=lambda limit: limit is None)
"""
PROPERTY = """
    @property
    def front_sideslip_max(self) -> float:
        \"\"\"Largest sideslip angle at the front axle in rad, infinite where it is not bounded.\"\"\"
        return math.inf if self.front_sideslip_max_deg is None else math.radians(self.front_sideslip_max_deg)
"""
BOUND = """    Bound(
        Binding.FRONT_SIDESLIP,
        "front sideslip",
        "#661100",
        "rad",
        "front_sideslip_max",
        lambda turn: turn.front_angle + turn.slip_front,
    ),
"""

CHECK = """
from pathlib import Path

import numpy as np

from codegen.configuration import parse, preset
from codegen.explore.explorer import map_data
from codegen.importing.toml_edit import whole
from codegen.map_file.bounds import MARKS, Binding, binding_text
from codegen.map_file.map import from_bytes, to_bytes
from codegen.optimum.solve import solve_case
from codegen.figures.draw import draw
from codegen.figures.maps import NamedMap, _binding, map_picture

data = preset().model_dump()
data["limits"]["front_sideslip_max_deg"] = 1.0
data["grid"].update(speed_min_km_h=40.0, speed_max_km_h=90.0, speed_points=3, front_angle_min_deg=1.0, front_angle_max_deg=4.0)
data["grid"]["front_angle_points"] = 4
flag = Binding.FRONT_SIDESLIP
for tyre_model in ("linear", "magic-formula"):
    data["cases"]["4ws-2"]["tyre_model"] = tyre_model
    config = parse(data, "test")
    own, reference = (solve_case(config, "4ws-2", method) for method in ("exact", "ipopt"))
    assert (own.feasible == reference.feasible).all()
    assert np.nanmax(np.abs(own.yaw_rate - reference.yaw_rate)) < 1e-6
    assert (own.active & flag).any() and ((own.active & flag) == (reference.active & flag)).all()
    # Kept by every turn, from the kinematics at the axle, and met where it binds.
    front = np.arctan(
        np.tan(own.sideslip) + config.vehicle.cg_to_front_axle_m * own.yaw_rate / own.speed[:, np.newaxis]
    )
    limit = config.limits.front_sideslip_max
    tolerance = 1e-3 * limit  # small angles of the linear car
    assert np.nanmax(np.abs(front)) <= limit + tolerance
    bound = (own.active & flag) != 0
    assert np.abs(np.abs(front[bound]) - limit).max() <= tolerance

Path("ars.toml").write_text(whole(config, "test"))
found = from_bytes(to_bytes(own), "test")
assert found.meta["active_bits"]["front_sideslip"] == int(flag) and (found.active == own.active).all()
alone = own.active == flag
assert alone.any() and binding_text(int(flag)) == "front sideslip"
assert sorted(mark.flag for mark in MARKS) == sorted(flag for flag in Binding)
legend = [text.get_text() for text in draw(map_picture(own, "test")).legends[0].get_texts()]
assert any("front sideslip" in text for text in legend)
chart = _binding(NamedMap("test", own), own.active)
assert "front sideslip" in chart.spoken and "#661100" in str(chart.figure)
known = []
shown = map_data(own, known)
assert shown["binding_colours"][known.index(int(flag))] == "#661100"
assert shown["binding_names"][known.index(int(flag))] == "front sideslip"
"""


def test_a_constraint_is_one_entry_of_the_list(tree: Copy) -> None:
    limits = "codegen/configuration/car.py"
    tree.after(limits, 'from its tangent at zero; bounds the slip angles"),\n    ] = 10.0\n', KEY)
    tree.after(limits, "        return math.radians(self.rear_angle_max_deg)\n", PROPERTY)
    bounds = "codegen/map_file/bounds.py"
    tree.after(bounds, "    FLOOR = 128\n", "    FRONT_SIDESLIP = 256\n")
    tree.replace(bounds, ')\n"""All bounds, by rising flag."""', BOUND + ')\n"""All bounds, by rising flag."""')
    problem = "codegen/optimum/problem.py"
    tree.after(problem, "    sideslip_weight: float\n", "    front_sideslip_max: float = math.inf\n")
    weight = "            sideslip_weight=case.sideslip_weight_per_s2,\n"
    tree.after(problem, weight, "            front_sideslip_max=config.limits.front_sideslip_max,\n")
    tree.run("-c", CHECK)
    printed = tree.commands(
        "solve --config ars.toml --case 4ws-2 -o new.npz",
        "show new.npz --plot new.png",
        "check new.npz",
        "build --map new.npz -o new",
        "report --map new.npz --no-simulation -o report.html",
    )
    assert "front sideslip" in printed
    assert len(tree.touched) <= 3
