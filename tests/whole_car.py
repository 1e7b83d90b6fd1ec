"""The data that every `ars.toml` must have, here the paper's car, for tests about other keys."""

import tomllib
from collections.abc import Mapping
from typing import Any

import tomlkit

from codegen.configuration import Config, parse, preset
from codegen.configuration.section import required_keys

REQUIRED = {key: preset().value(key) for key in (".".join(map(str, place)) for place in required_keys(Config))}
"""Dotted keys without a default, with the values of the paper's car."""


def with_car(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables as read from a file, with those data of the paper's car that they lack."""
    whole = _copy(data)
    for key, value in REQUIRED.items():
        *tables, name = key.split(".")
        table: Any = whole
        for one in tables:
            table = table.setdefault(one, {}) if isinstance(table, dict) else None
        if isinstance(table, dict) and not (tables[0] == "tyre" and "stiffness_factor_b_per_rad" in table):
            table.setdefault(name, value)
    return whole


def car_toml(text: str = "") -> str:
    """Return the text of an `ars.toml`, completed by data of the paper's car."""
    return tomlkit.dumps(with_car(tomllib.loads(text)))


def car(data: Mapping[str, Any] | None = None) -> Config:
    """Return the paper's car with default settings, and with other values by table."""
    return parse(with_car(data or {}), "car of the test")


def _copy(data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _copy(value) if isinstance(value, Mapping) else value for key, value in data.items()}
