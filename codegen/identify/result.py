"""The result as an `ars.toml`: the given one with the identified values, and their uncertainty in `[identified]`."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from typing import Any

import tomlkit

from codegen.configuration import Config, parse
from codegen.errors import ConfigError
from codegen.identify.model import AXLES
from codegen.identify.reached import known_share, reached
from codegen.identify.run import Identification
from codegen.importing.source import ImportFault
from codegen.importing.toml_edit import replace_values, whole

REMARK = "codegen identify wrote into this table."
DIGITS = 7
GRIP_DIGITS = 3
"""Digits of a share of the grip."""
_RENAMED = {"stiffness_factor_b_per_rad": "cornering_stiffness_n_per_rad"}


def identified_keys(found: Identification) -> dict[str, tuple[float | int, float]]:
    """Return the key of each uncertain quantity -> its value and standard deviation, in the unit of the key.

    If any quantity of an axle's tyre is determined, its cornering stiffness is written too: B would otherwise change with the
    other factors.
    """
    period = found.config.controller.sampling_time_s
    keys: dict[str, tuple[float | int, float]] = {}
    for quantity in found.quantities.values():
        parameter = quantity.parameter
        if not parameter.key or not quantity.is_uncertain:
            continue
        value, deviation = quantity.value / parameter.size, quantity.standard_deviation / parameter.size
        if parameter.name == "actuator_delay":
            keys[parameter.key] = max(round(value / period), 0), deviation / period
        else:
            keys[parameter.key] = _rounded(value), _rounded(deviation)
    return keys


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def identified_toml(found: Identification, text: str, where: object, doubts: Sequence[str] = ()) -> str:
    """Return an ars.toml with the identified values.

    Args:
        text: the given ars.toml, whose comments stay.
        where: location for messages.
        doubts: reasons for which values and deviations may be wrong. A key that accepted earlier ones is removed.

    Raises:
        ConfigError: the identified values contradict other values of the file.
    """
    keys = identified_keys(found)
    tables: dict[str, dict[str, Any]] = {}
    for key, (value, _) in keys.items():
        table, _, name = key.rpartition(".")
        tables.setdefault(table, {})[name] = value
    for axle in ("front", "rear"):
        stiffness = found.quantities[f"{axle}_stiffness"]
        if f"tyre.{axle}" in tables:
            tables[f"tyre.{axle}"].setdefault("cornering_stiffness_n_per_rad", _rounded(stiffness.value))
    order = list(keys)
    names = [next(q.parameter.name for q in found.quantities.values() if q.parameter.key == key) for key in order]
    places = [found.names.index(name) for name in names]
    matrix = [[1.0 if i == j else round(float(found.correlation[i, j]), DIGITS) for j in places] for i in places]
    tables["identified"] = {
        "keys": order,
        "standard_deviations": [deviation for _, deviation in keys.values()],
        "correlations": matrix,
    }
    for axle, share in grip_reached(found).items():
        known = known_share(share)
        is_limit = f"tyre.{axle}" in tables and known < 1.0
        tables["identified"][f"{axle}_grip_reached"] = round(known, GRIP_DIGITS) if is_limit else None
    tables["identified"] |= {"doubts": [*doubts] or None, "doubts_accepted": None}
    try:
        for table, values in {**tables, "identified": _rows(tables["identified"])}.items():
            text = replace_values(text, table, values, _RENAMED if table.startswith("tyre.") else {}, REMARK)
    except ImportFault:
        text = whole(_changed(found.config, tables, where), "codegen identify")
    _parsed(tomllib.loads(text), where)
    return text


def grip_reached(found: Identification) -> dict[str, float]:
    """Return for each axle the largest lateral force of the drives, over the peak of its identified tyres."""
    return dict(zip(AXLES, reached(found.vehicle, found.config).share, strict=True))


def _rows(values: dict[str, Any]) -> dict[str, Any]:
    """Return the lists with an entry, or a row of the matrix, on each line."""
    result = {}
    for key, entries in values.items():
        result[key] = entries
        if not isinstance(entries, list):
            continue
        result[key] = tomlkit.array()
        result[key].extend(entries)
        result[key].multiline(True)
    return result


def _changed(config: Config, tables: dict[str, dict[str, Any]], where: object) -> Config:
    data = config.model_dump(mode="json", exclude_none=True)
    for table, values in tables.items():
        target = data
        for part in table.split("."):
            target = target.setdefault(part, {})
        target.update(values)
        for key in [key for key, value in values.items() if value is None]:
            target.pop(key)
        if table.startswith("tyre."):
            target.pop("stiffness_factor_b_per_rad", None)
    return _parsed(data, where)


def _parsed(data: dict[str, Any], where: object) -> Config:
    try:
        return parse(data, where)
    except ConfigError as error:
        remedy = "check units and signs of the signals, and the other values of this file"
        raise ConfigError(f"with the identified values, {error.what}", where=error.where, remedy=remedy) from None


def understeer_gradient(found: Identification) -> tuple[float, float]:
    """Return the understeer gradient of the linear car in rad s^2/m, and its standard deviation; NaN if not determined.

    K = m/L (lr/C_f - lf/C_r) (R. Rajamani, Vehicle Dynamics and Control, section 3.3).
    """
    vehicle = found.config.vehicle
    front, rear = found.quantities["front_stiffness"], found.quantities["rear_stiffness"]
    loads = (
        vehicle.mass_kg * vehicle.cg_to_rear_axle_m / vehicle.wheelbase,
        vehicle.mass_kg * vehicle.cg_to_front_axle_m / vehicle.wheelbase,
    )
    compliances = loads[0] / (2.0 * front.value), loads[1] / (2.0 * rear.value)
    value = compliances[0] - compliances[1]
    if not (front.is_identified and rear.is_identified):
        return value, math.nan
    slopes = (
        compliances[0] * front.standard_deviation / front.value,
        -compliances[1] * rear.standard_deviation / rear.value,
    )
    i, j = found.names.index("front_stiffness"), found.names.index("rear_stiffness")
    variance = slopes[0] ** 2 + slopes[1] ** 2 + 2.0 * slopes[0] * slopes[1] * float(found.correlation[i, j])
    return value, math.sqrt(max(variance, 0.0))
