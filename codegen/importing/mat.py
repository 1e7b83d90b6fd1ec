"""Numeric variables of a MATLAB file: versions 4, 5, 6, 7 and 7.2 (save -v4, -v6, -v7); 7.3 is HDF5 and is rejected.

SciPy reads them in a child process (`mat_child`). On a damaged file it may crash (1.17 does) or request any amount of memory;
then only the child ends.
"""

from __future__ import annotations

import io
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from codegen.arrays import AnyArray
from codegen.importing import mat_child
from codegen.importing.source import MIB, TABLE_BYTES_MAX, ImportFault, Source

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
SAVE_AGAIN = "save it in MATLAB with save(name, 'vx', 'delta_f', 'yaw_rate', '-v7')"
SECONDS = 60.0
"""Time limit of the reading in s; 64 MiB take one second."""
# -P: neither the user's folder nor this one comes before the libraries. By its path: the package need not be installed.
READER = (sys.executable, "-P", str(Path(mat_child.__file__)), str(TABLE_BYTES_MAX))


@dataclass(frozen=True)
class Contents:
    """Contents of a MATLAB file.

    Attributes:
        variables: name -> array for each numeric or logical (0 and 1) one, in the file's order; in plain structs as "map.vx".
        nested: the names of structs inside structs, "lut.Breakpoints", which are not read.
    """

    variables: dict[str, AnyArray]
    nested: tuple[str, ...]


def contents(source: Source) -> Contents:
    """Read a MATLAB file.

    Raises:
        ImportFault: it is HDF5, no MATLAB file, damaged, or too large.
    """
    data = source.data
    if HDF5_SIGNATURE in data[:1024] or (data[126:128] in (b"IM", b"MI") and 2 in data[124:126]):
        raise ImportFault("a MATLAB file of version 7.3 (HDF5), which is not read", where=source.path, remedy=SAVE_AGAIN)
    try:
        result = subprocess.run(READER, input=data, capture_output=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        raise ImportFault(f"not read within {SECONDS:g} s: damaged?", where=source.path, remedy=SAVE_AGAIN) from None
    except OSError as error:
        raise _no_reader(source, str(error.strerror)) from None
    if result.returncode == mat_child.TOO_LARGE:
        remedy = "save the map's own variables only"
        raise ImportFault(f"over {TABLE_BYTES_MAX // MIB} MiB unpacked", where=source.path, remedy=remedy)
    if result.returncode == mat_child.DAMAGED or result.returncode < 0:  # below zero: a signal
        raise ImportFault("damaged, or no MAT-file of version 4 to 7.2", where=source.path, remedy=SAVE_AGAIN)
    if result.returncode != 0:
        told = result.stderr.decode(errors="replace").splitlines()
        raise _no_reader(source, told[-1] if told else f"exit code {result.returncode}")
    try:
        with np.load(io.BytesIO(result.stdout), allow_pickle=False) as found:
            variables = {str(name): found[f"arr_{number}"] for number, name in enumerate(found[mat_child.NAMES])}
            return Contents(variables, tuple(str(name) for name in found[mat_child.NESTED]))
    except (EOFError, KeyError, OSError, ValueError, zipfile.BadZipFile):
        raise _no_reader(source, "no answer that can be read") from None


def _no_reader(source: Source, reason: str) -> ImportFault:
    remedy = "install the project's packages again, or save the map as a text table"
    return ImportFault(f"SciPy, which reads it, cannot be run ({reason})", where=source.path, remedy=remedy)
