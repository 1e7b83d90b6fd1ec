"""MATLAB files: arrays written by SciPy are read back; a file that SciPy cannot read, or crashes on, gives a one-line error."""

import contextlib
import io
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from codegen.importing.maps import contents
from codegen.importing.source import ImportFault, Source

KINDS = ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "bool", "c16"]
SHAPES = [(1, 1), (3, 4), (1, 5), (5, 1), (2, 3, 4), (0, 3)]
DAMAGED = "x.mat: damaged, or no MAT-file of version 4 to 7.2 ("


def saved(arrays: dict[str, Any], **options: Any) -> bytes:
    stream = io.BytesIO()
    savemat(stream, arrays, **options)
    return stream.getvalue()


def read(data: bytes) -> dict[str, Any]:
    return contents(Source(Path("x.mat"), data)).variables


def message(data: bytes) -> str:
    """Return the error of a file that is rejected."""
    with pytest.raises(ImportFault) as error:
        read(data)
    return str(error.value)


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("packed", [False, True])
def test_every_kind_and_shape_is_read_back(packed: bool) -> None:
    """Texts, cells and nested structs are omitted; names that `numpy.savez` reserves are kept."""
    arrays = {
        f"{kind}_{number}": (np.arange(np.prod(shape)).reshape(shape) * (1 + 1j if kind == "c16" else 1)).astype(kind)
        for kind in KINDS
        for number, shape in enumerate(SHAPES)
    }
    arrays |= {name: np.array([[float(k)]]) for k, name in enumerate(("file", "arr_0", "names", "allow_pickle"))}
    many = np.zeros((1, 2), dtype=[("vx", "f8")])
    others = {"c": np.array([1, "a"], dtype=object), "t": "text", "deep": {"in": {"v": 1.0}}, "many": many}
    inside = {**arrays, "long_name_of_a_field": np.ones((2, 2))}
    found = read(saved({**others, **arrays, "s": inside}, do_compression=packed))
    assert list(found) == [*arrays, *(f"s.{name}" for name in inside)]
    for name, array in arrays.items():
        for key in (name, f"s.{name}"):
            np.testing.assert_array_equal(found[key], array)
            assert found[key].dtype == (np.uint8 if array.dtype == np.bool_ else array.dtype), key


@pytest.mark.usefixtures("in_this_process")
def test_version_4_and_the_other_byte_order() -> None:
    arrays = {f"of_{kind}": np.arange(12).reshape(3, 4).astype(kind) for kind in ("f8", "f4", "i4", "i2", "u2", "u1", "c16")}
    found = read(saved({**arrays, "t": "a text", "b": np.eye(2)}, format="4"))
    assert list(found) == [*arrays, "b"]
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI"
    words = np.array([14, 56, 6, 8, 6, 0, 5, 8, 1, 1, (1 << 16) + 1], ">u4").tobytes()
    found = read(head + words + b"v\0\0\0" + np.array([9, 8], ">u4").tobytes() + np.array([2.5], ">f8").tobytes())
    assert {name: array.tolist() for name, array in found.items()} == {"v": [[2.5]]}


def test_a_file_with_too_much_content_is_rejected() -> None:
    data = saved({"m": {"v": np.broadcast_to(np.uint8(0), (65, 2**20))}}, do_compression=True)
    assert "over 64 MiB unpacked" in message(data[: 2**20 - 1])


def test_version_7_3_is_rejected_with_the_remedy() -> None:
    hdf5 = b"\x89HDF\r\n\x1a\n" + bytes(100)
    for data in (hdf5, b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384) + hdf5):
        line = message(data)
        assert "version 7.3 (HDF5), which is not read" in line
        assert "'-v7'" in line


# --- damage --------------------------------------------------------------------------------------------------------------

WHOLE = saved({"vx": np.arange(5.0), "yaw_rate": np.ones((5, 4)), "m": {"vx": np.arange(3), "c": "text"}})
PACKED = saved({"vx": np.arange(5.0), "yaw_rate": np.ones((5, 4))}, do_compression=True)
VERSION_4 = saved({"vx": np.arange(5.0), "yaw_rate": np.ones((5, 4))}, format="4")
TYPE_OF_NUMBERS = 176
"""Offset in WHOLE. SciPy 1.17.1 uses the type of an element as an unchecked index and crashes."""
CRASHING = WHOLE[:TYPE_OF_NUMBERS] + b"\xd8" + WHOLE[TYPE_OF_NUMBERS + 1 :]


@pytest.mark.parametrize("data", [b"hello", WHOLE[:200], PACKED[:150], VERSION_4[:30], CRASHING])
def test_a_damaged_file_gives_one_line(data: bytes) -> None:
    assert WHOLE[TYPE_OF_NUMBERS] == 9  # double
    assert message(data).startswith(DAMAGED)


@pytest.mark.parametrize("whole", [WHOLE, PACKED, VERSION_4], ids=["whole", "packed", "4"])
def test_random_damage_is_read_or_rejected(whole: bytes) -> None:
    source, data = random.Random(1), bytearray(whole)
    for _ in range(3):
        data[source.randrange(0 if whole is VERSION_4 else 124, len(data))] = source.randrange(256)
    with contextlib.suppress(ImportFault):
        read(bytes(data))
