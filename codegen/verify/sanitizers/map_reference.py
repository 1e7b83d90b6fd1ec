"""The NumPy reference of the lookup for the map that stands in the C of a build.

The breakpoints come from the manifest, the numbers of the tables from the C text: any table may stand there. What the generated
lookup makes of them is computed by `codegen.refmap.lookup`, which knows nothing of the C.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import astuple
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.emit.laws import LAWS
from codegen.emit.text import numpy_type
from codegen.errors import BuildError
from codegen.refmap.axis import Axis
from codegen.refmap.lookup import AxisConstants, Lookup, Real, SteeringConstants, cap_in_precision
from codegen.refmap.total import CapSteering
from codegen.verify.check import Subject

Numbers = npt.NDArray[Any]

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_CONSTANT = re.compile(r"\bconst (?:float|double)\s+\w+\s*(?:\[[^\];{}]*\]\s*)*=\s*(?P<value>\{[^;]*\}|[-+\d.][^;]*);")
_NUMBER = re.compile(r"(?<!\w)[-+]?\d[\d.]*(?:e[-+]?\d+)?", re.IGNORECASE)


def lookup_of(subject: Subject) -> Lookup:
    """The reference of a build, in its precision. The car whose steering goes with a capped yaw rate is the manifest's.

    Raises:
        BuildError: the source of the map holds no such tables.
    """
    facts, real = subject.manifest["map"], numpy_type(subject.manifest["options"]["precision"])
    axes = [Axis.from_breakpoints(np.array(facts[key], dtype=np.float64)) for key in ("speed_m_s", "front_angle_rad")]
    frictions = np.array(facts["frictions"], dtype=real)
    shape = (frictions.size, axes[0].size, axes[1].size)
    constants = _constants(subject, real)
    tables = [array.reshape(shape) for array in constants if array.size == np.prod(shape)]
    wanted = 2 if LAWS[subject.kind].uses_rear_angle else 1
    if len(tables) != wanted:
        size = " x ".join(str(number) for number in shape)
        raise BuildError(f"{len(tables)} tables of {size} numbers, where {wanted} are expected", where=_path(subject))
    caps = np.array([cap_in_precision(facts["lateral_acceleration_cap_m_s2"], real)])
    if frictions.size > 1:  # of the lower ones the manifest has none: in the C it is the array that ends like this
        caps = _the(constants, lambda array: array.size == frictions.size and array[-1] == caps[-1], "the caps", subject)
    per_friction = cap_in_precision(facts["lateral_acceleration_cap_m_s2"] / facts["frictions"][0], real)
    if frictions.size > 1:
        near = caps[0] / frictions[0]
        per_friction = _the(constants, lambda array: array.size == 1 and _is_near(array[0], near), f"a cap of {near}", subject)[
            0
        ]
    config = subject.config
    return Lookup(
        speed_axis=AxisConstants(axes[0], real),
        front_axis=AxisConstants(axes[1], real),
        tables=tables[0],
        rear_tables=tables[-1],
        frictions=frictions,
        caps=caps,
        lateral_acceleration_cap_per_friction=per_friction,
        steering=SteeringConstants(*(real(value) for value in astuple(CapSteering.from_config(config)))),
        real=real,
    )


def _path(subject: Subject) -> str:
    return f"src/{subject.prefix}_map.c"


def _constants(subject: Subject, real: Real) -> list[Numbers]:
    """The constants of the source in their order, arrays flat."""
    text = _COMMENT.sub("", subject.files[_path(subject)].decode("ascii", errors="replace"))
    return [np.array(_NUMBER.findall(match["value"]), dtype=real) for match in _CONSTANT.finditer(text)]


def _is_near(value: float, other: float) -> bool:
    return abs(value - other) <= 4.0 * float(np.finfo(np.float32).eps) * abs(other)


def _the(constants: list[Numbers], wanted: Callable[[Numbers], bool], what: str, subject: Subject) -> Numbers:
    found = [array for array in constants if wanted(array)]
    if not found:
        raise BuildError(f"{what} cannot be found", where=_path(subject))
    return found[0]
