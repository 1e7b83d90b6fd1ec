"""The judgement of the car in a map file: where it is stored in `meta`, and the hash of the inputs for which it is valid."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.map_file.map import ATTRIBUTES, ReferenceMap

DEFINITION_VERSION = 1
"""Version of the judgement. Raise it with every change of its drives, figures or criteria, and of the control law."""
KEY = "judgement"
"""Key in `meta` and in the manifest of a build."""
HASH = "inputs_sha256"


def inputs_sha256(reference_map: ReferenceMap, config: Config) -> str:
    """Return the hash of everything that a judgement depends on: arrays, configuration and the version of its definition."""
    digest = hashlib.sha256(f"judgement {DEFINITION_VERSION}\n{config.to_json()}\n{reference_map.case}\n".encode())
    for value, each in [(0.0, reference_map), *((layer.value, layer.map) for layer in reference_map.layers)]:
        digest.update(f"{value!r} {reference_map.quantity and reference_map.quantity.key}\n".encode())
        tables = {
            "vx": each.speed,
            "delta_f": each.front_angle,
            **{key: getattr(each, name) for key, name in ATTRIBUTES.items()},
        }
        for key, table in tables.items():
            if table is not None:
                # As numbers of one type, without the bits that a NaN may carry: a saved map has the hash of the one in memory.
                array = np.array(table, dtype="<f8", order="C")
                array[np.isnan(array)] = np.nan
                digest.update(f"{key} {array.shape}\n".encode() + array.tobytes())
    return digest.hexdigest()


def with_judgement(reference_map: ReferenceMap, judgement: Mapping[str, Any] | None) -> ReferenceMap:
    """Return the map with a judgement, JSON values, in its `meta`; None removes one."""
    meta = {key: value for key, value in reference_map.meta.items() if key != KEY}
    return replace(reference_map, meta=meta if judgement is None else {**meta, KEY: json.loads(json.dumps(judgement))})


def stored(reference_map: ReferenceMap) -> Any:
    """Return the judgement in `meta`, unchecked; None without one."""
    return reference_map.meta.get(KEY)


def current(reference_map: ReferenceMap, config: Config) -> dict[str, Any] | None:
    """Return the stored judgement if it is of these arrays and this configuration; else None."""
    found = stored(reference_map)
    if not isinstance(found, dict) or found.get(HASH) != inputs_sha256(reference_map, config):
        return None
    return found
