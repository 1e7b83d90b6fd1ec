"""Numbers in a MATLAB file, read with SciPy. Only a child process imports it (see `child`)."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.io import loadmat, whosmat

BYTES_PER_NUMBER = {"int8": 1, "uint8": 1, "logical": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4, "single": 4}
BYTES_PER_NUMBER |= {"int64": 8, "uint64": 8, "double": 8}


def read(data: bytes, limit: int) -> tuple[dict[str, npt.NDArray[Any]], list[str]]:
    """Return name -> array for each numeric or logical (0 and 1) variable, those inside plain structs as "map.vx".

    Also return the names of the structs inside those structs.

    Raises:
        MemoryError: over `limit` bytes.
        Exception: whatever SciPy raises.
    """
    wanted, size = [], 0
    for name, shape, kind in whosmat(io.BytesIO(data)):
        length = int(np.prod(shape, dtype=object))
        if kind in BYTES_PER_NUMBER and not name.startswith("__"):  # internal names of SciPy and MATLAB
            size += BYTES_PER_NUMBER[kind] * length
            wanted.append(name)
        elif kind == "sparse" and not name.startswith("__"):
            size += BYTES_PER_NUMBER["double"] * length
            wanted.append(name)
        elif kind == "struct" and length == 1:
            wanted.append(name)
    if size > limit:
        raise MemoryError
    # Not mat_dtype=True, the types that they have in MATLAB: it drops imaginary parts (SciPy 1.17).
    inside = dict(_inside(loadmat(io.BytesIO(data), variable_names=wanted), wanted))
    found = {name: array for name, array in inside.items() if array.dtype.kind in "biufc"}
    if sum(array.nbytes for array in found.values()) > limit:
        raise MemoryError
    return found, [name for name, array in inside.items() if array.dtype.names is not None]


def _inside(variables: Mapping[str, Any], wanted: list[str]) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    for name in wanted:
        value = variables[name]
        if hasattr(value, "toarray"):  # a sparse matrix: what it does not store is zero
            value = value.toarray()
        if value.dtype.names is None:
            inside = {name: value}
        else:
            inside = {f"{name}.{field}": value[0, 0][field] for field in value.dtype.names}
        for key, array in inside.items():
            if isinstance(array, np.ndarray):
                yield key, array
