"""Reading of arrays from the bytes of an untrusted `.npz` file: pickles are rejected and declared sizes are checked."""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from codegen.arrays import AnyArray
from codegen.errors import MapError
from codegen.files import read_file, reason_of

UNPACKED_BYTES_MAX = 64 * 2**20
PACKED_BYTES_MAX = UNPACKED_BYTES_MAX + 2**20  # the arrays, stored as they are, and the directory of the archive
NPY_HEADER_BYTES = 128
SAVE_AS = "save plain numeric arrays with numpy.savez(path, vx=..., delta_f=..., yaw_rate=...)"


def read_map_file(path: Path) -> bytes:
    """The bytes of an .npz file. Raises MapError."""
    return read_file(path, PACKED_BYTES_MAX, "check the path, name an .npz file; `codegen solve` makes a map", MapError)


def check_size(size: int, limit: int, where: object) -> None:
    """Refuse more than `limit` bytes. Raises MapError."""
    if size > limit:
        remedy = "give the map fewer breakpoints, or its stack fewer frictions"
        raise MapError(f"over {UNPACKED_BYTES_MAX >> 20} MiB unpacked", where=where, remedy=remedy)


@contextmanager
def _refuse_damage(where: object) -> Iterator[None]:
    """Turn any exception that zipfile, zlib or NumPy raise on damaged data (no closed set) into a MapError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except MapError:
        raise
    except Exception as error:
        raise MapError(
            f"damaged or cut short ({reason_of(error)})", where=where, remedy="copy or make the file again"
        ) from error


def read_archive(
    data: bytes, where: object, keys: Sequence[str], check_keys: Callable[[Iterable[str], object], None]
) -> tuple[dict[str, AnyArray], tuple[str, ...]]:
    """Return the arrays of `keys` in an .npz archive, and the names of all others in it.

    `check_keys` checks all names before unpacking. Raises MapError.
    """
    check_size(len(data), PACKED_BYTES_MAX, where)
    if not data.startswith(b"PK"):
        raise MapError("not an .npz file (a zip archive)", where=where, remedy=SAVE_AS)
    with _refuse_damage(where), zipfile.ZipFile(io.BytesIO(data)) as archive:
        check_size(sum(info.file_size for info in archive.infolist()), UNPACKED_BYTES_MAX, where)
        members: dict[str, zipfile.ZipInfo] = {}
        for info in archive.infolist():
            key = info.filename.removesuffix(".npy")
            if key in members:
                raise MapError("the key is there twice", where=f"{where}: {key}", remedy=SAVE_AS)
            members[key] = info
        check_keys(members, where)
        arrays = {key: _read_member(archive, members[key], f"{where}: {key}") for key in keys if key in members}
        return arrays, tuple(key for key in members if key not in keys)


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, place: str) -> AnyArray:
    # Other methods of compression allocate as much memory as their stream states.
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise MapError("compressed in a way that NumPy does not use", where=place, remedy=SAVE_AS)
    with _refuse_damage(place):
        with archive.open(info) as member:
            data = member.read(info.file_size + 1)  # without a bound zlib would unpack all that the stream holds
        stream = io.BytesIO(data)
        version = np.lib.format.read_magic(stream)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"npy format version {version[0]}.{version[1]}")
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran_order, dtype = read_header(stream)
        if dtype.hasobject:
            raise MapError("an object array: a pickle, which is never read", where=place, remedy=SAVE_AS)
        # NumPy's own reader would allocate the shape that the header claims before it looks at the data.
        if math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
            raise ValueError(f"shape {shape} does not fit {len(data) - stream.tell()} bytes")
        # A narrow number becomes one of 8 bytes.
        check_size(math.prod(shape) * max(dtype.itemsize, 8), UNPACKED_BYTES_MAX, place)
        return np.ndarray(shape, dtype, data, stream.tell(), order="F" if fortran_order else "C")
