"""The NumPy reference of the lookup for the map in the C of a build.

The breakpoints come from the manifest; the numbers of the tables and the constants come from the compiled C, because any table
may be there. The vehicle of a capped yaw rate is the manifest's if the map was solved for it. The results that the generated
lookup must have are those of `codegen.ecu_map.lookup`, which does not know the C.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.ecu_map.lookup import AxisConstants, GripConstants, Lookup, SteeringConstants
from codegen.ecu_map.storage import Axis
from codegen.ecu_map.total import CapSteering
from codegen.emit.laws import LAWS
from codegen.errors import BuildError
from codegen.map_file.map import changed, own_value
from codegen.map_file.tables import ACCELERATION_STACK, FRICTION_STACK
from codegen.sil.software import Software
from codegen.verify.outcomes import Subject

_STEERING = (
    *("wheelbase", "understeer_coefficient", "rear_arm", "rear_slip_per_lateral_acceleration"),
    *("sideslip_max", "rear_angle_max"),
)
"""Constants of the linear car, in the order of `SteeringConstants`."""
_OF_THE_TYRES = ("understeer_coefficient", "rear_slip_per_lateral_acceleration")


def lookup_of(subject: Subject, software: Software) -> Lookup:
    """Return the reference of a build and its compiled C, in its precision.

    Raises:
        BuildError: the C has no such table or constant, or one of another size.
    """
    facts, kind, real = subject.manifest["map"], LAWS[subject.kind], software.real
    moving = facts.get("longitudinal_accelerations")
    stack, values = (ACCELERATION_STACK, moving) if moving else (FRICTION_STACK, facts["frictions"])
    count = len(values)
    speed_axis, front_axis, shape = _axes(facts, software)
    yaw_rate = _table(software, "yaw_rate", (count, *shape))
    rear_angle = _table(software, "rear_angle", (count, *shape)) if kind.uses_rear_angle else yaw_rate
    own = own_value(subject.config, stack)
    configs = (subject.config if value == own else changed(subject.config, stack, value) for value in values)
    cars = [CapSteering.from_config(config) for config in configs]
    grip, per_friction = None, "lateral_acceleration_cap_per_friction"
    if "grip" in facts:
        grip_speed, grip_front, shape = _axes(facts["grip"], software)
        grip = GripConstants(grip_speed, grip_front, _table(software, "grip_share", (count, *shape)))
        slips = facts["grip"]["rear_slip_per_lateral_acceleration_rad_s2_m"]
        cars = [replace(car, rear_slip_per_lateral_acceleration=slip) for car, slip in zip(cars, slips, strict=True)]
    steering = tuple(SteeringConstants.of(car, real) for car in cars)
    if kind.uses_rear_angle and subject.manifest["inputs"]["configuration"]["source"] not in ("map", "preset"):
        columns = [_constant(software, name, count if name in _OF_THE_TYRES else 1) for name in _STEERING]
        steering = tuple(SteeringConstants(*numbers) for numbers in zip(*np.broadcast_arrays(*columns), strict=True))
    return Lookup(
        speed_axis=speed_axis,
        front_axis=front_axis,
        tables=yaw_rate,
        rear_tables=rear_angle,
        frictions=np.array(facts["frictions"], dtype=real),
        caps=_constant(software, "lateral_acceleration_cap", count),
        lateral_acceleration_cap_per_friction=None if moving else _constant(software, per_friction)[0],
        cars=steering,
        real=real,
        grip=grip,
        **(_moving(software, moving, with_shares=kind.uses_reference_model) if moving else {}),
    )


def _moving(software: Software, values: list[float], *, with_shares: bool) -> dict[str, npt.NDArray[Any]]:
    """Return the numbers of a stack over longitudinal acceleration."""
    found = {"accelerations": np.array(values, dtype=software.real)}
    if with_shares:
        shares = [_constant(software, f"{axle}_share", len(values)) for axle in ("front", "rear")]
        found["axle_shares"] = np.stack(shares, axis=1)
    return found


def _axes(facts: Mapping[str, Any], software: Software) -> tuple[AxisConstants, AxisConstants, tuple[int, int]]:
    """Return the axes of a table, and their sizes."""
    speed, front = (Axis.from_breakpoints(np.array(facts[key], dtype=np.float64)) for key in ("speed_m_s", "front_angle_rad"))
    return AxisConstants(speed, software.real), AxisConstants(front, software.real), (speed.size, front.size)


def _constant(software: Software, name: str, count: int = 1) -> npt.NDArray[Any]:
    """Return (count,) numbers of a member of the struct of constants; of several, the member's name is a plural."""
    value = _member(_symbol(software, "constants"), f"{name}s" if count > 1 else name)
    return np.array(list(value) if count > 1 else [value], dtype=software.real)


def _table(software: Software, quantity: str, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """Return the values of a table of the map."""
    ffi, real, name = software.ffi, software.real, f"map_{quantity}_table"
    table, scale = _symbol(software, name), getattr(_symbol(software, "constants"), f"{quantity}_scale", None)
    kind = np.dtype(real if scale is None else np.int16)
    numbers = np.frombuffer(ffi.buffer(ffi.addressof(table)), dtype=kind)
    if numbers.size != np.prod(shape):
        raise BuildError(f"{numbers.size} numbers, where {np.prod(shape)} are expected", where=name)
    values: npt.NDArray[Any] = numbers.reshape(shape).astype(real)
    return values if scale is None else np.multiply(values, real(scale))


def _symbol(software: Software, name: str) -> Any:
    return _member(software.compiled.lib, f"{software.prefix}_{name}")


def _member(owner: Any, name: str) -> Any:
    try:
        return getattr(owner, name)
    except AttributeError:
        raise BuildError("the C has no such number", where=name, remedy="build again") from None
