"""MATLAB files: what SciPy writes comes back; what SciPy cannot read, or dies of, is one line."""

from __future__ import annotations

import contextlib
import io
import random
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from codegen.importing import mat, mat_child
from codegen.importing.mat import contents
from codegen.importing.source import ImportFault, Source

KINDS = ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "bool", "c16"]
SHAPES = [(1, 1), (3, 4), (1, 5), (5, 1), (2, 3, 4), (0, 3)]
DAMAGED = "x.mat: damaged, or no MAT-file of version 4 to 7.2; save it in MATLAB with save"


def saved(arrays: dict[str, Any], **options: Any) -> bytes:
    stream = io.BytesIO()
    savemat(stream, arrays, **options)
    return stream.getvalue()


def read(data: bytes) -> dict[str, Any]:
    return contents(Source(Path("x.mat"), data)).variables


@pytest.mark.parametrize("packed", [False, True])
def test_what_is_saved_comes_back(packed: bool) -> None:
    arrays = {
        f"{kind}_{number}": (np.arange(np.prod(shape)).reshape(shape) * (1 + 1j if kind == "c16" else 1)).astype(kind)
        for kind in KINDS
        for number, shape in enumerate(SHAPES)
    }
    found = read(saved({**arrays, "s": {**arrays, "long_name_of_a_field": np.ones((2, 2))}}, do_compression=packed))
    assert list(found) == [*arrays, *(f"s.{name}" for name in arrays), "s.long_name_of_a_field"]
    for name, array in arrays.items():
        for key in (name, f"s.{name}"):
            np.testing.assert_array_equal(found[key], array)
            assert found[key].dtype == (np.uint8 if array.dtype == np.bool_ else array.dtype), key


def test_version_4() -> None:
    arrays = {f"of_{kind}": np.arange(12).reshape(3, 4).astype(kind) for kind in ("f8", "f4", "i4", "i2", "u2", "u1", "c16")}
    found = read(saved({**arrays, "t": "a text", "b": np.eye(2)}, format="4"))
    assert list(found) == [*arrays, "b"]
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)


def test_the_other_order_of_bytes() -> None:
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI"
    words = np.array([14, 56, 6, 8, 6, 0, 5, 8, 1, 1, (1 << 16) + 1], ">u4").tobytes()
    found = read(head + words + b"v\0\0\0" + np.array([9, 8], ">u4").tobytes() + np.array([2.5], ">f8").tobytes())
    assert {name: array.tolist() for name, array in found.items()} == {"v": [[2.5]]}


def test_what_is_no_number_is_passed_over() -> None:
    many = np.zeros((1, 2), dtype=[("vx", "f8")])
    arrays = {"c": np.array([1, "a"], dtype=object), "t": "text", "deep": {"in": {"v": 1.0}}, "many": many, "v": 1.0}
    assert list(read(saved(arrays))) == ["v"]


def test_names_that_numpy_keeps_for_itself() -> None:
    assert list(read(saved({"file": 1.0, "arr_0": 2.0, "names": 3.0, "allow_pickle": 4.0}))) == [
        "file",
        "arr_0",
        "names",
        "allow_pickle",
    ]


@pytest.mark.parametrize("inside", [False, True])
def test_a_bomb_is_not_unpacked(inside: bool) -> None:
    big = np.broadcast_to(np.uint8(0), (65, 2**20))
    data = saved({"m": {"v": big}} if inside else {"v": big}, do_compression=True)
    assert len(data) < 2**20
    with pytest.raises(ImportFault, match="over 64 MiB unpacked"):
        read(data)


def test_what_is_too_large_is_not_read() -> None:
    """Its size is what the file says first: the numbers need not even be there."""
    with pytest.raises(ImportFault, match="over 64 MiB unpacked"):
        read(saved({"v": np.broadcast_to(np.uint8(0), (65, 2**20))})[:1000])


def test_hdf5_without_a_matlab_header() -> None:
    with pytest.raises(ImportFault, match=r"version 7\.3 \(HDF5\), which is not read"):
        read(b"\x89HDF\r\n\x1a\n" + bytes(500))


@pytest.mark.skipif(sys.platform != "linux", reason="macOS does not hold a process to its bound")
def test_the_process_that_reads_has_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a struct holds is not known before it is read."""
    text = f"import runpy; child = runpy.run_path({mat_child.__file__!r}); child['_bound_process']()"
    monkeypatch.setattr(mat, "READER", python(f"{text}; bytes(2**29); bytes(5 * 2**28)"))
    with pytest.raises(ImportFault, match="MemoryError"):
        read(WHOLE)


# --- damage --------------------------------------------------------------------------------------------------------------

WHOLE = saved({"vx": np.arange(5.0), "yaw_rate": np.ones((5, 4)), "m": {"vx": np.arange(3), "c": "text"}})
PACKED = saved({"vx": np.arange(5.0), "yaw_rate": np.ones((5, 4))}, do_compression=True)
VERSION_4 = saved({"vx": np.arange(5.0), "yaw_rate": np.ones((5, 4))}, format="4")
TYPE_OF_NUMBERS = 176
"""Offset in WHOLE. SciPy 1.17.1 takes the type of an element from a table without looking at its length."""


@pytest.mark.parametrize("data", [b"hello", bytes(200), WHOLE[:130], WHOLE[:200], PACKED[:150], VERSION_4[:30]])
def test_what_is_no_mat_file_is_one_line(data: bytes) -> None:
    with pytest.raises(ImportFault) as told:
        read(data)
    assert str(told.value).startswith(DAMAGED)


def test_a_file_that_scipy_dies_of() -> None:
    data = bytearray(WHOLE)
    assert data[TYPE_OF_NUMBERS] == 9  # double
    data[TYPE_OF_NUMBERS] = 216
    with pytest.raises(ImportFault) as told:
        read(bytes(data))
    assert str(told.value).startswith(DAMAGED)


@pytest.mark.parametrize("number", range(12))
def test_damage_is_read_or_told(number: int) -> None:
    source = random.Random(number)
    data = bytearray((WHOLE, PACKED, VERSION_4)[number % 3])
    for _ in range(source.randrange(1, 4)):
        data[source.randrange(0 if number % 3 == 2 else 124, len(data))] = source.randrange(256)
    with contextlib.suppress(ImportFault):
        read(bytes(data))


# --- the process that reads ----------------------------------------------------------------------------------------------


def python(text: str) -> tuple[str, ...]:
    return (sys.executable, "-c", text)


@pytest.mark.parametrize(
    ("program", "told"),
    [
        (python("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"), DAMAGED),
        (python("import os; os.abort()"), DAMAGED),
        (python("import threading; threading.Event().wait()"), "x.mat: not read within 0.5 s: damaged?; save it in MATLAB"),
        (
            python("import no_such_scipy"),
            "SciPy, which reads it, cannot be run (ModuleNotFoundError: No module named 'no_such_",
        ),
        (python("import sys; sys.exit(3)"), "SciPy, which reads it, cannot be run (exit code 3)"),
        (python("pass"), "SciPy, which reads it, cannot be run (no answer that can be read)"),
        (python("print('a word of sitecustomize')"), "SciPy, which reads it, cannot be run (no answer that can be read)"),
        (("/no/such/python",), "SciPy, which reads it, cannot be run (No such file or directory)"),
    ],
)
def test_however_it_ends_there_is_one_line(monkeypatch: pytest.MonkeyPatch, program: tuple[str, ...], told: str) -> None:
    monkeypatch.setattr(mat, "READER", program)
    monkeypatch.setattr(mat, "SECONDS", 0.5 if "threading" in program[-1] else 60.0)
    with pytest.raises(ImportFault) as fault:
        read(WHOLE)
    assert told in str(fault.value)


def test_nothing_of_the_users_folder_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("scipy", "numpy", "io", "resource", "codegen"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit(99)", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert list(read(WHOLE)) == ["vx", "yaw_rate", "m.vx"]
