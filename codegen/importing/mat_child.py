"""Child process that reads a MATLAB file from standard input and writes its numbers as .npz to standard output, within a limit.

`maps` runs it by its path, because SciPy may crash on a damaged file. It imports nothing of the project, which need not be on
the path of a new Python.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

DAMAGED, TOO_LARGE = 10, 11
"""Exit codes. 0 is success; any other code or a signal is another failure."""

NAMES, NESTED = "names", "nested"
"""Keys of the names of the variables, and of structs inside structs, which are not read. The arrays of the variables are arr_0,
arr_1 and so on, because no name must get into NumPy's way."""

BYTES_PER_NUMBER = {"int8": 1, "uint8": 1, "logical": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4, "single": 4}
BYTES_PER_NUMBER |= {"int64": 8, "uint64": 8, "double": 8}
SPARE = 2**30
"""Memory limit in bytes of the reading, in addition to Python, NumPy and SciPy."""


def read(data: bytes, limit: int) -> tuple[dict[str, npt.NDArray[Any]], list[str]]:
    """Return name -> array for each numeric or logical (0 and 1) variable, those inside plain structs as "map.vx".

    Also return the names of the structs inside those structs.

    Raises:
        MemoryError: over `limit` bytes.
        Exception: whatever SciPy raises.
    """
    from scipy.io import loadmat, whosmat

    wanted, size = [], 0
    for name, shape, kind in whosmat(io.BytesIO(data)):
        length = int(np.prod(shape, dtype=object))
        if kind in BYTES_PER_NUMBER and not name.startswith("__"):  # internal names of SciPy and MATLAB
            size += BYTES_PER_NUMBER[kind] * length
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
        if value.dtype.names is None:
            inside = {name: value}
        else:
            inside = {f"{name}.{field}": value[0, 0][field] for field in value.dtype.names}
        for key, array in inside.items():
            if isinstance(array, np.ndarray):
                yield key, array


def _bound_process() -> None:
    """Disable core files and, where Linux reports the size of this process, limit its memory to SPARE more."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + SPARE, most))


def main() -> int:
    """Return the exit code. Raises ImportError where SciPy is unusable."""
    import scipy.io  # noqa: F401, before the bound: it takes some memory itself

    _bound_process()
    try:
        found, nested = read(sys.stdin.buffer.read(), int(sys.argv[1]))
    except MemoryError:
        return TOO_LARGE
    except Exception:
        return DAMAGED
    result = io.BytesIO()
    texts = {key: np.array(names, dtype=np.str_) for key, names in ((NAMES, list(found)), (NESTED, nested))}
    np.savez(result, *found.values(), allow_pickle=False, **texts)
    sys.stdout.buffer.write(result.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main())
