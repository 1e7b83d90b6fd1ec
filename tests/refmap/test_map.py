"""The `.npz` contract: what is read, what is refused and how, and that saving is atomic and repeatable."""

from __future__ import annotations

import io
import json
import math
import os
import stat
import struct
import tracemalloc
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen import config as configuration
from codegen.errors import MapError
from codegen.refmap import archive
from codegen.refmap import map as refmap
from codegen.refmap.map import Binding, FrictionLayer, ReferenceMap

Arrays = dict[str, Any]
CONFIG = configuration.preset()


def plain_arrays() -> Arrays:
    """A small map as another tool would make it: 4 speeds, 3 front angles, the passive car with a cap at 5 m/s^2."""
    speed = np.array([5.0, 10.0, 20.0, 30.0])
    front_angle = np.array([0.01, 0.05, 0.1])
    yaw_rate = np.minimum(np.outer(speed / 3.14, front_angle), 5.0 / speed[:, np.newaxis])
    return {"vx": speed, "delta_f": front_angle, "yaw_rate": yaw_rate}


def solved_arrays() -> Arrays:
    """The same with everything that the optimisation adds; the last cell is infeasible."""
    arrays = plain_arrays()
    feasible = np.ones((4, 3), dtype=bool)
    feasible[3, 2] = False
    arrays["yaw_rate"][3, 2] = np.nan
    arrays["beta"] = np.where(feasible, -0.02, np.nan)
    arrays["delta_r"] = np.where(feasible, 0.03, np.nan)
    arrays["feasible"] = feasible
    arrays["active"] = np.where(feasible, int(Binding.SLIP_FRONT | Binding.SLIP_REAR), 0).astype(np.uint8)
    arrays["meta"] = np.array(json.dumps(refmap.make_meta(CONFIG, "4ws-2", "exact")))
    return arrays


def solved_map() -> ReferenceMap:
    return refmap.from_arrays(solved_arrays(), "test")


def write(path: Path, arrays: Arrays) -> Path:
    np.savez(path, **arrays)
    return path


def write_members(path: Path, members: list[tuple[str, bytes]], compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return path


def npy(array: Any) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asarray(array), allow_pickle=True)
    return stream.getvalue()


def plain_members() -> list[tuple[str, bytes]]:
    return [(f"{key}.npy", npy(array)) for key, array in plain_arrays().items()]


def refusal(path: Path) -> MapError:
    """The error of loading `path`: one line that begins with the file and ends with a remedy."""
    with pytest.raises(MapError) as caught:
        refmap.load(path)
    error = caught.value
    assert error.exit_code == 2
    assert "\n" not in str(error)
    assert str(error).startswith(str(path))
    assert error.remedy
    return error


# --- what is accepted ---------------------------------------------------------------------------------------------------


def test_three_arrays_are_a_map(tmp_path: Path) -> None:
    arrays = plain_arrays()
    loaded = refmap.load(write(tmp_path / "map.npz", arrays))
    np.testing.assert_array_equal(loaded.speed, arrays["vx"])
    np.testing.assert_array_equal(loaded.front_angle, arrays["delta_f"])
    np.testing.assert_array_equal(loaded.yaw_rate, arrays["yaw_rate"])
    assert loaded.feasible.dtype == np.bool_
    assert loaded.feasible.shape == (4, 3)
    assert loaded.feasible.all()
    assert (loaded.sideslip, loaded.rear_angle, loaded.active, loaded.config, loaded.case) == (None,) * 5
    assert loaded.meta == {}
    assert not loaded.solved


def test_solved_map_is_read_whole(tmp_path: Path) -> None:
    arrays = solved_arrays()
    loaded = refmap.load(write(tmp_path / "map.npz", arrays))
    assert loaded.sideslip is not None
    assert loaded.rear_angle is not None
    assert loaded.active is not None
    np.testing.assert_array_equal(loaded.yaw_rate, arrays["yaw_rate"])
    np.testing.assert_array_equal(loaded.sideslip, arrays["beta"])
    np.testing.assert_array_equal(loaded.rear_angle, arrays["delta_r"])
    np.testing.assert_array_equal(loaded.feasible, arrays["feasible"])
    np.testing.assert_array_equal(loaded.active, arrays["active"])
    assert loaded.active.dtype == np.uint8
    assert Binding(int(loaded.active[0, 0])) == Binding.SLIP_FRONT | Binding.SLIP_REAR
    assert loaded.config == CONFIG
    assert loaded.case == "4ws-2"
    assert loaded.meta["method"] == "exact"
    assert loaded.solved


@pytest.mark.parametrize("lost", ["active", "case", "configuration"])
def test_solved_needs_configuration_case_and_active(lost: str) -> None:
    arrays = solved_arrays()
    meta = json.loads(arrays["meta"].item())
    if lost == "active":
        del arrays["active"]
    else:
        del meta[lost]
    assert not refmap.from_arrays(arrays | {"meta": np.array(json.dumps(meta))}, "test").solved


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<f8", np.longdouble])
def test_floats_of_any_width_and_byte_order_become_float64(dtype: Any, tmp_path: Path) -> None:
    arrays = {key: array.astype(dtype) for key, array in plain_arrays().items()}
    loaded = refmap.load(write(tmp_path / "map.npz", arrays))
    for values, key in ((loaded.speed, "vx"), (loaded.front_angle, "delta_f"), (loaded.yaw_rate, "yaw_rate")):
        assert values.dtype == np.dtype("=f8")
        np.testing.assert_array_equal(values, arrays[key].astype(np.float64))


@pytest.mark.parametrize("dtype", [np.int32, np.int64, np.uint8, ">i2"])
def test_integer_axis_becomes_float64(dtype: Any, tmp_path: Path) -> None:
    arrays = plain_arrays()
    loaded = refmap.load(write(tmp_path / "map.npz", arrays | {"vx": arrays["vx"].astype(dtype)}))
    assert loaded.speed.dtype == np.float64
    np.testing.assert_array_equal(loaded.speed, arrays["vx"])


def test_column_order_and_compression_are_read(tmp_path: Path) -> None:
    arrays = plain_arrays()
    np.savez_compressed(tmp_path / "map.npz", **(arrays | {"yaw_rate": np.asfortranarray(arrays["yaw_rate"])}))
    loaded = refmap.load(tmp_path / "map.npz")
    np.testing.assert_array_equal(loaded.yaw_rate, arrays["yaw_rate"])
    assert loaded.yaw_rate.flags.c_contiguous


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.int64, np.float64])
def test_feasible_may_be_zeros_and_ones(dtype: Any, tmp_path: Path) -> None:
    arrays = solved_arrays()
    loaded = refmap.load(write(tmp_path / "map.npz", arrays | {"feasible": arrays["feasible"].astype(dtype)}))
    np.testing.assert_array_equal(loaded.feasible, arrays["feasible"])


@pytest.mark.parametrize("filling", [0.0, -1.0, 1e9, math.inf, math.nan])
def test_infeasible_cells_become_nan_whatever_fills_them(filling: float) -> None:
    arrays = solved_arrays()
    for key in ("yaw_rate", "beta", "delta_r"):
        arrays[key][3, 2] = filling
    loaded = refmap.from_arrays(arrays, "test")
    for values in (loaded.yaw_rate, loaded.sideslip, loaded.rear_angle):
        assert values is not None
        np.testing.assert_array_equal(np.isnan(values), ~loaded.feasible)


def test_unknown_keys_are_ignored_even_a_pickle(tmp_path: Path) -> None:
    extra = {"notes": np.array([{"a": 1}], dtype=object), "zeta": np.array("text")}
    loaded = refmap.load(write(tmp_path / "map.npz", plain_arrays() | extra))
    np.testing.assert_array_equal(loaded.speed, plain_arrays()["vx"])


def test_axes_may_start_at_zero() -> None:
    arrays = plain_arrays()
    arrays["vx"][0] = arrays["delta_f"][0] = 0.0
    arrays["yaw_rate"][0, :] = arrays["yaw_rate"][:, 0] = 0.0
    loaded = refmap.from_arrays(arrays, "test")
    assert loaded.speed[0] == loaded.front_angle[0] == 0.0


def test_map_is_a_copy_and_read_only() -> None:
    arrays = solved_arrays()
    loaded = refmap.from_arrays(arrays, "test")
    arrays["yaw_rate"][:] = 9.0
    arrays["vx"][:] = 9.0
    np.testing.assert_array_equal(loaded.speed, solved_arrays()["vx"])
    for values in (loaded.speed, loaded.front_angle, loaded.yaw_rate, loaded.feasible, loaded.sideslip, loaded.active):
        assert values is not None
        with pytest.raises(ValueError, match="read-only"):
            values[...] = 0


def test_bound_on_lateral_acceleration_is_inclusive_and_follows_the_road() -> None:
    arrays = plain_arrays()
    arrays["yaw_rate"][3, 2] = np.nextafter(5.0 * 9.81 / 30.0, 2.0)  # the bound and its rounding
    refmap.from_arrays(arrays, "test")
    meta = json.dumps({"schema_version": 1, "configuration": {"road": {"gravity_m_s2": 20.0}}})
    arrays["yaw_rate"][3, 2] = 5.0 * 20.0 / 30.0
    refmap.from_arrays(arrays | {"meta": np.array(meta)}, "test")
    with pytest.raises(MapError, match="lateral acceleration"):
        refmap.from_arrays(arrays, "test")


def test_meta_tells_versions_units_and_bits() -> None:
    meta = refmap.make_meta(CONFIG, "fws", "ipopt")
    assert meta["schema_version"] == 1
    assert (meta["case"], meta["method"]) == ("fws", "ipopt")
    assert configuration.parse(meta["configuration"], "meta") == CONFIG
    assert meta["units"]["vx"] == "m/s"
    assert set(meta["units"]) == {"vx", "delta_f", "yaw_rate", "beta", "delta_r", "feasible", "active"}
    assert meta["active_bits"] == {
        "sideslip": 1,
        "lateral_acceleration": 2,
        "slip_front": 4,
        "slip_rear": 8,
        "rear_angle": 16,
    }
    assert set(meta["tools"]) == {"codegen", "numpy"}
    assert json.loads(json.dumps(meta)) == meta


# --- what is refused: arrays --------------------------------------------------------------------------------------------


def cell(key: str, index: Any, value: float) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        arrays[key][index] = value

    return change


def put(key: str, value: Callable[[Any], Any]) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        arrays[key] = value(arrays[key])

    return change


def drop(key: str) -> Callable[[Arrays], None]:
    return lambda arrays: arrays.__delitem__(key)


def meta_with(**changes: Any) -> Callable[[Arrays], None]:
    """Replace top-level keys of meta; `...` removes one."""

    def change(arrays: Arrays) -> None:
        meta = json.loads(arrays["meta"].item()) | changes
        arrays["meta"] = np.array(json.dumps({key: value for key, value in meta.items() if value is not ...}))

    return change


def text_meta(text: Any) -> Callable[[Arrays], None]:
    return put("meta", lambda _: np.array(text))


def code_points(text: Any, value: int) -> Any:
    """The array `text` with a code point that Unicode does not have, behind one that needs four bytes as well."""
    raw = np.array([text.item() + "\U0001f600" + "x" * 9]).view(np.uint32)
    raw[-2] = value
    return raw.view(f"U{raw.size}").reshape(())


REFUSED = {
    # name: (change, place after the file name, words of the fault, words of the remedy)
    "missing vx": (drop("vx"), "vx", "missing", "m/s"),
    "missing delta_f": (drop("delta_f"), "delta_f", "missing", "rad; the file holds vx, yaw_rate"),
    "missing yaw_rate": (drop("yaw_rate"), "yaw_rate", "missing", "rad/s"),
    "object axis": (put("vx", lambda a: a.astype(object)), "vx", "object array", "numpy.savez"),
    "object table": (put("yaw_rate", lambda a: a.astype(object)), "yaw_rate", "never read", "numpy.savez"),
    "object feasible": (put("feasible", lambda a: a.astype(object)), "feasible", "object array", "numpy.savez"),
    "object meta": (put("meta", lambda _: np.array({}, dtype=object)), "meta", "object array", "numpy.savez"),
    "complex": (put("yaw_rate", lambda a: a + 0j), "yaw_rate", "complex values", "plain numbers"),
    "text": (put("vx", lambda a: a.astype(str)), "vx", "text values", "plain numbers"),
    "bytes": (put("vx", lambda a: a.astype("S8")), "vx", "text values", "plain numbers"),
    "boolean": (put("delta_f", lambda a: a > 0.01), "delta_f", "boolean values", "plain numbers"),
    "dates": (put("vx", lambda a: a.astype("M8[s]")), "vx", "date values", "plain numbers"),
    "durations": (put("vx", lambda a: a.astype("m8[s]")), "vx", "duration values", "plain numbers"),
    "records": (put("vx", lambda a: a.view([("speed", "f8")])), "vx", "record values", "plain numbers"),
    "axis of two dimensions": (put("vx", lambda a: a[:, None]), "vx", "one dimension", "ravel"),
    "axis of none": (put("delta_f", lambda _: np.array(0.1)), "delta_f", "one dimension", "ravel"),
    "axis of one point": (put("vx", lambda a: a[:1]), "vx", "1 points", "at least two"),
    "empty axis": (put("delta_f", lambda a: a[:0]), "delta_f", "0 points", "at least two"),
    "transposed": (put("yaw_rate", lambda a: a.T), "yaw_rate", "(3, 4), where (4, 3)", "transpose"),
    "flat table": (put("yaw_rate", lambda a: a.ravel()), "yaw_rate", "shape (12,)", "a row for each vx"),
    "short table": (put("beta", lambda a: a[:3]), "beta", "shape (3, 3)", "a row for each vx"),
    "deep table": (put("delta_r", lambda a: a[..., None]), "delta_r", "shape (4, 3, 1)", "a row for each vx"),
    "short feasible": (put("feasible", lambda a: a[:3]), "feasible", "shape (3, 3)", "a row for each vx"),
    "short active": (put("active", lambda a: a[:, :2]), "active", "shape (4, 2)", "a row for each vx"),
    "NaN on vx": (cell("vx", 2, math.nan), "vx[2]", "nan on an axis", "finite"),
    "inf on vx": (cell("vx", 3, math.inf), "vx[3]", "inf on an axis", "finite"),
    "inf on delta_f": (cell("delta_f", 0, -math.inf), "delta_f[0]", "-inf on an axis", "finite"),
    "NaN yaw rate": (cell("yaw_rate", (1, 2), math.nan), "yaw_rate[1, 2]", "nan in a feasible cell", "mark the cell"),
    "inf yaw rate": (cell("yaw_rate", (0, 1), math.inf), "yaw_rate[0, 1]", "inf in a feasible cell", "mark the cell"),
    "NaN beta": (cell("beta", (2, 0), math.nan), "beta[2, 0]", "nan in a feasible cell", "mark the cell"),
    "inf delta_r": (cell("delta_r", (2, 1), -math.inf), "delta_r[2, 1]", "-inf in a feasible cell", "mark the cell"),
    "falling axis": (cell("vx", 2, 9.0), "vx[2]", "9 is not above the breakpoint before it (10)", "sort"),
    "standing axis": (cell("delta_f", 1, 0.01), "delta_f[1]", "not above", "remove doubles"),
    "negative speed": (cell("vx", 0, -5.0), "vx[0]", "-5 is outside 0 to 150 m/s", "reverse"),
    "negative angle": (cell("delta_f", 0, -0.01), "delta_f[0]", "outside 0 to 1.2 rad", "symmetric"),
    "km/h": (put("vx", lambda a: a * 3.6 * 2.0), "vx[3]", "216 is outside", "km/h, divide by 3.6"),
    "yaw rate in deg/s, low speed": (
        put("yaw_rate", lambda a: np.rad2deg(a) / 2.0),
        "yaw_rate[1, 2]",
        " g of lateral acceleration, above 5 g",
        "deg/s",
    ),
    "front angle in degrees": (put("delta_f", np.rad2deg), "delta_f[1]", "2.86479 is outside", "multiply by pi/180"),
    "yaw rate in deg/s": (put("yaw_rate", lambda a: a * 60), "yaw_rate[1, 2]", "outside 0 to 10 rad/s", "pi/180"),
    "sideslip in degrees": (put("beta", np.rad2deg), "beta[0, 0]", "-1.14592 is outside", "multiply by pi/180"),
    "rear angle in degrees": (put("delta_r", np.rad2deg), "delta_r[0, 0]", "1.71887 is outside", "multiply by pi/180"),
    "turning against the steering": (cell("yaw_rate", (0, 2), -0.1), "yaw_rate[0, 2]", "-0.1 is outside", "sign"),
    "feasible of twos": (put("feasible", lambda a: a * 2.0), "feasible[0, 0]", "neither true nor false", "booleans"),
    "feasible NaN": (put("feasible", lambda a: a * math.nan), "feasible[0, 0]", "nan is neither", "booleans"),
    "feasible of text": (put("feasible", lambda a: a.astype(str)), "feasible", "text values", "plain numbers"),
    "infeasible everywhere": (put("feasible", lambda a: a & False), "feasible", "infeasible everywhere", "loosen"),
    "unknown constraint": (cell("active", (1, 1), 32), "active[1, 1]", "32 is no set", "0 to 31"),
    "negative constraint": (put("active", lambda a: a * -1.0), "active[0, 0]", "-12 is no set", "0 to 31"),
    "broken constraint": (put("active", lambda a: a + 0.5), "active[0, 0]", "12.5 is no set", "0 to 31"),
    "active of text": (put("active", lambda a: a.astype(str)), "active", "text values", "plain numbers"),
    "meta of numbers": (put("meta", lambda _: np.zeros(3)), "meta", "numeric of shape (3,)", "json.dumps"),
    "meta as a list": (put("meta", lambda a: a.reshape(1)), "meta", "text of shape (1,)", "json.dumps"),
    "meta in bytes": (put("meta", lambda a: a.astype("S")), "meta", "one JSON text", "json.dumps"),
    "meta empty": (text_meta(""), "meta", "not JSON text", "leave the key out"),
    "meta cut short": (text_meta('{"schema_version": 1'), "meta", "not JSON text", "leave the key out"),
    "meta with NaN": (text_meta('{"schema_version": NaN}'), "meta", "NaN is no JSON number", "leave the key out"),
    "meta too deep": (text_meta("[" * 100_000), "meta", "not JSON text", "leave the key out"),
    "meta with a huge number": (text_meta("9" * 5_000), "meta", "not JSON text", "leave the key out"),
    "meta with half a character": (text_meta('{"case": "\ud800"}'), "meta", "not JSON text", "leave the key out"),
    "meta with no character": (put("meta", lambda a: code_points(a, 0x110000)), "meta", "not JSON text", "leave the key"),
    "meta with half a character, escaped": (
        meta_with(configuration={"\ud800": {"\udfff": "\ud800"}}),
        "meta.configuration: the file as a whole",
        "valid string",
        "mend",
    ),
    "meta no object": (text_meta("[1]"), "meta", "no object", "leave the key"),
    "meta of no version": (meta_with(schema_version=...), "meta.schema_version", "None is not a version", "leave the key"),
    "meta of a later version": (meta_with(schema_version=2), "meta.schema_version", "2 is not a version", "again"),
    "meta of version true": (meta_with(schema_version=True), "meta.schema_version", "True is not", "again"),
    "configuration no object": (meta_with(configuration=[]), "meta.configuration", "no JSON object", "ars.toml"),
    "configuration misspelt": (
        meta_with(configuration={"vehicle": {"mas_kg": 2000.0}}),
        "meta.configuration: vehicle.mas_kg",
        "unknown key",
        "did you mean 'mass_kg'",
    ),
    "configuration impossible": (
        meta_with(configuration={"vehicle": {"mass_kg": -1.0}}),
        "meta.configuration: vehicle.mass_kg",
        "-1 is outside 200 to 60000 kg",
        "check the value",
    ),
    "case not in the configuration": (meta_with(case="4ws-3"), "meta.case", "no case '4ws-3'", "did you mean '4ws-"),
    "case that ends a comment": (meta_with(case="a*/b"), "meta.case", "cannot stand in C", "ASCII letters"),
    "case on two lines": (meta_with(case="a\nb"), "meta.case", "cannot stand in C", "ASCII letters"),
    "case illegal without configuration": (
        meta_with(case="é", configuration=...),
        "meta.case",
        "cannot stand in C",
        "ASCII letters",
    ),
    "case a number": (meta_with(case=3), "meta.case", "cannot stand in C", "ASCII letters"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_place_and_remedy(name: str, tmp_path: Path) -> None:
    change, place, fault, remedy = REFUSED[name]
    arrays = solved_arrays()
    change(arrays)
    path = write(tmp_path / "map.npz", arrays)
    before = path.read_bytes()
    error = refusal(path)
    assert error.where == f"{path}: {place}"
    assert fault in error.what
    assert remedy in error.remedy
    assert os.listdir(tmp_path) == ["map.npz"]
    assert path.read_bytes() == before


def test_pickle_in_the_file_is_never_executed(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(tmp_path / "executed"),)

    path = write(tmp_path / "map.npz", plain_arrays() | {"beta": np.array([Bomb()], dtype=object)})
    assert "object array" in refusal(path).what
    assert not (tmp_path / "executed").exists()


def test_configuration_nested_deeper_than_python_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Text that the JSON parser just takes may still be too deep for the message that shows the fault."""

    def parse(*_: object) -> None:
        raise RecursionError

    monkeypatch.setattr(refmap, "parse", parse)
    with pytest.raises(MapError, match=r"meta\.configuration: nested too deep"):
        solved_map()


# --- what is refused: files ---------------------------------------------------------------------------------------------


def test_missing_file(tmp_path: Path) -> None:
    error = refusal(tmp_path / "none.npz")
    assert "No such file" in error.what
    assert "codegen solve" in error.remedy


def test_folder(tmp_path: Path) -> None:
    assert "not a file" in refusal(tmp_path).what


def test_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "map.npz")
    assert "not a file" in refusal(tmp_path / "map.npz").what


def test_unreadable_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "map.npz", plain_arrays())

    def refuse(*_: object) -> None:  # taking the permission away would not stop root
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert "Permission denied" in refusal(path).what


def test_impossible_file_name() -> None:
    with pytest.raises(MapError, match="cannot be read"):
        refmap.load(Path("a\0b.npz"))


@pytest.mark.parametrize("data", [b"", b"P", b"vx,delta_f\n1,2\n", npy(np.arange(3.0)), b"MATLAB 5.0 MAT-file"])
def test_not_a_zip(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "map.npz").write_bytes(data)
    error = refusal(tmp_path / "map.npz")
    assert "not an .npz file" in error.what
    assert "numpy.savez" in error.remedy


def test_cut_short_anywhere(tmp_path: Path) -> None:
    path = write(tmp_path / "map.npz", plain_arrays())
    data = path.read_bytes()
    for length in range(2, len(data), 7):
        path.write_bytes(data[:length])
        error = refusal(path)
        assert "damaged or cut short" in error.what
        assert "again" in error.remedy


def test_damaged_data_names_its_key(tmp_path: Path) -> None:
    path = write(tmp_path / "map.npz", plain_arrays())
    data = bytearray(path.read_bytes())
    data[data.index(plain_arrays()["yaw_rate"].tobytes())] ^= 1
    path.write_bytes(data)
    error = refusal(path)
    assert error.where == f"{path}: yaw_rate"
    assert "CRC" in error.what


@pytest.mark.parametrize("second", ["vx.npy", "vx"])
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_duplicate_member(second: str, tmp_path: Path) -> None:
    members = [*plain_members(), (second, npy(np.array([1.0, 2.0, 3.0, 4.0])))]
    error = refusal(write_members(tmp_path / "map.npz", members))
    assert error.where.endswith(": vx")
    assert "twice" in error.what


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_foreign_compression(compression: int, tmp_path: Path) -> None:
    error = refusal(write_members(tmp_path / "map.npz", plain_members(), compression))
    assert error.where.endswith(": vx")
    assert "compressed in a way" in error.what


def test_encrypted_member(tmp_path: Path) -> None:
    path = write_members(tmp_path / "map.npz", plain_members())
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1  # general purpose flags of the first entry of the directory
    path.write_bytes(data)
    assert "encrypted" in refusal(path).what


@pytest.mark.parametrize(
    ("header", "fault"),
    [
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }", "does not fit"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (-4,), }", "does not fit"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (-2, -2), }", "damaged"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }", "does not fit"),
        ("{'descr': '<f8', 'fortran_order': False, }", "damaged"),
        ("{'descr': 'nonsense', 'fortran_order': False, 'shape': (4,), }", "damaged"),
        ("__import__('os').abort()", "damaged"),
        ("(" * 9_000, "damaged"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (4L,), }" + " " * 20_000, "damaged"),
    ],
)
def test_lying_npy_header(header: str, fault: str, tmp_path: Path) -> None:
    text = header.encode() + b"\n"
    member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(32)
    error = refusal(write_members(tmp_path / "map.npz", [("vx.npy", member), *plain_members()[1:]]))
    assert error.where.endswith(": vx")
    assert fault in error.what


def test_npy_header_of_python_2_is_read_without_a_word(tmp_path: Path) -> None:
    text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (4L,), }\n"
    member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + plain_arrays()["vx"].tobytes()
    path = write_members(tmp_path / "map.npz", [("vx.npy", member), *plain_members()[1:]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(refmap.load(path).speed, plain_arrays()["vx"])


@pytest.mark.parametrize("member", [b"", b"\x93NUMPY", b"\x93NUMPY\x03\x00" + bytes(64), b"not npy at all"])
def test_member_that_is_no_npy(member: bytes, tmp_path: Path) -> None:
    error = refusal(write_members(tmp_path / "map.npz", [("vx.npy", member), *plain_members()[1:]]))
    assert error.where.endswith(": vx")
    assert "damaged" in error.what


def test_over_64_mib_unpacked_is_refused_from_the_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A few kilobytes that unpack to 65 MiB: refused before anything is unpacked, whatever the key."""
    members = [*plain_members(), ("extra.npy", bytes(65 * 2**20))]
    path = write_members(tmp_path / "map.npz", members, zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 2**20
    monkeypatch.setattr(zipfile.ZipFile, "open", None)
    error = refusal(path)
    assert "over 64 MiB unpacked" in error.what
    assert "fewer breakpoints" in error.remedy


def test_size_in_the_directory_is_not_believed(tmp_path: Path) -> None:
    """The directory says 200 bytes, the stream holds 32 MiB: no more than what was said is unpacked."""
    path = write_members(tmp_path / "map.npz", [("vx.npy", bytes(2**25)), *plain_members()[1:]], zipfile.ZIP_DEFLATED)
    data = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        struct.pack_into("<I", data, data.index(signature) + offset, 200)
    path.write_bytes(data)
    tracemalloc.start()
    try:
        error = refusal(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert error.where.endswith(": vx")
    assert "damaged" in error.what
    assert peak < 2**21  # the file of 33 kB, read in a buffer, and change


def test_huge_file_is_not_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    with path.open("wb") as file:
        file.write(b"PK")
        file.truncate(2**40)  # sparse
    assert "over 64 MiB" in refusal(path).what


# --- saving -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("arrays", [plain_arrays, solved_arrays])
def test_round_trip(arrays: Callable[[], Arrays], tmp_path: Path) -> None:
    first = refmap.from_arrays(arrays(), "test")
    refmap.save(first, tmp_path / "map.npz")
    second = refmap.load(tmp_path / "map.npz")
    for name in ("speed", "front_angle", "yaw_rate", "feasible", "sideslip", "rear_angle", "active"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert (first.config, first.case, first.meta) == (second.config, second.case, second.meta)
    assert first.solved == second.solved


def test_saved_file_is_plain_numpy(tmp_path: Path) -> None:
    refmap.save(solved_map(), tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as file:
        assert file.files == ["vx", "delta_f", "yaw_rate", "beta", "delta_r", "feasible", "active", "meta"]
        assert {key: file[key].dtype.str for key in file.files if key != "meta"} == {
            "vx": "<f8",
            "delta_f": "<f8",
            "yaw_rate": "<f8",
            "beta": "<f8",
            "delta_r": "<f8",
            "feasible": "|b1",
            "active": "|u1",
        }
        assert file["meta"].shape == ()
        assert json.loads(file["meta"].item())["case"] == "4ws-2"


def test_same_map_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the clock, the memory layout, the sign of a NaN nor the order of meta shows in the file."""
    first = solved_map()
    assert first.sideslip is not None
    meta = dict(reversed(list(first.meta.items())))
    yaw_rate = np.asfortranarray(np.where(first.feasible, first.yaw_rate, np.copysign(np.nan, -1.0)))
    second = replace(first, yaw_rate=yaw_rate, sideslip=first.sideslip.astype(">f8"), meta=meta)
    refmap.save(first, tmp_path / "first.npz")
    monkeypatch.setattr("time.time", lambda: 2e9)
    monkeypatch.setattr("time.localtime", lambda *_: (2033, 5, 18, 3, 33, 20, 2, 138, 0))
    refmap.save(second, tmp_path / "second.npz")
    assert (tmp_path / "first.npz").read_bytes() == (tmp_path / "second.npz").read_bytes()
    assert (tmp_path / "first.npz").read_bytes() == refmap.to_bytes(refmap.load(tmp_path / "second.npz"))


def test_save_replaces_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    path.write_bytes(b"old")
    refmap.save(solved_map(), path)
    assert path.read_bytes() == refmap.to_bytes(solved_map())
    assert os.listdir(tmp_path) == ["map.npz"]


def test_saved_file_has_the_usual_permissions(tmp_path: Path) -> None:
    refmap.save(solved_map(), tmp_path / "map.npz")
    (tmp_path / "other").write_bytes(b"")
    assert stat.S_IMODE((tmp_path / "map.npz").stat().st_mode) == stat.S_IMODE((tmp_path / "other").stat().st_mode)


@pytest.mark.parametrize("failing", ["os.fsync", "os.replace"])
@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_failed_save_leaves_what_stood(
    failing: str, failure: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.npz"
    path.write_bytes(b"old")

    def fail(*_: object) -> None:
        assert path.read_bytes() == b"old"
        raise failure

    monkeypatch.setattr(failing, fail)
    with pytest.raises(MapError if isinstance(failure, OSError) else KeyboardInterrupt) as caught:
        refmap.save(solved_map(), path)
    if isinstance(caught.value, MapError):
        assert caught.value.where == str(path)
        assert "No space left" in caught.value.what
        assert "space" in caught.value.remedy
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["map.npz"]


def test_file_is_complete_on_disk_before_it_takes_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    happened: list[str] = []
    fsync, rename = os.fsync, os.replace

    def recording_fsync(descriptor: int) -> None:
        happened.append(f"sync {os.fstat(descriptor).st_size}")
        fsync(descriptor)

    def recording_replace(source: Path, target: Path) -> None:
        assert Path(source).parent == Path(target).parent == tmp_path
        happened.append(f"replace {Path(source).stat().st_size}")
        rename(source, target)

    monkeypatch.setattr("os.fsync", recording_fsync)
    monkeypatch.setattr("os.replace", recording_replace)
    refmap.save(solved_map(), tmp_path / "map.npz")
    size = len(refmap.to_bytes(solved_map()))
    assert happened == [f"sync {size}", f"replace {size}"]


def test_save_into_missing_folder_or_over_a_folder(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "none" / "map.npz", tmp_path / "folder"):
        with pytest.raises(MapError, match="cannot be written") as caught:
            refmap.save(solved_map(), path)
        assert caught.value.where == str(path)
        assert "folder" in caught.value.remedy
    assert os.listdir(tmp_path) == ["folder"]


def test_broken_map_is_not_saved(tmp_path: Path) -> None:
    yaw_rate = np.array(solved_map().yaw_rate)
    yaw_rate[1, 1] = np.nan
    with pytest.raises(MapError) as caught:
        refmap.save(replace(solved_map(), yaw_rate=yaw_rate), tmp_path / "map.npz")
    assert caught.value.where == "the map to save: yaw_rate[1, 1]"
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("change", [{"config": None}, {"case": "fws"}, {"meta": {}}])
def test_map_whose_meta_tells_another_story_is_not_saved(change: dict[str, Any]) -> None:
    with pytest.raises(MapError, match="make_meta"):
        refmap.to_bytes(replace(solved_map(), **change))


def test_map_that_could_not_be_read_back_is_not_saved(monkeypatch: pytest.MonkeyPatch) -> None:
    size = len(refmap.to_bytes(solved_map()))
    monkeypatch.setattr(archive, "MAX_UNPACKED_BYTES", size // 2)
    with pytest.raises(MapError, match="fewer breakpoints"):
        refmap.to_bytes(solved_map())


# --- anything at all ----------------------------------------------------------------------------------------------------

SAVED = refmap.to_bytes(solved_map())
STACKED = refmap.to_bytes(replace(solved_map(), layers=(FrictionLayer(0.3, solved_map()), FrictionLayer(0.6, solved_map()))))
TEXT = st.text(st.characters(exclude_categories=()))  # lone surrogates too: JSON can escape them
JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


def check_total(data: bytes) -> None:
    """Bytes give a map that keeps its promises, or a MapError: never another exception."""
    try:
        loaded = refmap.from_bytes(data, "fuzz")
    except MapError as error:
        assert error.remedy
        return
    n, m = loaded.yaw_rate.shape
    assert (loaded.speed.shape, loaded.front_angle.shape, loaded.feasible.shape) == ((n,), (m,), (n, m))
    assert loaded.feasible.any()
    assert np.all(np.diff(loaded.speed) > 0.0)
    assert np.all(np.diff(loaded.front_angle) > 0.0)
    for found in (loaded, *(layer.map for layer in loaded.layers)):
        assert found.feasible.any()
        np.testing.assert_array_equal(np.isnan(found.yaw_rate), ~found.feasible)
    assert refmap.to_bytes(refmap.from_bytes(refmap.to_bytes(loaded), "again")) == refmap.to_bytes(loaded)


@settings(deadline=None)
@given(st.binary(max_size=400), st.sampled_from([b"", b"PK\x03\x04", b"PK\x05\x06"]))
def test_random_bytes(tail: bytes, start: bytes) -> None:
    check_total(start + tail)


@settings(deadline=None)
@given(st.sampled_from([SAVED, STACKED]), st.lists(st.floats(0.0, 1.0, exclude_max=True), min_size=1, max_size=4))
def test_flipped_bits_of_a_file(saved: bytes, places: list[float]) -> None:
    data = bytearray(saved)
    for bit in (int(place * 8 * len(data)) for place in places):
        data[bit // 8] ^= 1 << bit % 8
    check_total(bytes(data))


@settings(deadline=None)
@given(st.data())
def test_flipped_bits_behind_a_good_checksum(data: st.DataObject) -> None:
    """The archive is whole, so the damage reaches the npy header, the numbers and the JSON."""
    with zipfile.ZipFile(io.BytesIO(data.draw(st.sampled_from([SAVED, STACKED])))) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = data.draw(st.sampled_from(sorted(members)))
    member = bytearray(members[name])
    last = data.draw(st.sampled_from([min(128, len(member)), len(member)]))  # the header half of the time
    for bit in data.draw(st.lists(st.integers(0, 8 * last - 1), min_size=1, max_size=4)):
        member[bit // 8] ^= 1 << bit % 8
    members[name] = bytes(member)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for key, content in members.items():
            archive.writestr(key, content)
    check_total(stream.getvalue())


@settings(deadline=None)
@given(
    st.fixed_dictionaries(
        {"schema_version": st.just(1)},
        optional={
            "case": JSON_VALUES,
            "configuration": st.dictionaries(st.sampled_from(["vehicle", "cases", "x"]), JSON_VALUES),
        },
    )
)
def test_any_json_in_meta(meta: dict[str, Any]) -> None:
    try:
        refmap.from_arrays(plain_arrays() | {"meta": np.array(json.dumps(meta))}, "fuzz")
    except MapError as error:
        assert error.where.startswith("fuzz: meta")
