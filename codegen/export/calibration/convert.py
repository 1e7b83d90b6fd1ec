"""A calibration set as `ars.toml`, and its map as `.npz`."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import CONFIG_BYTES_MAX, Config, parse
from codegen.ecu_map.total import Rule
from codegen.emit.controller_view import parameters_by_path
from codegen.emit.laws import is_untuned
from codegen.emit.objects import PARAMETER_GROUPS, Numbers, Values
from codegen.emit.parameters import Parameter
from codegen.errors import ConfigError, MapError
from codegen.export.calibration.build import BuildCalibration
from codegen.files import read_text
from codegen.importing.toml_edit import replace_values, whole
from codegen.map_file import map as npz
from codegen.map_file.map import SCHEMA_VERSION, ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK, FRICTION_STACK

AUTHOR = "codegen calibrate"
REMARK = f"{AUTHOR} wrote into this table."
DIGITS_MAX = 17
"""Digits that identify a double."""
SCHEDULE = "controller.tracking.schedule"
MARGINS = ("gain_margin_db", "phase_margin_deg", "sensitivity")
"""Keys of the schedule that describe other gains than those of the set."""


# --- parameters ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WrittenConfig:
    """Result of `toml_of`: the text, and the keys that differ from the base."""

    text: str
    changed: tuple[str, ...]


def toml_of(values: Values, build: BuildCalibration, config_path: Path | None) -> WrittenConfig:
    """Return the text of an `ars.toml` whose build has the parameters of a set, to the bit.

    Args:
        config_path: file whose text is kept and whose keys are replaced; None for the configuration of the build. A file
            without a gain schedule gets that of the set.

    Raises:
        CodegenError: a value has no key of its own, or is outside the range of its key; or the file cannot be edited.
    """
    if config_path is None:
        text, base = None, build.config
    else:
        text = read_text(config_path, CONFIG_BYTES_MAX, "give an ars.toml", ConfigError).replace("\r\n", "\n")
        try:
            base = parse(tomllib.loads(text), config_path)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise ConfigError(f"not TOML ({error})", where=config_path, remedy="give an ars.toml") from None
    gains = build.config.controller.tracking.schedule
    if is_untuned(base) and gains is not None:  # codegen tune writes the gains into a map, not into the user's file
        added = {f"{SCHEDULE}.{name}": value for name, value in gains.model_dump(mode="json", exclude_none=True).items()}
        base = base.unchecked({SCHEDULE: gains})
    else:
        added = {}
    chosen = added | _chosen_keys(values, base, build)
    config = base.replace(chosen, "the configuration of this set")
    _require_equal(values, config, build)
    if text is None:
        return WrittenConfig(whole(config, AUTHOR), tuple(chosen))
    tables: dict[str, dict[str, Any]] = {}
    for key, value in chosen.items():
        table, _, name = key.rpartition(".")
        tables.setdefault(table, {})[name] = value
    for table, entries in sorted(tables.items()):  # a table before those inside it
        given = {name: value for name, value in entries.items() if value is not None}
        removed = dict.fromkeys((name for name, value in entries.items() if value is None), next(iter(given)))
        text = replace_values(text, table, given, removed, REMARK)
    if parse(tomllib.loads(text), config_path) != config:
        raise ConfigError("cannot be edited key by key", where=config_path, remedy="leave `config=` out, for a new file")
    return WrittenConfig(text, tuple(chosen))


def _parameters(config: Config, prefix: str) -> dict[str, Parameter]:
    """Return the parameters of a configuration by the names of their objects."""
    found = parameters_by_path(config).items()
    return {f"{prefix}.{path if '.' in path else f'parameters.{path}'}": each for path, each in found}


def _chosen_keys(values: Values, base: Config, build: BuildCalibration) -> dict[str, Any]:
    """Return new values of the keys whose parameters differ from those of a configuration, with as few digits as possible.

    Arrays over the same breakpoints are written together.
    """
    own = _parameters(base, build.layout.prefix)
    if missing := own.keys() ^ {name for name, each in build.layout.objects.items() if each.group in PARAMETER_GROUPS}:
        raise ConfigError(
            f"the configuration is of another kind of controller: {min(missing)} is only in one of both",
            remedy="give the ars.toml of this build",
        )
    changed = {name: each for name, each in own.items() if each.key and not _is_equal(each.value, values[name])}
    together = {each.points for each in changed.values() if each.points}
    changed |= {name: each for name, each in own.items() if each.points in together}
    exact = {name: [each.to_key(value) for value in values[name].reshape(-1).tolist()] for name, each in changed.items()}
    found: dict[str, list[Any]] = {name: [None] * len(keys) for name, keys in exact.items()}
    for digits in range(1, DIGITS_MAX + 1):
        tried = {
            name: [_rounded(key, digits) if kept is None else kept for key, kept in zip(keys, found[name], strict=True)]
            for name, keys in exact.items()
        }
        results = _parameters(base.unchecked(_by_key(tried, own)), build.layout.prefix)
        for name, keys in tried.items():
            fits = _fits(results[name].value, values[name])
            found[name] = [
                key if fit or kept is not None else None for key, fit, kept in zip(keys, fits, found[name], strict=True)
            ]
    complete = {name: [e if kept is None else kept for e, kept in zip(exact[name], found[name], strict=True)] for name in exact}
    chosen = _by_key(complete, own)
    schedule = base.controller.tracking.schedule
    if schedule is not None and any(key.startswith(f"{SCHEDULE}.") for key in chosen):
        given = [name for name in MARGINS if getattr(schedule, name) is not None]
        chosen |= {f"{SCHEDULE}.{name}": None for name in given}
    return chosen


def _by_key(numbers: Mapping[str, list[Any]], own: Mapping[str, Parameter]) -> dict[str, Any]:
    return {own[name].key: keys if own[name].points else keys[0] for name, keys in numbers.items()}


def _rounded(key: float | str, digits: int) -> float | str:
    return float(f"{key:.{digits}g}") if isinstance(key, float) else key


def _fits(value: Any, wanted: Numbers) -> list[bool]:
    """Return for each number whether it is the wanted one in the precision of the build."""
    numbers = np.atleast_1d(np.asarray(value, dtype=np.float64)).astype(wanted.dtype)
    return [bool(fit) for fit in numbers == wanted.reshape(-1)] if numbers.size == wanted.size else [False] * wanted.size


def _is_equal(value: Any, wanted: Numbers) -> bool:
    return np.size(value) == wanted.size and all(_fits(value, wanted))


def _require_equal(values: Values, config: Config, build: BuildCalibration) -> None:
    """Raise ConfigError for a parameter of the set that the configuration does not give."""
    for name, each in _parameters(config, build.layout.prefix).items():
        if not _is_equal(each.value, values[name]):
            given = f"{each.value:.9g}" if isinstance(each.value, float | int) else "others"
            wanted = f"{float(values[name]):.9g}" if values[name].ndim == 0 else "its values"
            raise ConfigError(
                f"{wanted} cannot be set by a key of ars.toml of its own, which gives {given}",
                where=name,
                remedy="keep the set as .dcm or .cdfx, or change the car in ars.toml",
            )


# --- map -----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WrittenMap:
    """Result of `map_of`: the map, and objects with changes that it cannot contain."""

    map: ReferenceMap
    lost: tuple[str, ...]


def map_of(values: Values, build: BuildCalibration, name: object) -> WrittenMap:
    """Return the map that the ECU follows with a set: what the build's own lookup returns at the breakpoints of the map.

    Breakpoints that the build has added (zero, the last angle) are left out, because another build adds them again. A placed
    table has too few breakpoints for a map, because the cap can lie inside a cell; it is sampled on the grid of `[grid]`
    instead. The map has the configuration of the build.

    Raises:
        MapError: the tables are not a map.
    """
    facts, prefix = build.manifest["map"], f"{build.layout.prefix}.map."
    lost: tuple[str, ...] = ()
    if "placement" in facts:
        grid, placement = build.config.grid, facts["placement"]
        speed = _evenly(placement["own_speed_range_m_s"], grid.speed_points)
        front_angle = _evenly(placement["own_front_angle_range_rad"], grid.front_angle_points)
    else:
        rows, columns = _own_breakpoints(facts["rule_by_speed_and_front_angle"])
        speed, front_angle = _doubles(values[f"{prefix}speed"][rows]), _doubles(values[f"{prefix}front_angle"][columns])
        lost = tuple(_lost(values, build, rows, columns))
    with_rear = any(each.name.startswith(f"{prefix}rear_angle") for each in build.layout.tables)
    moving = facts.get("longitudinal_accelerations")
    stack, of_layers = (ACCELERATION_STACK, moving) if moving else (FRICTION_STACK, facts["frictions"])
    own = of_layers.index(0.0) if moving else len(of_layers) - 1
    takes_acceleration = ACCELERATION_STACK.key in build.config.can.vehicle_conditions.signals()
    roads = [(facts["friction"], value) if moving else (value, *([0.0] if takes_acceleration else [])) for value in of_layers]
    layers = [build.looked_up(values, speed, front_angle, road, with_rear_angle=with_rear) for road in roads]
    arrays: dict[str, Any] = {"vx": speed, "delta_f": front_angle}
    for key, tables in zip(("yaw_rate", "delta_r")[: 1 + with_rear], zip(*layers, strict=True), strict=False):
        others = [index for index in range(len(of_layers)) if index != own]
        arrays[key] = tables[own]
        if others:
            arrays[f"{stack.prefix}{key}"] = np.stack([tables[index] for index in others])
            arrays[stack.key] = np.array(of_layers, dtype=np.float64)[others]
    if with_rear:
        for key in [key for key in arrays if key.endswith("delta_r")]:
            arrays[key] = _within(arrays[key], build)
    meta = {"schema_version": SCHEMA_VERSION, "configuration": build.manifest["configuration"]}
    try:
        made = npz.from_arrays({**arrays, "meta": np.array(json.dumps(meta))}, name)
    except MapError as error:
        raise MapError(error.what, where=error.where, remedy="keep the set as .dcm or .cdfx") from None
    return WrittenMap(made, lost)


def _own_breakpoints(rules: list[str]) -> tuple[Any, Any]:
    """Return which rows and columns have a cell that the build did not add."""
    own = np.array([[letter not in (Rule.ZERO, Rule.PASSIVE_SLOPE, Rule.HOLD) for letter in row] for row in rules])
    return own.any(axis=1), own.any(axis=0)


def _lost(values: Values, build: BuildCalibration, rows: Any, columns: Any) -> Iterator[str]:
    for each in build.layout.tables:
        changed = values[each.name] != build.values[each.name]
        changed[np.ix_(rows, columns)] = False
        if changed.any():
            yield each.name


def _within(rear_angle: FloatArray, build: BuildCalibration) -> FloatArray:
    """Return rear angles in rad without rounding beyond the largest angle of the actuator."""
    largest = build.config.rear_actuator.angle_max
    rounded = np.abs(rear_angle) <= float(build.layout.tables[0].dtype.type(largest))
    return np.where(rounded, np.clip(rear_angle, -largest, largest), rear_angle)


def _evenly(ends: list[float], points: int) -> FloatArray:
    return np.linspace(ends[0], ends[1], points)


def _doubles(numbers: Numbers) -> FloatArray:
    result: FloatArray = numbers.astype(np.float64)
    return result
