"""The NumPy reference of the lookup for the map that stands in the C of a build.

The breakpoints come from the manifest, the numbers of the tables and the caps from the C text: any table may stand there. So
does the car whose steering goes with a capped yaw rate, where it is not the manifest's. What the generated lookup makes of them
is computed by `codegen.ecu_map.lookup`, which knows nothing of the C.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from codegen.ecu_map.axis import Axis
from codegen.ecu_map.lookup import AxisConstants, GripConstants, Lookup, Real, SteeringConstants
from codegen.ecu_map.total import CapSteering
from codegen.emit.laws import LAWS
from codegen.emit.text import numpy_type
from codegen.errors import BuildError
from codegen.optimum.stack import roads
from codegen.verify.check import Subject

Numbers = npt.NDArray[Any]

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_CONSTANT = re.compile(
    r"\bconst (?:float|double|int16_t)\s+(?P<name>\w+)\s*(?:\[[^\];{}]*\]\s*)*=\s*(?P<value>\{[^;]*\}|[-+\d.][^;]*);"
)
_STEERING = (
    *("wheelbase", "understeer_coefficient", "rear_arm", "rear_slip_per_lateral_acceleration"),
    *("sideslip_max", "rear_angle_max"),
)
"""Constants of the linear car, in the order of `SteeringConstants`."""
_OF_THE_TYRES = ("understeer_coefficient", "rear_slip_per_lateral_acceleration")
_NUMBER = re.compile(r"(?<!\w)[-+]?\d[\d.]*(?:e[-+]?\d+)?", re.IGNORECASE)


def lookup_of(subject: Subject) -> Lookup:
    """Return the reference of a build, in its precision.

    Raises:
        BuildError: the sources hold no such tables, caps or car.
    """
    facts, real = subject.manifest["map"], numpy_type(subject.manifest["options"]["precision"])
    axes = [Axis.from_breakpoints(np.array(facts[key], dtype=np.float64)) for key in ("speed_m_s", "front_angle_rad")]
    frictions = np.array(facts["frictions"], dtype=real)
    shape = (frictions.size, axes[0].size, axes[1].size)
    calibration, bounds = (_Constants.read(subject, name, real) for name in ("calibration", "map"))
    uses_rear_angle = LAWS[subject.kind].uses_rear_angle
    tables = []
    for quantity in ("yaw_rate", *(["rear_angle"] if uses_rear_angle else [])):
        table = calibration.of(f"{subject.prefix}_map_{quantity}_table", shape)
        # Of raw numbers, each a number of its own in either precision.
        tables.append(table * bounds.of(f"{quantity}_scale", (1,))[0] if "storage" in facts else table)
    caps = "lateral_acceleration_caps" if frictions.size > 1 else "lateral_acceleration_cap"
    grip = None
    if "grip" in facts:
        own = [
            Axis.from_breakpoints(np.array(facts["grip"][key], dtype=np.float64)) for key in ("speed_m_s", "front_angle_rad")
        ]
        shares = bounds.of("grip_share_table", (frictions.size, own[0].size, own[1].size))
        scale = bounds.of("grip_share_scale", (1,))[0] if "storage" in facts else real(1.0)
        grip = GripConstants(AxisConstants(own[0], real), AxisConstants(own[1], real), shares * scale)
    cars = [CapSteering.from_config(config) for config in roads(subject.config, facts["frictions"])]
    if "grip" in facts:
        slips = facts["grip"]["rear_slip_per_lateral_acceleration_rad_s2_m"]
        cars = [replace(car, rear_slip_per_lateral_acceleration=slip) for car, slip in zip(cars, slips, strict=True)]
    steering = [SteeringConstants.of(car, real) for car in cars]
    is_own_car = subject.manifest["inputs"]["configuration"]["source"] in ("map", "preset")
    if uses_rear_angle and not is_own_car and subject.is_of_this_version:
        steering = _cars_of(bounds, len(cars))
    return Lookup(
        speed_axis=AxisConstants(axes[0], real),
        front_axis=AxisConstants(axes[1], real),
        tables=tables[0],
        rear_tables=tables[-1],
        frictions=frictions,
        caps=bounds.of(caps, frictions.shape),
        lateral_acceleration_cap_per_friction=bounds.of("lateral_acceleration_cap_per_friction", (1,))[0],
        cars=tuple(steering),
        real=real,
        grip=grip,
    )


def _cars_of(bounds: _Constants, count: int) -> list[SteeringConstants]:
    """Those of the C: what the tyres decide has a number for each friction."""
    columns = [
        bounds.of(name + "s", (count,)) if count > 1 and name in _OF_THE_TYRES else np.repeat(bounds.of(name, (1,)), count)
        for name in _STEERING
    ]
    return [SteeringConstants(*numbers) for numbers in zip(*columns, strict=True)]


@dataclass(frozen=True)
class _Constants:
    """Return the constants of a source by name; arrays are flat."""

    path: str
    found: Mapping[str, Numbers]

    @classmethod
    def read(cls, subject: Subject, unit: str, real: Real) -> Self:
        path = f"src/{subject.prefix}_{unit}.c"
        text = _COMMENT.sub("", subject.files[path].decode("ascii", errors="replace"))
        numbers = {match["name"]: np.array(_NUMBER.findall(match["value"]), dtype=real) for match in _CONSTANT.finditer(text)}
        return cls(path, numbers)

    def of(self, name: str, shape: tuple[int, ...]) -> Numbers:
        """Raises BuildError: it is not there, or of another size."""
        size = " x ".join(str(number) for number in shape)
        if name not in self.found:
            raise BuildError(f"no {name} of {size} numbers", where=self.path)
        if self.found[name].size != np.prod(shape):
            raise BuildError(f"{name} has {self.found[name].size} numbers, where {size} are expected", where=self.path)
        return self.found[name].reshape(shape)
