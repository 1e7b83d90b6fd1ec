"""The reference map and its file, `.npz`.

`vx` (n,) m/s and `delta_f` (m,) rad, strictly increasing, with `yaw_rate` (n, m) rad/s are a map. The optimisation adds
`beta`, `delta_r` (rad), `feasible`, `active` (what binds) and `meta`, a JSON text with the configuration. Nothing in a file is
trusted: no pickle is read, sizes are checked first, and a violation of the contract is rejected with key, index and remedy.

That map is for the friction of its configuration, `road.friction`. A stack adds maps of the same car for lower frictions on the
same axes: `friction` (k,) rising by 0.01 or more, all as far below that of the map, and `friction_yaw_rate` (k, n, m) with
`friction_feasible` and, exactly where the map has the table itself, `friction_beta`, `friction_delta_r`, `friction_active`.
Each layer meets the same contract as the map. Older readers still find the first map under the original keys.

A stack over the longitudinal acceleration instead has `longitudinal_acceleration` (k,) in m/s^2, rising by 0.5 or more and
without zero, for which the map itself is, and tables with that prefix. A map has one of the two at most.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import EllipsisType
from typing import Any

import numpy as np

from codegen import __version__, configuration
from codegen.arrays import AnyArray, BoolArray, FloatArray
from codegen.configuration import Config, Controller, Tightening, check_name, parse
from codegen.errors import CodegenError, ConfigError, MapError, parts_of
from codegen.files import write_atomically
from codegen.map_file import archive, tables
from codegen.map_file.bounds import MARKS
from codegen.map_file.longitudinal import under_acceleration
from codegen.map_file.tables import KEYS, TABLE_UNITS, BindingArray
from codegen.units import GRAVITY
from codegen.vehicle.tyre import MagicFormulaTyre, grip_known, static_wheel_loads


def on_road(config: Config, friction: float) -> Config:
    """Return the configuration of the same car for a map with the design friction `friction`.

    The tyre itself must not change with the road: B keeps its value at the friction of `config`, and the peak D is
    proportional to the friction. Therefore the cornering stiffness is proportional to it too, and the slip bound is unchanged.
    Another `road.friction` alone would give a tyre of given cornering stiffness another B; so the tyres are given by B here.
    On the road of `config` the forces are the same.

    Raises:
        ConfigError: the friction (or B) is none that a configuration may have.
    """
    changes: dict[str, Any] = {"road.friction": friction}
    for axle, load in zip(("front", "rear"), static_wheel_loads(config), strict=True):
        tyre = MagicFormulaTyre.from_config(getattr(config.tyre, axle), load, config.road.friction)
        changes[f"tyre.{axle}"] = {"cornering_stiffness_n_per_rad": None, "stiffness_factor_b_per_rad": tyre.stiffness_factor}
    return config.replace(changes, f"on a road of friction {friction:g}")


def changed(config: Config, stack: tables.Stack, value: float) -> Config:
    """Return the configuration of a layer of a stack. Raises ConfigError: see `on_road` and `under_acceleration`."""
    return under_acceleration(config, value) if stack is tables.ACCELERATION_STACK else on_road(config, value)


def own_value(config: Config, stack: tables.Stack | None) -> float:
    """Return the value of a stack's quantity for which the map itself is; without a stack its friction."""
    return 0.0 if stack is tables.ACCELERATION_STACK else config.road.friction


SCHEMA_VERSION = 1

ATTRIBUTES = {
    "yaw_rate": "yaw_rate",
    "beta": "sideslip",
    "delta_r": "rear_angle",
    "feasible": "feasible",
    "active": "active",
}
"""File key of each table -> attribute of `ReferenceMap`."""


@dataclass(frozen=True)
class Layer:
    """One value of a stack's quantity (SI) and its map, on the axes of the map that it belongs to."""

    quantity: tables.Stack
    value: float
    map: ReferenceMap


@dataclass(frozen=True, eq=False)
class ReferenceMap:
    """Yaw rates for n speeds and m front angles, in left turns: right turns mirror them. SI units, ISO 8855 signs.

    Attributes:
        speed: (n,) m/s, strictly increasing, zero or above.
        front_angle: (m,) rad at the road wheel, strictly increasing, zero or above.
        yaw_rate: (n, m) rad/s, zero or above; NaN where infeasible and only there (so are `sideslip` and `rear_angle`).
        feasible: (n, m) whether a steady turn inside all constraints exists.
        sideslip: (n, m) rad, file key `beta`; None where the file has none (so are all below).
        rear_angle: (n, m) rad, file key `delta_r`.
        active: (n, m) `Binding` flags.
        config: the configuration that the map was made from; its `road.friction` is the friction of this map.
        case: name of the case in it.
        meta: the parsed JSON of the file; {} where it has none.
        layers: the stack over one quantity, rising; () where the file has none. A layer's map always has the configuration
            (`changed`), case and meta of this one: replacing those here replaces them there.
        ignored: names of arrays in the file that are no keys of a map; only a table without `meta` may have any.

    Raises:
        ConfigError: the configuration is invalid for a layer of the stack.
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
    layers: tuple[Layer, ...] = ()
    ignored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self._of_this_car(layer) for layer in self.layers))

    def _of_this_car(self, layer: Layer) -> Layer:
        config = None if self.config is None else changed(self.config, layer.quantity, layer.value)
        changes = {} if config is None else {"configuration": config.model_dump(mode="json")}
        own = replace(layer.map, config=config, case=self.case, meta={**self.meta, **changes}, layers=())
        return replace(layer, map=own)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the file."""
        return tuple(f"{key}: not a key of a map; ignored" for key in self.ignored)

    @property
    def lateral_acceleration(self) -> FloatArray:
        """Lateral acceleration (n, m) of the steady turns in m/s^2."""
        return np.asarray(self.speed[:, np.newaxis] * self.yaw_rate)

    @property
    def quantity(self) -> tables.Stack | None:
        """Quantity of the stack; None without layers."""
        return self.layers[0].quantity if self.layers else None

    def with_config(self, config: Config) -> ReferenceMap:
        """Return the map with another configuration; the rest of its `meta` is kept."""
        meta: dict[str, Any] = {"schema_version": SCHEMA_VERSION, **self.meta}
        meta["configuration"] = config.model_dump(mode="json")
        return replace(self, config=config, meta=meta)

    @property
    def solved(self) -> bool:
        """Whether the map came from the optimisation: its configuration, case and binding constraints are known."""
        return self.config is not None and self.case is not None and self.active is not None

    @property
    def tyre_model(self) -> str | None:
        """Tyre model of the optimisation, "linear" or "magic-formula"; None if configuration or case are unknown."""
        return None if self.config is None or self.case is None else self.config.case(self.case).tyre_model


def make_meta(config: Config, case: str, method: str) -> dict[str, Any]:
    """Return the `meta` of a solved map. The same input and versions give the same text."""
    of_case = config.case(case)
    keys = {**vars(config.limits), **vars(of_case)}
    marks = [mark for mark in MARKS if not mark.key or keys[mark.key]]
    return {
        "schema_version": SCHEMA_VERSION,
        "case": case,
        "method": method,
        "configuration": config.model_dump(mode="json"),
        "units": dict(TABLE_UNITS),
        "active_bits": {str(mark.flag.name).lower(): int(mark.flag) for mark in marks},
        "tools": {"codegen": __version__, "numpy": np.__version__},
    }


def load(path: Path) -> ReferenceMap:
    """Read and check a map. Raises MapError with file, key and index for everything that breaks the contract."""
    return from_bytes(archive.read_map_file(path), path)


def from_bytes(data: bytes, where: object) -> ReferenceMap:
    """Read a map from the bytes of an `.npz`; messages name `where` as the place. Raises MapError."""
    arrays, others = archive.read_archive(data, where, KEYS, tables.check_keys)
    return replace(from_arrays(arrays, where), ignored=others)


def from_arrays(arrays: Mapping[str, AnyArray], where: object) -> ReferenceMap:
    """Check arrays under the keys of the file and make a map of them. A table without `meta` may have other keys.

    The arrays are copied. Values of infeasible cells mean nothing and become NaN.

    Raises:
        MapError: the first fault, with its key and index.
    """
    tables.check_keys(arrays, where)
    speed, front_angle = tables.read_axis(arrays, "vx", where), tables.read_axis(arrays, "delta_f", where)
    shape = (speed.size, front_angle.size)
    own = tables.read_tables(arrays, shape, where)
    meta = _meta(arrays, where)
    config, case = _configuration(meta, where)
    gravity = GRAVITY if config is None else config.road.gravity_m_s2
    tables.check_lateral_acceleration(speed, own.yaw_rate, gravity, where)
    base = ReferenceMap(speed, front_angle, **vars(own), config=config, case=case, meta=meta)
    for stack in tables.STACKS:
        values = tables.read_stack_values(arrays, stack, where)
        if not values.size:
            continue
        if stack is tables.ACCELERATION_STACK:
            tables.check_not_zero(values, where)
        elif config is not None:
            tables.check_below_design(values, config.road.friction, where)
        layers = tables.read_tables(arrays, (values.size, *shape), where, stack)
        tables.check_lateral_acceleration(speed, layers.yaw_rate, gravity, where, stack)
        return _with_stack(base, stack, values, layers, where)
    return base


def _with_stack(
    base: ReferenceMap, stack: tables.Stack, values: FloatArray, layers: tables.Tables, where: object
) -> ReferenceMap:
    of_layers = (layers.layer(index) for index in range(values.size))
    maps = [replace(base, **{name: getattr(layer, name) for name in ATTRIBUTES.values()}) for layer in of_layers]
    try:
        return replace(base, layers=tuple(Layer(stack, *pair) for pair in zip(values.tolist(), maps, strict=True)))
    except ConfigError as error:
        raise MapError(error.what, where=f"{where}: {error.where}", remedy=error.remedy) from error


def to_bytes(reference_map: ReferenceMap) -> bytes:
    """Return the `.npz` of a map, checked as `load` does. Equal maps give equal bytes on every machine: stored, no time stamp.

    Raises:
        MapError: the map breaks the contract, or its `meta` does not hold its configuration and case.
    """
    where = "the map to save"
    checked = from_arrays(_arrays(reference_map, where), where)
    if (checked.config, checked.case) != (reference_map.config, reference_map.case):
        raise MapError("it is not of this configuration and case", where=f"{where}: meta", remedy="make it with make_meta")
    arrays = _arrays(checked, where)
    archive.check_size(
        sum(array.nbytes + archive.NPY_HEADER_BYTES for array in arrays.values()), archive.UNPACKED_BYTES_MAX, where
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


def save(reference_map: ReferenceMap, path: Path, *, replaces: bytes | EllipsisType | None = ...) -> None:
    """Write a map (see `to_bytes`). A failure, whenever it comes, leaves what stood at `path`.

    Args:
        replaces: see `write_atomically`.

    Raises:
        MapError: it cannot be written, or another program wrote the file in the meantime.
    """
    data = to_bytes(reference_map)
    try:
        write_atomically(path, data, replaces=replaces)
    except CodegenError as error:
        raise MapError(error.what, where=error.where, remedy=error.remedy) from error


def _arrays(reference_map: ReferenceMap, where: object) -> dict[str, AnyArray]:
    arrays: dict[str, AnyArray | None] = {"vx": reference_map.speed, "delta_f": reference_map.front_angle}
    arrays |= {key: getattr(reference_map, name) for key, name in ATTRIBUTES.items()}
    if reference_map.quantity is not None:
        arrays |= _stacked(reference_map, reference_map.quantity, where)
    if reference_map.meta:
        text = json.dumps(dict(reference_map.meta), sort_keys=True, separators=(",", ":"), allow_nan=False)
        arrays["meta"] = np.array(text)
    return {key: array for key, array in arrays.items() if array is not None}


def _stacked(reference_map: ReferenceMap, stack: tables.Stack, where: object) -> dict[str, AnyArray]:
    """Return the arrays of the stack by key. Raises MapError if a layer does not match the map that it belongs to."""
    shape = (reference_map.speed.size, reference_map.front_angle.size)
    attributes = {key: name for key, name in ATTRIBUTES.items() if getattr(reference_map, name) is not None}
    layers = [layer.map for layer in reference_map.layers]
    for index, own in enumerate(layers):
        of_layer = {key: getattr(own, name) for key, name in ATTRIBUTES.items()}
        if not (
            np.array_equal(own.speed, reference_map.speed)
            and np.array_equal(own.front_angle, reference_map.front_angle)
            and {key: table.shape for key, table in of_layer.items() if table is not None} == dict.fromkeys(attributes, shape)
        ):
            raise MapError(
                "this layer does not have the axes and the tables of the map",
                where=f"{where}: {stack.key}[{index}]",
                remedy="make it with `codegen solve`",
            )
    arrays = {stack.key: np.array([layer.value for layer in reference_map.layers], dtype=np.float64)}
    for key, name in attributes.items():
        arrays[stack.prefix + key] = np.stack([getattr(own, name) for own in layers])
    return arrays


# --- meta ----------------------------------------------------------------------------------------------------------------


def _meta(arrays: Mapping[str, AnyArray], where: object) -> dict[str, Any]:
    if "meta" not in arrays:
        return {}
    array, place = np.asarray(arrays["meta"]), f"{where}: meta"
    if array.ndim != 0 or array.dtype.kind != "U":
        kind = tables.kind_of(array) or "numeric"
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
        what, remedy = parts_of(error)
        raise MapError(what, where=place, remedy=remedy) from error


PRESET_NOTE = "the map brings no configuration: the paper's car and the paper's PI, with a rate limit, are taken"


def older_keys(config: Config) -> tuple[str, ...]:
    """Return a note for each key of older files that keeps its meaning, but has a better successor."""
    lags = config.tuning.actuator_lag_s
    if not lags:
        return ()
    return (
        f"tuning.actuator_lag_s = {min(lags):g} to {max(lags):g} s does not follow rear_actuator.lag_s "
        f"({config.rear_actuator.lag_s:g} s); give tuning.actuator_lag_factor instead, such as [0.4, 1.0, 2.0]",
    )


def _notes_on_design(config: Config) -> tuple[str, ...]:
    """Return those for a controller whose gains are designed."""
    return older_keys(config) if config.controller.kind == "tracking" else ()


@dataclass(frozen=True)
class Chosen:
    """The chosen configuration, its source ("map", "preset", GIVEN or a file name), and notes for the user."""

    config: Config
    source: str
    notes: tuple[str, ...] = ()


GIVEN = "given"
"""Source of a configuration that is no file."""


def choose_config(reference_map: ReferenceMap | None, given: Path | Config | None) -> Chosen:
    """Return the given configuration or that of a file, else the map's own, else the paper's preset. Raises ConfigError.

    One without `[tightening]` gets that of the map.
    """
    own = reference_map.config if reference_map is not None else None
    cases = None if reference_map is None else [reference_map.case]
    ignored = () if reference_map is None else reference_map.notes
    if given is not None:
        config, source = (given, GIVEN) if isinstance(given, Config) else (configuration.load(given), given.name)
        notes = (*ignored, *_notes_on_design(config))
        if own is not None and (own.vehicle, own.tyre, own.road) != (config.vehicle, config.tyre, config.road):
            name = "the given configuration" if isinstance(given, Config) else source
            notes += (f"{name} describes another car than the map was solved for; the map is taken as it is",)
        if own is not None and own.tightening != config.tightening == Tightening():
            config = config.model_copy(update={"tightening": own.tightening})  # it belongs to the map
        return Chosen(config, source, (*notes, *grip_notes(own or config, cases)))
    if own is not None:
        return Chosen(own, "map", (*_notes_on_design(own), *grip_notes(own, cases)))
    paper = configuration.preset()
    if reference_map is None:
        return Chosen(paper, "preset")
    # The paper's controller belongs to the paper's maps; another table gets the one with its rate limit on.
    return Chosen(paper.model_copy(update={"controller": Controller(kind="pi")}), "preset", (*ignored, PRESET_NOTE))


def grip_notes(config: Config, cases: Iterable[str | None] | None = None) -> Iterator[str]:
    """Yield notes on the grip that maps leave unused, what drives did not reach, and how little their keys vary.

    Args:
        cases: those that are of interest, by default all.
    """
    if floor_note := config.identified.floor_note:
        yield floor_note
    chosen = config.cases if cases is None else list(cases)
    reached = [(axle, share) for axle, share in zip(("front", "rear"), grip_known(config), strict=True) if share < 1.0]
    if config.limits.grip_use_max is None:
        for axle, share in reached:
            yield f"{axle} axle: the drives reached {100.0 * share:.0f} % of its grip; maps end there at the latest"
    nonlinear = [name for name, case in config.cases.items() if name in chosen and case.tyre_model != "linear"]
    if not nonlinear:
        return
    if config.limits.grip_use_max is None:
        yield (
            f"without limits.grip_use_max, a map of the nonlinear tyre ({', '.join(nonlinear)}) keeps to its linear range; "
            "set the key, such as 0.98, to use its grip"
        )
        return
    for axle, share in reached:
        yield f"{axle} axle: the drives reached {100.0 * share:.0f} % of its grip; grip_use_max refers to that"
