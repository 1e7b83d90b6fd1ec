"""Calibration objects of a build, read from its A2L: names, types, units, limits, axes and links.

The A2L is made from the tables of parameters and of the map, and calibration tools use its names. An A2L that `codegen a2l` has
filled for a linked program contains addresses as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from codegen.emit.folder import read_files
from codegen.emit.manifest import read_build
from codegen.errors import BuildError
from codegen.files import read_file, refuse_utf16

A2L_BYTES_MAX = 16 * 2**20

Kind = Literal["VALUE", "AXIS", "CURVE", "MAP"]
Numbers = npt.NDArray[Any]
Values = dict[str, Numbers]
"""Physical values by object name, in the precision of the build; see `CalibrationObject.dtype`."""

_TYPES = {"FLOAT32_IEEE": "f4", "FLOAT64_IEEE": "f8", "UWORD": "u2", "ULONG": "u4", "SWORD": "i2"}
_RECORD = re.compile(r"/begin RECORD_LAYOUT (?P<name>\S+)\s+(?:FNC_VALUES|AXIS_PTS_X) 1 (?P<type>\w+) ")
_CONVERSION = re.compile(
    r'/begin COMPU_METHOD (?P<name>\S+) "[^"]*" \w+ "[^"]*" "(?P<unit>[^"]*)"(?:\s+COEFFS_LINEAR (?P<scale>\S+) 0\s)?'
)
_HEAD = r"/begin {} (?P<name>\S+) \"(?P<text>[^\"]*)\"\s+"
_LINK = r'.*?SYMBOL_LINK "(?P<link>[A-Za-z_][\w.\[\]]*)" 0\b'
_AXIS = re.compile(
    _HEAD.format("AXIS_PTS")
    + r"(?P<address>0x\w+)\s+\S+ (?P<record>\S+) 0 (?P<conversion>\S+) (?P<points>\d+) (?P<low>\S+) (?P<high>\S+)\s"
    + _LINK,
    re.DOTALL,
)
_CHARACTERISTIC = re.compile(
    _HEAD.format("CHARACTERISTIC")
    + r"(?P<kind>VALUE|CURVE|MAP)\s+(?P<address>0x\w+)\s+(?P<record>\S+) 0 (?P<conversion>\S+) (?P<low>\S+) (?P<high>\S+)\s"
    + r"(?P<axes>(?:\s*/begin AXIS_DESCR .*?/end AXIS_DESCR)*)"
    + _LINK,
    re.DOTALL,
)
_AXIS_REFERENCE = re.compile(r"AXIS_PTS_REF (\S+)")
_BLOCK = re.compile(r"/begin (?P<kind>AXIS_PTS|CHARACTERISTIC) .*?/end (?P=kind)\b", re.DOTALL)


@dataclass(frozen=True)
class CalibrationObject:
    """A parameter, axis, curve or map of the calibration.

    Attributes:
        name: name in the A2L, DCM and CDF.
        text: description.
        kind: VALUE, AXIS, CURVE or MAP.
        stored: NumPy type of one number in the ECU.
        scale: physical value of one raw step; None if numbers are stored as they are.
        dtype: NumPy type of the physical values.
        unit: symbol of the unit; "" for none.
        low, high: limits of the physical values, both inclusive.
        link: the object in C, such as `ars_parameters_default.limiter.speed_max`.
        shape: () for a VALUE, (n,) for an axis or curve, (rows, columns) for a map: one row for each value of the second axis.
        axes: names of the axes: that of the columns first, then that of the rows.
        address: address in a program; 0 if unknown.
    """

    name: str
    text: str
    kind: Kind
    stored: np.dtype[Any]
    scale: float | None
    dtype: np.dtype[Any]
    unit: str
    low: float
    high: float
    link: str
    shape: tuple[int, ...]
    axes: tuple[str, ...]
    address: int

    @property
    def bytes(self) -> int:
        """Size in the ECU."""
        return self.stored.itemsize * int(np.prod(self.shape))

    def physical(self, stored: Numbers) -> Numbers:
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


@dataclass(frozen=True)
class Layout:
    """All calibration objects of a build.

    Attributes:
        prefix: prefix of the build.
        build_id: identity of the build, which its programs contain as EPK.
        objects: object by name.
        epk_address: address of the EPK in a program; 0 if unknown.
        byte_order: "<" or ">".
    """

    prefix: str
    build_id: str
    objects: Mapping[str, CalibrationObject]
    epk_address: int
    byte_order: str

    @property
    def checksum(self) -> CalibrationObject:
        """The checksum that the self-test expects."""
        return self.objects[f"{self.prefix}.calibration.expected_checksum"]

    @property
    def map_objects(self) -> list[CalibrationObject]:
        """The maps and their axes."""
        return [each for each in self.objects.values() if each.name.startswith(f"{self.prefix}.map.")]

    @property
    def tables(self) -> list[CalibrationObject]:
        """The maps."""
        return [each for each in self.objects.values() if each.kind == "MAP"]


def layout_of_build(build: Path) -> Layout:
    """Return the calibration objects of a build. Raises BuildError: no build, or its A2L is missing or was changed."""
    manifest = read_build(build)
    prefix = str(manifest["options"]["prefix"])
    path = f"{prefix}.a2l"
    content = read_files(build, manifest, (path,)).get(path)
    if content is None:
        raise BuildError(f"this build has no {path}", where=build, remedy="build again with this version")
    return read_layout(content, prefix, build / path)


def layout_of_a2l(path: Path, build: Layout) -> Layout:
    """Return the objects of an A2L with addresses.

    Raises:
        BuildError: it is not an A2L that `codegen a2l` made of this build.
    """
    remedy = "make it with codegen a2l"
    found = read_layout(read_file(path, A2L_BYTES_MAX, remedy, BuildError), build.prefix, path)
    own = {name: replace(each, address=0) for name, each in found.objects.items()}
    if found.build_id != build.build_id or own != build.objects:
        raise BuildError(f"it is of another build than {build.build_id}", where=path, remedy=remedy)
    if not (found.epk_address and all(each.address for each in found.objects.values())):
        raise BuildError("it has no addresses", where=path, remedy=remedy)
    return found


def read_layout(content: bytes, prefix: str, where: object) -> Layout:
    """Read the text of an A2L. Raises BuildError: it is not an A2L as codegen writes it."""
    refuse_utf16(content, where, BuildError)
    text = content.decode("ascii", "replace")
    try:
        objects = dict(_objects(text))
        epk = re.search(r'ADDR_EPK (0x\w+)\s+EPK "([^"]*)"', text)
        order = re.search(r"BYTE_ORDER (MSB_FIRST|MSB_LAST)", text)
        if epk is None or order is None or f"{prefix}.calibration.expected_checksum" not in objects:
            raise ValueError
        return Layout(prefix, epk[2], objects, int(epk[1], 16), ">" if order[1] == "MSB_FIRST" else "<")
    except (KeyError, ValueError, OverflowError):
        raise BuildError("not an A2L as this version writes it", where=where, remedy="build again with this version") from None


def _objects(text: str) -> Iterator[tuple[str, CalibrationObject]]:
    """Yield name and object, the axes first. Raises KeyError or ValueError."""
    records = {each["name"]: np.dtype(_TYPES[each["type"]]) for each in _RECORD.finditer(text)}
    conversions = {each["name"]: each for each in _CONVERSION.finditer(text)}
    real = next((each for name, each in records.items() if name.endswith("_REAL")), None)
    if real is None:
        raise ValueError("no record layout of real numbers")
    blocks = list(_BLOCK.finditer(text))
    points: dict[str, int] = {}
    for kind, pattern in (("AXIS_PTS", _AXIS), ("CHARACTERISTIC", _CHARACTERISTIC)):
        for block in blocks:
            if block["kind"] != kind:
                continue
            found = pattern.match(block[0])
            if found is None:
                raise ValueError(block[0])
            axes = tuple(_AXIS_REFERENCE.findall(found["axes"])) if kind == "CHARACTERISTIC" else ()
            if kind == "AXIS_PTS":
                points[found["name"]] = int(found["points"])
            stored, conversion = records[found["record"]], conversions[found["conversion"]]
            scale = conversion["scale"]
            yield (
                found["name"],
                CalibrationObject(
                    name=found["name"],
                    text=found["text"],
                    kind="AXIS" if kind == "AXIS_PTS" else found["kind"],  # type: ignore[arg-type]
                    stored=stored,
                    scale=None if scale is None else float(scale),
                    dtype=stored if scale is None else real,
                    unit=conversion["unit"],
                    low=float(found["low"]),
                    high=float(found["high"]),
                    link=found["link"],
                    shape=(points[found["name"]],) if kind == "AXIS_PTS" else tuple(points[axis] for axis in reversed(axes)),
                    axes=axes,
                    address=int(found["address"], 16),
                ),
            )
