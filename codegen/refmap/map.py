"""The reference map and its file, `.npz`.

`vx` (n,) m/s and `delta_f` (m,) rad, strictly increasing, with `yaw_rate` (n, m) rad/s are a map. The optimisation adds
`beta`, `delta_r` (rad), `feasible`, `active` (what binds) and `meta`, a JSON text with the configuration. Nothing in a file is
trusted: no pickle is read, no size believed, and what breaks the contract is refused with its key, index and remedy.

Layer 3: imports `errors`, `config` and NumPy.
"""

from __future__ import annotations

import enum
import io
import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from codegen import __version__
from codegen.config import Config, check_name, parse
from codegen.errors import CodegenError, ConfigError, MapError
from codegen.files import write_atomically
from codegen.refmap import archive

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
BindingArray = npt.NDArray[np.uint8]
AnyArray = npt.NDArray[Any]

SCHEMA_VERSION = 1
LATERAL_ACCELERATION_MAX_G = 5.0  # far above any tyre: degrees taken for radians ask for more
STANDARD_GRAVITY = 9.81

REQUIRED = ("vx", "delta_f", "yaw_rate")
UNITS = {"vx": "m/s", "delta_f": "rad", "yaw_rate": "rad/s", "beta": "rad", "delta_r": "rad", "feasible": "1", "active": "1"}
KEYS = (*UNITS, "meta")
KINDS = {"b": "boolean", "c": "complex", "U": "text", "S": "text", "V": "record", "M": "date", "m": "duration", "O": "object"}


class Binding(enum.IntFlag):
    """The constraints that bind in a cell: a set, for several may be reached together."""

    NONE = 0
    SIDESLIP = 1
    LATERAL_ACCELERATION = 2
    SLIP_FRONT = 4
    SLIP_REAR = 8
    REAR_ANGLE = 16


ALL_BINDING = sum(Binding)


class _Plausible(NamedTuple):
    low: float
    high: float
    if_low: str
    if_high: str


_IN_DEGREES = "if it is in degrees, multiply by pi/180"
PLAUSIBLE = {
    "vx": _Plausible(0.0, 150.0, "leave reverse out: the map is for forward speeds", "if it is in km/h, divide by 3.6"),
    "delta_f": _Plausible(0.0, 1.2, "leave right turns out: the map is symmetric", _IN_DEGREES),
    "yaw_rate": _Plausible(0.0, 10.0, "turn the sign: both are positive to the left", "if it is in deg/s, multiply by pi/180"),
    "beta": _Plausible(-0.5, 0.5, _IN_DEGREES, _IN_DEGREES),
    "delta_r": _Plausible(-0.5, 0.5, _IN_DEGREES, _IN_DEGREES),
}
"""Values (SI) beyond which no car's map goes, and what is likely wrong where one does."""


@dataclass(frozen=True, eq=False)
class ReferenceMap:
    """Yaw rates for n speeds and m front angles. SI units, ISO 8855 signs; a left turn, for the map is symmetric.

    Attributes:
        speed: (n,) m/s, strictly increasing, zero or above.
        front_angle: (m,) rad at the road wheel, strictly increasing, zero or above.
        yaw_rate: (n, m) rad/s, zero or above; NaN where infeasible and only there (so are `sideslip` and `rear_angle`).
        feasible: (n, m) whether a steady turn inside all constraints exists.
        sideslip: (n, m) rad, file key `beta`; None where the file has none (so are all below).
        rear_angle: (n, m) rad, file key `delta_r`.
        active: (n, m) `Binding` flags.
        config: the configuration that the map was made from.
        case: name of the case in it.
        meta: the parsed JSON of the file; {} where it has none.
    """

    speed: FloatArray
    front_angle: FloatArray
    yaw_rate: FloatArray
    feasible: BoolArray
    sideslip: FloatArray | None = None
    rear_angle: FloatArray | None = None
    active: BindingArray | None = None
    config: Config | None = None
    case: str | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)

    @property
    def solved(self) -> bool:
        """Whether the map came from the optimisation: its configuration, case and binding constraints are known."""
        return self.config is not None and self.case is not None and self.active is not None


def make_meta(config: Config, case: str, method: Literal["exact", "ipopt"]) -> dict[str, Any]:
    """The `meta` of a solved map. No clock, user or host: the same input and versions give the same text."""
    return {
        "schema_version": SCHEMA_VERSION,
        "case": case,
        "method": method,
        "configuration": config.model_dump(mode="json"),
        "units": dict(UNITS),
        "active_bits": {str(binding.name).lower(): int(binding) for binding in Binding},
        "tools": {"codegen": __version__, "numpy": np.__version__},
    }


def load(path: Path) -> ReferenceMap:
    """Read and check a map. Raises MapError with file, key and index for everything that breaks the contract."""
    return from_bytes(archive.read_file(path), path)


def from_bytes(data: bytes, where: object) -> ReferenceMap:
    """The map in the bytes of an `.npz`; `where` is what messages name as the place. Raises MapError."""
    return from_arrays(archive.read_archive(data, where, KEYS, _check_keys), where)


def from_arrays(arrays: Mapping[str, AnyArray], where: object) -> ReferenceMap:
    """Check arrays under the keys of the file and make a map of them; other keys are ignored.

    The arrays are copied. Values of infeasible cells mean nothing and become NaN.

    Raises:
        MapError: the first fault, with its key and index.
    """
    _check_keys(arrays, where)
    speed, front_angle = _axis(arrays, "vx", where), _axis(arrays, "delta_f", where)
    shape = (speed.size, front_angle.size)
    feasible = _feasible(arrays, shape, where)
    yaw_rate = _cells(arrays, "yaw_rate", feasible, where)
    optional = {key: _cells(arrays, key, feasible, where) for key in ("beta", "delta_r") if key in arrays}
    meta = _meta(arrays, where)
    config, case = _configuration(meta, where)
    _check_lateral_acceleration(speed, yaw_rate, STANDARD_GRAVITY if config is None else config.road.gravity_m_s2, where)
    active = _active(arrays, shape, where)
    return ReferenceMap(
        speed, front_angle, yaw_rate, feasible, optional.get("beta"), optional.get("delta_r"), active, config, case, meta
    )


def to_bytes(reference_map: ReferenceMap) -> bytes:
    """The `.npz` of a map, checked as `load` does. Equal maps give equal bytes on every machine: stored, no time stamp.

    Raises:
        MapError: the map breaks the contract, or its `meta` does not hold its configuration and case.
    """
    where = "the map to save"
    checked = from_arrays(_arrays(reference_map), where)
    if (checked.config, checked.case) != (reference_map.config, reference_map.case):
        raise MapError("it is not of this configuration and case", where=f"{where}: meta", remedy="make it with make_meta")
    arrays = _arrays(checked)
    archive.check_size(
        sum(array.nbytes + archive.NPY_HEADER_BYTES for array in arrays.values()), archive.MAX_UNPACKED_BYTES, where
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as packed:
        for key, array in arrays.items():
            entry = zipfile.ZipInfo(f"{key}.npy")  # dated 1980
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            member = io.BytesIO()
            little_endian = array.astype(array.dtype.newbyteorder("<"))
            np.lib.format.write_array(member, little_endian, version=(1, 0), allow_pickle=False)
            packed.writestr(entry, member.getvalue())
    return stream.getvalue()


def save(reference_map: ReferenceMap, path: Path) -> None:
    """Write a map (see `to_bytes`). A failure, whenever it comes, leaves what stood at `path`. Raises MapError."""
    data = to_bytes(reference_map)
    try:
        write_atomically(path, data)
    except CodegenError as error:
        raise MapError(error.what, where=error.where, remedy=error.remedy) from error


def _arrays(reference_map: ReferenceMap) -> dict[str, AnyArray]:
    arrays: dict[str, AnyArray | None] = {
        "vx": reference_map.speed,
        "delta_f": reference_map.front_angle,
        "yaw_rate": reference_map.yaw_rate,
        "beta": reference_map.sideslip,
        "delta_r": reference_map.rear_angle,
        "feasible": reference_map.feasible,
        "active": reference_map.active,
    }
    if reference_map.meta:
        text = json.dumps(dict(reference_map.meta), sort_keys=True, separators=(",", ":"), allow_nan=False)
        arrays["meta"] = np.array(text)
    return {key: array for key, array in arrays.items() if array is not None}


# --- arrays to a map ---------------------------------------------------------------------------------------------------


def _check_keys(keys: Iterable[str], where: object) -> None:
    present = list(keys)
    for key in REQUIRED:
        if key not in present:
            raise MapError(
                "this key is missing",
                where=f"{where}: {key}",
                remedy=f"add it, in {UNITS[key]}; the file holds {', '.join(present) or 'nothing'}",
            )


def _at(where: object, key: str, index: Iterable[np.intp]) -> str:
    return f"{where}: {key}[{', '.join(str(i) for i in index)}]"


def _numbers(arrays: Mapping[str, AnyArray], key: str, shape: tuple[int, ...] | None, where: object) -> FloatArray:
    """A copy in float64 of real numbers (any integer or floating type) of a shape (None: one axis of any length)."""
    array = np.asarray(arrays[key])
    place = f"{where}: {key}"
    if array.dtype.kind not in "iuf":
        kind = KINDS.get(array.dtype.kind, str(array.dtype))
        raise MapError(f"{kind} values, where real numbers are needed", where=place, remedy="save it as plain numbers")
    if shape is None and array.ndim != 1:
        raise MapError(f"shape {array.shape}, where one dimension is needed", where=place, remedy="save it with .ravel()")
    if shape is not None and array.shape != shape:
        transposed = array.shape == shape[::-1]
        remedy = "transpose it" if transposed else "give a row for each vx and a column for each delta_f"
        raise MapError(f"shape {array.shape}, where {shape} is needed (vx by delta_f)", where=place, remedy=remedy)
    with np.errstate(all="ignore"):  # an overflow is found as inf
        return np.array(array, dtype=np.float64, order="C")


def _check_plausible(values: FloatArray, key: str, where: object) -> None:
    limits = PLAUSIBLE[key]
    for index in np.argwhere((values < limits.low) | (values > limits.high))[:1]:
        value = values[tuple(index)]
        raise MapError(
            f"{value:.6g} is outside {limits.low:g} to {limits.high:g} {UNITS[key]}",
            where=_at(where, key, index),
            remedy=limits.if_low if value < limits.low else limits.if_high,
        )


def _axis(arrays: Mapping[str, AnyArray], key: str, where: object) -> FloatArray:
    values = _numbers(arrays, key, None, where)
    if values.size < 2:
        raise MapError(f"{values.size} points", where=f"{where}: {key}", remedy="give at least two")
    for index in np.argwhere(~np.isfinite(values))[:1]:
        raise MapError(f"{values[index[0]]} on an axis", where=_at(where, key, index), remedy="give a finite breakpoint")
    for index in np.argwhere(np.diff(values) <= 0.0)[:1] + 1:
        left, right = values[index[0] - 1], values[index[0]]
        raise MapError(
            f"{right:.9g} is not above the breakpoint before it ({left:.9g})",
            where=_at(where, key, index),
            remedy="sort the axis, with the rows or columns of the tables, and remove doubles",
        )
    _check_plausible(values, key, where)
    values.setflags(write=False)
    return values


def _feasible(arrays: Mapping[str, AnyArray], shape: tuple[int, int], where: object) -> BoolArray:
    if "feasible" not in arrays:
        feasible = np.ones(shape, dtype=np.bool_)
    else:
        array = np.asarray(arrays["feasible"])
        numbers = _numbers({"feasible": array.view(np.uint8) if array.dtype == np.bool_ else array}, "feasible", shape, where)
        for index in np.argwhere((numbers != 0.0) & (numbers != 1.0))[:1]:
            raise MapError(
                f"{numbers[tuple(index)]:g} is neither true nor false",
                where=_at(where, "feasible", index),
                remedy="give booleans, or 0 and 1",
            )
        feasible = numbers == 1.0
    if not feasible.any():
        raise MapError("infeasible everywhere", where=f"{where}: feasible", remedy="loosen the limits or move the grid")
    feasible.setflags(write=False)
    return feasible


def _cells(arrays: Mapping[str, AnyArray], key: str, feasible: BoolArray, where: object) -> FloatArray:
    values = _numbers(arrays, key, feasible.shape, where)
    for index in np.argwhere(feasible & ~np.isfinite(values))[:1]:
        raise MapError(
            f"{values[tuple(index)]} in a feasible cell",
            where=_at(where, key, index),
            remedy="give a number, or mark the cell false in an array 'feasible'",
        )
    values[~feasible] = np.nan
    _check_plausible(values, key, where)
    values.setflags(write=False)
    return values


def _check_lateral_acceleration(speed: FloatArray, yaw_rate: FloatArray, gravity: float, where: object) -> None:
    in_g = speed[:, np.newaxis] * yaw_rate / gravity
    # A map on the bound itself may lie above it by rounding.
    for index in np.argwhere(in_g > LATERAL_ACCELERATION_MAX_G * (1.0 + 1e-9))[:1]:
        i, j = index
        raise MapError(
            f"{yaw_rate[i, j]:.4g} rad/s at vx[{i}] = {speed[i]:.4g} m/s is {in_g[i, j]:.3g} g of lateral acceleration, "
            f"above {LATERAL_ACCELERATION_MAX_G:g} g",
            where=_at(where, "yaw_rate", index),
            remedy="check whether vx is in km/h or yaw_rate in deg/s",
        )


def _active(arrays: Mapping[str, AnyArray], shape: tuple[int, int], where: object) -> BindingArray | None:
    if "active" not in arrays:
        return None
    numbers = _numbers(arrays, "active", shape, where)
    for index in np.argwhere(~np.isin(numbers, np.arange(ALL_BINDING + 1)))[:1]:
        raise MapError(
            f"{numbers[tuple(index)]:g} is no set of binding constraints",
            where=_at(where, "active", index),
            remedy=f"give whole numbers from 0 to {ALL_BINDING}, or leave the key out",
        )
    active = numbers.astype(np.uint8)
    active.setflags(write=False)
    return active


def _meta(arrays: Mapping[str, AnyArray], where: object) -> dict[str, Any]:
    if "meta" not in arrays:
        return {}
    array, place = np.asarray(arrays["meta"]), f"{where}: meta"
    if array.ndim != 0 or array.dtype.kind != "U":
        kind = KINDS.get(array.dtype.kind, "numeric")
        raise MapError(
            f"{kind} of shape {array.shape}, where one JSON text is needed",
            where=place,
            remedy="save it as numpy.array(json.dumps(...)), or leave the key out",
        )
    try:
        # array.item() lets some code points through that no text may hold.
        text = array.astype(array.dtype.newbyteorder("<")).tobytes().decode("utf-32-le").rstrip("\0")
        meta = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise MapError(f"not JSON text: {error}", where=place, remedy="mend it, or leave the key out") from error
    if not isinstance(meta, dict):
        raise MapError("JSON, but no object", where=place, remedy="give {...}, or leave the key out")
    version = meta.get("schema_version")
    if type(version) is not int or version != SCHEMA_VERSION:
        raise MapError(
            f"{version!r} is not a version that this program reads ({SCHEMA_VERSION})",
            where=f"{place}.schema_version",
            remedy="make the map again with this version, or leave the key meta out",
        )
    return meta


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON number")


def _configuration(meta: Mapping[str, Any], where: object) -> tuple[Config | None, str | None]:
    data, case = meta.get("configuration"), meta.get("case")
    place = f"{where}: meta.configuration"
    if data is not None and not isinstance(data, dict):
        raise MapError("no JSON object", where=place, remedy="give the tables of ars.toml, or leave the key out")
    _check_case(case, f"{where}: meta.case")
    try:
        config = None if data is None else parse(data, place)
        if config is not None and case is not None:
            config.case(case, f"{where}: meta.case")
    except ConfigError as error:
        raise MapError(error.what, where=error.where, remedy=error.remedy) from error
    except RecursionError as error:
        raise MapError("nested too deep", where=place, remedy="give the tables of ars.toml, or leave the key out") from error
    return config, case


def _check_case(case: object, place: str) -> None:
    try:
        if case is not None:
            check_name(case if isinstance(case, str) else "")
    except ValueError as error:
        what, _, remedy = str(error).partition("; ")
        raise MapError(what, where=place, remedy=remedy) from error
