"""Calibration objects and measurements of a build: names, C types, units, limits, axes, and the objects in C.

The manifest carries them as data. The A2L is rendered from them, and calibration reads them from the manifest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from codegen.errors import BuildError

Kind = Literal["VALUE", "AXIS", "CURVE", "MAP"]
CType = Literal["bool", "float", "double", "int16_t", "uint8_t", "uint16_t", "uint32_t"]
Numbers = npt.NDArray[Any]
Values = dict[str, Numbers]
"""Physical values by object name, in the precision of the build; see `CalibrationObject.dtype`."""
PARAMETER_GROUPS = ("parameters", "inputs", "limiter")
"""Groups of the objects in the parameter structs."""
MAP_SPEED = "map.speed"
"""Side of a condition: the last breakpoint of the map's speeds."""
_NUMPY: Mapping[str, str] = {"float": "f4", "double": "f8", "int16_t": "i2", "uint16_t": "u2", "uint32_t": "u4"}


class _Entry(BaseModel):
    """An entry of the manifest. Numbers without a fraction stay whole."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


class CalibrationObject(_Entry):
    """A parameter, axis, curve or map of the calibration.

    Attributes:
        name: name in the A2L, DCM and CDF.
        meaning: description.
        group: part of the calibration, such as "limiter".
        kind: VALUE, AXIS, CURVE or MAP.
        type: C type of one number in the ECU.
        scale: physical value of one raw step; None if numbers are stored as they are.
        physical: C type of the physical values of raw numbers; "" if numbers are stored as they are.
        unit: symbol of the unit; "" for none.
        conversion: name of the conversion in the A2L, without the prefix.
        low, high: limits of the physical values in the precision of the build, both inclusive.
        link: the object in C, such as `ars_parameters_default.limiter.speed_max`.
        shape: () for a VALUE, (n,) for an axis or curve, (rows, columns) for a map: one row for each value of the second axis.
        axes: names of the axes: that of the columns first, then that of the rows.
        quantity: measurement that is looked up on an axis.
        address: address in a program; 0 if unknown.
    """

    name: str
    meaning: str
    group: str
    kind: Kind
    type: CType
    scale: float | None = None
    physical: Literal["", "float", "double"] = ""
    unit: str = ""
    conversion: str
    low: int | float
    high: int | float
    link: str
    shape: Annotated[tuple[int, ...], Field(strict=False)] = ()
    axes: Annotated[tuple[str, ...], Field(strict=False)] = ()
    quantity: str = ""
    address: int = 0

    @property
    def stored(self) -> np.dtype[Any]:
        """NumPy type of one number in the ECU."""
        return np.dtype(_NUMPY[self.type])

    @property
    def dtype(self) -> np.dtype[Any]:
        """NumPy type of the physical values."""
        return np.dtype(_NUMPY[self.physical or self.type])

    @property
    def bytes(self) -> int:
        """Size in the ECU."""
        return self.stored.itemsize * int(np.prod(self.shape))

    def physical_values(self, stored: Numbers) -> Numbers:
        """Return the physical values of numbers as the ECU stores them."""
        if self.scale is None:
            return stored.astype(self.dtype)
        values: Numbers = np.multiply(stored.astype(self.dtype), self.dtype.type(self.scale))
        return values

    def raw(self, values: Numbers) -> Numbers:
        """Return physical values as the ECU stores them. Raw numbers are rounded to the nearest step."""
        if self.scale is None:
            return values.astype(self.stored)
        return np.rint(values.astype(np.float64) / float(self.dtype.type(self.scale))).astype(self.stored)


class Measurement(_Entry):
    """A number that the code writes.

    Attributes:
        type: C type; an enum has the type that most targets give it.
        link: the object in C, of a task named `<prefix>_task`.
        others: as in `CalibrationObject`.
    """

    name: str
    meaning: str
    type: CType
    conversion: str
    unit: str = ""
    low: int | float
    high: int | float
    link: str
    address: int = 0


class Condition(_Entry):
    """A condition between two parameters, which `<prefix>_parameters_valid` checks: left, operator, factor times right.

    The sides are paths in `<prefix>_parameters_t`, or `MAP_SPEED`.
    """

    left: str
    operator: Literal["<", "<=", ">="]
    right: str
    factor: float = 1.0

    def __str__(self) -> str:
        factor = "" if self.factor == 1.0 else f"{self.factor:g} times "
        return f"{self.left} {self.operator} {factor}{'the last speed of the map' if self.right == MAP_SPEED else self.right}"


class ManifestObjects(_Entry):
    """The part of a manifest that describes the calibration. Older builds do not have it."""

    model_config = ConfigDict(extra="ignore")

    objects: list[CalibrationObject] = []
    measurements: list[Measurement] = []
    conditions: list[Condition] = []

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values, without entries that have their default."""
        return self.model_dump(mode="json", exclude_defaults=True)


@dataclass(frozen=True)
class Layout:
    """All calibration objects and measurements of a build.

    Attributes:
        prefix: prefix of the build.
        build_id: identity of the build, which its programs contain as EPK.
        objects: calibration object by name, the axes first.
        in_struct_order: the objects in the order of the C structs.
        measurements: in the order of the A2L.
        conditions: between parameters.
        epk_address: address of the EPK in a program; 0 if unknown.
        byte_order: "<" or ">".
    """

    prefix: str
    build_id: str
    objects: Mapping[str, CalibrationObject]
    in_struct_order: tuple[CalibrationObject, ...]
    measurements: tuple[Measurement, ...]
    conditions: tuple[Condition, ...]
    epk_address: int = 0
    byte_order: str = "<"

    @classmethod
    def of(cls, manifest: Mapping[str, Any], build: Path | str = "") -> Self:
        """Return the layout that a manifest describes. Raises BuildError: an older version wrote it, without objects."""
        found = ManifestObjects.model_validate(manifest)
        if not found.objects:
            raise BuildError("its manifest has no objects", where=build, remedy="build again with this version")
        objects = {each.name: each for each in sorted(found.objects, key=lambda each: each.kind != "AXIS")}
        prefix, identity = str(manifest["options"]["prefix"]), str(manifest["build_id"])
        return cls(prefix, identity, objects, tuple(found.objects), tuple(found.measurements), tuple(found.conditions))

    @property
    def checksum(self) -> CalibrationObject:
        """The checksum that the self-test expects."""
        return self.objects[f"{self.prefix}.calibration.expected_checksum"]

    @property
    def map_objects(self) -> list[CalibrationObject]:
        """The maps and their axes."""
        return [each for each in self.objects.values() if each.group == "map"]

    @property
    def tables(self) -> list[CalibrationObject]:
        """The maps."""
        return [each for each in self.objects.values() if each.kind == "MAP"]

    def at(self, addresses: Mapping[str, int], epk_address: int, byte_order: str) -> Layout:
        """Return the layout with the addresses of a program, given for every calibration object by its name."""
        objects = {name: each.model_copy(update={"address": addresses[name]}) for name, each in self.objects.items()}
        return replace(self, objects=objects, epk_address=epk_address, byte_order=byte_order)
